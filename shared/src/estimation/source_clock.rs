//! Offset between a sensor's clock and the local clock.
//!
//! A sensor does not answer time requests, but no measurement arrives before it is made. The smallest difference between
//! arrival and source time is the clock offset plus the minimum delay, from which the configured latency may be subtracted.
//! Measurements keep their source's intervals, however long each was delayed.
//!
//! A wrong time stamp in the future also makes the difference small. No other measurement confirms it, so it
//! is discarded after a timeout.

use super::OffsetBounds;
use crate::time::{Clock, Span, Time};

/// Drift between two quartz clocks, s/s.
pub const CLOCK_DRIFT: f64 = 1e-4;
/// Maximum deviation from the offset that a delay explains, s. Beyond it, the stamp is wrong or the source restarted.
const MAX_DELAY_S: f64 = 2.0;
/// Consecutive stamps, all shifted by the same amount beyond any delay, that indicate a restart of the source.
const AGREEING: u32 = 10;
/// Maximum arrival jitter, s; also about the maximum age of an admitted fix or heading.
pub const JITTER_S: f64 = 0.3;
/// Time for which consecutive stamps must deviate by the same amount, which no delay explains, before the clock
/// counts as stepped, s. A clock set back (as at a leap second) repeats stamps while messages arrive; with a clock
/// set forward, measurements would arrive before they were made. Two stamps at 1 Hz with jitter are sufficient.
const STEPPED_S: f64 = 1.0 - JITTER_S;
/// Time after which a lasting deviation that a delay could explain counts as a step, s: a backlog is cleared by then.
pub const HELD_UP_S: f64 = 10.0;
/// Maximum difference at which another offset confirms a smaller one, s.
const SUPPORT_S: f64 = 0.03;
/// Time without confirmation after which an offset is discarded, s. At least [`AGREEING`] larger offsets must have arrived
/// by then, and the confirmation must have lasted for a shorter time, because a line may be congested.
const UNSUPPORTED_S: f64 = 3.0;

/// Estimate of a source's clock offset.
#[derive(Clone, Debug, Default)]
pub struct SourceClock<C: Clock> {
    /// Local clock minus source clock, at the last update.
    offset: Option<Smallest<C>>,
    /// A different offset that was observed since the last update.
    other: Option<Other<C>>,
    /// Newest source time, ns.
    newest_ns: Option<i64>,
    restarts: u64,
    /// Change of the source's clock at its newest restart, s, forward positive.
    step_s: f64,
}

#[derive(Clone, Copy, Debug)]
struct Smallest<C: Clock> {
    bounds: OffsetBounds<C>,
    /// Times of the first and the newest offset that confirm it.
    since: Time<C>,
    supported: Time<C>,
    /// Smallest of the later offsets that do not confirm this one, and their number.
    later: (Span, u32),
}

impl<C: Clock> Smallest<C> {
    fn new(bounds: OffsetBounds<C>) -> Self {
        Smallest {
            bounds,
            since: bounds.at,
            supported: bounds.at,
            later: (Span::MAX, 0),
        }
    }
    /// Smaller of `measured` and this offset propagated as `drifted`; if this offset is unconfirmed, the smallest later one.
    fn and(self, drifted: OffsetBounds<C>, measured: OffsetBounds<C>) -> Self {
        let now = measured.at;
        let excess_s = (measured.high - drifted.high).secs();
        if excess_s <= SUPPORT_S {
            // A smaller offset inherits only part of the confirmation.
            let lost = (-excess_s / SUPPORT_S).clamp(0.0, 1.0);
            return Smallest {
                since: self.since + Span::from_secs(lost * (now - self.since).secs()),
                ..Smallest::new(drifted.and(measured))
            };
        }
        let (later, count) = (self.later.0.min(measured.high), self.later.1.saturating_add(1));
        let without_s = (now - self.supported).secs();
        let with_s = (self.supported - self.since).secs();
        if count >= AGREEING && without_s > with_s.max(UNSUPPORTED_S) {
            return Smallest::new(OffsetBounds {
                high: later,
                ..measured
            });
        }
        Smallest {
            bounds: drifted,
            later: (later, count),
            ..self
        }
    }
}

