//! Adaptive process noise of the residual tilt, from the innovation of the vessel's tilt rates.

use super::axis::{Axis, MeasurementRow};
use super::observation::Observation;
use super::waves::AXES;

/// Time constant of the mean, s (ours: two waves).
const MEMORY_S: f64 = 10.0;
/// A longer pause between two messages counts as this, s.
const MAX_GAP_S: f64 = 0.2;
/// Innovation that needs no more noise, rad/s: a hull that follows its waves is off by 0.005 to 0.007, one that leaves the
/// water by 0.02 to 0.06.
const EXPECTED_RADPS: f64 = 0.009;
/// Spread of the residual tilt per innovation of its rate, s.
const SPREAD_S: f64 = 1.5;

/// Mean square of the innovations of the radio's tilt rates.
#[derive(Clone, Copy, Debug, Default)]
pub struct AdaptiveTiltNoise {
    /// rad²/s².
    square: f64,
    /// Time of the last message, s.
    at: Option<f64>,
}

impl AdaptiveTiltNoise {
    /// Takes the vessel's estimate before it is fused, and what the filter `expected` then.
    pub fn update(&mut self, o: &Observation, expected: &[Axis; AXES]) {
        let at = o.at.secs();
        let Some(since) = self.at.replace(at).map(|t| at - t).filter(|dt| *dt > 0.0) else {
            return;
        };
        let off = |i: usize| o.rate[i].map_or(0.0, |r| r.0 - expected[i].project(MeasurementRow::Rate).0);
        let square = 0.5 * (off(3).powi(2) + off(4).powi(2));
        if square.is_finite() {
            let fraction = 1.0 - (-since.min(MAX_GAP_S) / MEMORY_S).exp();
            self.square += fraction * (square - self.square);
        }
    }
    /// Spread of the residual tilt that explains the innovations, rad.
    pub fn tilt_sd(&self) -> f64 {
        SPREAD_S * (self.square - EXPECTED_RADPS * EXPECTED_RADPS).max(0.0).sqrt()
    }
}
