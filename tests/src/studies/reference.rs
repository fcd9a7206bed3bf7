//! The vessel's broadcast prediction beside plain predictors that know no model, all driven by the node's own
//! published estimates of one run and judged against the truth at the same instants.
//!
//! The reference is a ridge regression, fitted anew every 10 s on the last 120 s and used in the 10 s that follow
//! ([`alight_usv::review::ridge`]). Heave is height about the mean water level: published height less the filter's level,
//! against the true height above the still water.
//!
//! The drone's forecast is judged in the same way while it follows over a radio that loses 10 % and delays by 100 ms,
//! against the regression from the newest estimate that such a radio has let through.

use alight_shared::frames::wrap_angle;
use alight_shared::msg::{CommandKind, Phase, State, VesselEstimate, VesselPrediction};
use alight_shared::node::Node;
use alight_shared::time::{Span, Time, TrueTime, VesselClock};
use alight_usv::review::ridge::{Published, RefittedRidge};
use alight_usv::{ComputerIn, ComputerOut, VesselNode, VesselNodeConfig};
use serde::Serialize;

use super::prediction::{Frame, follow_only, frame_error, ticks};
use crate::harness::physics::{Physics, TICK};
use crate::harness::scenario::{NodeConfigs, Scenario, SetupError};
use crate::harness::tap::Tap;
use crate::harness::world::World;

/// Times ahead, s.
pub const HORIZONS_S: [f64; 11] = [0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0];
const HORIZONS: usize = HORIZONS_S.len();
/// Predictions are judged from these times on, s after the vessel's start, for [`JUDGED_S`] each.
pub const JUDGED_FROM_S: [f64; 2] = [60.0, 180.0];
/// Length of a judged stretch, s.
pub const JUDGED_S: f64 = 120.0;

/// The drone's radio: mean delay, s, and share of the packets lost.
pub const DRONE_RADIO: (f64, f64) = (0.1, 0.1);
/// Mean age of the newest estimate that such a radio has let through, s: its delay, half a period of 30 Hz, what is
/// lost, and the drone's own period.
const DRONE_AGE_S: f64 = 0.13;
/// The drone's forecast is judged this often.
const DRONE_SAMPLE_S: f64 = 0.1;

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
fn truth_at(truth: &[Truth], since: Span) -> Option<Truth> {
    let tick = since.secs() / TICK.secs();
    let (i, f) = (tick.floor() as usize, tick.fract());
    let (a, b) = (truth.get(i)?, truth.get(i + 1)?);
    let mix = |a: [f64; 3], b: [f64; 3]| core::array::from_fn(|q| a[q] + f * (b[q] - a[q]));
    Some(Truth {
        of_node: mix(a.of_node, b.of_node),
        of_vessel: mix(a.of_vessel, b.of_vessel),
    })
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
    let (mut published, mut judged, mut truth) = (Published::default(), Vec::new(), Vec::new());
    let last = JUDGED_FROM_S[1] + JUDGED_S;
    let longest = HORIZONS_S[HORIZONS - 1];
    let began = physics.vessel_now();
    for _ in 0..((last + longest) / TICK.secs()).round() as usize + 2 {
        let (now, state) = (physics.vessel_now(), physics.vessel());
        let (roll, pitch, _) = state.attitude.euler();
        let motion = [roll, pitch, state.position.0.z];
        truth.push(Truth {
            of_node: motion,
            of_vessel: motion,
        });
        let out = node.step(now, &physics.vessel_readings().input());
        let level = node.estimator().level_and_sd(0.0).map_or(0.0, |l| l.0);
        if let Some(e) = out.estimate {
            published.push(&e, level);
        }
        if let Some(prediction) = out.prediction {
            let message = Message { level, prediction };
            judged.push(Judged {
                at: message.prediction.header.at,
                predicted: HORIZONS_S.map(|h| message.at(h)),
            });
        }
        physics.advance();
    }
    Ok(judge(began, &published, &judged, &truth, (0.0, HORIZONS_S)))
}

/// What somebody predicts from a time on.
struct Judged {
    /// Horizons count from here.
    at: Time<VesselClock>,
    /// By horizon, where it reaches so far.
    predicted: [Option<[f64; 3]>; HORIZONS],
}

/// A tick's roll, pitch, height of what the node predicts, and of the vessel.
#[derive(Clone, Copy)]
struct Truth {
    of_node: [f64; 3],
    of_vessel: [f64; 3],
}

