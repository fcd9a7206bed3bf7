//! Offset between a sensor's clock and the local clock.
//!
//! A sensor does not answer time requests, but no measurement arrives before it is made. The smallest difference between
//! arrival and source time is the clock offset plus the minimum delay, from which the configured latency may be subtracted.
//! Measurements keep their source's intervals, however long each was delayed.
//!
//! The offset grows at most by the drift of two quartz clocks, so measurements that arrive later and later, or at once
//! much later, are late: a full line, a congested network. Only the sender shows a step of its clock: it repeats times that
//! it has sent, or was silent on its own clock. A wrong time stamp in the future makes the difference small as well. No
//! other measurement confirms it, and then the offset that it replaced is valid again.

use super::OffsetBounds;
use crate::time::{Clock, Span, Time};

/// Drift between two quartz clocks, s/s.
pub const CLOCK_DRIFT: f64 = 1e-4;
/// Largest step ahead that is used before it is confirmed, s, and silence after which a source may have another clock.
const MAX_DELAY_S: f64 = 2.0;
/// Maximum arrival jitter, s; also about the maximum age of an admitted fix or heading.
pub const JITTER_S: f64 = 0.3;
/// Time for which consecutive stamps must deviate by the same amount before the clock counts as stepped, s. A clock set
/// back (as at a leap second) repeats stamps while messages arrive; with a clock set forward, measurements would arrive
/// before they were made. Two stamps at 1 Hz with jitter are sufficient.
const STEPPED_S: f64 = 1.0 - JITTER_S;
/// Time of consistent stamps after a silence of the source, s: a backlog is cleared by then.
const HELD_UP_S: f64 = 10.0;
/// Maximum difference at which another offset confirms a smaller one, s.
const SUPPORT_S: f64 = 0.03;
/// Time between two confirmations after which an offset is certain, s, and time after which it is discarded otherwise:
/// with a growing delay, the later offsets then differ by more than [`SUPPORT_S`].
const CERTAIN_S: f64 = 1.0;
const UNSUPPORTED_S: f64 = 3.0;
/// Larger offsets that discard one or show that a replaced one is valid again.
const LATER: u32 = 3;

/// Estimate of a source's clock offset.
#[derive(Clone, Debug, Default)]
pub struct SourceClock<C: Clock> {
    /// Local clock minus source clock, at the last update.
    offset: Option<Smallest<C>>,
    /// Best confirmed offset that a smaller one has replaced.
    replaced: Option<Smallest<C>>,
    /// Newest consecutive offsets that agree with each other, but not with the one in use.
    other: Option<Other<C>>,
    /// Newest source time, ns, and its offset.
    newest: Option<(i64, Span)>,
    /// Number of restarts and steps of the source's clock.
    pub restarts: u64,
    /// Change of the source's clock at its newest restart or step, s, forward positive.
    pub step_s: f64,
}

#[derive(Clone, Copy, Debug)]
struct Smallest<C: Clock> {
    bounds: OffsetBounds<C>,
    /// Times of the first and the newest offset that confirm it.
    since: Time<C>,
    supported: Time<C>,
}

impl<C: Clock> Smallest<C> {
    fn new(bounds: OffsetBounds<C>) -> Self {
        Smallest {
            bounds,
            since: bounds.at,
            supported: bounds.at,
        }
    }
    /// Time between the first and the newest confirmation, s.
    fn confirmed_s(&self) -> f64 {
        (self.supported - self.since).secs()
    }
}

