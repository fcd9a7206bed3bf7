//! The autopilot's start: it boots before our processes or after them, knows its origin as soon as GNSS is good, and aligns
//! its heading by the magnetometer later.
//!
//! Measured with PX4 main of March 2026: 0.4 to 2 s after the origin was reported, by 50 to 118 deg. Until then its attitude
//! begins at whatever heading, GNSS is not fused, which it reports, and neither OFFBOARD (GUIDED) nor arming is granted.
//! The drone meanwhile is where it is: a pilot holds it.

use core::f64::consts::TAU;

use alight_shared::time::{Span, Time, TrueTime};
use alight_uav::autopilot::message::estimator;
use alight_uav::autopilot::modes::Firmware;
use nalgebra::UnitQuaternion;

use crate::physics::streams::Streams;
use crate::sensors::noise::Noise;

/// Between the origin's report and the alignment, s.
const AFTER_S: [f64; 2] = [0.4, 2.0];
/// An autopilot that is started after our processes boots for so long, s.
const BOOT_S: [f64; 2] = [0.2, 1.0];

/// A heading that is not aligned yet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unaligned {
    /// The heading reads this much more, rad.
    turned: f64,
    /// Silent until then.
    boots_until: Time<TrueTime>,
    after: Span,
    /// When it is aligned; None: its origin is not reported yet.
    due: Option<Time<TrueTime>>,
}

impl Unaligned {
    /// Drawn: which of the two was started first, the heading, the time.
    pub(super) fn drawn(streams: &Streams, now: Time<TrueTime>) -> Unaligned {
        let mut draw = Noise::new(streams, "autopilot.alignment");
        let mut between = |[low, high]: [f64; 2]| low + (high - low) * draw.uniform();
        let turned = between([-0.5 * TAU, 0.5 * TAU]);
        let after = Span::from_secs(between(AFTER_S));
        let boot = Span::from_secs(between(BOOT_S));
        let first = between([0.0, 1.0]) < 0.5;
        Unaligned {
            turned,
            boots_until: if first { now } else { now + boot },
            after,
            due: first.then_some(now + after),
        }
    }
    /// Whether it receives and sends nothing yet.
    pub(super) fn boots(&self, now: Time<TrueTime>) -> bool {
        now < self.boots_until
    }
    /// Begins to report its origin.
    pub(super) fn origin_reported(&mut self, now: Time<TrueTime>) {
        self.due.get_or_insert(now + self.after);
    }
    /// The magnetometer has aligned it.
    pub(super) fn is_over(&self, now: Time<TrueTime>) -> bool {
        self.due.is_some_and(|due| now >= due)
    }
    /// The attitude (NED from body) as it reads.
    pub(super) fn read(&self, attitude: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        UnitQuaternion::from_euler_angles(0.0, 0.0, self.turned) * attitude
    }
}

/// The estimator's status flags, with an aligned heading and without.
pub(super) fn flags(firmware: Firmware, aligned: bool) -> u16 {
    let height = estimator::VELOCITY_VERT | estimator::POSITION_VERT_ABS;
    match (firmware, aligned) {
        (_, true) => height | estimator::ATTITUDE | estimator::VELOCITY_HORIZ | estimator::POSITION_HORIZ_ABS,
        // Its attitude is good as soon as the tilt is.
        (Firmware::Px4, false) => height | estimator::ATTITUDE | estimator::CONSTANT_POSITION,
        (Firmware::ArduCopter, false) => 0,
    }
}