/// Consecutive offsets that agree with each other, but not with the one in use.
#[derive(Clone, Copy, Debug)]
struct Other<C: Clock> {
    /// Range of the offsets.
    min: Span,
    max: Span,
    count: u32,
    since: Time<C>,
    /// Whether the first time stamp cannot be explained by a delay.
    stepped: bool,
}

/// Unwraps a time that wraps every `PERIOD_NS` (time of day, time of week).
#[derive(Clone, Copy, Debug, Default)]
pub struct Rollover<const PERIOD_NS: i64> {
    periods: i64,
    /// Newest unwrapped time, ns.
    pub last: Option<i64>,
}

impl<const PERIOD_NS: i64> Rollover<PERIOD_NS> {
    /// Unwrapped time nearest to the previous one.
    pub fn unwrap(&mut self, in_period_ns: i64) -> i64 {
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

impl<C: Clock> SourceClock<C> {
    /// Local time of a measurement stamped `at_ns`, which arrives at `now`, at least `latency` after it was
    /// made; None if implausible.
    pub fn local_time(&mut self, now: Time<C>, at_ns: i64, latency: Span) -> Option<Time<C>> {
        let measured = OffsetBounds::of_message(at_ns, now);
        let max_delay = Span::from_secs(MAX_DELAY_S);
        let Some(known) = self.offset else {
            (self.offset, self.newest_ns) = (Some(Smallest::new(measured)), Some(at_ns));
            return Some(now - latency);
        };
        // Smallest offset so far, plus the maximum drift since then.
        let drifted = known.bounds.drifted(now, CLOCK_DRIFT);
        let excess = measured.high - drifted.high;
        // A clock that was set back repeats a time while messages keep arriving.
        let again = self.newest_ns.replace(at_ns).is_some_and(|shown| at_ns <= shown);
        if excess <= Span::from_secs(JITTER_S) && excess >= -max_delay {
            self.other = None;
            self.offset = Some(known.and(drifted, measured));
        } else if let Some(high) = self.deviates(now, measured.high, excess, again) {
            self.restarts += 1;
            self.step_s = (drifted.high - high).secs();
            self.offset = Some(Smallest::new(OffsetBounds { high, ..measured }));
            self.other = None;
        } else if excess.abs() > max_delay {
            return None;
        } else if excess > Span::ZERO {
            // Jitter moves offsets across the limit, so later ones on both sides count against this one.
            self.offset = Some(known.and(drifted, measured));
        }
        Some(Time::from_nanos(at_ns) + self.offset?.bounds.high - latency)
    }
    /// Counts an offset that deviates by `excess`; `again` if its stamp was repeated. Returns the offset once confirmed.
    fn deviates(&mut self, now: Time<C>, measured: Span, excess: Span, again: bool) -> Option<Span> {
        let is_delay = excess.abs() <= Span::from_secs(MAX_DELAY_S);
        let own = Other {
            min: measured,
            max: measured,
            count: 1,
            since: now,
            // Two delayed messages with the same time do not show that a clock was set back.
            stepped: excess < Span::ZERO || self.other.map_or(again, |o| o.stepped),
        };
        let other = self.other.map_or(own, |o| Other {
            min: o.min.min(measured),
            max: o.max.max(measured),
            count: o.count.saturating_add(1),
            ..o
        });
        // The offset of a running clock is constant; it drifts if the clock stands still or a backlog is cleared.
        let agrees = other.max - other.min <= Span::from_secs(JITTER_S);
        let other = if agrees { other } else { own };
        self.other = Some(other);
        let (enough, long_enough) = match (other.stepped, is_delay) {
            (true, _) => (2, STEPPED_S),
            (false, true) => (2, HELD_UP_S),
            (false, false) => (AGREEING, STEPPED_S),
        };
        let for_s = (now - other.since).secs();
        (other.count >= enough && for_s >= long_enough).then_some(other.min)
    }
    /// Number of restarts and steps of the source's clock.
    pub fn restarts(&self) -> u64 {
        self.restarts
    }
    /// Change of the source's clock at its newest restart or step, s, forward positive.
    pub fn step_s(&self) -> f64 {
        self.step_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::VesselClock;
    use proptest::prelude::*;

    const APART_NS: i64 = -77_000_000_000;

    #[test]
    fn source_clock_with_arrival_jitter() {
        let mut c = SourceClock::<VesselClock>::default();
        let latency = Span::from_millis(5);
        let mut errors = Vec::new();
        for k in 0..600_i64 {
            let made = Time::<VesselClock>::from_secs(100.0 + 0.1 * k as f64);
            let delay = Span::from_millis(5 + (k * 37) % 60);
            let at = c
                .local_time(made + delay, made.nanos() + APART_NS, latency)
                .unwrap();
            errors.push((at - made).secs());
        }
        assert!(errors[..60].iter().all(|e| (0.0..0.06).contains(e)));
        assert!(errors[60..].iter().all(|e| e.abs() < 1e-3), "{:?}", errors.last());
    }

    #[test]
    fn source_clock_with_a_wrong_time_and_a_restart() {
        let mut c = SourceClock::<VesselClock>::default();
        let step = |c: &mut SourceClock<VesselClock>, k: i64, source_ns: i64| {
            c.local_time(Time::from_secs(100.0 + 0.1 * k as f64), source_ns, Span::ZERO)
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
        assert!((30..=31).contains(&taken), "{taken}");
        assert_eq!(c.restarts(), 1);
        let at = step(&mut c, 60, again(60)).unwrap();
        assert!((at.secs() - 106.0).abs() < 0.01, "{at:?}");
    }

    /// Errors of the local times from `from` s on, at 5 Hz with 50 ms jitter; None for a rejected time.
    fn dated(
        step_at_s: f64,
        step_s: f64,
        held_up: Option<(f64, f64)>,
        until_s: f64,
    ) -> (Vec<(f64, f64)>, SourceClock<VesselClock>) {
        let mut c = SourceClock::<VesselClock>::default();
        let mut out = Vec::new();
        for k in 0..(5.0 * until_s) as i64 {
            let made_s = 0.2 * k as f64;
            let jitter = 0.05 * ((k * 37) % 10) as f64 / 10.0;
            let arrives_s = match held_up {
                Some((from, to)) if (from..to).contains(&made_s) => to + 0.001 * made_s,
                _ => made_s + jitter,
            };
            let source_s = made_s + if made_s >= step_at_s { step_s } else { 0.0 };
            let now = Time::<VesselClock>::from_secs(100.0 + arrives_s);
            let at = c.local_time(now, (source_s * 1e9) as i64, Span::ZERO);
            out.extend(at.map(|at| (made_s, at.secs() - 100.0 - made_s)));
        }
        (out, c)
    }

    #[test]
    fn source_clock_across_a_step_of_utc() {
        // Steps of a leap second, a receiver's first almanac, and an hour after midnight in a wrong time zone.
        for step_s in [-1.0, 1.0, -2.0, -3.0, -40.0, 2.5, 3600.0, -3600.0] {
            let (errors, c) = dated(60.0, step_s, None, 90.0);
            let late = errors.iter().filter(|(at, _)| *at >= 61.1);
            assert!(late.clone().count() >= 144, "{step_s}: {} of 144", late.count());
            for (at, e) in errors.iter().filter(|(at, _)| *at < 60.0 || *at >= 61.1) {
                assert!(e.abs() < 0.06, "{step_s} at {at}: {e}");
            }
            // A forward step is visible at once in the smallest offset.
            let counted = u64::from(!(0.0..=MAX_DELAY_S).contains(&step_s));
            assert_eq!(c.restarts(), counted, "{step_s}");
            if counted > 0 {
                assert!((c.step_s() - step_s).abs() < 0.06, "{}", c.step_s());
            }
        }
    }

    #[test]
    fn source_clock_of_one_hertz_across_a_step() {
        for step_s in [-1.0, -3.0, -40.0, 3.0, 3600.0] {
            let mut c = SourceClock::<VesselClock>::default();
            let right = |k: &i64| {
                let jitter_s = 0.02 * ((k * 37) % 10) as f64;
                let now = Time::<VesselClock>::from_secs(100.0 + *k as f64 + jitter_s);
                let source_s = *k as f64 + if *k >= 60 { step_s } else { 0.0 };
                let at = c.local_time(now, (source_s * 1e9) as i64, Span::ZERO);
                at.is_some_and(|at| (at.secs() - 100.0 - *k as f64).abs() < 0.2)
            };
            let count = (0..120).filter(right).count();
            assert!(count >= 119, "{step_s}: {count} of 120");
            assert_eq!(c.restarts(), 1, "{step_s}");
        }
    }

    #[test]
    fn source_clock_while_the_line_is_held_up() {
        // Messages are held up for 1.5 or 5 s: their local times stay correct.
        for held_up_s in [1.5, 5.0] {
            let (errors, c) = dated(1e9, 0.0, Some((60.0, 60.0 + held_up_s)), 120.0);
            assert_eq!(c.restarts(), 0);
            assert!(errors.iter().all(|(_, e)| e.abs() < 0.06), "{errors:?}");
        }
    }

    #[test]
    fn source_clock_that_stands_still() {
        let mut c = SourceClock::<VesselClock>::default();
        for k in 0..600_i64 {
            let now = Time::<VesselClock>::from_secs(100.0 + 0.1 * k as f64);
            c.local_time(now, k.min(100) * 100_000_000, Span::ZERO);
        }
        assert_eq!(c.restarts(), 0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(96))]
        /// After a run of stamps in the future, local times are correct again within the length of the run plus 4 s.
        #[test]
        fn source_clock_after_runs_of_stamps_ahead(
            hz in 5_i64..50,
            runs in prop::collection::vec((0.0_f64..1.9, 1_i64..30, 0_i64..20), 1..4),
        ) {
            let mut c = SourceClock::<VesselClock>::default();
            for k in 0..60 * hz {
                let made_s = k as f64 / hz as f64;
                let run = runs.get(k as usize / (20 * hz) as usize).copied().unwrap_or((0.0, 0, 0));
                let (ahead_s, stamps, begin) = run;
                let since = k % (20 * hz) - begin;
                let wrong = (0..stamps).contains(&since);
                let jitter_s = 0.02 * ((k * 37) % 10) as f64 / 10.0;
                let source_s = made_s + if wrong { ahead_s } else { 0.0 };
                let now = Time::<VesselClock>::from_secs(100.0 + made_s + jitter_s);
                let at = c.local_time(now, (source_s * 1e9) as i64, Span::ZERO);
                if since > 2 * stamps + 4 * hz || since < 0 {
                    let error_s = at.map_or(f64::NAN, |at| at.secs() - 100.0 - made_s);
                    prop_assert!(error_s.abs() < 0.05, "{error_s} at {made_s} after {run:?}");
                }
            }
        }
    }

    #[test]
    fn source_clock_after_one_stamp_ahead() {
        let mut c = SourceClock::<VesselClock>::default();
        let mut errors = Vec::new();
        for k in 0..300_i64 {
            let made = Time::<VesselClock>::from_secs(100.0 + 0.1 * k as f64);
            let wrong = if k == 100 { 1_500_000_000 } else { 0 };
            let at = c.local_time(made, made.nanos() + wrong, Span::ZERO);
            errors.extend(at.filter(|_| k != 100).map(|at| (k, (at - made).secs())));
        }
        let late = errors.iter().filter(|(k, e)| *k > 125 && e.abs() > 0.01).count();
        assert_eq!(late, 0, "{errors:?}");
    }
}
