//! Gaussian white noise and first-order Gauss-Markov processes.

use crate::physics::streams::Stream;
use rand_distr::{Distribution, StandardNormal};

/// Standard normal sample.
pub(crate) fn normal(rng: &mut Stream) -> f64 {
    StandardNormal.sample(rng)
}

/// First-order Gauss-Markov process `dx/dt = -x/T + w`, stationary with `sd` (Gelb 1974, section 2.2),
/// discretised exactly.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GaussMarkov {
    pub(crate) value: f64,
    sd: f64,
    keep: f64,
    drive: f64,
}

impl GaussMarkov {
    /// Sampled every `dt_s`, with the correlation time `time_s`; starts in its stationary distribution.
    pub(crate) fn new(sd: f64, time_s: f64, dt_s: f64, rng: &mut Stream) -> Self {
        let keep = (-dt_s / time_s).exp();
        GaussMarkov {
            value: sd * normal(rng),
            sd,
            keep,
            drive: (1.0 - keep * keep).max(0.0).sqrt(),
        }
    }
    pub(crate) fn step(&mut self, rng: &mut Stream) -> f64 {
        self.value = self.keep * self.value + self.drive * self.sd * normal(rng);
        self.value
    }
}
