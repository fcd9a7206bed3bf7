//! Quantities and their limits, as reasons.

use alight_shared::msg::{Reason, ReasonCode};

/// Get altitude ends this close to the approach height, m.
pub(super) const HEIGHT_TOLERANCE_M: f64 = 1.0;
/// Detected for this long, visual contact is confirmed, s.
pub(super) const CONTACT_CONFIRM_S: f64 = 0.3;
/// Stably above the deck: horizontal distance, m.
pub(super) const STEADY_DISTANCE_M: f64 = 1.5;
/// Stably above the deck: difference from the tracking height, m.
/// Source: Heave is not chased at tracking height.
pub(super) const STEADY_HEIGHT_M: f64 = 2.0;
/// A committed flare is broken off when the feet's centre is this far outside the part of the
/// deck on which all feet stand, m.
/// Source: Half of the feet's span: half of the feet are off the deck.
pub(super) const LOST_OUTSIDE_M: f64 = 0.2;
/// An order to land waits no longer for a drone that is disarmed or in other hands, s: a pilot arms, takes off and chooses the
/// mode in that time. With a drone that is ours and waits for something else it lasts as long as a landing may.
pub(super) const ORDER_WAITS_S: f64 = 60.0;
/// Conditions of the flare unmet for this long at the decision clearance: back to Tracking, s.
pub(super) const DECISION_TIMEOUT_S: f64 = 8.0;
/// Data must be fresh for this long before Hold is left, s.
pub(super) const RECOVER_S: f64 = 0.5;
/// Limits are this much wider for what was steady, or feasible.
pub(super) const HYSTERESIS: f64 = 1.5;
/// Share of the reserve in which an operator who has stopped the landing decides.
pub(super) const FOR_OPERATOR: f64 = 0.25;
/// Hold resumes with Tracking within this horizontal distance of a detected deck, m.
pub(super) const RESUME_DISTANCE_M: f64 = 10.0;
/// A climb out of the way of a vessel takes so long, s: 6 m at 1.5 m/s.
pub(super) const CLIMB_S: f64 = 4.0;
/// A deck in waves comes up at most so far, m.
pub(super) const HEAVE_M: f64 = 2.0;
/// Without an order, a drone is away from the vessel from this horizontal distance on, m: waves alone do not close it.
pub(super) const AWAY_M: f64 = 1.5 * RESUME_DISTANCE_M;

/// The reason when `value` is beyond `limit`; a NaN is beyond.
pub(super) fn exceeds(code: ReasonCode, value: f64, limit: f64) -> Option<Reason> {
    (value > limit || value.is_nan()).then_some(Reason::new(code, value, limit))
}

/// The first value of the list that is beyond its limit.
pub(super) fn first_beyond<const N: usize>(values: [(ReasonCode, f64, f64); N]) -> Option<Reason> {
    values
        .into_iter()
        .find_map(|(code, value, limit)| exceeds(code, value, limit))
}
/// Over a vessel that is known by its tags alone the drone waits no higher than this, m: from there a tag's tilt is known
/// to a degree, from 7 m to three or four.
pub(super) const TAG_HEIGHT_M: f64 = 3.5;
/// A descent that does not land begins at least so far above its lowest plan, m.
pub(super) const MATCHES_FROM_M: f64 = 0.5;
