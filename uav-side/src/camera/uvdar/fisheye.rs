//! Wide equidistant lens with the polynomial of Kannala and Brandt 2006, as in OpenCV's fisheye model.

use alight_shared::config;
use nalgebra::{Vector2, Vector3};

use crate::camera::image::check_image;

const MAX_STEPS: usize = 20;

config! {
    /// Wide lens with its image size.
    ///
    /// Defaults: 180 deg on 640 x 480 px, with an image circle as high as the image.
    #[derive(Copy)]
    pub struct Fisheye {
        /// Width of the image, px.
        pub width_px: u32 = 640;
        /// Height of the image, px.
        pub height_px: u32 = 480;
        /// Scale along the two image axes, px/rad.
        pub focal_px: [f64; 2] = [152.0, 152.0];
        /// Principal point, px.
        pub centre_px: [f64; 2] = [319.5, 239.5];
        /// Coefficients k1 to k4 of the third, fifth, seventh and ninth power of the angle from the axis.
        pub distortion: [f64; 4] = [0.0; 4], in -2.0..=2.0;
        /// Full cone angle of the lens, deg.
        pub cone_deg: f64 = 180.0, in 10.0..=240.0;
    }
    check |this, at| {
        check_image(
            at,
            [this.width_px, this.height_px],
            &this.focal_px,
            &this.centre_px,
        )?;
        let rim = 0.5 * this.cone_deg.to_radians();
        let grows = (0..=100).all(|k| this.distorted_angle(rim * f64::from(k) / 100.0).1 > 0.0);
        at.require(
            grows,
            "distortion",
            format!("{:?}", this.distortion),
            "coefficients for which the image angle increases with the true angle over the whole cone",
        )?;
    }
}

impl Fisheye {
    fn distorted_angle(&self, angle: f64) -> (f64, f64) {
        let [k1, k2, k3, k4] = self.distortion;
        let a2 = angle * angle;
        let value = angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))));
        let slope = 1.0 + a2 * (3.0 * k1 + a2 * (5.0 * k2 + a2 * (7.0 * k3 + a2 * 9.0 * k4)));
        (value, slope)
    }
    /// Pixel of a direction in camera coordinates; None outside the cone.
    pub fn project(&self, p: &Vector3<f64>) -> Option<Vector2<f64>> {
        let across = p.xy().norm();
        let angle = across.atan2(p.z);
        if !(angle <= 0.5 * self.cone_deg.to_radians()) {
            return None;
        }
        let scale = if across > 1e-12 {
            self.distorted_angle(angle).0 / across
        } else {
            0.0
        };
        let px =
            (p.xy() * scale).component_mul(&Vector2::from(self.focal_px)) + Vector2::from(self.centre_px);
        Some(px)
    }
    /// Direction of a pixel as a unit vector; None outside the cone.
    pub fn direction(&self, px: Vector2<f64>) -> Option<Vector3<f64>> {
        let at = (px - Vector2::from(self.centre_px)).component_div(&Vector2::from(self.focal_px));
        let goal = at.norm();
        let rim = 0.5 * self.cone_deg.to_radians();
        let mut angle = goal.min(rim);
        for _ in 0..MAX_STEPS {
            let (value, slope) = self.distorted_angle(angle);
            let step = (goal - value) / slope;
            if !step.is_finite() {
                return None;
            }
            angle = (angle + step).clamp(0.0, 4.0);
            if step.abs() < 1e-12 {
                break;
            }
        }
        if !(angle <= rim) || (self.distorted_angle(angle).0 - goal).abs() > 1e-9 {
            return None;
        }
        let (sin, cos) = angle.sin_cos();
        let across = if goal > 1e-12 {
            at * (sin / goal)
        } else {
            Vector2::zeros()
        };
        Some(across.push(cos))
    }
    pub fn pixel_rad(&self) -> f64 {
        2.0 / (self.focal_px[0] + self.focal_px[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn fisheye_direction_round_trip(u in 100.0..540.0_f64, v in 20.0..460.0_f64) {
            for distortion in [[0.0; 4], [-0.02, 0.003, 0.0, 0.0]] {
                let lens = Fisheye { distortion, ..Fisheye::default() };
                if let Some(d) = lens.direction(Vector2::new(u, v)) {
                    prop_assert!((d.norm() - 1.0).abs() < 1e-9);
                    let px = lens.project(&(d * 7.0)).unwrap();
                    prop_assert!((px - Vector2::new(u, v)).norm() < 1e-6, "{px}");
                }
            }
        }
        #[test]
        fn fisheye_arbitrary_input(u in -1e6..1e6_f64, v in -1e6..1e6_f64, k in prop::array::uniform4(-2.0..2.0_f64)) {
            let lens = Fisheye { distortion: k, ..Fisheye::default() };
            let _direction = lens.direction(Vector2::new(u, v));
            let _none = lens.direction(Vector2::new(f64::NAN, v));
        }
    }
}
