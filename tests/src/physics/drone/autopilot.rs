//! The autopilot: modes, failsafe, position control. It flies by its own estimate and knows the
//! nominal airframe only.

use alight_shared::geometry::{DroneGeometry, GRAVITY};
use alight_shared::msg::{AutopilotMode, LandedState, Message, Motors, SetPoint, SetPointKind};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use rand::RngExt;

use super::airframe::ROTORS;
use super::attitude::{AttitudeTarget, RateLoop, rate_set_point};
use super::config::{AutopilotConfig, LossAction};
use super::estimator::Estimate;
use crate::physics::streams::Streams;

/// What position control follows.
#[derive(Clone, Copy, Debug)]
struct Track {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
    yaw: f64,
    yaw_rate: f64,
}

/// Which of PX4's controllers run: the Commander publishes it (`vehicle_control_mode`) at 2 Hz only, and at once when the
/// status changes (arming, mode), so another kind of set-point is known to them up to 0.5 s late. Measured with PX4 main
/// of March 2026.
#[derive(Clone, Copy, Debug)]
struct ControlMode {
    /// The kind of set-point that it was published for.
    kind: SetPointKind,
    /// Next publication, s.
    due_s: f64,
}

/// Time between two publications of the control mode, s.
const CONTROL_MODE_S: f64 = 0.5;

impl ControlMode {
    /// The kind of set-point that the controllers know of at `now_s`, while `newest` are sent.
    fn at(&mut self, now_s: f64, newest: SetPointKind) -> SetPointKind {
        // The first set-points are those with which the mode was entered.
        if now_s >= self.due_s || self.kind == SetPointKind::None {
            self.kind = newest;
            let missed = ((now_s - self.due_s) / CONTROL_MODE_S).floor() + 1.0;
            self.due_s += CONTROL_MODE_S * missed.max(0.0);
        }
        self.kind
    }
    fn publish(&mut self, newest: SetPointKind) {
        self.kind = newest;
    }
}

/// The autopilot's state.
#[derive(Clone, Debug)]
pub(crate) struct Autopilot {
    config: AutopilotConfig,
    rate_loop: RateLoop,
    /// Mode that the operator chose.
    intended: AutopilotMode,
    /// Mode in force: the intended one or the failsafe's.
    mode: AutopilotMode,
    armed: bool,
    landed: LandedState,
    set_point: Option<SetPoint>,
    control_mode: ControlMode,
    /// The newest set-point of position.
    track: Option<Track>,
    /// When the newest set-point arrived, s.
    received_s: Option<f64>,
    /// Where to hold in modes of its own and without a usable set-point.
    hold: Track,
    home: Vector3<f64>,
    integral: Vector3<f64>,
    rejected: u64,
    hover_thrust: f64,
    /// Collective set-point now.
    thrust: f64,
    still_s: f64,
    battery: f64,
    target: AttitudeTarget,
    tick: u32,
}

impl Autopilot {
    /// An autopilot that holds position in the air, in offboard mode and armed, with a hover
    /// thrust estimate that has settled at `hover_thrust`.
    pub(crate) fn new(
        config: &AutopilotConfig,
        drone: &DroneGeometry,
        estimate: &Estimate,
        hover_thrust: f64,
        streams: &Streams,
    ) -> Self {
        let yaw = estimate.attitude.euler_angles().2;
        let hold = Track {
            position: estimate.position,
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            yaw,
            yaw_rate: 0.0,
        };
        Autopilot {
            config: config.clone(),
            rate_loop: RateLoop::new(drone),
            intended: AutopilotMode::Offboard,
            mode: AutopilotMode::Offboard,
            armed: true,
            landed: LandedState::InAir,
            set_point: None,
            control_mode: ControlMode {
                kind: SetPointKind::None,
                due_s: CONTROL_MODE_S * streams.stream("drone.control_mode").random::<f64>(),
            },
            track: None,
            received_s: None,
            hold,
            home: estimate.position,
            integral: Vector3::zeros(),
            rejected: 0,
            hover_thrust,
            thrust: hover_thrust,
            still_s: 0.0,
            battery: config.battery,
            target: AttitudeTarget {
                attitude: UnitQuaternion::from_euler_angles(0.0, 0.0, yaw),
                yaw_rate: 0.0,
                rates: Vector3::zeros(),
                thrust: hover_thrust,
            },
            tick: 0,
        }
    }

