//! Offset between the autopilot's clock and the companion's, by TIMESYNC.
//!
//! A request carries our time `t0`; the answer adds the autopilot's time `ta` and arrives at `t1`. The offset
//! (ours minus theirs) is `(t0 + t1) / 2 - ta`, with an error of at most half the round trip. The recent
//! answer with the shortest round trip is used; its uncertainty grows with clock drift. An answer may be
//! dated too early: on a serial line ArduPilot subtracts the transmission time of the bytes queued behind a
//! request. Several consecutive samples that seem to arrive before they were taken overrule the answer.

use std::collections::VecDeque;

use alight_shared::{
    admission::Periodic,
    estimation::OffsetBounds,
    mavlink::dialect::TIMESYNC_DATA,
    time::{DroneClock, Span, Time},
};

use super::DroneTime;

const MAX_REQUESTS: usize = 16;
const MAX_EXCHANGES: usize = 20;
const DRIFT: f64 = 1e-4;
/// Backward jump of the offset that indicates a restart of the autopilot's clock, s.
const RESTART_S: f64 = 0.5;
/// Difference between two offsets, beyond their errors, that indicates a clock step, s.
const STEPPED_S: f64 = 0.02;
const MAX_SAMPLE_AGE_S: f64 = 1.0;
/// Maximum time by which a sample may be ahead of its arrival, s; it is then dated at its arrival.
const AHEAD_S: f64 = 0.01;
/// Number and minimum duration (s) of consecutive samples dated ahead of their arrival that contradict an
/// answer. A single time stamp may be wrong, and samples of other streams arrive in between.
const SEVERAL: u32 = 5;
const SEVERAL_S: f64 = 0.05;

