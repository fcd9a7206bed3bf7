use alight_shared::{frames::yaw_rotation, geometry::GRAVITY};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::SimulatedFlight;
use crate::autopilots::simulated::{
    attitude::AttitudeSetPoint, estimator::Estimate, reference::PositionReference,
};

impl SimulatedFlight {
    /// PX4's `PositionControl`: position P, velocity PID with acceleration feed-forward, thrust vector,
    /// attitude. Drone's NED frame, SI units.
    pub(super) fn follow(&mut self, track: &PositionReference, e: &Estimate, dt: f64) -> AttitudeSetPoint {
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

        let [p, i, d] = c.velocity_pid;
        let [pz, iz, dz] = c.climb_pid;
        let error = velocity - e.velocity;
        let pid = |p: f64, d: f64, k: usize| p * error[k] - d * e.acceleration[k];
        let wanted =
            track.acceleration + Vector3::new(pid(p, d, 0), pid(p, d, 1), pid(pz, dz, 2)) + self.integral;

        // Thrust along the body's up axis: (g - a_z) vertically, a_xy horizontally.
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

        // Anti-windup.
        let vertical_limited =
            (thrust > collective && error.z > 0.0) || (thrust < collective && error.z < 0.0);
        if !limited {
            self.integral.x = (self.integral.x + i * error.x * dt).clamp(-5.0, 5.0);
            self.integral.y = (self.integral.y + i * error.y * dt).clamp(-5.0, 5.0);
        }
        if !vertical_limited {
            self.integral.z = (self.integral.z + iz * error.z * dt).clamp(-GRAVITY, GRAVITY);
        }
        AttitudeSetPoint {
            attitude: attitude_of(&down, track.yaw),
            yaw_rate: track.yaw_rate,
            rates: Vector3::zeros(),
            thrust,
        }
    }
}

/// Rotation NED from body that points the body's down axis along `down` with the heading `yaw` (PX4's
/// `bodyzToAttitude`).
fn attitude_of(down: &Vector3<f64>, yaw: f64) -> UnitQuaternion<f64> {
    let right = Vector3::new(-yaw.sin(), yaw.cos(), 0.0);
    let Some(forward) = right.cross(down).try_normalize(1e-6) else {
        return yaw_rotation(yaw);
    };
    let right = down.cross(&forward);
    let matrix = Matrix3::from_columns(&[forward, right, *down]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attitude_target_by_thrust_axis_and_heading() {
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