/// `truth` is at the ticks from `began` on; the others than the node know what was published until `age_s` before.
fn judge(
    began: Time<VesselClock>,
    published: &Published,
    judged: &[Judged],
    truth: &[Truth],
    (age_s, horizons): (f64, [f64; HORIZONS]),
) -> RunErrors {
    let mut errors = RunErrors::default();
    let mut ridge = RefittedRidge::new(began, &horizons);
    for message in judged {
        let at = message.at;
        let t = (at - began).secs();
        let stretch = JUDGED_FROM_S
            .iter()
            .position(|from| (*from..from + JUDGED_S).contains(&t));
        let Some(stretch) = stretch else { continue };
        let known = at - Span::from_secs(age_s);
        let Some(now) = published.until(known).at(known) else {
            continue;
        };
        let reference = ridge.predict(published, known);
        for (h, ahead) in horizons.into_iter().enumerate() {
            let Some(then) = truth_at(truth, known - began + Span::from_secs(ahead)) else {
                continue;
            };
            let hold = [now[0], now[1], now[2]];
            let rolled = core::array::from_fn(|q| now[q] + ahead * now[q + 3]);
            let predictions = [
                (message.predicted[h], then.of_node),
                (reference.as_ref().and_then(|r| r.get(h).copied()), then.of_vessel),
                (Some(hold), then.of_vessel),
                (Some(rolled), then.of_vessel),
            ];
            for (who, (prediction, then)) in errors.0.iter_mut().zip(predictions) {
                for (q, p) in prediction.iter().flatten().enumerate() {
                    let e = p - then[q];
                    who[stretch][q][h].add(if q < 2 { wrap_angle(e) } else { e });
                }
            }
        }
    }
    errors
}

/// What is seen of the world in a tick.
#[derive(Default)]
struct DroneTap {
    estimate: Option<VesselEstimate<VesselClock>>,
    frame: Frame,
}

impl Tap for DroneTap {
    fn vessel(&mut self, _t: Time<TrueTime>, _now: Time<VesselClock>, _i: &ComputerIn, out: &ComputerOut) {
        self.estimate = out.vessel.estimate;
    }
    fn predictor(
        &mut self,
        t: Time<TrueTime>,
        now: Time<alight_shared::time::DroneClock>,
        input: &alight_uav::predictor::PredictorIn,
        output: &alight_uav::predictor::PredictorOut,
    ) {
        self.frame.predictor(t, now, input, output);
    }
}

/// Flies a drone that follows the vessel of `scenario` from a seed over [`DRONE_RADIO`] and judges its forecast as the
/// node's prediction, roll, pitch and height of the deck. Its height is in its own NED, whose error at the time (that of
/// the drone's own position) is taken out.
pub fn run_drone(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> Result<RunErrors, SetupError> {
    let (mut scenario, mut nodes) = (scenario.clone(), nodes.clone());
    (scenario.radio.delay_s, scenario.radio.loss) = DRONE_RADIO;
    scenario.start.warm_up_s = JUDGED_FROM_S[0];
    follow_only(&mut nodes);
    let mut world = World::new(&scenario, &nodes, seed)?;
    let (mut published, mut judged, mut truth) = (Published::default(), Vec::new(), Vec::new());
    let (mut own, mut forecasts) = (Vec::new(), Vec::new());
    let began = world.physics().vessel_now();
    let last = ticks(JUDGED_FROM_S[1] + JUDGED_S);
    for tick in 0..last + ticks(HORIZONS_S[HORIZONS - 1]) + 2 {
        let (vessel, deck) = (world.physics().vessel(), world.physics().deck());
        let now = world.physics().vessel_now();
        let motion = |(roll, pitch, _): (f64, f64, f64), z: f64| [roll, pitch, z];
        truth.push(Truth {
            of_node: motion(deck.attitude.euler(), deck.position.0.z),
            of_vessel: motion(vessel.attitude.euler(), vessel.position.0.z),
        });
        own.push(world.physics().drone(0).map(|d| d.position.0));
        let mut tap = DroneTap::default();
        if !world.warm_up_tick(&mut tap) {
            if world.mission_state().state == State::Idle {
                world.command(CommandKind::Land);
            }
            world.tick(&mut tap);
        }
        if let Some(e) = tap.estimate {
            let level = world.vessel_node().estimator().level_and_sd(0.0);
            published.push(&e, level.map_or(0.0, |l| l.0));
        }
        let follows = world.mission_state().state.phase() == Phase::Follow;
        if follows
            && tick % ticks(DRONE_SAMPLE_S) == 0
            && let Some(f) = tap.frame.0
        {
            forecasts.push((tick, now, f));
        }
    }
    for (tick, now, (forecast, position, age_s)) in forecasts {
        let Some(frame) = frame_error(&own, tick, &position, age_s) else {
            continue;
        };
        judged.push(Judged {
            at: now,
            predicted: HORIZONS_S.map(|h| {
                let stage = forecast.at(forecast.header.at + Span::from_secs(h))?;
                let [roll, pitch, _] = stage.euler;
                Some([roll, pitch, stage.position[2] - frame.z])
            }),
        });
    }
    let horizons = HORIZONS_S.map(|h| h + DRONE_AGE_S);
    Ok(judge(began, &published, &judged, &truth, (DRONE_AGE_S, horizons)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_error_of_a_run() {
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
