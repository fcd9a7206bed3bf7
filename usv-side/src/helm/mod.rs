//! The vessel's helm for a landing or a take-off: it asks the skipper, steers to a better course within his limits, keeps it,
//! and gives back what was before.
//!
//! A handshake of drone, skipper and boat ([`HelmState`]): `Idle` -> `Asked` (a drone comes for the deck, and another course
//! is worth it) -> `Agreed` (the skipper answered yes: the boat turns) -> `Steady` (it is on the course) -> `Done` (the
//! landing is over: it goes back) -> `Idle`. Anything else ends in `Withdrawn` until that landing is over: a refusal, no
//! answer, a hand on the helm ([`response`]), another mode of the boat's autopilot, a lost link, a boat that does not
//! become steady. Without an answer a drone lands as it does on a boat that is not steered.
//!
//! A yes is for one landing or take-off of one drone, and for a time and a way that the skipper has set
//! ([`HelmConfig::max_time_s`]). A question is about one course: where the limits permit it no more from where the boat is, it ends, and another is asked. A yes
//! names the course that it answers. A descent is never turned under: one that begins before the boat's autopilot has taken
//! the helm ends it, and one that begins before the boat is steady, or on its way back, makes the present course the one that is
//! kept.

mod autopilot;
mod command;
mod config;
mod consent;
mod ending;
mod limits;
mod mavlink;
mod nmea;
mod response;
mod signalk;

use alight_shared::geodesy::Datum;
use alight_shared::mavlink::Signing;
use alight_shared::msg::{HelmAnswer, HelmEnd, HelmState, HelmStatus, MAX_HELM_TURN_S};
use alight_shared::node::Node;
use alight_shared::time::{Span, Time, VesselClock};
use serde::{Deserialize, Serialize};

pub use config::{HelmBearings, HelmConfig, HelmOutput};

use autopilot::HelmDriver;
use command::{HelmCommand, ReadBack};
use consent::ConsentSwitch;
use response::SteeringResponse;

use crate::demand::Demand;

/// The skipper is asked for so long.
const ANSWER: Span = Span::from_millis(60_000);
/// The lamp is out for so long before each question, and a switch answers none that is newer: the skipper needs it to recognise that
/// this question is another.
const RECOGNISED: Span = Span::from_millis(3000);
/// No command is given for so long after his yes: three statuses of a drone that may just have begun its descent.
const LEAD: Span = Span::from_millis(1500);
/// A landing is over when no drone has asked for the deck for so long: one that breaks off comes again.
const GONE: Span = Span::from_millis(10_000);
/// An estimate of the vessel's motion counts for so long.
const FRESH: Span = Span::from_millis(1000);
/// The time of a checkpoint is brought up to date so often.
const REFRESH: Span = Span::from_millis(10_000);

/// Errors of a measured course (half of what is worth a helm) and of a speed in waves ([`response`]): rad, m/s.
const COURSE_ERROR_RAD: f64 = 0.0875;
const SPEED_ERROR_MPS: f64 = 1.2;

/// A course to steer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Goal {
    /// Heading, rad from north.
    pub heading_rad: f64,
    /// Speed over ground, m/s.
    pub speed_mps: f64,
    /// Probability of a landing on it, where it is computed.
    pub likelihood: Option<f64>,
    /// Standard deviation of the deck's apparent slope on it, where it is computed.
    pub slope_sd: Option<f64>,
}

/// The vessel's mean motion, without the waves.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BoatMotion {
    /// Heading, rad from north.
    pub heading_rad: f64,
    /// Rate of turn, rad/s.
    pub rate_radps: f64,
    /// Speed over ground along the heading, m/s.
    pub speed_mps: f64,
}

/// The boat's place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BoatPlace {
    /// Origin of the vessel's NED plane.
    pub datum: Datum,
    /// Position in it, north and east, m.
    pub position_m: [f64; 2],
}

/// Input that arrived since the last step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct HelmIn {
    /// Request of the drones.
    pub demand: Demand,
    /// The drone that comes or descends.
    pub drone: Option<u32>,
    /// The newest estimate of the vessel's motion, and its time.
    pub motion: Option<(Time<VesselClock>, BoatMotion)>,
    /// The boat's place by the same estimate.
    pub place: Option<BoatPlace>,
    /// The best course, where one is better than the present.
    pub advice: Option<Goal>,
    /// The skipper's answers by order.
    pub answers: Vec<HelmAnswer>,
    /// Level of his switch, if it was read.
    pub consent: Option<bool>,
    /// The helm states that the vessel turns or may turn.
    pub turning: bool,
    /// Bytes of the boat's autopilot; None: its link is not open.
    pub bytes: Option<Vec<u8>>,
    /// At the first step, what the former start left.
    pub checkpoint: Option<HelmCheckpoint>,
    /// The process is asked to end: what was before is given back, and nothing more is asked.
    pub ends: bool,
}

