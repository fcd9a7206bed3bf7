//! The autopilot's clock against the companion's, by MAVLink's TIMESYNC.
//!
//! A request carries our time `t0`; the answer adds the autopilot's `ta` and arrives at `t1`. The offset
//! ours - theirs is `(t0 + t1) / 2 - ta`, wrong by at most half of the round trip. So the quickest of the
//! last answers is used, its uncertainty growing by what the clocks may drift.

use std::collections::VecDeque;

use alight_shared::time::{Span, Time};
use serde::{Deserialize, Serialize};

use super::DroneTime;

/// Answers kept.
const MAX_EXCHANGES: usize = 20;
/// Drift between two crystals, s/s.
const DRIFT: f64 = 1e-4;
/// Offsets further apart than this, s, with the autopilot's clock behind: it restarted.
const RESTART_S: f64 = 0.5;
/// Two offsets that are further apart than both may err, and this, s: a clock has stepped.
const STEPPED_S: f64 = 0.02;
/// A sample is never older than this when it arrives, s.
const MAX_SAMPLE_AGE_S: f64 = 1.0;

/// An exchange.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Exchange {
    at: DroneTime,
    offset_ns: i64,
    round_trip: Span,
}

impl Exchange {
    /// Present uncertainty of the offset, s.
    fn uncertainty_s(&self, now: DroneTime) -> f64 {
        0.5 * self.round_trip.secs() + DRIFT * (now - self.at).secs()
    }
}

/// State of knowledge of the autopilot's clock.
#[derive(Clone, Debug, Default)]
pub(crate) struct RemoteClock {
    exchanges: VecDeque<Exchange>,
    /// Answers that were not used, samples whose time was impossible.
    pub(crate) rejected: u32,
    /// Restarts of the autopilot.
    pub(crate) restarts: u32,
    /// The autopilot's clock went ahead of ours, which stood still with this computer: known since, and for how long, s.
    stood_still: Option<(DroneTime, f64)>,
}

