//! Status of one computer: facts ([`ObservedSituation`]), findings ([`findings`]) and texts. Terminal ([`text`],
//! [`watch`], [`command`]) and page ([`crate::view`]) show the same object, [`Status`], which `alight status --json`
//! prints. `alight check` also uses [`finding`]s.

pub mod certificate;
pub mod command;
pub mod compass;
pub mod drone;
pub mod finding;
pub mod findings;
pub mod go;
pub mod sources;
pub mod text;
pub mod vessel;
pub mod watch;

use alight_computer::{process::snapshot::Snapshot, situation::ObservedSituation};
use alight_shared::msg::{ComputerReport, Course};
use alight_transport::clock::steady_ns;
use compass::Compass;
use finding::{Finding, FindingLevel, FindingTopic};
use go::{Go, Stage};
use serde::Serialize;
use vessel::DRONES;

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StateView {
    pub name: String,
    pub does: &'static str,
    /// Time in this state, s; 0 if the state has not changed since the mission began.
    pub since_s: f64,
    pub entered: String,
    /// Condition of the next state, with value and limit; may be empty.
    pub waiting: String,
    /// Reason why a recent order is not carried out; may be empty.
    pub rejected: String,
    pub sentence: String,
    pub stages: Vec<Stage>,
    pub stale: bool,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Figure {
    pub name: &'static str,
    /// Value with unit; None if unknown.
    pub value: Option<String>,
    pub note: String,
    /// Worst level of the findings whose topic has this name.
    pub level: FindingLevel,
    pub stale: bool,
}

impl Figure {
    pub fn of(name: &'static str, value: impl Into<String>, note: impl Into<String>) -> Figure {
        Figure {
            name,
            value: Some(value.into()),
            note: note.into(),
            ..Figure::default()
        }
    }
    pub fn unknown(name: &'static str) -> Figure {
        Figure {
            name,
            ..Figure::default()
        }
    }
    pub fn stale(self, stale: bool) -> Figure {
        Figure { stale, ..self }
    }
}

/// Silence after which a drone is out of reach, s; drones report at 2 Hz.
pub const LOST_CONTACT_S: f64 = 5.0;
pub const ARMED_REMEDY: &str = "keep clear of its rotors";

fn processes(s: &ObservedSituation) -> Option<Figure> {
    let names: Vec<&str> = s
        .snapshot
        .processes
        .keys()
        .filter(|kind| s.reports(**kind))
        .map(|kind| kind.name())
        .collect();
    let value = format!("{} run", names.len());
    (!s.snapshot.processes.is_empty()).then(|| Figure::of("processes", value, names.join(", ")))
}

pub fn course(course: Course) -> String {
    match course {
        Course::Unknown => "not stated".into(),
        Course::Steady(for_s) => format!("steady for {for_s:.0} s"),
        Course::Turning => "turning".into(),
    }
}

#[derive(Clone, Debug, Default, Serialize)]
pub struct Status {
    pub title: String,
    pub running: bool,
    pub headline: String,
    /// Whether a landing may be ordered now or may continue. On a vessel this takes the report of the foremost drone
    /// into account.
    pub go: Go,
    pub state: Option<StateView>,
    /// Wind, waves and advised heading relative to the bow; None if no heading is known.
    pub compass: Option<Compass>,
    pub figures: Vec<Figure>,
    pub worst: FindingLevel,
    pub findings: Vec<Finding>,
    #[serde(flatten)]
    pub situation: ObservedSituation,
}

impl Status {
    /// Status of a computer with configuration `configured`, from the `snapshot` of its processes; None if no process
    /// runs.
    pub fn look(snapshot: Option<&Snapshot>, configured: &ComputerReport) -> Status {
        match snapshot {
            Some(snapshot) => Status::of(ObservedSituation::look(snapshot, configured, steady_ns())),
            None => Status::absent(configured),
        }
    }
    pub fn of(situation: ObservedSituation) -> Status {
        if situation.known.vessel.is_some() && situation.vessel().is_none() {
            const TOPIC: FindingTopic = FindingTopic("processes");
            const FOUND: &str = "the vessel's process does not report";
            const REMEDY: &str = "read the cause in its journal: journalctl -u alight-vessel";
            let found = if situation.has_waited() {
                TOPIC.broken(FOUND, REMEDY)
            } else {
                TOPIC.warning(FOUND, REMEDY)
            };
            return Status {
                running: true,
                ..Status::without(&situation.known, "does not report", found)
            };
        }
        let findings = findings::judge(&situation);
        let worst = FindingLevel::worst(&findings);
        let (state, headline, mut figures, compass) = match situation.vessel() {
            Some((known, status)) => {
                let state = vessel::state(&situation, status);
                let figures = vessel::figures(&situation, known, status);
                let headline = vessel::headline(&situation, worst);
                let compass = compass::of_vessel(status, vessel::blowing(status), situation.known.knots);
                (state, headline, figures, compass)
            }
            None => {
                let state = drone::state(&situation);
                let headline = drone::headline(state.as_ref());
                let figures = drone::figures(&situation);
                (state, headline, figures, compass::of_drone(&situation))
            }
        };
        let go = match situation.vessel() {
            Some((_, status)) => vessel::go(&findings, status),
            None => drone::go(&situation, &findings),
        };
        // Each of several drones has a figure with a separate level.
        for figure in figures.iter_mut().filter(|f| f.name != DRONES) {
            let own = findings.iter().filter(|f| f.topic == figure.name);
            figure.level = own.map(|f| f.level).max().unwrap_or_default();
        }
        Status {
            title: situation.known.title.to_string(),
            running: true,
            headline,
            go,
            state,
            compass,
            figures,
            worst,
            findings,
            situation,
        }
    }
    pub fn absent(known: &ComputerReport) -> Status {
        const TOPIC: FindingTopic = FindingTopic("processes");
        const FOUND: &str = "no process runs on this computer, or this user has no access to it";
        let found = if known.vessel.is_some() {
            TOPIC.warning(
                FOUND,
                "systemctl status alight-vessel; run this as its user: sudo -u alight alight status",
            )
        } else {
            TOPIC.warning(
                FOUND,
                "systemctl status alight-drone, or alight land; run this as its user: sudo -u alight alight status",
            )
        };
        Status::without(known, "no process runs", found)
    }
    fn without(known: &ComputerReport, headline: &str, why: Finding) -> Status {
        Status {
            title: known.title.to_string(),
            headline: headline.into(),
            go: Go::of(core::slice::from_ref(&why), Some(&why.found)),
            worst: why.level,
            findings: vec![why],
            situation: ObservedSituation {
                known: *known,
                ..ObservedSituation::default()
            },
            ..Status::default()
        }
    }
    pub fn alarms(&self) -> Vec<&Finding> {
        let mut all: Vec<&Finding> = self
            .findings
            .iter()
            .filter(|f| f.level > FindingLevel::Fine)
            .collect();
        all.sort_by_key(|f| core::cmp::Reverse((f.level, f.stops)));
        all
    }
}
