//! The pilot: samples the plan at 100 Hz, tracks it into the set-point, and ends the flight when
//! the feet are on the deck.
//!
//! [`attitude`] is the flatness inverse, [`tracking`] the loop, [`estimate`], [`lag`] and [`delay`] what it
//! learns in flight, [`touchdown`] the evidence of contact. This file decides which of them makes the set-point.

pub mod attitude;
pub mod config;
mod delay;
mod estimate;
mod lag;
pub mod touchdown;
mod tracking;

#[cfg(test)]
mod sim_tests;
#[cfg(test)]
mod tests;

pub use config::{Output, PilotConfig};
pub use touchdown::{Contact, Touchdown};
pub(crate) use tracking::steer;

use alight_shared::admission::Latest;
use alight_shared::geometry::{DroneGeometry, GRAVITY};
use alight_shared::msg::{
    AutopilotMode, AutopilotState, DeckForecast, DeckStage, DroneState, Header, LandedState, LandingMode,
    Message, MissionState, Motors, Phase, Plan, PlanStage, RangeSample, SetPoint, SetPointKind, State,
};
use alight_shared::node::Node;
use alight_shared::surroundings::Surroundings;
use alight_shared::time::{DroneClock, Span, Time};
use alight_shared::topics;
use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::escape::{BELOW_M, Climb, contact_speed};
use crate::odometry::origin::DroneFrame;
use crate::surroundings::{escape_velocity, ring_m};
use attitude::{attitude_of_thrust, rates_of, upright};
use delay::Delay;
use estimate::FlightEstimator;
use lag::AttitudeLagEstimator;
use touchdown::{Evidence, TouchdownDetector, press_fraction};
use tracking::{AttitudeCommand, Authority, Body, Tracker};

/// Inputs.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PilotIn {
    /// The planner's trajectory.
    pub plan: Option<Plan>,
    /// The mission's state.
    pub mission: Option<MissionState>,
    /// The deck's forecast.
    pub forecast: Option<DeckForecast>,
    /// The drone's odometry.
    pub drone: Option<DroneState>,
    /// The autopilot's state.
    pub autopilot: Option<AutopilotState>,
    /// Readings of the rangefinder.
    pub ranges: Vec<RangeSample>,
}

/// Outputs.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PilotOut {
    /// The set-point, every step.
    pub set_point: Option<SetPoint>,
    /// Once, when touchdown is confirmed.
    pub touchdown: Option<Touchdown>,
}

impl PilotOut {
    fn of(set_point: SetPoint) -> Self {
        PilotOut {
            set_point: Some(set_point),
            touchdown: None,
        }
    }
}

/// Where the pilot holds on its own.
#[derive(Clone, Copy, Debug, PartialEq)]
struct HoldPlace {
    horizontal: Vector2<f64>,
    climb: Climb,
    yaw: f64,
}

/// The drone and the deck below it, now.
#[derive(Clone, Copy, Debug)]
struct DeckBelow {
    stage: DeckStage,
    around: Surroundings,
    clearance: f64,
    normal_speed: f64,
}

/// The pilot node.
#[derive(Clone, Debug)]
pub struct Pilot {
    config: PilotConfig,
    geometry: DroneGeometry,
    drone_id: u32,
    boot: u32,
    sequence: u32,

    plan: Latest<Plan>,
    mission: Latest<MissionState>,
    forecast: Latest<DeckForecast>,
    drone: Latest<DroneState>,
    autopilot: Latest<AutopilotState>,
    range: Latest<RangeSample>,
    frame: DroneFrame,

    estimate: FlightEstimator,
    lag: AttitudeLagEstimator,
    delay: Delay,
    tracker: Tracker,
    detector: TouchdownDetector,
    hold: Option<HoldPlace>,
    /// The landing goes on without the mission or a plan.
    completes: bool,
    stopped_at: Option<Time<DroneClock>>,
    disarmed_since_stop: bool,
    /// The mission took notice of the stop.
    landed_since_stop: bool,
    last_step: Option<Time<DroneClock>>,
}

/// Steps further apart than this count as this long: a pilot that was away must not jump, s.
const MAX_STEP_S: f64 = 0.05;
/// Period of the planner, s.
const PLAN_PERIOD_S: f64 = 0.02;
/// A plan older than this, five of its periods, brakes by an old forecast of the deck, s.
const OLD_PLAN_S: f64 = 0.1;
/// A landing without a plan has braked so long before its contact as one with a plan, s.
const SOFT_S: f64 = 0.2;

