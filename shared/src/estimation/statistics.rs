//! Statistics of samples.

use serde::Serialize;

/// A value and its standard error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ValueWithSd {
    /// Value of the statistic.
    pub value: f64,
    /// Standard error of the value.
    pub sd: f64,
}

impl ValueWithSd {
    /// Creates a value with its standard error.
    pub const fn new(value: f64, sd: f64) -> ValueWithSd {
        ValueWithSd { value, sd }
    }
    /// A value with a standard error of this fraction of its magnitude.
    pub fn relative(value: f64, fraction: f64) -> ValueWithSd {
        ValueWithSd::new(value, value * fraction)
    }
    /// Multiplies value and error by an exactly known factor.
    pub fn scaled(&self, factor: f64) -> ValueWithSd {
        ValueWithSd::new(factor * self.value, factor * self.sd)
    }
}

/// Median of the finite values; None without any.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut all: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
    all.sort_unstable_by(f64::total_cmp);
    let [low, high] = [all.len().saturating_sub(1) / 2, all.len() / 2].map(|k| all.get(k));
    Some((low? + high?) / 2.0)
}

/// The `q` quantile (0 to 1) by nearest rank. Sorts `values`; None if empty.
pub fn quantile(values: &mut [f64], q: f64) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    let rank = ((q * values.len() as f64).ceil() as usize).clamp(1, values.len().max(1));
    values.get(rank - 1).copied()
}

/// Mean and standard deviation; NaN for an empty slice.
pub fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    (mean, variance.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_and_quantiles() {
        assert_eq!(median([3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([4.0, 1.0, f64::NAN, 2.0, 3.0]), Some(2.5));
        assert_eq!(median([]), None);
        let mut hundred: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        for (q, value) in [(0.0, 1.0), (0.5, 50.0), (0.99, 99.0), (1.0, 100.0)] {
            assert_eq!(quantile(&mut hundred, q), Some(value));
        }
        assert_eq!(quantile(&mut [], 0.5), None);
    }
}
