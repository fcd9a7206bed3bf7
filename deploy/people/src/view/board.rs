//! Situation and history of a running flight, as the source of the page's picture.

use std::collections::VecDeque;

use alight_computer::{
    process::{
        lateness::{REAL_TIME_LIMIT_S, REMEDY},
        snapshot::minutes,
    },
    record::messages::Message,
    situation::ObservedSituation,
};
use alight_shared::{
    metrics::MetricName,
    msg::{ComputerReport, DeckDimensions, MissionState, ReasonCode, State, TwoDigits},
    process::{ProcessKind, ProcessState},
    time::{Time, TrueTime},
    topics,
};

use crate::{
    status::{Status, go::descends},
    view::{
        camera_image::ShownImage,
        motion::MotionHistory,
        picture::{FlightLine, LogLine, OrderView, Picture, ResultView, SceneView},
        scene::{drone, scene},
        track::GroundTrack,
    },
};

const LOG_LINES: usize = 12;
const FLIGHTS: usize = 8;

struct Ended {
    at: Time<TrueTime>,
    outcome: &'static str,
    text: String,
}

impl Ended {
    fn result(&self, t: Time<TrueTime>) -> ResultView {
        ResultView {
            ago_s: (t - self.at).secs(),
            outcome: self.outcome,
            text: self.text.clone(),
        }
    }
    fn line(&self, t: Time<TrueTime>) -> FlightLine {
        FlightLine {
            when: format!("{} ago", minutes((t - self.at).secs())),
            outcome: self.outcome.into(),
            text: self.text.clone(),
        }
    }
}

#[derive(Default)]
pub struct Board {
    pub situation: ObservedSituation,
    /// Roll, pitch (rad) and height (m) by the vessel's own estimate, with the time of reception.
    own_motion: Option<(Time<TrueTime>, [f64; 3])>,
    motion: MotionHistory,
    track: GroundTrack,
    is_own: bool,
    has_vessel: bool,
    log: VecDeque<(Time<TrueTime>, String)>,
    flights: VecDeque<Ended>,
    begun: Option<Time<TrueTime>>,
    shown: Option<State>,
    /// Flights of earlier runs, newest first, as their recorder lists them.
    pub earlier: Vec<FlightLine>,
    pub order: OrderView,
    pub camera: Option<ShownImage>,
    /// Depth of the foot plane below the drone's centre of mass, and height of the deck above the water at rest, m,
    /// if known.
    pub heights_m: Option<[f64; 2]>,
    /// Clearance of the feet at which the flare begins, m, once the mission has reported it.
    flare_m: Option<f64>,
    /// Closing speed at the contact of a flare, m/s; None if it was not observed.
    closing_mps: Option<f64>,
    charged: Option<(Time<TrueTime>, f64)>,
}

/// Clearances at which the closing speed equals that at contact, m: above, the drone still brakes; below, errors of
/// odometry and forecast hide a contact.
const CONTACT_M: core::ops::Range<f64> = 0.02..0.08;
/// Decrease of the battery's charge from which its rate is known: gauges show whole per cent.
const KNOWN_FALL: f64 = 0.03;

