use core::ops::RangeInclusive;

use alight_shared::{
    config::{ConfigError, InRange, Keys},
    time::{Time, TrueTime},
};
use nalgebra::Vector3;
use rand::RngExt;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use crate::physics::streams::{Stream, Streams};

#[derive(Clone, Debug)]
pub struct Noise(Stream);

impl Noise {
    pub fn new(streams: &Streams, name: &str) -> Self {
        Noise(streams.stream(name))
    }
    pub fn normal(&mut self) -> f64 {
        self.0.sample(StandardNormal)
    }
    pub fn normal3(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }
    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.0.random()
    }
    /// True with probability `p`. Always draws, so that `p` does not affect later draws.
    pub fn chance(&mut self, p: f64) -> bool {
        self.uniform() < p
    }
}

/// First-order Gauss-Markov process in three independent axes (Brown and Hwang 2012, section 2.9): `db/dt =
/// -b / tau + w`, stationary with `sd` and the correlation `exp(-dt / tau)`, discretised exactly. It starts
/// in its stationary distribution.
#[derive(Clone, Debug)]
pub struct GaussMarkovError {
    noise: Noise,
    sd: f64,
    correlation_s: f64,
    value: Vector3<f64>,
}

impl GaussMarkovError {
    pub fn new(noise: Noise, sd: f64, correlation_s: f64) -> Self {
        let mut noise = noise;
        let value = noise.normal3() * sd;
        GaussMarkovError {
            noise,
            sd,
            correlation_s,
            value,
        }
    }
    pub fn value(&self) -> Vector3<f64> {
        self.value
    }
    pub fn step(&mut self, dt: f64) -> Vector3<f64> {
        let keep = (-dt.max(0.0) / self.correlation_s).exp();
        let fresh = self.sd * (1.0 - keep * keep).max(0.0).sqrt();
        self.value = self.value * keep + self.noise.normal3() * fresh;
        self.value
    }
}

/// Ticks at which a sensor slower than the tick rate measures. A rate that does not divide the tick rate
/// alternates between intervals (30 Hz on 10 ms ticks: 40, 30, 30 ms); stamps are the times of the ticks.
#[derive(Clone, Copy, Debug)]
pub struct SampleSchedule {
    rate_hz: f64,
    last: Option<(i64, Time<TrueTime>)>,
}

impl SampleSchedule {
    pub const fn new(rate_hz: f64) -> Self {
        SampleSchedule { rate_hz, last: None }
    }
    /// Time since the last measurement (0 at the first), s; None if no measurement is due.
    pub fn due(&mut self, t: Time<TrueTime>) -> Option<f64> {
        // The offset prevents 0.29 s * 100 Hz from being rounded down to 28.
        let index = (t.secs() * self.rate_hz + 1e-6).floor() as i64;
        match self.last {
            Some((last, _)) if index <= last => None,
            Some((_, at)) => {
                self.last = Some((index, t));
                Some((t - at).secs())
            }
            None => {
                self.last = Some((index, t));
                Some(0.0)
            }
        }
    }
}

/// Windows `[start, end)` without data, s of true time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Windows(pub Vec<[f64; 2]>);

impl Windows {
    pub fn cover(&self, t: Time<TrueTime>) -> bool {
        let s = t.secs();
        self.0.iter().any(|[start, end]| (*start..*end).contains(&s))
    }
}
impl InRange for Windows {
    fn in_range(&self, at: &Keys<'_>, key: &str, range: &RangeInclusive<f64>) -> Result<(), ConfigError> {
        self.0.in_range(at, key, range)?;
        self.0.iter().enumerate().try_for_each(|(i, [start, end])| {
            let value = format!("{start} to {end}");
            at.require(
                start <= end,
                &format!("{key}[{i}]"),
                value,
                "a start and a later end, s",
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gauss_markov_spread_and_correlation() {
        let (tau, sd, dt) = (300.0, 1.0, 30.0);
        let (mut var, mut lag, mut n) = (0.0, 0.0, 0.0);
        for seed in 0..40 {
            let mut p = GaussMarkovError::new(Noise::new(&Streams::new(seed), "test"), sd, tau);
            let mut last = p.value();
            for _ in 0..400 {
                let v = p.step(dt);
                var += v.norm_squared();
                lag += v.dot(&last);
                n += 3.0;
                last = v;
            }
        }
        assert!((var / n - 1.0_f64).abs() < 0.06, "variance {}", var / n);
        let rho: f64 = lag / var;
        assert!((rho - (-dt / tau).exp()).abs() < 0.01, "correlation {rho}");
    }

    #[test]
    fn gauss_markov_in_one_step_and_in_many() {
        let spread = |steps: usize| {
            let mut sum = 0.0;
            for seed in 0..600 {
                let mut p = GaussMarkovError::new(Noise::new(&Streams::new(seed), "test"), 2.0, 100.0);
                let start = p.value();
                for _ in 0..steps {
                    p.step(60.0 / steps as f64);
                }
                sum += (p.value() - start * (-0.6_f64).exp()).norm_squared();
            }
            sum / 1800.0
        };
        let expected = 4.0 * (1.0 - (-1.2_f64).exp());
        for steps in [1, 60] {
            assert!((spread(steps) / expected - 1.0).abs() < 0.12, "{steps} steps");
        }
    }

    #[test]
    fn schedule_mean_rate() {
        for (hz, expected) in [(100.0, 1000), (50.0, 500), (30.0, 300), (20.0, 200), (10.0, 100)] {
            let mut s = SampleSchedule::new(hz);
            let n = (0..1000)
                .filter(|k| s.due(Time::from_nanos(k * 10_000_000)).is_some())
                .count();
            assert_eq!(n, expected, "{hz} Hz");
        }
    }
}
