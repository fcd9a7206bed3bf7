//! A source's clock against the vessel's. A source answers no time requests; known is only that no measurement
//! arrives before it is made. The smallest difference between arrival and source time is the offset plus the
//! smallest delay, of which the configuration may subtract what is known of the sensor. Measurements keep the
//! intervals that their source gives them, however they were delayed.

use alight_shared::time::{Span, Time, VesselClock};

/// Drift between two crystals, s/s.
const DRIFT: f64 = 1e-4;
/// Largest deviation from the offset that is delay, s: beyond, the time is wrong or the source has restarted.
const MAX_DELAY_S: f64 = 2.0;
/// After so many deviating times in a row that agree among themselves the source has restarted.
const AGREEING: u32 = 10;

/// The offset of a source's clock.
#[derive(Clone, Debug, Default)]
pub struct SourceClock {
    /// Vessel's less source's, ns, and the time of its last update.
    offset: Option<(i64, Time<VesselClock>)>,
    /// Another offset observed since, and how often in a row.
    other: Option<(i64, u32)>,
    restarts: u64,
}

/// Unwraps a time that starts anew every `PERIOD_NS` (time of day, time of week).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rollover<const PERIOD_NS: i64> {
    periods: i64,
    /// The last unwrapped time, ns.
    pub(super) last: Option<i64>,
}

impl<const PERIOD_NS: i64> Rollover<PERIOD_NS> {
    /// The time in the period that brings it nearest to the last.
    pub(super) fn unwrap(&mut self, in_period_ns: i64) -> i64 {
        if let Some(last) = self.last {
            let off = last - (self.periods * PERIOD_NS + in_period_ns);
            if off > PERIOD_NS / 2 {
                self.periods += 1;
            } else if off < -PERIOD_NS / 2 {
                self.periods -= 1;
            }
        }
        *self.last.insert(self.periods * PERIOD_NS + in_period_ns)
    }
}

impl SourceClock {
    /// The vessel's time of a measurement that its source dates at `at_ns` and that arrives at `now`, at least
    /// `least` after it was made. None when that time is implausible.
    pub fn vessel_time(
        &mut self,
        now: Time<VesselClock>,
        at_ns: i64,
        least: Span,
    ) -> Option<Time<VesselClock>> {
        let seen = now.nanos().saturating_sub(at_ns);
        let max_delay_ns = Span::from_secs(MAX_DELAY_S).nanos();
        let Some((offset, updated)) = self.offset else {
            self.offset = Some((seen, now));
            return Some(now - least);
        };
        // The smallest observed, enlarged by the drift possible since.
        let drifted = offset.saturating_add(((now - updated).nanos() as f64 * DRIFT) as i64);
        if seen.saturating_sub(drifted).saturating_abs() > max_delay_ns {
            let (other, count) = self.other.unwrap_or((seen, 0));
            let agrees = seen.saturating_sub(other).saturating_abs() < max_delay_ns;
            let (other, count) = if agrees {
                (other.min(seen), count + 1)
            } else {
                (seen, 1)
            };
            if count < AGREEING {
                self.other = Some((other, count));
                return None;
            }
            self.restarts += 1;
            self.offset = Some((other, now));
            self.other = None;
        } else {
            self.other = None;
            self.offset = Some((drifted.min(seen), now));
        }
        let (offset, _) = self.offset?;
        Some(Time::from_nanos(at_ns.saturating_add(offset)) - least)
    }
    /// Restarts of the source's clock.
    pub fn restarts(&self) -> u64 {
        self.restarts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const APART_NS: i64 = -77_000_000_000;

    #[test]
    fn source_clock_with_arrival_jitter() {
        let mut c = SourceClock::default();
        let least = Span::from_millis(5);
        let mut errors = Vec::new();
        for k in 0..600_i64 {
            let made = Time::<VesselClock>::from_secs(100.0 + 0.1 * k as f64);
            let delay = Span::from_millis(5 + (k * 37) % 60);
            let at = c
                .vessel_time(made + delay, made.nanos() + APART_NS, least)
                .unwrap();
            errors.push((at - made).secs());
        }
        assert!(errors[..60].iter().all(|e| (0.0..0.06).contains(e)));
        assert!(errors[60..].iter().all(|e| e.abs() < 1e-3), "{:?}", errors.last());
    }

    #[test]
    fn source_clock_with_a_wrong_time_and_a_restart() {
        let mut c = SourceClock::default();
        let step = |c: &mut SourceClock, k: i64, source_ns: i64| {
            c.vessel_time(Time::from_secs(100.0 + 0.1 * k as f64), source_ns, Span::ZERO)
        };
        for k in 0..20 {
            assert!(step(&mut c, k, k * 100_000_000).is_some());
        }
        for wild in [i64::MAX, i64::MIN, 86_400_000_000_000] {
            assert!(step(&mut c, 20, wild).is_none());
        }
        assert!(step(&mut c, 21, 2_100_000_000).is_some());
        let again = |k: i64| (k - 22) * 100_000_000;
        let taken = (22..60).filter(|k| step(&mut c, *k, again(*k)).is_some()).count();
        assert_eq!((taken, c.restarts()), (29, 1));
        let at = step(&mut c, 60, again(60)).unwrap();
        assert!((at.secs() - 106.0).abs() < 0.01, "{at:?}");
    }
}
