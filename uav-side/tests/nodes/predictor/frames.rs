//! The predictor where the frames of vessel and drone begin at different places, and move.

use alight_shared::frames::{DroneNed, Vector, VesselNed, body_from_camera};
use alight_shared::geodesy::Datum;
use alight_shared::geometry::DroneGeometry;
use alight_shared::msg::{DeckForecast, DroneState, Header, TagPose, VesselEstimate, f16};
use alight_shared::node::Node;
use alight_uav::predictor::{Predictor, PredictorConfig, PredictorIn};
use nalgebra::{UnitQuaternion, Vector3};

use super::world::time;

/// A vessel at anchor and a drone that hovers 3 m above its deck and 2 m south of it, close to the date line.
struct Bench {
    predictor: Predictor,
    tick: u32,
    /// Place of the vessel, and its datum and start.
    vessel: Datum,
    datum: Datum,
    boot: u32,
    /// The autopilot's origin, and by how much its heading is wrong, rad.
    origin: Datum,
    yaw: f64,
    forecast: Option<DeckForecast>,
}

const DECK: [f64; 3] = [0.0, 0.0, -1.3];

impl Bench {
    fn new() -> Bench {
        let vessel = Datum::new(-16.8, 179.999, 55.0);
        let near = |n: f64, e: f64, d: f64| vessel.at(&Vector::<VesselNed>::new(n, e, d));
        Bench {
            predictor: Predictor::new(&PredictorConfig::default(), 1),
            tick: 0,
            vessel,
            datum: near(-400.0, 300.0, -2.0),
            boot: 1,
            origin: near(1500.0, 1200.0, -8.0),
            yaw: 0.0,
            forecast: None,
        }
    }
    /// Place of the deck in the drone's frame.
    fn deck(&self) -> Vector3<f64> {
        self.origin.to::<DroneNed>(&self.vessel).0 + Vector3::from(DECK)
    }
    fn drone(&self) -> Vector3<f64> {
        self.deck() + Vector3::new(-2.0, 0.0, -3.0)
    }
    fn attitude(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_euler_angles(0.0, 0.0, self.yaw)
    }
    fn run(&mut self, seconds: f64, vision: bool) {
        for _ in 0..(seconds * 100.0) as u32 {
            self.tick += 1;
            let k = self.tick;
            let header = |boot| Header::new(1, 1, boot, k, time(f64::from(k) * 0.01));
            let q = self.attitude();
            let estimate = VesselEstimate {
                header: header(self.boot),
                datum: self.datum,
                eta: {
                    let p = self.datum.to::<VesselNed>(&self.vessel).0;
                    [p.x, p.y, p.z, 0.0, 0.0, 0.0]
                },
                uncertainty: [[0.05, 0.05, 0.0].map(f16::from_f64); 6],
                deck_centre: DECK.map(|x| x as f32),
                ..VesselEstimate::default()
            };
            // The camera looks where the drone really points: north.
            let camera = body_from_camera();
            let lens = self.drone() + Vector3::from(DroneGeometry::default().camera_m);
            let turned = UnitQuaternion::from_matrix(&camera.transpose());
            let tag = TagPose {
                header: header(1),
                position: (camera.transpose() * (self.deck() - lens)).into(),
                attitude: [turned.w, turned.i, turned.j, turned.k],
                variance: [1e-4; 6],
            };
            let input = PredictorIn {
                estimate: k.is_multiple_of(3).then_some(estimate),
                drone: Some(DroneState {
                    header: header(1),
                    datum: self.origin,
                    // As the odometry has summed it.
                    heading_jumps: self.yaw,
                    position: self.drone().into(),
                    attitude: [q.w, q.i, q.j, q.k],
                    position_sd: [0.02; 3],
                    ..DroneState::default()
                }),
                tags: (vision && k.is_multiple_of(3))
                    .then_some(tag)
                    .into_iter()
                    .collect(),
                ..PredictorIn::default()
            };
            let out = self.predictor.step(time(f64::from(k) * 0.01), &input);
            self.forecast = out.forecast.or(self.forecast);
        }
    }
    /// The predicted deck now, from the drone, in its body's axes.
    fn relative(&self) -> Vector3<f64> {
        let deck = Vector3::from(self.forecast.unwrap().stages[0].position);
        self.attitude().inverse() * (deck - self.drone())
    }
    fn assert_right(&self, limit_m: f64) {
        let error = self.relative() - Vector3::new(2.0, 0.0, 3.0);
        assert!(error.norm() < limit_m, "{error}");
    }
}

#[test]
fn deck_in_the_drones_frame_by_radio() {
    let mut b = Bench::new();
    b.run(3.0, false);
    b.assert_right(0.05);
}

#[test]
fn deck_through_a_restart_of_the_vessel() {
    let mut b = Bench::new();
    b.run(3.0, false);
    b.datum = b.vessel.at(&Vector::<VesselNed>::new(0.7, -0.9, -2.2));
    b.boot = 2;
    for _ in 0..20 {
        b.run(0.1, false);
        b.assert_right(0.05);
    }
}

#[test]
fn deck_through_a_move_of_the_drones_origin() {
    let mut b = Bench::new();
    b.run(3.0, true);
    b.origin = b.vessel.at(&Vector::<VesselNed>::new(-20.0, 35.0, 1.0));
    b.forecast = None;
    b.run(0.1, true);
    b.assert_right(0.2);
    b.run(1.0, true);
    b.assert_right(0.05);
}

#[test]
fn deck_through_a_reset_of_the_drones_heading() {
    let mut b = Bench::new();
    b.run(5.0, true);
    b.assert_right(0.05);
    b.yaw = 0.26;
    for _ in 0..20 {
        b.run(0.1, true);
        b.assert_right(0.1);
    }
}

#[test]
fn deck_by_radio_through_a_late_heading_alignment() {
    let mut b = Bench::new();
    b.run(3.0, false);
    let north_up = |b: &Bench| b.attitude() * b.relative();
    let before = north_up(&b);
    for yaw in [2.06, -3.0] {
        b.yaw = yaw;
        b.run(0.1, false);
        assert!(
            (north_up(&b) - before).norm() < 0.05,
            "{yaw}: {}",
            north_up(&b) - before
        );
    }
}
