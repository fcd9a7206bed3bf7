//! Detection of an inertial sensor that repeats a sample with new time stamps: a hung bus, a frozen register.

use alight_shared::msg::ImuSample;

/// Consecutive samples with the same six numbers after which a sensor counts as stuck.
///
/// The white noise of a MEMS sensor is `sigma >= LSB / 3` per sample and axis (data sheets: 1 to 5 LSB at 100
/// Hz and more). Two samples at rest then fall into one step of an axis with `p <= erf(1.5 / sqrt 2)^2 + ...
/// = 0.76`, of six axes with `p^6 <= 0.2`, 24 in a row with `0.2^24 = 2e-17`: less than once in ten years at
/// 1 kHz. A driver may publish each sample 24 times.
pub const MAX_REPEATED: u32 = 25;

/// Newest numbers, and count of consecutive repetitions.
#[derive(Clone, Copy, Debug, Default)]
pub struct RepeatedSamples {
    numbers: [u64; 6],
    count: u32,
}

impl RepeatedSamples {
    /// Adds a sample, compared bit by bit. Returns whether the sensor is stuck.
    pub fn is_stuck(&mut self, m: &ImuSample) -> bool {
        let ([p, q, r], [x, y, z]) = (m.gyro, m.accelerometer);
        let numbers = [p, q, r, x, y, z].map(f64::to_bits);
        self.count = if numbers == self.numbers {
            self.count.saturating_add(1)
        } else {
            1
        };
        self.numbers = numbers;
        self.now()
    }
    /// Whether the sensor was stuck at its newest sample.
    pub fn now(&self) -> bool {
        self.count >= MAX_REPEATED
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, StandardNormal};

    /// Sample at rest with a resolution of `lsb` and noise of a third of it.
    fn still(noise: &mut ChaCha8Rng, lsb: f64) -> ImuSample {
        let mut axis = |mean: f64| {
            let normal: f64 = StandardNormal.sample(noise);
            (mean / lsb + normal / 3.0).round() * lsb
        };
        ImuSample {
            gyro: [axis(0.0), axis(0.0), axis(0.0)],
            accelerometer: [axis(0.0), axis(0.0), axis(-9.81)],
            ..ImuSample::default()
        }
    }

    #[test]
    fn quantised_sensor_of_a_vessel_at_rest() {
        let (mut noise, mut newest) = (ChaCha8Rng::seed_from_u64(7), RepeatedSamples::default());
        let mut longest = 0;
        for _ in 0..1_000_000 {
            assert!(!newest.is_stuck(&still(&mut noise, 1e-3)));
            longest = longest.max(newest.count);
        }
        assert!((2..MAX_REPEATED / 2).contains(&longest), "{longest}");
    }

    #[test]
    fn repeated_sample_until_another_comes() {
        let (mut noise, mut newest) = (ChaCha8Rng::seed_from_u64(7), RepeatedSamples::default());
        let frozen = still(&mut noise, 1e-3);
        let stuck = (0..200).filter(|_| newest.is_stuck(&frozen)).count();
        assert_eq!(stuck as u32, 200 - (MAX_REPEATED - 1));
        // Motion of one axis is sufficient.
        let mut alive = frozen;
        alive.gyro[1] += 1e-3;
        assert!(!newest.is_stuck(&alive));
    }
}
