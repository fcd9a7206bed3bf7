//! The belly camera at night: the detector on rendered images compared with the measurement model.

use alight_uav::camera::{TagSettings, detector::TagDetector};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use super::*;
use crate::sensors::{
    camera::CameraMotion,
    night::NightConfig,
    noise::Noise,
    render::{Renderer, Shot},
    square_pose::corners,
    tag::SimulatedTagDetector,
};

const IMAGES: usize = 30;

/// Fraction of images with a detection, and corner noise, px: on rendered images, and according to the model.
struct Row {
    images: [f64; 2],
    model: [f64; 2],
}

/// Tag of 1 m in this light, viewed from all sides, 20 deg off its normal.
fn row(night: NightConfig, range_m: f64) -> Row {
    let (mut config, streams) = (SensorConfig::default(), Streams::new(7));
    // Rendered images have no error of a lens.
    config.tag.corner_sd_px = 0.046;
    let deck = DeckGeometry {
        tag_side_m: Some(1.0),
        ..DeckGeometry::default()
    };
    let (tags, lens) = (deck.tags(), config.render.lens);
    let mut renderer = Renderer::new(&config.render, &deck, &streams).at_night(Some(&night));
    let mut detector = TagDetector::new(&TagSettings::default(), &tags);
    let model = SimulatedTagDetector::new(&config.tag, &deck, "drone.tag", &streams).at_night(Some(&night));
    let mut draw = Noise::new(&streams, "test.night");
    // Half the image's height minus half the tag, rad.
    let room = (0.5 * config.tag.height_px / lens.focal_px[1] - 0.75 / range_m).clamp(0.0, 0.17);
    let (mut found, mut expected) = ([0.0; 2], [0.0; 2]);
    for _ in 0..IMAGES {
        let shot = shot(
            &mut draw,
            &model,
            (range_m, room, config.tag.exposure_s * lens.focal_px[0]),
        );
        let image = renderer.image(&shot).unwrap();
        if let Some(tag) = detector.find(&image).first() {
            let place = |at| {
                let deck = shot.view.to_camera_frame(shot.deck.position);
                (shot.view.camera_from_world * shot.deck.attitude).0 * at + deck
            };
            let off = tag.corners.iter().zip(corners(1.0));
            let off = off.map(|(px, at)| (px - lens.project(&place(at)).unwrap()).norm_squared());
            found = [found[0] + 1.0, found[1] + off.sum::<f64>() / 8.0];
        }
        if let Some(tag) = model.image_of(&shot.view, &shot.deck, &tags[0]) {
            expected = [
                expected[0] + tag.chance,
                expected[1] + tag.chance * tag.sd_px.powi(2),
            ];
        }
    }
    let [images, model] =
        [found, expected].map(|[n, square]| [n / IMAGES as f64, (square / n.max(1e-9)).sqrt()]);
    Row { images, model }
}

/// Camera at `range_m` with a random roll, its axis up to `room` rad off the tag. It turns by half a pixel
/// during the exposure; `exposure_px` is the exposure in seconds times the focal length.
fn shot(
    draw: &mut Noise,
    model: &SimulatedTagDetector,
    (range_m, room, exposure_px): (f64, f64, f64),
) -> Shot {
    let mut within = |end: f64| end * (2.0 * draw.uniform() - 1.0);
    let turn = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
    let level = |about: f64| Vector3::new(about.cos(), about.sin(), 0.0);
    let tilted = turn(level(within(3.1)), within(0.2)) * turn(Vector3::z(), within(3.1));
    let deck = RigidState::<Deck> {
        position: Point::new(0.0, 0.0, -1.3),
        attitude: Rotation::from(tilted),
        ..Default::default()
    };
    // Direction from the tag to the camera.
    let away = tilted * turn(level(within(3.1)), 20_f64.to_radians()) * -Vector3::z();
    let side = (-away).cross(&Vector3::new(0.3, 0.9, 0.1)).normalize();
    let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[side, -away.cross(&side), -away]));
    let off = turn(Vector3::new(within(room), within(room), 0.0), 1.0) * turn(Vector3::z(), within(3.1));
    let t = Time::from_nanos((300.0 + within(300.0)) as i64 * 1_000_000_000);
    let view = CameraMotion {
        centre: Point::from(deck.position.0 + away * range_m),
        velocity: Vector::zero(),
        camera_from_world: Rotation::from(off * UnitQuaternion::from_rotation_matrix(&axes.inverse())),
        rates: Vector::from(level(within(3.1)) * (0.5 / exposure_px)),
    };
    let setting = model.setting(&view, &deck);
    Shot {
        t,
        at: Time::from_nanos(t.nanos()),
        exposure_s: setting.exposure_s,
        gain: setting.gain,
        view,
        deck,
    }
}

#[test]
fn detection_by_night_in_images_and_model() {
    let printed = |ambient_lux: f64, max_gain: f64| NightConfig {
        ambient_lux,
        max_gain,
        ..NightConfig::default()
    };
    let lit = |tags_cdpm2: f64, lamp_cd: f64| NightConfig {
        ambient_lux: 0.01,
        tags_cdpm2,
        lamp_cd,
        ..NightConfig::default()
    };
    // Floodlit deck; 24 dB, limited by light; 36 dB, limited by noise; faint, normal and dazzling lit tags; a lamp.
    let conditions = [
        (printed(200.0, 16.0), 4.0),
        (printed(40.0, 16.0), 12.0),
        (printed(10.0, 16.0), 4.0),
        (printed(10.0, 64.0), 12.0),
        (printed(2.5, 256.0), 4.0),
        (lit(3.0, 0.0), 4.0),
        (lit(12.0, 0.0), 12.0),
        (lit(100.0, 1e4), 8.0),
        (lit(1000.0, 0.0), 20.0),
    ];
    for (night, range_m) in conditions {
        let Row { images, model } = row(night, range_m);
        let ratio = model[1] / images[1];
        let (images, model) = (images[0], model[0]);
        assert!(
            (images - model).abs() < 0.2,
            "{images} of the images, {model}: {night:?}"
        );
        // The comparison needs more than a few detections.
        assert!(
            images < 0.5 || (0.5..2.0).contains(&ratio),
            "corners {ratio}: {night:?}"
        );
    }
}
