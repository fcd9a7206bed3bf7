//! Conversion from Alight's frames, NED and FRD, to ROS frames (REP 103): world frames are east, north, up (ENU),
//! body frames forward, left, up (FLU).

use alight_shared::frames::body_rates;
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3};

use crate::ros2::messages::{Covariance, Quaternion, Vector3 as RosVector};

/// Half turn about (1, 1, 0), which swaps north and east and turns down into up.
fn enu_from_ned() -> UnitQuaternion<f64> {
    let half = core::f64::consts::FRAC_1_SQRT_2;
    UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(0.0, half, half, 0.0))
}

/// Half turn about the forward axis.
fn frd_from_flu() -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(0.0, 1.0, 0.0, 0.0))
}

pub fn enu([north, east, down]: [f64; 3]) -> RosVector {
    RosVector {
        x: east,
        y: north,
        z: -down,
    }
}

pub fn flu(v: &Vector3<f64>) -> RosVector {
    RosVector {
        x: v.x,
        y: -v.y,
        z: -v.z,
    }
}

fn quaternion(q: &UnitQuaternion<f64>) -> Quaternion {
    Quaternion {
        x: q.i,
        y: q.j,
        z: q.k,
        w: q.w,
    }
}

/// Rotation from FLU to ENU that corresponds to a rotation from FRD to NED.
pub fn attitude(ned_from_frd: &UnitQuaternion<f64>) -> Quaternion {
    quaternion(&(enu_from_ned() * ned_from_frd * frd_from_flu()))
}

pub fn still() -> Quaternion {
    quaternion(&UnitQuaternion::identity())
}

/// Rotation to FLU from a camera's optical frame (right, down, forward in the image), for a camera that looks down
/// with the top of its image forward.
pub fn of_camera() -> Quaternion {
    let frd_from_camera = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), core::f64::consts::FRAC_PI_2);
    quaternion(&(frd_from_flu().inverse() * frd_from_camera))
}

/// Rotation from FRD to NED for roll, pitch, yaw (ZYX), rad.
pub fn of_euler([roll, pitch, yaw]: [f64; 3]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(roll, pitch, yaw)
}

/// Covariance of a pose in ENU from the standard deviations of position in NED (m) and of roll, pitch, yaw (rad). ROS
/// defines the covariance for rotations about fixed axes by roll, pitch and yaw; only pitch and yaw change their
/// signs.
pub fn pose_covariance([north, east, down]: [f64; 3], euler_sd: [f64; 3]) -> Covariance {
    let mut all = Covariance::default();
    let [roll, pitch, yaw] = euler_sd;
    let sds = [east, north, down, roll, pitch, yaw];
    for (k, (row, sd)) in all.iter_mut().zip(sds).enumerate() {
        if let Some(variance) = row.get_mut(k) {
            *variance = sd * sd;
        }
    }
    all
}

pub struct BodyVelocity {
    /// Velocity in NED, m/s, and standard deviations.
    pub velocity: [[f64; 3]; 2],
    /// Angular rates in FRD, rad/s.
    pub rates: Vector3<f64>,
    /// (rad/s)².
    pub rates_covariance: Matrix3<f64>,
}

impl BodyVelocity {
    /// Angular rates of a body from its Euler-angle rates (rad/s) and their standard deviations.
    pub fn of_euler_rates(velocity: [[f64; 3]; 2], euler: [f64; 3], rates: [[f64; 3]; 2]) -> BodyVelocity {
        let [roll, pitch, _] = euler;
        let [rates, sd] = rates.map(Vector3::from);
        let columns = Matrix3::identity();
        let jacobian = Matrix3::from_columns(&[
            body_rates(roll, pitch, columns.column(0).into_owned()),
            body_rates(roll, pitch, columns.column(1).into_owned()),
            body_rates(roll, pitch, columns.column(2).into_owned()),
        ]);
        BodyVelocity {
            velocity,
            rates: body_rates(roll, pitch, rates),
            rates_covariance: jacobian * squared(&sd) * jacobian.transpose(),
        }
    }
    pub fn twist(&self, ned_from_frd: &UnitQuaternion<f64>) -> [RosVector; 2] {
        let [velocity, _] = self.velocity.map(Vector3::from);
        [flu(&(ned_from_frd.inverse() * velocity)), flu(&self.rates)]
    }
    pub fn covariance(&self, ned_from_frd: &UnitQuaternion<f64>) -> Covariance {
        let flu_from_frd = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let flu_from_ned = flu_from_frd * ned_from_frd.inverse().to_rotation_matrix().matrix();
        let [_, sd] = self.velocity.map(Vector3::from);
        let mut all = Matrix6::zeros();
        let linear = flu_from_ned * squared(&sd) * flu_from_ned.transpose();
        let angular = flu_from_frd * self.rates_covariance * flu_from_frd;
        all.fixed_view_mut::<3, 3>(0, 0).copy_from(&linear);
        all.fixed_view_mut::<3, 3>(3, 3).copy_from(&angular);
        // nalgebra's arrays are column-major; the matrix is symmetric.
        all.into()
    }
}

