//! Standard errors for autocorrelated samples, in which neighbours have a common error.

use nalgebra::{DMatrix, Matrix3, SymmetricEigen, Vector3};

/// Covariance of the sum of `scores`, over lags up to `lags` with Bartlett weights (Newey and West 1987).
fn long_run(scores: &[Vector3<f64>], lags: usize) -> Matrix3<f64> {
    let mut s: Matrix3<f64> = scores.iter().map(|v| v * v.transpose()).sum();
    for lag in 1..=lags.min(scores.len().saturating_sub(1)) {
        let w = 1.0 - lag as f64 / (lags + 1) as f64;
        let g: Matrix3<f64> = scores
            .iter()
            .skip(lag)
            .zip(scores)
            .map(|(a, b)| a * b.transpose())
            .sum();
        s += (g + g.transpose()) * w;
    }
    s
}

/// Mean of `samples` and its covariance, if errors are correlated over `lags` neighbours.
pub fn mean(samples: &[Vector3<f64>], lags: usize) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    if samples.len() < 2 {
        return None;
    }
    let n = samples.len() as f64;
    let mean = samples.iter().sum::<Vector3<f64>>() / n;
    let about: Vec<_> = samples.iter().map(|s| s - mean).collect();
    Some((mean, long_run(&about, lags) / (n * n)))
}

/// Information matrix of a regression (zero in unobserved directions), and its product with the value.
#[derive(Clone, Copy, Debug, Default)]
pub struct Information {
    matrix: Matrix3<f64>,
    vector: Vector3<f64>,
}

impl Information {
    pub fn of(value: &Vector3<f64>, covariance: &Matrix3<f64>) -> Option<Information> {
        let matrix = covariance.try_inverse()?;
        Some(Information {
            matrix,
            vector: matrix * value,
        })
    }
    #[must_use]
    pub fn with(&self, other: &Information) -> Information {
        Information {
            matrix: self.matrix + other.matrix,
            vector: self.vector + other.vector,
        }
    }
    /// Value and covariance; None while a direction is unobserved.
    pub fn value(&self) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let covariance = self.matrix.try_inverse()?;
        Some((covariance * self.vector, covariance))
    }
}

/// Least squares of `y = A x + e` in those directions of x that `A` excites by at least `floor` (RMS). Errors are
/// correlated over `lags` neighbours. Adds an error of `with` (RMS) in phase with `A`, which no residual reveals.
pub fn regress(samples: &[(Matrix3<f64>, Vector3<f64>)], floor: f64, lags: usize, with: f64) -> Information {
    let n = samples.len() as f64;
    let normal: Matrix3<f64> = samples.iter().map(|(a, _)| a.transpose() * a).sum();
    let SymmetricEigen {
        eigenvalues,
        eigenvectors,
    } = SymmetricEigen::new(normal);
    let directions: Vec<Vector3<f64>> = (0..3)
        .filter(|&k| eigenvalues[k] > n * floor * floor)
        .map(|k| eigenvectors.column(k).into_owned())
        .collect();
    if directions.is_empty() {
        return Information::default();
    }
    let right: Vector3<f64> = samples.iter().map(|(a, y)| a.transpose() * y).sum();
    // The normal matrix is diagonal in its eigenvectors.
    let value: Vector3<f64> = directions
        .iter()
        .map(|v| v * (v.dot(&right) / (v.dot(&(normal * v)))))
        .sum();
    let scores: Vec<Vector3<f64>> = samples
        .iter()
        .map(|(a, y)| a.transpose() * (y - a * value))
        .collect();
    let long = long_run(&scores, lags);
    let k = directions.len();
    let basis = DMatrix::from_fn(3, k, |r, c| directions[c][r]);
    let meat = DMatrix::from_fn(3, 3, |r, c| long[(r, c)]);
    let bread = DMatrix::from_fn(k, k, |r, c| {
        if r == c {
            1.0 / directions[r].dot(&(normal * directions[r]))
        } else {
            0.0
        }
    });
    let covariance = &bread * (basis.transpose() * meat * &basis) * &bread + &bread * (n * with * with);
    let Some(information) = covariance.try_inverse() else {
        return Information::default();
    };
    let full = &basis * information * basis.transpose();
    let matrix = Matrix3::from_fn(|r, c| full[(r, c)]);
    Information {
        matrix,
        vector: matrix * value,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_covariance_of_correlated_samples() {
        // Repeating each value ten times does not change the error of the mean.
        let distinct: Vec<f64> = (0..100)
            .map(|k| (f64::from(k * k) * 0.754_877_666).fract() - 0.5)
            .collect();
        let often: Vec<_> = distinct.iter().flat_map(|v| [Vector3::repeat(*v); 10]).collect();
        let once: Vec<_> = distinct.iter().map(|v| Vector3::repeat(*v)).collect();
        let sd = |s: &[Vector3<f64>], lags| mean(s, lags).unwrap().1[(0, 0)].sqrt();
        let naive = sd(&often, 0);
        let fair = sd(&often, 20);
        let expected = sd(&once, 0);
        assert!(naive < 0.4 * expected, "{naive} {expected}");
        assert!((fair / expected - 1.0).abs() < 0.3, "{fair} {expected}");
    }

    #[test]
    fn regression_with_unexcited_directions() {
        let samples: Vec<_> = (0..200)
            .map(|k| {
                let s = 0.1 * (f64::from(k) * 0.3).sin();
                let e = 0.001 * f64::from(k * 37 % 101 - 50) / 50.0;
                // Only the first component is excited.
                let a = Matrix3::new(s, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
                (a, Vector3::new(2.0 * s + e, 0.0, 0.0))
            })
            .collect();
        let known = regress(&samples, 0.005, 5, 0.0);
        assert!(known.value().is_none());
        let prior = Information::of(&Vector3::new(0.0, 5.0, 5.0), &Matrix3::identity()).unwrap();
        let (value, covariance) = known.with(&prior).value().unwrap();
        assert!((value.x - 2.0).abs() < 4.0 * covariance[(0, 0)].sqrt() && covariance[(0, 0)] < 1e-4);
        assert!((value.y - 5.0).abs() < 1e-9 && (covariance[(1, 1)] - 1.0).abs() < 1e-9);
    }
}
