//! The ultraviolet camera's node on rendered images, compared with the measurement model.

use core::f64::consts::TAU;

use alight_uav::camera::{
    node::CameraIdentity,
    uvdar::{UvdarNode, UvdarSettings},
};

use super::*;
use crate::sensors::{
    camera::{CameraMount, body_from_camera},
    noise::Noise,
    render::{Shot, ultraviolet::Ultraviolet},
    uvdar::UvdarConfig,
};

const RANGE_M: f64 = 12.0;
/// Images per flight. The first images, in which the codes are still unknown, do not count.
const IMAGES: usize = 80;
const FIRST: usize = 20;

/// Fixes and true positions of the deck, in camera axes, from four flights past a rocking deck, with `glints`
/// glints per image.
fn fixes(settings: &UvdarSettings, glints: usize, seed: u64) -> Vec<Option<[Vector3<f64>; 2]>> {
    let identity = CameraIdentity {
        vessel: 1,
        drone: 1,
        boot: 1,
    };
    let mount = CameraMount {
        position: Vector3::zeros(),
        attitude: body_from_camera(),
    };
    let mut draw = Noise::new(&Streams::new(seed), "study.uvdar");
    let mut fixes = Vec::new();
    for flight in 0..4 {
        let mut camera = Ultraviolet::new(settings, glints, &Streams::new(1000 * seed + flight));
        let mut node = UvdarNode::new(settings, identity);
        let mut between = |low: f64, high: f64| low + (high - low) * draw.uniform();
        let (up, bearing, heading) = (between(0.35, 1.3), between(-3.1, 3.1), between(-3.1, 3.1));
        let (phase, speed, rock) = (between(0.0, 6.2), between(0.0, 2.0), between(0.02, 0.12));
        let begin = between(0.0, 600.0);
        let side = Vector3::new(-bearing.sin(), bearing.cos(), 0.0);
        let from = Vector3::new(-bearing.cos() * up.cos(), -bearing.sin() * up.cos(), -up.sin()) * RANGE_M;
        for k in 0..IMAGES {
            let s = k as f64 / settings.rate_hz;
            let wave = |shift: f64, period: f64| (TAU * s / period + phase + shift).sin();
            let deck = RigidState::<Deck> {
                position: Point::new(0.0, 0.0, -1.3 + 0.3 * wave(1.0, 5.0)),
                attitude: Rotation::from_euler(rock * wave(0.0, 5.0), rock * wave(2.0, 4.0), heading),
                ..Default::default()
            };
            let place = from + side * (speed * (s - 2.0)) + Vector3::new(0.0, 0.0, -1.3);
            let drone = RigidState::<DroneBody> {
                position: Point::from(place),
                velocity: Vector::from(side * speed),
                attitude: Rotation::from_euler(0.05 * wave(0.5, 2.0), 0.05 * wave(1.5, 2.3), bearing),
                ..Default::default()
            };
            let t = Time::from_nanos(((begin + s) * 1e9) as i64);
            let shot = Shot {
                t,
                at: Time::from_nanos(t.nanos()),
                exposure_s: 0.004,
                gain: 1.0,
                view: mount.view(&drone),
                deck,
            };
            let fix = node.detect(shot.at, &camera.image(&shot).unwrap());
            if k >= FIRST {
                let truth = shot.view.to_camera_frame(shot.deck.position);
                fixes.push(fix.map(|fix| [Vector3::from(fix.position), truth]));
            }
        }
    }
    fixes
}

#[test]
fn uvdar_node_among_glints() {
    let images = fixes(&UvdarSettings::default(), 10, 3);
    let fixes: Vec<_> = images.iter().flatten().collect();
    let mean = |of: &dyn Fn(&[Vector3<f64>; 2]) -> f64| {
        (fixes.iter().map(|fix| of(fix)).sum::<f64>() / fixes.len() as f64).sqrt()
    };
    let far = |[fix, truth]: &[Vector3<f64>; 2]| (fix - truth).dot(&truth.normalize()) / truth.norm();
    let aside =
        |[fix, truth]: &[Vector3<f64>; 2]| (fix - truth).cross(&truth.normalize()).norm() / truth.norm();
    let worst = fixes
        .iter()
        .map(|[fix, truth]| (fix - truth).norm() / truth.norm());
    assert!(worst.fold(0.0, f64::max) < 0.5, "made from wrong markers");
    let rate = fixes.len() as f64 / images.len() as f64;
    let (bearing, distance) = (
        mean(&|fix| 0.5 * aside(fix).powi(2)),
        mean(&|fix| far(fix).powi(2)),
    );
    assert!(
        rate > 0.5 && bearing.to_degrees() < 0.5 && distance < 0.15,
        "{rate} {bearing} {distance}"
    );
    // The model is fitted to this detector.
    let model = UvdarConfig::default();
    let [model_bearing, model_distance] = model.sd(RANGE_M);
    assert!((1.0 - model.miss - rate).abs() < 0.1, "{rate}");
    for ratio in [model_bearing / bearing, model_distance / distance] {
        assert!((0.6..1.7).contains(&ratio), "{ratio}");
    }
}

#[test]
fn uvdar_node_in_glints_alone() {
    let up = UvdarSettings {
        tilt_down_deg: -90.0,
        ..UvdarSettings::default()
    };
    let images = fixes(&up, 60, 5);
    assert_eq!((images.len(), images.iter().flatten().count()), (240, 0));
}
