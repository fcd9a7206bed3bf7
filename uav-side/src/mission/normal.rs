//! Normal distributions of one and two dimensions.

use core::f64::consts::SQRT_2;

/// Root of the sum of the squares.
pub(super) fn norm(parts: &[f64]) -> f64 {
    parts.iter().map(|p| p * p).sum::<f64>().sqrt()
}

/// Probability that a standard normal figure is below `z`.
pub(super) fn below(z: f64) -> f64 {
    0.5 * libm::erfc(-z / SQRT_2)
}

/// Probability that a plane's normal figure with the mean `mean` from the middle and the standard deviation `sd` of each
/// axis lies within `radius` of the middle (Rice): `∫ phi(u) (2 Phi(sqrt(radius² - x²) / sd) - 1) du`, `x = mean + sd u`.
pub(super) fn inside(mean: f64, sd: f64, radius: f64) -> f64 {
    /// Standard deviations to either side, and steps.
    const REACH: f64 = 6.0;
    const STEPS: u32 = 96;
    if !(sd > 0.0) {
        return f64::from(mean < radius);
    }
    let step = 2.0 * REACH / f64::from(STEPS);
    let part = |k: u32| {
        let u = -REACH + step * (f64::from(k) + 0.5);
        let x = mean + sd * u;
        let half = (radius * radius - x * x).max(0.0).sqrt();
        (-0.5 * u * u).exp() * (1.0 - libm::erfc(half / sd / SQRT_2))
    };
    let sum: f64 = (0..STEPS).map(part).sum();
    (sum * step / core::f64::consts::TAU.sqrt()).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probability_inside_a_circle() {
        for sd in [0.2, 0.5, 1.0] {
            // Rayleigh, where the mean is the middle.
            let rayleigh = 1.0 - (-0.5_f64 / (sd * sd)).exp();
            assert!((inside(0.0, sd, 1.0) - rayleigh).abs() < 2e-3, "{sd}");
        }
        // Far off along one axis it is that axis's alone.
        assert!((inside(0.8, 0.05, 1.0) - below(4.0)).abs() < 1e-3);
        assert!(inside(2.0, 0.1, 1.0) < 1e-6 && inside(0.5, 0.0, 1.0) > 0.999);
    }
}
