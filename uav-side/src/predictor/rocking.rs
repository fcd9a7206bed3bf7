//! How the deck rocks by the vessel's estimates: spread and frequency of its tilt. Where
//! the vessel has no wave components that explain its motion, this is all that is known of it, and
//! the predictor's own oscillators take it for theirs.

/// Time constant of the mean squares, s (ours: two periods of a long swell).
const MEMORY_S: f64 = 10.0;
/// Estimates further apart than this start afresh, s.
const GAP_S: f64 = 5.0;
/// Frequencies that a residual oscillator is given, rad/s: between the slowest that is worth a
/// prediction and what an attitude loop can still follow.
const OMEGA: [f64; 2] = [2.0, 9.0];
/// Nothing is known before this time of estimates, s.
const MIN_OBSERVED_S: f64 = 3.0;

/// Mean squares of tilt and tilt rate.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rocking {
    mean: [f64; 2],
    square: [f64; 2],
    rate: [f64; 2],
    at: Option<f64>,
    observed_s: f64,
}

impl Rocking {
    /// Tilt (rad) and tilt rate (rad/s) about north and east at time `at` (s).
    pub fn update(&mut self, at: f64, tilt: [f64; 2], rate: [f64; 2]) {
        let dt = self.at.map_or(0.0, |t| at - t);
        if dt < 0.0 {
            return;
        }
        if dt > GAP_S {
            *self = Rocking::default();
        }
        self.at = Some(at);
        self.observed_s += dt.min(GAP_S);
        // An average of all so far until the memory is full.
        let fraction = if self.observed_s > 0.0 {
            dt / self.observed_s.min(MEMORY_S)
        } else {
            1.0
        }
        .clamp(0.0, 1.0);
        for i in 0..2 {
            self.mean[i] += fraction * (tilt[i] - self.mean[i]);
            self.square[i] += fraction * ((tilt[i] - self.mean[i]).powi(2) - self.square[i]);
            self.rate[i] += fraction * (rate[i].powi(2) - self.rate[i]);
        }
    }

    /// Standard deviation of the tilt about an axis (rad) and the frequency with which it crosses
    /// its mean (rad/s, Rice 1945: the ratio of the spreads of rate and value); None until known.
    pub fn known(&self) -> Option<(f64, f64)> {
        let (value, rate) = (
            0.5 * (self.square[0] + self.square[1]),
            0.5 * (self.rate[0] + self.rate[1]),
        );
        (self.observed_s > MIN_OBSERVED_S && value > 0.0 && rate.is_finite()).then(|| {
            let omega = (rate / value).sqrt();
            (value.sqrt(), omega.clamp(OMEGA[0], OMEGA[1]))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rocking_measures_spread_and_frequency_of_a_sine() {
        let mut r = Rocking::default();
        assert_eq!(r.known(), None);
        for k in 0..900 {
            let t = f64::from(k) / 30.0;
            let (s, c) = (7.0 * t).sin_cos();
            r.update(t, [0.05 + 0.03 * s, 0.03 * c], [0.21 * c, -0.21 * s]);
        }
        let (sd, omega) = r.known().unwrap();
        assert!((sd - 0.03 / 2f64.sqrt()).abs() < 0.004, "{sd}");
        assert!((omega - 7.0).abs() < 0.7, "{omega}");
    }

    #[test]
    fn rocking_ignores_time_that_runs_back() {
        let mut r = Rocking::default();
        r.update(5.0, [0.0; 2], [0.0; 2]);
        r.update(4.0, [1.0; 2], [1.0; 2]);
        assert_eq!(r.mean, [0.0; 2]);
    }
}
