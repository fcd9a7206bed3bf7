//! Set-points of each action: stop, stand, hold, follow, complete, press.

use alight_shared::{
    frames::{wxyz, yaw_rotation},
    msg::{Header, MissionState, Motors, Phase, Plan, PlanStage, SetPoint, SetPointKind, State},
    time::{DroneTime, Span},
};
use nalgebra::{UnitQuaternion, Vector3};

use super::{
    Pilot,
    config::Output,
    touchdown::{TouchdownContact, press_fraction},
};
use crate::{
    contingency::{Body, Completion, DeckBelow, Hold},
    flatness::{rates_of, upright},
    tracking::{AttitudeCommand, Authority},
};

/// Age above which a plan no longer determines the braking, s: five periods.
pub(super) const OLD_PLAN_S: f64 = 0.1;

impl Pilot {
    pub(super) fn set_point(&mut self, now: DroneTime) -> SetPoint {
        self.sequence = self.sequence.wrapping_add(1);
        let vessel = self.mission.get().map_or(0, |m| m.header.vessel);
        SetPoint {
            header: Header::new(vessel, self.drone_id, self.boot, self.sequence, now),
            response: self.response.get(),
            hard_contact_mps: self.detector.hard_mps(),
            plan_refusal: self.refusal,
            ..SetPoint::default()
        }
    }

    pub(super) fn no_set_point(&mut self, now: DroneTime) -> SetPoint {
        self.hold = None;
        self.tracker.reset();
        self.set_point(now)
    }

    pub(super) fn stop(&mut self, now: DroneTime) -> SetPoint {
        let attitude = self.drone.get().map_or([1.0, 0.0, 0.0, 0.0], |d| d.attitude);
        SetPoint {
            kind: SetPointKind::Attitude,
            motors: Motors::Stop,
            attitude,
            thrust: 0.0,
            ..self.set_point(now)
        }
    }

    /// Set-point for the autopilot's own loop. The acceleration is sampled one attitude lag ahead, because the attitude
    /// must have reached it by then.
    fn trajectory(&mut self, now: DroneTime, plan: &Plan, stage: &PlanStage) -> SetPoint {
        self.hold = None;
        self.tracker.reset();
        let ahead = plan
            .sample(self.turns_at(now) + Span::from_secs(self.response.slowest_s()))
            .map_or(stage.acceleration, |s| s.acceleration);
        SetPoint {
            kind: SetPointKind::Trajectory,
            position: stage.position,
            velocity: stage.velocity,
            acceleration: ahead,
            yaw: stage.euler[2],
            yaw_rate: stage.euler_rates[2],
            attitude: wxyz(&UnitQuaternion::from_euler_angles(
                stage.euler[0],
                stage.euler[1],
                stage.euler[2],
            )),
            rates: rates_of(&stage.euler, &stage.euler_rates).into(),
            thrust: self.estimate.hover().clamp(0.0, 1.0),
            ..self.set_point(now)
        }
    }

    pub(super) fn attitude(
        &mut self,
        now: DroneTime,
        stage: Option<&PlanStage>,
        a: AttitudeCommand,
        body: &Body,
    ) -> SetPoint {
        self.hold = None;
        let presses = stage.is_none();
        let stage = stage.copied().unwrap_or_default();
        let (_, _, yaw) = a.attitude.euler_angles();
        // Lag compensation enlarges the rotation, which must not exceed the tilt limit.
        let attitude = self
            .response
            .command(&a.attitude, &body.attitude, &self.config.lag);
        let attitude = upright(&attitude, self.config.tracking.tilt_limit_rad);
        let min_thrust = if presses {
            0.0
        } else {
            let turn = (attitude * Vector3::z()).angle(&(body.attitude * Vector3::z()));
            self.min_thrust(turn)
        };
        SetPoint {
            kind: SetPointKind::Attitude,
            position: stage.position,
            velocity: stage.velocity,
            acceleration: stage.acceleration,
            yaw,
            attitude: wxyz(&attitude),
            rates: a.rates.map(|v| v.clamp(-4.0, 4.0)).into(),
            thrust: a.thrust.max(min_thrust),
            ..self.set_point(now)
        }
    }

    /// Collective thrust at which no rotor stops while the drone rotates by `angle` (rad). The attitude loop commands
    /// the rate `angle / T`, which the rate loop reaches within `T_r` with the torque `tau = J angle / (T T_r)`. Four
    /// rotors with the arm length `l` in an X provide it with `tau / (4 l / sqrt 2)` each. Mixers use the reserve of
    /// the collective thrust before they raise it (PX4 without air mode), or raise it to hover at most (ArduCopter),
    /// which is also the limit here.
    fn min_thrust(&self, angle: f64) -> f64 {
        let g = &self.geometry;
        let c = &self.config.lag;
        let [roll, pitch, _] = g.inertia_kgm2;
        let torque = roll.max(pitch) * angle / (c.design_s * c.rate_loop_s);
        let rotor_n = torque / (4.0 * g.arm_m / core::f64::consts::SQRT_2);
        (4.0 * rotor_n / g.max_thrust_n).min(self.estimate.hover())
    }

