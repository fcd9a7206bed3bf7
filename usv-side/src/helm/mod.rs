//! The vessel's helm for a landing or a take-off: it asks the skipper, steers to a better course within his limits, keeps it,
//! and gives back what was before.
//!
//! A handshake of drone, skipper and boat ([`HelmState`]): `Idle` -> `Asked` (a drone comes for the deck, and another course
//! is worth it) -> `Agreed` (he said yes: she turns) -> `Steady` (she is on the course) -> `Done` (the landing is over: she
//! goes back) -> `Idle`. Anything else ends in `Withdrawn` until that landing is over: a refusal, no answer, a hand on the
//! helm ([`response`]), another mode of the boat's autopilot, a lost link. Without an answer a drone lands as it does on a
//! boat that is not steered.
//!
//! A question is about one course: where the limits permit it no more from where she is, it ends, and another is asked. A
//! descent is never turned under: one that begins before the boat's autopilot has taken the helm ends it, and one that begins
//! before she is steady makes the present course the one that is kept.

mod autopilot;
mod command;
mod config;
mod consent;
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

use autopilot::Autopilot;
use command::{Command, ReadBack};
use consent::ConsentSwitch;
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
/// The mode is given back within this, or not at all.
const GIVE_BACK: Span = Span::from_millis(10_000);
/// A request of a mode is taken within this, and the next report shows it: a report that is older by less may be of before.
const LATENCY: Span = Span::from_millis(2000);
/// A helm for a drone that comes lasts no longer. Chosen: the battery of a multirotor that waited so long is empty.
const MAX_STEERING: Span = Span::from_millis(1_200_000);

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
    /// Bytes of the boat's autopilot; None: its link is not open.
    pub bytes: Option<Vec<u8>>,
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
    switch: ConsentSwitch,
}

/// How the giving back of a mode stands.
#[derive(Clone, Copy, Debug, PartialEq)]
enum GivingBack {
    GoesOn,
    /// Given back, or never taken, or a person has chosen another meanwhile.
    Done,
    Failed,
}

/// What a step looks at.
struct View<'a> {
    now: Time<VesselClock>,
    input: &'a HelmIn,
    /// Where it is fresh.
    motion: Option<BoatMotion>,
    read_back: ReadBack,
    answer: Option<bool>,
}

