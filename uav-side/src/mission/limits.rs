//! Quantities with their limits, as reasons.

use alight_shared::msg::{Reason, ReasonCode};

pub(super) use crate::contingency::LOST_OUTSIDE_M;

/// Distance from the approach height at which Get altitude ends, m.
pub(super) const HEIGHT_TOLERANCE_M: f64 = 1.0;
/// Time for which the deck must be detected to confirm visual contact, s.
pub(super) const CONTACT_CONFIRM_S: f64 = 0.3;
/// Maximum horizontal distance from the deck's centre of a steady drone, m.
pub(super) const STEADY_DISTANCE_M: f64 = 1.5;
/// Maximum difference from the tracking height of a steady drone, m.
/// Source: at tracking height the drone does not follow heave.
pub(super) const STEADY_HEIGHT_M: f64 = 2.0;
/// Time for which an order to land waits for a drone that is disarmed or under other control, s: enough to arm, take
/// off and select the mode. For a drone under our control the order lasts as long as a landing may.
pub(super) const ORDER_WAITS_S: f64 = 60.0;
/// Time at the decision clearance without the flare's conditions after which the drone returns to Tracking, s.
pub(super) const DECISION_TIMEOUT_S: f64 = 8.0;
/// Time for which data must be fresh before a Hold ends, s.
pub(super) const RECOVER_S: f64 = 0.5;
/// Factor that widens the limits of a steady drone or feasible deck once they are met.
pub(super) const HYSTERESIS: f64 = 1.5;
/// Fraction of the reserve that may be used while an operator who has stopped the landing decides.
pub(super) const FOR_OPERATOR: f64 = 0.25;
/// Horizontal distance to a detected deck within which Hold is followed by Tracking, m.
pub(super) const RESUME_DISTANCE_M: f64 = 10.0;
/// Duration of a climb out of the path of a vessel, s: 6 m at 1.5 m/s.
pub(super) const CLIMB_S: f64 = 4.0;
/// Maximum rise of a deck in waves, m.
pub(super) const HEAVE_M: f64 = 2.0;
/// Minimum horizontal distance of a drone without an order that is away from the vessel, m: more than wave motion.
pub(super) const AWAY_M: f64 = 1.5 * RESUME_DISTANCE_M;

/// Reason if `value` exceeds `limit` or is NaN.
pub(super) fn exceeds(code: ReasonCode, value: f64, limit: f64) -> Option<Reason> {
    (value > limit || value.is_nan()).then_some(Reason::new(code, value, limit))
}

pub(super) fn first_beyond<const N: usize>(values: [(ReasonCode, f64, f64); N]) -> Option<Reason> {
    values
        .into_iter()
        .find_map(|(code, value, limit)| exceeds(code, value, limit))
}
/// Maximum waiting height above a vessel known only by its tags, m: there a tag's tilt is accurate to a degree, and
/// from 7 m only to three or four.
pub(super) const TAG_HEIGHT_M: f64 = 3.5;
/// Minimum height above its lowest plan at which a descent without a landing starts, m.
pub(super) const MATCHES_FROM_M: f64 = 0.5;
