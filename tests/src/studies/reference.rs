//! The vessel's broadcast prediction beside plain predictors that know no model, all driven by the node's own
//! published estimates of one run and judged against the truth at the same instants.
//!
//! The reference is a ridge regression: roll, pitch, heave and their rates at 24 lags over the last 5.6 s (10 Hz)
//! predict roll, pitch and heave one horizon ahead; fitted anew every 10 s on the last 120 s and used in the
//! 10 s that follow. Heave is height about the mean water level: published height less the filter's level,
//! against the true height above the still water.

use alight_shared::frames::wrap_angle;
use alight_shared::msg::{VesselEstimate, VesselPrediction};
use alight_shared::node::Node;
use alight_shared::time::{Span, VesselClock};
use alight_usv::{VesselNode, VesselNodeConfig};
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::harness::physics::{Physics, TICK};
use crate::harness::scenario::{Scenario, SetupError};

/// Times ahead, s.
pub const HORIZONS_S: [f64; 11] = [0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0];
const HORIZONS: usize = HORIZONS_S.len();
/// Predictions are judged from these times on, s after the vessel's start, for [`JUDGED_S`] each.
pub const JUDGED_FROM_S: [f64; 2] = [60.0, 180.0];
/// Length of a judged stretch, s.
pub const JUDGED_S: f64 = 120.0;

/// Samples of the regression.
const STEP_S: f64 = 0.1;
/// Lags of the regression, samples.
const LAGS: [usize; 24] = [
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 16, 20, 24, 28, 32, 36, 40, 44, 48, 52, 56,
];
/// Weight of the ridge, times the number of rows.
const RIDGE: f64 = 3e-3;
/// It is fitted to so much of the past, s, and as often, s.
const WINDOW_S: f64 = 120.0;
const REFIT_S: f64 = 10.0;
/// Fewest rows of a fit.
const MIN_ROWS: usize = 200;
/// Before that the estimator has not settled, s.
const SETTLED_S: f64 = 10.0;

/// Quantities: roll, pitch (rad), heave (m down).
pub const QUANTITIES: [&str; 3] = ["roll rad", "pitch rad", "heave m"];
const CHANNELS: usize = 6;
const FEATURES: usize = LAGS.len() * CHANNELS;

/// Who predicts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Predictor {
    /// The node's broadcast prediction.
    Node,
    /// The ridge regression.
    Reference,
    /// The last value stays.
    Hold,
    /// The last rate stays.
    ConstantVelocity,
}

impl Predictor {
    /// All of them.
    pub const ALL: [Predictor; 4] = [
        Predictor::Node,
        Predictor::Reference,
        Predictor::Hold,
        Predictor::ConstantVelocity,
    ];
    /// Name.
    pub const fn name(self) -> &'static str {
        match self {
            Predictor::Node => "node",
            Predictor::Reference => "reference",
            Predictor::Hold => "hold",
            Predictor::ConstantVelocity => "constant velocity",
        }
    }
}

/// Errors of one run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Errors {
    /// Predictions.
    pub count: u64,
    /// Sum of the errors.
    pub sum: f64,
    /// Sum of their squares.
    pub squares: f64,
}

impl Errors {
    fn add(&mut self, e: f64) {
        self.count += 1;
        self.sum += e;
        self.squares += e * e;
    }
    /// Mean error.
    pub fn mean(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }
    /// Mean square about the mean error.
    pub fn variance(&self) -> f64 {
        (self.squares / self.count.max(1) as f64 - self.mean().powi(2)).max(0.0)
    }
}

/// Errors of one run by predictor, judged stretch, quantity and horizon.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunErrors([[[[Errors; HORIZONS]; 3]; 2]; 4]);

impl RunErrors {
    /// Of one predictor in the stretch that begins at the `stretch`th of [`JUDGED_FROM_S`].
    pub fn of(&self, predictor: Predictor, stretch: usize, quantity: usize, horizon: usize) -> Errors {
        self.0[predictor as usize][stretch][quantity][horizon]
    }
}

/// RMSE over runs with each run's mean error removed, and the RMS of those mean errors; None without any.
pub fn rmse(
    runs: &[RunErrors],
    predictor: Predictor,
    stretch: usize,
    quantity: usize,
    horizon: usize,
) -> Option<[f64; 2]> {
    let errors = runs.iter().map(|r| r.of(predictor, stretch, quantity, horizon));
    let (mut n, mut variance, mut mean) = (0_u64, 0.0, 0.0);
    for e in errors.filter(|e| e.count > 0) {
        n += e.count;
        variance += e.count as f64 * e.variance();
        mean += e.count as f64 * e.mean().powi(2);
    }
    (n > 0).then(|| [variance, mean].map(|v| (v / n as f64).sqrt()))
}

