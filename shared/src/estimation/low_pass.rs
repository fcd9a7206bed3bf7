//! First-order low-pass filter.

/// Fraction of a sample that a first-order filter with the time constant `time_s` takes over in `dt` (s):
/// `x += low_pass_gain(dt, T) (sample - x)`, the exact discretisation `1 - exp(-dt / T)`. Without a time constant all of it,
/// backwards in time nothing.
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
        let after = |steps: u32| {
            (0..steps).fold(0.0, |x, _| {
                x + low_pass_gain(2.0 / f64::from(steps), 1.5) * (1.0 - x)
            })
        };
        assert!((after(1) - after(1000)).abs() < 1e-12);
        assert_eq!((low_pass_gain(-1.0, 1.5), low_pass_gain(0.1, 0.0)), (0.0, 1.0));
    }
}
