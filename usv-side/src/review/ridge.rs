//! Model-free reference predictor: ridge regression on the node's published estimates.
//!
//! Roll, pitch, heave and their rates at 24 lags over 5.6 s predict roll, pitch and heave one horizon ahead
//! (Hoerl and Kennard 1970). The fit uses the last 120 s.

use alight_shared::time::{Span, VesselTime};
use nalgebra::{DMatrix, DVector};

const STEP_S: f64 = 0.1;
/// Lags, samples.
const LAGS: [usize; 24] = [
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 16, 20, 24, 28, 32, 36, 40, 44, 48, 52, 56,
];
/// Weight of the ridge, multiplied by the number of rows.
const RIDGE: f64 = 3e-3;
/// Length of the past used for the fit, s.
const WINDOW_S: f64 = 120.0;
const REFIT_S: f64 = 10.0;
/// Settling time of the estimator, s.
const WARM_UP_S: f64 = 10.0;
const MIN_ROWS: usize = 200;
const CHANNELS: usize = 6;
const FEATURES: usize = LAGS.len() * CHANNELS;

/// Roll, pitch (rad) and heave about the mean water level (m down), and their rates.
pub type RollPitchHeave = [f64; CHANNELS];

/// Estimates published by the node, oldest first.
#[derive(Clone, Debug, Default)]
pub struct PublishedMotion {
    times: Vec<VesselTime>,
    values: Vec<RollPitchHeave>,
}

impl PublishedMotion {
    /// Adds a motion if it is later than its predecessors.
    pub fn push_motion(&mut self, at: VesselTime, motion: RollPitchHeave) {
        if self.times.last().is_some_and(|last| at <= *last) {
            return;
        }
        self.times.push(at);
        self.values.push(motion);
    }
    /// Drops estimates that no fit uses any more.
    pub fn forget(&mut self) {
        let Some(last) = self.times.last() else { return };
        let from = *last - Span::from_secs(WINDOW_S + REFIT_S);
        // Entries are dropped rarely, because all remaining ones are moved.
        let old = self.times.partition_point(|t| *t < from);
        if old > self.times.len() / 2 {
            self.times.drain(..old);
            self.values.drain(..old);
        }
    }
    pub fn until(&self, t: VesselTime) -> Past<'_> {
        let n = self.times.partition_point(|at| *at <= t);
        Past {
            times: self.times.get(..n).unwrap_or_default(),
            values: self.values.get(..n).unwrap_or_default(),
        }
    }
}

/// Estimates published until a time.
#[derive(Clone, Copy, Debug)]
pub struct Past<'a> {
    times: &'a [VesselTime],
    values: &'a [RollPitchHeave],
}

