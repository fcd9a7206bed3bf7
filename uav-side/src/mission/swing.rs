//! Oscillation of the commanded attitude: an unstable loop of pilot and autopilot commands alternating tilts
//! that neither plan nor wind requires.
//!
//! The commanded tilt gives the plan's acceleration `a` against the disturbance `d`, and the feedback `r =
//! (f_c / g) - (a - d) / g` with the horizontal specific force `f_c` of the commanded attitude. Its part
//! slower than a second is a position error or wind; the oscillation is the faster part's RMS over two
//! seconds.

use alight_shared::estimation::low_pass;
use alight_shared::geometry::GRAVITY;
use alight_shared::msg::{DroneState, SetPoint, SetPointKind};
use alight_shared::time::{DroneClock, Time};
use nalgebra::{Vector2, Vector3};

/// Time constant of feedback that is no oscillation, s: an unstable loop oscillates in about a second.
const SLOW_S: f64 = 1.0;
const AVERAGE_S: f64 = 2.0;
/// Gap between set-points after which the monitor restarts, s.
const MAX_GAP_S: f64 = 0.3;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SwingMonitor {
    last: Option<Time<DroneClock>>,
    slow: Vector2<f64>,
    square: f64,
}

impl SwingMonitor {
    /// `drone`: odometry with the disturbance.
    pub(super) fn update(&mut self, s: &SetPoint, drone: Option<&DroneState>) {
        let at = s.header.at;
        let dt = self.last.map(|last| (at - last).secs());
        let up = s.attitude() * -Vector3::z();
        let (SetPointKind::Attitude, Some(drone), true) = (s.kind, drone, up.z < -0.1) else {
            *self = SwingMonitor::default();
            return;
        };
        self.last = Some(at);
        let commanded = up.xy() / -up.z;
        let [x, y, _] = s.acceleration;
        let feedback = commanded - (Vector2::new(x, y) - drone.disturbance()) / GRAVITY;
        let Some(dt) = dt.filter(|dt| (0.0..=MAX_GAP_S).contains(dt)) else {
            (self.slow, self.square) = (feedback, 0.0);
            return;
        };
        self.slow = low_pass(self.slow, feedback, dt, SLOW_S);
        self.square = low_pass(self.square, (feedback - self.slow).norm_squared(), dt, AVERAGE_S);
    }
    pub(super) fn rms(&self) -> f64 {
        self.square.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::Header;
    use nalgebra::UnitQuaternion;

    /// Oscillation after ten seconds of `roll(t)` (rad) and lateral acceleration `a(t)` (m/s²) of the plan,
    /// at a heading of 1 rad in a constant wind of 2 m/s².
    fn swing(roll: impl Fn(f64) -> f64, a: impl Fn(f64) -> f64) -> f64 {
        let mut m = SwingMonitor::default();
        let across = UnitQuaternion::from_euler_angles(0.0, 0.0, 1.0) * Vector3::y();
        for k in 0..1000 {
            let t = 0.01 * f64::from(k);
            let header = Header::new(1, 1, 1, k, Time::from_secs(t));
            // The drone rolls against the wind.
            let q = UnitQuaternion::from_euler_angles(((2.0 + a(t)) / GRAVITY).atan() + roll(t), 0.0, 1.0);
            let s = SetPoint {
                header,
                kind: SetPointKind::Attitude,
                attitude: [q.w, q.i, q.j, q.k],
                acceleration: (across * a(t)).into(),
                ..SetPoint::default()
            };
            let drone = DroneState {
                header,
                disturbance: [-2.0 * across.x, -2.0 * across.y],
                ..DroneState::default()
            };
            m.update(&s, Some(&drone));
        }
        m.rms().to_degrees()
    }

    #[test]
    fn swing_of_a_limit_cycle() {
        let waves = |t: f64| 1.5 * (1.2 * t).sin();
        // Standard deviation of 16 deg at 1 Hz, as in the flight of a real ArduCopter.
        let cycle = swing(|t| 0.39 * (std::f64::consts::TAU * t).sin(), waves);
        assert!((12.0..19.0).contains(&cycle), "{cycle}");
        let quiet = swing(|_| 0.0, waves);
        assert!(quiet < 0.1, "{quiet}");
        let slow = swing(|t| 0.1 * (0.4 * t).sin(), waves);
        assert!(slow < 2.5, "{slow}");
    }

    #[test]
    fn swing_while_the_autopilot_steers() {
        let mut m = SwingMonitor {
            square: 1.0,
            ..SwingMonitor::default()
        };
        let s = SetPoint {
            kind: SetPointKind::Trajectory,
            ..SetPoint::default()
        };
        m.update(&s, Some(&DroneState::default()));
        assert_eq!(m.rms(), 0.0);
    }
}
