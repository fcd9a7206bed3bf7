//! The error of the predictions, measured: each is kept until the motion that it predicted has come.

use std::collections::VecDeque;

use crate::time::{Clock, Span, Time};
use crate::vessel_model::{DOFS, Motion};

use super::{MotionSample, SAMPLE_S};

/// Times ahead at which errors are measured, s.
pub(super) const SPREAD_AT_S: [f64; 6] = [0.2, 0.5, 1.0, 1.5, 2.0, 3.0];
/// Samples between two predictions that are kept.
const EVERY: u32 = 3;
/// Memory of the mean squares, comparisons: half a minute, and at first a fifth of all, because the first models are
/// the worst.
const MEMORY: f64 = 100.0;
const SHARE: f64 = 0.2;
/// Comparisons before which the deviation of the motion itself stands in.
const FIRST: f64 = 5.0;
/// Memory of the recent mean squares, comparisons.
const RECENT: f64 = 10.0;
/// Most predictions that wait.
const MAX_WAITING: usize = 64;

/// A prediction that waits for its time.
#[derive(Clone, Copy, Debug)]
struct Waiting<C: Clock> {
    due: Time<C>,
    horizon: usize,
    value: [f64; DOFS],
}

/// Mean squares of the errors.
#[derive(Clone, Debug, Default)]
pub(super) struct Errors<C: Clock> {
    waiting: VecDeque<Waiting<C>>,
    squares: [[f64; DOFS]; SPREAD_AT_S.len()],
    /// The same of the last seconds.
    recent: [[f64; DOFS]; SPREAD_AT_S.len()],
    count: [f64; SPREAD_AT_S.len()],
    since: u32,
}

impl<C: Clock> Errors<C> {
    /// Whether a prediction is to be kept.
    pub(super) fn is_due(&mut self) -> bool {
        self.since += 1;
        self.since >= EVERY
    }
    /// Keeps the motion predicted at `now` for each of [`SPREAD_AT_S`].
    pub(super) fn push(&mut self, now: Time<C>, predicted: [Motion; SPREAD_AT_S.len()]) {
        self.since = 0;
        for (horizon, (ahead, motion)) in SPREAD_AT_S.into_iter().zip(predicted).enumerate() {
            if self.waiting.len() < MAX_WAITING {
                self.waiting.push_back(Waiting {
                    due: now + Span::from_secs(ahead),
                    horizon,
                    value: motion.map(|m| m[0]),
                });
            }
        }
    }
    /// Compares what is due.
    pub(super) fn compare(&mut self, now: &MotionSample<C>) {
        let near = Span::from_secs(0.51 * SAMPLE_S);
        let Errors {
            waiting,
            squares,
            recent,
            count,
            ..
        } = self;
        waiting.retain(|w| {
            if w.due > now.at + near {
                return true;
            }
            if now.at - w.due < near {
                let compared = count[w.horizon] + 1.0;
                count[w.horizon] = compared;
                let n = (SHARE * compared).clamp(compared.min(FIRST), MEMORY);
                for d in 0..DOFS {
                    let e = now.value[d] - w.value[d];
                    let sum = &mut squares[w.horizon][d];
                    *sum += (e * e - *sum) / n;
                    let sum = &mut recent[w.horizon][d];
                    *sum += (e * e - *sum) / n.min(RECENT);
                }
            }
            false
        });
    }
    /// Mean square error `ahead` seconds on, one of [`SPREAD_AT_S`]; None until measured.
    pub(super) fn mean_squares(&self, ahead: f64) -> Option<[f64; DOFS]> {
        let h = SPREAD_AT_S.iter().position(|t| *t == ahead)?;
        (self.count[h] >= FIRST).then(|| self.squares[h])
    }
    /// Standard deviations `ahead` seconds on: zero now, as measured at [`SPREAD_AT_S`] and at least `least` there,
    /// between them in proportion, held after the last. `deviation` of the motion itself stands in until errors are
    /// measured.
    pub(super) fn spread(
        &self,
        deviation: [f64; DOFS],
        least: &[[f64; DOFS]; SPREAD_AT_S.len()],
        ahead: f64,
    ) -> [f64; DOFS] {
        let (mut before, mut from) = ([0.0; DOFS], 0.0);
        for (h, to) in SPREAD_AT_S.into_iter().enumerate() {
            let sd = if self.count[h] < FIRST {
                deviation
            } else {
                // What has lately been worse than usual will be for a while.
                core::array::from_fn(|d| self.squares[h][d].max(self.recent[h][d]).sqrt().max(least[h][d]))
            };
            if ahead <= to {
                let f = ((ahead - from) / (to - from)).clamp(0.0, 1.0);
                return core::array::from_fn(|d| before[d] + f * (sd[d] - before[d]));
            }
            (before, from) = (sd, to);
        }
        before
    }
}
