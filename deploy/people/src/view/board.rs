//! Board: situation of a running flight, its history, and the picture of both that the page shows.

use std::collections::VecDeque;

use alight_bridge::BridgeOut;
use alight_computer::process::snapshot::minutes;
use alight_computer::situation::Situation;
use alight_shared::frames::wrap_angle;
use alight_shared::msg::{ComputerReport, MissionState, State, VesselEstimate};
use alight_shared::process::ProcessState;
use alight_shared::time::{DroneClock, Span, Time, TrueTime};
use alight_shared::topics;
use alight_uav::mission::{MissionIn, MissionOut};
use alight_uav::pilot::PilotOut;
use alight_uav::planner::PlannerOut;
use alight_uav::predictor::{PredictorIn, PredictorOut};
use alight_usv::ComputerOut;

use crate::status::Status;
use crate::view::camera_image::ShownImage;
use crate::view::motion::MotionHistory;
use crate::view::picture::{
    DroneView, FlightLine, LogLine, OrderView, Picture, Place, ResultView, SceneView,
};
use crate::view::track::Track;

/// Changes of state that are kept.
const LOG_LINES: usize = 12;
/// Flights that are kept.
const FLIGHTS: usize = 8;
/// Every so many stages of forecast and plan are drawn.
const PATH_STEP: usize = 2;
/// A plan that is older is not drawn any more, s: the vessel has left it behind.
const FORGOTTEN_S: f64 = 5.0;

/// A flight that ended.
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

/// What is known of a flight.
pub struct Board {
    /// What is known of the computer.
    pub situation: Situation,
    /// Roll, pitch (rad) and height (m) by the vessel's own estimate, and when it came.
    own_motion: Option<(Time<TrueTime>, [f64; 3])>,
    motion: MotionHistory,
    track: Track,
    /// The newest motion is the vessel's own estimate of it.
    is_own: bool,
    log: VecDeque<(Time<TrueTime>, String)>,
    flights: VecDeque<Ended>,
    /// When the landing was begun that goes on.
    begun: Option<Time<TrueTime>>,
    shown: Option<State>,
    /// Flights of earlier runs, the newest first, from whoever keeps them.
    pub earlier: Vec<FlightLine>,
    /// The order that may be given, and its answer.
    pub order: OrderView,
    /// The newest image of the drone's camera.
    pub camera: Option<ShownImage>,
}

impl Board {
    /// Nothing is known yet but this.
    pub fn new(known: ComputerReport) -> Board {
        Board {
            situation: Situation {
                known,
                ..Situation::default()
            },
            own_motion: None,
            motion: MotionHistory::default(),
            track: Track::default(),
            is_own: false,
            log: VecDeque::new(),
            flights: VecDeque::new(),
            begun: None,
            shown: None,
            earlier: Vec::new(),
            order: OrderView::default(),
            camera: None,
        }
    }
    /// Forgets what is known but for the flights that ended; observes again from `t` on.
    pub fn reset(&mut self, t: Time<TrueTime>) {
        let known = core::mem::take(&mut self.situation.known);
        let flights = core::mem::take(&mut self.flights);
        let earlier = core::mem::take(&mut self.earlier);
        *self = Board {
            flights,
            earlier,
            ..Board::new(known)
        };
        self.situation.seen.since_ns = t.nanos();
    }
    /// A step of the vessel.
    pub fn vessel(&mut self, t: Time<TrueTime>, o: &ComputerOut) {
        self.moved(t, o.vessel.estimate.as_ref().map(|e| motion(&e.eta)));
    }
    /// The vessel's broadcast as the bridge received it.
    pub fn received(&mut self, t: Time<TrueTime>, estimate: Option<&VesselEstimate<DroneClock>>) {
        self.moved(t, estimate.map(|e| motion(&e.eta)));
    }
    /// A step of the bridge.
    pub fn bridge(&mut self, t: Time<TrueTime>, o: &BridgeOut) {
        let seen = &mut self.situation.seen;
        seen.link.set(t.nanos(), o.link);
        seen.grant.set(t.nanos(), o.deck);
        seen.wave.set(t.nanos(), o.wave);
    }
    /// A step of the predictor.
    pub fn predictor(&mut self, t: Time<TrueTime>, i: &PredictorIn, o: &PredictorOut) {
        self.situation.seen.drone.set(t.nanos(), i.drone);
        self.situation.seen.forecast.set(t.nanos(), o.forecast);
        if let Some(drone) = i.drone {
            let ground = |[north, east, _]: [f64; 3]| [north, east];
            let forecast = self.situation.seen.forecast.fresh(t.nanos());
            let deck = forecast.and_then(|f| f.stages.first());
            let deck = deck.map(|s| ground(s.position));
            self.track
                .add(t, drone.frames, Some(ground(drone.position)), deck);
        }
        self.sample(t);
    }
    /// A step of the mission.
    pub fn mission(&mut self, t: Time<TrueTime>, i: &MissionIn, o: &MissionOut) {
        let was_armed = self.situation.seen.autopilot.map(|a| a.armed);
        if was_armed == Some(false) && i.autopilot.is_some_and(|a| a.armed) {
            self.flight_begins();
        }
        self.situation.seen.autopilot.set(t.nanos(), i.autopilot);
        if let Some(m) = &o.state {
            self.entered(t, m);
        }
        self.situation.seen.mission.set(t.nanos(), o.state);
    }
    /// A step of the planner.
    pub fn planner(&mut self, t: Time<TrueTime>, o: &PlannerOut) {
        self.situation.seen.plan.set(t.nanos(), o.plan);
    }
    /// A step of the pilot.
    pub fn pilot(&mut self, o: &PilotOut) {
        let newest = o.set_point.map(|s| s.response);
        self.situation.seen.response = newest.or(self.situation.seen.response);
    }
    /// What the computer reports of itself.
    pub fn reported(&mut self, report: Option<ComputerReport>) {
        self.situation.known = report.unwrap_or(self.situation.known);
    }
    /// Reports of processes.
    pub fn processes(&mut self, reports: Vec<ProcessState>) {
        let reports = reports.into_iter().map(|p| (p.kind, p));
        self.situation.seen.processes.extend(reports);
    }

