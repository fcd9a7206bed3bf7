//! The pilot samples the plan at 100 Hz, tracks it, and ends the flight when the feet are on the deck.
//!
//! [`crate::flatness`] converts between thrust and attitude; [`crate::tracking`] is the control loop; [`response`] and
//! [`delay`] identify the autopilot in flight; [`touchdown`] detects the contact; [`set_points`] builds the set-point
//! of each action; [`admission`] refuses unsafe plans; and [`crate::contingency`] chooses the action without a plan or a mission.

mod admission;
pub mod config;
mod delay;
mod response;
mod set_points;
mod take_off;
pub mod touchdown;

#[cfg(test)]
mod sim_tests;
#[cfg(test)]
mod tests;

pub use config::{Output, PilotConfig};
pub use touchdown::{Touchdown, TouchdownContact};

use alight_shared::{
    admission::Latest,
    bus::wiring,
    geometry::{DeckGeometry, DroneGeometry, GRAVITY},
    msg::{
        AutopilotMode, AutopilotState, DeckForecast, DroneState, LandingMode, Message, MissionState, Phase,
        Plan, PlanRefusal, PlanStage, RangeSample, SetPoint, SetPointKind, State,
    },
    node::Node,
    time::{DroneClock, DroneTime, Span},
    topics,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::{
    contingency::{
        Body, ContactOutcomes, ContingencyAction, ContingencyInput, DeckBelow, GOES_ON_WITHOUT_MISSION_S,
        Hold, LOST_OUTSIDE_M, outside_m,
    },
    lift_off::Rise,
    tracking::{FlightEstimator, Tracker},
};
use delay::Delay;
use response::ResponseEstimator;
use set_points::OLD_PLAN_S;
use touchdown::{AUTOPILOT_AGE_S, TouchdownDetector, TouchdownEvidence};

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PilotIn {
    pub plan: Option<Plan>,
    pub mission: Option<MissionState>,
    pub forecast: Option<DeckForecast>,
    pub drone: Option<DroneState>,
    pub autopilot: Option<AutopilotState>,
    pub ranges: Vec<RangeSample>,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PilotOut {
    pub set_point: Option<SetPoint>,
    /// Published once, when a touchdown is confirmed.
    pub touchdown: Option<Touchdown>,
}

wiring! {
    PilotPorts of Pilot: PilotIn => PilotOut {
        reads {
            newest plan: Plan,
            newest mission: MissionState,
            newest forecast: DeckForecast,
            newest drone: DroneState,
            newest autopilot: AutopilotState,
            all ranges: RangeSample,
        }
        writes { set_point: SetPoint }
        wakes { DroneState }
    }
}

impl PilotOut {
    fn of(set_point: SetPoint) -> Self {
        PilotOut {
            set_point: Some(set_point),
            touchdown: None,
        }
    }
}

#[derive(Clone, Debug)]
pub struct Pilot {
    config: PilotConfig,
    geometry: DroneGeometry,
    deck: DeckGeometry,
    drone_id: u32,
    boot: u32,
    sequence: u32,

    plan: Latest<Plan>,
    admitted: Option<Plan>,
    /// Reason why the newest plan is not flown.
    refusal: Option<PlanRefusal>,
    mission: Latest<MissionState>,
    forecast: Latest<DeckForecast>,
    drone: Latest<DroneState>,
    autopilot: Latest<AutopilotState>,
    range: Latest<RangeSample>,

    estimate: FlightEstimator,
    response: ResponseEstimator,
    delay: Delay,
    tracker: Tracker,
    detector: TouchdownDetector,
    hold: Option<Hold>,
    /// Start of a take-off in progress, and the rise since then; None for a pilot that started in the air.
    jump: Option<(DroneTime, Option<Rise>)>,
    /// Height at which the drone was last disarmed, NED z, m.
    disarmed_z: Option<f64>,
    completes: bool,
    stopped_at: Option<DroneTime>,
    disarmed_since_stop: bool,
    /// Whether the mission has reported the landing since the motors were stopped.
    landed_since_stop: bool,
    last_step: Option<DroneTime>,
}

/// Maximum integration step, s, so that the set-point does not jump after an interruption.
const MAX_STEP_S: f64 = 0.05;
/// Time without set-points after which an autopilot leaves the commanded mode, s: PX4's minimum (COM_OF_LOSS_T) minus
/// the link's delay.
const SET_POINT_LOSS_S: f64 = 0.3;
const PLAN_PERIOD_S: f64 = 0.02;
/// Height of the feet below which the drone may stand on the ground, m: by the rangefinder, or above the height at
/// which it was disarmed, because a deck heaves.
const LOW_BY_RANGE_M: f64 = 0.3;
const LOW_M: f64 = 1.0;

impl Pilot {
    pub fn new(
        config: &PilotConfig,
        geometry: &DroneGeometry,
        deck: &DeckGeometry,
        drone_id: u32,
        boot: u32,
    ) -> Self {
        let hover = (geometry.mass_kg * GRAVITY / geometry.max_thrust_n).clamp(0.05, 0.9);
        Pilot {
            config: config.clone(),
            geometry: *geometry,
            deck: *deck,
            drone_id,
            boot,
            sequence: 0,
            plan: Latest::default(),
            admitted: None,
            refusal: None,
            mission: Latest::default(),
            forecast: Latest::default(),
            drone: Latest::default(),
            autopilot: Latest::default(),
            range: Latest::default(),
            estimate: FlightEstimator::new(hover),
            response: ResponseEstimator::new(geometry.attitude_lag_s, &config.lag),
            delay: Delay::default(),
            tracker: Tracker::default(),
            detector: TouchdownDetector::new(geometry.feet_below_m - geometry.rangefinder_m[2]),
            hold: None,
            jump: None,
            disarmed_z: None,
            completes: false,
            stopped_at: None,
            disarmed_since_stop: false,
            landed_since_stop: false,
            last_step: None,
        }
    }

    fn receive(&mut self, now: DroneTime, input: &PilotIn) -> Option<DroneState> {
        let before = self.drone.get().copied();
        let drone = input.drone.filter(|m| self.drone.offer(now, m));
        if (before.zip(drone)).is_some_and(|(before, d)| d.origin_moved_m(&before).is_some()) {
            self.forget_frame();
        }
        if let Some(m) = &input.autopilot
            && self.autopilot.offer(now, m)
        {
            self.estimate.use_reported_hover(m.hover_thrust);
            if !m.armed {
                self.detector.forget_contacts();
            }
            self.disarmed_since_stop |= self.stopped_at.is_some() && !m.armed;
            if let Some(d) = self
                .drone
                .fresh(now, topics::DRONE_STATE.stale_after)
                .filter(|_| !m.armed)
            {
                self.disarmed_z = Some(d.position[2]);
            }
        }
        if let Some(m) = &input.mission {
            self.mission.offer(now, m);
        }
        if let Some(m) = &input.forecast {
            self.forecast.offer(now, m);
        }
        if let Some(m) = &input.plan {
            self.plan.offer(now, m);
        }
        for m in &input.ranges {
            if self.range.offer(now, m) {
                self.detector.range(m.header.at, m.range_m);
            }
        }
        drone
    }

    /// Discards plan, forecast, hold and integral, which refer to another frame.
    fn forget_frame(&mut self) {
        self.plan.forget();
        self.admitted = None;
        self.forecast.forget();
        self.hold = None;
        self.disarmed_z = None;
        self.tracker.reset();
    }

    /// Whether the drone is low enough to stand on the ground, according to the rangefinder or the height at
    /// which it was disarmed.
    fn is_low(&self, now: DroneTime, body: &Body) -> bool {
        let feet_m = self.geometry.feet_below_m - self.geometry.rangefinder_m[2];
        match self.detector.median(now) {
            Some(range_m) => range_m < feet_m + LOW_BY_RANGE_M,
            None => self.disarmed_z.is_some_and(|z| body.position.z > z - LOW_M),
        }
    }

    /// Deck below the drone; None if forecast or odometry do not cover `now`.
    fn below(&self, now: DroneTime, body: &Body) -> Option<DeckBelow> {
        DeckBelow::of(now, self.forecast.get()?, body, &self.geometry)
    }

    /// Whether feet that touch the deck `below` do not stay on it. An old forecast does not keep the motors running.
    fn slides(&self, now: DroneTime, below: Option<&DeckBelow>) -> bool {
        let fresh = self.forecast.age_s(now) <= topics::FORECAST.stale_after.secs();
        fresh && below.is_some_and(|b| outside_m(&b.rests_at, &self.deck, &self.geometry) > LOST_OUTSIDE_M)
    }

    fn stop_from(&mut self, now: DroneTime) {
        self.stopped_at = Some(now);
        self.disarmed_since_stop = false;
        self.landed_since_stop = false;
    }

    /// Whether stopped motors stay stopped. They are released if the autopilot was disarmed and the mission is idle
    /// again; if the mission climbs after it has reported the landing (a false touchdown); or if the autopilot has
    /// flown on its own in the meantime. The touchdown must then be detected again.
    fn stays_stopped(&mut self, now: DroneTime, mission: Option<&MissionState>, late_s: f64) -> bool {
        let Some(at) = self.stopped_at else {
            return false;
        };
        // The autopilot's own landing also ends on the deck, so it does not release the motors.
        let own = |a: &AutopilotState| {
            a.header.at > at && !matches!(a.mode, AutopilotMode::Offboard | AutopilotMode::Land)
        };
        let flown = self.armed(now).is_some_and(own);
        if !self.disarmed_since_stop && (flown || late_s > SET_POINT_LOSS_S) {
            self.release();
            return false;
        }
        let since = mission.filter(|m| m.header.at > at);
        self.landed_since_stop |= since.is_some_and(|m| m.state == State::Landed);
        let next_flight = since.is_some_and(|m| m.state == State::Idle || m.state.stands_for_take_off());
        let climbs = since.is_some_and(|m| matches!(m.state, State::GaveUp | State::Hold | State::Tracking));
        if !(next_flight && self.disarmed_since_stop || climbs && self.landed_since_stop) {
            return true;
        }
        self.release();
        false
    }

    fn release(&mut self) {
        self.stopped_at = None;
        self.disarmed_since_stop = false;
        self.detector.clear();
    }

    fn touch_down(&mut self, now: DroneTime, touchdown: Touchdown) -> PilotOut {
        self.stop_from(now);
        let set_point = self.stop(now);
        PilotOut {
            set_point: Some(set_point),
            touchdown: Some(Touchdown {
                header: set_point.header,
                ..touchdown
            }),
        }
    }

    /// Stores the command and updates the thrust that explains the next odometry.
    fn remember(&mut self, now: DroneTime, dt: f64, set_point: &SetPoint) {
        let followed = self
            .autopilot
            .get()
            .is_some_and(|a| a.mode == AutopilotMode::Offboard);
        let own = (followed && set_point.kind == SetPointKind::Attitude).then(|| {
            let [w, i, j, k] = set_point.attitude;
            (
                UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k)),
                set_point.thrust,
            )
        });
        self.delay.sent.push(now, own);
        let answered = self.delay.answered(now);
        self.estimate
            .commanded(answered.map(|(_, u)| u), dt, self.config.tracking.thrust_lag_s);
    }

    /// Updates hover thrust, response and disturbance from new odometry in free flight.
    fn learn(&mut self, now: DroneTime, new: Option<&DroneState>, dt: f64, below: Option<&DeckBelow>) {
        let Some(d) = new else { return };
        if self.lies_on_deck() {
            self.estimate.forget_lift();
            self.response.interrupt();
            return;
        }
        let force = Vector3::from(d.specific_force);
        if self.detector.contact() == TouchdownContact::Clear {
            self.estimate
                .learn_lift(&force, &d.attitude(), dt, &self.config.tracking);
        }
        let free =
            self.detector.contact() == TouchdownContact::Clear && below.is_none_or(|b| b.clearance > 0.5);
        if !free {
            self.response.interrupt();
            return;
        }
        self.estimate.use_disturbance(d.disturbance());
        let c = &self.config.tracking;
        let one_way_s = self.delay.one_way_s();
        self.response
            .learn(d, &self.delay.sent, one_way_s, &self.config.lag);
        self.delay.learn_thrust(d, c.thrust_lag_s);
        let reported = self.armed(now).and_then(|a| a.thrust).filter(|t| *t > 0.0);
        if let Some(u) = self.estimate.in_force().or(reported) {
            self.estimate.learn_hover(&force, u, dt, c);
        }
    }

    fn evidence(
        &self,
        now: DroneTime,
        mission: Option<&MissionState>,
        new: Option<&DroneState>,
        below: Option<&DeckBelow>,
    ) -> TouchdownEvidence {
        let limit = Span::from_secs(AUTOPILOT_AGE_S);
        let begins = self.config.output == Output::Attitude && self.estimate.in_force().is_none();
        let commands = self.armed(now).is_some_and(|a| a.mode == AutopilotMode::Offboard);
        let permitted = commands
            && !self.slides(now, below)
            && mission.is_some_and(|m| m.lowest_clearance_m.is_none())
            && mission.is_some_and(|m| {
                let committed = below.is_some_and(|b| b.clearance <= m.commit_clearance_m);
                let near = committed && matches!(m.state, State::Descent | State::Landed);
                m.state == State::Flare || near
            });
        TouchdownEvidence {
            permitted,
            descending: mission.is_some_and(|m| m.descent_mps > 0.0 || m.state == State::Landed),
            force: new.map(|d| -d.specific_force[2]),
            begins_within: begins.then_some(self.geometry.max_thrust_n / self.geometry.mass_kg),
            own_thrust: self.estimate.in_force().map(|u| self.estimate.specific(u)),
            reported_thrust: self
                .autopilot
                .fresh(now, limit)
                .and_then(|a| a.thrust)
                .map(|thrust| self.estimate.specific(thrust)),
            hover_thrust: GRAVITY,
            clearance: below.map(|b| b.clearance),
            normal_speed: below.map(|b| b.normal_speed),
        }
    }

    /// Whether `mission` has withdrawn the plan's landing and the planner has not responded for several periods. A plan
    /// with the same time stamp may have been started before the withdrawal.
    fn is_withdrawn(&self, now: DroneTime, plan: &Plan, mission: &MissionState) -> bool {
        mission.state.phase() != Phase::Landing
            && mission.previous.phase() == Phase::Landing
            && (plan.header.at - mission.since).secs() < PLAN_PERIOD_S
            && (now - mission.since).secs() > OLD_PLAN_S
    }

    /// Last state of the mission, for a short time after its last message.
    fn last_mission(&self, now: DroneTime) -> Option<MissionState> {
        let limit = topics::MISSION.stale_after.secs() + GOES_ON_WITHOUT_MISSION_S;
        let goes_on = |m: &&MissionState| {
            let leaves = matches!(m.state, State::SpinUp | State::TakeOff | State::StandDown);
            leaves || m.state.phase() != Phase::None
        };
        let last = self.mission.get().filter(goes_on);
        last.filter(|_| self.mission.age_s(now) <= limit).copied()
    }

    fn fly(
        &mut self,
        now: DroneTime,
        dt: f64,
        mission: Option<MissionState>,
        body: &Body,
        below: Option<&DeckBelow>,
    ) -> SetPoint {
        let autopilot = self.armed(now).copied();
        let silent = mission.is_none();
        let mission = mission.or_else(|| self.last_mission(now));
        let plan = mission.and_then(|m| self.wanted_plan(now, &m, body, below));
        let known = ContingencyInput {
            autopilot: autopilot.as_ref(),
            mission: mission.as_ref(),
            silent,
            planned: plan.is_some(),
            below,
            holds: self.hold.is_some(),
            attitudes: self.config.output == Output::Attitude,
            touches: matches!(self.detector.contact(), TouchdownContact::Suspected { .. }),
            low: self.is_low(now, body),
        };
        if known.waits() && !known.commands() {
            // Offboard modes need a stream of set-points before they are entered; until then the hold follows the
            // drone.
            self.hold = None;
            self.tracker.reset();
        }
        let action = known.action(|| below.is_some() && self.lands_softer(now, body));
        // If the autopilot is briefly silent in a take-off, the drone must not return to standing.
        if mission.is_none_or(|m| m.state != State::TakeOff) {
            self.jump = None;
        }
        let goes_on = matches!(
            action,
            ContingencyAction::Follow | ContingencyAction::Complete | ContingencyAction::Press
        );
        self.completes = silent && goes_on;
        let led = self.acted_on(now, body);
        match (action, &plan, &mission, below) {
            (ContingencyAction::RemainOnDeck, ..) => self.stand(now, body),
            (ContingencyAction::Idle, ..) => self.idle(now, body, dt, below),
            (ContingencyAction::Jump, _, Some(m), _) => self.jump(now, &led, dt, m, below),
            (ContingencyAction::Hold, ..) => self.hold(now, body, dt, None),
            (ContingencyAction::Leave, ..) => {
                let height_m = self.mission.get().map_or(0.0, |m| m.height_m);
                let near = below.filter(|b| b.is_near(body, height_m, &self.geometry));
                self.hold(now, &led, dt, near)
            }
            (ContingencyAction::Press, ..) => {
                let yaw = plan.map_or(body.yaw(), |(_, s)| s.euler[2]);
                self.press(now, body, dt, below, yaw)
            }
            (ContingencyAction::Follow, Some(plan), Some(m), _) => self.follow(now, plan, m, &led, dt, below),
            (ContingencyAction::Complete, _, _, Some(b)) => self.complete(now, &led, dt, b),
            (
                ContingencyAction::Nothing
                | ContingencyAction::Jump
                | ContingencyAction::Follow
                | ContingencyAction::Complete,
                ..,
            ) => self.no_set_point(now),
        }
    }

    /// Plan, and its stage for a command sent at `now`, in states that need a plan.
    fn wanted_plan(
        &mut self,
        now: DroneTime,
        mission: &MissionState,
        body: &Body,
        below: Option<&DeckBelow>,
    ) -> Option<(Plan, PlanStage)> {
        self.refusal = None;
        if mission.state == State::Landed {
            return None;
        }
        let mut plan = *self.plan.fresh(now, topics::PLAN.stale_after)?;
        // Feet that touch the deck are pressed onto it, and the plan leads through the deck.
        if self.detector.contact() == TouchdownContact::Clear {
            plan = self.admitted_plan(now, &plan, mission, body, below)?;
        }
        if self.is_withdrawn(now, &plan, mission) {
            return None;
        }
        Some((plan, self.served(now, &plan)?))
    }

    fn armed(&self, now: DroneTime) -> Option<&AutopilotState> {
        self.autopilot
            .fresh(now, topics::AUTOPILOT.stale_after)
            .filter(|a| a.armed)
    }

    fn lands_softer(&self, now: DroneTime, body: &Body) -> bool {
        let ends = |f| ContactOutcomes::predict(now, f, &body.position, &body.velocity, &self.geometry);
        let touched = self.detector.contact() != TouchdownContact::Clear;
        touched
            || self
                .forecast
                .get()
                .and_then(ends)
                .is_some_and(|e| e.landing_is_softer())
    }
}