/// Output of the helm.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HelmOut {
    /// State of the handshake.
    pub status: HelmStatus,
    /// Bytes for the boat's autopilot.
    pub bytes: Vec<u8>,
}

/// State before the vessel was steered; it outlives the process.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HelmCheckpoint {
    /// It was steered then.
    pub at: Time<VesselClock>,
    /// Custom mode of the boat's autopilot, where it reports one.
    pub mode: Option<u32>,
    /// Heading, rad.
    pub heading_rad: f64,
    /// Speed over ground, m/s.
    pub speed_mps: f64,
}

/// A helm under way.
#[derive(Clone, Copy, Debug)]
struct Steering {
    since: Time<VesselClock>,
    /// Distance covered since, m, until the step at this time.
    way_m: f64,
    at: Time<VesselClock>,
    /// The drone that it is for, and whether that has stood on the deck since: a yes is for one landing or take-off.
    drone: Option<u32>,
    stood: bool,
    response: SteeringResponse,
    former: HelmCheckpoint,
    /// The autopilot has taken the mode.
    engaged: bool,
    steady: bool,
}

/// Phase of the handshake.
#[derive(Clone, Copy, Debug)]
enum Phase {
    Idle,
    Asked {
        since: Time<VesselClock>,
        goal: Goal,
    },
    Steering(Steering),
    /// Back to the former course, and then to the former mode.
    Returning {
        steering: Steering,
        mode_since: Option<Time<VesselClock>>,
    },
    Withdrawn {
        since: Time<VesselClock>,
        why: HelmEnd,
        former: Option<HelmCheckpoint>,
    },
}

/// The node.
#[derive(Debug)]
pub struct HelmNode {
    config: HelmConfig,
    autopilot: HelmDriver,
    phase: Phase,
    began: bool,
    /// When a drone came for the deck last.
    wanted: Option<Time<VesselClock>>,
    /// Since when one stands on the deck.
    stands: Option<Time<VesselClock>>,
    switch: ConsentSwitch,
    /// Time of the checkpoint.
    kept_at: Option<Time<VesselClock>>,
    /// When it was steered last, until it has come to rest on the course of its own autopilot.
    coming_to_rest: Option<Time<VesselClock>>,
}

/// Input of a step.
struct View<'a> {
    now: Time<VesselClock>,
    input: &'a HelmIn,
    /// Motion of the boat, where it is fresh.
    motion: Option<BoatMotion>,
    read_back: ReadBack,
    answer: Option<bool>,
}

impl HelmNode {
    /// The helm of `config`.
    pub fn new(config: &HelmConfig) -> HelmNode {
        HelmNode {
            autopilot: HelmDriver::new(config),
            config: config.clone(),
            phase: Phase::Idle,
            began: false,
            wanted: None,
            stands: None,
            switch: ConsentSwitch::default(),
            kept_at: None,
            coming_to_rest: None,
        }
    }
    /// MAVLink frames are signed with this key.
    pub fn sign(&mut self, key: Signing) {
        self.autopilot.sign(key);
    }
    /// The boat's autopilot is configured, and silent or without a link.
    pub fn is_silent(&self, now: Time<VesselClock>) -> bool {
        self.config.output != HelmOutput::None && !self.autopilot.read_back(now).present
    }
    /// The boat's autopilot is in the mode in which it takes set-points, ours or another system's.
    pub fn is_steered(&self, now: Time<VesselClock>) -> bool {
        self.autopilot.read_back(now).is_steered()
    }
    /// The course that is kept, once the vessel is steady on it.
    pub fn kept(&self) -> Option<Goal> {
        match &self.phase {
            Phase::Steering(s) => s.steady.then(|| s.response.goal()),
            Phase::Idle | Phase::Asked { .. } | Phase::Returning { .. } | Phase::Withdrawn { .. } => None,
        }
    }
    /// Skipper and autopilot permit this course, from the motion `now`.
    pub fn permits(&self, course: &Goal, now: &BoatMotion) -> bool {
        let keeps_speed = (course.speed_mps - now.speed_mps).abs() < 0.5;
        (self.autopilot.steers_speed() || keeps_speed) && self.config.permits(course, now)
    }
    /// The skipper is asked, and has had the time to see it.
    pub fn asks_by_lamp(&self, now: Time<VesselClock>) -> bool {
        match &self.phase {
            Phase::Asked { since, .. } => now - *since > RECOGNISED,
            Phase::Idle | Phase::Steering(_) | Phase::Returning { .. } | Phase::Withdrawn { .. } => false,
        }
    }
    /// It is given back, or was a moment ago, and turns to the course of its own autopilot.
    pub fn turns_back(&self) -> bool {
        match &self.phase {
            Phase::Idle | Phase::Asked { .. } | Phase::Withdrawn { .. } => self.coming_to_rest.is_some(),
            Phase::Steering(_) | Phase::Returning { .. } => false,
        }
    }
    /// Checkpoint with which the next start of the process begins.
    pub fn checkpoint(&self) -> Option<HelmCheckpoint> {
        let former = match &self.phase {
            Phase::Idle | Phase::Asked { .. } => None,
            Phase::Steering(s) | Phase::Returning { steering: s, .. } => Some(s.former),
            Phase::Withdrawn { former, .. } => *former,
        };
        former.map(|f| HelmCheckpoint {
            at: self.kept_at.unwrap_or(f.at),
            ..f
        })
    }

