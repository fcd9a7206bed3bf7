//! Forecast of a drone above a real boat under way, whose heel changes with each turn, in almost flat water.

use std::path::Path;

use alight_shared::{
    estimation::moments,
    frames::{Deck, DroneBody, VesselBody, wrap_angle},
    geometry::DeckGeometry,
    msg::{DeckForecast, Motors, SetPoint, SetPointKind, VesselEstimate},
    process::ProcessKind,
    step::Step,
    time::{DroneClock, Span, WorldTime},
};
use alight_sim::{
    harness::{
        bus::BusSide,
        observer::WorldObserver,
        scenario::{NodeConfigs, Scenario},
        world::World,
    },
    physics::{body::RigidState, deck_motion::DeckMotionConfig, sea::SeaConfig},
};
use alight_uav::predictor::{PredictorIn, PredictorOut};
use nalgebra::Vector3;

/// Flight time above the boat, s; the first part, in which the filters converge, is not judged.
const FLOWN_S: f64 = 38.0;
const BEGINS_S: f64 = 10.0;

struct ForecastSample {
    t: usize,
    forecast: DeckForecast,
}

#[derive(Default)]
struct PredictorFlight {
    /// Error of the drone's odometry, whose frame the forecast uses, at each tick.
    frames: Vec<Vector3<f64>>,
    truth: Vec<RigidState<Deck>>,
    samples: Vec<ForecastSample>,
    /// Estimates as received by the drone.
    estimates: Vec<VesselEstimate<DroneClock>>,
    /// Start of the flight above the boat, ticks.
    began: usize,
    drone: Vector3<f64>,
}

impl WorldObserver for PredictorFlight {
    fn truth(
        &mut self,
        _: WorldTime,
        vessel: &RigidState<VesselBody>,
        drone: Option<&(RigidState<DroneBody>, Vector3<f64>)>,
    ) {
        self.truth.push(vessel.at(DeckGeometry::default().centre()));
        self.frames.push(self.frames.last().copied().unwrap_or_default());
        self.drone = drone.map_or(self.drone, |(d, _)| d.position.0);
    }
    fn step(&mut self, _: WorldTime, step: &Step<'_>) {
        let (Some(i), Some(o)) = (step.input::<PredictorIn>(), step.output::<PredictorOut>()) else {
            return;
        };
        if let (Some(odometry), Some(frame)) = (i.drone, self.frames.last_mut()) {
            *frame = odometry.position() - self.drone;
        }
        self.estimates.extend(i.estimate);
        let t = self.truth.len() - 1;
        self.samples
            .extend(o.forecast.map(|forecast| ForecastSample { t, forecast }));
    }
}

/// The truth keeps the drone level with the recorded boat: at 7 m, then down to 1.5 m.
fn above_the_boat() -> PredictorFlight {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/flights/data/figure-of-eight.csv");
    let mut scenario = Scenario {
        sea: SeaConfig::paper(0.0, 5.0),
        deck_motion: Some(DeckMotionConfig {
            file,
            keep_mean: true,
            ..DeckMotionConfig::default()
        }),
        ..Scenario::default()
    };
    // The recording lasts 100 s; in the second half the boat heels to the other side.
    scenario.start.warm_up_s = 60.0;
    scenario.start.distance_m = [0.0; 2];
    scenario.start.height_m = [9.0; 2];
    let mut world = World::new(&scenario, &NodeConfigs::default(), 100).unwrap();
    let mut flight = PredictorFlight::default();
    world.warm_up(&mut flight);
    flight.began = flight.truth.len();
    for tick in 0..(FLOWN_S * 100.0) as u32 {
        let since = f64::from(tick) * 0.01;
        let deck = world.physics().deck();
        let height_m = (7.0 - (since - 20.0).max(0.0)).max(1.5);
        let above = Vector3::new(deck.position.0.x, deck.position.0.y, -1.3 - height_m);
        let set_point = SetPoint {
            kind: SetPointKind::Trajectory,
            motors: Motors::Run,
            position: (above + flight.frames[flight.frames.len() - 1]).into(),
            velocity: [deck.velocity.0.x, deck.velocity.0.y, 0.0],
            yaw: deck.euler().z,
            ..SetPoint::default()
        };
        let bus = &world.drones()[0].bus;
        bus.wrap(
            ProcessKind::Pilot,
            BusSide::Written,
            move |_, _: Vec<SetPoint>| vec![set_point],
        );
        world.tick(&mut flight);
    }
    flight
}

/// Standard deviation of the roll and pitch errors of forecasts at a horizon (s), deg. Excludes the trim of
/// the inertial unit, which is a constant error.
fn errors_deg(flight: &PredictorFlight, ahead_s: f64) -> [f64; 2] {
    let mut errors = [Vec::new(), Vec::new()];
    for s in &flight.samples {
        let then = flight.truth.get(s.t + (100.0 * ahead_s).round() as usize);
        let stage = s.forecast.at(s.forecast.header.at + Span::from_secs(ahead_s));
        let begun = (s.t as f64 - flight.began as f64) * 0.01 >= BEGINS_S;
        let (Some(deck), Some(stage), true) = (then, stage, begun) else {
            continue;
        };
        let error = Vector3::from(stage.euler) - deck.euler();
        errors[0].push(error.x.to_degrees());
        errors[1].push(error.y.to_degrees());
    }
    assert!(errors[0].len() > 500, "{} forecasts", errors[0].len());
    errors.map(|e| moments(&e).1)
}

/// Root mean square difference in roll and pitch between a forecast's start and the vessel's estimate, deg.
fn beginning_deg(flight: &PredictorFlight) -> f64 {
    let mut sum = 0.0;
    let mut n = 0.0;
    for e in &flight.estimates {
        let i = flight
            .samples
            .partition_point(|s| s.forecast.header.at <= e.header.at);
        let Some(s) = i.checked_sub(1).and_then(|i| flight.samples.get(i)) else {
            continue;
        };
        if (s.t as f64 - flight.began as f64) * 0.01 < BEGINS_S {
            continue;
        }
        let Some(stage) = s.forecast.at(e.header.at) else {
            continue;
        };
        n += 1.0;
        sum += wrap_angle(stage.euler[0] - e.eta[3]).powi(2) + wrap_angle(stage.euler[1] - e.eta[4]).powi(2);
    }
    assert!(n > 100.0, "{n} estimates");
    (sum / (2.0 * n)).sqrt().to_degrees()
}

#[test]
fn forecast_over_a_boat_that_turns() {
    let flight = above_the_boat();
    let begins = beginning_deg(&flight);
    let errors = [0.0, 0.5, 1.0, 2.0].map(|ahead| errors_deg(&flight, ahead));
    println!("begins {begins:.3} deg from the estimate; roll, pitch {errors:.3?} deg");
    assert!(begins < 0.2, "{begins} deg from the estimate");
    let [_, half, one, _] = errors;
    assert!(
        half.iter().all(|e| *e < 0.25) && one.iter().all(|e| *e < 0.45),
        "{errors:?}"
    );
}
