//! The scale of the prediction covariance: the filter predicts heave, roll and pitch [`AHEAD_S`] ahead and compares
//! the prediction with the later estimate. In a consistent filter their difference has the variance `P(h) - P(0)`,
//! because it is independent of the later estimate's error (Bar-Shalom, Li and Kirubarajan 2001, section 5.4);
//! constant errors, such as the sensor's misalignment, cancel. Where the waves keep their phase better than their
//! process noise implies, or worse (harmonics of a steep sea), the growth of the variance is scaled to match
//! (covariance matching, Mehra 1972).
//!
//! Only the published covariance is scaled. The filter's own noise stays, because it lets the filter follow a changing
//! sea. The disturbance's part stays too: without waves it is the only one, and somebody may step on a deck that
//! has been still for a minute.

use std::collections::VecDeque;

use alight_shared::time::{Span, Time, VesselClock};
use alight_shared::vessel_model::{HEAVE, PITCH, ROLL, VesselModelConfig};

/// Time ahead at which predictions are held against what came, s.
pub(crate) const AHEAD_S: f64 = 1.0;
/// Time between two comparisons, s: off the waves' periods, several in each.
const PERIOD: Span = Span::from_millis(230);
/// Memory of the means, s: two or three wave periods (ours; with 30 s errors from before the waves were known still
/// counted at the landing).
const MEMORY_S: f64 = 12.0;
/// Most comparisons under way.
const MAX_PENDING: usize = 8;
/// Weight of the model's own variance, in comparisons: one second.
const PRIOR: u32 = 5;
/// Least and largest factor: the model's noise differs by the square of a spread that is guessed.
const BOUNDS: [f64; 2] = [0.02, 50.0];

/// Degrees of freedom with stiffness, whose waves are motion.
pub(crate) const COMPARED: [usize; 3] = [HEAVE, ROLL, PITCH];

/// Mean and variance of a degree of freedom in a prediction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Predicted {
    /// m, rad.
    pub(crate) mean: f64,
    /// What the variance will have grown by beyond that of the disturbance, m², rad².
    pub(crate) waves: f64,
    /// What the disturbance adds, m², rad².
    pub(crate) disturbance: f64,
}

#[derive(Clone, Copy, Debug)]
struct Pending {
    due: Time<VesselClock>,
    /// Reference heading that roll and pitch belong to, rad.
    reference: f64,
    predicted: [Predicted; 3],
}

/// The observed growth of the variances.
#[derive(Clone, Debug)]
pub(crate) struct PredictionScale {
    pending: VecDeque<Pending>,
    next: Time<VesselClock>,
    /// Mean squared difference less the disturbance's part, m², rad²; none before the first prediction.
    came: Option<[f64; 3]>,
    /// Comparisons in it.
    count: u32,
}

impl PredictionScale {
    pub(crate) fn new(at: Time<VesselClock>) -> Self {
        PredictionScale {
            pending: VecDeque::with_capacity(MAX_PENDING),
            next: at,
            came: None,
            count: 0,
        }
    }

    /// The model is a new one: begins anew with its own variance.
    pub(crate) fn forget(&mut self) {
        self.pending.clear();
        self.came = None;
        self.count = 0;
    }

    /// A prediction made now is wanted.
    pub(crate) fn is_due(&mut self, at: Time<VesselClock>) -> bool {
        if at < self.next {
            return false;
        }
        self.next = at + PERIOD;
        true
    }

    /// A prediction made at `at`, roll and pitch in the frame at the `reference` heading.
    pub(crate) fn push(&mut self, at: Time<VesselClock>, reference: f64, predicted: [Predicted; 3]) {
        if self.pending.len() >= MAX_PENDING {
            self.pending.pop_front();
        }
        self.came.get_or_insert(predicted.map(|f| f.waves));
        self.pending.push_back(Pending {
            due: at + Span::from_secs(AHEAD_S),
            reference,
            predicted,
        });
    }

