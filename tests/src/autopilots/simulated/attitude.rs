//! Inner loops of the autopilot: attitude, rates, mixer.

use alight_shared::geometry::DroneGeometry;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::mixer::Mixer;
use crate::physics::drone::{AutopilotConfig, MAX_ROTORS, RotorFrame};

#[derive(Clone, Copy, Debug)]
pub(super) struct AttitudeSetPoint {
    /// Rotation NED from body.
    pub(super) attitude: UnitQuaternion<f64>,
    /// Rate about NED's down axis, rad/s.
    pub(super) yaw_rate: f64,
    /// Body rates, rad/s.
    pub(super) rates: Vector3<f64>,
    /// Collective thrust, as a fraction of the nominal maximum.
    pub(super) thrust: f64,
}

/// Body-rate set-point for an attitude error, rad/s; `wanted` and `is` are rotations NED from body. PX4's
/// `AttitudeControl`, after Brescianini, Hehn, D'Andrea 2013 ("Nonlinear quadrocopter attitude control",
/// section 4.2): tilt has priority, and the heading error is weighted.
///
/// For small errors this is `w = P e`, so the attitude follows a ramp with the lag `1/P`.
pub(super) fn rate_set_point(
    config: &AutopilotConfig,
    target: &AttitudeSetPoint,
    is: &UnitQuaternion<f64>,
) -> Vector3<f64> {
    let wanted = target.attitude;
    let axis = is * Vector3::z();
    let axis_wanted = wanted * Vector3::z();
    // Shortest rotation that aligns the thrust axis. It is not unique upside down, but then the heading does not
    // matter.
    let reduced = UnitQuaternion::rotation_between(&axis, &axis_wanted).map_or(wanted, |r| r * is);
    let mix = canonical(&(reduced.inverse() * wanted));
    let half = config.yaw_weight * mix.k.clamp(-1.0, 1.0).asin();
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(half.cos(), 0.0, 0.0, half.sin()));
    let error = canonical(&(is.inverse() * (reduced * turn)));
    let gain = 1.0 / config.attitude_lag_s();
    let yaw_gain = config.yaw_gain_hz / config.yaw_weight;
    let mut rates = 2.0 * Vector3::new(gain * error.i, gain * error.j, yaw_gain * error.k);
    rates += is.inverse_transform_vector(&Vector3::new(0.0, 0.0, target.yaw_rate));
    let tilt = config.max_rate_rps;
    let yaw = config.max_yaw_rate_rps;
    Vector3::new(
        rates.x.clamp(-tilt, tilt),
        rates.y.clamp(-tilt, tilt),
        rates.z.clamp(-yaw, yaw),
    )
}

fn canonical(q: &UnitQuaternion<f64>) -> Quaternion<f64> {
    if q.w < 0.0 {
        -q.into_inner()
    } else {
        q.into_inner()
    }
}

#[derive(Clone, Debug)]
pub(super) struct RateLoop {
    inertia: Vector3<f64>,
    side: f64,
    moment_per_force: f64,
    rotor_max: f64,
    pub(super) frame: RotorFrame,
    integral: Vector3<f64>,
    pub(super) mixer: Mixer,
    saturated: [bool; 3],
}

impl RateLoop {
    pub(super) fn new(drone: &DroneGeometry, frame: RotorFrame) -> Self {
        RateLoop {
            inertia: Vector3::from(drone.inertia_kgm2),
            side: drone.arm_m / 2.0_f64.sqrt(),
            moment_per_force: drone.moment_per_force_m,
            rotor_max: drone.max_thrust_n / frame.count() as f64,
            frame,
            integral: Vector3::zeros(),
            mixer: Mixer::Px4 { airmode: false },
            saturated: [false; 3],
        }
    }
    pub(super) fn reset(&mut self) {
        self.integral = Vector3::zeros();
    }

    /// Rotor commands (fractions of the nominal maximum thrust) that change the body rates from `is` to `wanted` at the
    /// collective `thrust`: `dw = K (w_c - w) + I`, moments by the nominal inertia, then [`Self::mix`].
    pub(super) fn step(
        &mut self,
        config: &AutopilotConfig,
        wanted: &Vector3<f64>,
        is: &Vector3<f64>,
        thrust: f64,
        dt: f64,
    ) -> [f64; MAX_ROTORS] {
        let error = wanted - is;
        let gain = Vector3::new(config.rate_gain_hz, config.rate_gain_hz, config.yaw_rate_gain_hz);
        for i in 0..3 {
            // Anti-windup.
            if !self.saturated[i] || error[i] * self.integral[i] < 0.0 {
                let next = self.integral[i] + config.rate_integral_hz2 * error[i] * dt;
                self.integral[i] = next.clamp(-10.0, 10.0);
            }
        }
        let moment = (gain.component_mul(&error) + self.integral).component_mul(&self.inertia);
        self.mix(thrust, &moment)
    }

    /// Rotor commands for a collective thrust and moments, by PX4's default mixer.
    fn mix(&mut self, thrust: f64, moment: &Vector3<f64>) -> [f64; MAX_ROTORS] {
        let scale = 1.0 / (self.frame.count() as f64 * self.rotor_max);
        let [roll, pitch, yaw] = self.frame.axes();
        let [by_roll, by_pitch] = [0, 1].map(|k| moment[k] / self.side * scale);
        let tilt = core::array::from_fn(|i| pitch[i] * by_pitch + roll[i] * by_roll);
        let turn = yaw.map(|s| s * moment.z / self.moment_per_force * scale);
        let mixed = self.mixer.mix(self.frame, thrust, &tilt, &turn);
        self.saturated = mixed.saturated;
        mixed.out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::frames::yaw_rotation;

    #[test]
    fn attitude_loop_rates_towards_the_target() {
        let config = AutopilotConfig {
            attitude_lag_s: Some(0.2),
            ..AutopilotConfig::default()
        };
        let target = AttitudeSetPoint {
            attitude: UnitQuaternion::from_euler_angles(0.02, -0.01, 1.0),
            yaw_rate: 0.0,
            rates: Vector3::zeros(),
            thrust: 0.3,
        };
        let is = yaw_rotation(1.0);
        let w = rate_set_point(&config, &target, &is);
        assert!((w - Vector3::new(0.1, -0.05, 0.0)).norm() < 1e-3, "{w}");
        let is = UnitQuaternion::from_euler_angles(0.02, -0.01, 0.9);
        let w = rate_set_point(&config, &target, &is);
        assert!((w.z - 0.28).abs() < 5e-3 && w.xy().norm() < 0.02, "{w}");
    }
}
