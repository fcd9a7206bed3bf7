//! ArduCopter's input shaping and attitude loop (`AC_AttitudeControl::input_quaternion`). The vehicle follows
//! a target that moves towards the set-point with limited acceleration and whose rates are fed forward.
//!
//! For each axis, with the error `e` from target to set-point, the time constant `tc` (ATC_INPUT_TC) and the
//! limit `a` (ATC_ACCEL_R_MAX), the desired rate is `w_d = e / tc`, or `sign(e) sqrt(2 a (|e| - a tc² / 2))`
//! beyond `|e| = a tc²`. The target's rate approaches `w_d` by at most `a dt` per step, and the vehicle's
//! rate is `w = w_target + P e_target` (ATC_ANG_RLL_P). The response to more than a few degrees is therefore
//! slower than `tc`; a linear model describes this as dead time.

use nalgebra::{UnitQuaternion, Vector3};

use super::attitude::AttitudeSetPoint;

/// Maximum acceleration of the target about roll, pitch (ATC_ACCEL_R_MAX, ATC_ACCEL_P_MAX 110 000 cdeg/s²) and yaw
/// (ATC_ACCEL_Y_MAX 27 000 cdeg/s²), rad/s².
const MAX_ACCELERATION: [f64; 3] = [19.2, 19.2, 4.71];
/// Gain from the target's error to body rates, 1/s (ATC_ANG_RLL_P, ATC_ANG_PIT_P, ATC_ANG_YAW_P).
const ANGLE_GAIN: f64 = 4.5;

#[derive(Clone, Copy, Debug)]
pub(super) struct InputShaping {
    /// Rotation NED from the target's body frame.
    pub(super) attitude: UnitQuaternion<f64>,
    /// Rates of the target in its body frame, rad/s.
    pub(super) rates: Vector3<f64>,
}

impl InputShaping {
    pub(super) fn at(attitude: UnitQuaternion<f64>) -> InputShaping {
        InputShaping {
            attitude,
            rates: Vector3::zeros(),
        }
    }

    /// Moves the target towards `to` over `dt` with the time constant `tc` (s) and at most `max_yaw_rate`
    /// (rad/s). Returns body rates for a vehicle at the attitude `is`, rad/s.
    pub(super) fn step(
        &mut self,
        to: &AttitudeSetPoint,
        is: &UnitQuaternion<f64>,
        tc: f64,
        max_yaw_rate: f64,
        dt: f64,
    ) -> Vector3<f64> {
        let error = (self.attitude.inverse() * to.attitude).scaled_axis();
        // ArduCopter 4.6 and 4.7 use the rates to lead the attitude, but rotate them once too often.
        let lead = to.attitude * to.rates + Vector3::z() * to.yaw_rate;
        for i in 0..3 {
            let limit = MAX_ACCELERATION[i];
            let mut wanted = lead[i] + towards(error[i], tc, limit);
            if i == 2 {
                wanted = wanted.clamp(-max_yaw_rate, max_yaw_rate);
            }
            self.rates[i] += (wanted - self.rates[i]).clamp(-limit * dt, limit * dt);
        }
        self.attitude *= UnitQuaternion::from_scaled_axis(self.rates * dt);
        let ahead = is.inverse() * self.attitude;
        ahead.scaled_axis() * ANGLE_GAIN + ahead * self.rates
    }
}

/// Rate that removes an error (rad), rad/s: proportional up to `a tc²`, limited by the braking distance
/// beyond it (ArduPilot's `sqrt_controller`).
fn towards(error: f64, tc: f64, limit: f64) -> f64 {
    let linear = limit * tc * tc;
    if error.abs() <= linear {
        error / tc
    } else {
        (2.0 * limit * (error.abs() - 0.5 * linear))
            .sqrt()
            .copysign(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 20 s of set-points, with the target and attitude that ArduCopter 4.7-dev logged at default parameters
    /// (real firmware in simulation), deg.
    const FLIGHT: &str = include_str!("../../../flights/arducopter-oscillating.csv");
    /// Lag of rate loop and motors in that log, s.
    const RATE_LAG_S: f64 = 0.08;

    /// Parses a line; empty columns become None.
    fn row(line: &str) -> Option<[Option<f64>; 7]> {
        let values: Vec<Option<f64>> = line.split(',').map(|v| v.parse().ok()).collect();
        values.try_into().ok()
    }

    /// Root mean square of the logged target and attitude, and of the replay's errors, deg.
    fn replayed() -> [[f64; 2]; 2] {
        let dt = 0.0025;
        let mut set: Option<[f64; 2]> = None;
        let mut shaping = InputShaping::at(UnitQuaternion::identity());
        let mut is = UnitQuaternion::identity();
        let mut rates = Vector3::zeros();
        let mut t = 25.3;
        let mut sums = [[0.0; 2]; 2];
        let mut counts = [0.0; 2];
        for line in FLIGHT.lines().skip(1) {
            let [
                Some(at),
                roll,
                pitch,
                shaped_roll,
                shaped_pitch,
                own_roll,
                own_pitch,
            ] = row(line).unwrap()
            else {
                panic!("{line}");
            };
            while t < at {
                t += dt;
                let [roll, pitch] = set.unwrap_or_default().map(f64::to_radians);
                let to = AttitudeSetPoint {
                    attitude: UnitQuaternion::from_euler_angles(roll, pitch, 0.0),
                    yaw_rate: 0.0,
                    rates: Vector3::zeros(),
                    thrust: 0.5,
                };
                let wanted = shaping.step(&to, &is, 0.15, 1.0, dt);
                rates += (wanted - rates) * (1.0 - f64::exp(-dt / RATE_LAG_S));
                is *= UnitQuaternion::from_scaled_axis(rates * dt);
            }
            if let (Some(roll), Some(pitch)) = (roll, pitch) {
                set = Some([roll, pitch]);
            }
            let pairs = [
                (shaped_roll.zip(shaped_pitch), shaping.attitude),
                (own_roll.zip(own_pitch), is),
            ];
            for (i, (logged, own)) in pairs.into_iter().enumerate() {
                let Some((roll, pitch)) = logged.filter(|_| (26.4..44.8).contains(&t)) else {
                    continue;
                };
                let (r, p, _) = own.euler_angles();
                let error = [r.to_degrees() - roll, p.to_degrees() - pitch];
                sums[i][0] += roll * roll + pitch * pitch;
                sums[i][1] += error[0] * error[0] + error[1] * error[1];
                counts[i] += 2.0;
            }
        }
        [0, 1].map(|i| sums[i].map(|s| f64::sqrt(s / counts[i])))
    }

    #[test]
    fn shaping_of_a_real_flight() {
        let [target, attitude] = replayed();
        println!("target, attitude: rms and error {target:?} {attitude:?} deg");
        assert!(target[0] > 10.0 && target[1] < 2.5, "{target:?}");
        assert!(attitude[0] > 12.0 && attitude[1] < 5.5, "{attitude:?}");
    }
}
