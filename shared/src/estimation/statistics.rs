//! Statistics of samples.

use serde::Serialize;

/// A value and its standard error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ValueWithSd {
    /// Its value.
    pub value: f64,
    /// Its standard error.
    pub sd: f64,
}

impl ValueWithSd {
    /// A value with its standard error.
    pub const fn new(value: f64, sd: f64) -> ValueWithSd {
        ValueWithSd { value, sd }
    }
    /// A value that is known to this fraction of itself.
    pub fn relative(value: f64, fraction: f64) -> ValueWithSd {
        ValueWithSd::new(value, value * fraction)
    }
    /// It, times a known factor.
    pub fn scaled(&self, factor: f64) -> ValueWithSd {
        ValueWithSd::new(factor * self.value, factor * self.sd)
    }
}

/// The median of what is finite; None without any.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut all: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
    all.sort_unstable_by(f64::total_cmp);
    let [low, high] = [all.len().saturating_sub(1) / 2, all.len() / 2].map(|k| all.get(k));
    Some((low? + high?) / 2.0)
}

/// Mean and standard deviation; of nothing both are no number.
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
    fn medians() {
        assert_eq!(median([3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([4.0, 1.0, f64::NAN, 2.0, 3.0]), Some(2.5));
        assert_eq!(median([]), None);
    }
}