impl Past<'_> {
    /// Motion at `t`: cubic interpolation between estimates, linear extrapolation beyond the last; None before the first.
    pub fn at(&self, t: VesselTime) -> Option<RollPitchHeave> {
        let i = self.times.partition_point(|at| *at <= t).checked_sub(1)?;
        let a = self.values.get(i)?;
        let t0 = self.times.get(i)?;
        let since = (t - *t0).secs();
        let Some((b, t1)) = self.values.get(i + 1).zip(self.times.get(i + 1)) else {
            let there = |c: usize| if c < 3 { a[c] + since * a[c + 3] } else { a[c] };
            return Some(core::array::from_fn(there));
        };
        let h = (*t1 - *t0).secs();
        let s = since / h;
        let s2 = s * s;
        let s3 = s * s * s;
        Some(core::array::from_fn(|c| match c {
            0..3 => {
                a[c] + (3.0 * s2 - 2.0 * s3) * (b[c] - a[c])
                    + h * ((s3 - 2.0 * s2 + s) * a[c + 3] + (s3 - s2) * b[c + 3])
            }
            _ => a[c] + s * (b[c] - a[c]),
        }))
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Ridge {
    mean: RollPitchHeave,
    scale: RollPitchHeave,
    /// Weights of the features for roll, pitch, heave, by horizon.
    weights: Vec<DMatrix<f64>>,
}

impl Ridge {
    /// Fits for these horizons (s) to the estimates of the two minutes before `t`, but not before `valid_from`; None
    /// if there are too few.
    pub fn fit(
        all: &PublishedMotion,
        t: VesselTime,
        valid_from: VesselTime,
        horizons_s: &[f64],
    ) -> Option<Ridge> {
        let past = all.until(t);
        let last = *past.times.last()?;
        let begin = (t - Span::from_secs(WINDOW_S)).max(valid_from);
        let begin = begin.max(*past.times.first()?);
        let reach = LAGS.iter().max().copied().unwrap_or(0);
        let count = ((last - begin).secs() / STEP_S).floor();
        if count < (reach + MIN_ROWS) as f64 {
            return None;
        }
        let back = |steps: f64| last - Span::from_secs(steps * STEP_S);
        let samples: Vec<RollPitchHeave> = (0..=count as usize)
            .map(|k| past.at(back(count - k as f64)))
            .collect::<Option<_>>()?;
        let n = samples.len() as f64;
        let mean: RollPitchHeave = core::array::from_fn(|c| samples.iter().map(|s| s[c]).sum::<f64>() / n);
        let scale = core::array::from_fn(|c| {
            let square = samples.iter().map(|s| (s[c] - mean[c]).powi(2)).sum::<f64>();
            (square / n).sqrt().max(1e-6)
        });
        let mut ridge = Ridge {
            mean,
            scale,
            weights: Vec::with_capacity(horizons_s.len()),
        };
        let scaled: Vec<RollPitchHeave> = samples.iter().map(|s| ridge.scaled(s)).collect();
        // One row per sample with all lags.
        let z = DMatrix::from_fn(scaled.len() - reach, FEATURES, |r, f| {
            scaled[reach + r - LAGS[f / CHANNELS]][f % CHANNELS]
        });
        for horizon in horizons_s {
            // Number of rows whose target has already been published.
            let known = z.nrows().checked_sub((horizon / STEP_S).ceil() as usize)?;
            if known < MIN_ROWS.min(FEATURES) {
                return None;
            }
            let z = z.rows(0, known);
            let target = |r: usize| {
                let at = back(count - (reach + r) as f64) + Span::from_secs(*horizon);
                Some(ridge.scaled(&past.at(at)?))
            };
            let targets: Vec<RollPitchHeave> = (0..known).map(target).collect::<Option<_>>()?;
            let y = DMatrix::from_fn(known, 3, |r, q| targets[r][q]);
            let mut gram = z.tr_mul(&z);
            for i in 0..FEATURES {
                gram[(i, i)] += RIDGE * known as f64;
            }
            ridge.weights.push(gram.cholesky()?.solve(&z.tr_mul(&y)));
        }
        Some(ridge)
    }
    fn scaled(&self, s: &RollPitchHeave) -> RollPitchHeave {
        core::array::from_fn(|c| (s[c] - self.mean[c]) / self.scale[c])
    }
    /// Roll, pitch and heave at every horizon after `t`.
    pub fn predict(&self, past: &Past<'_>, t: VesselTime) -> Option<Vec<[f64; 3]>> {
        let mut features = DVector::zeros(FEATURES);
        for (i, lag) in LAGS.into_iter().enumerate() {
            let sample = self.scaled(&past.at(t - Span::from_secs(lag as f64 * STEP_S))?);
            for (c, value) in sample.into_iter().enumerate() {
                features[i * CHANNELS + c] = value;
            }
        }
        let prediction = |w: &DMatrix<f64>| {
            let y = w.tr_mul(&features);
            core::array::from_fn(|q| self.mean[q] + self.scale[q] * y[q])
        };
        Some(self.weights.iter().map(prediction).collect())
    }
}

/// Regression fitted every 10 s from the start of the node, once the estimator has settled.
#[derive(Clone, Debug)]
pub struct RefittedRidge {
    began: VesselTime,
    horizons_s: Vec<f64>,
    /// Number of the current 10 s interval, and the fit at its start; inner `None`: the fit failed.
    fitted: Option<(u64, Option<Ridge>)>,
}

impl RefittedRidge {
    /// Regression for these horizons (s), for a node that has published since `began`.
    pub fn new(began: VesselTime, horizons_s: &[f64]) -> Self {
        RefittedRidge {
            began,
            horizons_s: horizons_s.to_vec(),
            fitted: None,
        }
    }
    /// Roll, pitch and heave at every horizon after `t`, from estimates published until then; times must not decrease.
    pub fn predict(&mut self, published: &PublishedMotion, t: VesselTime) -> Option<Vec<[f64; 3]>> {
        let period = ((t - self.began).secs() / REFIT_S).floor();
        if self.fitted.as_ref().is_none_or(|f| f.0 != period as u64) {
            let at = self.began + Span::from_secs(period * REFIT_S);
            let valid_from = self.began + Span::from_secs(WARM_UP_S);
            self.fitted = Some((
                period as u64,
                Ridge::fit(published, at, valid_from, &self.horizons_s),
            ));
        }
        let (_, ridge) = self.fitted.as_ref()?;
        ridge.as_ref()?.predict(&published.until(t), t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    const AHEAD_S: [f64; 3] = [0.5, 1.0, 2.0];

    fn motion(t: VesselTime) -> RollPitchHeave {
        let wave = |a: f64, w: f64, p: f64| {
            let x = w * t.secs() + p;
            [a * x.sin(), a * w * x.cos()]
        };
        let wave = |a: f64, b: f64, p: f64| {
            let x = wave(a, 1.1, p);
            let y = wave(b, 1.7, 2.0 * p);
            [x[0] + y[0], x[1] + y[1]]
        };
        let roll = wave(0.1, 0.05, 0.3);
        let pitch = wave(0.03, 0.06, 1.0);
        let heave = wave(0.4, 0.2, 2.0);
        [roll[0] + 0.05, pitch[0], heave[0], roll[1], pitch[1], heave[1]]
    }

    #[test]
    fn ridge_prediction_of_lines() {
        let mut published = PublishedMotion::default();
        for k in 0..30 * 100 {
            let t = Time::from_secs(f64::from(k) / 30.0);
            published.push_motion(t, motion(t));
        }
        let valid_from = Time::from_secs(10.0);
        let t = Time::from_secs(80.0);
        let ridge = Ridge::fit(&published, t, valid_from, &AHEAD_S).unwrap();
        let mut known = PublishedMotion::default();
        for k in 0..=30 * 80 {
            let t = Time::from_secs(f64::from(k) / 30.0);
            known.push_motion(t, motion(t));
        }
        let again = Ridge::fit(&known, t, valid_from, &AHEAD_S).unwrap();
        assert_eq!(ridge, again);
        let t = Time::from_secs(85.0);
        let predicted = ridge.predict(&published.until(t), t).unwrap();
        for (predicted, ahead) in predicted.into_iter().zip(AHEAD_S) {
            let then = motion(t + Span::from_secs(ahead));
            for q in 0..3 {
                let sd = [0.08, 0.05, 0.3][q];
                assert!((predicted[q] - then[q]).abs() < 0.1 * sd, "{ahead} {q}");
            }
        }
        assert!(Ridge::fit(&published, Time::from_secs(30.0), valid_from, &AHEAD_S).is_none());
        assert!(Ridge::fit(&PublishedMotion::default(), t, valid_from, &AHEAD_S).is_none());
    }

    #[test]
    fn published_history_length() {
        let mut published = PublishedMotion::default();
        for k in 0..10 * 1000 {
            let t = Time::from_secs(0.1 * f64::from(k));
            published.push_motion(t, motion(t));
            published.forget();
            // The present fit may be as old as one interval.
            let used = t - Span::from_secs(WINDOW_S + REFIT_S);
            let is_kept = published.until(t).at(used).is_some();
            assert!(is_kept || used < Time::EPOCH, "{} s", t.secs());
        }
        assert!(published.times.len() < 10 * 300);
    }
}
