//! Detection of delayed updates. The difference between arrival and time stamp is compared with the smallest difference
//! so far. A time stamp truncated to whole seconds is up to one second earlier than the measurement.

use alight_shared::estimation::{CLOCK_DRIFT, HELD_UP_S, JITTER_S, OffsetBounds};
use alight_shared::time::{Time, VesselClock};

/// Excess over the smallest lag that truncation to a second and arrival jitter do not explain, ns.
const LATE_NS: i64 = 1_000_000_000 + (JITTER_S * 1e9) as i64;

/// Lag of the updates of one clock.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lag {
    /// Smallest difference between arrival and time stamp, as of the last accepted update.
    smallest: Option<OffsetBounds<VesselClock>>,
    /// Start of the current run of late updates, ns.
    late_since: Option<i64>,
}

impl Lag {
    /// Adds an update with time `stamp_ns` that arrives at `now_ns`. Returns whether it was delayed. After some seconds
    /// the clock is assumed to have been set back.
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
        // A clock that was set forward is accepted at once, a clock that was set back after ten seconds.
        assert!(!late(111, 500) && !late(112, 501));
        assert!((113..123).all(|k| late(k, k - 100)));
        assert!(!late(123, 23) && !late(124, 24) && late(130, 25));
    }
}