    /// When a drone came last, and since when one stands.
    fn observe(&mut self, now: Time<VesselClock>, demand: Demand) {
        if matches!(demand, Demand::Comes | Demand::Descends) {
            self.wanted = Some(now);
        }
        let stands = demand == Demand::Stands;
        self.stands = stands.then(|| self.stands.unwrap_or(now));
    }
    /// The skipper's newest answer, by order or by his switch; of two a no. A yes to another course than the one that is
    /// asked is not one, nor is that of a switch to a question that he cannot have recognised.
    fn answer(&mut self, now: Time<VesselClock>, input: &HelmIn) -> Option<bool> {
        let (asked, shown) = (self.status().asked(), self.asks_by_lamp(now));
        let counts = |answer: &HelmAnswer| match answer {
            HelmAnswer::Yes(course) => (asked == Some(*course)).then_some(true),
            HelmAnswer::No => Some(false),
        };
        let ordered = input.answers.iter().rev().find_map(counts);
        let switched = self.switch.answer(now, input.consent);
        let switched = switched.filter(|yes| shown || !yes);
        ordered.into_iter().chain(switched).reduce(|a, b| a && b)
    }

    fn next(&self, v: &View<'_>) -> Phase {
        match self.phase {
            Phase::Idle => self.ask(v),
            Phase::Asked { since, goal } => self.asked(v, since, goal),
            Phase::Steering(steering) => self.steer(v, steering),
            Phase::Returning { steering, mode_since } => self.give_back(v, steering, mode_since),
            Phase::Withdrawn { since, why, former } => self.withdrawn(v, since, why, former),
        }
    }
    /// No drone has come for the deck for long.
    fn is_over(&self, now: Time<VesselClock>) -> bool {
        self.wanted.is_none_or(|t| now - t > GONE)
    }

    fn ask(&self, v: &View<'_>) -> Phase {
        // In our mode without us she is steered by somebody else.
        let can = v.read_back.present && !v.read_back.is_steered() && !v.input.ends;
        let asks = v.input.demand == Demand::Comes && can && !v.input.turning;
        let (Some(motion), Some(advice)) = (v.motion.filter(|_| asks), v.input.advice) else {
            return Phase::Idle;
        };
        let goal = self.permitted(&advice, &motion);
        match goal.filter(|goal| self.still_permits(goal, &motion)) {
            Some(goal) => Phase::Asked { since: v.now, goal },
            None => Phase::Idle,
        }
    }
    /// The course that is asked for; the speed is the present one where the autopilot does not steer it.
    fn permitted(&self, advice: &Goal, motion: &BoatMotion) -> Option<Goal> {
        let advice = match self.autopilot.steers_speed() {
            true => *advice,
            false => Goal {
                speed_mps: motion.speed_mps,
                ..*advice
            },
        };
        self.config.permitted(&advice, motion)
    }
    /// Permission for a course that the skipper is asked for, from the motion now: within the errors of a course the boat
    /// heads and goes as when he was asked.
    fn still_permits(&self, goal: &Goal, now: &BoatMotion) -> bool {
        let keeps_speed = (goal.speed_mps - now.speed_mps).abs() < SPEED_ERROR_MPS;
        (self.autopilot.steers_speed() || keeps_speed) && self.config.permits(goal, now)
    }