/// Roll, pitch, heave and their rates as the node has published them, at ticks.
#[derive(Default)]
struct Published {
    ticks: Vec<f64>,
    values: Vec<[f64; CHANNELS]>,
}

impl Published {
    fn push(&mut self, tick: f64, e: &VesselEstimate<VesselClock>, level: f64) {
        self.ticks.push(tick);
        self.values.push([
            e.eta[3],
            e.eta[4],
            e.eta[2] - level,
            f64::from(e.eta_dot[3]),
            f64::from(e.eta_dot[4]),
            f64::from(e.eta_dot[2]),
        ]);
    }
    /// At `tick`: cubic between two estimates, from the last one on by its rates.
    fn at(&self, tick: f64) -> Option<[f64; CHANNELS]> {
        let i = self.ticks.partition_point(|t| *t <= tick).checked_sub(1)?;
        let (a, t0) = (self.values.get(i)?, self.ticks.get(i)?);
        let since = (tick - t0) * TICK.secs();
        let Some((b, t1)) = self.values.get(i + 1).zip(self.ticks.get(i + 1)) else {
            let there = |c: usize| if c < 3 { a[c] + since * a[c + 3] } else { a[c] };
            return Some(core::array::from_fn(there));
        };
        let h = (t1 - t0) * TICK.secs();
        let s = since / h;
        let (s2, s3) = (s * s, s * s * s);
        Some(core::array::from_fn(|c| match c {
            0..3 => {
                a[c] + (3.0 * s2 - 2.0 * s3) * (b[c] - a[c])
                    + h * ((s3 - 2.0 * s2 + s) * a[c + 3] + (s3 - s2) * b[c + 3])
            }
            _ => a[c] + s * (b[c] - a[c]),
        }))
    }
    /// What was published until `tick`.
    fn until(&self, tick: f64) -> Published {
        let n = self.ticks.partition_point(|t| *t <= tick);
        Published {
            ticks: self.ticks[..n].to_vec(),
            values: self.values[..n].to_vec(),
        }
    }
}

/// The ridge regression, fitted.
struct Ridge {
    mean: [f64; CHANNELS],
    scale: [f64; CHANNELS],
    /// By horizon: weights of the features for roll, pitch, heave.
    weights: Vec<DMatrix<f64>>,
}

fn ticks(s: f64) -> f64 {
    s / TICK.secs()
}