    pub(crate) fn mode(&self) -> AutopilotMode {
        self.mode
    }
    pub(crate) fn armed(&self) -> bool {
        self.armed
    }
    pub(crate) fn landed(&self) -> LandedState {
        self.landed
    }
    pub(crate) fn battery(&self) -> f64 {
        self.battery
    }
    pub(crate) fn thrust(&self) -> f64 {
        self.thrust
    }
    pub(crate) fn hover_thrust(&self) -> f64 {
        self.hover_thrust
    }
    pub(crate) fn rejected(&self) -> u64 {
        self.rejected
    }

    /// The operator chooses a mode.
    pub(crate) fn command(&mut self, mode: AutopilotMode, estimate: &Estimate) {
        self.intended = mode;
        self.enter(mode, estimate);
    }

    /// A set-point arrives at `now_s`. `Motors::Stop` disarms at once in offboard mode, as PX4
    /// obeys a forced disarm.
    pub(crate) fn apply(&mut self, set_point: &SetPoint, now_s: f64) {
        if set_point.check().is_err() {
            self.rejected += 1;
            return;
        }
        self.received_s = Some(now_s);
        self.set_point = Some(*set_point);
        if set_point.motors == Motors::Stop && self.intended == AutopilotMode::Offboard {
            self.disarm();
        }
    }

    fn disarm(&mut self) {
        self.armed = false;
        self.thrust = 0.0;
        self.landed = LandedState::OnGround;
        self.rate_loop.reset();
        self.integral = Vector3::zeros();
    }

    fn enter(&mut self, mode: AutopilotMode, estimate: &Estimate) {
        if mode == self.mode {
            return;
        }
        self.mode = mode;
        // The control mode is published with it.
        let newest = self.set_point.map_or(SetPointKind::None, |s| s.kind);
        self.control_mode.publish(newest);
        self.hold_here(estimate);
    }
    fn hold_here(&mut self, estimate: &Estimate) {
        // Where it comes to rest: v² / (2 a).
        let v = estimate.velocity;
        let [across, along] = self.config.stop_mps2;
        let (sideways, down) = (
            v.xy() * (v.xy().norm() / (2.0 * across)),
            v.z * v.z.abs() / (2.0 * along),
        );
        self.hold = Track {
            position: estimate.position + Vector3::new(sideways.x, sideways.y, down),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            yaw: estimate.attitude.euler_angles().2,
            yaw_rate: 0.0,
        };
    }

    /// The outer loops, once per tick of `dt`.
    pub(crate) fn outer(&mut self, estimate: &Estimate, now_s: f64, dt: f64) {
        self.tick = self.tick.wrapping_add(1);
        self.battery = (self.battery - dt / self.config.endurance_s).max(0.0);
        if !self.armed {
            return;
        }
        self.failsafe(estimate, now_s);
        self.estimate_hover(estimate, dt);
        let offboard = match self.mode {
            AutopilotMode::Offboard => self.set_point.filter(|s| s.kind != SetPointKind::None),
            AutopilotMode::Other | AutopilotMode::Hold | AutopilotMode::Land | AutopilotMode::Return => None,
        };
        self.target = match offboard {
            Some(s) => self.offboard(&s, estimate, now_s, dt),
            None => {
                self.move_hold(estimate, dt);
                let track = self.hold;
                self.follow(&track, estimate, dt)
            }
        };
        self.thrust = self.target.thrust;
        self.detect_landing(estimate, dt);
    }

    /// What the set-points ask for, and what the control mode makes of it: where position control has not been told to end,
    /// it and the set-points write attitudes by turns; where it has not been told to begin, the last attitude stays.
    fn offboard(&mut self, s: &SetPoint, estimate: &Estimate, now_s: f64, dt: f64) -> AttitudeTarget {
        self.hold_here(estimate);
        let known = self.control_mode.at(now_s, s.kind);
        if s.kind == SetPointKind::Trajectory {
            self.track = Some(Track {
                position: Vector3::from(s.position),
                velocity: Vector3::from(s.velocity),
                acceleration: Vector3::from(s.acceleration),
                yaw: s.yaw,
                yaw_rate: s.yaw_rate,
            });
        }
        let positions = known == SetPointKind::Trajectory && (s.kind == known || self.tick.is_multiple_of(2));
        if let Some(track) = self.track.filter(|_| positions) {
            return self.follow(&track, estimate, dt);
        }
        if s.kind == SetPointKind::Trajectory {
            return self.target;
        }
        if known != SetPointKind::Trajectory {
            self.integral = Vector3::zeros();
        }
        AttitudeTarget {
            attitude: s.attitude(),
            yaw_rate: 0.0,
            rates: Vector3::from(s.rates),
            thrust: s.thrust,
        }
    }