impl Pilot {
    /// A pilot of the drone described by `geometry`.
    pub fn new(config: &PilotConfig, geometry: &DroneGeometry, drone_id: u32, boot: u32) -> Self {
        let hover = (geometry.mass_kg * GRAVITY / geometry.max_thrust_n).clamp(0.05, 0.9);
        Pilot {
            config: config.clone(),
            geometry: *geometry,
            drone_id,
            boot,
            sequence: 0,
            plan: Latest::default(),
            mission: Latest::default(),
            forecast: Latest::default(),
            drone: Latest::default(),
            autopilot: Latest::default(),
            range: Latest::default(),
            frame: DroneFrame::default(),
            estimate: FlightEstimator::new(hover),
            lag: AttitudeLagEstimator::new(geometry.attitude_lag_s, &config.lag),
            delay: Delay::default(),
            tracker: Tracker::default(),
            detector: TouchdownDetector::new(geometry.feet_below_m - geometry.rangefinder_m[2]),
            hold: None,
            completes: false,
            stopped_at: None,
            disarmed_since_stop: false,
            landed_since_stop: false,
            last_step: None,
        }
    }

    /// Takes the inputs; gives the odometry when it is new.
    fn receive(&mut self, now: Time<DroneClock>, input: &PilotIn) -> Option<DroneState> {
        let drone = input.drone.filter(|m| self.drone.offer(now, m));
        if drone.is_some_and(|m| self.frame.moved_m(&m).is_some()) {
            self.forget_frame();
        }
        if let Some(m) = &input.autopilot
            && self.autopilot.offer(now, m)
        {
            if self.frame.has_jumped(m) {
                self.forget_frame();
            }
            self.estimate.use_reported_hover(m.hover_thrust);
            self.disarmed_since_stop |= self.stopped_at.is_some() && !m.armed;
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

    /// Plan, forecast, hold and integral are of another frame.
    fn forget_frame(&mut self) {
        self.plan.forget();
        self.forecast.forget();
        self.hold = None;
        self.tracker.reset();
    }

    /// The deck under the drone, when forecast and odometry reach `now`.
    fn below(&self, now: Time<DroneClock>, body: &Body) -> Option<DeckBelow> {
        let f = self.forecast.get()?;
        let stage = f.at(now.max(f.header.at))?;
        let up = stage.normal();
        let r = body.position - Vector3::from(stage.position);
        Some(DeckBelow {
            stage,
            around: f.surroundings,
            clearance: up.dot(&r) - self.geometry.feet_below_m,
            normal_speed: up.dot(&(body.velocity - Vector3::from(stage.velocity))),
        })
    }

    fn set_point(&mut self, now: Time<DroneClock>) -> SetPoint {
        self.sequence = self.sequence.wrapping_add(1);
        let vessel = self.mission.get().map_or(0, |m| m.header.vessel);
        SetPoint {
            header: Header::new(vessel, self.drone_id, self.boot, self.sequence, now),
            ..SetPoint::default()
        }
    }

    /// No set-point: the autopilot's own failsafe acts.
    fn no_set_point(&mut self, now: Time<DroneClock>) -> SetPoint {
        self.hold = None;
        self.tracker.reset();
        self.set_point(now)
    }

    /// The motors stop from now on.
    fn stop_from(&mut self, now: Time<DroneClock>) {
        self.stopped_at = Some(now);
        self.disarmed_since_stop = false;
        self.landed_since_stop = false;
    }

    /// Motors off, until the mission is idle again.
    fn stop(&mut self, now: Time<DroneClock>) -> SetPoint {
        let attitude = self.drone.get().map_or([1.0, 0.0, 0.0, 0.0], |d| d.attitude);
        SetPoint {
            kind: SetPointKind::Attitude,
            motors: Motors::Stop,
            attitude,
            thrust: 0.0,
            ..self.set_point(now)
        }
    }

    /// Position, velocity and acceleration for the autopilot's own loop. The acceleration leads by
    /// the attitude's lag: it is what the attitude has to be by then.
    fn trajectory(&mut self, now: Time<DroneClock>, plan: &Plan, stage: &PlanStage) -> SetPoint {
        self.hold = None;
        self.tracker.reset();
        let ahead = plan
            .sample(self.acts_at(now) + Span::from_secs(self.lag.lag(&self.config.lag)))
            .map_or(stage.acceleration, |s| s.acceleration);
        let q = UnitQuaternion::from_euler_angles(stage.euler[0], stage.euler[1], stage.euler[2]);
        SetPoint {
            kind: SetPointKind::Trajectory,
            position: stage.position,
            velocity: stage.velocity,
            acceleration: ahead,
            yaw: stage.euler[2],
            yaw_rate: stage.euler_rates[2],
            attitude: [q.w, q.i, q.j, q.k],
            rates: rates_of(&stage.euler, &stage.euler_rates).into(),
            thrust: self.estimate.hover().clamp(0.0, 1.0),
            ..self.set_point(now)
        }
    }

    /// Attitude and thrust of the pilot's own loop.
    fn attitude(
        &mut self,
        now: Time<DroneClock>,
        stage: Option<&PlanStage>,
        a: AttitudeCommand,
        body: &Body,
    ) -> SetPoint {
        self.hold = None;
        let presses = stage.is_none();
        let stage = stage.copied().unwrap_or_default();
        let (_, _, yaw) = a.attitude.euler_angles();
        // Making up for the lag lengthens the turn, and must not tip the drone over.
        let attitude = self.lag.command(&a.attitude, &body.attitude, &self.config.lag);
        let attitude = upright(&attitude, self.config.tracking.tilt_limit_rad);
        let least = if presses {
            0.0
        } else {
            let turn = (attitude * Vector3::z()).angle(&(body.attitude * Vector3::z()));
            self.least_thrust(turn)
        };
        SetPoint {
            kind: SetPointKind::Attitude,
            position: stage.position,
            velocity: stage.velocity,
            acceleration: stage.acceleration,
            yaw,
            attitude: [attitude.w, attitude.i, attitude.j, attitude.k],
            rates: a.rates.map(|v| v.clamp(-4.0, 4.0)).into(),
            thrust: a.thrust.max(least),
            ..self.set_point(now)
        }
    }

    /// Collective thrust at which no rotor has to stop for the torque that turns the drone by `angle` (rad): the attitude
    /// loop asks for the rate `angle / T`, the rate loop below for its change within `T_r`, so for the torque
    /// `tau = J angle / (T T_r)`; four rotors at the arm `l` in an X give it by `tau / (4 l / sqrt 2)` each. Mixers take
    /// torque before they raise the collective (PX4 without air mode), or raise it no higher than hover (ArduCopter);
    /// nor does this.
    fn least_thrust(&self, angle: f64) -> f64 {
        let (g, c) = (&self.geometry, &self.config.lag);
        let [roll, pitch, _] = g.inertia_kgm2;
        let torque = roll.max(pitch) * angle / (c.design_s * c.rate_loop_s);
        let rotor_n = torque / (4.0 * g.arm_m / core::f64::consts::SQRT_2);
        (4.0 * rotor_n / g.max_thrust_n).min(self.estimate.hover())
    }

    /// Whether the drone, without mission or plan, has to climb with the deck: near enough to be reached by it or what
    /// stands on the vessel, and not yet as high as the mission has asked for.
    fn is_near(&self, b: &DeckBelow, body: &Body) -> bool {
        let safety = &self.config.safety;
        let aside = (body.position - Vector3::from(b.stage.position)).xy().norm();
        let height = self.mission.get().map_or(0.0, |m| m.height_m) - BELOW_M;
        let clear = (height - self.geometry.feet_below_m).max(safety.near_deck_m);
        aside < ring_m(&b.around, &self.geometry) && b.clearance < clear
    }

    /// Whether a drone low above the deck, without mission and plan, lands softer than it climbs away: the deck would meet it
    /// harder on its way up.
    fn lands_softer(&self, now: Time<DroneClock>, body: &Body, b: &DeckBelow) -> bool {
        let sink_mps = self.config.safety.sink_mps;
        let climb = Climb::new(body.position.z, body.velocity.z, &self.geometry);
        let landing = climb.braked(-b.normal_speed, b.clearance, sink_mps);
        let touched = self.detector.contact() != Contact::Clear;
        let climbing = |f| {
            contact_speed(now, f, &body.position, &body.velocity, &self.geometry).is_some_and(|v| v > landing)
        };
        touched || self.forecast.get().is_some_and(climbing)
    }

    /// Stands where the drone is; away from a deck that is `near`: with it, up from it, and along the vessel's escape
    /// direction.
    fn hold(&mut self, now: Time<DroneClock>, body: &Body, dt: f64, near: Option<&DeckBelow>) -> SetPoint {
        let (_, _, yaw) = body.attitude.euler_angles();
        let sinks = near.map_or(0.0, |_| body.velocity.z);
        let mut hold = self.hold.unwrap_or_else(|| HoldPlace {
            horizontal: body.position.xy(),
            climb: Climb::new(body.position.z, sinks, &self.geometry),
            yaw,
        });
        let before = hold.climb.velocity;
        let velocity = match near {
            Some(b) => {
                hold.climb.advance(dt, b.stage.velocity[2]);
                let out = escape_velocity(&b.around, &b.stage, &self.geometry, &body.position, b.clearance);
                Vector2::new(b.stage.velocity[0], b.stage.velocity[1]) + out
            }
            None => {
                hold.climb.rest(dt);
                Vector2::zeros()
            }
        };
        hold.horizontal += velocity * dt;
        let stage = PlanStage {
            position: [hold.horizontal.x, hold.horizontal.y, hold.climb.z],
            velocity: [velocity.x, velocity.y, hold.climb.velocity],
            acceleration: [0.0, 0.0, (hold.climb.velocity - before) / dt.max(1e-3)],
            euler: [0.0, 0.0, hold.yaw],
            euler_rates: [0.0; 3],
        };
        let set_point = match self.config.output {
            Output::Trajectory => {
                self.tracker.reset();
                SetPoint {
                    kind: SetPointKind::Trajectory,
                    position: stage.position,
                    velocity: stage.velocity,
                    acceleration: stage.acceleration,
                    yaw: hold.yaw,
                    ..self.set_point(now)
                }
            }
            Output::Attitude => {
                let authority = Authority {
                    brakes: near.is_some(),
                    ..Authority::descent(&self.config.tracking)
                };
                let body = self.acted_on(now, body);
                self.tracked(now, &stage, &stage, &body, authority, dt)
            }
        };
        self.hold = Some(hold);
        set_point
    }

    /// A set-point that keeps a drone on the ground there: level, with less thrust than flight needs.
    fn stand(&mut self, now: Time<DroneClock>, body: &Body) -> SetPoint {
        self.tracker.reset();
        let (_, _, yaw) = body.attitude.euler_angles();
        let level = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
        SetPoint {
            kind: SetPointKind::Attitude,
            position: body.position.into(),
            yaw,
            attitude: [level.w, level.i, level.j, level.k],
            thrust: self.config.tracking.min_thrust_of_hover * self.estimate.hover(),
            ..self.set_point(now)
        }
    }

    /// Attitude and thrust that follow `led`, what the plan's `stage` is by the time they act.
    fn tracked(
        &mut self,
        now: Time<DroneClock>,
        stage: &PlanStage,
        led: &PlanStage,
        body: &Body,
        authority: Authority,
        dt: f64,
    ) -> SetPoint {
        let (c, lag) = (&self.config.tracking, self.config.lag.design_s);
        let a = self
            .tracker
            .track(led, body, &self.estimate, authority, lag, dt, c);
        self.attitude(now, Some(stage), a, body)
    }

    /// Onto the deck without a plan: braked at a constant rate to the speed of a soft contact, level, and in the end aligned
    /// with the deck.
    fn sinking(&self, body: &Body, below: &DeckBelow) -> PlanStage {
        let least = self.config.safety.sink_mps;
        let (up, sinks) = (below.stage.normal(), -below.normal_speed);
        let climb = Climb::new(body.position.z, body.velocity.z, &self.geometry);
        let braking = climb.braking(sinks, below.clearance - SOFT_S * least, least);
        let (_, _, yaw) = body.attitude.euler_angles();
        let mut stage = PlanStage {
            position: body.position.into(),
            velocity: (Vector3::from(below.stage.velocity) - up * least.max(sinks)).into(),
            acceleration: (Vector3::from(below.stage.acceleration) + up * braking).into(),
            euler: [0.0, 0.0, yaw],
            euler_rates: [0.0; 3],
        };
        self.align(&mut stage, below);
        stage
    }

    /// Tilts the attitude of `stage` towards the deck's, from the clearance down at which the feedback fades out.
    fn align(&self, stage: &mut PlanStage, below: &DeckBelow) {
        let near = 1.0 - (below.clearance / self.config.tracking.fade_clearance_m).clamp(0.0, 1.0);
        let [roll, pitch, yaw] = stage.euler;
        let deck = attitude_of_thrust(&below.stage.normal(), yaw).euler_angles();
        stage.euler = [
            roll + near * (deck.0 - roll),
            pitch + near * (deck.1 - pitch),
            yaw,
        ];
    }

    /// The `stage` of a plan that is not renewed, braked and aligned by the newest forecast; None when it sinks no faster than
    /// a soft contact.
    fn renewed(&self, stage: &PlanStage, body: &Body, below: &DeckBelow) -> Option<PlanStage> {
        let relative = Vector3::from(stage.velocity) - Vector3::from(below.stage.velocity);
        if -relative.dot(&below.stage.normal()) <= self.config.safety.sink_mps {
            return None;
        }
        let (own, mut stage) = (self.sinking(body, below), *stage);
        stage.position[2] = own.position[2];
        stage.velocity[2] = own.velocity[2];
        stage.acceleration[2] = own.acceleration[2];
        self.align(&mut stage, below);
        Some(stage)
    }

    /// Learns hover thrust, lag and disturbance from new odometry in free flight.
    fn learn(&mut self, now: Time<DroneClock>, new: Option<&DroneState>, dt: f64, below: Option<&DeckBelow>) {
        let Some(d) = new else { return };
        let force = Vector3::from(d.specific_force);
        if self.detector.contact() == Contact::Clear {
            self.estimate
                .learn_lift(&force, &d.attitude(), dt, &self.config.tracking);
        }
        let free = self.detector.contact() == Contact::Clear && below.is_none_or(|b| b.clearance > 0.5);
        if !free {
            return;
        }
        self.estimate.use_disturbance(d.disturbance());
        let rates = Vector3::from(d.rates);
        self.lag.learn(&d.attitude(), &rates, dt, &self.config.lag);
        let c = &self.config.tracking;
        let reported = self
            .autopilot
            .fresh(now, topics::AUTOPILOT.stale_after)
            .filter(|a| a.armed && a.thrust > 0.0)
            .map(|a| a.thrust);
        if let Some(u) = self.estimate.acting().or(reported) {
            self.estimate.learn_hover(&force, u, dt, c);
        }
    }

    fn evidence(
        &self,
        now: Time<DroneClock>,
        mission: Option<&MissionState>,
        new: Option<&DroneState>,
        below: Option<&DeckBelow>,
    ) -> Evidence {
        let limit = Span::from_secs(self.config.touchdown.autopilot_age_s);
        let commands = self
            .autopilot
            .fresh(now, topics::AUTOPILOT.stale_after)
            .is_some_and(|a| a.armed && a.mode == AutopilotMode::Offboard);
        let committed = below.is_some_and(|b| b.clearance <= self.config.safety.commit_clearance_m);
        let permitted = commands
            && mission.is_some_and(|m| m.lowest_clearance_m.is_none())
            && mission.is_some_and(|m| {
                let near = committed && matches!(m.state, State::Descent | State::Landed);
                m.state == State::Flare || near
            });
        Evidence {
            permitted,
            descending: mission.is_some_and(|m| m.descent_mps > 0.0 || m.state == State::Landed),
            force: new.map(|d| -d.specific_force[2]),
            own_thrust: self.estimate.acting().map(|u| self.estimate.specific(u)),
            reported_thrust: self
                .autopilot
                .fresh(now, limit)
                .map(|a| self.estimate.specific(a.thrust)),
            hover_thrust: GRAVITY,
            clearance: below.map(|b| b.clearance),
            normal_speed: below.map(|b| b.normal_speed),
        }
    }

    /// A landing that `mission` no longer wants, by a planner that has not answered it for several of its periods. A plan
    /// of the same instant may have been begun before it was withdrawn.
    fn is_withdrawn(&self, now: Time<DroneClock>, plan: &Plan, mission: &MissionState) -> bool {
        mission.state.phase() != Phase::Landing
            && mission.previous.phase() == Phase::Landing
            && (plan.header.at - mission.since).secs() < PLAN_PERIOD_S
            && (now - mission.since).secs() > OLD_PLAN_S
    }

    /// What the mission wanted last, for a moment after its last message: then the autopilot's failsafe acts.
    fn last_mission(&self, now: Time<DroneClock>) -> Option<MissionState> {
        let limit = topics::MISSION.stale_after.secs() + self.config.safety.hold_without_mission_s;
        let last = self.mission.get().filter(|m| m.state.phase() != Phase::None);
        last.filter(|_| self.mission.age_s(now) <= limit).copied()
    }

    /// The set-point of a step in which the motors run.
    fn fly(
        &mut self,
        now: Time<DroneClock>,
        dt: f64,
        mission: Option<MissionState>,
        body: &Body,
        below: Option<&DeckBelow>,
    ) -> SetPoint {
        self.completes = false;
        let armed = self
            .autopilot
            .fresh(now, topics::AUTOPILOT.stale_after)
            .filter(|a| a.armed)
            .copied();
        let Some(autopilot) = armed else {
            return self.no_set_point(now);
        };
        // A pilot before this one stopped the motors, and this one has to find the touchdown again.
        let landed = mission.is_some_and(|m| m.state == State::Landed);
        let close = below.is_some_and(|b| b.clearance < self.config.safety.commit_clearance_m);
        let near = below.filter(|b| self.is_near(b, body));
        let silent = mission.is_none();
        let Some(mission) = mission.or_else(|| self.last_mission(now)) else {
            return self.no_set_point(now);
        };
        let commands = autopilot.mode == AutopilotMode::Offboard;
        let output = match mission.state.phase() {
            Phase::None if landed => {
                if !close || !commands {
                    return self.no_set_point(now);
                }
                Output::Attitude
            }
            Phase::None => {
                // Offboard modes want a stream of set-points before they can be entered; until
                // then the place to hold moves with whoever flies.
                if !commands {
                    self.hold = None;
                    self.tracker.reset();
                }
                if autopilot.landed == LandedState::OnGround && self.config.output == Output::Attitude {
                    return self.stand(now, body);
                }
                return self.hold(now, body, dt, None);
            }
            Phase::Navigation | Phase::Follow | Phase::Landing => self.config.output,
        };
        let plan = self
            .plan
            .fresh(now, topics::PLAN.stale_after)
            .filter(|p| !landed && !self.is_withdrawn(now, p, &mission))
            .and_then(|p| p.sample(self.acts_at(now)).map(|stage| (*p, stage)));
        let flare = mission.state == State::Flare;
        let lands = mission.state.phase() == Phase::Landing && mission.lowest_clearance_m.is_none();
        // A mission that fell silent in the descent would have gone on to the flare.
        let committed = close && (flare || landed || silent && lands);
        if silent {
            let softer = || below.is_some_and(|b| self.lands_softer(now, body, b));
            self.completes = committed && (plan.is_some() || softer());
            if !self.completes {
                return self.hold(now, body, dt, near);
            }
        }

        if let (Contact::Suspected { since, .. }, Output::Attitude) = (self.detector.contact(), output) {
            let fraction = press_fraction(since, now, &self.config.touchdown);
            let up = below.map(|b| b.stage.normal());
            let yaw = plan.map_or(body.attitude.euler_angles().2, |(_, s)| s.euler[2]);
            let thrust = fraction * self.estimate.hover();
            let a = self
                .tracker
                .press(up, yaw, thrust, body, dt, &self.config.tracking);
            return self.attitude(now, None, a, body);
        }
        let body = &self.acted_on(now, body);
        match (plan, output, below) {
            (Some((plan, stage)), Output::Trajectory, _) => self.trajectory(now, &plan, &stage),
            (Some((plan, stage)), Output::Attitude, _) => {
                let c = &self.config.tracking;
                let then = self.acts_at(now);
                let ahead = self.below(then, body);
                let mut authority = Authority {
                    planned: plan.disturbance.into(),
                    ..match ahead.as_ref().or(below) {
                        Some(b) if flare => Authority::flare(b.clearance, c),
                        Some(_) | None => Authority::descent(c),
                    }
                };
                // The thrust that acts after its lag is the one that the plan has by then.
                let mut led = stage;
                if let Some(then) = plan.sample(then + Span::from_secs(c.thrust_lag_s)) {
                    led.acceleration[2] = then.acceleration[2];
                }
                let old = lands && self.plan.age_s(now) > OLD_PLAN_S;
                let ahead = ahead.filter(|_| old);
                if let Some(braked) = ahead.and_then(|b| self.renewed(&led, body, &b)) {
                    (led, authority.brakes) = (braked, true);
                }
                self.tracked(now, &stage, &led, body, authority, dt)
            }
            (None, _, Some(b))
                if committed && self.hold.is_none() || lands && self.lands_softer(now, body, b) =>
            {
                let b = self.below(self.acts_at(now), body).unwrap_or(*b);
                let stage = self.sinking(body, &b);
                let c = &self.config.tracking;
                let authority = Authority {
                    brakes: true,
                    ..if b.clearance < c.fade_clearance_m {
                        Authority::flare(b.clearance, c)
                    } else {
                        Authority::descent(c)
                    }
                };
                self.tracked(now, &stage, &stage, body, authority, dt)
            }
            (None, _, _) => self.hold(now, body, dt, near),
        }
    }
}

impl Node for Pilot {
    type Clock = DroneClock;
    type In = PilotIn;
    type Out = PilotOut;

    fn step(&mut self, now: Time<DroneClock>, input: &PilotIn) -> PilotOut {
        let dt = self
            .last_step
            .map_or(0.01, |t| (now - t).secs())
            .clamp(0.0, MAX_STEP_S);
        self.last_step = Some(now);
        let new = self.receive(now, input);
        let mission = self.mission.fresh(now, topics::MISSION.stale_after).copied();

        if let Some(at) = self.stopped_at {
            // Released only after the autopilot was disarmed and the mission is idle again, or when the mission
            // that took notice of the stop climbs all the same: the touchdown was false.
            let since = mission.filter(|m| m.header.at > at);
            self.landed_since_stop |= since.is_some_and(|m| m.state == State::Landed);
            let anew = since.is_some_and(|m| m.state == State::Idle);
            let climbs = since.is_some_and(|m| matches!(m.state, State::GaveUp | State::Hold));
            if !(anew && self.disarmed_since_stop || climbs && self.landed_since_stop) {
                return PilotOut::of(self.stop(now));
            }
            self.stopped_at = None;
            self.disarmed_since_stop = false;
            self.detector.clear();
        }
        let Some(drone) = self.drone.fresh(now, topics::DRONE_STATE.stale_after).copied() else {
            self.detector.clear();
            self.estimate.commanded(None, dt, 0.0);
            return PilotOut::of(self.no_set_point(now));
        };
        let age = (now - drone.header.at).secs().max(0.0);
        let body = Body {
            position: drone.position() + drone.velocity() * age,
            velocity: drone.velocity(),
            attitude: drone.attitude(),
        };
        let below = self.below(now, &body);
        let landing = mission.or_else(|| self.last_mission(now).filter(|_| self.completes));
        let evidence = self.evidence(now, landing.as_ref(), new.as_ref(), below.as_ref());
        if let Some(mut touchdown) = self.detector.step(now, dt, &evidence, &self.config.touchdown) {
            self.stop_from(now);
            let set_point = self.stop(now);
            touchdown.header = set_point.header;
            return PilotOut {
                set_point: Some(set_point),
                touchdown: Some(touchdown),
            };
        }
        if new.is_some() {
            self.delay.received(age, dt, &self.config.delay);
        }
        self.learn(now, new.as_ref(), dt, below.as_ref());
        if mission.is_some_and(|m| m.mode == LandingMode::Shadow) {
            // Nobody follows the last command.
            self.tracker.reset();
        }
        let set_point = self.fly(now, dt, mission, &body, below.as_ref());
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
        self.delay.sent(now, own);
        let answered = self.delay.answered(now, &self.config.delay);
        self.lag.answers(answered.map(|(attitude, _)| attitude));
        self.estimate
            .commanded(answered.map(|(_, u)| u), dt, self.config.tracking.thrust_lag_s);
        // Nothing that the message's own check would reject may leave the pilot.
        let set_point = if set_point.check().is_ok() {
            set_point
        } else {
            self.no_set_point(now)
        };
        PilotOut::of(set_point)
    }
}
