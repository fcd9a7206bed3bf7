//! Oscillation of the commanded attitude: an unstable loop of pilot and autopilot commands alternating tilts that
//! neither plan nor wind requires.
//!
//! The commanded tilt produces the plan's acceleration `a` against the disturbance `d`, plus the feedback `r = (f_c /
//! g) - (a - d) / g`, where `f_c` is the horizontal specific force of the commanded attitude. Feedback slower than a
//! second is a position error or wind; the oscillation is the RMS of the faster part over two seconds.

use alight_shared::{
    estimation::low_pass,
    geometry::GRAVITY,
    msg::{DroneState, SetPoint, SetPointKind},
    time::{DroneClock, Time},
};
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

/// Time constant of feedback that does not count as oscillation, s: an unstable loop oscillates in about a second.
const SLOW_S: f64 = 1.0;
const AVERAGE_S: f64 = 2.0;
/// Gap between set-points after which the monitor restarts, s.
const MAX_GAP_S: f64 = 0.3;
/// Variances of the plan's acceleration, (m/s²)², and of its derivative, (m/s³)², below which a plan explains no
/// oscillation.
const PLAN_VARIANCE: f64 = 0.01;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SwingMonitor {
    last: Option<(Time<DroneClock>, Vector2<f64>)>,
    /// Slow parts of feedback, planned acceleration and its derivative (columns), north and east.
    slow: Matrix2x3<f64>,
    /// Second moments of the fast parts.
    moments: Matrix3<f64>,
}

impl SwingMonitor {
    /// `drone`: odometry with the disturbance.
    pub(super) fn update(&mut self, s: &SetPoint, drone: Option<&DroneState>) {
        let at = s.header.at;
        let up = s.attitude() * -Vector3::z();
        let (SetPointKind::Attitude, Some(drone), true) = (s.kind, drone, up.z < -0.1) else {
            *self = SwingMonitor::default();
            return;
        };
        let planned = Vector3::from(s.acceleration).xy();
        let last = self.last.replace((at, planned));
        let commanded = up.xy() / -up.z;
        let feedback = commanded - (planned - drone.disturbance()) / GRAVITY;
        let step = last.map(|(then, before)| ((at - then).secs(), before));
        let Some((dt, before)) = step.filter(|(dt, _)| *dt > 0.0 && *dt <= MAX_GAP_S) else {
            self.moments = Matrix3::zeros();
            self.slow = Matrix2x3::from_columns(&[feedback, planned, Vector2::zeros()]);
            return;
        };
        let signals = Matrix2x3::from_columns(&[feedback, planned, (planned - before) / dt]);
        self.slow = low_pass(self.slow, signals, dt, SLOW_S);
        let fast = signals - self.slow;
        self.moments = low_pass(self.moments, fast.transpose() * fast, dt, AVERAGE_S);
    }
    pub(super) fn rms(&self) -> f64 {
        let m = &self.moments;
        let of_plan = m.fixed_view::<2, 2>(1, 1) + Matrix2::from_diagonal_element(PLAN_VARIANCE);
        let with_plan = m.fixed_view::<2, 1>(1, 0);
        let explained = (of_plan.try_inverse()).map_or(0.0, |i| (with_plan.transpose() * i * with_plan)[0]);
        (m[(0, 0)] - explained).max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::Header;
    use nalgebra::UnitQuaternion;

    /// Oscillation after ten seconds of `roll(t)` (rad) and lateral planned acceleration `a(t)` (m/s²), at a heading of
    /// 1 rad in a constant wind of 2 m/s².
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
        // Commands that lead the plan by 0.15 s (8 deg RMS) over a deck at 7 m/s, without and with a limit cycle.
        let fast = |t: f64| 2.0 * (9.0 * t).sin();
        let leads = |t: f64| 0.15 * 2.0 * 9.0 * (9.0 * t).cos() / GRAVITY;
        let deck = swing(leads, fast);
        assert!(deck < 2.5, "{deck}");
        let both = swing(|t| leads(t) + 0.39 * (std::f64::consts::TAU * t).sin(), fast);
        assert!((12.0..19.0).contains(&both), "{both}");
    }

    #[test]
    fn swing_while_the_autopilot_steers() {
        let mut m = SwingMonitor {
            moments: Matrix3::identity(),
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
