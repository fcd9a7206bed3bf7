//! Detection by the camera node in rendered images.

use alight_shared::{
    frames::{Camera, DroneBody, Point, Rotation},
    msg::TagPose,
};
use alight_uav::camera::{CameraNode, CameraSettings, node::CameraIdentity};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::*;
use crate::sensors::camera::{CameraMount, body_from_camera};

fn shot(view: &CameraMotion, deck: &RigidState<Deck>, exposure_s: f64) -> Shot {
    Shot {
        t: Time::EPOCH,
        at: Time::EPOCH,
        exposure_s,
        gain: 1.0,
        view: *view,
        deck: *deck,
    }
}

const NAMES: CameraIdentity = CameraIdentity {
    vessel: 1,
    drone: 1,
    boot: 1,
};

fn distorted() -> Lens {
    Lens {
        focal_px: [330.0, 326.0],
        centre_px: [312.0, 247.0],
        distortion: [-0.11, 0.02, 0.001, -0.0007, -0.001],
        ..Lens::default()
    }
}

/// Camera `up` m above and `aside` m north of the origin, on a drone with these Euler angles.
fn view(up: f64, aside: f64, euler: [f64; 3], rates: [f64; 3]) -> CameraMotion {
    let mount = CameraMount {
        position: Vector3::zeros(),
        attitude: body_from_camera(),
    };
    mount.view(&RigidState::<DroneBody> {
        position: Point::new(aside, 0.0, -up),
        attitude: Rotation::from_euler(euler[0], euler[1], euler[2]),
        rates: Vector::from(Vector3::from(rates)),
        ..Default::default()
    })
}

fn deck(euler: [f64; 3]) -> RigidState<Deck> {
    RigidState {
        attitude: Rotation::from_euler(euler[0], euler[1], euler[2]),
        ..Default::default()
    }
}

fn one_tag() -> DeckGeometry {
    DeckGeometry {
        tag_side_m: Some(1.0),
        ..DeckGeometry::default()
    }
}

struct Setup {
    renderer: Renderer,
    node: CameraNode,
}

fn setup(change: impl FnOnce(&mut RenderConfig)) -> Setup {
    let mut config = RenderConfig::default();
    change(&mut config);
    let settings = CameraSettings {
        lens: config.lens,
        ..CameraSettings::default()
    };
    Setup {
        renderer: Renderer::new(&config, &one_tag(), &Streams::new(1)),
        node: CameraNode::new(&settings, &one_tag().tags(), NAMES),
    }
}

/// Position error, m, and attitude error, rad.
fn errors(pose: &TagPose, view: &CameraMotion, deck: &RigidState<Deck>) -> (f64, f64) {
    let [w, x, y, z] = pose.attitude;
    let detected = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    let truth: Rotation<Camera, Deck> = view.camera_from_world * deck.attitude;
    let at = view.to_camera_frame(deck.position);
    (
        (Vector3::from(pose.position) - at).norm(),
        detected.angle_to(&truth.0),
    )
}

#[test]
fn rendered_deck_through_any_lens() {
    for lens in [Lens::default(), distorted()] {
        let mut setup = setup(|c| c.lens = lens);
        for (up, aside, drone, level) in [
            (1.6, 0.05, [0.02, -0.03, 0.0], [0.05, 0.08, 0.4]),
            (3.0, 0.5, [0.05, 0.02, 1.0], [-0.15, 0.1, -2.0]),
            (7.0, -1.0, [-0.03, 0.04, -2.0], [0.1, 0.2, 0.7]),
        ] {
            let (view, deck) = (view(up, aside, drone, [0.0; 3]), deck(level));
            let image = setup
                .renderer
                .image(&shot(&view, &deck, 0.004))
                .expect("an image");
            let pose = setup.node.detect(&image).expect("detected");
            let (moved, turned) = errors(&pose, &view, &deck);
            assert!(moved < 0.01 * up, "{moved} m at {up} m");
            assert!(turned < 0.012 * up, "{turned} rad at {up} m");
        }
    }
}

