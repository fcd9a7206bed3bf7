//! Comparison of predictions with the later motion, a ridge regression, and the last motion held constant.

use std::collections::VecDeque;

use alight_shared::{
    frames::wrap_angle,
    time::{Span, VesselTime},
};
use serde::Serialize;

use super::ridge::{PublishedMotion, RefittedRidge, RollPitchHeave};

/// Horizons at which predictions are compared, s.
pub const HORIZONS_S: [f64; 4] = [0.5, 1.0, 2.0, 3.0];
const DOFS: [&str; 6] = ["north", "east", "heave", "roll", "pitch", "yaw"];
const HEAVE: usize = 2;
const MAX_PENDING: usize = 1024;
const RIDGE_DOFS: [usize; 3] = [3, 4, HEAVE];
/// Maximum time between two estimates for interpolation, s.
const MAX_GAP_S: f64 = 0.2;

#[derive(Clone, Debug, Serialize)]
pub struct PredictionReview {
    /// Degree of freedom: position north, east, down, then roll, pitch, yaw.
    pub what: &'static str,
    /// Unit: m or deg.
    pub unit: &'static str,
    pub count: u64,
    /// Root mean square difference from the later estimate, per horizon.
    pub rms: [f64; 4],
    /// RMS of a ridge regression on the estimates of the last two minutes; None without a prediction.
    pub ridge_rms: [Option<f64>; 4],
    /// RMS of holding the last estimate.
    pub hold_rms: [f64; 4],
    /// Fraction of differences within 1.96 of the predicted standard deviation.
    pub inside_95: [f64; 4],
}

#[derive(Clone, Copy, Debug)]
struct Pending {
    horizon: usize,
    due: VesselTime,
    predicted: [f64; 6],
    sd: [f64; 6],
    held: [f64; 6],
    ridge: Option<[f64; 3]>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    n: u64,
    squares: [f64; 6],
    held: [f64; 6],
    inside: [u64; 6],
    ridge: u64,
    ridge_squares: [f64; 3],
}

/// Predictions of a motion given as position north, east, down (m), roll, pitch, yaw (rad).
#[derive(Debug, Default)]
pub struct Predictions {
    pending: VecDeque<Pending>,
    last: Option<(VesselTime, [f64; 6])>,
    sums: [Sums; HORIZONS_S.len()],
    published: PublishedMotion,
    /// Regression; None before the first motion.
    ridge: Option<RefittedRidge>,
}

fn difference(dof: usize, a: f64, b: f64) -> f64 {
    if dof < 3 { a - b } else { wrap_angle(a - b) }
}

impl Predictions {
    /// Stores a prediction made at `at` with the mean water level at `level`, m down: motion and its standard deviations
    /// at a time ahead (s).
    pub fn push(
        &mut self,
        at: VesselTime,
        predicted: impl Fn(f64) -> Option<([f64; 6], [f64; 6])>,
        level: f64,
    ) {
        let Some((held, _)) = predicted(0.0) else { return };
        let ridge = self.ridge.as_mut().and_then(|r| r.predict(&self.published, at));
        for (horizon, h) in HORIZONS_S.iter().enumerate() {
            if let Some((predicted, sd)) = predicted(*h)
                && self.pending.len() < MAX_PENDING
            {
                self.pending.push_back(Pending {
                    horizon,
                    due: at + Span::from_secs(*h),
                    predicted,
                    sd,
                    held,
                    ridge: ridge
                        .as_ref()
                        .and_then(|r| r.get(horizon))
                        .map(|r| [r[0], r[1], r[2] + level]),
                });
            }
        }
    }

    /// Adds a motion as published, for the regression.
    pub fn publish(&mut self, at: VesselTime, motion: RollPitchHeave) {
        self.ridge
            .get_or_insert_with(|| RefittedRidge::new(at, &HORIZONS_S));
        self.published.push_motion(at, motion);
        self.published.forget();
    }

    /// Compares due predictions with the motion at `at`.
    pub fn compare(&mut self, at: VesselTime, eta: [f64; 6]) {
        if let Some((before, was)) = self.last.replace((at, eta)) {
            let whole = (at - before).secs();
            let sums = &mut self.sums;
            let sound = whole > 0.0 && whole < MAX_GAP_S;
            self.pending.retain(|p| {
                if p.due > at {
                    return true;
                }
                let fraction = (p.due - before).secs() / whole;
                if let Some(s) = sums.get_mut(p.horizon)
                    && sound
                    && (0.0..=1.0).contains(&fraction)
                {
                    s.n += 1;
                    let then: [f64; 6] =
                        core::array::from_fn(|d| was[d] + fraction * difference(d, eta[d], was[d]));
                    if let Some(ridge) = p.ridge {
                        s.ridge += 1;
                        for (k, d) in RIDGE_DOFS.into_iter().enumerate() {
                            s.ridge_squares[k] += difference(d, ridge[k], then[d]).powi(2);
                        }
                    }
                    for d in 0..6 {
                        let off = difference(d, p.predicted[d], then[d]);
                        s.squares[d] += off * off;
                        s.held[d] += difference(d, p.held[d], then[d]).powi(2);
                        s.inside[d] += u64::from(off.abs() <= 1.96 * p.sd[d]);
                    }
                }
                false
            });
        }
    }
    /// Adds the comparisons of another run.
    pub fn add(&mut self, other: &Predictions) {
        for (sums, others) in self.sums.iter_mut().zip(&other.sums) {
            sums.n += others.n;
            sums.ridge += others.ridge;
            for d in 0..6 {
                sums.squares[d] += others.squares[d];
                sums.held[d] += others.held[d];
                sums.inside[d] += others.inside[d];
            }
            for k in 0..RIDGE_DOFS.len() {
                sums.ridge_squares[k] += others.ridge_squares[k];
            }
        }
    }

    /// Errors per degree of freedom; with heave if it is observable.
    pub fn reviews(&self, heave: bool) -> Vec<PredictionReview> {
        let count = self.sums.iter().map(|s| s.n).min().unwrap_or_default();
        if count == 0 {
            return Vec::new();
        }
        let dofs = (0..6).filter(|d| *d != HEAVE || heave);
        dofs.map(|d| {
            let scale = if d < 3 { 1.0 } else { 1.0_f64.to_degrees() };
            let per_horizon = |f: &dyn Fn(&Sums) -> f64| self.sums.each_ref().map(f);
            PredictionReview {
                what: DOFS[d],
                unit: if d < 3 { "m" } else { "deg" },
                count,
                rms: per_horizon(&|s| scale * (s.squares[d] / s.n as f64).sqrt()),
                ridge_rms: self.sums.each_ref().map(|s| {
                    let k = RIDGE_DOFS.iter().position(|r| *r == d)?;
                    (s.ridge > 0).then(|| scale * (s.ridge_squares[k] / s.ridge as f64).sqrt())
                }),
                hold_rms: per_horizon(&|s| scale * (s.held[d] / s.n as f64).sqrt()),
                inside_95: per_horizon(&|s| s.inside[d] as f64 / s.n as f64),
            }
        })
        .collect()
    }
}
