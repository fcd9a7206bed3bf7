//! Tilt kinematics in the reference-parallel frame, exact for any tilt. The deck's normal (down) at the
//! reference heading is `n = (sin theta cos phi, -sin phi, cos theta cos phi)`, with `n_dot = omega x n`.

use alight_shared::vessel_model::turn_tilt;
use nalgebra::{Rotation3, Vector3};

/// Roll and pitch at the reference heading, heading minus reference, and their rates (rad, rad/s).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tilt {
    pub angles: [f64; 2],
    pub rates: [f64; 2],
    pub heading: f64,
    pub heading_rate: f64,
}

fn normal([roll, pitch]: [f64; 2]) -> Vector3<f64> {
    Vector3::new(pitch.sin() * roll.cos(), -roll.sin(), pitch.cos() * roll.cos())
}
fn normal_rate([roll, pitch]: [f64; 2], [dr, dp]: [f64; 2]) -> Vector3<f64> {
    let (sr, cr) = roll.sin_cos();
    let (sp, cp) = pitch.sin_cos();
    Vector3::new(
        cp * cr * dp - sp * sr * dr,
        -cr * dr,
        -sp * cr * dp - cp * sr * dr,
    )
}
/// Rates of roll and pitch from the derivative of the normal.
fn rates_of([roll, pitch]: [f64; 2], d: Vector3<f64>) -> [f64; 2] {
    let cr = roll.cos().max(1e-3);
    [-d.y / cr, (pitch.cos() * d.x - pitch.sin() * d.z) / cr]
}

impl Tilt {
    /// ZYX Euler angles of the body in the reference-parallel frame: roll, pitch, heading minus reference.
    pub fn euler(&self) -> [f64; 3] {
        let (r, p) = turn_tilt(self.angles[0], self.angles[1], self.heading);
        [r, p, self.heading]
    }
    pub fn euler_rates(&self) -> [f64; 3] {
        let [r, p, _] = self.euler();
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -self.heading);
        let n = turn * normal(self.angles);
        let d = turn * normal_rate(self.angles, self.rates) - self.heading_rate * Vector3::z().cross(&n);
        let [dr, dp] = rates_of([r, p], d);
        [dr, dp, self.heading_rate]
    }
    /// Rotation from body to the reference-parallel frame.
    pub fn rotation(&self) -> Rotation3<f64> {
        let [r, p, y] = self.euler();
        Rotation3::from_euler_angles(r, p, y)
    }
    /// Body rates, rad/s.
    pub fn body_rates(&self) -> Vector3<f64> {
        let [r, p, _] = self.euler();
        alight_shared::frames::body_rates(r, p, Vector3::from(self.euler_rates()))
    }
    /// Rates of roll, pitch (at the reference heading) and heading from gyro rates: `n_dot = (R omega) x n`.
    pub fn rates_from_gyro(&self, body: Vector3<f64>) -> [f64; 3] {
        let w = self.rotation() * body;
        let d = w.cross(&normal(self.angles));
        let [dr, dp] = rates_of(self.angles, d);
        let [r, p, _] = self.euler();
        let yaw = alight_shared::frames::euler_rates(r, p, body).z;
        [dr, dp, yaw]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tilt() -> Tilt {
        Tilt {
            angles: [0.21, -0.17],
            rates: [0.3, 0.25],
            heading: 0.6,
            heading_rate: -0.2,
        }
    }

    #[test]
    fn euler_rates_against_euler_angles() {
        let t = tilt();
        let h = 1e-6;
        let later = Tilt {
            angles: [t.angles[0] + h * t.rates[0], t.angles[1] + h * t.rates[1]],
            heading: t.heading + h * t.heading_rate,
            ..t
        };
        let a = t.euler();
        let b = later.euler();
        let d = t.euler_rates();
        for i in 0..3 {
            assert!(((b[i] - a[i]) / h - d[i]).abs() < 1e-5, "{i}");
        }
    }

    #[test]
    fn gyroscope_rates_and_tilt_kinematics() {
        let t = tilt();
        let g = t.rates_from_gyro(t.body_rates());
        assert!((g[0] - t.rates[0]).abs() < 1e-12);
        assert!((g[1] - t.rates[1]).abs() < 1e-12);
        assert!((g[2] - t.heading_rate).abs() < 1e-12);
    }
}
