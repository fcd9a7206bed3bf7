//! Tracking loop from plan and odometry to attitude and thrust.
//!
//! `a = a_plan + sat(Kp e_p + Kv e_v + I) - (d - d_plan) + Ka e_a`, converted to a thrust vector, and by flatness to an
//! attitude. The plan's attitude is fed forward with compensation of the autopilot's lag. The feedback is not
//! compensated, and its authority over the tilt fades towards the deck, because at contact the plan's attitude matters
//! more than a few centimetres of position.

mod config;
mod estimate;

use alight_shared::{
    frames::wxyz,
    geometry::GRAVITY,
    msg::{DroneState, PlanStage, SetPoint, SetPointKind},
};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use crate::{
    contingency::Body,
    flatness::{attitude_of_thrust, lead, rates_of, slewed, thrust_of_attitude, tilt_limited},
};
pub use config::TrackingConfig;
pub(crate) use estimate::FlightEstimator;

/// Attitude time constant for which the default gains are designed, s.
pub(crate) const DESIGN_LAG_S: f64 = 0.2;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AttitudeCommand {
    pub(crate) attitude: UnitQuaternion<f64>,
    /// Body rates for feed-forward, rad/s.
    pub(crate) rates: Vector3<f64>,
    /// Collective thrust, 0 to 1.
    pub(crate) thrust: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Authority {
    /// Tilt that the feedback may add, rad.
    pub(crate) tilt: f64,
    /// Fraction of the disturbance that is compensated, 0 to 1.
    pub(crate) disturbance: f64,
    /// Disturbance that the plan's attitude already compensates, NED, m/s².
    pub(crate) planned: Vector2<f64>,
    pub(crate) integrate: bool,
    /// Whether the vertical force has priority over the horizontal one.
    pub(crate) brakes: bool,
    /// Limit of the downward acceleration, NED z, m/s²; an active limit also gives the vertical force priority.
    pub(crate) down_mps2: f64,
}

impl Authority {
    pub(crate) fn descent(c: &TrackingConfig) -> Self {
        Authority {
            tilt: c.descent_feedback_tilt_rad,
            disturbance: 1.0,
            planned: Vector2::zeros(),
            integrate: true,
            brakes: false,
            down_mps2: f64::INFINITY,
        }
    }
    /// Authority in the flare, which fades linearly below `fade_clearance_m`.
    pub(crate) fn flare(clearance: f64, c: &TrackingConfig) -> Self {
        let s = (clearance / c.fade_clearance_m).clamp(0.0, 1.0);
        let mix = |low: f64, high: f64| low + s * (high - low);
        Authority {
            tilt: mix(c.contact_feedback_tilt_rad, c.flare_feedback_tilt_rad),
            disturbance: mix(c.contact_disturbance_fraction, 1.0),
            planned: Vector2::zeros(),
            integrate: clearance > c.fade_clearance_m,
            brakes: false,
            down_mps2: f64::INFINITY,
        }
    }
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Tracker {
    integral: Vector3<f64>,
    last: Option<UnitQuaternion<f64>>,
}

impl Tracker {
    pub(crate) fn reset(&mut self) {
        *self = Tracker::default();
    }

    /// Attitude that was commanded last; None after a reset.
    pub(crate) const fn commanded(&self) -> Option<UnitQuaternion<f64>> {
        self.last
    }

    /// Command that follows `stage` over the next `dt` (s), for an attitude loop with lag `lag` (s).
    pub(crate) fn track(
        &mut self,
        stage: &PlanStage,
        body: &Body,
        estimate: &FlightEstimator,
        authority: Authority,
        lag: f64,
        dt: f64,
        c: &TrackingConfig,
    ) -> AttitudeCommand {
        let e_p = cut(
            Vector3::from(stage.position) - body.position,
            c.position_error_limit_m,
        );
        let e_v = Vector3::from(stage.velocity) - body.velocity;
        if authority.integrate && e_p.norm() <= c.integral_within_m {
            let max = c.integral_limit_mps2;
            self.integral = (self.integral + e_p * (c.ki * dt)).map(|v| v.clamp(-max, max));
        }
        let vertical = (c.vertical_kp * e_p.z + c.vertical_kv * e_v.z + self.integral.z)
            .clamp(-c.vertical_limit_mps2, c.vertical_limit_mps2);
        let horizontal = cut2(
            e_p.xy() * c.horizontal_kp + e_v.xy() * c.horizontal_kv + self.integral.xy(),
            GRAVITY * authority.tilt.tan(),
        );

        let euler = lead(&stage.euler, &stage.euler_rates, lag + c.rate_lag_s);
        let planned = UnitQuaternion::from_euler_angles(euler[0], euler[1], euler[2]);
        let planned_down = stage.acceleration[2] + vertical;
        let down = planned_down.min(authority.down_mps2);
        let mut thrust = thrust_of_attitude(&planned, down, GRAVITY);
        let unplanned = (estimate.disturbance() - authority.planned) * authority.disturbance;
        let push = horizontal - unplanned;
        // The feedback includes the attitude in addition to position and velocity, which permits higher gains on these.
        let [roll, pitch, yaw] = stage.euler;
        let meant = thrust_of_attitude(
            &UnitQuaternion::from_euler_angles(roll, pitch, yaw),
            down,
            GRAVITY,
        );
        let is = thrust_of_attitude(&body.attitude, down, GRAVITY);
        let tilt_error = meant.xy() - is.xy() - unplanned + self.integral.xy();
        let push = push
            + cut2(
                tilt_error * c.attitude_gain,
                GRAVITY * c.descent_feedback_tilt_rad.tan(),
            );
        thrust.x += push.x;
        thrust.y += push.y;
        let thrust = tilt_limited(&thrust, c.tilt_limit_rad, c.min_thrust_of_hover * GRAVITY);
        let attitude = self.turn(attitude_of_thrust(&thrust, euler[2]), &body.attitude, dt, c);
        // Only the component along the drone's current up axis has an effect (Lee et al. 2010), minus the aerodynamic
        // lift.
        let up = body.attitude * -Vector3::z();
        let upright = (-up.z).max(0.5);
        let mut along = thrust.dot(&up);
        if authority.brakes || down < planned_down {
            along = along.max(-thrust.z / upright);
        }
        let along = along - estimate.lift() / upright;
        AttitudeCommand {
            attitude,
            rates: rates_of(&stage.euler, &stage.euler_rates),
            thrust: fraction(along, estimate, c),
        }
    }

    /// Command on a deck: the deck's attitude and a fixed collective thrust, 0 to 1.
    pub(crate) fn press(
        &mut self,
        up: Option<Vector3<f64>>,
        yaw: f64,
        thrust: f64,
        body: &Body,
        dt: f64,
        c: &TrackingConfig,
    ) -> AttitudeCommand {
        let wanted = match up {
            Some(up) => attitude_of_thrust(&tilt_limited(&up, c.tilt_limit_rad, 0.1), yaw),
            None => self.last.unwrap_or(body.attitude),
        };
        AttitudeCommand {
            attitude: self.turn(wanted, &body.attitude, dt, c),
            rates: Vector3::zeros(),
            thrust: thrust.clamp(0.0, 1.0),
        }
    }

    fn turn(
        &mut self,
        wanted: UnitQuaternion<f64>,
        now: &UnitQuaternion<f64>,
        dt: f64,
        c: &TrackingConfig,
    ) -> UnitQuaternion<f64> {
        let q = slewed(
            &self.last.unwrap_or(*now),
            &wanted,
            c.attitude_rate_limit_rps * dt,
        );
        self.last = Some(q);
        q
    }
}

/// Attitude and thrust that bring a drone to `stage`, from its newest odometry alone, for callers without a pilot.
/// `hover` is the collective thrust in hover, 0 to 1; the caller sets the header.
///
/// The age of the odometry and the autopilot's response are unknown here, so the gains leave a margin for any of them:
/// the loop crosses over at 3.7 rad/s vertically, where 0.15 s from motion to thrust leave 41 deg, and at 1.7 rad/s
/// horizontally, where 0.4 s of dead time and lag leave 37 deg.
pub(crate) fn steer(stage: &PlanStage, drone: &DroneState, hover: f64) -> SetPoint {
    /// Time over which the rate limit bounds the rotation to the command, s.
    const TURN_S: f64 = 0.2;
    let c = TrackingConfig {
        horizontal_kp: 0.7,
        horizontal_kv: 1.6,
        attitude_gain: 0.0,
        vertical_kp: 4.0,
        vertical_kv: 3.5,
        ..TrackingConfig::default()
    };
    let body = Body::of(drone, 0.0);
    let estimate = FlightEstimator::new(hover);
    let a = Tracker::default().track(
        stage,
        &body,
        &estimate,
        Authority::descent(&c),
        DESIGN_LAG_S,
        TURN_S,
        &c,
    );
    SetPoint {
        kind: SetPointKind::Attitude,
        position: stage.position,
        velocity: stage.velocity,
        yaw: stage.euler[2],
        attitude: wxyz(&a.attitude),
        thrust: a.thrust,
        ..SetPoint::default()
    }
}

fn fraction(specific: f64, estimate: &FlightEstimator, c: &TrackingConfig) -> f64 {
    let u = specific * estimate.hover() / GRAVITY;
    u.clamp(c.min_thrust_of_hover * estimate.hover(), 1.0)
}

fn cut(v: Vector3<f64>, max: f64) -> Vector3<f64> {
    let n = v.norm();
    if n > max { v * (max / n) } else { v }
}
fn cut2(v: Vector2<f64>, max: f64) -> Vector2<f64> {
    let n = v.norm();
    if n > max { v * (max / n) } else { v }
}