impl Ridge {
    /// Fitted to what was published in the [`WINDOW_S`] before `tick`; None where that is too little.
    fn fit(all: &Published, tick: f64) -> Option<Ridge> {
        let past = all.until(tick);
        let last = *past.ticks.last()?;
        let begin = (tick - ticks(WINDOW_S)).max(ticks(SETTLED_S));
        let reach = LAGS.iter().max().copied().unwrap_or(0);
        let count = ((last - begin) / ticks(STEP_S)).floor();
        if count < (reach + MIN_ROWS) as f64 {
            return None;
        }
        let samples: Vec<[f64; CHANNELS]> = (0..=count as usize)
            .map(|k| past.at(last - (count - k as f64) * ticks(STEP_S)))
            .collect::<Option<_>>()?;
        let n = samples.len() as f64;
        let mean: [f64; CHANNELS] = core::array::from_fn(|c| samples.iter().map(|s| s[c]).sum::<f64>() / n);
        let scale = core::array::from_fn(|c| {
            let square = samples.iter().map(|s| (s[c] - mean[c]).powi(2)).sum::<f64>();
            (square / n).sqrt().max(1e-6)
        });
        let mut ridge = Ridge {
            mean,
            scale,
            weights: Vec::with_capacity(HORIZONS),
        };
        let scaled: Vec<[f64; CHANNELS]> = samples.iter().map(|s| ridge.scaled(s)).collect();
        // One row per sample that has all its lags.
        let rows: Vec<usize> = (reach..scaled.len()).collect();
        let z = DMatrix::from_fn(rows.len(), FEATURES, |r, f| {
            scaled[rows[r] - LAGS[f / CHANNELS]][f % CHANNELS]
        });
        for horizon in HORIZONS_S {
            // Rows whose target was published by now.
            let known = rows.len().checked_sub((horizon / STEP_S).ceil() as usize)?;
            if known < MIN_ROWS.min(FEATURES) {
                return None;
            }
            let z = z.rows(0, known).into_owned();
            let target = |r: usize| {
                let at = last - (count - rows[r] as f64) * ticks(STEP_S) + ticks(horizon);
                Some(ridge.scaled(&past.at(at)?))
            };
            let targets: Vec<[f64; CHANNELS]> = (0..known).map(target).collect::<Option<_>>()?;
            let y = DMatrix::from_fn(known, 3, |r, q| targets[r][q]);
            let zt = z.transpose();
            let mut gram = &zt * &z;
            for i in 0..FEATURES {
                gram[(i, i)] += RIDGE * known as f64;
            }
            ridge.weights.push(gram.cholesky()?.solve(&(&zt * &y)));
        }
        Some(ridge)
    }
    fn scaled(&self, s: &[f64; CHANNELS]) -> [f64; CHANNELS] {
        core::array::from_fn(|c| (s[c] - self.mean[c]) / self.scale[c])
    }
    /// Roll, pitch and heave at every horizon after `tick`.
    fn predict(&self, past: &Published, tick: f64) -> Option<Vec<[f64; 3]>> {
        let mut features = DVector::zeros(FEATURES);
        for (i, lag) in LAGS.into_iter().enumerate() {
            let sample = self.scaled(&past.at(tick - lag as f64 * ticks(STEP_S))?);
            for (c, value) in sample.into_iter().enumerate() {
                features[i * CHANNELS + c] = value;
            }
        }
        let of = |w: &DMatrix<f64>| {
            let y = w.tr_mul(&features);
            core::array::from_fn(|q| self.mean[q] + self.scale[q] * y[q])
        };
        Some(self.weights.iter().map(of).collect())
    }
}

/// Roll, pitch, heave of the truth at a fractional tick.
fn truth_at(truth: &[[f64; 3]], tick: f64) -> Option<[f64; 3]> {
    let (i, f) = (tick.floor() as usize, tick.fract());
    let (a, b) = (truth.get(i)?, truth.get(i + 1)?);
    Some(core::array::from_fn(|q| a[q] + f * (b[q] - a[q])))
}

/// A prediction message: tick of its first stage, and the filter's level when it was published.
struct Message {
    tick: f64,
    level: f64,
    prediction: VesselPrediction<VesselClock>,
}

impl Message {
    /// Roll, pitch, heave `ahead` (s) of the first stage.
    fn at(&self, ahead: f64) -> Option<[f64; 3]> {
        let stages = self.prediction.stages.len().checked_sub(1)?;
        if ahead > stages as f64 * f64::from(self.prediction.step_s) + 1e-6 {
            return None;
        }
        let (eta, _) = self.prediction.at(ahead)?;
        Some([eta[3], eta[4], eta[2] - self.level])
    }
}

/// Runs vessel, sensors and node of `scenario` from a seed and judges all predictors.
pub fn run(scenario: &Scenario, node: &VesselNodeConfig, seed: u64) -> Result<RunErrors, SetupError> {
    let mut physics = Physics::new(scenario, seed)?;
    let mut node = VesselNode::new(node, 1, 1);
    let (mut published, mut messages, mut truth) = (Published::default(), Vec::new(), Vec::new());
    let last = JUDGED_FROM_S[1] + JUDGED_S;
    let longest = HORIZONS_S[HORIZONS - 1];
    for k in 0..ticks(last + longest).round() as usize + 2 {
        let (now, state) = (physics.vessel_now(), physics.vessel());
        let (roll, pitch, _) = state.attitude.euler();
        truth.push([roll, pitch, state.position.0.z]);
        let out = node.step(now, &physics.vessel_readings().input());
        let level = node.estimator().level_and_sd(0.0).map_or(0.0, |l| l.0);
        let tick_of = |age: Span| k as f64 - age.secs() / TICK.secs();
        if let Some(e) = out.estimate {
            published.push(tick_of(now - e.header.at), &e, level);
        }
        if let Some(prediction) = out.prediction {
            messages.push(Message {
                tick: tick_of(now - prediction.header.at),
                level,
                prediction,
            });
        }
        physics.advance();
    }
    Ok(judge(&published, &messages, &truth))
}

