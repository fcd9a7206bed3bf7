//! The vessel's broadcast prediction 1 s ahead after something has changed: a turn, the speed, a gap of the inertial
//! sensor; and in a following sea. Beside a ridge regression on what the node has published.

use alight_shared::frames::wrap_angle;
use alight_shared::node::Node;
use alight_shared::time::Span;
use alight_usv::review::ridge::{Published, RefittedRidge};
use alight_usv::{VesselNode, VesselNodeConfig};
use serde::Serialize;

use crate::harness::physics::{Physics, TICK};
use crate::harness::scenario::{Scenario, SetupError};
use crate::physics::vessel::Course;

/// Time ahead, s.
pub const HORIZON_S: f64 = 1.0;
/// Time since the change by which errors are pooled, s; the first before it.
pub const SINCE_S: [[f64; 2]; 5] = [[-20.0, 0.0], [0.0, 2.0], [2.0, 5.0], [5.0, 10.0], [10.0, 25.0]];
/// Quantities: heave (m down), roll, pitch (rad).
pub const QUANTITIES: [&str; 3] = ["heave m", "roll rad", "pitch rad"];
/// The first change, s after the vessel's start: the regression has its 120 s.
const CHANGE_AT_S: f64 = 140.0;
/// A gap of the inertial sensor lasts so long and comes back after so long, s.
const GAP_S: f64 = 0.2;
const GAP_EVERY_S: f64 = 8.0;

/// What changes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Change {
    /// One turn by 45 to 120 deg at 3 m/s.
    Turn,
    /// The speed of 3 m/s by half, up or down.
    Speed,
    /// The inertial sensor is silent for 0.2 s every 8 s, while the vessel drifts.
    ImuGap,
    /// Nothing: waves from astern at this speed, m/s.
    FollowingSea(f64),
}

impl Change {
    /// All that the study has.
    pub const ALL: [Change; 5] = [
        Change::Turn,
        Change::Speed,
        Change::ImuGap,
        Change::FollowingSea(5.0),
        Change::FollowingSea(7.0),
    ];
    /// Its name in tables.
    pub fn name(self) -> String {
        match self {
            Change::Turn => "turn, 3 m/s".into(),
            Change::Speed => "speed by half, 3 m/s".into(),
            Change::ImuGap => "inertial gap of 0.2 s every 8 s".into(),
            Change::FollowingSea(speed) => format!("following sea, {speed} m/s"),
        }
    }
    /// The scenario with this change.
    pub fn of(self, scenario: &Scenario) -> Scenario {
        let mut scenario = scenario.clone();
        let vessel = &mut scenario.vessel;
        (vessel.course, vessel.speed_mps) = match self {
            Change::Turn => (Course::Turn, 3.0),
            Change::Speed => (Course::SpeedChange, 3.0),
            Change::ImuGap => (Course::Drift, 0.0),
            Change::FollowingSea(speed) => (Course::Straight, speed),
        };
        vessel.power_for(1.5 * vessel.speed_mps);
        vessel.change_at_s = Some(CHANGE_AT_S);
        if let Change::FollowingSea(_) = self {
            vessel.heading_deg = Some(0.0);
            scenario.sea.mean_direction_deg = Some(0.0);
        }
        scenario
    }
    /// Whether the inertial sensor is silent at `t`, s.
    fn silences(self, t: f64) -> bool {
        self == Change::ImuGap && t >= CHANGE_AT_S && (t - CHANGE_AT_S).rem_euclid(GAP_EVERY_S) < GAP_S
    }
    /// Time since the last change at `t`, s; negative before the first, and where nothing changes.
    fn since(self, t: f64) -> f64 {
        let since = t - CHANGE_AT_S;
        match self {
            Change::FollowingSea(_) => -since.rem_euclid(-SINCE_S[0][0]) - TICK.secs(),
            Change::ImuGap if since >= 0.0 => since.rem_euclid(GAP_EVERY_S),
            Change::Turn | Change::Speed | Change::ImuGap => since,
        }
    }
}

/// Squared errors of one quantity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Errors {
    /// Predictions.
    pub count: u64,
    /// Sum of the node's squares.
    pub node: f64,
    /// The same over the stated variance.
    pub normalised: f64,
    /// Sum of the reference's squares, and how many it made.
    pub reference: (f64, u64),
    /// Sum of the squares of the motion about its rest.
    pub motion: f64,
}

impl Errors {
    /// Both together.
    pub fn and(self, o: Errors) -> Errors {
        Errors {
            count: self.count + o.count,
            node: self.node + o.node,
            normalised: self.normalised + o.normalised,
            reference: (self.reference.0 + o.reference.0, self.reference.1 + o.reference.1),
            motion: self.motion + o.motion,
        }
    }
    /// RMSE of the node, RMSE of the reference, RMS of the motion, NEES; None without predictions.
    pub fn scores(&self) -> Option<[f64; 4]> {
        let root = |sum: f64, n: u64| (sum / n.max(1) as f64).sqrt();
        (self.count > 0).then(|| {
            [
                root(self.node, self.count),
                root(self.reference.0, self.reference.1),
                root(self.motion, self.count),
                self.normalised / self.count as f64,
            ]
        })
    }
}

