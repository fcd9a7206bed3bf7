//! Adaptive process noise by covariance matching (Mehra 1972). In a consistent filter the normalised innovation squared
//! of the inertial channels is 1 on average. A mean that stays higher shows motion that the wave model does not explain
//! (a platform turning about its deck, wash, moving crew). The disturbance of that degree of freedom then gets a
//! larger spread and a shorter memory until the innovations are consistent again.
//!
//! Under such motion an accelerometer carries less information on tilt. The larger disturbance in surge and sway
//! accounts for this: the gyroscope then determines the tilt.

use alight_shared::{
    time::{Span, VesselTime},
    vessel_model::VesselModelConfig,
};

/// Time constant of the mean innovation, s (our choice: several periods of a fast platform).
const MEMORY_S: f64 = 2.0;
const PERIOD: Span = Span::from_millis(500);
/// Fraction of the discrepancy (logarithm of the spread) removed by an update.
const GAIN: f64 = 0.4;
/// Target of the mean normalised innovation squared, a little more than 1 for a hull in waves.
const CONSISTENT: f64 = 2.0;
const MAX_FACTOR: f64 = 150.0;
/// Minimum memory of a disturbance, s.
const MIN_TIME_S: f64 = 0.1;
/// Change of a factor (logarithm) that requires a new model.
const REBUILD_CHANGE: f64 = 0.2;

/// Factors on the disturbances of the model.
#[derive(Clone, Debug)]
pub(crate) struct AdaptiveNoise {
    /// Mean normalised innovation squared of each degree of freedom.
    mean: [f64; 6],
    /// Target factor, as a logarithm.
    wanted: [f64; 6],
    /// Factor used by the current model, as a logarithm.
    built: [f64; 6],
    next: VesselTime,
}

impl AdaptiveNoise {
    pub(crate) fn new(at: VesselTime) -> Self {
        AdaptiveNoise {
            mean: [1.0; 6],
            wanted: [0.0; 6],
            built: [0.0; 6],
            next: at + PERIOD,
        }
    }

    /// Adds the normalised innovation squared of degree of freedom `dof`, `dt` s after the previous one.
    pub(crate) fn observe(&mut self, dof: usize, nis: f64, dt: f64) {
        if let Some(m) = self.mean.get_mut(dof)
            && nis.is_finite()
        {
            *m += (nis - *m) * (dt / MEMORY_S).min(1.0);
        }
    }

    /// Updates the factors when due. Returns whether the model must be rebuilt by [`AdaptiveNoise::adapted`].
    pub(crate) fn is_rebuild_due(&mut self, at: VesselTime) -> bool {
        if at < self.next {
            return false;
        }
        self.next = at + PERIOD;
        for (wanted, mean) in self.wanted.iter_mut().zip(self.mean) {
            // The factor 0.5 converts variances to standard deviations.
            let off = 0.5 * (mean.max(1e-3) / CONSISTENT).ln();
            *wanted = (*wanted + GAIN * off).clamp(0.0, MAX_FACTOR.ln());
        }
        let off = |(w, b): (&f64, &f64)| (w - b).abs() > REBUILD_CHANGE || (*w == 0.0 && *b != 0.0);
        if !self.wanted.iter().zip(&self.built).any(off) {
            return false;
        }
        self.built = self.wanted;
        true
    }

    /// Factor of the current model on the disturbance of a degree of freedom.
    pub(crate) fn factor(&self, dof: usize) -> f64 {
        self.built.get(dof).map_or(1.0, |b| b.exp())
    }

    /// Spread of the acceleration in surge or sway beyond the configured one, m/s²; zero for other degrees.
    pub(crate) fn spread(&self, model: &VesselModelConfig, dof: usize) -> f64 {
        if dof > 1 {
            return 0.0;
        }
        (self.factor(dof) - 1.0) * model.disturbance_sd_mps2_m_rad_radps2[dof]
    }

    /// Model parameters with these disturbances. The spread is multiplied by the factor and the memory divided by it,
    /// which limits the increase of slow motion.
    pub(crate) fn adapted(&self, model: &VesselModelConfig) -> VesselModelConfig {
        let mut adapted = model.clone();
        for dof in 0..6 {
            let f = self.factor(dof);
            adapted.disturbance_sd_mps2_m_rad_radps2[dof] *= f;
            let time = &mut adapted.disturbance_time_s[dof];
            *time = (*time / f).max(MIN_TIME_S.min(*time));
        }
        adapted
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    fn after(nis: f64, seconds: f64) -> AdaptiveNoise {
        let mut u = AdaptiveNoise::new(Time::EPOCH);
        for k in 0..(seconds / 0.02) as u32 {
            for dof in 0..6 {
                u.observe(dof, if dof == 4 { nis } else { 1.0 }, 0.02);
            }
            u.is_rebuild_due(Time::from_secs(0.02 * f64::from(k)));
        }
        u
    }

    #[test]
    fn adaptive_noise_of_a_consistent_model() {
        let u = after(1.2, 60.0);
        let model = VesselModelConfig::default();
        assert_eq!(u.adapted(&model), model);
    }

    #[test]
    fn adaptive_noise_of_an_inconsistent_model() {
        let mut u = after(30.0, 20.0);
        assert!(u.factor(4) > 5.0 && u.factor(4) <= MAX_FACTOR + 1e-9);
        assert_eq!((u.factor(2), u.factor(3)), (1.0, 1.0));
        let adapted = u.adapted(&VesselModelConfig::default());
        use alight_shared::config::{Check, Keys};
        assert!(adapted.check(&Keys::ROOT).is_ok());
        for k in 0..6000 {
            u.observe(4, 0.5, 0.02);
            u.is_rebuild_due(Time::from_secs(20.0 + 0.02 * f64::from(k)));
        }
        assert_eq!(u.factor(4), 1.0);
    }

    #[test]
    fn adaptive_noise_with_nan() {
        let mut u = AdaptiveNoise::new(Time::EPOCH);
        u.observe(2, f64::NAN, 0.02);
        u.observe(9, 1.0, 0.02);
        assert!(u.mean.iter().all(|m| *m == 1.0));
    }
}
