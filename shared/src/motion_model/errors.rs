//! Prediction errors, measured by storing each prediction until its time arrives.

use std::collections::VecDeque;

use crate::{
    time::{Clock, Span, Time},
    vessel_model::{DOFS, Motion, PITCH, ROLL, SURGE, SWAY},
};

use super::{MotionSample, SAMPLE_S};

/// Prediction horizons at which errors are measured, s.
pub(super) const SPREAD_AT_S: [f64; 6] = [0.2, 0.5, 1.0, 1.5, 2.0, 3.0];
/// Memory of the mean squares, in comparisons: half a minute. At first it is a fifth of all comparisons,
/// because the first models are the worst.
const MEMORY: f64 = 300.0;
const INITIAL_FRACTION: f64 = 0.2;
/// Number of comparisons before measured errors replace the standard deviation of the motion itself.
const FIRST: f64 = 15.0;
/// Memory of the recent mean squares, in comparisons: two seconds.
const RECENT: f64 = 20.0;
/// Index in [`SPREAD_AT_S`] of the horizon (1 s) whose errors weight the identifications.
const WEIGHED_AT: usize = 2;
/// Maximum number of pending predictions over all horizons.
const MAX_WAITING: usize = 96;
/// Number of the shortest horizons whose errors also widen the longer ones.
const SOON: usize = 2;
/// Compared quantities: degrees of freedom, and acceleration north and east, which shows a manoeuvre first.
const COMPARED: usize = DOFS + 2;
/// Ratio by which a mean square over a few waves can exceed its usual value by chance (95 % of chi squared / 8).
const BY_CHANCE: f64 = 1.94;

#[derive(Clone, Copy, Debug)]
struct Waiting<const N: usize, C: Clock> {
    due: Time<C>,
    horizon: usize,
    value: [f64; N],
}

/// Mean squares of prediction errors of `N` quantities.
#[derive(Clone, Debug)]
pub struct MeasuredErrors<const N: usize, C: Clock> {
    waiting: VecDeque<Waiting<N, C>>,
    squares: [[f64; N]; SPREAD_AT_S.len()],
    /// Mean squares over the last two seconds.
    recent: [[f64; N]; SPREAD_AT_S.len()],
    count: [f64; SPREAD_AT_S.len()],
}

impl<const N: usize, C: Clock> Default for MeasuredErrors<N, C> {
    fn default() -> Self {
        MeasuredErrors {
            waiting: VecDeque::new(),
            squares: [[0.0; N]; SPREAD_AT_S.len()],
            recent: [[0.0; N]; SPREAD_AT_S.len()],
            count: Default::default(),
        }
    }
}

impl<const N: usize, C: Clock> MeasuredErrors<N, C> {
    /// Stores the predictions made at `now` for each of [`SPREAD_AT_S`]; `predicted` maps seconds ahead to values.
    pub fn push(&mut self, now: Time<C>, predicted: impl Fn(f64) -> [f64; N]) {
        for (horizon, ahead) in SPREAD_AT_S.into_iter().enumerate() {
            if self.waiting.len() < MAX_WAITING {
                self.waiting.push_back(Waiting {
                    due: now + Span::from_secs(ahead),
                    horizon,
                    value: predicted(ahead),
                });
            }
        }
    }
    /// Compares the predictions for `now` with the actual values.
    pub fn compare(&mut self, now: Time<C>, values: [f64; N]) {
        let near = Span::from_secs(0.51 * SAMPLE_S);
        let MeasuredErrors {
            waiting,
            squares,
            recent,
            count,
        } = self;
        waiting.retain(|w| {
            if w.due > now + near {
                return true;
            }
            if now - w.due < near {
                let compared = count[w.horizon] + 1.0;
                count[w.horizon] = compared;
                let n = (INITIAL_FRACTION * compared).clamp(compared.min(FIRST), MEMORY);
                for (d, (measured, predicted)) in values.into_iter().zip(w.value).enumerate() {
                    let e = measured - predicted;
                    let sum = &mut squares[w.horizon][d];
                    *sum += (e * e - *sum) / n;
                    let sum = &mut recent[w.horizon][d];
                    *sum += (e * e - *sum) / n.min(RECENT);
                }
            }
            false
        });
    }
    /// Mean square errors at a horizon: the larger of the half-minute and the two-second means; None until measured.
    fn mean_squares(&self, horizon: usize) -> Option<[f64; N]> {
        (self.count[horizon] >= FIRST)
            .then(|| core::array::from_fn(|d| self.squares[horizon][d].max(self.recent[horizon][d])))
    }
    /// Standard deviations of a prediction `ahead` s ahead: zero at 0 s, linear between [`SPREAD_AT_S`]; None
    /// until measured.
    pub fn deviation(&self, ahead: f64) -> Option<[f64; N]> {
        let mut knots = [[0.0; N]; SPREAD_AT_S.len()];
        for (horizon, knot) in knots.iter_mut().enumerate() {
            *knot = self.mean_squares(horizon)?.map(f64::sqrt);
        }
        Some(between(&knots, ahead))
    }
}

