//! Inertial samples at the rate of the filter.

use alight_shared::msg::ImuSample;

/// Longest time that is averaged over, ns: 100 Hz.
const WINDOW_NS: i64 = 10_000_000;
/// Most samples in a window: a sensor that repeats its time must not be summed for ever.
const MAX_SAMPLES: u32 = 1000;

/// Means of inertial samples over 0.01 s; slower samples pass as they are.
#[derive(Clone, Debug, Default)]
pub struct Average {
    open: Option<Window>,
}

#[derive(Clone, Copy, Debug)]
struct Window {
    first_ns: i64,
    last_ns: i64,
    /// Sum of times since the first, ns.
    times: i64,
    count: u32,
    /// The first sample, with the sums of rates and specific forces.
    sum: ImuSample,
}

impl Window {
    fn new(at_ns: i64, sample: &ImuSample) -> Self {
        Window {
            first_ns: at_ns,
            last_ns: at_ns,
            times: 0,
            count: 1,
            sum: *sample,
        }
    }
    fn mean(&self) -> (i64, ImuSample) {
        let n = f64::from(self.count);
        let sample = ImuSample {
            gyro: self.sum.gyro.map(|v| v / n),
            accelerometer: self.sum.accelerometer.map(|v| v / n),
            ..self.sum
        };
        (self.first_ns + self.times / i64::from(self.count), sample)
    }
}

impl Average {
    /// Takes a sample at the source's time `at_ns`; returns a mean when one is complete. A sample that is not newer
    /// than the last passes at once: it is counted where samples are admitted.
    pub fn push(&mut self, at_ns: i64, sample: &ImuSample) -> Option<(i64, ImuSample)> {
        let Some(w) = &mut self.open else {
            self.open = Some(Window::new(at_ns, sample));
            return None;
        };
        if at_ns <= w.last_ns && w.last_ns.saturating_sub(at_ns) < 1_000_000_000 {
            return Some((at_ns, *sample));
        }
        let since = at_ns.saturating_sub(w.first_ns);
        if (0..WINDOW_NS * 95 / 100).contains(&since) && w.count < MAX_SAMPLES {
            w.last_ns = at_ns;
            w.times += since;
            w.count += 1;
            for k in 0..3 {
                w.sum.gyro[k] += sample.gyro[k];
                w.sum.accelerometer[k] += sample.accelerometer[k];
            }
            return None;
        }
        let mean = w.mean();
        self.open = Some(Window::new(at_ns, sample));
        Some(mean)
    }
    /// The mean of the incomplete window at the end.
    pub fn finish(&mut self) -> Option<(i64, ImuSample)> {
        self.open.take().map(|w| w.mean())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(x: f64) -> ImuSample {
        ImuSample {
            gyro: [x, 0.0, 0.0],
            accelerometer: [0.0, 0.0, -x],
            ..ImuSample::default()
        }
    }

    #[test]
    fn average_of_fast_and_slow_sensors() {
        let mut a = Average::default();
        // 500 Hz for a second: means of five, dated at their middle.
        let out: Vec<_> = (0..500)
            .filter_map(|k| a.push(k * 2_000_000, &sample(k as f64)))
            .collect();
        assert_eq!(out.len(), 99);
        let (at, mean) = out[3];
        assert_eq!((at, mean.gyro[0]), (34_000_000, 17.0));
        let mut a = Average::default();
        let out: Vec<_> = (0..50)
            .filter_map(|k| a.push(k * 20_000_000, &sample(k as f64)))
            .collect();
        assert_eq!(out.len(), 49);
        assert!(
            out.iter()
                .enumerate()
                .all(|(k, (at, s))| *at == k as i64 * 20_000_000 && s.gyro[0] == k as f64)
        );
        assert_eq!(a.finish().unwrap().0, 49 * 20_000_000);
    }

    #[test]
    fn average_with_a_repeated_time() {
        let mut a = Average::default();
        a.push(0, &sample(1.0));
        for _ in 0..10 {
            assert_eq!(a.push(0, &sample(2.0)), Some((0, sample(2.0))));
        }
        assert_eq!(a.finish(), Some((0, sample(1.0))));
    }
}
