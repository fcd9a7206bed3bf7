use std::collections::VecDeque;

use alight_shared::time::{Span, Time, TrueTime};

use crate::view::picture::MotionView;

/// Time between two samples, ms; a roll period of 2 s has eight.
const STEP_MS: i64 = 250;
const SAMPLES: usize = 240;

/// Roll and pitch (rad) and height (m, upwards), if known.
type Sample = Option<[f64; 3]>;

#[derive(Debug, Default)]
pub struct MotionHistory {
    samples: VecDeque<Sample>,
    newest: Option<Time<TrueTime>>,
}

impl MotionHistory {
    /// Adds the sample at `t` when one is due; None for unknown motion.
    pub fn add(&mut self, t: Time<TrueTime>, sample: Sample) {
        let step = Span::from_millis(STEP_MS);
        let Some(newest) = self.newest else {
            if sample.is_some() {
                self.newest = Some(t);
                self.samples.push_back(sample);
            }
            return;
        };
        let due = (t - newest).nanos() / step.nanos();
        if due < 0 || due > SAMPLES as i64 {
            *self = MotionHistory::default();
            return self.add(t, sample);
        }
        for k in 1..=due {
            self.samples.push_back(sample.filter(|_| k == due));
            self.newest = Some(newest + step * k);
        }
        while self.samples.len() > SAMPLES {
            self.samples.pop_front();
        }
    }
    /// Moves earlier heights to another reference level, in which the newest sample is `sample`.
    pub fn relevel(&mut self, sample: Sample) {
        let before = self.samples.iter().rev().flatten().next().copied();
        if let (Some(before), Some(sample)) = (before, sample) {
            let by = sample[2] - before[2];
            self.samples.iter_mut().flatten().for_each(|s| s[2] += by);
        }
    }
    pub fn view(&self) -> MotionView {
        let known = self.samples.iter().flatten();
        let (sum, n) = known.fold((0.0, 0_u32), |(sum, n), s| (sum + s[2], n + 1));
        let mean = if n > 0 { sum / f64::from(n) } else { 0.0 };
        let of = |value: fn(&[f64; 3], f64) -> f64| {
            let rounded = |s: &Sample| s.map(|s| (100.0 * value(&s, mean)).round() / 100.0);
            self.samples.iter().map(rounded).collect()
        };
        MotionView {
            step_s: STEP_MS as f64 * 1e-3,
            roll_deg: of(|s, _| s[0].to_degrees()),
            pitch_deg: of(|s, _| s[1].to_degrees()),
            heave_m: of(|s, mean| s[2] - mean),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_in_the_motion_of_the_last_minute() {
        let mut history = MotionHistory::default();
        let at = |ms: i64| Time::from_nanos(ms * 1_000_000);
        for k in 0..1200_i64 {
            // 100 s at 12 Hz, of which 2 s are missing.
            let t = k * 1000 / 12;
            if !(90_000..92_000).contains(&t) {
                history.add(at(t), Some([0.1, -0.2, if k % 2 == 0 { 5.5 } else { 4.5 }]));
            }
        }
        let view = history.view();
        assert_eq!(view.roll_deg.len(), SAMPLES);
        let gaps = view.heave_m.iter().filter(|h| h.is_none()).count();
        assert!((6..=9).contains(&gaps), "{gaps}");
        let heave: Vec<f64> = view.heave_m.iter().flatten().copied().collect();
        assert!(heave.iter().all(|h| h.abs() <= 1.01), "{heave:?}");
        assert_eq!(view.pitch_deg.last(), Some(&Some(-11.46)));
        // A jump of the clock starts a new history.
        history.add(at(10), Some([0.0; 3]));
        assert_eq!(history.view().roll_deg, [Some(0.0)]);
    }
}