    /// PX4's offboard loss: after COM_OF_LOSS_T the failsafe's mode, back to offboard as soon as
    /// set-points come again. Before the first set-point nothing can be lost.
    fn failsafe(&mut self, estimate: &Estimate, now_s: f64) {
        if self.intended != AutopilotMode::Offboard {
            return;
        }
        let lost = self
            .received_s
            .is_some_and(|h| now_s - h > self.config.loss_after_s);
        let mode = if !lost {
            AutopilotMode::Offboard
        } else {
            match self.config.loss_action {
                LossAction::Hold => AutopilotMode::Hold,
                LossAction::Land => AutopilotMode::Land,
                LossAction::Return => AutopilotMode::Return,
            }
        };
        self.enter(mode, estimate);
    }

    /// Moves the hold point in the modes that go somewhere.
    fn move_hold(&mut self, estimate: &Estimate, dt: f64) {
        self.hold.velocity = Vector3::zeros();
        match self.mode {
            AutopilotMode::Offboard | AutopilotMode::Other | AutopilotMode::Hold => {}
            AutopilotMode::Land => self.sink(estimate, dt),
            AutopilotMode::Return => {
                let away = self.home.xy() - estimate.position.xy();
                let up = -self.config.return_height_m;
                if away.norm() < 1.0 {
                    self.sink(estimate, dt);
                } else if estimate.position.z > up + 1.0 {
                    self.hold.position.z = self.hold.position.z.max(up) - 2.0 * dt;
                    self.hold.velocity.z = -2.0;
                } else {
                    let speed = away.normalize() * away.norm().min(5.0);
                    self.hold.velocity = Vector3::new(speed.x, speed.y, 0.0);
                    self.hold.position += self.hold.velocity * dt;
                }
            }
        }
    }
    fn sink(&mut self, estimate: &Estimate, dt: f64) {
        self.hold.velocity.z = self.config.land_mps;
        // The set-point leads by a metre at most, so that ground contact unloads the rotors.
        self.hold.position.z =
            (self.hold.position.z + self.config.land_mps * dt).min(estimate.position.z + 1.0);
    }

    /// PX4's `PositionControl`: position P, velocity PID with acceleration feed-forward, thrust
    /// vector, attitude. Drone's NED, SI.
    fn follow(&mut self, track: &Track, e: &Estimate, dt: f64) -> AttitudeTarget {
        let c = &self.config;
        let gains = Vector3::new(c.position_gain_hz, c.position_gain_hz, c.height_gain_hz);
        let mut velocity = track.velocity + gains.component_mul(&(track.position - e.position));
        let speed = velocity.xy().norm();
        if speed > c.max_speed_mps {
            let k = c.max_speed_mps / speed;
            velocity.x *= k;
            velocity.y *= k;
        }
        velocity.z = velocity.z.clamp(-c.max_climb_mps[0], c.max_climb_mps[1]);

        let ([p, i, d], [pz, iz, dz]) = (c.velocity_pid, c.climb_pid);
        let error = velocity - e.velocity;
        let pid = |p: f64, d: f64, k: usize| p * error[k] - d * e.acceleration[k];
        let wanted =
            track.acceleration + Vector3::new(pid(p, d, 0), pid(p, d, 1), pid(pz, dz, 2)) + self.integral;

        // Thrust along the body's down axis turned up: (g - a_z) against gravity, a_xy sideways.
        let lift = (GRAVITY - wanted.z).max(0.05 * GRAVITY);
        let vertical = if c.decouple_vertical { GRAVITY } else { lift };
        let max_sideways = vertical * c.max_tilt_deg.to_radians().tan();
        let mut sideways = Vector3::new(wanted.x, wanted.y, 0.0);
        let limited = sideways.norm() > max_sideways;
        if limited {
            sideways *= max_sideways / sideways.norm();
        }
        let down = Vector3::new(-sideways.x, -sideways.y, vertical).normalize();
        let collective = self.hover_thrust * lift / GRAVITY / down.z;
        let thrust = collective.clamp(c.min_thrust, 1.0);

        // Integrators stop where the output is limited in their direction.
        let vertical_limited =
            (thrust > collective && error.z > 0.0) || (thrust < collective && error.z < 0.0);
        if !limited {
            self.integral.x = (self.integral.x + i * error.x * dt).clamp(-5.0, 5.0);
            self.integral.y = (self.integral.y + i * error.y * dt).clamp(-5.0, 5.0);
        }
        if !vertical_limited {
            self.integral.z = (self.integral.z + iz * error.z * dt).clamp(-GRAVITY, GRAVITY);
        }
        AttitudeTarget {
            attitude: attitude_of(&down, track.yaw),
            yaw_rate: track.yaw_rate,
            rates: Vector3::zeros(),
            thrust,
        }
    }

