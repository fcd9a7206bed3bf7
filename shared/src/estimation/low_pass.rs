//! First-order low-pass filter.

use core::ops::{Add, Mul, Sub};

/// First-order low-pass filter `x' = (u - x) / T` with time constant `time_s` (s), for a number or a vector.
/// Returns `x + (u - x)` [`low_pass_gain`]`(dt, T)` for the sample `u`, taken `dt` (s) after the output `x =
/// before`; without a previous output, `u`.
pub fn low_pass<T>(before: impl Into<Option<T>>, u: T, dt: f64, time_s: f64) -> T
where
    T: Copy + Add<Output = T> + Sub<Output = T> + Mul<f64, Output = T>,
{
    before
        .into()
        .map_or(u, |x| x + (u - x) * low_pass_gain(dt, time_s))
}

/// Gain of a first-order low-pass filter with time constant `time_s` on a sample after `dt` (s), discretised
/// exactly: `1 - exp(-dt / T)`; 1 without a time constant, 0 for negative `dt`.
pub fn low_pass_gain(dt: f64, time_s: f64) -> f64 {
    if time_s > 0.0 {
        1.0 - (-dt.max(0.0) / time_s).exp()
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn low_pass_in_steps_of_any_length() {
        let after =
            |steps: u32| (0..steps).fold(0.0_f64, |x, _| low_pass(x, 1.0, 2.0 / f64::from(steps), 1.5));
        assert!((after(1) - after(1000)).abs() < 1e-12);
        assert_eq!(low_pass(None::<f64>, 3.0, 0.1, 1.5), 3.0);
        assert_eq!((low_pass_gain(-1.0, 1.5), low_pass_gain(0.1, 0.0)), (0.0, 1.0));
    }
}