#[derive(Clone, Copy, Debug)]
struct Other<C: Clock> {
    min: Span,
    max: Span,
    count: u32,
    since: Time<C>,
    /// Time for which they must last to be a step, s; infinite if the sender shows no step.
    step_s: f64,
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
        let newest = self.newest.replace((at_ns, measured.high));
        let Some(known) = self.offset else {
            self.offset = Some(Smallest::new(measured));
            return Some(now - latency);
        };
        // Smallest offset so far, plus the maximum drift since then.
        let bounds = known.bounds.drifted(now, CLOCK_DRIFT);
        let known = Smallest { bounds, ..known };
        let excess_s = (measured.high - bounds.high).secs();
        if (-MAX_DELAY_S..=SUPPORT_S).contains(&excess_s) {
            self.other = None;
            self.confirm(known, measured, excess_s);
        } else {
            let other = self.other(measured, step_s(newest, at_ns, measured.high, excess_s));
            if other.count >= 2 && (now - other.since).secs() >= other.step_s {
                self.restarts += 1;
                self.step_s = (bounds.high - other.min).secs();
                let high = other.min;
                self.restart(Smallest::new(OffsetBounds { high, ..measured }));
            } else if excess_s.abs() > MAX_DELAY_S && other.step_s.is_finite() {
                return None;
            } else {
                self.offset = Some(known);
                self.later(known, other, measured.high);
            }
        }
        Some(Time::from_nanos(at_ns) + self.offset?.bounds.high - latency)
    }
    fn restart(&mut self, offset: Smallest<C>) {
        self.offset = Some(offset);
        (self.replaced, self.other) = (None, None);
    }
    /// Adds an offset to those that agree with each other but not with the known one.
    fn other(&mut self, measured: OffsetBounds<C>, step_s: f64) -> Other<C> {
        let high = measured.high;
        let own = Other {
            min: high,
            max: high,
            count: 1,
            since: measured.at,
            step_s,
        };
        let joined = self.other.map_or(own, |other| Other {
            min: other.min.min(high),
            max: other.max.max(high),
            count: other.count.saturating_add(1),
            ..other
        });
        // The offset of a running clock is constant; it drifts if the clock stands still or a backlog is cleared.
        let agrees = joined.max - joined.min <= Span::from_secs(JITTER_S);
        *self.other.insert(if agrees { joined } else { own })
    }
    /// Takes an offset that confirms the known one, or is smaller.
    fn confirm(&mut self, known: Smallest<C>, measured: OffsetBounds<C>, excess_s: f64) {
        if excess_s < -SUPPORT_S {
            let best = self.replaced.unwrap_or(known);
            let is_better = best.confirmed_s() > known.confirmed_s();
            self.replaced = Some(if is_better { best } else { known });
            self.offset = Some(Smallest::new(measured));
            return;
        }
        if known.confirmed_s() > HELD_UP_S {
            self.replaced = None;
        }
        self.offset = Some(Smallest {
            bounds: known.bounds.and(measured),
            supported: measured.at,
            ..known
        });
    }
    /// Takes an offset that is larger than the known one, which ends if it was that of a wrong stamp.
    fn later(&mut self, known: Smallest<C>, other: Other<C>, newest: Span) {
        let now = known.bounds.at;
        let for_s = (now - other.since).secs();
        if other.count < LATER || for_s < CERTAIN_S {
            return;
        }
        let mut high = other.min;
        if let Some(replaced) = self.replaced {
            let bounds = replaced.bounds.drifted(now, CLOCK_DRIFT);
            if (high - bounds.high).secs().abs() <= 2.0 * SUPPORT_S {
                return self.restart(Smallest { bounds, ..replaced });
            }
            high = high.min(bounds.high);
        }
        let grows = (newest - other.min).secs() > SUPPORT_S;
        let is_certain = known.confirmed_s() >= CERTAIN_S || (now - known.since).secs() > HELD_UP_S;
        if for_s >= UNSUPPORTED_S && !grows && !is_certain {
            self.offset = Some(Smallest::new(OffsetBounds { high, ..known.bounds }));
            self.other = None;
        }
    }
}