impl Node for Pilot {
    type Clock = DroneClock;
    type In = PilotIn;
    type Out = PilotOut;

    fn step(&mut self, now: DroneTime, input: &PilotIn) -> PilotOut {
        let late_s = self.last_step.map_or(0.01, |t| (now - t).secs());
        let dt = late_s.clamp(0.0, MAX_STEP_S);
        self.last_step = Some(now);
        let new = self.receive(now, input);
        let mission = self.mission.fresh(now, topics::MISSION.stale_after).copied();
        if self.stays_stopped(now, mission.as_ref(), late_s) {
            return PilotOut::of(self.stop(now));
        }
        let Some(drone) = self.drone.fresh(now, topics::DRONE_STATE.stale_after).copied() else {
            self.detector.clear();
            self.estimate.commanded(None, dt, 0.0);
            return PilotOut::of(self.no_set_point(now));
        };
        let age_s = (now - drone.header.at).secs().max(0.0);
        let body = Body::of(&drone, age_s);
        let below = self.below(now, &body);
        let landing = mission.or_else(|| self.last_mission(now).filter(|_| self.completes));
        let evidence = self.evidence(now, landing.as_ref(), new.as_ref(), below.as_ref());
        if let Some(touchdown) = self.detector.step(now, dt, &evidence) {
            return self.touch_down(now, touchdown);
        }
        if new.is_some() {
            self.delay.received(age_s, dt, &self.config.delay);
        }
        let near = below.as_ref().filter(|b| b.is_near(&body, 0.0, &self.geometry));
        self.learn(now, new.as_ref(), dt, near);
        if mission.is_some_and(|m| m.settings.mode == LandingMode::Shadow) {
            // The autopilot did not follow the last command.
            self.tracker.reset();
        }
        let set_point = self.fly(now, dt, mission, &body, below.as_ref());
        self.remember(now, dt, &set_point);
        // The message's own check must not reject a published set-point.
        let passes = set_point.check().is_ok();
        PilotOut::of(if passes { set_point } else { self.no_set_point(now) })
    }
}