    fn asked(&self, v: &View<'_>, since: Time<VesselClock>, goal: Goal) -> Phase {
        let withdrawn = |why| Phase::Withdrawn {
            since: v.now,
            why,
            former: None,
        };
        let demand = v.input.demand;
        let gone = demand != Demand::Comes && (demand == Demand::Descends || self.is_over(v.now));
        if !gone && v.answer == Some(false) {
            return withdrawn(HelmEnd::Refused);
        }
        let asks = !gone && !v.read_back.is_steered() && !v.input.ends;
        // One question is about one course: another course is another question.
        let here = v
            .motion
            .filter(|motion| asks && self.still_permits(&goal, motion));
        let Some(motion) = here else {
            return Phase::Idle;
        };
        if v.input.turning {
            return withdrawn(HelmEnd::Turning);
        }
        if !v.read_back.present {
            return withdrawn(HelmEnd::LinkLost);
        }
        match v.answer {
            // A drone that is not received may have gone.
            Some(true) if demand == Demand::Comes => Phase::Steering(Steering {
                since: v.now,
                way_m: 0.0,
                at: v.now,
                drone: v.input.drone,
                stood: false,
                response: self.response(v.now, goal, &motion),
                former: HelmCheckpoint {
                    at: v.now,
                    mode: v.read_back.mode,
                    heading_rad: motion.heading_rad,
                    speed_mps: motion.speed_mps,
                },
                engaged: false,
                steady: false,
            }),
            Some(_) | None if v.now - since > ANSWER => withdrawn(HelmEnd::Unanswered),
            Some(_) | None => Phase::Asked { since, goal },
        }
    }
    fn response(&self, now: Time<VesselClock>, goal: Goal, motion: &BoatMotion) -> SteeringResponse {
        SteeringResponse::begin(now, goal, motion, !self.autopilot.steers_speed())
    }

    /// Why a helm ends at once.
    fn ends(&self, v: &View<'_>, s: &Steering) -> Option<HelmEnd> {
        let steered = v.now - s.since;
        let (r, demand) = (&v.read_back, v.input.demand);
        let late = steered > self.autopilot.engages_within();
        let comes = demand == Demand::Comes;
        let too_long = comes && steered.secs() > self.config.max_time_s;
        let too_far = comes && s.way_m > self.config.max_way_m;
        // Before it is ours, too, the skipper or a failsafe may set another.
        let changed = !r.is_ours && (s.engaged || r.mode.is_some() && r.mode != s.former.mode);
        [
            (v.input.ends, HelmEnd::Restarted),
            (v.answer == Some(false), HelmEnd::Refused),
            (v.input.turning, HelmEnd::Turning),
            (!r.present, HelmEnd::LinkLost),
            // A hand that has not yet handed the helm over takes none back.
            (s.engaged && r.by_hand, HelmEnd::HandOnHelm),
            (changed, HelmEnd::ModeChanged),
            (!s.engaged && (r.denied || late), HelmEnd::Denied),
            (v.motion.is_none(), HelmEnd::NoEstimate),
            // A boat that has not begun to turn does not begin under a descent.
            (!s.engaged && demand == Demand::Descends, HelmEnd::Descent),
            (too_long, HelmEnd::TooLong),
            (too_far, HelmEnd::TooFar),
            (s.engaged && s.response.is_violated(v.now), HelmEnd::HandOnHelm),
        ]
        .into_iter()
        .find_map(|(ends, why)| ends.then_some(why))
    }

    /// One step of a helm that goes on: the mode is taken, and the boat follows.
    fn follow(&self, v: &View<'_>, s: &mut Steering) {
        let Some(motion) = v.motion else { return };
        s.way_m += motion.speed_mps.abs() * (v.now - s.at).secs();
        s.at = v.now;
        if !s.engaged && v.read_back.is_ours && v.now - s.since > LEAD {
            s.engaged = true;
            s.response = self.response(v.now, s.response.goal(), &motion);
        }
        if s.engaged {
            s.response.observe(v.now, &motion);
        }
    }

