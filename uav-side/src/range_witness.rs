//! Consistency check of a rangefinder: its readings must follow the drone's motion.
//!
//! Spray, a wet window or a defect freezes a rangefinder at one reading, which it repeats with fresh time stamps. A
//! reading is evidence of a height only while it changes with the height. Over every displacement `w` of at least
//! [`WAY_M`] along the deck's normal, from odometry and forecast within [`WITHIN_S`], the readings must change by `d`
//! with `|d - w| <= WRONG_BY |w|`. Otherwise they are rejected until they follow such a displacement.

use alight_shared::{estimation::median, time::DroneTime};

/// Displacement over which readings are checked, m: ten times the noise of their median.
const WAY_M: f64 = 0.4;
/// Time limit of that displacement, s: velocities are wrong by 0.1 to 0.3 m/s, which must stay below [`WRONG_BY`] of
/// the displacement.
const WITHIN_S: f64 = 1.5;
/// Tolerated difference between readings and displacement, as a fraction of the displacement.
const WRONG_BY: f64 = 0.75;
const MEDIAN: usize = 5;
/// Difference between the heights by rangefinder and forecast above which they contradict each other, m.
const APART_M: f64 = 0.5;

/// Maximum distance by which a deck can be closer to the rangefinder than the feet, m. A shorter reading is invalid.
pub(crate) const BELOW_FEET_M: f64 = 0.10;

/// Whether two heights of the feet contradict each other; an unknown height contradicts nothing.
pub(crate) fn disagree(range_height: f64, forecast_height: Option<f64>) -> bool {
    forecast_height.is_some_and(|h| !((range_height - h).abs() <= APART_M))
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RangeWitness {
    /// Displacement along the deck's normal so far, m.
    way_m: f64,
    newest: [Option<f64>; MEDIAN],
    next: usize,
    /// Start of the current check: time, displacement and reading.
    from: Option<(DroneTime, f64, f64)>,
    contradicts: bool,
}

impl RangeWitness {
    /// Whether the readings failed to follow the last checked displacement.
    pub(crate) fn contradicts(&self) -> bool {
        self.contradicts
    }
    /// Integrates the speed away from the deck along its normal over `dt` (s). None means unknown and restarts the
    /// check.
    pub(crate) fn moves(&mut self, dt: f64, speed_mps: Option<f64>) {
        match speed_mps.filter(|v| v.is_finite()) {
            Some(v) => self.way_m += v * dt,
            None => self.from = None,
        }
    }
    pub(crate) fn reads(&mut self, at: DroneTime, range_m: f64) {
        if let Some(newest) = self.newest.get_mut(self.next) {
            *newest = Some(range_m);
        }
        self.next = (self.next + 1) % MEDIAN;
        let newest: Option<Vec<f64>> = self.newest.iter().copied().collect();
        let Some(range_m) = newest.and_then(median) else {
            return;
        };
        let (from_at, from_m, read_m) = *self.from.get_or_insert((at, self.way_m, range_m));
        let way = self.way_m - from_m;
        if way.abs() >= WAY_M {
            let wrong = (range_m - read_m - way).abs();
            self.contradicts = !(wrong <= WRONG_BY * way.abs());
            self.from = Some((at, self.way_m, range_m));
        } else if (at - from_at).secs() > WITHIN_S {
            self.from = Some((at, self.way_m, range_m));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    /// Descent at `sink` (m/s) with readings `read(height)` at 50 Hz and a speed that is wrong by `error`.
    fn descends(height: f64, until: f64, sink: f64, error: f64, read: impl Fn(f64) -> f64) -> RangeWitness {
        let mut w = RangeWitness::default();
        let mut h = height;
        let mut t = 10.0;
        let mut k = 0_u32;
        while h > until {
            h -= sink * 0.01;
            t += 0.01;
            w.moves(0.01, Some(error - sink));
            k += 1;
            if k.is_multiple_of(2) {
                let noise = 0.03 * f64::from(k % 7) / 3.0 - 0.03;
                w.reads(Time::from_secs(t), read(h) + noise);
            }
        }
        w
    }

    #[test]
    fn readings_that_follow_or_stick() {
        for error in [-0.2, 0.0, 0.2] {
            assert!(
                !descends(4.0, 0.0, 0.5, error, |h| h + 0.2).contradicts(),
                "{error}"
            );
            assert!(
                !descends(4.0, 0.0, 1.5, error, |h| h + 0.2).contradicts(),
                "{error}"
            );
        }
        for error in [-0.1, 0.0, 0.1] {
            // Stuck at the feet, at the initial height, and from some height on.
            assert!(descends(1.0, 0.0, 0.5, error, |_| 0.2).contradicts(), "{error}");
            assert!(descends(2.0, 0.0, 1.5, error, |_| 1.4).contradicts(), "{error}");
            assert!(
                descends(2.0, 0.0, 0.5, error, |h| h.max(1.0)).contradicts(),
                "{error}"
            );
            assert!(descends(2.0, 0.1, 0.5, error, |h| if h > 0.7 { h + 0.2 } else { 0.2 }).contradicts());
        }
        // Centimetres interpreted as metres, and the reverse.
        assert!(descends(2.0, 0.0, 0.5, 0.0, |h| 100.0 * h).contradicts());
        assert!(descends(2.0, 0.0, 0.5, 0.0, |h| 0.01 * h).contradicts());
        // A sensor that detects the water below a wet deck follows the motion; only a comparison of heights reveals it.
        assert!(!descends(2.0, 0.0, 0.5, 0.0, |h| h + 1.5).contradicts());
    }

    #[test]
    fn standstill_shows_nothing() {
        let mut w = RangeWitness::default();
        for k in 0..1000 {
            // The speed has a bias of 0.1 m/s.
            w.moves(0.02, Some(0.1));
            w.reads(Time::from_secs(0.02 * f64::from(k)), 0.22);
            assert!(!w.contradicts(), "{k}");
        }
    }
}