impl RemoteClock {
    /// An answer arrived at `now`: our time in the request, the autopilot's in the answer, ns.
    pub(crate) fn answered(&mut self, now: DroneTime, asked_ns: i64, remote_ns: i64, limit_s: f64) {
        let round_trip = now - Time::from_nanos(asked_ns);
        if !(0.0..=limit_s).contains(&round_trip.secs()) {
            self.rejected = self.rejected.saturating_add(1);
            return;
        }
        let half = round_trip / 2;
        let exchange = Exchange {
            at: now,
            offset_ns: asked_ns.saturating_add(half.nanos()).saturating_sub(remote_ns),
            round_trip,
        };
        if let Some((before, error_s)) = self.offset(now) {
            let ahead_s = Span::from_nanos(before.saturating_sub(exchange.offset_ns)).secs();
            if ahead_s.abs() > error_s + exchange.uncertainty_s(now) + STEPPED_S {
                // What was exchanged before dates nothing any more.
                self.exchanges.clear();
            }
            if ahead_s < -RESTART_S {
                self.restarts = self.restarts.saturating_add(1);
            }
        }
        self.exchanges.push_back(exchange);
        if self.exchanges.len() > MAX_EXCHANGES {
            self.exchanges.pop_front();
        }
    }
    /// Ours minus theirs, ns.
    fn offset_ns(&self, now: DroneTime) -> Option<i64> {
        let best = self
            .exchanges
            .iter()
            .min_by(|a, b| a.uncertainty_s(now).total_cmp(&b.uncertainty_s(now)))?;
        Some(best.offset_ns)
    }
    /// Ours minus theirs, ns, and by how much it may be wrong, s; None while it is not known.
    pub(crate) fn offset(&self, now: DroneTime) -> Option<(i64, f64)> {
        Some((self.offset_ns(now)?, self.uncertainty_s(now)))
    }
    /// Begins with an offset that was known at `now`, wrong by at most `error_s`.
    pub(crate) fn resume(&mut self, now: DroneTime, offset_ns: i64, error_s: f64) {
        self.exchanges.push_back(Exchange {
            at: now,
            offset_ns,
            round_trip: Span::from_secs(2.0 * error_s),
        });
    }
    /// Whether samples can be dated.
    pub(crate) fn is_synchronised(&self) -> bool {
        !self.exchanges.is_empty()
    }
    /// Uncertainty of the offset, s; infinite while it is not known.
    pub(crate) fn uncertainty_s(&self, now: DroneTime) -> f64 {
        self.exchanges
            .iter()
            .map(|e| e.uncertainty_s(now))
            .fold(f64::INFINITY, f64::min)
    }
    /// Our time of a sample that the autopilot dates at `remote_ns`; None, and counted, when it lies
    /// ahead of `now` by more than the uncertainty or is far too old. A little ahead counts as now.
    pub(crate) fn local_time(&mut self, now: DroneTime, remote_ns: i64) -> Option<DroneTime> {
        let offset = self.offset_ns(now)?;
        let at = Time::from_nanos(remote_ns.saturating_add(offset));
        let age = (now - at).secs();
        if age < -(STEPPED_S + self.uncertainty_s(now)) {
            let before = self.stood_still(now).map_or(0.0, |(_, s)| s);
            self.stood_still = Some((now, before.max(-age)));
        }
        if !(-0.01 - self.uncertainty_s(now)..=MAX_SAMPLE_AGE_S).contains(&age) {
            self.rejected = self.rejected.saturating_add(1);
            return None;
        }
        Some(at.min(now))
    }
    /// This computer stood still with its clock, as samples show that are dated ahead of it: since when that is known, and for
    /// how long it did, s. For a while: they are dated again with the next answer.
    pub(crate) fn stood_still(&self, now: DroneTime) -> Option<(DroneTime, f64)> {
        self.stood_still
            .filter(|(at, _)| (now - *at).secs() <= MAX_SAMPLE_AGE_S)
    }
    /// The autopilot's time of ours, us; 0 while it is not known.
    pub(crate) fn remote_time_us(&self, now: DroneTime, at: DroneTime) -> u64 {
        let ns = self
            .offset_ns(now)
            .map_or(0, |o| at.nanos().saturating_sub(o).max(0));
        ns.unsigned_abs() / 1000
    }
    /// The autopilot is another one, or was away.
    pub(crate) fn forget(&mut self) {
        self.exchanges.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The autopilot's clock is ours less 100 s.
    const APART_NS: i64 = 100_000_000_000;

    fn ask(c: &mut RemoteClock, at_s: f64, there_s: f64, back_s: f64) {
        let t0 = DroneTime::from_secs(at_s);
        let then = t0 + Span::from_secs(there_s);
        let now = then + Span::from_secs(back_s);
        c.answered(now, t0.nanos(), then.nanos() - APART_NS, 0.1);
    }

    #[test]
    fn timesync_offset_by_the_quickest_answer() {
        let mut c = RemoteClock::default();
        assert!(!c.is_synchronised() && c.local_time(Time::from_secs(1.0), 0).is_none());
        ask(&mut c, 200.0, 0.030, 0.002);
        ask(&mut c, 200.2, 0.001, 0.001);
        ask(&mut c, 200.4, 0.002, 0.050);
        let now = Time::from_secs(201.0);
        let at = c.local_time(now, now.nanos() - APART_NS - 20_000_000).unwrap();
        assert!(((now - at).secs() - 0.020).abs() < 1e-4);
        assert!(c.uncertainty_s(now) < 0.002);
    }

    #[test]
    fn timesync_slow_answers_and_impossible_times() {
        let mut c = RemoteClock::default();
        ask(&mut c, 200.0, 0.2, 0.2);
        assert!(!c.is_synchronised() && c.rejected == 1);
        ask(&mut c, 201.0, 0.001, 0.001);
        let now = Time::from_secs(202.0);
        assert!(c.local_time(now, now.nanos() - APART_NS + 50_000_000).is_none());
        assert!(
            c.local_time(now, now.nanos() - APART_NS - 5_000_000_000)
                .is_none()
        );
        assert!(c.local_time(now, i64::MIN).is_none() && c.local_time(now, i64::MAX).is_none());
        assert_eq!(c.rejected, 5);
    }

    /// This computer was suspended with its clock, for less and for more than a restart takes: that is no restart, and samples are
    /// dated again by the next answer.
    #[test]
    fn timesync_after_a_suspended_computer() {
        for gap_s in [0.1, 0.3, 1.5, 20.0] {
            let mut c = RemoteClock::default();
            for k in 0..20 {
                ask(&mut c, 200.0 + 0.2 * f64::from(k), 0.001, 0.001);
            }
            let (now, gap) = (DroneTime::from_secs(204.1), Span::from_secs(gap_s));
            let remote = |now: DroneTime| (now + gap).nanos() - APART_NS;
            assert!(c.stood_still(now).is_none() && c.local_time(now, remote(now)).is_none());
            let found = c.stood_still(now).map_or(0.0, |(_, s)| s);
            assert!((found - gap_s).abs() < 0.01, "{found} s of {gap_s}");
            let back = now + Span::from_millis(10);
            c.answered(back, now.nanos(), remote(now) + 5_000_000, 0.1);
            let at = c.local_time(back, remote(back));
            assert!(at.is_some_and(|at| (back - at).secs() < 0.01), "{gap_s}: {at:?}");
            assert_eq!(c.restarts, 0, "{gap_s}");
        }
    }

    #[test]
    fn timesync_with_a_restarted_autopilot() {
        let mut c = RemoteClock::default();
        for k in 0..10 {
            ask(&mut c, 200.0 + 0.2 * f64::from(k), 0.0005, 0.0005);
        }
        // Its clock begins at zero again; the first answer is slower than all before.
        let t0 = DroneTime::from_secs(300.0);
        let now = t0 + Span::from_secs(0.02);
        c.answered(now, t0.nanos(), 1_000_000_000, 0.1);
        assert_eq!(c.restarts, 1);
        let at = c.local_time(now, 1_000_000_000).unwrap();
        assert!((now - at).secs() < 0.03);
    }
}
