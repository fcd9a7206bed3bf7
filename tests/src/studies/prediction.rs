//! Predictions of the deck against the truth, by horizon: the vessel's broadcast and the drone's own forecast, which
//! is what a landing is planned on.
//!
//! "Heave" has three meanings, and each is measured apart. *Heave* (Fossen 2011): height against the
//! mean water level. *Height in the vessel's NED*: heave and the receiver's slow bias, which wanders
//! by 0.08 m in a second under 0.3 m of white noise at 10 Hz, so that no filter knows it better than
//! 0.09 m. *Height in the drone's NED*: what the drone has to meet; its sight measures that bias.

use std::collections::BTreeMap;

use alight_shared::frames::wrap_angle;
use alight_shared::msg::{CommandKind, State, VesselPrediction};
use alight_shared::time::{Span, VesselClock};
use alight_usv::VesselNodeConfig;
use nalgebra::Vector3;
use serde::Serialize;

use super::estimator::{Run, difference, predicted, run};
use crate::harness::physics::TICK;
use crate::harness::scenario::{NodeConfigs, Scenario, SetupError};
use crate::harness::tap::NoTap;
use crate::harness::world::World;

/// Times ahead, s.
pub const HORIZONS_S: [f64; 8] = [0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0];
/// 95 % of the chi-square distribution with one, two and three degrees of freedom.
const CHI2_95: [f64; 3] = [3.841, 5.991, 7.815];
/// A tag sighting no older than this counts as sight of the tag, s.
const MAX_TAG_AGE_S: f64 = 0.2;
/// Least ticks between two samples of the drone's forecast.
const SAMPLE_TICKS: usize = 10;
/// A landing is planned on the forecasts of so many seconds before the first contact.
const FINAL_S: f64 = 3.0;
/// Longest wait for the drone to follow, or to land, s.
const MAX_WAIT_S: f64 = 90.0;

/// Who predicts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// The vessel's broadcast prediction.
    Vessel,
    /// The drone's forecast while it follows at the tracking height with the tag in sight.
    DroneFollowing,
    /// The drone's forecast in the last three seconds of a landing, tag in sight or no more.
    DroneDescending,
}

/// What is predicted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// Vessel: height of the reference point against the mean water level, m.
    Heave,
    /// Height in the own NED (truth and own frame's slow error), m.
    Height,
    /// Horizontal position in the own NED, m.
    Place,
    /// Roll and pitch, rad.
    Tilt,
    /// Roll alone, rad.
    Roll,
    /// Pitch alone, rad.
    Pitch,
    /// Vertical speed, m/s (the vessel's broadcast states no spread of it).
    VerticalSpeed,
    /// Heave, roll and pitch together: the ellipsoid of the deck in waves. Its RMSE means nothing.
    Deck,
}

impl Quantity {
    /// Name and unit.
    pub const fn name(self) -> &'static str {
        match self {
            Quantity::Heave => "heave m",
            Quantity::Height => "height m",
            Quantity::Place => "place m",
            Quantity::Tilt => "tilt rad",
            Quantity::Roll => "roll rad",
            Quantity::Pitch => "pitch rad",
            Quantity::VerticalSpeed => "vertical speed m/s",
            Quantity::Deck => "heave, roll, pitch",
        }
    }
}

impl Source {
    /// Name.
    pub const fn name(self) -> &'static str {
        match self {
            Source::Vessel => "vessel",
            Source::DroneFollowing => "drone, following",
            Source::DroneDescending => "drone, last 3 s",
        }
    }
}

/// Errors of one figure at one horizon.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Tally {
    /// Predictions.
    pub count: u64,
    /// Sum of the squared errors (of the norm, where there are several components).
    pub squares: f64,
    /// Sum of the normalised squared errors per component: `count` when the covariance is right.
    pub normalised: f64,
    /// Predictions whose 95 % ellipse holds the truth.
    pub inside: u64,
}