impl Board {
    pub fn new(known: ComputerReport) -> Board {
        Board {
            situation: ObservedSituation {
                known,
                ..ObservedSituation::default()
            },
            ..Board::default()
        }
    }
    /// Clears everything except the ended flights; observes again from `t` on.
    pub fn reset(&mut self, t: Time<TrueTime>) {
        let known = core::mem::take(&mut self.situation.known);
        let flights = core::mem::take(&mut self.flights);
        let earlier = core::mem::take(&mut self.earlier);
        *self = Board {
            flights,
            earlier,
            heights_m: self.heights_m,
            ..Board::new(known)
        };
        self.situation.snapshot.since_ns = t.nanos();
    }
    pub fn message(&mut self, t: Time<TrueTime>, message: &Message<'_>) {
        let (snapshot, ns) = (&mut self.situation.snapshot, t.nanos());
        match *message {
            Message::OwnEstimate(e) => {
                self.has_vessel = true;
                self.moved(t, motion(&e.eta));
            }
            // The vessel's own estimate is shown instead of the one that a drone received.
            Message::Estimate(_) if self.has_vessel => {}
            Message::Estimate(e) => self.moved(t, motion(&e.eta)),
            Message::Link(m) => snapshot.link.set(ns, Some(*m)),
            Message::Deck(m) => snapshot.grant.set(ns, Some(*m)),
            Message::Wave(m) => snapshot.wave.set(ns, Some(*m)),
            Message::Forecast(m) => {
                snapshot.forecast.set(ns, Some(*m));
                self.sample(t);
            }
            Message::Drone(drone) => {
                snapshot.drone.set(ns, Some(*drone));
                let ground = |[north, east, _]: [f64; 3]| [north, east];
                let forecast = snapshot.forecast.fresh(ns);
                let deck = forecast.and_then(|f| f.stages.first());
                let deck = deck.map(|s| ground(s.position));
                self.track
                    .add(t, drone.frames, Some(ground(drone.position)), deck);
                self.closes(ns);
            }
            Message::Autopilot(a) => {
                let was_armed = snapshot.autopilot.map(|a| a.armed);
                snapshot.autopilot.set(ns, Some(*a));
                if was_armed == Some(false) && a.armed {
                    self.flight_begins();
                }
                let more = |(_, start): &(_, f64)| a.battery.is_none_or(|b| b > *start);
                if !a.armed || self.charged.as_ref().is_none_or(more) {
                    self.charged = a.battery.filter(|_| a.armed).map(|b| (t, b));
                }
            }
            Message::Mission(m) => {
                snapshot.mission.set(ns, Some(*m));
                self.entered(t, m);
                self.flare_m = flare_m(m).or(self.flare_m);
            }
            Message::Plan(_, m) => snapshot.plan.set(ns, Some(*m)),
            Message::SetPoint(_, m) => snapshot.response = Some(m.response),
            Message::Sensors(_)
            | Message::OwnWave(_)
            | Message::Tag(_)
            | Message::Uvdar(_)
            | Message::Range(_)
            | Message::Command(_)
            | Message::FlownPlan(_)
            | Message::Touchdown(_) => {}
        }
    }
    pub fn reported(&mut self, report: Option<ComputerReport>) {
        if let Some(report) = report {
            self.situation.known = report;
            self.situation.snapshot.computer = report.into();
        }
    }
    pub fn processes(&mut self, reports: Vec<ProcessState>) {
        let reports = reports.into_iter().map(|p| (p.kind, p));
        self.situation.snapshot.processes.extend(reports);
    }

    fn moved(&mut self, t: Time<TrueTime>, motion: [f64; 3]) {
        self.own_motion = Some((t, motion));
        self.sample(t);
    }
    /// Samples the motion at `t` from the vessel's own estimate, or without one from the drone's forecast.
    pub fn sample(&mut self, t: Time<TrueTime>) {
        let forecast = self.situation.snapshot.forecast.fresh(t.nanos());
        let stage = forecast.and_then(|f| f.stages.first());
        let of_forecast = stage.map(|s| [s.euler[0], s.euler[1], -s.position[2]]);
        let fresh = |(at, _): &(Time<TrueTime>, _)| t - *at <= topics::ESTIMATE.stale_after;
        let own = self.own_motion.filter(fresh).map(|(_, motion)| motion);
        let sample = own.or(of_forecast);
        if own.is_some() != self.is_own {
            // The two sources measure heights from different levels.
            self.is_own = own.is_some();
            self.motion.relevel(sample);
        }
        self.motion.add(t, sample);
    }

    /// Records the closing speed of a flare, until the contact.
    fn closes(&mut self, ns: i64) {
        if self.shown != Some(State::Flare) {
            return;
        }
        let feet_m = self.heights_m.map_or(0.0, |[feet, _]| feet);
        let drone = drone(&self.situation.snapshot, ns);
        let close = drone.filter(|d| CONTACT_M.contains(&(d.at[2] - feet_m)));
        self.closing_mps = close.map(|d| d.closing_mps).or(self.closing_mps);
    }
    /// Place and speed of a landing by the drone's own estimate.
    fn contact(&self, ns: i64) -> Option<String> {
        let [forward, right, _] = drone(&self.situation.snapshot, ns)?.at;
        let off = TwoDigits(f64::hypot(forward, right));
        let speed = self.closing_mps.map(|v| format!(" at {} m/s", TwoDigits(v)));
        Some(format!(
            "{off} m off the deck's centre{}",
            speed.unwrap_or_default()
        ))
    }
    /// Time until the battery reaches its reserve, s, at the mean rate of this flight.
    fn battery_left_s(&self, t: Time<TrueTime>) -> Option<f64> {
        let (at, start) = self.charged?;
        let snapshot = &self.situation.snapshot;
        let left = (*snapshot.autopilot)?.battery?;
        let fallen = Some(start - left).filter(|fallen| *fallen >= KNOWN_FALL)?;
        let above = (left - (*snapshot.mission)?.battery_reserve).max(0.0);
        Some(above * (t - at).secs() / fallen)
    }
    fn flight_begins(&mut self) {
        self.closing_mps = None;
        self.order.answer.clear();
    }
    fn entered(&mut self, t: Time<TrueTime>, m: &MissionState) {
        let before = self.shown.replace(m.state);
        if before == Some(m.state) {
            return;
        }
        if is_flight(m.state) && !before.is_some_and(is_flight) {
            self.flight_begins();
        }
        keep(&mut self.log, (t, m.state.because(&m.entered)), LOG_LINES);
        if m.state.is_landing() {
            self.begun.get_or_insert(t);
        }
        // A view that began with the drone already on the deck has observed no flight.
        if let (Some(_), Some(_)) = (m.state.ending(), before) {
            let took = self.begun.take().map(|at| (t - at).secs());
            let took = took.map_or(String::new(), |s| format!(", after {}", minutes(s)));
            let plural = if m.attempts == 1 { "" } else { "s" };
            let contact = self.contact(t.nanos()).filter(|_| m.state == State::Landed);
            let how = contact.unwrap_or_else(|| m.entered.to_string());
            let text = format!("{how}; {} descent{plural}{took}", m.attempts);
            let outcome = m.state.named(&m.entered);
            keep(&mut self.flights, Ended { at: t, outcome, text }, FLIGHTS);
        }
        if !m.state.is_landing() {
            self.begun = None;
        }
    }