/// Time for which offsets like `measured` must last to show a step of the sender's clock, s; infinite without a sign of
/// one. A slow line also repeats the time of an epoch, but not for [`STEPPED_S`].
fn step_s(newest: Option<(i64, Span)>, at_ns: i64, measured: Span, excess_s: f64) -> f64 {
    let (newest_ns, newest) = newest.unwrap_or((at_ns, measured));
    let after_s = Span::from_nanos(at_ns.saturating_sub(newest_ns)).secs();
    let later_s = (measured - newest).secs();
    let is_repeated = after_s == 0.0 && later_s >= STEPPED_S;
    if excess_s < 0.0 || after_s < 0.0 || is_repeated {
        STEPPED_S
    } else if after_s > MAX_DELAY_S && later_s.abs() > JITTER_S {
        // A full line that loses a part is as late as before.
        HELD_UP_S
    } else {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::VesselClock;
    use proptest::prelude::*;

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
        assert_eq!(c.restarts, 1);
        let at = step(&mut c, 60, again(60)).unwrap();
        assert!((at.secs() - 106.0).abs() < 0.01, "{at:?}");
    }

    /// Errors of the local times of a clock that steps after 60 s, on a line with a delay, at 1 or 5 Hz with jitter.
    fn dated(
        hz: f64,
        step_s: f64,
        delay_s: impl Fn(f64) -> f64,
    ) -> (Vec<(f64, f64)>, SourceClock<VesselClock>) {
        let mut c = SourceClock::<VesselClock>::default();
        let mut out = Vec::new();
        let jitter_s = if hz < 2.0 { 0.18 } else { 0.05 };
        for k in 0..(120.0 * hz) as i64 {
            let made_s = k as f64 / hz;
            let arrives_s = made_s + delay_s(made_s) + jitter_s * ((k * 37) % 10) as f64 / 10.0;
            if !arrives_s.is_finite() {
                continue;
            }
            let source_s = made_s + if made_s >= 60.0 { step_s } else { 0.0 };
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
            for hz in [1.0, 5.0] {
                let (errors, c) = dated(hz, step_s, |_| 0.0);
                let late = errors.iter().filter(|(at, _)| *at >= 61.1);
                assert!(late.count() as f64 >= 58.0 * hz, "{step_s}");
                for (at, e) in errors.iter().filter(|(at, _)| *at < 60.0 || *at >= 61.1) {
                    assert!(e.abs() < 0.2, "{step_s} at {at}: {e}");
                }
                // A forward step is visible at once in the smallest offset.
                let counted = u64::from(!(0.0..=MAX_DELAY_S).contains(&step_s));
                assert_eq!(c.restarts, counted, "{step_s}");
                assert!(counted == 0 || (c.step_s - step_s).abs() < 0.2, "{}", c.step_s);
            }
        }
    }

    #[test]
    fn source_clock_of_a_line_that_delays() {
        let held_up = |for_s: f64| {
            move |t: f64| {
                if t < 60.0 {
                    0.0
                } else {
                    (60.0 + for_s - t).max(0.0)
                }
            }
        };
        let full = |rate: f64| move |t: f64| (rate * t).min(3.5);
        let overflows = |t: f64| {
            if (80.0..83.0).contains(&t) {
                f64::NAN
            } else {
                full(0.06)(t)
            }
        };
        let burst = |t: f64| if (20.0..45.0).contains(&t) { 1.5 } else { 0.0 };
        for hz in [1.0, 5.0] {
            for (errors, c) in [
                dated(hz, 0.0, |_| 0.0),
                dated(hz, 0.0, held_up(1.5)),
                dated(hz, 0.0, held_up(5.0)),
                dated(hz, 0.0, full(0.008)),
                dated(hz, 0.0, full(0.02)),
                dated(hz, 0.0, full(0.06)),
                dated(hz, 0.0, burst),
                dated(hz, 0.0, overflows),
            ] {
                assert!(errors.len() as f64 >= 116.0 * hz && c.restarts == 0);
                assert!(errors.iter().all(|(_, e)| e.abs() < 0.1), "{errors:?}");
            }
        }
    }

    #[test]
    fn source_clock_that_stands_still() {
        let mut c = SourceClock::<VesselClock>::default();
        for k in 0..600_i64 {
            let now = Time::<VesselClock>::from_secs(100.0 + 0.1 * k as f64);
            c.local_time(now, k.min(100) * 100_000_000, Span::ZERO);
        }
        assert_eq!(c.restarts, 0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(96))]
        /// After a run of stamps in the future, local times are correct again within the length of the run plus 4 s.
        #[test]
        fn source_clock_after_runs_of_stamps_ahead(
            hz in 5_i64..50,
            runs in prop::collection::vec((0.0_f64..1.9, 1_i64..30, 1_i64..20), 1..4),
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
                    prop_assert!(error_s.abs() < 2.0 * SUPPORT_S, "{error_s} at {made_s} after {run:?}");
                }
            }
        }
    }
}
