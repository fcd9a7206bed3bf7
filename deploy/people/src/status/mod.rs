//! Status of one computer: what is known ([`ObservedSituation`]), what it means ([`findings`]), and its texts. Terminal
//! ([`text`], [`watch`], [`command`]) and page ([`crate::view`]) show one object, [`Status`], which `alight status --json`
//! prints; `alight check` reports in the same [`finding`]s.

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

use alight_computer::process::snapshot::Snapshot;
use alight_computer::situation::ObservedSituation;
use alight_shared::msg::ComputerReport;
use alight_shared::msg::Course;
use alight_transport::clock::steady_ns;
use compass::Compass;
use finding::{Finding, FindingLevel, FindingTopic};
use go::{Go, Stage};
use serde::Serialize;
use vessel::DRONES;

/// The state of a landing.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StateView {
    pub name: String,
    /// Action of the drone in it.
    pub does: &'static str,
    /// Since when, s; 0 where it has not changed since the mission began.
    pub since_s: f64,
    /// Why it was entered; empty: no reason.
    pub entered: String,
    /// Condition of the next state, with figure and limit; empty: none.
    pub waiting: String,
    /// The one sentence that counts ([`go::sentence`]).
    pub sentence: String,
    /// The stages of a landing, and which of them it is.
    pub stages: Vec<Stage>,
    /// Nothing new is known of it.
    pub stale: bool,
}

/// A figure with its name.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Figure {
    pub name: &'static str,
    /// With its unit; None: not known.
    pub value: Option<String>,
    pub note: String,
    /// The worst of the findings with this name as their topic.
    pub level: FindingLevel,
    /// It is an old one.
    pub stale: bool,
}

impl Figure {
    /// One that is known.
    pub fn of(name: &'static str, value: impl Into<String>, note: impl Into<String>) -> Figure {
        Figure {
            name,
            value: Some(value.into()),
            note: note.into(),
            ..Figure::default()
        }
    }
    /// One that is not known.
    pub fn unknown(name: &'static str) -> Figure {
        Figure {
            name,
            ..Figure::default()
        }
    }
    /// From a message that may be an old one.
    pub fn stale(self, stale: bool) -> Figure {
        Figure { stale, ..self }
    }
}

/// Remedy for motors that run on the deck.
pub const ARMED_REMEDY: &str = "keep clear of its rotors";

/// The processes that report.
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

/// Course that the helm states.
pub fn course(course: Course) -> String {
    match course {
        Course::Unknown => "not stated".into(),
        Course::Steady(for_s) => format!("steady for {for_s:.0} s"),
        Course::Turning => "turning".into(),
    }
}

/// A computer's situation and what it means.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Status {
    /// Whose it is.
    pub title: String,
    /// Whether its processes run.
    pub running: bool,
    /// The state, in one clause.
    pub headline: String,
    /// Whether a landing may be ordered now, or go on; of a vessel with what her foremost drone reports.
    pub go: Go,
    /// The state of the landing; None: not known.
    pub state: Option<StateView>,
    /// Wind, waves and advised heading from the bow; None: no heading is known.
    pub compass: Option<Compass>,
    /// Figures, the most important first.
    pub figures: Vec<Figure>,
    /// The worst of the findings.
    pub worst: FindingLevel,
    /// Findings with their remedies.
    pub findings: Vec<Finding>,
    /// The situation of the findings.
    #[serde(flatten)]
    pub situation: ObservedSituation,
}

impl Status {
    /// The status of a computer that is `configured` so, by the `snapshot` of its processes; None: nothing runs.
    pub fn look(snapshot: Option<&Snapshot>, configured: &ComputerReport) -> Status {
        match snapshot {
            Some(snapshot) => Status::of(ObservedSituation::look(snapshot, configured, steady_ns())),
            None => Status::absent(configured),
        }
    }
    /// The status of this situation.
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
                let compass = compass::of_vessel(status, vessel::wind(status), situation.known.knots);
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
        // Of several drones each has a figure, which judges itself.
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
    /// Status of a computer on which nothing runs.
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
    /// Status of a computer of which no more is known.
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
    /// The findings that are not fine, the worst first.
    pub fn alarms(&self) -> Vec<&Finding> {
        let mut all: Vec<&Finding> = self
            .findings
            .iter()
            .filter(|f| f.level > FindingLevel::Fine)
            .collect();
        all.sort_by_key(|f| core::cmp::Reverse(f.level));
        all
    }
}
