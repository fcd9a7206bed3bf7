//! Quantities and their limits, as reasons.

use alight_shared::msg::{Reason, ReasonCode};

/// The reason when `value` is beyond `limit`; a NaN is beyond.
pub(super) fn exceeds(code: ReasonCode, value: f64, limit: f64) -> Option<Reason> {
    (value > limit || value.is_nan()).then_some(Reason::new(code, value, limit))
}

/// The first figure of the list that is beyond its limit.
pub(super) fn first_beyond<const N: usize>(figures: [(ReasonCode, f64, f64); N]) -> Option<Reason> {
    figures
        .into_iter()
        .find_map(|(code, value, limit)| exceeds(code, value, limit))
}
