//! Plausibility of heave: physical bounds of waves, and mean and trend.
//!
//! A heave sensor removes slow components, so its mean over many waves is zero. In a window of length L, a
//! wave of amplitude a and period T has a trend of up to `6 a T / (pi L)` (regression of a sine): 0.95 a for
//! a 20 s swell in the shortest window, less than two standard deviations; the slow error of a good sensor
//! adds as much. An unfiltered integral, another quantity, or a constant offset exceeds this.

use alight_shared::time::{Span, Time, VesselClock};

use super::verdict::{ChannelState, Doubt, Taken, WINDOW_S};

/// Maximum heave, m: half the highest measured waves (29 m, RRS Discovery 2000, Holliday and others 2006).
const MAX_HEAVE_M: f64 = 15.0;
/// Maximum heave rate, m/s: water in a deep wave of limiting steepness 1/7, `g T / 14`, 8 m/s at 11.4 s.
const MAX_RATE_MPS: f64 = 8.0;
/// Change explained by a coarse clock or a late message, m.
const JUMP_M: f64 = 1.0;
/// Number of blocks of a window, and their length, s. Sums are kept per block.
const BLOCKS: usize = 6;
const BLOCK_S: f64 = WINDOW_S / BLOCKS as f64;
/// Blocks of the shortest window tested while the heave is used: two periods of a 20 s swell.
const MIN_BLOCKS: usize = 4;
/// Minimum number of values in a tested window.
const MIN_VALUES: f64 = 20.0;
const MAX_GAP_S: f64 = 5.0;
/// Permitted mean, and change of it within a window, m: slow error of a good sensor, and a reference point
/// that sinks with load, speed or heel.
const DRIFT_M: f64 = 0.5;
const MEAN_M: f64 = 1.0;
/// Additional permitted mean and change, in standard deviations about the trend and of the sensor. A slow
/// error of 1/7 of the significant height with a memory of 40 s then passes for hours.
const DRIFT_SPREADS: f64 = 4.0;
const MEAN_SPREADS: f64 = 2.0;
const STATED: f64 = 4.0;

/// Sums of 1, time (s), heave (m), and the products of time and time, time and heave, heave and heave.
#[derive(Clone, Copy, Debug, Default)]
struct Sums([f64; 6]);

impl Sums {
    fn new(t: f64, h: f64) -> Sums {
        Sums([1.0, t, h, t * t, t * h, h * h])
    }
    fn and(self, o: Sums) -> Sums {
        Sums(core::array::from_fn(|k| self.0[k] + o.0[k]))
    }
    /// Mean heave (m), its slope (m/s), standard deviation about it (m), and length of the window (s).
    fn regression(&self) -> Option<[f64; 4]> {
        let n = self.0[0];
        if n < MIN_VALUES {
            return None;
        }
        let [_, t, h, tt, th, hh] = self.0.map(|sum| sum / n);
        let (tt, th, hh) = (tt - t * t, th - t * h, hh - h * h);
        // The variance of uniformly spread times is a twelfth of the squared length.
        (tt > 0.0).then(|| {
            let slope = th / tt;
            [h, slope, (hh - slope * th).max(0.0).sqrt(), (12.0 * tt).sqrt()]
        })
    }
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Heave {
    last: Option<(Time<VesselClock>, f64)>,
    /// Start of the first block, and time of the newest value.
    window: Option<(Time<VesselClock>, Time<VesselClock>)>,
    block: Sums,
    ring: [Sums; BLOCKS],
    /// Number of blocks completed since the start.
    blocks: usize,
}

impl Heave {
    /// Adds a heave and its stated standard deviation, m.
    pub(super) fn take(
        &mut self,
        verdict: &mut ChannelState,
        at: Time<VesselClock>,
        heave: f64,
        sd: f64,
    ) -> Taken {
        let oldest = at - Span::from_secs(WINDOW_S + BLOCK_S);
        let since = self.window.map_or(at, |(begin, _)| begin.max(oldest));
        let doubt = self.doubt(at, heave);
        let loses = match doubt {
            Some(doubt) => verdict.reject(at, doubt),
            None => self.add(verdict, at, heave, sd),
        };
        if loses || (doubt.is_some() && verdict.is_out()) {
            self.clear();
        }
        Taken {
            believed: doubt.is_none() && !verdict.is_out(),
            since: loses.then_some(since),
        }
    }
    /// Reason why a single value is physically impossible.
    fn doubt(&mut self, at: Time<VesselClock>, heave: f64) -> Option<Doubt> {
        let last = self.last.take();
        if !(-MAX_HEAVE_M..=MAX_HEAVE_M).contains(&heave) {
            return Some(Doubt::Beyond(heave.abs()));
        }
        self.last = Some((at, heave));
        let (then, before) = last?;
        let change = heave - before;
        let most = JUMP_M + MAX_RATE_MPS * (at - then).abs().secs();
        (change.abs() > most).then_some(Doubt::Jump(change))
    }
    /// Adds a possible value. Returns true if the channel is rejected from now on.
    fn add(&mut self, verdict: &mut ChannelState, at: Time<VesselClock>, heave: f64, sd: f64) -> bool {
        let begin = match self.window {
            Some((begin, newest)) if (at - newest).secs() > -1.0 && (at - newest).secs() <= MAX_GAP_S => {
                if at <= newest {
                    return false;
                }
                begin
            }
            Some(_) | None => {
                self.clear();
                at
            }
        };
        self.window = Some((begin, at));
        let t = (at - begin).secs();
        let loses = t >= BLOCK_S * (self.blocks + 1) as f64 && self.close(verdict, at, sd);
        self.block = self.block.and(Sums::new(t, heave));
        loses
    }
    /// Ends a block and tests the window.
    fn close(&mut self, verdict: &mut ChannelState, at: Time<VesselClock>, sd: f64) -> bool {
        let block = core::mem::take(&mut self.block);
        if let Some(slot) = self.ring.get_mut(self.blocks % BLOCKS) {
            *slot = block;
        }
        self.blocks += 1;
        let needed = if verdict.is_out() { BLOCKS } else { MIN_BLOCKS };
        if self.blocks < needed {
            return false;
        }
        let all = self.ring.iter().fold(Sums::default(), |all, b| all.and(*b));
        let Some([mean, slope, spread, length]) = all.regression() else {
            return false;
        };
        let doubt = if (slope * length).abs() > DRIFT_M + DRIFT_SPREADS * spread + STATED * sd {
            Some(Doubt::Drift(60.0 * slope))
        } else if mean.abs() > MEAN_M + MEAN_SPREADS * spread + STATED * sd {
            Some(Doubt::Mean(mean))
        } else {
            None
        };
        verdict.judge(at, doubt)
    }
    fn clear(&mut self) {
        *self = Heave {
            last: self.last,
            ..Heave::default()
        };
    }
}
