//! Detection of delayed updates by the smallest difference of arrival and time stamp so far. A stamp
//! truncated to whole seconds is up to one second early.

use alight_shared::estimation::{CLOCK_DRIFT, HELD_UP_S, JITTER_S, OffsetBounds};
use alight_shared::time::{Time, VesselClock};

/// Excess over the smallest lag beyond truncation to a second and arrival jitter, ns.
const LATE_NS: i64 = 1_000_000_000 + (JITTER_S * 1e9) as i64;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lag {
    /// Smallest difference of arrival and time stamp, as of the last accepted update.
    smallest: Option<OffsetBounds<VesselClock>>,
    /// Start of the current run of late updates, ns.
    late_since: Option<i64>,
}

impl Lag {
    /// Whether an update stamped `stamp_ns` that arrives at `now_ns` was delayed. After some seconds, its
    /// clock is taken as set back instead.
    pub(super) fn is_held_up(&mut self, now_ns: i64, stamp_ns: i64) -> bool {
        let lag = OffsetBounds::of_message(stamp_ns, Time::from_nanos(now_ns));
        let smallest = self.smallest.map_or(lag, |s| s.drifted(lag.at, CLOCK_DRIFT));
        let is_late = (lag.high - smallest.high).nanos() > LATE_NS;
        let since = *self.late_since.get_or_insert(now_ns);
        if is_late && (now_ns.saturating_sub(since) as f64) < HELD_UP_S * 1e9 {
            return true;
        }
        self.smallest = Some(if is_late { lag } else { smallest.and(lag) });
        self.late_since = None;
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    #[test]
    fn lag_of_a_clock_that_is_set() {
        let mut lag = Lag::default();
        let mut late = |at_s: i64, stamp_s: i64| lag.is_held_up(at_s * S, stamp_s * S);
        assert!(!late(100, 7) && !late(101, 8) && !late(102, 8), "cut by a second");
        assert!(late(110, 10) && !late(110, 17), "a burst");
        // A clock set forward is accepted at once, one set back after ten seconds.
        assert!(!late(111, 500) && !late(112, 501));
        assert!((113..123).all(|k| late(k, k - 100)));
        assert!(!late(123, 23) && !late(124, 24) && late(130, 25));
    }
}
