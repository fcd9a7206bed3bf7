//! Pinhole camera with radial and tangential distortion (Brown 1966; k1 k2 p1 p2 k3 of OpenCV, `plumb_bob` of ROS).
//!
//! Camera axes: x right and y down in the image, z along the optical axis. The centre of the first pixel is (0, 0).

use alight_shared::config;
use nalgebra::{Matrix2, Vector2, Vector3};

use super::image::check_image;

const MAX_STEPS: usize = 20;
/// Step below which Newton's method has converged, at unit distance.
const CONVERGED: f64 = 1e-9;
/// Maximum difference between the directions of a point and of its pixel if the polynomial does not fold, at unit
/// distance.
const FOLDED: f64 = 1e-3;
/// Maximum distance from the axis in the search, at unit distance: 81 deg.
const MAX_RADIUS: f64 = 6.5;

config! {
    /// Pinhole lens with its image size.
    ///
    /// Defaults: 640 x 480 over 90 deg, the camera of the simulated drone.
    #[derive(Copy)]
    pub struct Lens {
        /// Width of the image, px.
        pub width_px: u32 = 640;
        /// Height of the image, px.
        pub height_px: u32 = 480;
        /// Focal lengths fx and fy, px.
        pub focal_px: [f64; 2] = [320.0, 320.0];
        /// Principal point cx and cy, px.
        pub centre_px: [f64; 2] = [319.5, 239.5];
        /// Distortion k1, k2, p1, p2, k3.
        /// Source: ROS's model plumb_bob. The 8 numbers of rational_polynomial are not supported.
        pub distortion: [f64; 5] = [0.0; 5], in -20.0..=20.0;
    }
    check |this, at| {
        check_image(
            at,
            [this.width_px, this.height_px],
            &this.focal_px,
            &this.centre_px,
        )?;
        let corners = [0.0, 1.0].map(|x| {
            [0.0, 1.0].map(|y| {
                let size = Vector2::new(f64::from(this.width_px), f64::from(this.height_px));
                this.normalised(Vector2::new(x, y).component_mul(&size)).is_some()
            })
        });
        at.require(
            corners.as_flattened().iter().all(|has| *has),
            "distortion",
            format!("{:?}", this.distortion),
            "numbers that give every corner of the image a direction (k1 k2 p1 p2 k3 of a calibration of \
             this size)",
        )?;
    }
}

