use alight_shared::frames::{Frame, Point, Rotation, TrueNed, Vector};
use nalgebra::Vector3;

use super::spline::Jet;

/// State of a rigid body's reference point, SI units; `B` is the body's FRD frame.
#[derive(Clone, Copy)]
pub struct RigidState<B> {
    pub position: Point<TrueNed>,
    pub velocity: Vector<TrueNed>,
    /// Acceleration without gravity, m/s².
    pub acceleration: Vector<TrueNed>,
    /// Rotation NED from body.
    pub attitude: Rotation<TrueNed, B>,
    pub rates: Vector<B>,
    pub angular_acceleration: Vector<B>,
}

impl<B> Default for RigidState<B> {
    fn default() -> Self {
        RigidState {
            position: Point::origin(),
            velocity: Vector::zero(),
            acceleration: Vector::zero(),
            attitude: Rotation::identity(),
            rates: Vector::zero(),
            angular_acceleration: Vector::zero(),
        }
    }
}

impl<B: Frame> RigidState<B> {
    /// State of the point at `lever_arm` (body frame, m), expressed in the parallel axes `P`: `v = v0 + w x
    /// r`, `a = a0 + dw x r + w x (w x r)`.
    pub fn at<P>(&self, lever_arm: Vector3<f64>) -> RigidState<P> {
        let w = self.rates.0;
        let dw = self.angular_acceleration.0;
        let turn = |v: Vector3<f64>| self.attitude * Vector::<B>::from(v);
        RigidState {
            position: self.position + turn(lever_arm),
            velocity: self.velocity + turn(w.cross(&lever_arm)),
            acceleration: self.acceleration + turn(dw.cross(&lever_arm) + w.cross(&w.cross(&lever_arm))),
            attitude: Rotation::from(self.attitude.0),
            rates: Vector::from(w),
            angular_acceleration: Vector::from(dw),
        }
    }
    pub fn euler(&self) -> Vector3<f64> {
        let (r, p, y) = self.attitude.euler();
        Vector3::new(r, p, y)
    }
}

/// Body rates (rad/s) and angular acceleration (rad/s²) from ZYX Euler angles and their derivatives: `w = T^-1 e'`
/// (Fossen 2011, eq. 2.28) and its derivative.
pub fn body_motion(roll: &Jet, pitch: &Jet, yaw: &Jet) -> (Vector3<f64>, Vector3<f64>) {
    let (sr, cr) = roll.y.sin_cos();
    let (sp, cp) = pitch.y.sin_cos();
    let r = roll.d;
    let p = pitch.d;
    let y = yaw.d;
    (
        Vector3::new(r - sp * y, cr * p + sr * cp * y, -sr * p + cr * cp * y),
        Vector3::new(
            roll.dd - cp * p * y - sp * yaw.dd,
            -sr * r * p + cr * pitch.dd + cr * r * cp * y - sr * sp * p * y + sr * cp * yaw.dd,
            -cr * r * p - sr * pitch.dd - sr * r * cp * y - cr * sp * p * y + cr * cp * yaw.dd,
        ),
    )
}
