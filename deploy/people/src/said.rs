//! Judge of statements: rules on the texts of status and page, checked five times a second against the messages from
//! which they are made. The judge of flights is `alight_sim::harness::storm::watch`.

use alight_computer::{
    process::snapshot::Snapshot,
    record::{
        messages::{Message, each_message},
        observer::StepObserver,
    },
    situation::ObservedSituation,
};
use alight_shared::{
    msg::{
        Command, CommandKind, ComputerReport, DroneContact, DroneStatus, Seq, State, VesselReport,
        VesselStatus,
    },
    process::ProcessKind,
    step::Step,
    time::{Time, TrueTime},
    topics,
};
use serde::Serialize;

use crate::{
    status::{Status, go},
    view::{board::Board, picture::Picture},
};

const PERIOD_NS: i64 = 200_000_000;
/// Shortest time between two changes of words without a new state or order, less the time between two moments, ns.
const WORDS_NS: i64 = 700_000_000;
/// Boot and sequence of an order that the mission has received.
type Echo = Option<[u32; 2]>;
/// Maximum length of a warning that stops a landing and stands first, characters: two lines on a phone.
const WARNING_CHARS: usize = 110;

/// Statements of one page at one moment, with the messages from which they are made.
struct Moment<'a> {
    page: &'a Picture,
    status: &'a Status,
    /// The mission's report as the vessel receives it.
    report: DroneStatus,
    order: Option<Command>,
    /// The words of the large sentence change twice within a second in one state.
    flickers: bool,
}

/// Name of a rule, and whether a moment breaks it.
type StatementRule = (&'static str, fn(&Moment<'_>) -> bool);

/// Rules for every page and moment.
const RULES: [StatementRule; 11] = [
    (
        "numbers are finite, and no remaining time is negative",
        odd_number,
    ),
    ("green only where the mission lands", green),
    ("GO and NO-GO only before an order", verdict),
    ("the large sentence is about what is awaited now", not_awaited),
    ("words of the large sentence last for a second", |m| m.flickers),
    ("a rejected order has a line of its own", rejected),
    ("no advice to turn during a landing", advice),
    ("a time of contact only before a contact", contact),
    ("a lost radio is shown with its age", link),
    ("the most urgent warning is first and short", not_urgent),
    ("an abort is taken", abort_rejected),
];

fn texts(page: &Picture) -> impl Iterator<Item = &str> {
    let status = &page.status;
    let state = status.state.iter();
    let state = state.flat_map(|s| [&s.entered, &s.waiting, &s.sentence]);
    let figures = status.figures.iter();
    let figures = figures.flat_map(|f| f.value.iter().chain([&f.note]));
    let findings = status.findings.iter().flat_map(|f| [&f.found, &f.remedy]);
    let compass = status.compass.iter().map(|c| &c.text);
    let all = state.chain(figures).chain(findings).chain(compass);
    all.chain([&status.go.why]).map(String::as_str)
}

fn odd_number(m: &Moment<'_>) -> bool {
    texts(m.page).any(|text| {
        let words: Vec<&str> = text.split([' ', ',', ';', ':', '(', ')']).collect();
        words.iter().zip(words.iter().skip(1)).any(|(word, unit)| {
            let negative = word.starts_with('-');
            let is_rest = ["s", "min"].contains(unit);
            let number = word.parse::<f64>();
            number.is_ok_and(|n| !n.is_finite() || negative && (n == 0.0 || is_rest))
        })
    })
}

fn green(m: &Moment<'_>) -> bool {
    let lands = go::descends(m.report.state) && !go::is_unlikely(m.report.waiting.code);
    m.status.go.go == Some(true) && go::is_ordered(&m.report) && !lands
}

fn verdict(m: &Moment<'_>) -> bool {
    let wrong = if go::is_ordered(&m.report) {
        ["GO", "NO-GO"]
    } else {
        ["LANDS", "WAITS"]
    };
    wrong.contains(&m.status.go.verdict)
}

fn not_awaited(m: &Moment<'_>) -> bool {
    let report = &m.report;
    let ended = report.state.ending().is_some() || report.state == State::StandDown;
    let waits = report.waits();
    m.status.state.as_ref().is_some_and(|shown| {
        let text = &shown.sentence;
        let now = !waits.is_empty() && text.ends_with(&waits);
        let does = text == report.state.does();
        !(now || does || ended && *text == report.entered.to_string())
    })
}

fn rejected(m: &Moment<'_>) -> bool {
    let shown = m.status.state.as_ref();
    shown.is_some_and(|s| s.rejected.is_empty() != m.report.rejected.is_none())
}

fn advice(m: &Moment<'_>) -> bool {
    let arrow = m.status.compass.as_ref().and_then(|c| c.advised_deg);
    let advised = arrow.is_some() || texts(m.page).any(|text| text.contains("turn to "));
    advised && go::descends(m.report.state)
}

fn contact(m: &Moment<'_>) -> bool {
    let planned = m.page.scene.as_ref().is_some_and(|s| s.contact.is_some());
    planned && !go::descends(m.report.state)
}

