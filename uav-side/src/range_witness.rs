//! Whether a rangefinder's readings follow the motion that should move them.
//!
//! Spray, a wet window or a defect leave a rangefinder at one reading, near the feet or anywhere, and it goes on stating it
//! with fresh stamps. A reading is a witness of a height only where it moves as the height does: over every way `w` of at
//! least [`WAY_M`] that odometry and forecast see the drone go along the deck's normal within [`WITHIN_S`], the readings have
//! to change by `d` with `|d - w| <= WRONG_BY |w|`. One that does not contradicts, until it has followed such a way again.

use alight_shared::estimation::median;
use alight_shared::time::{DroneClock, Time};

type DroneTime = Time<DroneClock>;

/// A way that shows whether readings follow it, m: ten times the noise of their median.
const WAY_M: f64 = 0.4;
/// It is gone within this time, s: velocities err by 0.1 to 0.3 m/s, which must stay less than [`WRONG_BY`] of the way.
const WITHIN_S: f64 = 1.5;
/// Readings follow a way that they differ from by no more than this part of it.
const WRONG_BY: f64 = 0.75;
/// Readings whose median counts.
const MEDIAN: usize = 5;
/// Heights of the feet above the deck by rangefinder and forecast that differ by more than this contradict each other, m.
const APART_M: f64 = 0.5;

/// No deck is nearer to the rangefinder than the feet by more than this, m: such a reading, as the 0 of a device that measures
/// nothing, is invalid.
pub(crate) const BELOW_FEET_M: f64 = 0.10;

/// Whether two heights of the feet contradict each other; what is not known contradicts nothing.
pub(crate) fn disagree(range_height: f64, forecast_height: Option<f64>) -> bool {
    forecast_height.is_some_and(|h| !((range_height - h).abs() <= APART_M))
}

/// The watch over a rangefinder.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RangeWitness {
    /// Way along the deck's normal so far, m.
    way_m: f64,
    /// The newest readings.
    newest: [Option<f64>; MEDIAN],
    next: usize,
    /// Beginning of the watched way: its time, the way and the reading there.
    from: Option<(DroneTime, f64, f64)>,
    contradicts: bool,
}

impl RangeWitness {
    /// The readings did not follow the last way that shows it.
    pub(crate) fn contradicts(&self) -> bool {
        self.contradicts
    }
    /// The drone goes away from the deck at this speed along its normal for `dt` (s); None: not known.
    pub(crate) fn moves(&mut self, dt: f64, speed_mps: Option<f64>) {
        match speed_mps.filter(|v| v.is_finite()) {
            Some(v) => self.way_m += v * dt,
            None => self.from = None,
        }
    }
    /// A reading, m.
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

    /// Down at `sink` (m/s) from `height` (m) to `until`, with readings of `read(height)` at 50 Hz and speeds that err.
    fn descends(height: f64, until: f64, sink: f64, error: f64, read: impl Fn(f64) -> f64) -> RangeWitness {
        let (mut w, mut h, mut t) = (RangeWitness::default(), height, 10.0);
        let mut k = 0_u32;
        while h > until {
            h -= sink * 0.01;
            t += 0.01;
            w.moves(0.01, Some(error - sink));
            k += 1;
            if k.is_multiple_of(2) {
                // Noise of 3 cm, by turns.
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
            // Stuck at the feet, at the height where it began, from a height on.
            assert!(descends(1.0, 0.0, 0.5, error, |_| 0.2).contradicts(), "{error}");
            assert!(descends(2.0, 0.0, 1.5, error, |_| 1.4).contradicts(), "{error}");
            assert!(
                descends(2.0, 0.0, 0.5, error, |h| h.max(1.0)).contradicts(),
                "{error}"
            );
            assert!(descends(2.0, 0.1, 0.5, error, |h| if h > 0.7 { h + 0.2 } else { 0.2 }).contradicts());
        }
        // Over a wet deck it sees the water below: it follows, and only another height shows that it is wrong.
        assert!(!descends(2.0, 0.0, 0.5, 0.0, |h| h + 1.5).contradicts());
    }

    #[test]
    fn standstill_shows_nothing() {
        let mut w = RangeWitness::default();
        for k in 0..1000 {
            // The speed errs by 0.1 m/s to one side.
            w.moves(0.02, Some(0.1));
            w.reads(Time::from_secs(0.02 * f64::from(k)), 0.22);
            assert!(!w.contradicts(), "{k}");
        }
    }
}