    /// Hover thrust from the lift that the present thrust gives: `T_h = T g / f_lift`, smoothed
    /// (PX4's hover thrust estimator reduced to its fixed gain), in the air and without shocks.
    fn estimate_hover(&mut self, e: &Estimate, dt: f64) {
        let lift = -e.specific_force.z;
        if self.landed == LandedState::OnGround
            || !(0.5 * GRAVITY..1.5 * GRAVITY).contains(&lift)
            || self.thrust < 0.5 * self.hover_thrust
        {
            return;
        }
        let sample = self.thrust * GRAVITY / lift;
        let k = dt / self.config.hover_thrust_s;
        self.hover_thrust = (self.hover_thrust + k * (sample - self.hover_thrust)).clamp(0.1, 0.9);
    }

    /// PX4's land detector reduced: little thrust, little speed, for a second. In its own landing
    /// it then disarms.
    fn detect_landing(&mut self, e: &Estimate, dt: f64) {
        let quiet = self.thrust < 0.6 * self.hover_thrust
            && e.velocity.z.abs() < 0.25
            && e.velocity.xy().norm() < 0.5
            && e.rates.norm() < 0.35;
        self.still_s = if quiet { self.still_s + dt } else { 0.0 };
        self.landed = if self.still_s >= 1.0 {
            LandedState::OnGround
        } else {
            LandedState::InAir
        };
        let by_itself = matches!(self.mode, AutopilotMode::Land | AutopilotMode::Return);
        if by_itself && self.still_s >= 2.0 {
            self.disarm();
        }
    }

    /// The inner loops, once per sub-step; None with the motors stopped.
    pub(crate) fn inner(
        &mut self,
        attitude: &UnitQuaternion<f64>,
        rates: &Vector3<f64>,
        dt: f64,
    ) -> Option<[f64; ROTORS]> {
        if !self.armed {
            return None;
        }
        let wanted = rate_set_point(&self.config, &self.target, attitude);
        let thrust = self.target.thrust;
        Some(self.rate_loop.step(&self.config, &wanted, rates, thrust, dt))
    }
}

/// NED from body with the body's down axis along `down` and the heading `yaw` (PX4's
/// `bodyzToAttitude`).
fn attitude_of(down: &Vector3<f64>, yaw: f64) -> UnitQuaternion<f64> {
    let right = Vector3::new(-yaw.sin(), yaw.cos(), 0.0);
    let Some(forward) = right.cross(down).try_normalize(1e-6) else {
        return UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
    };
    let right = down.cross(&forward);
    let matrix = Matrix3::from_columns(&[forward, right, *down]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attitude_target_has_the_thrust_axis_and_the_heading() {
        for (x, y, yaw) in [(0.2, -0.3, 1.0), (-0.5, 0.1, -2.5), (0.0, 0.0, 3.0)] {
            let down = Vector3::new(x, y, 1.0).normalize();
            let q = attitude_of(&down, yaw);
            assert!((q * Vector3::z() - down).norm() < 1e-12);
            let forward = q * Vector3::x();
            assert!((forward.y.atan2(forward.x) - yaw).abs() < 0.2, "{forward}");
        }
        let level = attitude_of(&Vector3::z(), 0.7);
        assert!((level.euler_angles().2 - 0.7).abs() < 1e-12);
    }
}
