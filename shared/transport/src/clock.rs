//! Clock of a process: the operating system's steady clock with configured errors.

use rustix::time::{ClockId, clock_gettime};

use alight_shared::{
    config,
    time::{Clock, Span, Time},
};

/// The operating system's steady clock, ns: one for all processes of a computer. It is never set and keeps the rate of
/// its quartz: a time service slews the other monotonic clock by up to 8 %, which would look like a delay of every source.
pub fn steady_ns() -> i64 {
    nanoseconds(ClockId::MonotonicRaw)
}
/// Time since `stamp_ns` of the kernel's slewed monotonic clock, ns.
pub fn since_monotonic_ns(stamp_ns: i64) -> i64 {
    nanoseconds(ClockId::Monotonic).saturating_sub(stamp_ns)
}
fn nanoseconds(clock: ClockId) -> i64 {
    let now = clock_gettime(clock);
    now.tv_sec.saturating_mul(1_000_000_000) + now.tv_nsec
}

config! {
    /// A computer's clock as its processes read it: `C = s + offset + drift s`, with `s` the steady clock
    /// since `epoch_ns`. All three are zero, except on a simulated vehicle.
    #[derive(Copy)]
    pub struct ProcessClock {
        /// Reading of the steady clock at which this clock starts, ns.
        pub epoch_ns: i64 = Default::default();
        /// Offset, s.
        pub offset_s: f64 = Default::default(), in -1e9..=1e9;
        /// Relative drift, parts per million, positive when fast.
        pub drift_ppm: f64 = Default::default(), in -500.0..=500.0;
    }
}

impl ProcessClock {
    pub fn now<C: Clock>(&self) -> Time<C> {
        self.read(steady_ns())
    }
    /// Clock reading at the steady clock's `steady_ns`.
    pub fn read<C: Clock>(&self, steady_ns: i64) -> Time<C> {
        let s = steady_ns.saturating_sub(self.epoch_ns);
        let ahead = (s as f64 * self.drift_ppm * 1e-6).round() as i64;
        Time::from_nanos(s) + Span::from_secs(self.offset_s) + Span::from_nanos(ahead)
    }
    /// Steady-clock time since `epoch_ns` at which the clock reads `now_ns`.
    pub fn steady<C: Clock>(&self, now_ns: i64) -> Time<C> {
        let ahead = Time::from_nanos(now_ns) - Span::from_secs(self.offset_s);
        let drift = ahead.nanos() as f64 * self.drift_ppm * 1e-6 / (1.0 + self.drift_ppm * 1e-6);
        ahead - Span::from_nanos(drift.round() as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::DroneTime;

    #[test]
    fn process_clock_with_offset_and_drift() {
        let clock = ProcessClock {
            epoch_ns: 5_000_000_000,
            offset_s: 100.25,
            drift_ppm: 20.0,
        };
        let t: DroneTime = clock.read(5_000_000_000 + 1_000_000_000_000);
        assert!((t.secs() - 1100.25 - 0.02).abs() < 1e-9, "{t:?}");
        let back: DroneTime = clock.steady(t.nanos());
        assert!((back.nanos() - 1_000_000_000_000).abs() <= 2, "{back:?}");
    }

    #[test]
    fn monotonic_steady_clock() {
        let a = steady_ns();
        let b = steady_ns();
        assert!(0 < a && a <= b);
    }
}