impl Tally {
    fn add<const N: usize>(&mut self, errors: [f64; N], sds: [f64; N]) {
        let q: f64 = errors
            .iter()
            .zip(sds)
            .map(|(e, s)| (e / s.max(1e-9)).powi(2))
            .sum();
        self.count += 1;
        self.squares += errors.iter().map(|e| e * e).sum::<f64>();
        self.normalised += q / N as f64;
        self.inside += u64::from(CHI2_95.get(N - 1).is_some_and(|limit| q <= *limit));
    }
    /// Both together.
    pub fn and(self, o: Tally) -> Tally {
        Tally {
            count: self.count + o.count,
            squares: self.squares + o.squares,
            normalised: self.normalised + o.normalised,
            inside: self.inside + o.inside,
        }
    }
    /// Root mean square of the error.
    pub fn rmse(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }
    /// Mean normalised squared error per component, 1 when the covariance is right.
    pub fn nees(&self) -> f64 {
        self.normalised / self.count.max(1) as f64
    }
    /// Share of the truths inside the 95 % ellipse.
    pub fn inside(&self) -> f64 {
        self.inside as f64 / self.count.max(1) as f64
    }
}

/// Tallies by source, figure and index of [`HORIZONS_S`].
pub type Scores = BTreeMap<(Source, Quantity, usize), Tally>;

/// The vessel's broadcast over `span_s` after the warm-up.
pub fn vessel(
    scenario: &Scenario,
    node: &VesselNodeConfig,
    seed: u64,
    span_s: f64,
) -> Result<Scores, SetupError> {
    Ok(vessel_scores(&run(scenario, node, seed, span_s)?))
}

fn vessel_scores(run: &Run) -> Scores {
    let source = Source::Vessel;
    let mut scores = Scores::new();
    for ((start, p), (level, sds)) in run.predictions.iter().zip(&run.levels) {
        for (h, &ahead) in HORIZONS_S.iter().enumerate() {
            let (Some(e), Some(sd)) = (
                vessel_errors(run, *start, p, *level, ahead),
                vessel_sd(p, sds, ahead),
            ) else {
                continue;
            };
            let mut add = |figure, f: &dyn Fn(&mut Tally)| f(scores.entry((source, figure, h)).or_default());
            add(Quantity::Heave, &|t| t.add([e.heave], [sd.heave]));
            add(Quantity::Height, &|t| t.add([e.eta[2]], [sd.eta[2]]));
            add(Quantity::Place, &|t| {
                t.add([e.eta[0], e.eta[1]], [sd.eta[0], sd.eta[1]])
            });
            add(Quantity::Tilt, &|t| {
                t.add([e.eta[3], e.eta[4]], [sd.eta[3], sd.eta[4]])
            });
            add(Quantity::Roll, &|t| t.add([e.eta[3]], [sd.eta[3]]));
            add(Quantity::Pitch, &|t| t.add([e.eta[4]], [sd.eta[4]]));
            add(Quantity::Deck, &|t| {
                t.add([e.heave, e.eta[3], e.eta[4]], [sd.heave, sd.eta[3], sd.eta[4]])
            });
        }
    }
    scores
}

/// Errors, or standard deviations.
struct Motion {
    eta: [f64; 5],
    heave: f64,
}

fn vessel_errors(
    run: &Run,
    start: f64,
    p: &VesselPrediction<VesselClock>,
    level: f64,
    ahead: f64,
) -> Option<Motion> {
    let tick = start + ahead / TICK.secs();
    let (i, f) = (tick.max(0.0).floor() as usize, tick.fract());
    let (a, b) = (run.truth.get(i)?, run.truth.get(i + 1)?);
    let mut eta = [0.0; 5];
    for (dof, e) in eta.iter_mut().enumerate() {
        let origin = if dof < 3 { p.origin[dof] } else { 0.0 };
        let then = a.eta[dof] + f * difference(dof, b.eta[dof], a.eta[dof]);
        *e = difference(dof, origin + predicted(p, dof, ahead)?, then);
    }
    let heave = p.origin[2] + predicted(p, 2, ahead)? - level - (a.heave + f * (b.heave - a.heave));
    Some(Motion { eta, heave })
}

