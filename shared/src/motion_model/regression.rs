//! Sums for the regression of the future on the past, with exponential forgetting.

use std::collections::VecDeque;

use crate::{
    time::Clock,
    vessel_model::{DOFS, HEAVE, PITCH, ROLL, SURGE, SWAY},
};
use nalgebra::{DMatrix, DVector};

use super::MotionSample;

/// Number of channels of a past sample: heave, tilt, their rates, and horizontal acceleration. Velocity is
/// omitted because it depends mostly on the helm.
pub(super) const CHANNELS: usize = 8;
pub(super) const LAGS: usize = 24;
/// Lags, samples: every one over one second, then every fourth over six. More lags gain less than 1 % (3 hulls).
pub(super) const LAG: [usize; LAGS] = [
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 16, 20, 24, 28, 32, 36, 40, 44, 48, 52, 56,
];
pub(super) const PAST: usize = 57;
/// Spacing of the predicted future values, samples.
pub(super) const STRIDE: usize = 2;
pub(super) const AHEAD: usize = 15;
pub(super) const REACH: usize = STRIDE * AHEAD;
pub(super) const INPUTS: usize = CHANNELS * LAGS;
pub(super) const OUTPUTS: usize = DOFS * AHEAD;

/// Memory, samples: 100 s, about twenty waves. Memories of 60 to 150 s differ by less than 3 % on the three hulls.
const MEMORY: f64 = 1000.0;

/// Exponentially weighted sums over rows of past `z` and future `f`.
#[derive(Clone, Debug)]
pub(super) struct Regression {
    /// Sum of `[z; f] z'`, inputs first; only the lower triangle of the symmetric square is stored.
    pub(super) products: DMatrix<f64>,
    /// Sum of the squares of `f`.
    pub(super) squares: DVector<f64>,
    /// Sum of `[z; f]`.
    pub(super) sums: DVector<f64>,
    pub(super) weight: f64,
    rows: f64,
}

impl Default for Regression {
    fn default() -> Self {
        Regression {
            products: DMatrix::zeros(INPUTS + OUTPUTS, INPUTS),
            squares: DVector::zeros(OUTPUTS),
            sums: DVector::zeros(INPUTS + OUTPUTS),
            weight: 0.0,
            rows: 0.0,
        }
    }
}

fn channels<C: Clock>(s: &MotionSample<C>) -> [f64; CHANNELS] {
    let [_, _, heave, roll, pitch, _] = s.value;
    let [sinks, dr, dp, north, east] = s.rate;
    [heave, roll, pitch, sinks, dr, dp, north, east]
}

/// Channels of a degree of freedom and of its rate.
pub(super) fn channels_of(dof: usize) -> (Option<usize>, Option<usize>) {
    match dof {
        HEAVE => (Some(0), Some(3)),
        ROLL => (Some(1), Some(4)),
        PITCH => (Some(2), Some(5)),
        SURGE => (None, Some(6)),
        SWAY => (None, Some(7)),
        _ => (None, None),
    }
}

/// Past at sample `i` of the record; None if the record is too short.
pub(super) fn past<C: Clock>(record: &VecDeque<MotionSample<C>>, i: usize) -> Option<DVector<f64>> {
    let mut z = DVector::zeros(INPUTS);
    for (l, lag) in LAG.iter().enumerate() {
        let s = record.get(i.checked_sub(*lag)?)?;
        z.rows_mut(CHANNELS * l, CHANNELS).copy_from_slice(&channels(s));
    }
    Some(z)
}

impl Regression {
    /// Adds the row whose future is now complete.
    pub(super) fn push<C: Clock>(&mut self, record: &VecDeque<MotionSample<C>>) {
        let Some(now) = record.len().checked_sub(1 + REACH) else {
            return;
        };
        let Some(z) = past(record, now) else { return };
        let keep = 1.0 - 1.0 / MEMORY;
        let mut row = DVector::zeros(INPUTS + OUTPUTS);
        row.rows_mut(0, INPUTS).copy_from(&z);
        for j in 0..AHEAD {
            if let Some(s) = record.get(now + STRIDE * (j + 1)) {
                row.rows_mut(INPUTS + DOFS * j, DOFS).copy_from_slice(&s.value);
            }
        }
        let columns = self.products.as_mut_slice().chunks_exact_mut(INPUTS + OUTPUTS);
        for (j, (column, z)) in columns.zip(z.iter()).enumerate() {
            for (sum, value) in column[j..].iter_mut().zip(&row.as_slice()[j..]) {
                *sum = z * value + keep * *sum;
            }
        }
        self.sums *= keep;
        self.sums += &row;
        self.squares *= keep;
        let future = row.rows(INPUTS, OUTPUTS);
        self.squares += future.component_mul(&future);
        self.weight = keep * self.weight + 1.0;
        self.rows += 1.0;
    }
    pub(super) fn rows(&self) -> f64 {
        self.rows
    }
    /// Mean of each degree of freedom over the first step of the future.
    pub(super) fn mean(&self) -> [f64; DOFS] {
        core::array::from_fn(|d| self.sums[INPUTS + d] / self.weight.max(1.0))
    }
    pub(super) fn deviation(&self) -> [f64; DOFS] {
        let mean = self.mean();
        core::array::from_fn(|d| {
            (self.squares[d] / self.weight.max(1.0) - mean[d] * mean[d])
                .max(0.0)
                .sqrt()
        })
    }
}

/// Degrees of freedom whose rates are also channels.
pub(super) const OBSERVED: [usize; 3] = [HEAVE, ROLL, PITCH];
