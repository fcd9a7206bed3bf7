//! Mass, added mass and Coriolis terms of a rigid body in water, about the body's origin (Fossen 2011,
//! chapters 3 and 6).

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Rigid-body mass matrix about the origin, with the centre of gravity at `cg` from the origin and the
/// inertia about that centre (Fossen 2011, eq. 3.44; kg, kg m, kg m²).
pub fn rigid_body_mass(mass: f64, cg: Vector3<f64>, inertia: Vector3<f64>) -> Matrix6<f64> {
    let s = cg.cross_matrix();
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&(Matrix3::identity() * mass));
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-s * mass));
    m.fixed_view_mut::<3, 3>(3, 0).copy_from(&(s * mass));
    m.fixed_view_mut::<3, 3>(3, 3)
        .copy_from(&(Matrix3::from_diagonal(&inertia) - s * s * mass));
    m
}

/// `C(nu) nu` of a symmetric mass matrix (Fossen 2011, theorem 3.2): with the momenta
/// `[p; h] = M nu`, it is `[w x p; v x p + w x h]`.
pub fn coriolis(m: &Matrix6<f64>, nu: &Vector6<f64>) -> Vector6<f64> {
    let momentum = m * nu;
    let v = head(nu);
    let w = tail(nu);
    let p = head(&momentum);
    let h = tail(&momentum);
    join(w.cross(&p), v.cross(&p) + w.cross(&h))
}

pub fn head(x: &Vector6<f64>) -> Vector3<f64> {
    Vector3::new(x[0], x[1], x[2])
}
pub fn tail(x: &Vector6<f64>) -> Vector3<f64> {
    Vector3::new(x[3], x[4], x[5])
}
pub fn join(a: Vector3<f64>, b: Vector3<f64>) -> Vector6<f64> {
    Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn masses() -> Matrix6<f64> {
        rigid_body_mass(
            211.0,
            Vector3::new(0.1, 0.02, -0.2),
            Vector3::new(120.0, 393.0, 446.0),
        ) + Matrix6::from_diagonal(&Vector6::new(21.0, 316.0, 211.0, 24.0, 314.0, 758.0))
    }

    #[test]
    fn free_rigid_body_energy_and_momentum() {
        // nu' = -M^-1 C nu, RK4; kinetic energy 0.5 nu' M nu and linear momentum in NED are constant.
        let m = masses();
        let inverse = m.try_inverse().unwrap();
        let f = |nu: &Vector6<f64>| -(inverse * coriolis(&m, nu));
        let mut nu = Vector6::new(2.0, -0.5, 0.3, 0.4, -0.3, 0.6);
        let mut q = nalgebra::UnitQuaternion::identity();
        let energy = |nu: &Vector6<f64>| 0.5 * nu.dot(&(m * nu));
        let e0 = energy(&nu);
        let p0 = head(&(m * nu));
        let dt = 0.002;
        for _ in 0..5000 {
            let k1 = f(&nu);
            let k2 = f(&(nu + k1 * (dt / 2.0)));
            let k3 = f(&(nu + k2 * (dt / 2.0)));
            let k4 = f(&(nu + k3 * dt));
            let w = tail(&(nu + (k1 + k2) * (dt / 4.0)));
            q *= nalgebra::UnitQuaternion::from_scaled_axis(w * dt);
            nu += (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (dt / 6.0);
        }
        assert!((energy(&nu) / e0 - 1.0).abs() < 1e-9);
        assert!((q * head(&(m * nu)) - p0).norm() / p0.norm() < 1e-3);
        // The motion must have changed.
        assert!((nu - Vector6::new(2.0, -0.5, 0.3, 0.4, -0.3, 0.6)).norm() > 0.1);
    }
}
