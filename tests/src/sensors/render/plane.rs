use alight_shared::frames::Deck;
use nalgebra::{Rotation3, Vector3};

use super::super::camera::CameraMotion;
use crate::physics::body::RigidState;

pub(super) struct DeckInCamera {
    /// Centre, m, and axes of the deck in camera coordinates.
    pub(super) at: Vector3<f64>,
    pub(super) axes: Rotation3<f64>,
    /// Velocity of the centre, m/s, and rate of turn, rad/s, in camera coordinates.
    pub(super) drift: Vector3<f64>,
    pub(super) turn: Vector3<f64>,
}

impl DeckInCamera {
    pub(super) fn new(view: &CameraMotion, deck: &RigidState<Deck>) -> DeckInCamera {
        let at = view.to_camera_frame(deck.position);
        let axes = view.camera_from_world * deck.attitude;
        DeckInCamera {
            at,
            drift: view.drift(at, deck.velocity),
            turn: (axes * deck.rates).0 - view.rates.0,
            axes: axes.0.to_rotation_matrix(),
        }
    }
    /// Position at which a ray meets the plane, m; None if it misses.
    pub(super) fn meet(&self, [u, v]: [f32; 2]) -> Option<Vector3<f64>> {
        let (ray, normal) = (
            Vector3::new(f64::from(u), f64::from(v), 1.0),
            self.axes.matrix().column(2),
        );
        let depth = normal.dot(&self.at) / normal.dot(&ray);
        (depth > 0.0).then(|| ray * depth)
    }
    /// Centre and axes `s` seconds after the middle of the exposure.
    pub(super) fn after(&self, s: f64) -> (Vector3<f64>, Rotation3<f64>) {
        (
            self.at + self.drift * s,
            Rotation3::from_scaled_axis(self.turn * s) * self.axes,
        )
    }
}

/// Homography, by rows, from directions at unit distance to the deck's plane: a ray `d` meets it at `x = (X .
/// d) / (Z . d)`, `y = (Y . d) / (Z . d)` if `Z . d > 0`.
#[derive(Clone, Copy)]
pub(super) struct ToDeck {
    x: [f32; 3],
    y: [f32; 3],
    z: [f32; 3],
}

impl ToDeck {
    /// None if the camera is not above the deck.
    pub(super) fn new(at: &Vector3<f64>, axes: &Rotation3<f64>) -> Option<ToDeck> {
        let m = axes.matrix();
        let [a, b, c] = [0, 1, 2].map(|k| m.column(k).into_owned());
        let height = c.dot(at);
        let row = |v: Vector3<f64>| [v.x as f32, v.y as f32, v.z as f32];
        (height > 1e-3).then(|| ToDeck {
            x: row(a * height - c * a.dot(at)),
            y: row(b * height - c * b.dot(at)),
            z: row(c),
        })
    }
    pub(super) fn meet(&self, u: f32, v: f32) -> Option<[f32; 2]> {
        let dot = |r: &[f32; 3]| r[0] * u + r[1] * v + r[2];
        let z = dot(&self.z);
        (z > 1e-4).then(|| [dot(&self.x) / z, dot(&self.y) / z])
    }
}