/// Linear interpolation at `ahead` s: zero at 0 s, `knots` at [`SPREAD_AT_S`], then constant.
fn between<const N: usize>(knots: &[[f64; N]; SPREAD_AT_S.len()], ahead: f64) -> [f64; N] {
    let mut before = [0.0; N];
    let mut from = 0.0;
    for (&knot, to) in knots.iter().zip(SPREAD_AT_S) {
        if ahead <= to {
            let f = ((ahead - from) / (to - from)).clamp(0.0, 1.0);
            return core::array::from_fn(|d| before[d] + f * (knot[d] - before[d]));
        }
        before = knot;
        from = to;
    }
    before
}

/// Errors of the motion: degrees of freedom, and acceleration north and east.
#[derive(Clone, Debug, Default)]
pub(super) struct ForecastErrors<C: Clock>(MeasuredErrors<COMPARED, C>);

impl<C: Clock> ForecastErrors<C> {
    /// Stores the motion predicted at `now`; `predicted` maps seconds ahead to the motion.
    pub(super) fn push(&mut self, now: Time<C>, predicted: impl Fn(f64) -> Motion) {
        self.0.push(now, |ahead| {
            let motion = predicted(ahead);
            core::array::from_fn(|d| match motion.get(d) {
                Some(m) => m[0],
                None => motion[[SURGE, SWAY][d - DOFS]][1],
            })
        });
    }
    pub(super) fn compare(&mut self, now: &MotionSample<C>) {
        let [_, _, _, north, east] = now.rate;
        let values = core::array::from_fn(|d| match now.value.get(d) {
            Some(v) => *v,
            None => [north, east][d - DOFS],
        });
        self.0.compare(now.at, values);
    }
    /// Inverse mean square errors one second ahead, 1 until measured; equal for quantities that a turn mixes.
    pub(super) fn weights(&self) -> [f64; DOFS] {
        let squares = &self.0.squares[WEIGHED_AT];
        core::array::from_fn(|d| match d {
            _ if self.0.count[WEIGHED_AT] < FIRST => 1.0,
            SURGE | SWAY => 1.0 / (squares[SURGE] + squares[SWAY]).max(1e-12),
            ROLL | PITCH => 1.0 / (squares[ROLL] + squares[PITCH]).max(1e-12),
            _ => 1.0 / squares[d].max(1e-12),
        })
    }
    /// Ratio of recent to usual mean squares at the shortest horizons, at least 1. A change shows there long before
    /// longer predictions are due. It affects these, too, because they start before the unforeseen acceleration.
    fn recent_increase(&self) -> [f64; DOFS] {
        let ratio = |h: usize, d: usize| {
            let usual = self.0.squares[h][d].max(f64::MIN_POSITIVE);
            if self.0.count[h] < FIRST {
                1.0
            } else {
                self.0.recent[h][d] / usual
            }
        };
        let pushed = (DOFS..COMPARED).map(|d| ratio(0, d)).fold(0.0, f64::max) / BY_CHANCE;
        core::array::from_fn(|d| (0..SOON).map(|h| ratio(h, d)).fold(pushed.max(1.0), f64::max))
    }
    /// Standard deviations of a prediction `ahead` s ahead: zero at 0 s, as measured at [`SPREAD_AT_S`] but
    /// at least `floor`, linear in between, then constant; `deviation` of the motion itself until measured. A
    /// recent increase widens them, at most to the deviation of two independent motions.
    pub(super) fn spread(
        &self,
        deviation: [f64; DOFS],
        floor: &[[f64; DOFS]; SPREAD_AT_S.len()],
        ahead: f64,
    ) -> [f64; DOFS] {
        let recent_increase = self.recent_increase();
        let knots = core::array::from_fn(|h| {
            self.0.mean_squares(h).map_or(deviation, |squares| {
                core::array::from_fn(|d| {
                    let unknown = 2.0 * deviation[d] * deviation[d];
                    let widened = (self.0.squares[h][d] * recent_increase[d]).min(unknown);
                    squares[d].max(widened).sqrt().max(floor[h][d])
                })
            })
        });
        between(&knots, ahead)
    }
}
