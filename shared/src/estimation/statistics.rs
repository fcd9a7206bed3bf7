//! Figures of samples.

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