    /// Compares the predictions that are due at `at` with the values `now`. Predictions in another frame (after a
    /// turn) and those that are due by more than `late` are dropped.
    pub(crate) fn compare(&mut self, at: Time<VesselClock>, reference: f64, now: [f64; 3], late: Span) {
        while let Some(p) = self.pending.front().copied().filter(|p| p.due <= at) {
            self.pending.pop_front();
            let Some(came) = &mut self.came else { return };
            if p.reference != reference || at - p.due > late || now.iter().any(|v| !v.is_finite()) {
                continue;
            }
            self.count = self.count.saturating_add(1);
            let gain = (1.0 / f64::from(PRIOR + self.count)).max(PERIOD.secs() / MEMORY_S);
            for ((came, f), now) in came.iter_mut().zip(p.predicted).zip(now) {
                let difference = (now - f.mean).powi(2) - f.disturbance;
                if difference.is_finite() {
                    *came += gain * (difference - *came);
                }
            }
        }
    }

    /// Factor on the waves' part of the growth in a degree of freedom where the model has `waves` (m², rad²) at
    /// [`AHEAD_S`]; 1 for those not compared and before the first comparison.
    pub(crate) fn factor(&self, dof: usize, waves: f64) -> f64 {
        let (Some(i), Some(came)) = (COMPARED.iter().position(|d| *d == dof), self.came) else {
            return 1.0;
        };
        if !(waves > 0.0) {
            return 1.0;
        }
        let [least, most] = BOUNDS;
        (came[i] / waves).clamp(least, most)
    }
}

/// What the disturbance of a degree of freedom, a first-order Markov process, has moved away from
/// its present value after `t`: `sd² (1 - exp(-2 t / tau))`.
pub(crate) fn disturbance(model: &VesselModelConfig, dof: usize, t: f64) -> f64 {
    let (sd, tau) = (
        model.disturbance_sd_mps2_m_rad_radps2[dof],
        model.disturbance_time_s[dof],
    );
    sd * sd * (1.0 - (-2.0 * t / tau).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Errors of this spread (m, rad) where a spread of 1 was predicted.
    fn after(spread: f64, seconds: f64) -> PredictionScale {
        let mut g = PredictionScale::new(Time::EPOCH);
        let step = Span::from_millis(20);
        let mut sign = 1.0;
        for k in 0..(seconds / 0.02) as u32 {
            let at = Time::from_secs(0.02 * f64::from(k));
            sign = -sign;
            g.compare(at, 0.0, [sign * spread; 3], step);
            if g.is_due(at) {
                let f = Predicted {
                    waves: 1.0,
                    ..Predicted::default()
                };
                g.push(at, 0.0, [f; 3]);
            }
            assert!(g.pending.len() <= MAX_PENDING);
        }
        g
    }

    #[test]
    fn prediction_scale_follows_the_observed_error_within_bounds() {
        for (spread, factor) in [
            (1.0, 1.0),
            (0.5, 0.25),
            (2.0, 4.0),
            (0.0, BOUNDS[0]),
            (90.0, BOUNDS[1]),
        ] {
            let got = after(spread, 600.0).factor(HEAVE, 1.0);
            assert!((got / factor - 1.0).abs() < 1e-6, "{spread}: {got}, not {factor}");
        }
        assert_eq!(PredictionScale::new(Time::EPOCH).factor(ROLL, 1.0), 1.0);
        assert_eq!(after(2.0, 600.0).factor(0, 1.0), 1.0, "surge is not compared");
        // A model with another variance: the observed error stays.
        assert!((after(2.0, 600.0).factor(HEAVE, 8.0) - 0.5).abs() < 1e-6);
        let mut g = after(2.0, 600.0);
        g.forget();
        assert_eq!(g.factor(HEAVE, 1.0), 1.0);
    }

    #[test]
    fn prediction_scale_ignores_other_frames_and_nan() {
        let mut g = PredictionScale::new(Time::EPOCH);
        let f = Predicted {
            waves: 1.0,
            ..Predicted::default()
        };
        for (reference, value) in [(0.2, 5.0), (0.0, f64::NAN)] {
            g.push(Time::EPOCH, 0.0, [f; 3]);
            g.compare(Time::from_secs(1.0), reference, [value; 3], Span::from_millis(20));
            assert_eq!(g.factor(PITCH, 1.0), 1.0);
        }
    }
}
