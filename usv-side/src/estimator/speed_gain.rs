//! Acceleration by the engines, which the identification must not treat as a wave.

use super::STEP_S;

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SpeedGain {
    /// Measured acceleration, m/s².
    measured: f64,
    /// Recent mean square, (m/s²)².
    usual: f64,
    known_s: f64,
}

/// Averaging times of the acceleration (half that of the mean velocity) and of its mean square, s.
const GAIN_S: f64 = 0.5;
const USUAL_S: f64 = 100.0;
/// Multiple of the mean square that is statistically significant: two standard deviations.
const SURE: f64 = 4.0;

impl SpeedGain {
    /// Updates with the lag `behind` of the mean velocity, m/s, whose averaging time is 1 s.
    pub(crate) fn update(&mut self, behind: f64) {
        self.measured += (behind - self.measured) * STEP_S / GAIN_S;
        self.known_s += STEP_S;
        // Plain average until the memory is full.
        let memory_s = self.known_s.min(USUAL_S);
        self.usual += (self.measured * self.measured - self.usual) * STEP_S / memory_s;
    }
    /// Acceleration in excess of the waves' residual, m/s²: `g (1 - (2 sigma)² / g²)`, zero below two
    /// standard deviations (James and Stein 1961); without engines, 1 % of the variance remains.
    pub(crate) fn acceleration(&self) -> f64 {
        let g = self.measured;
        if g == 0.0 {
            0.0
        } else {
            g * (1.0 - SURE * self.usual / (g * g)).max(0.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speed_gain_by_engine() {
        let mut gain = SpeedGain::default();
        let mut squares = [0.0; 2];
        for k in 0..30_000 {
            // The waves leave a residual of 0.05 m/s.
            let t = STEP_S * f64::from(k);
            gain.update(0.07 * (1.3 * t).sin());
            if t > 400.0 {
                squares[0] += gain.measured.powi(2);
                squares[1] += gain.acceleration().powi(2);
            }
        }
        assert!(squares[1] < 0.2 * squares[0], "{squares:?}");
        for _ in 0..100 {
            gain.update(0.5);
        }
        assert!(
            (gain.acceleration() - 0.5).abs() < 0.05,
            "{}",
            gain.acceleration()
        );
    }
}