#[derive(Clone, Copy, Debug)]
struct AheadRun {
    since: DroneTime,
    count: u32,
    /// Largest offset that is consistent with a sample.
    high: Span,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct RemoteClock {
    /// Offsets, ours minus theirs.
    exchanges: VecDeque<OffsetBounds<DroneClock>>,
    /// Send times of the pending requests, on our clock, ns.
    requests: VecDeque<i64>,
    timer: Periodic<DroneClock>,
    pub(crate) rejected: u32,
    pub(crate) restarts: u32,
    /// Suspension of this computer together with its clock: time of detection, and duration in s.
    stood_still: Option<(DroneTime, f64)>,
    ahead: Option<AheadRun>,
}

impl RemoteClock {
    pub(crate) fn ask(&mut self, now: DroneTime, hz: f64) -> Option<TIMESYNC_DATA> {
        if !self.timer.is_due_spaced(now, Span::from_secs(1.0 / hz)) {
            return None;
        }
        self.requests.push_front(now.nanos());
        self.requests.truncate(MAX_REQUESTS);
        Some(TIMESYNC_DATA {
            ts1: now.nanos(),
            ..TIMESYNC_DATA::DEFAULT
        })
    }
    /// Processes a possible answer. Returns whether the autopilot has restarted.
    pub(crate) fn on_answer(&mut self, now: DroneTime, asked_ns: i64, remote_ns: i64, limit_s: f64) -> bool {
        let before = self.restarts;
        if let Some(k) = self.requests.iter().position(|q| *q == asked_ns) {
            self.requests.remove(k);
            self.answered(now, asked_ns, remote_ns, limit_s);
        }
        self.restarts != before
    }
    /// Processes an answer that arrived at `now`, with our time in the request and the autopilot's time in
    /// the answer, ns.
    fn answered(&mut self, now: DroneTime, asked_ns: i64, remote_ns: i64, limit_s: f64) {
        let asked = Time::from_nanos(asked_ns);
        if !(0.0..=limit_s).contains(&(now - asked).secs()) {
            self.rejected = self.rejected.saturating_add(1);
            return;
        }
        let exchange = OffsetBounds::of_exchange(asked, remote_ns, remote_ns, now);
        if let Some(before) = self.best(now) {
            let ahead_s = (before.middle() - exchange.middle()).secs();
            if ahead_s.abs() > before.error_s() + exchange.error_s() + STEPPED_S {
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
    fn best(&self, now: DroneTime) -> Option<OffsetBounds<DroneClock>> {
        let exchanges = self.exchanges.iter().map(|e| e.drifted(now, DRIFT));
        exchanges.min_by_key(|e| e.high - e.low)
    }
    /// Offset (ours minus theirs), ns, and its maximum error, s; None while unknown.
    pub(crate) fn offset(&self, now: DroneTime) -> Option<(i64, f64)> {
        self.best(now).map(|b| (b.middle().nanos(), b.error_s()))
    }
    pub(crate) fn resume(&mut self, now: DroneTime, offset_ns: i64, error_s: f64) {
        let middle = Span::from_nanos(offset_ns);
        let error = Span::from_secs(error_s);
        self.exchanges.push_back(OffsetBounds {
            at: now,
            low: middle - error,
            high: middle + error,
        });
    }
    pub(crate) fn is_synchronised(&self) -> bool {
        !self.exchanges.is_empty()
    }
    /// Uncertainty of the offset, s; infinite while unknown.
    pub(crate) fn uncertainty_s(&self, now: DroneTime) -> f64 {
        self.best(now).map_or(f64::INFINITY, OffsetBounds::error_s)
    }
    /// Our time of a sample dated `remote_ns` by the autopilot. A sample that is ahead of `now` by more than
    /// the uncertainty, or too old, gives None and is counted as rejected; a small lead is clamped.
    pub(crate) fn local_time(&mut self, now: DroneTime, remote_ns: i64) -> Option<DroneTime> {
        let offset = self.best(now)?;
        let at = Time::from_nanos(remote_ns) + offset.middle();
        let age = (now - at).secs();
        let error_s = offset.error_s();
        if age < -(STEPPED_S + error_s) {
            let before = self.stood_still(now).map_or(0.0, |(_, s)| s);
            self.stood_still = Some((now, before.max(-age)));
        }
        let allowed = OffsetBounds::of_message(remote_ns, now).high;
        self.ahead = (age < -error_s).then(|| match self.ahead {
            Some(run) => AheadRun {
                count: run.count.saturating_add(1),
                high: run.high.max(allowed),
                ..run
            },
            None => AheadRun {
                since: now,
                count: 1,
                high: allowed,
            },
        });
        if !(-AHEAD_S - error_s..=MAX_SAMPLE_AGE_S).contains(&age) {
            self.rejected = self.rejected.saturating_add(1);
            self.discard_contradicted(now);
            return None;
        }
        Some(at.min(now))
    }
    /// Discards answers that several consecutive samples contradict. If all are contradicted, keeps the one
    /// with the smallest lead, because this computer may have been suspended.
    fn discard_contradicted(&mut self, now: DroneTime) {
        let lasts = |run: &AheadRun| run.count >= SEVERAL && (now - run.since).secs() >= SEVERAL_S;
        let Some(run) = self.ahead.filter(lasts) else {
            return;
        };
        let lowest = self.exchanges.iter().map(|e| e.drifted(now, DRIFT).low).min();
        let limit = run.high.max(lowest.unwrap_or(run.high));
        self.exchanges.retain(|e| e.drifted(now, DRIFT).low <= limit);
        self.ahead = None;
    }
    /// Suspension of this computer together with its clock, inferred from samples ahead of the clock: time of
    /// detection, and duration in s. Reported until the next answer dates samples again.
    pub(crate) fn stood_still(&self, now: DroneTime) -> Option<(DroneTime, f64)> {
        self.stood_still
            .filter(|(at, _)| (now - *at).secs() <= MAX_SAMPLE_AGE_S)
    }
    /// Autopilot's time at the companion's time `at`, us; 0 while unknown.
    pub(crate) fn remote_time_us(&self, now: DroneTime, at: DroneTime) -> u64 {
        let theirs = self.best(now).map_or(Time::EPOCH, |b| at - b.middle());
        theirs.nanos().max(0).unsigned_abs() / 1000
    }
    pub(crate) fn forget(&mut self) {
        self.exchanges.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    /// Number of correctly dated samples in one second, and the uncertainty, after an answer with a round
    /// trip of 20 ms and one of 1 ms that is early by `early_s`. Samples arrive at 100 Hz with 1 ms of delay;
    /// those for which `ahead` is true are stamped 15 ms after their arrival.
    fn dated(early_s: f64, ahead: impl Fn(i64) -> bool) -> (usize, f64) {
        let mut c = RemoteClock::default();
        for k in 0..10 {
            ask(&mut c, 200.0 + 0.2 * f64::from(k), 0.010, 0.010);
        }
        let t0 = DroneTime::from_secs(202.0);
        let stated = t0 + Span::from_secs(0.0005 - early_s);
        c.answered(
            t0 + Span::from_millis(1),
            t0.nanos(),
            stated.nanos() - APART_NS,
            0.1,
        );
        let mut dated = 0;
        for k in 1..=100_i64 {
            let now = t0 + Span::from_millis(10 * k);
            let wrong = if ahead(k) { 16_000_000 } else { 0 };
            let at = c.local_time(now, now.nanos() - 1_000_000 + wrong - APART_NS);
            dated += usize::from(at.is_some_and(|at| (now - at).secs() < 0.012));
        }
        (dated, c.uncertainty_s(t0 + Span::from_secs(1.0)))
    }

    #[test]
    fn samples_in_a_row_against_one_answer() {
        let (dated, error_s) = dated(0.012, |_| false);
        assert!(
            dated >= 90 && (0.009..0.012).contains(&error_s),
            "{dated}, {error_s}"
        );
    }

    #[test]
    fn single_samples_against_right_answers() {
        // A single sample ahead, every fifth one (a stream with another clock), and a burst of four.
        for ahead in [
            |k: i64| k == 50,
            |k: i64| k % 5 == 0,
            |k: i64| (50..54).contains(&k),
        ] {
            let (dated, error_s) = dated(0.0, ahead);
            assert!(dated >= 79 && error_s < 0.001, "{dated}, {error_s}");
        }
    }

    /// A suspension of any length is not a restart; the next answer dates samples again.
    #[test]
    fn timesync_after_a_suspended_computer() {
        for gap_s in [0.1, 0.3, 1.5, 20.0] {
            let mut c = RemoteClock::default();
            for k in 0..20 {
                ask(&mut c, 200.0 + 0.2 * f64::from(k), 0.001, 0.001);
            }
            let now = DroneTime::from_secs(204.1);
            let gap = Span::from_secs(gap_s);
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
        // The autopilot's clock restarts at zero; its first answer is slower than all earlier ones.
        let t0 = DroneTime::from_secs(300.0);
        let now = t0 + Span::from_secs(0.02);
        c.answered(now, t0.nanos(), 1_000_000_000, 0.1);
        assert_eq!(c.restarts, 1);
        let at = c.local_time(now, 1_000_000_000).unwrap();
        assert!((now - at).secs() < 0.03);
    }
}