#[test]
fn rendered_deck_with_a_turned_mount() {
    let mut config = RenderConfig::default();
    config.lens.centre_px = [300.0, 250.0];
    let mount_rotation_deg = [4.0, -6.0, 90.0];
    let settings = CameraSettings {
        lens: config.lens,
        mount_rotation_deg,
        ..CameraSettings::default()
    };
    let mount = CameraMount {
        position: Vector3::zeros(),
        attitude: body_from_camera() * settings.mount(),
    };
    let drone = RigidState::<DroneBody> {
        position: Point::new(0.2, 0.1, -3.0),
        ..Default::default()
    };
    let designed = view(3.0, 0.2, [0.0; 3], [0.0; 3]);
    let deck = deck([0.1, -0.05, 0.3]);
    let mut renderer = Renderer::new(&config, &one_tag(), &Streams::new(1));
    let image = renderer
        .image(&shot(&mount.view(&drone), &deck, 0.004))
        .expect("an image");
    let pose = CameraNode::new(&settings, &one_tag().tags(), NAMES)
        .detect(&image)
        .expect("detected");
    let shifted = CameraMotion {
        centre: drone.position,
        ..designed
    };
    let (moved, turned) = errors(&pose, &shifted, &deck);
    assert!(moved < 0.02 && turned < 0.02, "{moved} {turned}");
}

#[test]
fn rendered_motion_blur() {
    let mut setup = setup(|c| c.dark_sd = 0.0);
    // 4 ms at 2 rad/s cause 2.6 px of motion.
    let view_of = |rates| view(3.0, 0.0, [0.0; 3], rates);
    let (view, deck) = (view_of([0.0, 2.0, 0.0]), deck([0.0; 3]));
    let image = setup
        .renderer
        .image(&shot(&view, &deck, 0.004))
        .expect("an image");
    let pose = setup.node.detect(&image).expect("detected");
    let (moved, _) = errors(&pose, &view, &deck);
    assert!(moved < 0.01, "{moved}");
    // Motion blur of 9 px in various directions; a common shift of all edges would indicate an error in the renderer.
    let mut moved = Vec::new();
    for k in 0..12 {
        let (sin, cos) = (core::f64::consts::TAU * f64::from(k) / 12.0).sin_cos();
        let turning = view_of([7.0 * cos, 7.0 * sin, 0.0]);
        let image = setup
            .renderer
            .image(&shot(&turning, &deck, 0.004))
            .expect("an image");
        if let Some(pose) = setup.node.detect(&image) {
            moved.push(Vector3::from(pose.position) - turning.to_camera_frame(deck.position));
        }
    }
    // At most one image has a corner that fits no pose. 0.002 m corresponds to a fifth of a pixel.
    assert!(moved.len() >= 11, "{moved:?}");
    let mean = moved.iter().sum::<Vector3<f64>>() / moved.len() as f64;
    assert!(mean.xy().norm() < 0.002, "{mean}");
    let smeared = setup.renderer.image(&shot(&view, &deck, 0.08)).expect("an image");
    assert_eq!(setup.node.detect(&smeared), None, "51 px of smear");
}

#[test]
fn rendered_glare_partial_view_and_open_sea() {
    let mut setup = setup(|c| c.glare = 0.0);
    let level = deck([0.0; 3]);
    for view in [
        view(0.6, 0.0, [0.0; 3], [0.0; 3]),
        view(3.0, 3.0, [0.0; 3], [0.0; 3]),
        view(10.0, 40.0, [0.0; 3], [0.0; 3]),
    ] {
        let image = setup
            .renderer
            .image(&shot(&view, &level, 0.004))
            .expect("an image");
        assert_eq!(setup.node.detect(&image), None);
    }
    // The sun is behind the drone, and the deck mirrors it into the camera.
    let sun = Vector3::new(0.5, 0.0, -0.75_f64.sqrt());
    setup.renderer.sun = Vector::from(sun);
    let from_sun = view_along(&sun);
    setup.renderer.config.glare = 40.0;
    setup.renderer.config.glare_sd_deg = 20.0;
    let image = setup
        .renderer
        .image(&shot(&from_sun, &level, 0.004))
        .expect("an image");
    let shining = image.pixels().iter().filter(|p| **p == 255).count();
    assert!(shining > 3000, "{shining}");
    assert_eq!(setup.node.detect(&image), None);
}

#[test]
fn rendered_tag_metering_in_any_light() {
    use alight_uav::camera::metering::{Metering, Setting, SettingRange};
    let range = |most, step| SettingRange {
        low: step,
        most,
        step,
    };
    for (light, up) in [(2e3, 3.0), (1e5, 10.0), (5e6, 6.0)] {
        let mut setup = setup(|c| c.dark_sd = 0.0);
        let start = Setting {
            exposure_s: 0.004,
            gain: 1.0,
        };
        let mut metering = Metering::new(range(0.004, 1e-5), range(64.0, 1.0), start);
        let (view, deck) = (view(up, 0.0, [0.0; 3], [0.0; 3]), deck([0.0; 3]));
        let found: Vec<bool> = (1..=80)
            .map(|number| {
                let Setting { exposure_s, gain } = metering.setting();
                setup.renderer.config.white = light * exposure_s * gain;
                let image = setup
                    .renderer
                    .image(&shot(&view, &deck, exposure_s))
                    .expect("an image");
                let tag = setup.node.detect(&image).and(setup.node.tag_light());
                metering.step(number, number, &setup.node.light());
                tag.is_some_and(|tag| tag.contrast() > 0.5 && tag.saturation < 0.02)
            })
            .collect();
        assert!(
            found[60..].iter().all(|f| *f),
            "{light}: {:?}",
            metering.setting()
        );
    }
}

