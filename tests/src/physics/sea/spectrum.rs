//! Irregular seas: the JONSWAP spectrum, divided into parts of equal energy, with directional spread.

use core::f64::consts::{PI, TAU};

use rand::{Rng, RngExt};

/// JONSWAP spectrum (Hasselmann 1973) without its energy scale, which follows from the significant height, at
/// the angular frequency `w`, rad/s: `w^-5 exp(-1.25 (wp/w)^4) gamma^exp(-(w - wp)²/(2 (sigma wp)²))`, sigma
/// 0.07 below the peak and 0.09 above.
pub fn jonswap_shape(w: f64, peak: f64, gamma: f64) -> f64 {
    if w <= 0.0 {
        return 0.0;
    }
    let sigma = if w <= peak { 0.07 } else { 0.09 };
    let r = (-(w - peak).powi(2) / (2.0 * (sigma * peak).powi(2))).exp();
    w.powi(-5) * (-1.25 * (peak / w).powi(4)).exp() * gamma.powf(r)
}

/// Quantiles of `density` between `low` and `high`: the values of `x` that bound the `fractions` (ascending, 0 to 1)
/// of its integral, by the trapezoidal rule on a fixed grid.
fn quantiles(density: impl Fn(f64) -> f64, low: f64, high: f64, fractions: &[f64]) -> Vec<f64> {
    const GRID: usize = 4000;
    let step = (high - low) / GRID as f64;
    let x = |i: usize| low + step * i as f64;
    let mut running = Vec::with_capacity(GRID + 1);
    let mut sum = 0.0;
    let mut before = density(low);
    running.push(0.0);
    for i in 1..=GRID {
        let here = density(x(i));
        sum += 0.5 * (before + here) * step;
        running.push(sum);
        before = here;
    }
    let mut i = 0;
    fractions
        .iter()
        .map(|fraction| {
            let target = fraction * sum;
            while i + 1 < GRID && running[i + 1] < target {
                i += 1;
            }
            let width = (running[i + 1] - running[i]).max(f64::MIN_POSITIVE);
            x(i) + step * ((target - running[i]) / width).clamp(0.0, 1.0)
        })
        .collect()
}

/// `n` angular frequencies, rad/s, one drawn from each `n`th of the energy, so that components have equal
/// energy and no common period.
pub fn frequencies(peak: f64, gamma: f64, n: usize, rng: &mut impl Rng) -> Vec<f64> {
    let fractions: Vec<f64> = (0..n)
        .map(|i| (i as f64 + rng.random::<f64>()) / n as f64)
        .collect();
    // Waves above three times the peak frequency (2 % of the energy) are shorter than the hull.
    quantiles(
        |w| jonswap_shape(w, peak, gamma),
        0.5 * peak,
        3.0 * peak,
        &fractions,
    )
}

/// Draws a direction relative to the mean, rad, from the density cos^2s(d/2) (Longuet-Higgins 1963).
pub fn direction(spread: f64, rng: &mut impl Rng) -> f64 {
    // Bounded rejection sampling: at s = 100 it accepts 8 % of draws, so that 200 draws suffice in practice.
    for _ in 0..200 {
        let d = (rng.random::<f64>() - 0.5) * TAU;
        if rng.random::<f64>() < (0.5 * d).cos().powf(2.0 * spread) {
            return d;
        }
    }
    0.0
}

pub fn phase(rng: &mut impl Rng) -> f64 {
    rng.random::<f64>() * 2.0 * PI
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::streams::Streams;

    #[test]
    fn jonswap_spectrum_peak() {
        let s = |w| jonswap_shape(w, 1.2, 3.3);
        for i in 1..400 {
            assert!(s(0.01 * f64::from(i)) <= s(1.2) * (1.0 + 1e-12));
        }
        // The peak is gamma times that of Pierson-Moskowitz.
        assert!((s(1.2) / jonswap_shape(1.2, 1.2, 1.0) - 3.3).abs() < 1e-12);
    }

    #[test]
    fn component_frequencies_by_energy() {
        let mut rng = Streams::new(3).stream("sea");
        let w = frequencies(1.2, 3.3, 24, &mut rng);
        assert!(w.windows(2).all(|p| p[0] < p[1]), "{w:?}");
        // The mean frequency of JONSWAP 3.3 over this band is about 1.15 to 1.25 times the peak frequency.
        let mean = w.iter().sum::<f64>() / 24.0 / 1.2;
        assert!((1.05..1.35).contains(&mean), "{mean}");
    }

    #[test]
    fn directional_spread_variance() {
        let mut rng = Streams::new(3).stream("sea");
        let n = 20_000;
        let mean_cos = (0..n).map(|_| direction(10.0, &mut rng).cos()).sum::<f64>() / f64::from(n);
        // E[cos d] = s/(s + 1) for cos^2s(d/2).
        assert!((mean_cos - 10.0 / 11.0).abs() < 0.005, "{mean_cos}");
    }
}
