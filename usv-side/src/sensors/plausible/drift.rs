//! Angle between a heading and the course over ground. A mirrored or reversed compass keeps it large, as do a boat that
//! goes astern and one that drifts, so it is reported and nothing is removed.

use alight_shared::{
    frames::wrap_angle,
    msg::{GnssFix, HeadingFix},
    time::{Time, VesselClock},
};

use super::has_velocity;

/// Minimum speed of a course, m/s, and maximum age of a velocity and of a heading, s.
const MIN_SPEED_MPS: f64 = 1.5;
const MAX_AGE_S: f64 = 2.5;
/// Averaging time, s, minimum length of the mean unit vector, and minimum angle, rad (60 deg): twice the drift of a boat
/// with 2.5 kn of current on her beam.
const MEAN_S: f64 = 60.0;
const MIN_STEADY: f64 = 0.9;
const MIN_ANGLE_RAD: f64 = 1.05;

/// Number of different courses that are compared with the heading, fraction of them that shows a copy, and maximum
/// difference of a copy, rad: half a step of a tenth of a degree.
const COMPARED: u32 = 20;
const COPIED: f64 = 0.9;
const COPY_RAD: f64 = 1e-3;

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
    /// Newest heading, rad.
    heading: Option<(Time<VesselClock>, f64)>,
    /// Start of the comparison with the course, numbers of courses and of equal ones.
    compared: Option<(Time<VesselClock>, u32, u32)>,
    is_copy: Option<Time<VesselClock>>,
}

impl DriftAngle {
    pub(super) fn fix(&mut self, fix: &GnssFix) {
        let [north, east, _] = fix.velocity;
        if has_velocity(fix) {
            let course = (fix.header.at, east.atan2(north), north.hypot(east));
            let before = self.course.replace(course);
            if let (Some((_, before, _)), Some((at, heading))) = (before, self.heading)
                && before != course.1
                && (fix.header.at - at).abs().secs() <= MAX_AGE_S
            {
                // A heading precedes or follows the course of its epoch.
                let is_equal = |course: f64| wrap_angle(heading - course).abs() <= COPY_RAD;
                self.compare(at, is_equal(before) || is_equal(course.1));
            }
        }
    }
    fn compare(&mut self, at: Time<VesselClock>, is_equal: bool) {
        let (since, all, equal) = self.compared.unwrap_or((at, 0, 0));
        let (all, equal) = (all + 1, equal + u32::from(is_equal));
        self.compared = Some((since, all, equal));
        if all >= COMPARED {
            let is_copy = f64::from(equal) >= COPIED * f64::from(all);
            self.is_copy = if is_copy {
                self.is_copy.or(Some(since))
            } else {
                None
            };
            self.compared = None;
        }
    }
    /// Time since which the heading repeats the course.
    pub(super) fn is_copy(&self) -> Option<Time<VesselClock>> {
        self.is_copy
    }
    pub(super) fn heading(&mut self, fix: &HeadingFix) {
        let at = fix.header.at;
        self.heading = Some((at, fix.heading));
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
    pub(super) fn has_velocity(&self) -> bool {
        self.course.is_some()
    }
    /// Whether the boat moves, so that the course tells about the heading.
    pub(super) fn has_course(&self) -> bool {
        self.mean.is_some()
    }
    pub(super) fn found(&self) -> Option<Drift> {
        let ((_, _, speed_mps), (begun, newest, [x, y])) = self.course.zip(self.mean)?;
        let angle = y.atan2(x);
        let is_steady = (newest - begun).secs() >= MEAN_S && x.hypot(y) >= MIN_STEADY;
        (is_steady && angle.abs() >= MIN_ANGLE_RAD).then_some(Drift { angle, speed_mps })
    }
}