fn squared(sd: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_diagonal(&sd.component_mul(sd))
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_PI_2;

    fn turned(q: &Quaternion, axis: Vector3<f64>) -> Vector3<f64> {
        UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z)) * axis
    }
    fn is_near(a: Vector3<f64>, b: [f64; 3]) -> bool {
        (a - Vector3::from(b)).norm() < 1e-12
    }
    fn rolled(sds: [f64; 6]) -> Covariance {
        let [a, b, c, d, e, f] = sds;
        pose_covariance([a, b, c], [d, e, f])
    }

    #[test]
    fn enu_and_flu_axes() {
        let north = attitude(&of_euler([0.0; 3]));
        // A bow to the north points along y, the port side to the west, the mast up.
        assert!(is_near(turned(&north, Vector3::x()), [0.0, 1.0, 0.0]));
        assert!(is_near(turned(&north, Vector3::y()), [-1.0, 0.0, 0.0]));
        assert!(is_near(turned(&north, Vector3::z()), [0.0, 0.0, 1.0]));
        // The right of an image is the drone's right, the lower edge aft.
        assert!(is_near(turned(&of_camera(), Vector3::x()), [0.0, -1.0, 0.0]));
        assert!(is_near(turned(&of_camera(), Vector3::y()), [-1.0, 0.0, 0.0]));
        // A heading of east is the identity in ROS.
        let east = attitude(&of_euler([0.0, 0.0, FRAC_PI_2]));
        assert!(is_near(turned(&east, Vector3::x()), [1.0, 0.0, 0.0]));
        assert!((east.w.abs() - 1.0).abs() < 1e-12);
        // Bow up is a negative pitch in ROS, starboard down a positive roll.
        let tilted = attitude(&of_euler([0.2, 0.1, FRAC_PI_2]));
        assert!(turned(&tilted, Vector3::x()).z > 0.0);
        assert!(turned(&tilted, Vector3::y()).z > 0.0);
        let place = enu([1.0, 2.0, 3.0]);
        assert_eq!((place.x, place.y, place.z), (2.0, 1.0, -3.0));
    }

    #[test]
    fn euler_angles_of_ros() {
        let q = attitude(&of_euler([0.2, 0.1, 0.7]));
        let (roll, pitch, yaw) =
            UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z)).euler_angles();
        assert!((roll - 0.2).abs() < 1e-12 && (pitch + 0.1).abs() < 1e-12);
        assert!((yaw - (FRAC_PI_2 - 0.7)).abs() < 1e-12);
    }

    #[test]
    fn covariance_of_pose_in_enu() {
        let all = rolled([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]);
        let diagonal: Vec<f64> = (0..6).map(|k| all[k][k]).collect();
        let expected = [4.0, 1.0, 9.0, 0.01, 0.04, 0.09];
        assert!(diagonal.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12));
        assert_eq!(all[0][1], 0.0);
    }

    #[test]
    fn twist_in_the_body() {
        // Moves east at 3 m/s and down at 1 m/s, heading east, turning to starboard.
        let q = of_euler([0.0, 0.0, FRAC_PI_2]);
        let motion = BodyVelocity {
            velocity: [[0.0, 3.0, 1.0], [0.5, 0.2, 0.3]],
            rates: Vector3::new(0.1, 0.2, 0.4),
            rates_covariance: Matrix3::zeros(),
        };
        let [linear, angular] = motion.twist(&q);
        assert!((linear.x - 3.0).abs() < 1e-12 && linear.y.abs() < 1e-12 && (linear.z + 1.0).abs() < 1e-12);
        assert_eq!((angular.x, angular.y, angular.z), (0.1, -0.2, -0.4));
        let all = motion.covariance(&q);
        for (k, variance) in [0.04, 0.25, 0.09, 0.0, 0.0, 0.0].into_iter().enumerate() {
            assert!((all[k][k] - variance).abs() < 1e-12, "{k}: {all:?}");
        }
    }

    #[test]
    fn rates_of_a_level_deck() {
        let velocity = [[0.0; 3]; 2];
        let level = BodyVelocity::of_euler_rates(velocity, [0.0; 3], [[0.1, 0.2, 0.3], [0.01, 0.02, 0.03]]);
        assert!(is_near(level.rates, [0.1, 0.2, 0.3]));
        let all = level.covariance(&of_euler([0.0; 3]));
        assert!((all[4][4] - 4e-4).abs() < 1e-15 && all[3][4].abs() < 1e-15);
    }
}
