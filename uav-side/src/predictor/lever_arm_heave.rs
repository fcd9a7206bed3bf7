//! Lever-arm heave: difference in height of the deck's centre between a tilted and a level vessel.
//!
//! The filters estimate the height of the deck on a level vessel, which is a sum of waves. A deck at the lever arm `c`
//! above the vessel's reference point dips twice in each rocking period by `c_z (cos theta cos phi - 1)`: 8 cm at 20
//! deg, at up to 0.1 m/s. No mode contains this motion, so it is computed from the tilt.

use nalgebra::Vector3;

/// Height (m, down) that tilt adds to a deck at the lever arm `c` (body frame, m), with its rate and acceleration, from
/// Euler angles, their rates and accelerations: the third row of `R(phi, theta)` times `c`, minus `c_z`.
pub fn lever_arm_heave(
    c: &Vector3<f64>,
    [phi, theta]: [f64; 2],
    [dphi, dtheta]: [f64; 2],
    [ddphi, ddtheta]: [f64; 2],
) -> [f64; 3] {
    let (sp, cp) = phi.sin_cos();
    let (st, ct) = theta.sin_cos();
    let row = Vector3::new(-st, ct * sp, ct * cp);
    let rate = Vector3::new(
        -ct * dtheta,
        -st * sp * dtheta + ct * cp * dphi,
        -st * cp * dtheta - ct * sp * dphi,
    );
    let square = dtheta * dtheta + dphi * dphi;
    let cross = 2.0 * dtheta * dphi;
    let acceleration = Vector3::new(
        st * dtheta * dtheta - ct * ddtheta,
        -ct * sp * square - st * cp * cross - st * sp * ddtheta + ct * cp * ddphi,
        -ct * cp * square + st * sp * cross - st * cp * ddtheta - ct * sp * ddphi,
    );
    [row.dot(c) - c.z, rate.dot(c), acceleration.dot(c)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    #[test]
    fn lever_arm_heave_against_the_rotated_lever_arm() {
        let c = Vector3::new(0.4, -0.2, -1.3);
        let angles = |t: f64| [0.2 * (1.1 * t).sin(), 0.3 * (0.9 * t + 0.4).cos()];
        let at = |t: f64| {
            let [phi, theta] = angles(t);
            (Rotation3::from_euler_angles(phi, theta, 0.7) * c).z - c.z
        };
        let t = 0.8;
        let h = 1e-4;
        let [a, b, d] = [angles(t - h), angles(t), angles(t + h)];
        let rate: [f64; 2] = core::array::from_fn(|i| (d[i] - a[i]) / (2.0 * h));
        let second: [f64; 2] = core::array::from_fn(|i| (d[i] - 2.0 * b[i] + a[i]) / (h * h));
        let [value, first, accelerated] = lever_arm_heave(&c, b, rate, second);
        assert!((value - at(t)).abs() < 1e-12);
        assert!((first - (at(t + h) - at(t - h)) / (2.0 * h)).abs() < 1e-6);
        assert!((accelerated - (at(t + h) - 2.0 * at(t) + at(t - h)) / (h * h)).abs() < 1e-5);
    }
}