    /// Keeps a drone on the ground, level and with less thrust than flight needs.
    pub(super) fn stand(&mut self, now: DroneTime, body: &Body) -> SetPoint {
        self.tracker.reset();
        let (_, _, yaw) = body.attitude.euler_angles();
        let level = yaw_rotation(yaw);
        SetPoint {
            kind: SetPointKind::Attitude,
            position: body.position.into(),
            yaw,
            attitude: wxyz(&level),
            thrust: self.config.tracking.min_thrust_of_hover * self.estimate.hover(),
            ..self.set_point(now)
        }
    }

    /// Holds the position. If the deck is `near`, the drone moves with it, climbs, and follows the escape direction.
    pub(super) fn hold(
        &mut self,
        now: DroneTime,
        body: &Body,
        dt: f64,
        near: Option<&DeckBelow>,
    ) -> SetPoint {
        let here = || Hold::at(body, near.is_some(), &self.geometry);
        let mut hold = self.hold.unwrap_or_else(here);
        let stage = hold.advance(dt, near, body, &self.geometry);
        let set_point = match self.config.output {
            Output::Trajectory => {
                self.tracker.reset();
                SetPoint {
                    kind: SetPointKind::Trajectory,
                    position: stage.position,
                    velocity: stage.velocity,
                    acceleration: stage.acceleration,
                    yaw: stage.euler[2],
                    ..self.set_point(now)
                }
            }
            Output::Attitude => {
                let authority = Authority {
                    brakes: near.is_some_and(|b| !b.levels_first(body)),
                    ..Authority::descent(&self.config.tracking)
                };
                let body = self.acted_on(now, body);
                self.tracked(now, &stage, &stage, &body, authority, dt)
            }
        };
        self.hold = Some(hold);
        set_point
    }

    /// Presses the feet onto the deck and aligns with it; the thrust ramps down while contact is suspected.
    pub(super) fn press(
        &mut self,
        now: DroneTime,
        body: &Body,
        dt: f64,
        below: Option<&DeckBelow>,
        yaw: f64,
    ) -> SetPoint {
        let TouchdownContact::Suspected { since, .. } = self.detector.contact() else {
            return self.no_set_point(now);
        };
        let fraction = press_fraction(since, now);
        let up = below.map(|b| b.stage.normal());
        let thrust = fraction * self.estimate.hover();
        let a = self
            .tracker
            .press(up, yaw, thrust, body, dt, &self.config.tracking);
        self.attitude(now, None, a, body)
    }

    /// Attitude and thrust for `led`, the plan's `stage` at the time when the command takes effect.
    fn tracked(
        &mut self,
        now: DroneTime,
        stage: &PlanStage,
        led: &PlanStage,
        body: &Body,
        authority: Authority,
        dt: f64,
    ) -> SetPoint {
        let c = &self.config.tracking;
        let lag = self.response.compensated_s(&self.config.lag);
        let a = self
            .tracker
            .track(led, body, &self.estimate, authority, lag, dt, c);
        self.attitude(now, Some(stage), a, body)
    }

    /// Follows the `stage` of a plan. In a landing the newest forecast determines the braking if the plan is old or the
    /// drone approaches the deck too fast.
    pub(super) fn follow(
        &mut self,
        now: DroneTime,
        (plan, stage): &(Plan, PlanStage),
        mission: &MissionState,
        body: &Body,
        dt: f64,
        below: Option<&DeckBelow>,
    ) -> SetPoint {
        if self.config.output == Output::Trajectory {
            return self.trajectory(now, plan, stage);
        }
        let c = &self.config.tracking;
        let ahead = self.below(self.thrusts_at(now), body);
        let mut authority = Authority {
            planned: plan.disturbance.into(),
            ..match ahead.as_ref().or(below) {
                Some(b) if mission.state == State::Flare => Authority::flare(b.clearance, c),
                Some(_) | None => Authority::descent(c),
            }
        };
        let mut led = *stage;
        let lands = mission.state.phase() == Phase::Landing && mission.lowest_clearance_m.is_none();
        let old = (now - plan.header.at).secs() > OLD_PLAN_S;
        if let Some(b) = ahead.filter(|_| lands) {
            let completion = self.completion(body, &b);
            if old && let Some(braked) = completion.renewed(&led) {
                led = braked;
                authority.brakes = true;
            }
            // A new pilot node keeps its predecessor's thrust until its own is in effect.
            let acts = self.estimate.in_force().is_some();
            if let Some(most) = completion.reflex(c.thrust_lag_s).filter(|_| acts) {
                authority.down_mps2 = most;
            }
        }
        self.tracked(now, stage, &led, body, authority, dt)
    }

    pub(super) fn complete(&mut self, now: DroneTime, body: &Body, dt: f64, below: &DeckBelow) -> SetPoint {
        let b = self.below(self.thrusts_at(now), body).unwrap_or(*below);
        let stage = self.completion(body, &b).stage();
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

    fn completion<'a>(&'a self, body: &'a Body, below: &'a DeckBelow) -> Completion<'a> {
        Completion {
            body,
            below,
            drone: &self.geometry,
            aligns_below_m: self.config.tracking.fade_clearance_m,
        }
    }
}
