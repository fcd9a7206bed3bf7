//! The predictor behind sea, vessel, estimator, radio and bridge, against the truth: a drone that
//! flies above the deck by truth and looks at it.

use alight_shared::frames::{Deck, DroneBody, VesselBody, wrap_angle};
use alight_shared::geometry::DeckGeometry;
use alight_shared::msg::{DeckForecast, Motors, SetPoint, SetPointKind, VesselEstimate};
use alight_shared::step::Step;
use alight_shared::time::{DroneClock, Span, Time, TrueTime};
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::tap::Tap;
use alight_sim::harness::world::World;
use alight_sim::physics::body::RigidState;
use alight_uav::predictor::{PredictorIn, PredictorOut};
use nalgebra::Vector3;

/// A forecast and its tick.
pub(crate) struct ForecastSample {
    pub(crate) t: usize,
    pub(crate) forecast: DeckForecast,
}

/// Record that a tap collects from the warm-up on.
#[derive(Default)]
pub(crate) struct PredictorFlight {
    /// Error of the drone's odometry at each tick: the forecast is where the drone will believe the deck.
    frames: Vec<Vector3<f64>>,
    /// Deck, per tick.
    pub(crate) truth: Vec<RigidState<Deck>>,
    pub(crate) samples: Vec<ForecastSample>,
    /// The vessel's estimates as the drone received them.
    pub(crate) estimates: Vec<VesselEstimate<DroneClock>>,
    /// Tick at which the test begins to fly.
    pub(crate) began: usize,
    /// True position of the drone.
    drone: Vector3<f64>,
}