impl HelmNode {
    /// The helm of `config`.
    pub fn new(config: &HelmConfig) -> HelmNode {
        HelmNode {
            autopilot: Autopilot::new(config),
            config: config.clone(),
            phase: Phase::Idle,
            began: false,
            wanted: None,
            stands: None,
            switch: ConsentSwitch::default(),
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
    /// The boat's autopilot is in the mode in which it takes set-points, ours or somebody else's.
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
    /// What the next start of the process begins with.
    pub fn checkpoint(&self) -> Option<HelmCheckpoint> {
        match &self.phase {
            Phase::Idle | Phase::Asked { .. } => None,
            Phase::Steering(s) | Phase::Returning { steering: s, .. } => Some(s.former),
            Phase::Withdrawn { former, .. } => *former,
        }
    }

    /// When a drone came last, and since when one stands.
    fn observe(&mut self, now: Time<VesselClock>, demand: Demand) {
        if matches!(demand, Demand::Comes | Demand::Descends) {
            self.wanted = Some(now);
        }
        let stands = demand == Demand::Stands;
        self.stands = stands.then(|| self.stands.unwrap_or(now));
    }
    /// The skipper's newest answer, by order or by his switch; of two a no.
    fn answer(&mut self, now: Time<VesselClock>, input: &HelmIn) -> Option<bool> {
        let ordered = input.answers.last().copied();
        let switched = self.switch.answer(now, input.consent);
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
    /// What was before is given back once; a landing that goes on is not asked for again, nor is any while the boat stays in
    /// the mode that she was to leave.
    fn withdrawn(
        &self,
        v: &View<'_>,
        since: Time<VesselClock>,
        why: HelmEnd,
        former: Option<HelmCheckpoint>,
    ) -> Phase {
        let (why, former) = match former.map(|f| Self::giving_back(v, since, &f)) {
            Some(GivingBack::GoesOn) => (why, former),
            Some(GivingBack::Failed) => (HelmEnd::NotGivenBack, None),
            Some(GivingBack::Done) | None => (why, None),
        };
        let left = why == HelmEnd::NotGivenBack && v.read_back.is_steered();
        match self.is_over(v.now) && former.is_none() && !left {
            true => Phase::Idle,
            false => Phase::Withdrawn { since, why, former },
        }
    }
    /// How it stands with a mode that is given back from `since` on. The autopilot may yet take our last request, so that
    /// its report shows another mode for good only once it is later by [`LATENCY`].
    fn giving_back(v: &View<'_>, since: Time<VesselClock>, former: &HelmCheckpoint) -> GivingBack {
        let r = &v.read_back;
        let settled = r.reported.is_some_and(|at| at - since > LATENCY);
        if former.mode.is_none() || settled && r.present && !r.is_ours {
            GivingBack::Done
        } else if v.now - since > GIVE_BACK {
            GivingBack::Failed
        } else {
            GivingBack::GoesOn
        }
    }
    /// No drone has come for the deck for long.
    fn is_over(&self, now: Time<VesselClock>) -> bool {
        self.wanted.is_none_or(|t| now - t > GONE)
    }

    fn ask(&self, v: &View<'_>) -> Phase {
        // In our mode without us she is steered by somebody else.
        let can = v.read_back.present && !v.read_back.is_steered();
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
    /// The same of a course that the skipper is asked for, from the motion now: within the errors of a course she heads and
    /// goes as when he was asked.
    fn still_permits(&self, goal: &Goal, now: &BoatMotion) -> bool {
        let keeps_speed = (goal.speed_mps - now.speed_mps).abs() < SPEED_ERROR_MPS;
        (self.autopilot.steers_speed() || keeps_speed)
            && self.config.permits_within(goal, now, COURSE_ERROR_RAD)
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
        let asks = !gone && !v.read_back.is_steered();
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
            Some(false) | None if v.now - since > ANSWER => withdrawn(HelmEnd::Unanswered),
            Some(false) | None => Phase::Asked { since, goal },
        }
    }
    fn response(&self, now: Time<VesselClock>, goal: Goal, motion: &BoatMotion) -> Response {
        Response::begin(now, goal, motion, !self.autopilot.steers_speed())
    }

    /// Why a helm ends at once.
    fn ends(v: &View<'_>, s: &Steering) -> Option<HelmEnd> {
        let steered = v.now - s.since;
        let (r, demand) = (&v.read_back, v.input.demand);
        let late = steered > ENGAGE;
        let too_long = demand == Demand::Comes && steered > MAX_STEERING;
        [
            (v.answer == Some(false), HelmEnd::Refused),
            (v.input.turning, HelmEnd::Turning),
            (!r.present, HelmEnd::LinkLost),
            (r.by_hand, HelmEnd::HandOnHelm),
            (s.engaged && !r.is_ours, HelmEnd::ModeChanged),
            (!s.engaged && (r.denied || late), HelmEnd::Denied),
            (v.motion.is_none(), HelmEnd::NoEstimate),
            // A boat that has not begun to turn does not begin under a descent.
            (!s.engaged && demand == Demand::Descends, HelmEnd::Descent),
            (too_long, HelmEnd::TooLong),
            (s.engaged && s.response.is_violated(v.now), HelmEnd::HandOnHelm),
        ]
        .into_iter()
        .find_map(|(ends, why)| ends.then_some(why))
    }
    /// Withdrawn; what was before is given back unless nothing was commanded yet, or a person has chosen a mode.
    fn withdraw(v: &View<'_>, why: HelmEnd, s: &Steering) -> Phase {
        let commanded = s.engaged || v.now - s.since > LEAD;
        let former = (commanded && why != HelmEnd::ModeChanged).then_some(s.former);
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
        let demand = v.input.demand;
        let stands = demand == Demand::Stands;
        if secured || !stands && self.is_over(v.now) {
            return self.return_to_former(v, s);
        }
        if let Some(motion) = v.motion.filter(|_| demand == Demand::Descends && !s.steady) {
            // The drone has chosen to land now: what is, is kept.
            let goal = Goal {
                heading_rad: motion.heading_rad,
                speed_mps: motion.speed_mps.max(0.0),
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

    /// Back to the former course, as fast as before, or as now where that is beyond the limits. Slower than the lowest speed
    /// she would not answer: then she is given back as she goes.
    fn return_to_former(&self, v: &View<'_>, mut s: Steering) -> Phase {
        let Some(motion) = v.motion else {
            return Self::withdraw(v, HelmEnd::NoEstimate, &s);
        };
        let [low, high] = self.config.speed_mps;
        let speed_mps = match self.autopilot.steers_speed() {
            true => s.former.speed_mps.clamp(0.0, high.max(motion.speed_mps)),
            false => motion.speed_mps,
        };
        let former = Goal {
            heading_rad: s.former.heading_rad,
            speed_mps,
            likelihood: None,
            slope_sd: None,
        };
        (s.since, s.response) = (v.now, self.response(v.now, former, &motion));
        Phase::Returning {
            steering: s,
            mode_since: (speed_mps < low).then_some(v.now),
        }
    }
    fn give_back(&self, v: &View<'_>, mut s: Steering, mode_since: Option<Time<VesselClock>>) -> Phase {
        if let Some(since) = mode_since {
            return match Self::giving_back(v, since, &s.former) {
                GivingBack::Done => Phase::Idle,
                GivingBack::GoesOn => Phase::Returning {
                    steering: s,
                    mode_since,
                },
                GivingBack::Failed => Phase::Withdrawn {
                    since: v.now,
                    why: HelmEnd::NotGivenBack,
                    former: None,
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
            Phase::Steering(s) if now - s.since <= LEAD => Command::Nothing,
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
        let command = self.command(now);
        HelmOut {
            status: self.status(),
            bytes: self.autopilot.send(now, &command),
        }
    }
}

#[cfg(test)]
mod tests;
