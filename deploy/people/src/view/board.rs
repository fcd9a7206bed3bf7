//! Board: situation and history of a running flight, from which it makes the page's picture.

use std::collections::VecDeque;

use alight_bridge::BridgeOut;
use alight_computer::process::snapshot::minutes;
use alight_computer::situation::ObservedSituation;
use alight_shared::msg::{ComputerReport, DeckDimensions, MissionState, ReasonCode, State, VesselEstimate};
use alight_shared::process::ProcessState;
use alight_shared::time::{DroneClock, Time, TrueTime};
use alight_shared::topics;
use alight_uav::mission::{MissionIn, MissionOut};
use alight_uav::pilot::PilotOut;
use alight_uav::planner::PlannerOut;
use alight_uav::predictor::{PredictorIn, PredictorOut};
use alight_usv::ComputerOut;

use crate::status::Status;
use crate::view::camera_image::ShownImage;
use crate::view::motion::MotionHistory;
use crate::view::picture::{FlightLine, LogLine, OrderView, Picture, ResultView, SceneView};
use crate::view::scene::scene;
use crate::view::track::GroundTrack;

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

pub struct Board {
    pub situation: ObservedSituation,
    /// Roll, pitch (rad) and height (m) by the vessel's own estimate, with the time of reception.
    own_motion: Option<(Time<TrueTime>, [f64; 3])>,
    motion: MotionHistory,
    track: GroundTrack,
    /// The newest motion is the vessel's own estimate.
    is_own: bool,
    log: VecDeque<(Time<TrueTime>, String)>,
    flights: VecDeque<Ended>,
    begun: Option<Time<TrueTime>>,
    shown: Option<State>,
    /// Flights of earlier runs, the newest first, as their recorder lists them.
    pub earlier: Vec<FlightLine>,
    pub order: OrderView,
    pub camera: Option<ShownImage>,
    /// Depth of the foot plane below the drone's centre of mass, and height of the deck above the water at rest, m, if
    /// known.
    pub heights_m: Option<[f64; 2]>,
    /// Clearance of the feet at which the flare begins, m, once the mission has named it.
    flare_m: Option<f64>,
}

impl Board {
    pub fn new(known: ComputerReport) -> Board {
        Board {
            situation: ObservedSituation {
                known,
                ..ObservedSituation::default()
            },
            own_motion: None,
            motion: MotionHistory::default(),
            track: GroundTrack::default(),
            is_own: false,
            log: VecDeque::new(),
            flights: VecDeque::new(),
            begun: None,
            shown: None,
            earlier: Vec::new(),
            order: OrderView::default(),
            camera: None,
            heights_m: None,
            flare_m: None,
        }
    }
    /// Clears everything except the flights that ended; observes again from `t` on.
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
    pub fn vessel(&mut self, t: Time<TrueTime>, o: &ComputerOut) {
        self.moved(t, o.vessel.estimate.as_ref().map(|e| motion(&e.eta)));
    }
    pub fn received(&mut self, t: Time<TrueTime>, estimate: Option<&VesselEstimate<DroneClock>>) {
        self.moved(t, estimate.map(|e| motion(&e.eta)));
    }
    pub fn bridge(&mut self, t: Time<TrueTime>, o: &BridgeOut) {
        let snapshot = &mut self.situation.snapshot;
        snapshot.link.set(t.nanos(), o.link);
        snapshot.grant.set(t.nanos(), o.deck);
        snapshot.wave.set(t.nanos(), o.wave);
    }
    pub fn predictor(&mut self, t: Time<TrueTime>, i: &PredictorIn, o: &PredictorOut) {
        self.situation.snapshot.drone.set(t.nanos(), i.drone);
        self.situation.snapshot.forecast.set(t.nanos(), o.forecast);
        if let Some(drone) = i.drone {
            let ground = |[north, east, _]: [f64; 3]| [north, east];
            let forecast = self.situation.snapshot.forecast.fresh(t.nanos());
            let deck = forecast.and_then(|f| f.stages.first());
            let deck = deck.map(|s| ground(s.position));
            self.track
                .add(t, drone.frames, Some(ground(drone.position)), deck);
        }
        self.sample(t);
    }
    pub fn mission(&mut self, t: Time<TrueTime>, i: &MissionIn, o: &MissionOut) {
        let was_armed = self.situation.snapshot.autopilot.map(|a| a.armed);
        if was_armed == Some(false) && i.autopilot.is_some_and(|a| a.armed) {
            self.flight_begins();
        }
        self.situation.snapshot.autopilot.set(t.nanos(), i.autopilot);
        if let Some(m) = &o.state {
            self.entered(t, m);
            self.flare_m = flare_m(m).or(self.flare_m);
        }
        self.situation.snapshot.mission.set(t.nanos(), o.state);
    }
    pub fn planner(&mut self, t: Time<TrueTime>, o: &PlannerOut) {
        self.situation.snapshot.plan.set(t.nanos(), o.plan);
    }
    pub fn pilot(&mut self, o: &PilotOut) {
        let newest = o.set_point.map(|s| s.response);
        self.situation.snapshot.response = newest.or(self.situation.snapshot.response);
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

    fn moved(&mut self, t: Time<TrueTime>, motion: Option<[f64; 3]>) {
        self.own_motion = motion.map(|m| (t, m)).or(self.own_motion);
        self.sample(t);
    }
    /// Samples the motion of the vessel's own estimate, or of the drone's forecast if that is missing.
    fn sample(&mut self, t: Time<TrueTime>) {
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

    fn flight_begins(&mut self) {
        self.order.answer.clear();
    }
    /// Logs a change of state, and the flight that it ends.
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
        // A view that began when the drone was already on the deck has observed no flight.
        if let (Some(outcome), Some(_)) = (m.state.ending(), before) {
            let took = self.begun.take().map(|at| (t - at).secs());
            let took = took.map_or(String::new(), |s| format!(", after {}", minutes(s)));
            let plural = if m.attempts == 1 { "" } else { "s" };
            let text = format!("{}; {} descent{plural}{took}", m.entered, m.attempts);
            keep(&mut self.flights, Ended { at: t, outcome, text }, FLIGHTS);
        }
        if !m.state.is_landing() {
            self.begun = None;
        }
    }

    pub fn picture(&self, t: Time<TrueTime>) -> Picture {
        let mut situation = self.situation.clone();
        situation.now_ns = t.nanos();
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
        }
    }

    fn scene(&self, t: Time<TrueTime>) -> Option<SceneView> {
        let size_m = |deck: DeckDimensions| {
            let [.., length, width] = deck.all_m();
            [length, width]
        };
        Some(SceneView {
            size_m: self.situation.known.deck.map(size_m),
            feet_m: self.heights_m.map(|[feet, _]| feet),
            freeboard_m: self.heights_m.map(|[_, freeboard]| freeboard),
            flare_m: self.flare_m,
            ..scene(&self.situation.snapshot, t.nanos())?
        })
    }
}

fn is_flight(state: State) -> bool {
    state.is_landing() || state.is_take_off()
}

/// Clearance of the flare, m, if a reason of the mission names it.
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