fn vessel_sd(p: &VesselPrediction<VesselClock>, sds: &[([f64; 6], f64)], ahead: f64) -> Option<Motion> {
    let x = ahead / f64::from(p.step_s);
    let (i, f) = (x.floor() as usize, x.fract());
    let j = (i + 1).min(p.stages.len().saturating_sub(1));
    let (a, b) = (sds.get(i)?, sds.get(j)?);
    let mix = |a: f64, b: f64| a + f * (b - a);
    Some(Motion {
        eta: core::array::from_fn(|d| mix(a.0[d], b.0[d])),
        heave: mix(a.1, b.1),
    })
}

/// What the drone said at one instant, and what its frame was wrong by.
struct ForecastSample {
    tick: usize,
    source: Source,
    stages: Vec<alight_shared::msg::DeckStage>,
    /// The drone's own position minus the truth, m.
    frame: Vector3<f64>,
}

/// The deck at one tick.
struct Deck {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    tilt: [f64; 2],
}

/// The drone's forecasts: `span_s` of following at the tracking height, or one landing. The deck is
/// forecast in the drone's NED of that instant; the error of the drone's own position in it (held
/// against its truth at the time of its newest odometry) is taken out, for drone and deck share it.
pub fn drone(
    scenario: &Scenario,
    nodes: &NodeConfigs,
    seed: u64,
    span_s: Option<f64>,
) -> Result<Scores, SetupError> {
    let mut nodes = nodes.clone();
    if span_s.is_some() {
        follow_only(&mut nodes);
    }
    let mut world = World::new(scenario, &nodes, seed)?;
    world.warm_up(&mut NoTap);
    world.command(CommandKind::Land);
    let (mut decks, mut drones, mut predicted) = (Vec::new(), Vec::new(), Vec::new());
    let mut last = None;
    let mut touched = None;
    let mut next = 0;
    let mut left = ticks(MAX_WAIT_S);
    while left > 0 {
        left -= 1;
        let (deck, drone) = (world.physics().deck(), world.physics().drone(0));
        let (roll, pitch, _) = deck.attitude.euler();
        decks.push(Deck {
            position: deck.position.0,
            velocity: deck.velocity.0,
            tilt: [roll, pitch],
        });
        drones.push(drone.map(|d| d.position.0));
        let mut frame = Frame::default();
        world.tick(&mut frame);
        let tick = decks.len() - 1;
        if touched.is_none() && !world.observation().contacts.is_empty() {
            touched = Some(tick);
            left = left.min(ticks(2.1));
        }
        let state = world.mission_state().state;
        let source = match state {
            State::Tracking | State::TrackingStable => Some(Source::DroneFollowing),
            State::Descent | State::Flare => Some(Source::DroneDescending),
            State::Idle
            | State::GetAltitude
            | State::Approach
            | State::Landed
            | State::Hold
            | State::GaveUp => None,
        };
        let wanted = if span_s.is_some() {
            Source::DroneFollowing
        } else {
            Source::DroneDescending
        };
        let Some(source) = source.filter(|s| *s == wanted && touched.is_none()) else {
            continue;
        };
        if let Some(span) = span_s
            && last.is_none()
        {
            last = Some(tick);
            left = ticks(span);
        }
        let Some((forecast, own, age_s)) = frame.0 else {
            continue;
        };
        let Some(frame_error) = frame_error(&drones, tick, &own, age_s) else {
            continue;
        };
        let seen = forecast.tag_age_s <= MAX_TAG_AGE_S || source == Source::DroneDescending;
        if tick < next || !seen {
            continue;
        }
        next = tick + SAMPLE_TICKS;
        let stages = HORIZONS_S
            .iter()
            .filter_map(|h| forecast.at(forecast.header.at + Span::from_secs(*h)))
            .collect();
        predicted.push(ForecastSample {
            tick,
            source,
            stages,
            frame: frame_error,
        });
    }
    if let Some(touched) = touched {
        predicted.retain(|s| s.tick + ticks(FINAL_S) >= touched);
    }
    Ok(drone_scores(&decks, &predicted))
}

