//! The vessel's helm for a landing or a take-off: it asks the skipper, steers to a better course within his limits, keeps it,
//! and gives back what was before.
//!
//! A handshake of drone, skipper and boat ([`HelmState`]): `Idle` -> `Asked` (a drone comes for the deck, and another course
//! is worth it) -> `Agreed` (he said yes: she turns) -> `Steady` (she is on the course) -> `Done` (the landing is over: she
//! goes back) -> `Idle`. Anything else ends in `Withdrawn` until that landing is over: a refusal, no answer, a hand on the
//! helm ([`response`]), another mode of the boat's autopilot, a lost link. Without an answer a drone lands as it does on a
//! boat that is not steered. A descent is never turned under: one that begins before she is steady makes the present course
//! the one that is kept.

mod config;
mod limits;
mod mavlink;
mod nmea;
mod response;

use alight_shared::mavlink::Signing;
use alight_shared::msg::{HelmEnd, HelmState, HelmStatus, MAX_HELM_TURN_S};
use alight_shared::node::Node;
use alight_shared::time::{Span, Time, VesselClock};
use serde::{Deserialize, Serialize};

pub use config::{HelmConfig, HelmOutput};

use mavlink::MavlinkHelm;
use nmea::NmeaHelm;
use response::Response;

use crate::demand::Demand;

/// The skipper is asked for so long.
const ANSWER: Span = Span::from_millis(60_000);
/// No command is given for so long after his yes: three statuses of a drone that may just have begun its descent.
const LEAD: Span = Span::from_millis(1500);
/// The autopilot takes the mode within this, or denies it.
const ENGAGE: Span = Span::from_millis(6000);
/// A landing is over when no drone has asked for the deck for so long: one that breaks off comes again.
const GONE: Span = Span::from_millis(10_000);
/// An estimate of the vessel's motion counts for so long.
const FRESH: Span = Span::from_millis(1000);
/// The switch counts as open when it was not read for so long: four periods.
const UNREAD: Span = Span::from_millis(2000);
/// The mode is given back within this, or not at all.
const GIVE_BACK: Span = Span::from_millis(10_000);

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

/// What arrived since the last step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct HelmIn {
    /// What the drones want.
    pub demand: Demand,
    /// The newest estimate of the vessel's motion, and its time.
    pub motion: Option<(Time<VesselClock>, BoatMotion)>,
    /// The best course, where one is better than the present.
    pub advice: Option<Goal>,
    /// The skipper's answers by order.
    pub answers: Vec<bool>,
    /// Level of his switch, if it was read.
    pub consent: Option<bool>,
    /// The helm states that the vessel turns or may turn.
    pub turning: bool,
    /// Bytes of the boat's autopilot.
    pub bytes: Vec<u8>,
    /// At the first step, what the former start left.
    pub checkpoint: Option<HelmCheckpoint>,
}

/// What is published.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HelmOut {
    /// Where the handshake stands.
    pub status: HelmStatus,
    /// Bytes for the boat's autopilot.
    pub bytes: Vec<u8>,
}

/// What was before the vessel was steered; it outlives the process.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HelmCheckpoint {
    /// Custom mode of the boat's autopilot, where it reports one.
    pub mode: Option<u32>,
    /// Heading, rad.
    pub heading_rad: f64,
    /// Speed over ground, m/s.
    pub speed_mps: f64,
}

/// What the boat's autopilot is to do.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Command {
    Nothing,
    Steer { heading_rad: f64, speed_mps: f64 },
    GiveBack { mode: Option<u32> },
}

/// What the boat's autopilot reports.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ReadBack {
    /// It is there.
    present: bool,
    /// Its mode, where it reports one.
    mode: Option<u32>,
    /// It takes our commands in that mode.
    is_ours: bool,
    /// It denied the mode.
    denied: bool,
    /// It reports a hand on the helm.
    by_hand: bool,
}

/// The boat's autopilot.
#[derive(Debug)]
enum Autopilot {
    None,
    Mavlink(Box<MavlinkHelm>),
    Nmea(NmeaHelm),
}

