//! Predictor with a relative position from a moving base: a correct fix, a false fix, and a float solution.

use alight_shared::{
    frames::{body_from_camera, wxyz},
    geometry::DroneGeometry,
    msg::{
        CarrierSolution, DeckForecast, DroneState, Header, RelativePlace, RelativeState, TagPose,
        VesselEstimate, f16,
    },
    node::Node,
};
use alight_uav::predictor::{Predictor, PredictorConfig, PredictorIn};
use nalgebra::{UnitQuaternion, Vector3};

use super::world::time;

/// A vessel at anchor heads north, and its position by radio is 2 m off. A drone with drifting odometry hovers above
/// its deck.
struct Bench {
    predictor: Predictor,
    tick: u32,
    solution: Option<CarrierSolution>,
    error: Vector3<f64>,
    vision: bool,
    forecast: DeckForecast,
    drift: Vector3<f64>,
}

const DECK: Vector3<f64> = Vector3::new(0.0, 0.0, -1.3);
const DRONE: Vector3<f64> = Vector3::new(-0.3, 0.2, -3.3);
const ANTENNA: [f32; 3] = [-1.0, 0.5, -2.0];
const FALSE_FIX: Vector3<f64> = Vector3::new(0.4, -0.3, 0.0);

impl Bench {
    fn new(solution: CarrierSolution, error: Vector3<f64>) -> Bench {
        Bench {
            predictor: Predictor::new(&PredictorConfig::default(), 1),
            tick: 0,
            solution: Some(solution),
            error,
            vision: false,
            forecast: DeckForecast::default(),
            drift: Vector3::zeros(),
        }
    }
    fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * 100.0).round() as u32 {
            self.step();
        }
    }
    fn step(&mut self) {
        self.tick += 1;
        let k = self.tick;
        let now = time(f64::from(k) * 0.01);
        let header = Header::new(1, 1, 1, k, now);
        let geometry = DroneGeometry::default();
        self.drift += Vector3::new(0.03, 0.0, 0.01) * 0.01;
        let estimate = VesselEstimate {
            header,
            eta: [2.0, 0.0, 0.5, 0.0, 0.0, 0.0],
            uncertainty: [[0.05, 0.05, 0.0].map(f16::from_f64); 6],
            deck_centre: [0.0, 0.0, -1.3],
            ..VesselEstimate::default()
        };
        let camera = body_from_camera();
        let turned = UnitQuaternion::from_matrix(&camera.transpose());
        let tag = TagPose {
            header,
            position: (camera.transpose() * (DECK - DRONE - Vector3::from(geometry.camera_m))).into(),
            attitude: wxyz(&turned),
            variance: [1e-4; 6],
        };
        let relative = self.solution.map(|solution| RelativePlace {
            header,
            baseline_m: (DRONE + Vector3::from(geometry.gnss_antenna_m)
                - DECK
                - Vector3::from(ANTENNA.map(f64::from))
                + self.error)
                .into(),
            baseline_sd_m: [0.01, 0.01, 0.02],
            solution,
            antenna_m: ANTENNA,
        });
        let input = PredictorIn {
            estimate: k.is_multiple_of(5).then_some(estimate),
            drone: Some(DroneState {
                header,
                position: (DRONE + self.drift).into(),
                position_sd: [0.02; 3],
                ..DroneState::default()
            }),
            tags: Some(tag)
                .filter(|_| self.vision && k.is_multiple_of(3))
                .into_iter()
                .collect(),
            relative: relative.filter(|_| k.is_multiple_of(20)).into_iter().collect(),
            ..PredictorIn::default()
        };
        if let Some(forecast) = self.predictor.step(now, &input).forecast {
            self.forecast = forecast;
        }
    }
    /// Error of the forecast deck's position in the drone's frame, m.
    fn off_m(&self) -> f64 {
        let [stage, ..] = &self.forecast.stages[..] else {
            panic!("no stage");
        };
        (Vector3::from(stage.position) - self.drift - DECK).norm()
    }
    fn state(&self) -> RelativeState {
        self.forecast.relative.unwrap()
    }
}

#[test]
fn false_fix_before_the_tags() {
    let mut b = Bench::new(CarrierSolution::Fixed, FALSE_FIX);
    b.run(20.0);
    assert!((b.off_m() - FALSE_FIX.norm()).abs() < 0.05, "{}", b.off_m());
    b.vision = true;
    b.run(1.5);
    assert!(b.off_m() < 0.05, "{}", b.off_m());
    let s = b.state();
    assert!((s.contradicted_m.unwrap() - 0.5).abs() < 0.1, "{s:?}");
    // The fix stays rejected until the receiver has solved again.
    b.vision = false;
    b.run(3.0);
    assert!(
        b.off_m() < 0.3 && b.state().used_age_s == f64::INFINITY,
        "{}",
        b.off_m()
    );
    b.solution = Some(CarrierSolution::Float);
    b.run(0.5);
    b.solution = Some(CarrierSolution::Fixed);
    b.error = Vector3::zeros();
    b.vision = true;
    b.run(1.5);
    assert!(b.state().confirmed && b.off_m() < 0.05, "{:?}", b.state());
}
