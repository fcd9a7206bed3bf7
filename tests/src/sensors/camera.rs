//! Mount and lens of the belly camera.

use alight_shared::{
    config,
    frames::{Camera, DroneBody, Point, Rotation, TrueNed, Vector},
    geometry::DroneGeometry,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};

use super::noise::Noise;
use crate::physics::{body::RigidState, streams::Streams};

config! {
    /// True mount of the camera relative to the designed mount; nodes do not know the errors.
    #[derive(Copy)]
    pub struct CameraMountConfig {
        /// Rotation (roll, pitch, yaw about the camera's axes) relative to the designed mount, deg. The nodes
        /// know this value.
        pub rotation_deg: [f64; 3] = [0.0; 3], in -180.0..=180.0;
        /// Standard deviation of the rotation error about each camera axis, drawn per seed, deg.
        pub angle_sd_deg: f64 = 1.0, in 0.0..=30.0;
        /// Standard deviation of the position error, per axis, drawn per seed, m.
        pub position_sd_m: f64 = 0.01, in 0.0..=1.0;
    }
}

/// Rotation drone body from camera by design. The camera looks down and the image's upper edge is forward: camera x is
/// body y (right), camera y is body -x (aft), camera z is body z, i.e. a rotation of +90 deg about the common z axis.
pub fn body_from_camera() -> Rotation<DroneBody, Camera> {
    let half = core::f64::consts::FRAC_1_SQRT_2;
    Rotation::from(UnitQuaternion::new_unchecked(Quaternion::new(
        half, 0.0, 0.0, half,
    )))
}

#[derive(Clone, Copy, Debug)]
pub struct CameraMount {
    /// Optical centre in the body frame, m.
    pub position: Vector3<f64>,
    pub attitude: Rotation<DroneBody, Camera>,
}

impl CameraMount {
    /// Designed mount with this seed's errors.
    pub fn new(config: &CameraMountConfig, drone: &DroneGeometry, streams: &Streams) -> Self {
        let mut noise = Noise::new(streams, "drone.camera.mount");
        let turn = noise.normal3() * config.angle_sd_deg.to_radians();
        let [roll, pitch, yaw] = config.rotation_deg.map(f64::to_radians);
        CameraMount {
            position: Vector3::from(drone.camera_m) + noise.normal3() * config.position_sd_m,
            attitude: body_from_camera()
                * Rotation::<Camera, Camera>::from_euler(roll, pitch, yaw)
                * Rotation::<Camera, Camera>::from(UnitQuaternion::from_scaled_axis(turn)),
        }
    }
    pub fn view(&self, drone: &RigidState<DroneBody>) -> CameraMotion {
        let at = drone.at::<DroneBody>(self.position);
        let camera_from_body = self.attitude.inverse();
        CameraMotion {
            centre: at.position,
            velocity: at.velocity,
            camera_from_world: camera_from_body * at.attitude.inverse(),
            rates: camera_from_body * at.rates,
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub struct CameraMotion {
    pub centre: Point<TrueNed>,
    pub velocity: Vector<TrueNed>,
    pub camera_from_world: Rotation<Camera, TrueNed>,
    pub rates: Vector<Camera>,
}

impl CameraMotion {
    pub fn to_camera_frame(&self, point: Point<TrueNed>) -> Vector3<f64> {
        (self.camera_from_world * (point - self.centre)).0
    }
    /// Velocity, in camera coordinates, of a `point` (camera coordinates, m) that moves with `velocity`: `R
    /// (v - v_camera) - w x p`, m/s.
    pub fn drift(&self, point: Vector3<f64>, velocity: Vector<TrueNed>) -> Vector3<f64> {
        (self.camera_from_world * (velocity - self.velocity)).0 - self.rates.0.cross(&point)
    }
}

/// A pinhole lens without distortion, as after rectification.
#[derive(Clone, Copy, Debug)]
pub struct PinholeLens {
    pub size_px: [f64; 2],
    pub focal_px: f64,
}

impl PinholeLens {
    /// `fov_rad` is the horizontal field of view over the image width.
    pub fn new(width_px: f64, height_px: f64, fov_rad: f64) -> Self {
        PinholeLens {
            size_px: [width_px, height_px],
            focal_px: 0.5 * width_px / (0.5 * fov_rad).tan(),
        }
    }
    /// None for points behind the camera.
    pub fn project(&self, p: Vector3<f64>) -> Option<Vector2<f64>> {
        (p.z > 1e-3).then(|| p.xy() * (self.focal_px / p.z) + self.centre())
    }
    pub fn holds(&self, px: Vector2<f64>) -> bool {
        (0.0..=self.size_px[0]).contains(&px.x) && (0.0..=self.size_px[1]).contains(&px.y)
    }
    pub fn normalised(&self, px: Vector2<f64>) -> Vector2<f64> {
        (px - self.centre()) / self.focal_px
    }
    fn centre(&self) -> Vector2<f64> {
        Vector2::new(0.5 * self.size_px[0], 0.5 * self.size_px[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn belly_camera_axes() {
        let r = body_from_camera();
        let to_body = |x, y, z| (r * Vector::<Camera>::new(x, y, z)).0;
        assert!((to_body(1.0, 0.0, 0.0) - Vector3::y()).norm() < 1e-15);
        assert!((to_body(0.0, 1.0, 0.0) + Vector3::x()).norm() < 1e-15);
        assert!((to_body(0.0, 0.0, 1.0) - Vector3::z()).norm() < 1e-15);
        // Ahead is up in the image, and starboard is right.
        let mount = CameraMount {
            position: Vector3::zeros(),
            attitude: r,
        };
        let view = mount.view(&RigidState {
            position: Point::new(0.0, 0.0, -10.0),
            ..Default::default()
        });
        let lens = PinholeLens::new(640.0, 480.0, 90_f64.to_radians());
        let px = lens
            .project(view.to_camera_frame(Point::new(2.0, 1.0, 0.0)))
            .unwrap();
        assert!(
            (px - Vector2::new(320.0 + 32.0, 240.0 - 64.0)).norm() < 1e-9,
            "{px}"
        );
    }

    #[test]
    fn view_drift_against_camera_coordinates() {
        let mount = CameraMount {
            position: Vector3::new(0.05, -0.02, 0.08),
            attitude: body_from_camera() * Rotation::from_euler(0.02, -0.01, 0.03),
        };
        let drone = RigidState::<DroneBody> {
            position: Point::new(1.0, 2.0, -8.0),
            velocity: Vector::new(1.0, -0.5, 0.7),
            attitude: Rotation::from_euler(0.1, -0.2, 0.7),
            rates: Vector::new(0.3, -0.4, 0.2),
            ..Default::default()
        };
        let point = Point::new(0.4, 0.3, -1.0);
        let moves = Vector::new(0.2, 0.1, -0.6);
        let view = mount.view(&drone);
        let h = 1e-5;
        let projected = |s: f64| {
            let turned = drone.attitude
                * Rotation::<DroneBody, DroneBody>::from(UnitQuaternion::from_scaled_axis(drone.rates.0 * s));
            let later = RigidState {
                position: drone.position + drone.velocity * s,
                attitude: turned,
                ..drone
            };
            mount.view(&later).to_camera_frame(point + moves * s)
        };
        let numerical = (projected(h) - projected(-h)) / (2.0 * h);
        let analytical = view.drift(view.to_camera_frame(point), moves);
        assert!((numerical - analytical).norm() < 1e-7, "{numerical} {analytical}");
    }
}