fn judge(published: &Published, messages: &[Message], truth: &[[f64; 3]]) -> RunErrors {
    let mut errors = RunErrors::default();
    let mut fitted: Option<(u64, Option<Ridge>)> = None;
    for message in messages {
        let t = message.tick * TICK.secs();
        let stretch = JUDGED_FROM_S
            .iter()
            .position(|from| (*from..from + JUDGED_S).contains(&t));
        let Some(stretch) = stretch else { continue };
        let fit = (t / REFIT_S).floor() as u64;
        if fitted.as_ref().is_none_or(|f| f.0 != fit) {
            let ridge = Ridge::fit(published, ticks(fit as f64 * REFIT_S));
            fitted = Some((fit, ridge));
        }
        let past = published.until(message.tick);
        let Some(now) = past.at(message.tick) else {
            continue;
        };
        let reference = fitted
            .as_ref()
            .and_then(|f| f.1.as_ref())
            .and_then(|r| r.predict(&past, message.tick));
        for (h, ahead) in HORIZONS_S.into_iter().enumerate() {
            let Some(then) = truth_at(truth, message.tick + ticks(ahead)) else {
                continue;
            };
            let hold = [now[0], now[1], now[2]];
            let rolled = core::array::from_fn(|q| now[q] + ahead * now[q + 3]);
            let predictions = [
                message.at(ahead),
                reference.as_ref().and_then(|r| r.get(h).copied()),
                Some(hold),
                Some(rolled),
            ];
            for (who, prediction) in errors.0.iter_mut().zip(predictions) {
                for (q, p) in prediction.iter().flatten().enumerate() {
                    let e = p - then[q];
                    who[stretch][q][h].add(if q < 2 { wrap_angle(e) } else { e });
                }
            }
        }
    }
    errors
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Estimates of a motion of two lines without any error, at 30 Hz.
    fn lines() -> (Published, Vec<[f64; 3]>) {
        let value = |t: f64| {
            let wave = |a: f64, w: f64, p: f64| [a * (w * t + p).sin(), a * w * (w * t + p).cos()];
            let of = |a: f64, b: f64, p: f64| {
                let (x, y) = (wave(a, 1.1, p), wave(b, 1.7, 2.0 * p));
                [x[0] + y[0], x[1] + y[1]]
            };
            let (roll, pitch, heave) = (of(0.1, 0.05, 0.3), of(0.03, 0.06, 1.0), of(0.4, 0.2, 2.0));
            [roll[0] + 0.05, pitch[0], heave[0], roll[1], pitch[1], heave[1]]
        };
        let mut published = Published::default();
        for k in 0..30 * 100 {
            let t = f64::from(k) / 30.0;
            published.ticks.push(ticks(t));
            published.values.push(value(t));
        }
        let truth = (0..11_000)
            .map(|k| {
                let v = value(0.01 * f64::from(k));
                [v[0], v[1], v[2]]
            })
            .collect();
        (published, truth)
    }

    #[test]
    fn reference_predicts_lines_and_is_causal() {
        let (published, truth) = lines();
        let tick = ticks(80.0);
        let ridge = Ridge::fit(&published, tick).unwrap();
        let again = Ridge::fit(&published.until(tick), tick).unwrap();
        assert_eq!(ridge.weights, again.weights);
        let at = ticks(85.0);
        let predicted = ridge.predict(&published.until(at), at).unwrap();
        for (h, ahead) in HORIZONS_S.into_iter().enumerate().take(6) {
            let then = truth_at(&truth, at + ticks(ahead)).unwrap();
            for q in 0..3 {
                let sd = [0.08, 0.05, 0.3][q];
                assert!((predicted[h][q] - then[q]).abs() < 0.1 * sd, "{ahead} {q}");
            }
        }
        assert!(Ridge::fit(&published, ticks(30.0)).is_none());
    }

    #[test]
    fn mean_error_of_a_run_is_reported_apart() {
        let mut a = RunErrors::default();
        let mut b = RunErrors::default();
        for e in [0.9, 1.1] {
            a.0[0][1][2][3].add(e);
            b.0[0][1][2][3].add(e - 2.0);
        }
        let [rmse, mean] = rmse(&[a, b], Predictor::Node, 1, 2, 3).unwrap();
        assert!((rmse - 0.1).abs() < 1e-12 && (mean - 1.0).abs() < 1e-12);
        assert!(super::rmse(&[RunErrors::default()], Predictor::Hold, 0, 0, 0).is_none());
    }
}
