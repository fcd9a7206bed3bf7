//! First-order low-pass filter.

use core::ops::{Add, Mul, Sub};

/// Output of a first-order low-pass filter with the time constant `time_s` (s), `x' = (u - x) / T`, `dt` (s) after it was
/// `before`: `x + (u - x)` [`low_pass_gain`]`(dt, T)` with the sample `u`, a number or a vector; begins with `u`.
pub fn low_pass<T>(before: impl Into<Option<T>>, u: T, dt: f64, time_s: f64) -> T
where
    T: Copy + Add<Output = T> + Sub<Output = T> + Mul<f64, Output = T>,
{
    before
        .into()
        .map_or(u, |x| x + (u - x) * low_pass_gain(dt, time_s))
}

/// Fraction of a sample that a first-order filter with the time constant `time_s` takes over in `dt` (s), discretised
/// exactly: `1 - exp(-dt / T)`. Without a time constant all of it, backwards in time nothing.
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
