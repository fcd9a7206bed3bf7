//! Occlusion of the tags by the drone's legs and by its shadow.

use alight_shared::{
    frames::{TrueNed, Vector},
    geometry::DroneGeometry,
};
use nalgebra::{Vector2, Vector3};

use super::camera::{CameraMotion, CameraMount};

/// Radius of a leg, m. Chosen: carbon tube of 16 mm with its clamps.
const LEG_RADIUS_M: f64 = 0.01;
/// Radius of the parts that cast a shadow (plates, battery, roots of the rotor arms), in rotor arm lengths.
/// Spinning rotors transmit nine tenths of the light. Chosen: as on a Tarot T650.
const BODY: f64 = 0.4;
/// Number of points along a leg; their spacing is smaller than its radius.
const POINTS: usize = 60;

#[derive(Clone, Debug)]
pub struct Occlusion {
    /// Points along the legs in front of the camera, at unit distance: image coordinates, and radius.
    pub(super) legs: Vec<(Vector2<f64>, f64)>,
    body: Vector3<f64>,
    radius_m: f64,
    sun: Vector<TrueNed>,
}

/// Shaded region: a cylinder along the sun's direction.
pub(super) struct Shadow {
    body: Vector3<f64>,
    radius_m: f64,
    sun: Vector3<f64>,
}

impl Shadow {
    pub(super) fn covers(&self, point: Vector3<f64>) -> bool {
        let to_body = self.body - point;
        let along = to_body.dot(&self.sun);
        along > 0.0 && to_body.norm_squared() - along * along < self.radius_m * self.radius_m
    }
}

impl Occlusion {
    pub fn new(drone: &DroneGeometry, mount: &CameraMount, sun: Vector<TrueNed>) -> Occlusion {
        let to_camera = |p: Vector3<f64>| mount.attitude.inverse().0 * (p - mount.position);
        let [x, y] = drone.feet_span_m.map(|span| 0.5 * span);
        let along = |k: usize| k as f64 / (POINTS - 1) as f64;
        let legs = [[x, y], [x, -y], [-x, y], [-x, -y]]
            .into_iter()
            .flat_map(|[x, y]| {
                let (root, foot) = (
                    Vector3::new(BODY * x, BODY * y, 0.0),
                    Vector3::new(x, y, drone.feet_below_m),
                );
                (0..POINTS).map(move |k| to_camera(root.lerp(&foot, along(k))))
            });
        let image = |p: Vector3<f64>| (p.z > 2.0 * LEG_RADIUS_M).then(|| (p.xy() / p.z, LEG_RADIUS_M / p.z));
        Occlusion {
            legs: legs.filter_map(image).collect(),
            body: to_camera(Vector3::zeros()),
            radius_m: BODY * drone.arm_m,
            sun,
        }
    }
    pub(super) fn shadow(&self, view: &CameraMotion) -> Shadow {
        Shadow {
            body: self.body,
            radius_m: self.radius_m,
            sun: (view.camera_from_world * self.sun).0,
        }
    }
    /// Whether a leg crosses a convex quadrilateral at unit distance, whose corners are clockwise as in [`super::tag`].
    pub(super) fn covers(&self, quad: &[Vector2<f64>; 4]) -> bool {
        self.legs.iter().any(|(at, radius)| {
            (0..4).all(|k| {
                let side = quad[(k + 1) % 4] - quad[k];
                side.perp(&(at - quad[k])) >= -radius * side.norm()
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{super::camera::body_from_camera, *};
    use alight_shared::frames::DroneBody;

    use crate::physics::body::RigidState;

    #[test]
    fn tag_behind_a_leg_or_in_the_shadow() {
        let drone = DroneGeometry {
            feet_span_m: [0.2, 0.2],
            ..DroneGeometry::default()
        };
        let mount = CameraMount {
            position: Vector3::from(drone.camera_m),
            attitude: body_from_camera(),
        };
        // The sun is ahead, at an elevation of 45 deg.
        let half = core::f64::consts::FRAC_1_SQRT_2;
        let hidden = Occlusion::new(&drone, &mount, Vector::new(half, 0.0, -half));
        // In the image, the right front foot is 0.1 / 0.22 to the right and up.
        let quad = |x: f64, y: f64| {
            [[-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [1.0, 1.0]]
                .map(|[u, v]| Vector2::new(x + 0.05 * u, y + 0.05 * v))
        };
        assert!(hidden.covers(&quad(0.45, -0.45)));
        assert!(!hidden.covers(&quad(0.0, 0.0)) && !hidden.covers(&quad(0.45, 0.2)));
        // At 1 m above the deck, the shadow is 1 m aft of the drone.
        let view = mount.view(&RigidState::<DroneBody>::default());
        let below = |ahead: f64| view.to_camera_frame(alight_shared::frames::Point::new(ahead, 0.0, 1.0));
        let shadow = hidden.shadow(&view);
        assert!(shadow.covers(below(-1.0)));
        assert!(!shadow.covers(below(0.0)) && !shadow.covers(below(-1.4)));
    }
}