/// The drone's own position, `age_s` old at `tick`, less the truth (by ticks) at its time, m.
pub(super) fn frame_error(
    truth: &[Option<Vector3<f64>>],
    tick: usize,
    own: &Vector3<f64>,
    age_s: f64,
) -> Option<Vector3<f64>> {
    let at = (tick as f64 - age_s / TICK.secs()).max(0.0);
    let position = |i: usize| truth.get(i).copied().flatten();
    let a = position(at.floor() as usize)?;
    let b = position(at.floor() as usize + 1).unwrap_or(a);
    Some(own - a.lerp(&b, at.fract()))
}

/// No landing is certain: it follows.
pub(super) fn follow_only(nodes: &mut NodeConfigs) {
    nodes.drone.mission.min_probability = 1.0;
}

pub(super) fn ticks(s: f64) -> usize {
    (s / TICK.secs()).round() as usize
}

fn drone_scores(decks: &[Deck], predicted: &[ForecastSample]) -> Scores {
    let mut scores = Scores::new();
    for s in predicted {
        for (h, (&ahead, stage)) in HORIZONS_S.iter().zip(&s.stages).enumerate() {
            let Some(deck) = decks.get(s.tick + ticks(ahead)) else {
                continue;
            };
            let e = Vector3::from(stage.position) - s.frame - deck.position;
            let rate = Vector3::from(stage.velocity) - deck.velocity;
            let tilt: [f64; 2] = core::array::from_fn(|i| wrap_angle(stage.euler[i] - deck.tilt[i]));
            let sd = stage.position_sd;
            let mut add =
                |figure, f: &dyn Fn(&mut Tally)| f(scores.entry((s.source, figure, h)).or_default());
            add(Quantity::Height, &|t| t.add([e.z], [sd[2]]));
            add(Quantity::Place, &|t| t.add([e.x, e.y], [sd[0], sd[1]]));
            add(Quantity::Tilt, &|t| {
                t.add(tilt, [stage.euler_sd[0], stage.euler_sd[1]])
            });
            add(Quantity::Roll, &|t| t.add([tilt[0]], [stage.euler_sd[0]]));
            add(Quantity::Pitch, &|t| t.add([tilt[1]], [stage.euler_sd[1]]));
            add(Quantity::VerticalSpeed, &|t| {
                t.add([rate.z], [stage.velocity_sd[2]])
            });
            add(Quantity::Deck, &|t| {
                t.add(
                    [e.z, tilt[0], tilt[1]],
                    [sd[2], stage.euler_sd[0], stage.euler_sd[1]],
                )
            });
        }
    }
    scores
}

/// The forecast of a tick with the drone's own position and that position's age, s.
#[derive(Default)]
pub(super) struct Frame(pub(super) Option<(alight_shared::msg::DeckForecast, Vector3<f64>, f64)>);

impl crate::harness::tap::Tap for Frame {
    fn predictor(
        &mut self,
        _t: alight_shared::time::Time<alight_shared::time::TrueTime>,
        now: alight_shared::time::Time<alight_shared::time::DroneClock>,
        input: &alight_uav::predictor::PredictorIn,
        output: &alight_uav::predictor::PredictorOut,
    ) {
        self.0 = output
            .forecast
            .zip(input.drone)
            .map(|(f, d)| (f, d.position(), (now - d.header.at).secs()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tally_by_dimension() {
        let mut t = Tally::default();
        // 2.2 standard deviations: outside in one dimension, inside in two and three.
        t.add([2.2], [1.0]);
        assert_eq!((t.count, t.inside), (1, 0));
        t.add([2.2, 0.0], [1.0, 5.0]);
        t.add([0.0, 2.2, 0.0], [1.0, 1.0, 1.0]);
        assert_eq!((t.count, t.inside), (3, 2));
        assert!((t.rmse() - 2.2).abs() < 1e-12);
        assert!((t.nees() - 4.84 * (1.0 + 0.5 + 1.0 / 3.0) / 3.0).abs() < 1e-12);
        assert_eq!(t.and(t).count, 6);
    }
}
