//! The vessel's estimator and prediction compared with the truth, in the vessel's GNSS frame: the truth plus
//! the receiver's bias at that instant.

use alight_shared::{
    frames::{euler_rates, wrap_angle},
    msg::{VesselEstimate, VesselPrediction},
    node::Node,
    time::{Span, VesselClock},
};
use alight_usv::{VesselNode, VesselNodeConfig};

use crate::harness::{
    physics::{Physics, TICK},
    scenario::{Scenario, SetupError},
};

#[derive(Clone, Copy, Debug)]
pub struct VesselTruth {
    /// Position in the vessel's NED (m), roll, pitch, yaw (rad), as in [`VesselEstimate`].
    pub eta: [f64; 6],
    pub eta_dot: [f64; 6],
    /// Height relative to still water, without the receiver's bias, positive down, m.
    pub heave: f64,
}

/// Standard deviations at each stage of a prediction: heave about the mean level, m; roll and pitch, rad.
pub type StageDeviations = Vec<[f64; 3]>;

#[derive(Clone, Debug)]
pub struct EstimatorRun {
    pub truth: Vec<VesselTruth>,
    /// Estimates with their ticks.
    pub estimates: Vec<(usize, VesselEstimate<VesselClock>)>,
    /// Predictions with the (fractional) tick of their first stage.
    pub predictions: Vec<(f64, VesselPrediction<VesselClock>)>,
    /// For each prediction: the filter's mean water level (positive down, m), and the deviations of the stages.
    pub levels: Vec<(f64, StageDeviations)>,
    pub confidence: f32,
}

/// Runs vessel, sensors and node for the warm-up and a further `span_s`, without a place: the node takes quantities in
/// the scene's NED, the frame of the truth.
pub fn run(
    scenario: &Scenario,
    node: &VesselNodeConfig,
    seed: u64,
    span_s: f64,
) -> Result<EstimatorRun, SetupError> {
    let mut scenario = scenario.clone();
    scenario.place.among.clear();
    let mut physics = Physics::new(&scenario, seed)?;
    let mut node = VesselNode::new(node, 1, 1);
    let mut out = EstimatorRun {
        truth: Vec::new(),
        estimates: Vec::new(),
        predictions: Vec::new(),
        levels: Vec::new(),
        confidence: 0.0,
    };
    let ticks = |s: f64| (s / TICK.secs()).round() as usize;
    let first = ticks(scenario.start.warm_up_s);
    let last = ticks(scenario.start.warm_up_s + span_s);
    // The truth continues to the end of the last predictions.
    for k in 0..last + 300 {
        let now = physics.vessel_now();
        let state = physics.vessel();
        let readings = physics.vessel_readings();
        let p = state.position.0 + physics.vessel_gnss_bias();
        let (roll, pitch, yaw) = state.attitude.euler();
        let rates = euler_rates(roll, pitch, state.rates.0);
        let v = state.velocity.0;
        out.truth.push(VesselTruth {
            eta: [p.x, p.y, p.z, roll, pitch, yaw],
            eta_dot: [v.x, v.y, v.z, rates.x, rates.y, rates.z],
            heave: state.position.0.z,
        });
        let predicted = node.step(now, &readings.into());
        if (first..last).contains(&k) {
            out.estimates.extend(predicted.estimate.map(|e| (k, e)));
            if let Some(p) = predicted.prediction {
                let age: Span = now - p.header.at;
                out.predictions.push((k as f64 - age.secs() / TICK.secs(), p));
                let estimator = node.estimator();
                let at = |k| estimator.deck_sd(k as f64 * f64::from(p.step_s));
                let sds = (0..p.stages.len()).filter_map(at).collect();
                out.levels.push((estimator.level().unwrap_or_default(), sds));
            }
            out.confidence = predicted.wave.map_or(out.confidence, |w| w.confidence);
        }
        physics.advance();
    }
    Ok(out)
}

/// `a - b`; differences of angles are wrapped.
pub fn difference(dof: usize, a: f64, b: f64) -> f64 {
    if dof < 3 { a - b } else { wrap_angle(a - b) }
}

fn rms(squares: &[f64]) -> f64 {
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

#[derive(Clone, Copy, Debug, Default)]
pub struct StateErrors {
    /// RMSE per axis of position (m), attitude (rad), velocity (m/s), rates (rad/s).
    pub per_axis: [f64; 4],
    /// Mean NEES of (eta, eta_dot) for each degree of freedom; 2 for a consistent covariance.
    pub nees: [f64; 6],
}

pub fn state_errors(runs: &[EstimatorRun]) -> StateErrors {
    let mut squares = [const { Vec::new() }; 4];
    let mut nees = [const { Vec::new() }; 6];
    for r in runs {
        for (k, e) in &r.estimates {
            let truth = r.truth[*k];
            for d in 0..6 {
                let a = difference(d, e.eta[d], truth.eta[d]);
                let b = f64::from(e.eta_dot[d]) - truth.eta_dot[d];
                squares[d / 3].push(a * a);
                squares[2 + d / 3].push(b * b);
                let [p, c, q] = e.covariance(d);
                nees[d].push((q * a * a - 2.0 * c * a * b + p * b * b) / (p * q - c * c));
            }
        }
    }
    let per_axis = squares.each_ref().map(|s| rms(s));
    StateErrors {
        per_axis,
        nees: nees.map(|n| n.iter().sum::<f64>() / n.len().max(1) as f64),
    }
}

/// RMSE of a degree of freedom at one horizon.
#[derive(Clone, Copy, Debug, Default)]
pub struct PredictionError {
    /// Error of the broadcast prediction.
    pub model: f64,
    /// Error if the last state is held constant.
    pub hold: f64,
    /// Error if the last velocity is held constant.
    pub velocity: f64,
}

/// Prediction of `dof`, `horizon_s` after its origin.
pub fn predicted(p: &VesselPrediction<VesselClock>, dof: usize, horizon_s: f64) -> Option<f64> {
    let (eta, _sd) = p.at(horizon_s)?;
    Some(eta.get(dof)? - p.origin.get(dof).copied().unwrap_or(0.0))
}

pub fn prediction_error(runs: &[EstimatorRun], dof: usize, horizon_s: f64) -> PredictionError {
    let mut squares = [const { Vec::new() }; 3];
    for r in runs {
        let truth = |tick: f64| {
            let i = tick.max(0.0).floor() as usize;
            let f = tick.fract();
            let a = r.truth.get(i)?.eta[dof];
            let b = r.truth.get(i + 1)?.eta[dof];
            Some(a + f * difference(dof, b, a))
        };
        for (start, p) in &r.predictions {
            let (Some(first), Some(predicted)) = (p.stages.first(), predicted(p, dof, horizon_s)) else {
                continue;
            };
            let Some(then) = truth(start + horizon_s / TICK.secs()) else {
                continue;
            };
            let origin = if dof < 3 { p.origin[dof] } else { 0.0 };
            let now = origin + f64::from(first.eta[dof]);
            let rolled = now + horizon_s * f64::from(first.eta_dot[dof]);
            let errors = [origin + predicted, now, rolled].map(|p| difference(dof, p, then));
            for (s, e) in squares.iter_mut().zip(errors) {
                s.push(e * e);
            }
        }
    }
    let [model, hold, velocity] = squares.map(|s| rms(&s));
    PredictionError {
        model,
        hold,
        velocity,
    }
}