/// Camera that looks straight down from a position at which the deck mirrors the sun.
fn view_along(sun: &Vector3<f64>) -> CameraMotion {
    let height = 4.0;
    let away = -sun.xy() / -sun.z * height;
    let mut v = view(height, 0.0, [0.0; 3], [0.0; 3]);
    v.centre = Point::new(away.x, away.y, -height);
    v
}

#[test]
fn rendered_tags_from_contact_to_10_m() {
    let (config, deck_geometry, drone) = (
        RenderConfig::default(),
        DeckGeometry::default(),
        DroneGeometry::default(),
    );
    let mount = CameraMount {
        position: Vector3::from(drone.camera_m),
        attitude: body_from_camera(),
    };
    let mut renderer = Renderer::new(&config, &deck_geometry, &Streams::new(1)).below(&drone, &mount);
    let mut node = CameraNode::new(&CameraSettings::default(), &deck_geometry.tags(), NAMES);
    // Heights are those of the feet above the deck.
    for (up, aside) in [
        (0.0, 0.0),
        (0.0, 0.2),
        (0.3, 0.15),
        (0.8, 0.2),
        (2.0, -0.2),
        (5.0, 0.1),
        (10.0, 0.2),
    ] {
        let at = RigidState::<DroneBody> {
            position: Point::new(aside, -0.5 * aside, -up - drone.feet_below_m),
            attitude: Rotation::from_euler(0.03, -0.04, 0.5),
            ..Default::default()
        };
        let (view, level) = (mount.view(&at), deck([0.0; 3]));
        let image = renderer.image(&shot(&view, &level, 0.004)).expect("an image");
        let pose = node.detect(&image).expect("detected");
        let (moved, turned) = errors(&pose, &view, &level);
        assert!(
            moved < 0.002 + 0.004 * up && turned < 0.01 + 0.002 * up,
            "{moved} m, {turned} rad at {up} m"
        );
    }
}

/// Draws every pixel with its own rays, without uniform blocks.
fn by_pixels(renderer: &Renderer, scene: &Scene) -> Vec<f32> {
    let (deck, _) = scene.deck.as_ref().expect("detected");
    let pixel = |ray| {
        let mut light = scene.sea.light(ray);
        renderer.draw_pixel(&mut light, deck, ray);
        light
    };
    renderer.rays.all.iter().map(pixel).collect()
}

#[test]
fn blocks_of_one_light_and_their_pixels() {
    let (deck_geometry, drone) = (DeckGeometry::default(), DroneGeometry::default());
    let mount = CameraMount {
        position: Vector3::from(drone.camera_m),
        attitude: body_from_camera(),
    };
    for lens in [Lens::default(), distorted()] {
        let config = RenderConfig {
            lens,
            glare: 1.0,
            ..RenderConfig::default()
        };
        let renderer = Renderer::new(&config, &deck_geometry, &Streams::new(1)).below(&drone, &mount);
        let (_, covered) = renderer.drone.as_ref().expect("below a drone");
        for (up, speed) in [(0.0, 0.0), (0.4, 1.0), (2.0, 2.0), (8.0, -1.0)] {
            let at = RigidState::<DroneBody> {
                position: Point::new(0.3, -0.2, -up - drone.feet_below_m),
                attitude: Rotation::from_euler(0.1, -0.2, 0.5),
                velocity: Vector::new(speed, -0.5 * speed, speed),
                rates: Vector::new(speed, 0.3, -0.2),
                ..Default::default()
            };
            let shot = shot(&mount.view(&at), &deck([0.05, 0.1, -0.4]), 0.004);
            let width = config.lens.width_px as usize;
            let mut light = vec![0.0; width * config.lens.height_px as usize];
            let scene = renderer.scene(&shot);
            for (k, light) in light.chunks_mut(width * BLOCK_PX).enumerate() {
                let top = k * BLOCK_PX;
                renderer.draw(&mut Band { light, top, width }, &scene);
            }
            let whole = by_pixels(&renderer, &scene);
            let differ = light.iter().zip(&whole).zip(covered);
            let differ = differ.filter(|((a, b), leg)| !**leg && (**a - **b).abs() > 1e-5);
            assert_eq!(differ.count(), 0, "{up} m, {speed} m/s");
        }
    }
}