    fn steer(&self, v: &View<'_>, mut s: Steering) -> Phase {
        self.follow(v, &mut s);
        if let Some(why) = self.ends(v, &s) {
            return Self::withdraw(v, why, &s);
        }
        let secured = self
            .stands
            .is_some_and(|t| (v.now - t).secs() > self.config.secure_s);
        let demand = v.input.demand;
        let stands = demand == Demand::Stands;
        s.stood |= self.stands.is_some_and(|t| v.now - t > GONE);
        let another = v.input.drone.is_some_and(|d| s.drone.is_some_and(|own| own != d));
        let next = demand == Demand::Comes && (s.stood || another);
        if secured || next || !stands && self.is_over(v.now) {
            return self.return_to_former(v, s);
        }
        if let Some(motion) = v.motion.filter(|_| demand == Demand::Descends && !s.steady) {
            self.keep(v.now, &mut s, &motion);
        }
        let late = (v.now - s.since).secs() > f64::from(MAX_HELM_TURN_S);
        s.steady |= s.engaged && (s.response.is_steady(v.now) || late && s.response.is_steady_on_average());
        match s.engaged && late && !s.steady {
            true => Self::withdraw(v, HelmEnd::NotSettled, &s),
            false => Phase::Steering(s),
        }
    }
    /// A drone has chosen to land now: what is, is kept.
    fn keep(&self, now: Time<VesselClock>, s: &mut Steering, motion: &BoatMotion) {
        let goal = Goal {
            heading_rad: motion.heading_rad,
            speed_mps: motion.speed_mps.max(0.0),
            likelihood: None,
            slope_sd: None,
        };
        s.response = self.response(now, goal, motion);
        s.steady = true;
    }

    fn command(&self, now: Time<VesselClock>) -> HelmCommand {
        let steer = |s: &Steering| HelmCommand::Steer {
            heading_rad: s.response.goal().heading_rad,
            speed_mps: s.response.goal().speed_mps,
        };
        match &self.phase {
            Phase::Idle | Phase::Asked { .. } => HelmCommand::Nothing,
            Phase::Steering(s) if now - s.since <= LEAD => HelmCommand::Nothing,
            Phase::Steering(s)
            | Phase::Returning {
                steering: s,
                mode_since: None,
            } => steer(s),
            Phase::Returning {
                steering: s,
                mode_since: Some(_),
            } => HelmCommand::GiveBack { mode: s.former.mode },
            Phase::Withdrawn { former, .. } => match former {
                Some(former) => HelmCommand::GiveBack { mode: former.mode },
                None => HelmCommand::Nothing,
            },
        }
    }
    /// State of the handshake.
    pub fn status(&self) -> HelmStatus {
        let of = |state, goal: &Goal, steady_in_s: f64| HelmStatus {
            state,
            why: HelmEnd::None,
            heading_rad: goal.heading_rad as f32,
            speed_mps: goal.speed_mps.clamp(0.0, 30.0) as f32,
            steady_in_s: steady_in_s as f32,
            likelihood: goal.likelihood.map_or(1.0, |p| p.clamp(0.0, 1.0)) as f32,
        };
        match &self.phase {
            Phase::Idle => HelmStatus::default(),
            Phase::Asked { goal, .. } => of(HelmState::Asked, goal, 0.0),
            Phase::Steering(s) if s.steady => of(HelmState::Steady, &s.response.goal(), 0.0),
            Phase::Steering(s) => of(HelmState::Agreed, &s.response.goal(), s.response.steady_in_s()),
            Phase::Returning { steering, .. } => of(HelmState::Done, &steering.response.goal(), 0.0),
            Phase::Withdrawn { why, .. } => HelmStatus {
                state: HelmState::Withdrawn,
                why: *why,
                ..HelmStatus::default()
            },
        }
    }
}

impl Node for HelmNode {
    type Clock = VesselClock;
    type In = HelmIn;
    type Out = HelmOut;

    fn step(&mut self, now: Time<VesselClock>, input: &HelmIn) -> HelmOut {
        let left = input.checkpoint.filter(|_| !self.began);
        if let Some(former) = left.filter(|_| self.config.output != HelmOutput::None) {
            self.phase = Self::found(now, former);
        }
        self.began = true;
        self.autopilot.receive(now, input.bytes.as_deref());
        self.observe(now, input.demand);
        let view = View {
            now,
            motion: input
                .motion
                .filter(|(at, _)| now - *at <= FRESH)
                .map(|(_, motion)| motion),
            read_back: self.autopilot.read_back(now),
            answer: self.answer(now, input),
            input,
        };
        self.phase = self.next(&view);
        self.coming_to_rest = self.coming_to_rest(&view);
        self.kept_at = self.kept_at.filter(|at| now - *at < REFRESH).or(Some(now));
        let command = self.command(now);
        let place = input.place.filter(|_| view.motion.is_some());
        HelmOut {
            status: self.status(),
            bytes: self.autopilot.send(now, &command, place.as_ref()),
        }
    }
}

#[cfg(test)]
mod tests;
