//! Differential flatness of a multirotor: attitude and thrust from a thrust vector and heading (Mellinger and Kumar
//! 2011, section III), and lead compensation of the attitude loop's lag.

use alight_shared::{
    frames::{body_rates, yaw_rotation},
    geometry::GRAVITY,
    msg::DeckStage,
};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

/// Attitude with its up axis along `thrust` (NED, any length, m/s²) at heading `yaw` (rad).
///
/// With `R = Rz(yaw) Ry(pitch) Rx(roll)` the down axis in the heading frame is `[sin pitch cos roll, -sin roll, cos
/// pitch cos roll]`; this function inverts it. Level if `thrust` is too short to define a direction.
pub fn attitude_of_thrust(thrust: &Vector3<f64>, yaw: f64) -> UnitQuaternion<f64> {
    let norm = thrust.norm();
    if norm.is_nan() || norm < 1e-6 {
        return yaw_rotation(yaw);
    }
    let down = yaw_rotation(-yaw) * (-thrust / norm);
    let roll = (-down.y).clamp(-1.0, 1.0).asin();
    let pitch = down.x.atan2(down.z);
    UnitQuaternion::from_euler_angles(roll, pitch, yaw)
}

/// Horizontal acceleration (NED, m/s²) of a drone that is aligned with the normal `n` of `deck` and keeps its height
/// above it: `(g - a_z) n_xy / -n_z`.
pub fn aligned_acceleration(deck: &DeckStage, n: &Vector3<f64>) -> Vector2<f64> {
    let up = (-n.z).max(0.3);
    Vector2::new(n.x, n.y) * ((GRAVITY - deck.acceleration[2]) / up)
}

/// Specific thrust (NED, m/s²) along the up axis of `attitude` whose vertical component balances gravity and gives the
/// acceleration `vertical` (NED z, m/s²).
pub fn thrust_of_attitude(attitude: &UnitQuaternion<f64>, vertical: f64, gravity: f64) -> Vector3<f64> {
    let up = attitude * -Vector3::z();
    // Beyond 75 deg the vertical component is limited, which bounds the thrust.
    let lift = (-up.z).max(0.26);
    up * ((gravity - vertical).max(0.0) / lift)
}

/// Upward `thrust` with its horizontal component limited to a tilt of `tilt` (rad).
pub fn tilt_limited(thrust: &Vector3<f64>, tilt: f64, min_up: f64) -> Vector3<f64> {
    let up = (-thrust.z).max(min_up);
    let horizontal = thrust.x.hypot(thrust.y);
    let max = up * tilt.tan();
    let fraction = if horizontal > max { max / horizontal } else { 1.0 };
    Vector3::new(thrust.x * fraction, thrust.y * fraction, -up)
}

/// `attitude` with its tilt from the vertical limited to `tilt` (rad) in the same direction.
pub fn upright(attitude: &UnitQuaternion<f64>, tilt: f64) -> UnitQuaternion<f64> {
    let up = attitude * -Vector3::z();
    let sideways = up.xy().norm();
    if -up.z >= tilt.cos() || sideways < 1e-9 {
        return *attitude;
    }
    let limited = (up.xy() * (tilt.sin() / sideways)).push(-tilt.cos());
    UnitQuaternion::rotation_between(&up, &limited).map_or(*attitude, |turn| turn * attitude)
}

/// Euler angles to command now so that a loop with first-order lag `lag` (s) has reached `euler`: the inverse of `lag
/// x' = c - x`, i.e. `c = x + lag x'` (rad). For a second-order loop with the same total lag it is exact to first order
/// in frequency.
pub fn lead(euler: &[f64; 3], rates: &[f64; 3], lag: f64) -> [f64; 3] {
    core::array::from_fn(|i| euler[i] + lag * rates[i])
}

/// Body rates from Euler angles and their rates, rad/s.
pub fn rates_of(euler: &[f64; 3], rates: &[f64; 3]) -> Vector3<f64> {
    body_rates(euler[0], euler[1], Vector3::from(*rates))
}

/// Attitude `last`, rotated towards `wanted` by at most `max` (rad).
pub fn slewed(last: &UnitQuaternion<f64>, wanted: &UnitQuaternion<f64>, max: f64) -> UnitQuaternion<f64> {
    let turn = last.rotation_to(wanted);
    let angle = turn.angle();
    if angle <= max || angle < 1e-9 {
        return *wanted;
    }
    match turn.axis() {
        Some(axis) => UnitQuaternion::from_axis_angle(&axis, max) * last,
        None => *wanted,
    }
}