    pub fn picture(&self, t: Time<TrueTime>) -> Picture {
        let mut situation = self.situation.clone();
        situation.now_ns = t.nanos();
        situation.battery_left_s = self.battery_left_s(t);
        Picture {
            clock_s: 0.0,
            status: Status::of(situation),
            scene: self.scene(t),
            camera: self.camera.map(|c| c.view(t)),
            motion: self.motion.view(),
            track: self.track.view(),
            log: self
                .log
                .iter()
                .rev()
                .map(|(at, text)| LogLine {
                    ago_s: (t - *at).secs(),
                    text: text.clone(),
                })
                .collect(),
            result: self.flights.back().map(|f| f.result(t)),
            flights: self
                .flights
                .iter()
                .rev()
                .map(|f| f.line(t))
                .chain(self.earlier.iter().cloned())
                .take(FLIGHTS)
                .collect(),
            order: self.order.clone(),
            over: None,
            begins_in_s: self.begins_in_s(),
        }
    }
    /// Time until a simulated landing is ordered, s, as the world's process reports it.
    fn begins_in_s(&self) -> Option<f64> {
        let world = self.situation.process(ProcessKind::World)?;
        Some(-world.seconds(MetricName::TimeSinceStart)).filter(|s| *s > 0.0)
    }
    /// Reason why the result of a simulation is not valid, and the remedy.
    pub fn too_slow(&self) -> Option<String> {
        let late_s = self
            .situation
            .process(ProcessKind::World)?
            .seconds(MetricName::LatestTick);
        if late_s <= REAL_TIME_LIMIT_S {
            return None;
        }
        Some(format!(
            "this computer was {late_s:.1} s behind real time, so the result is not valid; {REMEDY}, or run alight trial \
             --view, which needs no real time"
        ))
    }
    pub fn is_simulated(&self) -> bool {
        self.situation.process(ProcessKind::World).is_some()
    }

    fn scene(&self, t: Time<TrueTime>) -> Option<SceneView> {
        let size_m = |deck: DeckDimensions| {
            let [.., length, width] = deck.all_m();
            [length, width]
        };
        let scene = scene(&self.situation.snapshot, t.nanos())?;
        let descends = self.shown.is_some_and(descends);
        Some(SceneView {
            contact: scene.contact.clone().filter(|_| descends),
            size_m: self.situation.known.deck.map(size_m),
            feet_m: self.heights_m.map(|[feet, _]| feet),
            freeboard_m: self.heights_m.map(|[_, freeboard]| freeboard),
            flare_m: self.flare_m,
            limit_deg: self.situation.known.deck_tilt_rad.map(f64::to_degrees),
            ..scene
        })
    }
}

fn is_flight(state: State) -> bool {
    state.is_landing() || state.is_take_off()
}

/// Clearance of the flare, m, if a reason of the mission contains it.
fn flare_m(m: &MissionState) -> Option<f64> {
    let names = |code| matches!(code, ReasonCode::Descending | ReasonCode::FlareHeight);
    let reasons = [m.waiting, m.entered];
    reasons.iter().find(|r| names(r.code)).map(|r| r.limit)
}

fn motion(eta: &[f64; 6]) -> [f64; 3] {
    [eta[3], eta[4], -eta[2]]
}

fn keep<T>(kept: &mut VecDeque<T>, new: T, most: usize) {
    kept.push_back(new);
    while kept.len() > most {
        kept.pop_front();
    }
}

#[cfg(test)]
mod tests;