impl Tap for PredictorFlight {
    fn truth(
        &mut self,
        _: Time<TrueTime>,
        vessel: &RigidState<VesselBody>,
        drone: Option<&(RigidState<DroneBody>, Vector3<f64>)>,
    ) {
        self.truth.push(vessel.at(DeckGeometry::default().centre()));
        self.frames.push(self.frames.last().copied().unwrap_or_default());
        self.drone = drone.map_or(self.drone, |(d, _)| d.position.0);
    }
    fn step(&mut self, _: Time<TrueTime>, step: &Step<'_>) {
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

/// 40 s above the deck by truth, [`landing`] over its mean place; the radio is cut after `cut_s`.
fn fly(cut_s: f64, seed: u64) -> PredictorFlight {
    let mut mean = None;
    fly_above(Scenario::default(), [40.0, cut_s], seed, |deck| {
        let mean = mean.get_or_insert(deck.position.0);
        *mean += (deck.position.0 - *mean) * 0.003;
        (*mean, Vector3::zeros())
    })
}

/// For so long (s) [`landing`] above the place (m) with the velocity (m/s) that `follow` has of the deck; the radio is cut
/// after the second time (s).
pub(crate) fn fly_above(
    mut scenario: Scenario,
    [secs, cut_s]: [f64; 2],
    seed: u64,
    mut follow: impl FnMut(&RigidState<Deck>) -> (Vector3<f64>, Vector3<f64>),
) -> PredictorFlight {
    scenario.start.distance_m = [0.0; 2];
    scenario.start.height_m = [9.0; 2];
    let mut world = World::new(&scenario, &NodeConfigs::default(), seed).unwrap();
    let mut flight = PredictorFlight::default();
    world.warm_up(&mut flight);
    flight.began = flight.truth.len();
    for tick in 0..(secs * 100.0) as u32 {
        let since = f64::from(tick) * 0.01;
        if since >= cut_s && since < cut_s + 0.01 {
            world.radio_outage(0, f64::INFINITY);
        }
        let deck = world.physics().deck();
        let (place, velocity) = follow(&deck);
        let above = Vector3::new(place.x, place.y, -1.3 - landing(since));
        let set_point = SetPoint {
            kind: SetPointKind::Trajectory,
            motors: Motors::Run,
            position: (above + flight.frames[flight.frames.len() - 1]).into(),
            velocity: velocity.into(),
            yaw: deck.euler().z,
            ..SetPoint::default()
        };
        world.fly_by_set_point(0, set_point);
        world.tick(&mut flight);
    }
    flight
}

/// Root mean squares (m, rad) and mean normalised squared errors of a horizon.
#[derive(Clone, Copy, Debug, Default)]
struct HorizonErrors {
    horizontal: f64,
    vertical: f64,
    tilt: f64,
    yaw: f64,
    nees: [f64; 3],
    n: f64,
}

impl HorizonErrors {
    fn add(&mut self, f: &PredictorFlight, from_s: f64, to_s: f64, ahead: f64) {
        for s in &f.samples {
            let since = (s.t as f64 - f.began as f64) * 0.01;
            let then = s.t + (ahead * 100.0).round() as usize;
            let (Some(deck), Some(frame)) = (f.truth.get(then), f.frames.get(then)) else {
                continue;
            };
            if since < from_s || since >= to_s {
                continue;
            }
            let at = s.forecast.header.at + Span::from_secs(ahead);
            let stage = s.forecast.at(at).unwrap();
            let p = Vector3::from(stage.position) - frame - deck.position.0;
            let e = Vector3::from(stage.euler) - deck.euler();
            let yaw = wrap_angle(e.z);
            self.n += 1.0;
            self.horizontal += p.x * p.x + p.y * p.y;
            self.vertical += p.z * p.z;
            self.tilt += e.x * e.x + e.y * e.y;
            self.yaw += yaw * yaw;
            let ratio = |e: f64, sd: f64| (e / sd).powi(2);
            self.nees[0] += 0.5 * (ratio(p.x, stage.position_sd[0]) + ratio(p.y, stage.position_sd[1]));
            self.nees[1] += ratio(p.z, stage.position_sd[2]);
            self.nees[2] += 0.5 * (ratio(e.x, stage.euler_sd[0]) + ratio(e.y, stage.euler_sd[1]));
        }
    }
    fn of(flights: &[PredictorFlight], from_s: f64, to_s: f64, ahead: f64) -> HorizonErrors {
        let mut a = HorizonErrors::default();
        for f in flights {
            a.add(f, from_s, to_s, ahead);
        }
        let mean = |x: f64| x / a.n;
        let f = HorizonErrors {
            horizontal: mean(a.horizontal).sqrt(),
            vertical: mean(a.vertical).sqrt(),
            tilt: mean(a.tilt).sqrt(),
            yaw: mean(a.yaw).sqrt(),
            nees: a.nees.map(mean),
            n: a.n,
        };
        println!(
            "{from_s:4.0}..{to_s:3.0} s, {ahead:.1} s ahead: {:.3} m across, {:.3} m down, {:.2} deg tilt, \
             {:.2} deg yaw, NEES {:.2} {:.2} {:.2}",
            f.horizontal,
            f.vertical,
            f.tilt.to_degrees(),
            f.yaw.to_degrees(),
            f.nees[0],
            f.nees[1],
            f.nees[2]
        );
        f
    }
}

/// Approach at 7 m, then down to 1.5 m.
fn landing(since: f64) -> f64 {
    if since < 20.0 {
        7.0
    } else {
        (7.0 - (since - 20.0)).max(1.5)
    }
}

/// Flights of three seeds at Moderate, the radio cut after `cut_s`.
fn flights(cut_s: f64) -> Vec<PredictorFlight> {
    (100..103).map(|seed| fly(cut_s, seed)).collect()
}

#[test]
fn forecast_accuracy_at_moderate() {
    let flights = flights(1e9);
    let high = HorizonErrors::of(&flights, 10.0, 20.0, 0.2);
    let near = HorizonErrors::of(&flights, 26.0, 38.0, 0.2);
    let far = HorizonErrors::of(&flights, 26.0, 38.0, 1.0);
    assert!(near.horizontal < 0.10 && near.vertical < 0.05 && near.tilt.to_degrees() < 0.7);
    assert!(
        far.horizontal < 0.12 && far.vertical < 0.06 && far.tilt.to_degrees() < 1.0,
        "{far:?}"
    );
    assert!(far.yaw.to_degrees() < 2.5);
    for f in [high, near, far] {
        assert!(f.n > 1000.0 && f.nees.iter().all(|n| *n < 2.0), "{f:?}");
    }
}

#[test]
fn forecast_accuracy_from_vision_alone() {
    let flights = flights(5.0);
    let near = HorizonErrors::of(&flights, 26.0, 38.0, 0.2);
    let far = HorizonErrors::of(&flights, 26.0, 38.0, 1.0);
    assert!(near.horizontal < 0.13 && near.vertical < 0.08 && near.tilt.to_degrees() < 2.0);
    assert!(far.horizontal < 0.20 && far.vertical < 0.13 && far.tilt.to_degrees() < 2.2);
    for f in [near, far] {
        assert!(f.n > 1000.0 && f.nees.iter().all(|n| *n < 2.0), "{f:?}");
    }
}