fn link(m: &Moment<'_>) -> bool {
    let age_s = m.status.situation.link_age_s().filter(|s| s.is_finite());
    let lost = age_s.is_some_and(|s| s > topics::ESTIMATE.stale_after.secs());
    let figure = m.status.figures.iter().find(|f| f.name == "link");
    lost && figure.is_some_and(|f| f.value.is_none() || f.note.contains("latency"))
}

fn not_urgent(m: &Moment<'_>) -> bool {
    let alarms = m.status.alarms();
    alarms.first().is_some_and(|first| {
        let more = alarms
            .iter()
            .any(|f| (f.level, f.stops) > (first.level, first.stops));
        more || first.stops && first.found.chars().count() > WARNING_CHARS
    })
}

fn abort_rejected(m: &Moment<'_>) -> bool {
    let abort = m.order.filter(|o| o.kind == CommandKind::Abort);
    abort.is_some_and(|o| {
        let own = |echo| echo == [o.header.boot, o.header.sequence];
        m.report.echo().answers(o.kind, own) == Some(false)
    })
}

/// First statement of a flight that breaks a rule, and the number of moments that break it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BrokenStatement {
    pub rule: &'static str,
    pub page: &'static str,
    pub t_s: f64,
    /// All texts of the page.
    pub text: String,
    pub moments: u32,
}

/// Judge of the statements of one flight, on the drone's page and on its vessel's.
#[derive(Default, Serialize)]
pub struct Statements {
    #[serde(skip)]
    board: Board,
    #[serde(skip)]
    order: Option<Command>,
    #[serde(skip)]
    due_ns: i64,
    /// State, newest abort, and newest other order; words of the large sentence; the time of their last change, ns.
    #[serde(skip)]
    shown: (Option<(State, Echo, Echo)>, String, i64),
    pub judged: u32,
    pub broken: Vec<BrokenStatement>,
}

impl StepObserver for Statements {
    fn step(&mut self, t: Time<TrueTime>, step: &Step<'_>) {
        each_message(step, &mut |message| {
            if let Message::Command(order) = message {
                self.order = Some(*order);
            }
            self.board.message(t, &message);
        });
        if step.process == ProcessKind::Mission && t.nanos() >= self.due_ns {
            self.due_ns = t.nanos() + PERIOD_NS;
            self.judge(t);
        }
    }
}

impl Statements {
    pub fn text(&self) -> String {
        let mut text = format!("statements judged at {} moments", self.judged);
        for b in &self.broken {
            text += &format!(
                "\n{:>6}  broken on the {}'s page, first at {:.1} s: {}\n        {}",
                b.moments, b.page, b.t_s, b.rule, b.text
            );
        }
        text
    }
    fn judge(&mut self, t: Time<TrueTime>) {
        let drone = self.board.picture(t);
        let snapshot = &self.board.situation.snapshot;
        let Some(mission) = *snapshot.mission else {
            return;
        };
        let report = DroneStatus::of(mission.header, &mission, snapshot.autopilot.as_ref(), None);
        let vessel = Picture {
            status: vessel_status(snapshot, report, t.nanos()),
            ..Picture::default()
        };
        self.judged += 1;
        let sentence = drone.status.state.iter().flat_map(|s| s.sentence.chars());
        let words: String = sentence.filter(|c| !c.is_ascii_digit()).collect();
        let event = Some((mission.state, mission.abort, mission.order));
        let (before, shown, since_ns) = &self.shown;
        let differs = *shown != words;
        let flickers = differs && *before == event && t.nanos() - since_ns < WORDS_NS;
        if differs || *before != event {
            self.shown = (event, words, t.nanos());
        }
        // A vessel that no longer receives the drone says so instead.
        let received = !snapshot.mission.is_old(t.nanos());
        let pages = [("drone", &drone), ("vessel", &vessel)];
        for (name, page) in pages.into_iter().filter(|(name, _)| received || *name == "drone") {
            let moment = Moment {
                page,
                status: &page.status,
                report,
                order: self.order,
                flickers: flickers && name == "drone",
            };
            for &(rule, _) in RULES.iter().filter(|(_, breaks)| breaks(&moment)) {
                let mut known = self.broken.iter_mut();
                if let Some(known) = known.find(|b| b.rule == rule && b.page == name) {
                    known.moments += 1;
                    continue;
                }
                self.broken.push(BrokenStatement {
                    rule,
                    page: name,
                    t_s: t.secs(),
                    text: texts(page).collect::<Vec<_>>().join(" | "),
                    moments: 1,
                });
            }
        }
    }
}

/// Status of a vessel that receives this drone alone.
fn vessel_status(drone: &Snapshot, report: DroneStatus, now_ns: i64) -> Status {
    let contact = DroneContact {
        age_s: drone.mission.age_s(now_ns),
        status: report,
    };
    let mut vessel = VesselStatus {
        deck_owner: Some(report.header.drone),
        drones: Seq::filled([contact]),
        ..VesselStatus::default()
    };
    vessel.estimator.advice = drone.wave.and_then(|w| w.advice);
    let known = ComputerReport {
        vessel: Some(VesselReport::default()),
        ..ComputerReport::default()
    };
    let snapshot = Snapshot {
        vessel: vessel.into(),
        computer: known.into(),
        ..Snapshot::default()
    };
    Status::of(ObservedSituation::of(&snapshot, now_ns))
}
