//! Tests of the drone camera's pose solver, which the measurement model also uses, with simulated corner noise.

pub use alight_uav::camera::square_pose::{DeckPose, DetectedTag, corners, corners_of, solve};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{physics::streams::Streams, sensors::noise::Noise};
    use alight_shared::tags::DeckTag;
    use nalgebra::{UnitQuaternion, Vector2, Vector3, Vector6};
    use proptest::prelude::*;

    /// Pose from one tag with the side `side_m`.
    fn solve(side_m: f64, image: &[Vector2<f64>; 4], sd: f64) -> Option<DeckPose> {
        let tag = DeckTag {
            side_m,
            ..DeckTag::default()
        };
        super::solve(&[DetectedTag {
            tag,
            image: *image,
            sd,
        }])
    }
    fn image(side: f64, t: Vector3<f64>, q: UnitQuaternion<f64>) -> [Vector2<f64>; 4] {
        corners(side).map(|c| {
            let p = q * c + t;
            p.xy() / p.z
        })
    }

    proptest! {
        #[test]
        fn square_pose_without_noise(
            x in -0.5..0.5_f64, y in -0.5..0.5_f64, z in 0.7..15.0_f64,
            tilt in 0.0..1.1_f64, about in -3.1..3.1_f64, yaw in -3.1..3.1_f64,
        ) {
            let t = Vector3::new(x * z, y * z, z);
            let tilt = UnitQuaternion::from_scaled_axis(Vector3::new(about.cos(), about.sin(), 0.0) * tilt);
            let q = tilt * UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
            // The upper face must be turned to the camera, with a margin.
            prop_assume!((q * Vector3::z()).dot(&t.normalize()) > 0.3);
            let s = solve(1.0, &image(1.0, t, q), 1.0 / 320.0).unwrap();
            prop_assert!((s.position - t).norm() < 1e-6, "{} {}", s.position, t);
            prop_assert!(s.attitude.angle_to(&q) < 1e-6);
        }

        #[test]
        fn square_pose_of_any_image(c in proptest::array::uniform8(prop_oneof![
            -2.0..2.0_f64, Just(0.0), Just(f64::NAN), Just(f64::INFINITY), -1e300..1e300_f64,
        ])) {
            let image = [0, 2, 4, 6].map(|i| Vector2::new(c[i], c[i + 1]));
            if let Some(s) = solve(1.0, &image, 1.0 / 320.0) {
                prop_assert!(s.position.iter().chain(s.variance.iter()).all(|v| v.is_finite()));
                prop_assert!(s.attitude.coords.iter().all(|v| v.is_finite()));
                prop_assert!(s.variance.iter().all(|v| *v >= 0.0));
            }
        }
    }

    #[test]
    fn square_pose_variance() {
        let sd = 1.0 / 320.0;
        for (t, q) in [
            (
                Vector3::new(0.1, -0.2, 1.2),
                UnitQuaternion::from_euler_angles(0.1, -0.05, 0.3),
            ),
            (
                Vector3::new(0.3, 0.2, 2.5),
                UnitQuaternion::from_euler_angles(-0.2, 0.3, 1.5),
            ),
            (
                Vector3::new(-1.0, 0.5, 5.0),
                UnitQuaternion::from_euler_angles(0.15, 0.05, -1.0),
            ),
            (
                Vector3::new(0.0, 0.5, 7.0),
                UnitQuaternion::from_euler_angles(0.05, 0.1, 0.0),
            ),
            // Cases in which the solver often chooses the wrong tilt.
            (
                Vector3::new(0.0, 0.0, 10.0),
                UnitQuaternion::from_euler_angles(0.4, 0.0, 0.0),
            ),
        ] {
            let exact = image(1.0, t, q);
            let mut noise = Noise::new(&Streams::new(3), "test");
            let (mut square, mut stated, n) = (Vector6::zeros(), Vector6::zeros(), 2000);
            for _ in 0..n {
                let measured = exact.map(|p| p + Vector2::new(noise.normal(), noise.normal()) * sd);
                let s = solve(1.0, &measured, sd).unwrap();
                let (dt, dr) = (s.position - t, (s.attitude * q.inverse()).scaled_axis());
                let e = Vector6::new(dt.x, dt.y, dt.z, dr.x, dr.y, dr.z);
                square += e.component_mul(&e) / f64::from(n);
                stated += s.variance / f64::from(n);
            }
            for i in 0..6 {
                let ratio = (stated[i] / square[i]).sqrt();
                assert!(
                    (0.5..2.0).contains(&ratio),
                    "component {i} at {t}: {ratio} {stated} {square}"
                );
            }
        }
    }

    #[test]
    fn square_pose_wrong_tilt_by_distance() {
        let flips = |z: f64| {
            let q = UnitQuaternion::from_euler_angles(0.35, 0.0, 0.0);
            let exact = image(1.0, Vector3::new(0.0, 0.0, z), q);
            let mut noise = Noise::new(&Streams::new(5), "test");
            (0..500)
                .filter(|_| {
                    let measured = exact.map(|p| p + Vector2::new(noise.normal(), noise.normal()) / 320.0);
                    solve(1.0, &measured, 1.0 / 320.0).is_some_and(|s| s.attitude.euler_angles().0 < -0.1)
                })
                .count()
        };
        assert_eq!(flips(1.5), 0);
        let far = flips(12.0);
        assert!((50..300).contains(&far), "{far}");
    }

    #[test]
    fn square_pose_distance_bias() {
        let mean_error = |z: f64| {
            let t = Vector3::new(0.1 * z, -0.05 * z, z);
            let exact = image(1.0, t, UnitQuaternion::from_euler_angles(0.1, 0.0, 0.4));
            let mut noise = Noise::new(&Streams::new(8), "test");
            let n = 2000;
            let sum: f64 = (0..n)
                .map(|_| exact.map(|p| p + Vector2::new(noise.normal(), noise.normal()) / 320.0))
                .filter_map(|measured| solve(1.0, &measured, 1.0 / 320.0))
                .map(|s| s.position.z - z)
                .sum();
            sum / f64::from(n)
        };
        assert!(mean_error(1.5).abs() < 0.001);
        assert!(mean_error(3.0).abs() < 0.01);
        let far = mean_error(7.0);
        assert!((-0.15..-0.08).contains(&far), "{far}");
    }
}
