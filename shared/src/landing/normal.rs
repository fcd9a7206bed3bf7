//! Normal distributions in one and two dimensions.

use core::f64::consts::{FRAC_1_SQRT_2, TAU};

/// Gauss-Legendre nodes and weights of order 20 on -1 to 1; each node also stands for its negative.
const NODES: [[f64; 2]; 10] = [
    [0.076526521133497, 0.152753387130726],
    [0.227785851141645, 0.149172986472604],
    [0.373706088715420, 0.142096109318382],
    [0.510867001950827, 0.131688638449177],
    [0.636053680726515, 0.118194531961519],
    [0.746331906460151, 0.101930119817241],
    [0.839116971822219, 0.083276741576705],
    [0.912234428251326, 0.062672048334109],
    [0.963971927277914, 0.040601429800386],
    [0.993128599185095, 0.017614007139151],
];

/// Root of the sum of squares.
pub fn norm(parts: &[f64]) -> f64 {
    parts.iter().map(|p| p * p).sum::<f64>().sqrt()
}

/// Error function of `x >= 0`, to 3e-7: `1 - (1 + a_1 x + ... + a_6 x^6)^-16`.
/// Source: Abramowitz and Stegun 1964, eq. 7.1.28.
fn erf(x: f64) -> f64 {
    const A: [f64; 6] = [
        0.070_523_078_4,
        0.042_282_012_3,
        0.009_270_527_2,
        0.000_152_014_3,
        0.000_276_567_2,
        0.000_043_063_8,
    ];
    if x > 6.0 {
        return 1.0;
    }
    1.0 - (1.0 + x * A.iter().rev().fold(0.0, |sum, a| sum * x + a)).powi(-16)
}

/// Probability that a standard normal variable is below `z`, to 2e-7.
pub fn below(z: f64) -> f64 {
    let half = 0.5 * erf(z.abs() * FRAC_1_SQRT_2);
    0.5 + half.copysign(z)
}

/// Larger of two values; NaN if either is NaN, unlike `f64::max`.
pub fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}
/// Smaller of two values; NaN if either is NaN.
pub fn smaller(a: f64, b: f64) -> f64 {
    if a.is_nan() || a < b { a } else { b }
}

/// Probability that a normal variable in the plane with offset `mean` and standard deviation `sd` per axis lies within
/// `radius` of the origin (Rice), to 5e-5: the integral `∫ phi(u) erf(radius cos t / (sd sqrt 2)) (radius cos t / sd) dt`
/// with `x = radius sin t = mean + sd u`; NaN for a NaN argument.
pub fn inside(mean: f64, sd: f64, radius: f64) -> f64 {
    /// Standard deviations beyond which the density is negligible.
    const REACH: f64 = 6.0;
    if sd <= 0.0 {
        return f64::from(mean < radius);
    }
    let angle = |u: f64| ((mean + sd * u) / radius).clamp(-1.0, 1.0).asin();
    let [low, high] = [-REACH, REACH].map(angle);
    let [middle, half] = [0.5 * (low + high), 0.5 * (high - low)];
    let part = |node: f64| {
        let (sin, cos) = (middle + half * node).sin_cos();
        let u = (radius * sin - mean) / sd;
        let across = radius * cos / sd;
        (-0.5 * u * u).exp() * erf(across * FRAC_1_SQRT_2) * across
    };
    let sum: f64 = NODES.iter().map(|[x, w]| w * (part(*x) + part(-*x))).sum();
    smaller(sum * half / TAU.sqrt(), 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probability_inside_a_circle() {
        for sd in [0.2, 0.5, 1.0] {
            let rayleigh = 1.0 - (-0.5_f64 / (sd * sd)).exp();
            assert!((inside(0.0, sd, 1.0) - rayleigh).abs() < 5e-5, "{sd}");
        }
        // Reference: fine midpoint rule for the same integral.
        for (mean, sd) in [(0.3, 0.02), (0.95, 0.1), (1.05, 0.3), (0.1, 2.0), (4.0, 1.0)] {
            let n = 20_000;
            let dense: f64 = (0..n)
                .map(|k| {
                    let u = 12.0 * (f64::from(k) + 0.5) / f64::from(n) - 6.0;
                    let half = (1.0 - (mean + sd * u).powi(2)).max(0.0).sqrt();
                    (-0.5 * u * u).exp() * erf(half / sd * FRAC_1_SQRT_2) * 12.0 / f64::from(n)
                })
                .sum();
            let dense = dense / TAU.sqrt();
            assert!(
                (inside(mean, sd, 1.0) - dense).abs() < 6e-5,
                "{mean}, {sd}: {dense}"
            );
        }
        assert!((inside(0.8, 0.05, 1.0) - below(4.0)).abs() < 1e-3);
        assert!(inside(2.0, 0.1, 1.0) < 1e-6 && inside(0.5, 0.0, 1.0) > 0.999);
    }

    #[test]
    fn probability_inside_of_no_number() {
        for [mean, sd, radius] in [[f64::NAN, 0.1, 1.0], [0.1, f64::NAN, 1.0], [0.1, 0.1, f64::NAN]] {
            assert!(inside(mean, sd, radius).is_nan(), "{mean} {sd} {radius}");
        }
        assert!(inside(f64::NAN, 0.0, 1.0) < 1e-12);
        for (a, b) in [(f64::NAN, 1.0), (1.0, f64::NAN)] {
            assert!(larger(a, b).is_nan() && smaller(a, b).is_nan());
        }
        assert_eq!((larger(1.0, 2.0), smaller(1.0, 2.0)), (2.0, 1.0));
    }

    #[test]
    fn probability_below() {
        // Tabulated values of the normal distribution.
        for (z, p) in [
            (0.0, 0.5),
            (1.0, 0.841_344_75),
            (1.96, 0.975_002_10),
            (3.0, 0.998_650_10),
            (-2.0, 0.022_750_13),
        ] {
            assert!((below(z) - p).abs() < 2e-7, "{z}: {}", below(z));
        }
        assert!(below(f64::NAN).is_nan() && below(f64::INFINITY) == 1.0 && below(f64::NEG_INFINITY) == 0.0);
    }
}
