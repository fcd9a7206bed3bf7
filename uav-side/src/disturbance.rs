//! What pushes the drone sideways besides its rotors: wind, and what its attitude and accelerometers
//! are wrong by, all as the odometry sees them.

use nalgebra::{UnitQuaternion, Vector2, Vector3};

/// A horizontal acceleration learnt from odometry.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DisturbanceObserver {
    value: Vector2<f64>,
    /// Horizontal velocity that attitude, thrust and disturbance explain, m/s; None at rest.
    velocity: Option<Vector2<f64>>,
}

/// Velocity that is further from the explained one than this is a jump of the odometry, not a
/// force, m/s.
const JUMP_MPS: f64 = 2.0;

impl DisturbanceObserver {
    /// The acceleration that is not the rotors', NED, m/s².
    pub fn value(&self) -> Vector2<f64> {
        self.value
    }

    /// Learns from `force` (specific, body, m/s²), `attitude` (NED from body) and `velocity` (NED,
    /// m/s) of free flight, `dt` after the last. A Luenberger observer,
    /// `v' = (R [0, 0, f_z])_xy + d + 2 w (v_m - v)`, `d' = w² (v_m - v)`, with both poles at
    /// `w = 1 / time_s`; no axis beyond `max` (m/s²). Drag felt by the accelerometers would be
    /// quicker, but their bias of 0.05 m/s² and the tilt's of 0.3 deg would each cost 3 cm.
    pub fn learn(
        &mut self,
        force: &Vector3<f64>,
        attitude: &UnitQuaternion<f64>,
        velocity: &Vector3<f64>,
        dt: f64,
        time_s: f64,
        max: f64,
    ) {
        let measured = velocity.xy();
        let thrust = attitude * Vector3::new(0.0, 0.0, force.z);
        let w = 1.0 / time_s;
        let v = self.velocity.unwrap_or(measured);
        let wrong = measured - v;
        if !(wrong.norm() < JUMP_MPS) || !thrust.norm().is_finite() {
            self.velocity = None;
            return;
        }
        self.velocity = Some(v + (thrust.xy() + self.value + wrong * (2.0 * w)) * dt);
        self.value = (self.value + wrong * (w * w * dt)).map(|d| d.clamp(-max, max));
    }

    /// In contact or without odometry the observer starts anew; what it found stays.
    pub fn pause(&mut self) {
        self.velocity = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::geometry::GRAVITY;

    #[test]
    fn disturbance_observer_learns_wind_and_level_error_from_velocity() {
        // Wind of 0.6 m/s² north while the attitude reads 0.01 rad too much roll: held by the true lean.
        let mut x = DisturbanceObserver::default();
        let (mut v, dt) = (Vector3::zeros(), 0.01);
        let seen = UnitQuaternion::from_euler_angles(0.01, 0.0, 0.0);
        let force = Vector3::new(0.0, 0.0, -GRAVITY);
        for _ in 0..400 {
            v += Vector3::new(0.6, 0.0, 0.0) * dt;
            x.learn(&force, &seen, &v, dt, 0.5, 3.0);
        }
        let d = x.value();
        assert!(
            (d.x - 0.6).abs() < 0.03 && (d.y + 0.01 * GRAVITY).abs() < 0.01,
            "{d}"
        );
        // A jump of the odometry is not a force, and what is not a number is not learnt.
        x.learn(&force, &seen, &Vector3::new(50.0, 0.0, 0.0), dt, 0.5, 3.0);
        x.learn(&force, &seen, &Vector3::new(f64::NAN, 0.0, 0.0), dt, 0.5, 3.0);
        x.learn(&force, &seen, &v, dt, 0.5, 3.0);
        assert!((x.value() - d).norm() < 0.05);
    }

    #[test]
    fn disturbance_observer_output_is_bounded() {
        let mut x = DisturbanceObserver::default();
        let tilt = UnitQuaternion::from_euler_angles(0.0, 0.7, 0.0);
        let force = Vector3::new(0.0, 0.0, -12.0);
        for _ in 0..1000 {
            x.learn(&force, &tilt, &Vector3::zeros(), 0.01, 0.5, 3.0);
        }
        assert!((x.value().x - 3.0).abs() < 1e-9, "{}", x.value());
    }
}
