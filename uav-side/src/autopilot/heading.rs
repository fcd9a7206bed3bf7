//! Alignment of the autopilot's heading, which Alight needs before it flies.
//!
//! PX4 and ArduPilot report the origin of their NED as soon as GNSS is good. They align the heading with the
//! magnetometer 0.4 to 2 s later, which turns it by up to 180 deg. Both fuse GNSS only after tilt and heading
//! are aligned (PX4 `EKF2`: `yaw_align` before GNSS fusion; ArduPilot `EKF3`: `yawAlignComplete`), so an
//! absolute position implies alignment. Without a status, a heading that has not jumped for [`STEADY_S`]
//! counts as aligned.

use alight_shared::{mavlink::dialect::EstimatorStatusFlags as Flags, msg::DroneState, time::Span};
use nalgebra::{UnitQuaternion, Vector3};

use super::DroneTime;
use crate::odometry::origin::yaw_jump;

const STATUS_STALE: Span = Span::from_millis(3000);
/// Time without a jump after which a heading without a status counts as aligned, s: five times the longest
/// measured.
const STEADY_S: f64 = 10.0;

#[derive(Clone, Debug, Default)]
pub(crate) struct HeadingAlignment {
    /// Time of the newest status, and whether it reported an aligned heading.
    status: Option<(DroneTime, bool)>,
    last: Option<(DroneTime, UnitQuaternion<f64>, Vector3<f64>)>,
    steady_since: Option<DroneTime>,
    was_aligned: bool,
}

impl HeadingAlignment {
    /// Processes the estimator's status; both firmwares use the same bits. Without a position measurement an
    /// estimator assumes a constant position.
    pub(crate) fn status(&mut self, now: DroneTime, flags: Flags) {
        let aligned = flags.contains(Flags::ESTIMATOR_ATTITUDE | Flags::ESTIMATOR_POS_HORIZ_ABS);
        self.status = Some((now, aligned));
        self.was_aligned |= aligned;
    }
    pub(crate) fn watch(&mut self, d: &DroneState) {
        let at = d.header.at;
        let q = d.attitude();
        let rates = Vector3::from(d.rates);
        let jumped = self.last.is_some_and(|(then, before, turned)| {
            yaw_jump((&before, turned), (&q, rates), (at - then).secs()).is_some()
        });
        let gap = self.last.is_none_or(|(then, ..)| (at - then).secs() > 1.0);
        if jumped || gap {
            self.steady_since = Some(at);
        }
        self.last = Some((at, q, rates));
        let steady = self
            .steady_since
            .is_some_and(|since| (at - since).secs() >= STEADY_S);
        self.was_aligned |= self.status.is_none() && steady;
    }
    pub(crate) fn is_watched(&self, now: DroneTime, limit_s: f64) -> bool {
        self.last.is_some_and(|(at, ..)| (now - at).secs() <= limit_s)
    }
    pub(crate) fn resume(&mut self) {
        self.was_aligned = true;
    }
    /// Whether the heading has been aligned, so that odometry and set-points share it.
    pub(crate) fn was_aligned(&self) -> bool {
        self.was_aligned
    }
    pub(crate) fn is_aligned(&self, now: DroneTime) -> bool {
        match self.status {
            Some((at, aligned)) if now - at <= STATUS_STALE => aligned,
            Some(_) | None => self.was_aligned,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{
        frames::{wxyz, yaw_rotation},
        msg::Header,
    };

    fn at(s: f64) -> DroneTime {
        DroneTime::from_secs(s)
    }
    fn state(s: f64, yaw: f64) -> DroneState {
        DroneState {
            header: Header::new(1, 1, 1, 1, at(s)),
            attitude: wxyz(&yaw_rotation(yaw)),
            ..DroneState::default()
        }
    }

    #[test]
    fn alignment_by_the_estimators_status() {
        let mut h = HeadingAlignment::default();
        // Before the alignment PX4 reports tilt, height and constant position.
        h.status(
            at(1.0),
            Flags::ESTIMATOR_ATTITUDE | Flags::ESTIMATOR_POS_VERT_ABS | Flags::ESTIMATOR_CONST_POS_MODE,
        );
        for k in 0..2000 {
            h.watch(&state(1.0 + 0.01 * f64::from(k), 0.3));
        }
        assert!(!h.was_aligned() && !h.is_aligned(at(2.0)));
        h.status(
            at(21.0),
            Flags::ESTIMATOR_ATTITUDE | Flags::ESTIMATOR_POS_HORIZ_ABS,
        );
        assert!(h.was_aligned() && h.is_aligned(at(21.0)));
        // When alignment is lost a flight continues, but no landing begins.
        h.status(at(30.0), Flags::ESTIMATOR_ATTITUDE);
        assert!(h.was_aligned() && !h.is_aligned(at(30.1)));
    }

    #[test]
    fn alignment_of_a_firmware_without_a_status() {
        let mut h = HeadingAlignment::default();
        let yaw = |s: f64| if s < 4.0 { 0.0 } else { 2.0 };
        for k in 0..1390 {
            let s = 0.01 * f64::from(k);
            h.watch(&state(s, yaw(s)));
            assert!(!h.was_aligned(), "{s}");
        }
        for k in 1390..1410 {
            h.watch(&state(0.01 * f64::from(k), 2.0));
        }
        assert!(h.was_aligned() && h.is_aligned(at(14.1)));
    }
}
