//! Shapes of vessel, deck, drone and water as a `foxglove.SceneUpdate`.

use alight_shared::geometry::{DeckGeometry, DroneGeometry};
use foxglove::messages::{
    Color, CubePrimitive, CylinderPrimitive, SceneEntity, SceneUpdate, SpherePrimitive, Timestamp,
};
use nalgebra::UnitQuaternion;

use crate::record::geometry::{frame, pose, vector};

fn color(r: f64, g: f64, b: f64, a: f64) -> Option<Color> {
    Some(Color { r, g, b, a })
}
fn cube(centre: [f64; 3], size: [f64; 3], color: Option<Color>) -> CubePrimitive {
    CubePrimitive {
        pose: Some(pose(centre, &UnitQuaternion::identity())),
        size: Some(vector(size)),
        color,
    }
}

pub fn scene(timestamp: Timestamp, deck: &DeckGeometry, airframe: &DroneGeometry) -> SceneUpdate {
    let entity = |frame: &str, id: &str| SceneEntity {
        timestamp: Some(timestamp),
        frame_id: frame.into(),
        id: id.into(),
        frame_locked: true,
        ..SceneEntity::default()
    };
    let vessel = SceneEntity {
        cubes: hulls(deck),
        ..entity(frame::VESSEL, "vessel")
    };
    let platform = SceneEntity {
        cubes: deck_cubes(deck),
        ..entity(frame::DECK, "deck")
    };
    let drone = SceneEntity {
        cubes: vec![cube([0.0; 3], [0.3, 0.2, 0.1], color(0.2, 0.2, 0.2, 1.0))],
        cylinders: rotors(airframe),
        spheres: feet(airframe),
        ..entity(frame::DRONE, "drone")
    };
    let water = SceneEntity {
        cubes: vec![cube([0.0; 3], [200.0, 200.0, 0.02], color(0.1, 0.35, 0.6, 0.35))],
        ..entity(frame::CHASE, "water")
    };
    SceneUpdate {
        deletions: Vec::new(),
        entities: vec![vessel, platform, drone, water],
    }
}

/// Two hulls under the deck, for display only.
fn hulls(deck: &DeckGeometry) -> Vec<CubePrimitive> {
    let length = 1.9 * deck.length_m;
    let side = 0.7 * deck.width_m;
    let grey = color(0.75, 0.77, 0.8, 1.0);
    vec![
        cube([0.0, -side, 0.0], [length, 0.4, 0.5], grey),
        cube([0.0, side, 0.0], [length, 0.4, 0.5], grey),
        cube(
            [deck.centre_m[0], 0.0, 0.5 * deck.centre_m[2]],
            [0.1, 2.0 * side, -deck.centre_m[2]],
            grey,
        ),
    ]
}
fn deck_cubes(deck: &DeckGeometry) -> Vec<CubePrimitive> {
    let thickness = 0.06;
    let platform = cube(
        [0.0, 0.0, 0.5 * thickness],
        [deck.length_m, deck.width_m, thickness],
        color(0.85, 0.55, 0.2, 1.0),
    );
    let tags = deck.tags();
    let tags = tags.iter().flat_map(|tag| {
        let side = tag.side_m;
        let [x, y, z] = tag.centre_m;
        [
            cube(
                [x, y, z - 0.005],
                [side, side, 0.01],
                color(0.05, 0.05, 0.05, 1.0),
            ),
            cube(
                [x + 0.25 * side, y, z - 0.01],
                [0.3 * side, 0.1 * side, 0.01],
                color(1.0, 1.0, 1.0, 1.0),
            ),
        ]
    });
    [platform].into_iter().chain(tags).collect()
}
fn rotors(drone: &DroneGeometry) -> Vec<CylinderPrimitive> {
    let at = drone.arm_m / core::f64::consts::SQRT_2;
    [[at, at], [at, -at], [-at, at], [-at, -at]]
        .map(|[x, y]| CylinderPrimitive {
            pose: Some(pose([x, y, -0.06], &UnitQuaternion::identity())),
            size: Some(vector([0.36, 0.36, 0.02])),
            bottom_scale: 1.0,
            top_scale: 1.0,
            color: if x > 0.0 {
                color(0.85, 0.15, 0.1, 0.8)
            } else {
                color(0.2, 0.2, 0.25, 0.8)
            },
        })
        .into()
}
fn feet(drone: &DroneGeometry) -> Vec<SpherePrimitive> {
    let [x, y] = drone.feet_span_m.map(|s| 0.5 * s);
    [[x, y], [x, -y], [-x, y], [-x, -y]]
        .map(|[x, y]| SpherePrimitive {
            pose: Some(pose(
                [x, y, drone.feet_below_m - 0.02],
                &UnitQuaternion::identity(),
            )),
            size: Some(vector([0.04; 3])),
            color: color(0.9, 0.8, 0.1, 1.0),
        })
        .into()
}