impl Autopilot {
    fn receive(&mut self, now: Time<VesselClock>, bytes: &[u8]) {
        match self {
            Autopilot::None => {}
            Autopilot::Mavlink(link) => link.receive(now, bytes),
            Autopilot::Nmea(link) => link.receive(now, bytes),
        }
    }
    fn read_back(&self, now: Time<VesselClock>) -> ReadBack {
        match self {
            Autopilot::None => ReadBack {
                present: false,
                mode: None,
                is_ours: false,
                denied: false,
                by_hand: false,
            },
            Autopilot::Mavlink(link) => link.read_back(now),
            Autopilot::Nmea(link) => link.read_back(now),
        }
    }
    fn send(&mut self, now: Time<VesselClock>, command: &Command) -> Vec<u8> {
        match self {
            Autopilot::None => Vec::new(),
            Autopilot::Mavlink(link) => link.send(now, command),
            Autopilot::Nmea(link) => link.send(now, command),
        }
    }
    fn steers_speed(&self) -> bool {
        match self {
            Autopilot::None | Autopilot::Nmea(_) => false,
            Autopilot::Mavlink(_) => true,
        }
    }
}

/// A helm under way.
#[derive(Clone, Copy, Debug)]
struct Steering {
    since: Time<VesselClock>,
    response: Response,
    former: HelmCheckpoint,
    /// The autopilot has taken the mode.
    engaged: bool,
    steady: bool,
}

/// Where the handshake stands.
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
    autopilot: Autopilot,
    phase: Phase,
    began: bool,
    /// When a drone came for the deck last.
    wanted: Option<Time<VesselClock>>,
    /// Since when one stands on the deck.
    stands: Option<Time<VesselClock>>,
    /// It stood there with its motors off: armed, it takes off.
    parked: bool,
    /// The switch as it was read last, and its level at the step before.
    switch: Option<(Time<VesselClock>, bool)>,
    consents: bool,
}

/// What a step looks at.
struct View<'a> {
    now: Time<VesselClock>,
    input: &'a HelmIn,
    demand: Demand,
    /// Where it is fresh.
    motion: Option<BoatMotion>,
    read_back: ReadBack,
    answer: Option<bool>,
}

