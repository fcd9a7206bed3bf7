//! Angle between a heading and the course over ground. A mirrored or reversed compass keeps it large, as do a boat that
//! goes astern and one that drifts, so it is reported and nothing is removed.

use alight_shared::msg::{GnssFix, HeadingFix};
use alight_shared::time::{Time, VesselClock};

use super::has_velocity;

/// Minimum speed of a course, m/s, and maximum age of a velocity and of a heading, s.
const MIN_SPEED_MPS: f64 = 1.5;
const MAX_AGE_S: f64 = 2.5;
/// Averaging time, s, minimum length of the mean unit vector, and minimum angle, rad (60 deg): twice the drift of a boat
/// with 2.5 kn of current on her beam.
const MEAN_S: f64 = 60.0;
const MIN_STEADY: f64 = 0.9;
const MIN_ANGLE_RAD: f64 = 1.05;

/// Steady angle from the course to the heading, rad, and the speed, m/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Drift {
    pub(super) angle: f64,
    pub(super) speed_mps: f64,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DriftAngle {
    /// Newest course, rad, and speed, m/s.
    course: Option<(Time<VesselClock>, f64, f64)>,
    /// Times of the first and the newest angle, and the mean unit vector.
    mean: Option<(Time<VesselClock>, Time<VesselClock>, [f64; 2])>,
}

impl DriftAngle {
    pub(super) fn fix(&mut self, fix: &GnssFix) {
        let [north, east, _] = fix.velocity;
        if has_velocity(fix) {
            self.course = Some((fix.header.at, east.atan2(north), north.hypot(east)));
        }
    }
    pub(super) fn heading(&mut self, fix: &HeadingFix) {
        let at = fix.header.at;
        let is_fresh = |then: Time<VesselClock>| (at - then).abs().secs() <= MAX_AGE_S;
        let course = self.course.filter(|(then, ..)| is_fresh(*then));
        let before = self.mean.take();
        let Some((_, course, _)) = course.filter(|(.., speed)| *speed >= MIN_SPEED_MPS) else {
            return;
        };
        let (sin, cos) = (fix.heading - course).sin_cos();
        self.mean = match before.filter(|(_, newest, _)| is_fresh(*newest)) {
            Some((begun, newest, [x, y])) => {
                let part = ((at - newest).secs() / MEAN_S).clamp(0.0, 1.0);
                Some((begun, at, [x + part * (cos - x), y + part * (sin - y)]))
            }
            None => Some((at, at, [cos, sin])),
        };
    }
    pub(super) fn found(&self) -> Option<Drift> {
        let ((_, _, speed_mps), (begun, newest, [x, y])) = self.course.zip(self.mean)?;
        let angle = y.atan2(x);
        let is_steady = (newest - begun).secs() >= MEAN_S && x.hypot(y) >= MIN_STEADY;
        (is_steady && angle.abs() >= MIN_ANGLE_RAD).then_some(Drift { angle, speed_mps })
    }
}