    fn moved(&mut self, t: Time<TrueTime>, motion: Option<[f64; 3]>) {
        self.own_motion = motion.map(|m| (t, m)).or(self.own_motion);
        self.sample(t);
    }
    /// The motion by the vessel's own estimate; by the drone's forecast where that does not come.
    fn sample(&mut self, t: Time<TrueTime>) {
        let forecast = self.situation.seen.forecast.fresh(t.nanos());
        let stage = forecast.and_then(|f| f.stages.first());
        let of_forecast = stage.map(|s| [s.euler[0], s.euler[1], -s.position[2]]);
        let fresh = |(at, _): &(Time<TrueTime>, _)| t - *at <= topics::ESTIMATE.stale_after;
        let own = self.own_motion.filter(fresh).map(|(_, motion)| motion);
        let sample = own.or(of_forecast);
        if own.is_some() != self.is_own {
            // They count heights from levels of their own.
            self.is_own = own.is_some();
            self.motion.relevel(sample);
        }
        self.motion.add(t, sample);
    }

    /// Drops the answer to an order of the flight before.
    fn flight_begins(&mut self) {
        self.order.answer.clear();
    }
    /// Keeps a change of state, and what it ends.
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
        // Who looks on since the drone stood on the deck has seen no flight.
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

    /// The picture at `t`.
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
        let (now, seen) = (t.nanos(), &self.situation.seen);
        let (forecast, age_s) = (seen.forecast.as_ref()?, seen.forecast.age_s(now));
        let first = forecast.stages.first()?;
        let deck = forecast
            .at(forecast.header.at + Span::from_secs(age_s))
            .unwrap_or(*first);
        let heading = forecast.mean_heading;
        let place = |at: [f64; 3]| place(at, deck.position, heading);
        let path =
            |stages: &mut dyn Iterator<Item = [f64; 3]>| stages.step_by(PATH_STEP).map(place).collect();
        let drone = seen.drone.map(|d| {
            let e = d.euler();
            DroneView {
                at: place(d.position),
                euler_deg: degrees([e.x, e.y, wrap_angle(e.z - heading)]),
                stale: seen.drone.is_old(now),
            }
        });
        let plan = seen.plan.filter(|_| seen.plan.age_s(now) < FORGOTTEN_S);
        let [roll, pitch, yaw] = deck.euler;
        Some(SceneView {
            size_m: self.situation.known.deck_size_m,
            euler_deg: degrees([roll, pitch, wrap_angle(yaw - heading)]),
            heading_deg: tenth(heading.to_degrees().rem_euclid(360.0)),
            forecast: path(&mut forecast.stages.iter().map(|s| s.position)),
            forecast_stale: seen.forecast.is_old(now),
            plan: plan.map_or_else(Vec::new, |p| path(&mut p.stages.iter().map(|s| s.position))),
            plan_stale: seen.plan.is_old(now),
            drone,
        })
    }
}

/// A landing or a take-off goes on in a state.
fn is_flight(state: State) -> bool {
    state.is_landing() || state.is_take_off()
}

/// Roll, pitch, height of a vessel's estimate.
fn motion(eta: &[f64; 6]) -> [f64; 3] {
    [eta[3], eta[4], -eta[2]]
}

fn keep<T>(kept: &mut VecDeque<T>, new: T, most: usize) {
    kept.push_back(new);
    while kept.len() > most {
        kept.pop_front();
    }
}

/// A place of the NED as seen from the deck at `deck`.
fn place(at: [f64; 3], deck: [f64; 3], heading: f64) -> Place {
    let (sin, cos) = heading.sin_cos();
    let [north, east, down] = [at[0] - deck[0], at[1] - deck[1], at[2] - deck[2]];
    [cos * north + sin * east, cos * east - sin * north, -down].map(|x| (100.0 * x).round() / 100.0)
}

fn degrees(euler: [f64; 3]) -> [f64; 3] {
    euler.map(|a| tenth(a.to_degrees()))
}

fn tenth(x: f64) -> f64 {
    (10.0 * x).round() / 10.0
}

#[cfg(test)]
mod tests;
