//! Clocks of the two computers, with offset and drift drawn per seed.

use alight_shared::{
    config,
    time::{Clock, Span, Time, TrueTime},
};

use super::noise::Noise;
use crate::physics::streams::Streams;

config! {
    /// Differences between the clocks of vessel and drone.
    #[derive(Copy)]
    pub struct ClockErrorConfig {
        /// Approximate reading of both clocks at the true time zero, s.
        /// Chosen: no node can assume that its clock starts at zero.
        pub epoch_s: f64 = 100.0, in 0.0..=1e9;
        /// Bound of the drone clock's offset from the vessel clock at the true time zero, drawn uniformly, s.
        pub offset_s: f64 = 0.5, in 0.0..=3600.0;
        /// Relative drift of the two clocks, with random sign, parts per million.
        pub drift_ppm: f64 = 20.0, in 0.0..=500.0;
    }
}

/// One clock: `C = true + offset + drift * true`.
#[derive(Clone, Copy, Debug)]
pub struct ClockModel {
    offset: Span,
    drift: f64,
}

impl ClockModel {
    /// `offset_s` is the offset at the true time zero, `drift` the rate error, s/s.
    pub fn new(offset_s: f64, drift: f64) -> Self {
        ClockModel {
            offset: Span::from_secs(offset_s),
            drift,
        }
    }
    pub fn ahead(self, by: Span) -> Self {
        ClockModel {
            offset: self.offset + by,
            ..self
        }
    }
    /// Offset at the true time zero.
    pub const fn offset(&self) -> Span {
        self.offset
    }
    pub const fn drift(&self) -> f64 {
        self.drift
    }
    pub fn read<C: Clock>(&self, t: Time<TrueTime>) -> Time<C> {
        let ahead = Span::from_nanos((t.nanos() as f64 * self.drift).round() as i64);
        Time::<C>::from_nanos(t.nanos()) + self.offset + ahead
    }
    /// True time of a reading, to the nearest nanosecond.
    pub fn true_time<C: Clock>(&self, c: Time<C>) -> Time<TrueTime> {
        let shown = Time::<TrueTime>::from_nanos(c.nanos()) - self.offset;
        let ahead = shown.nanos() as f64 * (self.drift / (1.0 + self.drift));
        shown - Span::from_nanos(ahead.round() as i64)
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Clocks {
    pub vessel: ClockModel,
    pub drone: ClockModel,
}

impl Clocks {
    /// Draws the clocks: a uniform offset within `offset_s`, and `drift_ppm` with a random sign. Each clock
    /// has half of both differences.
    pub fn new(config: &ClockErrorConfig, streams: &Streams) -> Self {
        let mut noise = Noise::new(streams, "clocks");
        let offset = 0.5 * config.offset_s * (2.0 * noise.uniform() - 1.0);
        let sign = if noise.chance(0.5) { 1.0 } else { -1.0 };
        let drift = 0.5e-6 * config.drift_ppm * sign;
        Clocks {
            vessel: ClockModel::new(config.epoch_s - offset, -drift),
            drone: ClockModel::new(config.epoch_s + offset, drift),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::{DroneClock, VesselClock};

    fn drone_time(c: &Clocks, t: Time<TrueTime>) -> Time<DroneClock> {
        c.drone.read(t)
    }
    fn vessel_time(c: &Clocks, t: Time<TrueTime>) -> Time<VesselClock> {
        c.vessel.read(t)
    }

    #[test]
    fn simulated_clocks_as_configured() {
        let config = ClockErrorConfig::default();
        let mut signs = [0, 0];
        for seed in 0..200 {
            let c = Clocks::new(&config, &Streams::new(seed));
            let apart = |s: f64| {
                let t = Time::from_secs(s);
                drone_time(&c, t).secs() - vessel_time(&c, t).secs()
            };
            assert!(apart(0.0).abs() <= 0.5);
            let drift = (apart(1000.0) - apart(0.0)) / 1000.0;
            assert!((drift.abs() - 20e-6).abs() < 1e-9, "{drift}");
            signs[usize::from(drift > 0.0)] += 1;
            let t = Time::from_secs(123.456);
            assert!((c.drone.true_time(drone_time(&c, t)) - t).abs() <= Span::from_nanos(1));
            assert!((c.vessel.true_time(vessel_time(&c, t)) - t).abs() <= Span::from_nanos(1));
        }
        assert!(signs.iter().all(|n| *n > 70), "{signs:?}");
        let spread: f64 = (0..200)
            .map(|s| Clocks::new(&config, &Streams::new(s)))
            .map(|c| (drone_time(&c, Time::EPOCH).secs() - vessel_time(&c, Time::EPOCH).secs()).powi(2))
            .sum::<f64>()
            / 200.0;
        // The variance of a uniform distribution within +-0.5 s is 1/12 s².
        assert!((spread * 12.0 - 1.0).abs() < 0.2, "{spread}");
    }

    #[test]
    fn monotonic_simulated_clock() {
        let c = ClockModel::new(0.3, -500e-6);
        let read = |k: i64| c.read::<VesselClock>(Time::from_nanos(k * 10_000_000));
        assert!((0..1000).all(|k| read(k + 1) > read(k)));
    }
}
