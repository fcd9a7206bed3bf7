//! Times of a measurement: how many, and their quantiles.

use alight_shared::transport::statistics::Quantiles;

/// Times, counted.
#[derive(Clone, Debug, Default)]
pub struct Times {
    /// How many.
    pub count: usize,
    quantiles: Quantiles,
}

impl Times {
    /// Counts a time, ns.
    pub fn add_ns(&mut self, ns: i64) {
        self.count += 1;
        self.quantiles.add(ns as f64 * 1e-9);
    }
    /// The `q` quantile, s; NaN without any.
    pub fn quantile(&self, q: f64) -> f64 {
        if self.count == 0 {
            f64::NAN
        } else {
            self.quantiles.quantile(q)
        }
    }
}