impl HelmNode {
    /// The helm of `config`.
    pub fn new(config: &HelmConfig) -> HelmNode {
        HelmNode {
            autopilot: match config.output {
                HelmOutput::None => Autopilot::None,
                HelmOutput::Mavlink => Autopilot::Mavlink(Box::default()),
                HelmOutput::Nmea0183 => Autopilot::Nmea(NmeaHelm::default()),
            },
            config: config.clone(),
            phase: Phase::Idle,
            began: false,
            wanted: None,
            stands: None,
            parked: false,
            switch: None,
            consents: false,
        }
    }
    /// MAVLink frames are signed with this key.
    pub fn sign(&mut self, key: Signing) {
        match &mut self.autopilot {
            Autopilot::Mavlink(link) => link.sign(key),
            Autopilot::None | Autopilot::Nmea(_) => {}
        }
    }
    /// The boat's autopilot is configured, and silent.
    pub fn is_silent(&self, now: Time<VesselClock>) -> bool {
        self.config.output != HelmOutput::None && !self.autopilot.read_back(now).present
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
    /// What the next start of the process begins with.
    pub fn checkpoint(&self) -> Option<HelmCheckpoint> {
        match &self.phase {
            Phase::Idle | Phase::Asked { .. } => None,
            Phase::Steering(s) | Phase::Returning { steering: s, .. } => Some(s.former),
            Phase::Withdrawn { former, .. } => *former,
        }
    }

    /// What is wanted: one that arms after it stood is about to take off, one that has just landed stands.
    fn demand(&mut self, now: Time<VesselClock>, demand: Demand) -> Demand {
        let wanted = match demand {
            Demand::Armed if self.parked => Demand::Comes,
            Demand::Armed => Demand::Stands,
            Demand::Nothing | Demand::Stands | Demand::Comes | Demand::Descends => demand,
        };
        self.parked = match demand {
            Demand::Stands => true,
            Demand::Comes | Demand::Descends => false,
            Demand::Nothing | Demand::Armed => self.parked,
        };
        if matches!(wanted, Demand::Comes | Demand::Descends) {
            self.wanted = Some(now);
        }
        let stands = wanted == Demand::Stands;
        self.stands = stands.then(|| self.stands.unwrap_or(now));
        wanted
    }
    /// The skipper's newest answer: an order, or an edge of his switch.
    fn answer(&mut self, now: Time<VesselClock>, input: &HelmIn) -> Option<bool> {
        self.switch = input.consent.map(|level| (now, level)).or(self.switch);
        let level = self.switch.is_some_and(|(at, level)| level && now - at <= UNREAD);
        let edge = (core::mem::replace(&mut self.consents, level) != level).then_some(level);
        input.answers.last().copied().or(edge)
    }

    fn next(&self, v: &View<'_>) -> Phase {
        match self.phase {
            Phase::Idle => self.ask(v),
            Phase::Asked { since, goal } => self.asked(v, since, goal),
            Phase::Steering(steering) => self.steer(v, steering),
            Phase::Returning { steering, mode_since } => self.give_back(v, steering, mode_since),
            Phase::Withdrawn { since, why, former } => {
                // What was before is given back once; a landing that goes on is not asked for again.
                let former = former
                    .filter(|_| v.now - since < GIVE_BACK && (!v.read_back.present || v.read_back.is_ours));
                match self.is_over(v.now) && former.is_none() {
                    true => Phase::Idle,
                    false => Phase::Withdrawn { since, why, former },
                }
            }
        }
    }
    /// No drone has come for the deck for long.
    fn is_over(&self, now: Time<VesselClock>) -> bool {
        self.wanted.is_none_or(|t| now - t > GONE)
    }

    fn ask(&self, v: &View<'_>) -> Phase {
        let asks = v.demand == Demand::Comes && v.read_back.present && !v.input.turning;
        let (Some(motion), Some(advice)) = (v.motion.filter(|_| asks), v.input.advice) else {
            return Phase::Idle;
        };
        match self.permitted(&advice, &motion) {
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

    fn asked(&self, v: &View<'_>, since: Time<VesselClock>, goal: Goal) -> Phase {
        let withdrawn = |why| Phase::Withdrawn {
            since: v.now,
            why,
            former: None,
        };
        let gone = v.demand != Demand::Comes && (v.demand == Demand::Descends || self.is_over(v.now));
        let Some(motion) = v.motion.filter(|_| !gone) else {
            return Phase::Idle;
        };
        if v.input.turning {
            return withdrawn(HelmEnd::Turning);
        }
        if !v.read_back.present {
            return withdrawn(HelmEnd::LinkLost);
        }
        let newer = v.input.advice.and_then(|advice| self.permitted(&advice, &motion));
        let goal = newer.unwrap_or(goal);
        match v.answer {
            Some(true) => Phase::Steering(Steering {
                since: v.now,
                response: self.response(v.now, goal, &motion),
                former: HelmCheckpoint {
                    mode: v.read_back.mode,
                    heading_rad: motion.heading_rad,
                    speed_mps: motion.speed_mps,
                },
                engaged: false,
                steady: false,
            }),
            Some(false) => withdrawn(HelmEnd::Refused),
            None if v.now - since > ANSWER => withdrawn(HelmEnd::Unanswered),
            None => Phase::Asked { since, goal },
        }
    }
    fn response(&self, now: Time<VesselClock>, goal: Goal, motion: &BoatMotion) -> Response {
        Response::begin(now, goal, motion, !self.autopilot.steers_speed())
    }

    /// Why a helm ends at once.
    fn ends(v: &View<'_>, s: &Steering) -> Option<HelmEnd> {
        let late = v.now - s.since > ENGAGE;
        let r = &v.read_back;
        [
            (v.answer == Some(false), HelmEnd::Refused),
            (v.input.turning, HelmEnd::Turning),
            (!r.present, HelmEnd::LinkLost),
            (r.by_hand, HelmEnd::HandOnHelm),
            (s.engaged && !r.is_ours, HelmEnd::ModeChanged),
            (!s.engaged && (r.denied || late), HelmEnd::Denied),
            (v.motion.is_none(), HelmEnd::NoEstimate),
            (s.engaged && s.response.is_violated(v.now), HelmEnd::HandOnHelm),
        ]
        .into_iter()
        .find_map(|(ends, why)| ends.then_some(why))
    }
    /// Withdrawn; what was before is given back unless a person has chosen a mode.
    fn withdraw(v: &View<'_>, why: HelmEnd, s: &Steering) -> Phase {
        let former = (why != HelmEnd::ModeChanged).then_some(s.former);
        Phase::Withdrawn {
            since: v.now,
            why,
            former,
        }
    }

    /// One step of a helm that goes on: the mode is taken, and the boat follows.
    fn follow(&self, v: &View<'_>, s: &mut Steering) {
        let Some(motion) = v.motion else { return };
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
        if let Some(why) = Self::ends(v, &s) {
            return Self::withdraw(v, why, &s);
        }
        let secured = self
            .stands
            .is_some_and(|t| (v.now - t).secs() > self.config.secure_s);
        let stands = v.demand == Demand::Stands;
        if secured || !stands && self.is_over(v.now) {
            return self.return_to_former(v, s);
        }
        if let Some(motion) = v.motion.filter(|_| v.demand == Demand::Descends && !s.steady) {
            // The drone has chosen to land now: what is, is kept.
            let goal = Goal {
                heading_rad: motion.heading_rad,
                speed_mps: motion
                    .speed_mps
                    .clamp(self.config.speed_mps[0], self.config.speed_mps[1]),
                likelihood: None,
                slope_sd: None,
            };
            s.response = self.response(v.now, goal, &motion);
            s.steady = true;
        }
        let late = s.engaged && (v.now - s.since).secs() > f64::from(MAX_HELM_TURN_S);
        s.steady |= s.engaged && s.response.is_steady(v.now) || late;
        Phase::Steering(s)
    }

    fn return_to_former(&self, v: &View<'_>, mut s: Steering) -> Phase {
        let Some(motion) = v.motion else {
            return Self::withdraw(v, HelmEnd::NoEstimate, &s);
        };
        let former = Goal {
            heading_rad: s.former.heading_rad,
            speed_mps: s.former.speed_mps,
            likelihood: None,
            slope_sd: None,
        };
        (s.since, s.response) = (v.now, self.response(v.now, former, &motion));
        Phase::Returning {
            steering: s,
            mode_since: None,
        }
    }
    fn give_back(&self, v: &View<'_>, mut s: Steering, mode_since: Option<Time<VesselClock>>) -> Phase {
        if let Some(since) = mode_since {
            let given = !v.read_back.is_ours || s.former.mode.is_none() || s.former.mode == v.read_back.mode;
            return match given || v.now - since > GIVE_BACK {
                true => Phase::Idle,
                false => Phase::Returning {
                    steering: s,
                    mode_since,
                },
            };
        }
        self.follow(v, &mut s);
        if let Some(why) = Self::ends(v, &s) {
            return Self::withdraw(v, why, &s);
        }
        let there = s.response.is_steady(v.now) || (v.now - s.since).secs() > f64::from(MAX_HELM_TURN_S);
        Phase::Returning {
            steering: s,
            mode_since: there.then_some(v.now),
        }
    }

    fn command(&self, now: Time<VesselClock>) -> Command {
        let steer = |s: &Steering| Command::Steer {
            heading_rad: s.response.goal().heading_rad,
            speed_mps: s.response.goal().speed_mps,
        };
        match &self.phase {
            Phase::Idle | Phase::Asked { .. } => Command::Nothing,
            Phase::Steering(s) if now - s.since <= LEAD && !s.steady => Command::Nothing,
            Phase::Steering(s)
            | Phase::Returning {
                steering: s,
                mode_since: None,
            } => steer(s),
            Phase::Returning {
                steering: s,
                mode_since: Some(_),
            } => Command::GiveBack { mode: s.former.mode },
            Phase::Withdrawn { former, .. } => match former {
                Some(former) => Command::GiveBack { mode: former.mode },
                None => Command::Nothing,
            },
        }
    }
    /// Where the handshake stands.
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
        if let Some(former) = input.checkpoint.filter(|_| !self.began) {
            let why = HelmEnd::Restarted;
            self.phase = Phase::Withdrawn {
                since: now,
                why,
                former: Some(former),
            };
        }
        self.began = true;
        self.autopilot.receive(now, &input.bytes);
        let demand = self.demand(now, input.demand);
        let view = View {
            now,
            demand,
            motion: input
                .motion
                .filter(|(at, _)| now - *at <= FRESH)
                .map(|(_, motion)| motion),
            read_back: self.autopilot.read_back(now),
            answer: self.answer(now, input),
            input,
        };
        self.phase = self.next(&view);
        let command = self.command(now);
        HelmOut {
            status: self.status(),
            bytes: self.autopilot.send(now, &command),
        }
    }
}

#[cfg(test)]
mod tests;
