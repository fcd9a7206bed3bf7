//! Start of the autopilot. It boots before or after Alight's processes, reports its origin when GNSS is good,
//! and then aligns its heading with the magnetometer.
//!
//! Measured with PX4 main of March 2026: the alignment comes 0.4 to 2 s after the report of the origin and
//! turns the heading by 50 to 118 deg. Until then the heading is arbitrary, the autopilot reports that GNSS
//! is not fused, and it denies OFFBOARD (GUIDED) and arming, while a pilot holds the drone in place.

use core::f64::consts::TAU;

use alight_shared::{
    frames::yaw_rotation,
    mavlink::dialect::EstimatorStatusFlags as Flags,
    time::{Span, WorldTime},
};
use alight_uav::autopilot::modes::Firmware;
use nalgebra::UnitQuaternion;

use crate::{physics::streams::Streams, sensors::noise::Noise};

/// Time from the report of the origin to the alignment, s.
const AFTER_S: [f64; 2] = [0.4, 2.0];
/// Boot time of an autopilot that starts after Alight's processes, s.
const BOOT_S: [f64; 2] = [0.2, 1.0];

#[derive(Clone, Copy, Debug)]
pub(super) struct Unaligned {
    /// Heading error before the alignment, rad.
    turned: f64,
    /// Time until which the autopilot boots and is silent.
    boots_until: WorldTime,
    after: Span,
    /// Time of the alignment; None until the origin is reported.
    due: Option<WorldTime>,
}

impl Unaligned {
    /// Draws the order in which autopilot and Alight's processes start, the heading error and the delay.
    pub(super) fn drawn(streams: &Streams, now: WorldTime) -> Unaligned {
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
    /// Whether the autopilot is still booting, and neither receives nor sends.
    pub(super) fn boots(&self, now: WorldTime) -> bool {
        now < self.boots_until
    }
    pub(super) fn origin_reported(&mut self, now: WorldTime) {
        self.due.get_or_insert(now + self.after);
    }
    /// Whether the magnetometer has aligned the heading.
    pub(super) fn is_over(&self, now: WorldTime) -> bool {
        self.due.is_some_and(|due| now >= due)
    }
    /// Reported attitude (NED from body) for a true attitude.
    pub(super) fn read(&self, attitude: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        yaw_rotation(self.turned) * attitude
    }
}

pub(super) fn flags(firmware: Firmware, aligned: bool) -> Flags {
    let height = Flags::ESTIMATOR_VELOCITY_VERT | Flags::ESTIMATOR_POS_VERT_ABS;
    match (firmware, aligned) {
        (_, true) => {
            height
                | Flags::ESTIMATOR_ATTITUDE
                | Flags::ESTIMATOR_VELOCITY_HORIZ
                | Flags::ESTIMATOR_POS_HORIZ_ABS
        }
        // The attitude flag is set as soon as the tilt has converged.
        (Firmware::Px4, false) => height | Flags::ESTIMATOR_ATTITUDE | Flags::ESTIMATOR_CONST_POS_MODE,
        (Firmware::ArduCopter, false) => Flags::empty(),
    }
}
