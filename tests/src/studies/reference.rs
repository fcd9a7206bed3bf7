//! The vessel's broadcast prediction beside plain predictors that know no model, all driven by the node's own
//! published estimates of one run and judged against the truth at the same instants.
//!
//! The reference is a ridge regression, fitted anew every 10 s on the last 120 s and used in the 10 s that follow
//! ([`alight_usv::review::ridge`]). Heave is height about the mean water level: published height less the filter's level,
//! against the true height above the still water.

use alight_shared::frames::wrap_angle;
use alight_shared::msg::VesselPrediction;
use alight_shared::node::Node;
use alight_shared::time::{Span, Time, VesselClock};
use alight_usv::review::ridge::{Published, RefittedRidge};
use alight_usv::{VesselNode, VesselNodeConfig};
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

/// Quantities: roll, pitch (rad), heave (m down).
pub const QUANTITIES: [&str; 3] = ["roll rad", "pitch rad", "heave m"];

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

/// Roll, pitch, heave of the truth some time after the start, between two ticks in proportion.
fn truth_at(truth: &[[f64; 3]], since: Span) -> Option<[f64; 3]> {
    let tick = since.secs() / TICK.secs();
    let (i, f) = (tick.floor() as usize, tick.fract());
    let (a, b) = (truth.get(i)?, truth.get(i + 1)?);
    Some(core::array::from_fn(|q| a[q] + f * (b[q] - a[q])))
}

/// A prediction message and the filter's level when it was published.
struct Message {
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
    let began = physics.vessel_now();
    for _ in 0..((last + longest) / TICK.secs()).round() as usize + 2 {
        let (now, state) = (physics.vessel_now(), physics.vessel());
        let (roll, pitch, _) = state.attitude.euler();
        truth.push([roll, pitch, state.position.0.z]);
        let out = node.step(now, &physics.vessel_readings().input());
        let level = node.estimator().level_and_sd(0.0).map_or(0.0, |l| l.0);
        if let Some(e) = out.estimate {
            published.push(&e, level);
        }
        if let Some(prediction) = out.prediction {
            messages.push(Message { level, prediction });
        }
        physics.advance();
    }
    Ok(judge(began, &published, &messages, &truth))
}

/// `truth` is at the ticks from `began` on.
fn judge(
    began: Time<VesselClock>,
    published: &Published,
    messages: &[Message],
    truth: &[[f64; 3]],
) -> RunErrors {
    let mut errors = RunErrors::default();
    let mut ridge = RefittedRidge::new(began, &HORIZONS_S);
    for message in messages {
        let at = message.prediction.header.at;
        let t = (at - began).secs();
        let stretch = JUDGED_FROM_S
            .iter()
            .position(|from| (*from..from + JUDGED_S).contains(&t));
        let Some(stretch) = stretch else { continue };
        let Some(now) = published.until(at).at(at) else {
            continue;
        };
        let reference = ridge.predict(published, at);
        for (h, ahead) in HORIZONS_S.into_iter().enumerate() {
            let Some(then) = truth_at(truth, at - began + Span::from_secs(ahead)) else {
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
