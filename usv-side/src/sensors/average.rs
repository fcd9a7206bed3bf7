//! Inertial samples at the rate of the filter.

use alight_shared::msg::ImuSample;

/// Longest time that is averaged over, ns: 100 Hz.
const WINDOW_NS: i64 = 10_000_000;
/// Most samples in a window: a sensor that repeats its time must not be summed for ever.
const MAX_SAMPLES: u32 = 1000;

/// Means of inertial samples over 0.01 s; those of a sensor that is no faster pass as they are, at once.
#[derive(Clone, Debug, Default)]
pub struct Average {
    open: Option<Window>,
    /// The time of the newest sample that passed at once, ns.
    passed_ns: Option<i64>,
}

/// A sample of the filter's rate is as far from the one before, ns, and a little jitter.
const APART_NS: i64 = WINDOW_NS * 95 / 100;

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
    /// Takes a sample at the source's time `at_ns`; gives what is complete by it, in order. A sample that is not newer than the
    /// last passes at once: it is counted where samples are admitted.
    pub fn push(&mut self, at_ns: i64, sample: &ImuSample) -> [Option<(i64, ImuSample)>; 2] {
        let newest = self.open.map(|w| w.last_ns).or(self.passed_ns);
        let own = Some((at_ns, *sample));
        if newest.is_some_and(|last| at_ns <= last && last.saturating_sub(at_ns) < 1_000_000_000) {
            return [own, None];
        }
        let Some(w) = &mut self.open else {
            let near = |passed: i64| (0..APART_NS).contains(&at_ns.saturating_sub(passed));
            if self.passed_ns.is_some_and(near) {
                self.open = Some(Window::new(at_ns, sample));
                return [None, None];
            }
            self.passed_ns = Some(at_ns);
            return [own, None];
        };
        let since = at_ns.saturating_sub(w.first_ns);
        if (0..APART_NS).contains(&since) && w.count < MAX_SAMPLES {
            w.last_ns = at_ns;
            w.times += since;
            w.count += 1;
            for k in 0..3 {
                w.sum.gyro[k] += sample.gyro[k];
                w.sum.accelerometer[k] += sample.accelerometer[k];
            }
            return [None, None];
        }
        let mean = Some(w.mean());
        if w.count == 1 {
            // The sensor is no faster than the filter: nothing is waited for.
            (self.open, self.passed_ns) = (None, Some(at_ns));
            return [mean, own];
        }
        self.open = Some(Window::new(at_ns, sample));
        [mean, None]
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

    /// Samples that pass of those so far apart, with their times, and the delays, ms.
    fn passed(apart_ms: impl Fn(i64) -> i64, samples: i64) -> (Vec<(i64, f64)>, Vec<i64>) {
        let (mut a, mut out, mut delays, mut t) = (Average::default(), Vec::new(), Vec::new(), 0);
        for k in 0..samples {
            for (at_ns, s) in a.push(t * 1_000_000, &sample(k as f64)).into_iter().flatten() {
                out.push((at_ns / 1_000_000, s.gyro[0]));
                delays.push(t - at_ns / 1_000_000);
            }
            t += apart_ms(k);
        }
        out.extend(a.finish().map(|(at_ns, s)| (at_ns / 1_000_000, s.gyro[0])));
        (out, delays)
    }

    #[test]
    fn average_of_a_fast_sensor() {
        // 500 Hz for a second: means of five, dated at their middle, behind the first sample.
        let (out, _) = passed(|_| 2, 501);
        assert_eq!(out.len(), 101);
        assert_eq!((out[0], out[1], out[4]), ((0, 0.0), (6, 3.0), (36, 18.0)));
    }

    #[test]
    fn slow_sensor_without_delay() {
        for apart_ms in [10, 20, 100] {
            let (out, delays) = passed(|_| apart_ms, 50);
            let all: Vec<_> = (0..50).map(|k| (apart_ms * k, k as f64)).collect();
            assert_eq!((out, delays), (all, vec![0; 50]), "{apart_ms} ms");
        }
        // One that jitters, and one that becomes slow.
        let (out, delays) = passed(|k| 10 + k % 2, 60);
        assert!(
            out.len() >= 50 && delays.iter().all(|d| *d <= 12),
            "{out:?} {delays:?}"
        );
        let (out, delays) = passed(|k| if k < 50 { 2 } else { 20 }, 100);
        assert_eq!((out.last(), delays.last()), (Some(&(1080, 99.0)), Some(&0)));
    }

    #[test]
    fn average_with_a_repeated_time() {
        let mut a = Average::default();
        assert_eq!(a.push(0, &sample(1.0)), [Some((0, sample(1.0))), None]);
        for _ in 0..10 {
            assert_eq!(a.push(0, &sample(2.0)), [Some((0, sample(2.0))), None]);
        }
        a.push(1, &sample(3.0));
        assert_eq!(a.push(1, &sample(2.0)), [Some((1, sample(2.0))), None]);
        assert_eq!(a.finish(), Some((1, sample(3.0))));
    }
}