impl Lens {
    /// Distorted position of a point at unit distance, and its derivative.
    fn distorted(&self, n: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let (x, y) = (n.x, n.y);
        let r2 = n.norm_squared();
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        // d radial / d r2.
        let slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let moved = n * radial
            + Vector2::new(
                2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            );
        let cross = 2.0 * x * y * slope + 2.0 * (p1 * x + p2 * y);
        let derivative = Matrix2::new(
            radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        (moved, derivative)
    }
    fn at_unit(&self, px: Vector2<f64>) -> Vector2<f64> {
        (px - Vector2::from(self.centre_px)).component_div(&Vector2::from(self.focal_px))
    }
    /// Pixel of a point in camera coordinates; None behind the camera.
    pub fn project(&self, p: &Vector3<f64>) -> Option<Vector2<f64>> {
        (p.z > 1e-3).then(|| {
            let (moved, _) = self.distorted(p.xy() / p.z);
            moved.component_mul(&Vector2::from(self.focal_px)) + Vector2::from(self.centre_px)
        })
    }
    /// Projects a point only within the field of view; outside it the distortion polynomial folds back.
    pub fn project_inside(&self, p: &Vector3<f64>) -> Option<Vector2<f64>> {
        let px = self.project(p)?;
        let back = self.normalised(px)?;
        ((back - p.xy() / p.z).norm() < FOLDED).then_some(px)
    }
    /// Direction of a pixel, at unit distance, by Newton's method. None where the polynomial folds the image.
    pub fn normalised(&self, px: Vector2<f64>) -> Option<Vector2<f64>> {
        let goal = self.at_unit(px);
        let mut n = goal;
        for _ in 0..MAX_STEPS {
            let (moved, derivative) = self.distorted(n);
            if !(derivative.determinant() > 0.0) {
                return None;
            }
            let step = derivative.try_inverse()? * (goal - moved);
            // A long step might cross the fold.
            n += step * (0.5 / step.norm()).min(1.0);
            if !(n.norm() < MAX_RADIUS) {
                return None;
            }
            if step.norm() < CONVERGED {
                return Some(n);
            }
        }
        None
    }
    /// Size of a pixel at unit distance, RMS over all directions.
    pub fn pixel_size(&self, n: Vector2<f64>) -> Option<f64> {
        let (_, derivative) = self.distorted(n);
        let to_px = Matrix2::from_diagonal(&Vector2::from(self.focal_px)) * derivative;
        let size = to_px.try_inverse()?.norm() * core::f64::consts::FRAC_1_SQRT_2;
        size.is_finite().then_some(size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::config::{Check, Keys};
    use proptest::prelude::*;

    fn wide() -> Lens {
        Lens {
            focal_px: [330.0, 326.0],
            centre_px: [312.0, 247.0],
            distortion: [-0.11, 0.02, 0.001, -0.0007, -0.001],
            ..Lens::default()
        }
    }

    proptest! {
        #[test]
        fn pixel_direction_round_trip(u in 0.0..640.0_f64, v in 0.0..480.0_f64, z in 0.1..50.0_f64) {
            for lens in [Lens::default(), wide()] {
                let n = lens.normalised(Vector2::new(u, v)).unwrap();
                let px = lens.project(&Vector3::new(n.x * z, n.y * z, z)).unwrap();
                prop_assert!((px - Vector2::new(u, v)).norm() < 1e-5, "{px}");
            }
        }
        #[test]
        fn lens_inversion_with_any_distortion(
            d in prop::array::uniform5(-20.0..20.0_f64), u in -1e4..1e4_f64, v in -1e4..1e4_f64,
        ) {
            let lens = Lens { distortion: d, ..Lens::default() };
            if let Some(n) = lens.normalised(Vector2::new(u, v)) {
                let px = lens.project(&n.push(1.0)).unwrap();
                prop_assert!((px - Vector2::new(u, v)).norm() < 1e-3, "{n} {px}");
            }
        }
    }

    #[test]
    fn lens_pixel_size_against_the_direction() {
        let lens = wide();
        let at = Vector2::new(600.0, 30.0);
        let n = |du, dv| lens.normalised(at + Vector2::new(du, dv)).unwrap();
        let (u, v) = (n(0.5, 0.0) - n(-0.5, 0.0), n(0.0, 0.5) - n(0.0, -0.5));
        let expected = ((u.norm_squared() + v.norm_squared()) / 2.0).sqrt();
        let size = lens.pixel_size(n(0.0, 0.0)).unwrap();
        assert!((size / expected - 1.0).abs() < 1e-4, "{size} {expected}");
    }

    #[test]
    fn calibration_of_another_model_or_image_size() {
        let error = |text: &str| {
            alight_shared::config::parse::<Lens>(text, "lens")
                .unwrap_err()
                .to_string()
        };
        let rational = error("distortion = [4.65, 1.34, 0.001, 0.002, -0.03, 4.71, 1.92, 0.11]");
        for part in [
            "`distortion` is a list of 8",
            "a list of 5",
            "rational_polynomial",
        ] {
            assert!(rational.contains(part), "{rational}");
        }
        let large = error("centre_px = [960.2, 540.1]");
        for part in ["`centre_px` is [960.2, 540.1]", "640 x 480 px"] {
            assert!(large.contains(part), "{large}");
        }
        assert!(error("centre_px = [320.0, nan]").contains("NaN"));
        assert!(error("height_px = 200").contains("640 x 200 px"));
    }

    #[test]
    fn lens_with_a_folding_distortion() {
        let lens = Lens {
            distortion: [-0.9, 0.0, 0.0, 0.0, 0.0],
            ..Lens::default()
        };
        let e = lens.check(&Keys::ROOT).unwrap_err().to_string();
        assert!(e.contains("distortion"), "{e}");
        assert!(wide().check(&Keys::ROOT).is_ok());
    }
}