/// Errors by time since the change and quantity.
pub type RunErrors = [[Errors; 3]; SINCE_S.len()];

/// A prediction made, still to be judged.
struct Made {
    /// When it is for, and when it was published, s.
    valid_s: f64,
    made_s: f64,
    predicted: [f64; 3],
    sd: [f64; 3],
    reference: Option<[f64; 3]>,
}

/// Runs vessel, sensors and node of `scenario` with a change from a seed.
pub fn run(
    scenario: &Scenario,
    node: &VesselNodeConfig,
    change: Change,
    seed: u64,
) -> Result<RunErrors, SetupError> {
    let scenario = change.of(scenario);
    let mut physics = Physics::new(&scenario, seed)?;
    let mut node = VesselNode::new(node, 1, 1);
    let (mut truth, mut made, mut published) = (Vec::new(), Vec::new(), Published::default());
    let began = physics.vessel_now();
    let mut ridge = RefittedRidge::new(began, &[HORIZON_S]);
    let last = CHANGE_AT_S + SINCE_S[SINCE_S.len() - 1][1];
    for k in 0..((last + HORIZON_S) / TICK.secs()).round() as usize + 2 {
        let (now, state) = (physics.vessel_now(), physics.vessel());
        let (roll, pitch, _) = state.attitude.euler();
        truth.push([state.position.0.z, roll, pitch]);
        let mut input = physics.vessel_readings().input();
        if change.silences(k as f64 * TICK.secs()) {
            input.imu.clear();
        }
        let out = node.step(now, &input);
        let level = node.estimator().level_and_sd(0.0).map_or(0.0, |l| l.0);
        if let Some(e) = out.estimate {
            published.push(&e, level);
        }
        let made_s = (now - began).secs();
        if let Some(p) = out.prediction
            && made_s > CHANGE_AT_S + SINCE_S[0][0]
            && let Some((eta, _)) = p.at(HORIZON_S)
            && let Some((_, sd, heave_sd)) = node.estimator().level_and_sd(HORIZON_S)
        {
            let known = p.header.at;
            let reference = ridge.predict(&published, known).and_then(|r| r.first().copied());
            made.push(Made {
                valid_s: (known - began + Span::from_secs(HORIZON_S)).secs(),
                made_s,
                predicted: [eta[2] - level, eta[3], eta[4]],
                sd: [heave_sd, sd[3], sd[4]],
                reference: reference.map(|[roll, pitch, heave]| [heave, roll, pitch]),
            });
        }
        physics.advance();
    }
    Ok(judge(change, &truth, &made))
}

fn judge(change: Change, truth: &[[f64; 3]], made: &[Made]) -> RunErrors {
    let mut errors = RunErrors::default();
    // At rest a hull lies trimmed.
    let n = truth.len().max(1) as f64;
    let rest: [f64; 3] = core::array::from_fn(|q| truth.iter().map(|t| t[q]).sum::<f64>() / n);
    for m in made {
        let since = change.since(m.made_s);
        let bin = SINCE_S
            .iter()
            .position(|[from, to]| (*from..*to).contains(&since));
        let tick = m.valid_s / TICK.secs();
        let (i, f) = (tick.floor().max(0.0) as usize, tick.fract());
        let (Some(bin), Some(a), Some(b)) = (bin, truth.get(i), truth.get(i + 1)) else {
            continue;
        };
        for (q, e) in errors[bin].iter_mut().enumerate() {
            let then = a[q] + f * (b[q] - a[q]);
            let off = |v: f64| if q == 0 { v - then } else { wrap_angle(v - then) };
            let error = off(m.predicted[q]);
            e.count += 1;
            e.node += error * error;
            e.normalised += (error / m.sd[q].max(1e-9)).powi(2);
            e.motion += (then - rest[q]).powi(2);
            if let Some(r) = m.reference {
                e.reference.0 += off(r[q]).powi(2);
                e.reference.1 += 1;
            }
        }
    }
    errors
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_by_time_since_the_last_change() {
        let at = |change: Change, t: f64| {
            let since = change.since(t);
            SINCE_S
                .iter()
                .position(|[from, to]| (*from..*to).contains(&since))
        };
        let turn = [130.0, 140.5, 143.0, 149.0, 160.0, 170.0].map(|t| at(Change::Turn, t));
        assert_eq!(turn, [Some(0), Some(1), Some(2), Some(3), Some(4), None]);
        assert_eq!(at(Change::ImuGap, 140.0 + 3.0 * GAP_EVERY_S + 1.0), Some(1));
        assert!((130..160).all(|t| at(Change::FollowingSea(5.0), f64::from(t)) == Some(0)));
        assert!(Change::ImuGap.silences(148.1) && !Change::ImuGap.silences(148.3));
        assert!(!Change::Turn.silences(148.1));
    }
}
