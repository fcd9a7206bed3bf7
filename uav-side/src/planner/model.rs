//! Prediction model of the paper: the multirotor linearised about hover, discretised exactly (Procházka et al. 2024,
//! eq. 4-5).
//!
//! State `x = [p, (phi theta psi), v, (phidot thetadot psidot)]` in NED with ZYX Euler angles, input `u` = squared
//! rotor speeds divided by their value at hover. In the paper's ENU the signs of z and of the torques differ.
//!
//! About hover the model splits into four chains that are coupled only through the rotors: x-pitch and y-roll (four
//! integrators each), z and yaw (two each). [`MIXER`] is orthonormal, so the paper's cost `R` on the rotors' increments
//! equals that on the increments of the virtual inputs, and four small problems are equivalent to the large one.

use alight_shared::{
    frames::body_rates,
    geometry::{DroneGeometry, GRAVITY},
    msg::{DeckStage, DroneState},
};
use nalgebra::{SMatrix, SVector, Vector3};

pub const STATES: usize = 12;
/// Number of rotors, and of virtual inputs.
pub const INPUTS: usize = 4;

/// Full state `[p, euler, v, euler rates]`, indexed by [`state`]: m, rad, m/s, rad/s.
pub type ModelState = [f64; STATES];

pub mod state {
    use super::ModelState;
    use nalgebra::Vector3;

    pub const NORTH: usize = 0;
    pub const EAST: usize = 1;
    pub const DOWN: usize = 2;
    /// Tilt about north, rad.
    pub const PHI: usize = 3;
    /// Tilt about east, rad.
    pub const THETA: usize = 4;
    pub const PSI: usize = 5;
    pub const V_NORTH: usize = 6;
    pub const V_EAST: usize = 7;
    pub const V_DOWN: usize = 8;
    pub const PHI_DOT: usize = 9;
    pub const THETA_DOT: usize = 10;
    pub const PSI_DOT: usize = 11;

    /// Position, NED, m.
    pub fn position(x: &ModelState) -> Vector3<f64> {
        Vector3::new(x[NORTH], x[EAST], x[DOWN])
    }
}

/// Virtual inputs from rotor inputs (deviations from hover): rows thrust, roll, pitch, yaw, with the signs of
/// the paper's eq. 5 in FRD. Orthonormal: `u = MIXER' nu`.
pub const MIXER: [[f64; 4]; 4] = [
    [0.5, 0.5, 0.5, 0.5],
    [-0.5, -0.5, 0.5, 0.5],
    [-0.5, 0.5, 0.5, -0.5],
    [-0.5, 0.5, -0.5, 0.5],
];

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoverModel {
    /// Downward acceleration per unit of collective input, m/s²: `-g / 2`.
    pub vertical: f64,
    /// Roll acceleration per unit, rad/s²: `m g l / (2 Ixx)`.
    pub roll: f64,
    /// Pitch acceleration per unit, rad/s²: `m g l / (2 Iyy)`.
    pub pitch: f64,
    /// Yaw acceleration per unit, rad/s²: `m g c / (2 Izz)` with the moment per force `c`.
    pub yaw: f64,
}

impl HoverModel {
    /// The paper's lever arm `l` of all four rotors about each axis is the arm length of an X frame divided by the
    /// square root of two.
    pub fn new(drone: &DroneGeometry) -> Self {
        let half_weight = 0.5 * drone.mass_kg * GRAVITY;
        let lever = drone.arm_m * core::f64::consts::FRAC_1_SQRT_2;
        let [ixx, iyy, izz] = drone.inertia_kgm2;
        HoverModel {
            vertical: -0.5 * GRAVITY,
            roll: half_weight * lever / ixx,
            pitch: half_weight * lever / iyy,
            yaw: half_weight * drone.moment_per_force_m / izz,
        }
    }

    /// Continuous `A` (12 x 12) and `B` (12 x 4, rotor inputs): `xdot = A x + B (u - 1)`.
    pub fn continuous(&self) -> (SMatrix<f64, STATES, STATES>, SMatrix<f64, STATES, INPUTS>) {
        let mut a = SMatrix::zeros();
        for i in 0..6 {
            a[(i, i + 6)] = 1.0;
        }
        // A nose-down pitch is negative and accelerates the drone forward; a starboard-down roll accelerates it to the
        // right.
        a[(state::V_NORTH, state::THETA)] = -GRAVITY;
        a[(state::V_EAST, state::PHI)] = GRAVITY;
        let mut b = SMatrix::zeros();
        for rotor in 0..INPUTS {
            b[(state::V_DOWN, rotor)] = self.vertical * MIXER[0][rotor];
            b[(state::PHI_DOT, rotor)] = self.roll * MIXER[1][rotor];
            b[(state::THETA_DOT, rotor)] = self.pitch * MIXER[2][rotor];
            b[(state::PSI_DOT, rotor)] = self.yaw * MIXER[3][rotor];
        }
        (a, b)
    }

    /// Chain of x and pitch: `[px, vx, theta, thetadot]`, input 2.
    pub fn x_chain(&self) -> Chain<4> {
        Chain::tilt(-GRAVITY, self.pitch)
    }
    /// Chain of y and roll: `[py, vy, phi, phidot]`, input 1.
    pub fn y_chain(&self) -> Chain<4> {
        Chain::tilt(GRAVITY, self.roll)
    }
    /// Vertical chain: `[pz, vz]`, input 0.
    pub fn z_chain(&self) -> Chain<2> {
        Chain::double(self.vertical)
    }
    /// Yaw chain: `[psi, psidot]`, input 3.
    pub fn yaw_chain(&self) -> Chain<2> {
        Chain::double(self.yaw)
    }
}

/// Continuous-time chain `xdot = A x + B u` with a single input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chain<const N: usize> {
    /// `A`, 1/s.
    pub a: SMatrix<f64, N, N>,
    pub b: SVector<f64, N>,
}

impl Chain<4> {
    fn tilt(acceleration_per_rad: f64, gain: f64) -> Self {
        let mut a = SMatrix::zeros();
        a[(0, 1)] = 1.0;
        a[(1, 2)] = acceleration_per_rad;
        a[(2, 3)] = 1.0;
        Chain {
            a,
            b: SVector::from([0.0, 0.0, 0.0, gain]),
        }
    }
}
impl Chain<2> {
    fn double(gain: f64) -> Self {
        let mut a = SMatrix::zeros();
        a[(0, 1)] = 1.0;
        Chain {
            a,
            b: SVector::from([0.0, gain]),
        }
    }
}
impl<const N: usize> Chain<N> {
    /// Exact zero-order hold over `step_s`.
    pub fn discrete(&self, step_s: f64) -> DiscreteModel<N, 1> {
        discretise(&self.a, &self.b, step_s)
    }
}

/// Discrete-time model `x+ = A x + B u` with the input held over the step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiscreteModel<const N: usize, const M: usize> {
    pub a: SMatrix<f64, N, N>,
    pub b: SMatrix<f64, N, M>,
}

impl<const N: usize> DiscreteModel<N, 1> {
    pub fn step(&self, x: &SVector<f64, N>, u: f64) -> SVector<f64, N> {
        self.a * x + self.b * u
    }
}

/// Exact zero-order hold: `Ad = sum A^k h^k / k!`, `Bd = sum A^k h^(k+1) / (k+1)! B`. The sums are finite, because the
/// hover model's `A` is nilpotent (`A^4 = 0`).
pub fn discretise<const N: usize, const M: usize>(
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, M>,
    step_s: f64,
) -> DiscreteModel<N, M> {
    const NILPOTENCY: usize = 4;
    let mut term = SMatrix::<f64, N, N>::identity();
    let (mut ad, mut integral) = (SMatrix::zeros(), SMatrix::zeros());
    for k in 0..NILPOTENCY {
        ad += term;
        integral += term * (step_s / (k as f64 + 1.0));
        term = term * a * (step_s / (k as f64 + 1.0));
    }
    DiscreteModel {
        a: ad,
        b: integral * b,
    }
}

/// Tilt (phi, theta) of a body with the upward axis `up` (NED), about the axes of a frame rotated by `heading`: `R =
/// Ry(theta) Rx(phi)` rotates the frame's -z to `up`.
pub fn tilt_of(up: &Vector3<f64>, heading: f64) -> (f64, f64) {
    let (s, c) = heading.sin_cos();
    let (x, y) = (c * up.x + s * up.y, -s * up.x + c * up.y);
    (y.clamp(-1.0, 1.0).asin(), (-x).atan2(-up.z))
}

/// Upward axis (NED) of a body with tilt `(phi, theta)` about north and east.
pub fn up_of(phi: f64, theta: f64) -> Vector3<f64> {
    let ((sp, cp), (st, ct)) = (phi.sin_cos(), theta.sin_cos());
    Vector3::new(-st * cp, sp, -ct * cp)
}

/// NED, rad/s.
pub fn angular_velocity(d: &DeckStage) -> Vector3<f64> {
    d.rotation() * body_rates(d.euler[0], d.euler[1], Vector3::from(d.euler_rates))
}

/// Height above the deck's plane, along its normal, of the foot plane of a body at `p` with upward axis `up`, m.
pub fn clearance(p: &Vector3<f64>, up: &Vector3<f64>, deck: &DeckStage, feet_below_m: f64) -> f64 {
    deck.height_of(&(p - up * feet_below_m))
}

pub fn measured_state(drone: &DroneState) -> ModelState {
    let q = drone.attitude();
    let (phi, theta) = tilt_of(&(q * -Vector3::z()), 0.0);
    let w = q * Vector3::from(drone.rates);
    let (p, v) = (drone.position, drone.velocity);
    [
        p[0],
        p[1],
        p[2],
        phi,
        theta,
        drone.euler().z,
        v[0],
        v[1],
        v[2],
        w.x,
        w.y,
        w.z,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::frames::euler_rates;
    use nalgebra::{Rotation3, Vector4};

    fn drone() -> DroneGeometry {
        // Three different inertias reveal swapped axes.
        DroneGeometry {
            inertia_kgm2: [0.08, 0.11, 0.19],
            ..DroneGeometry::default()
        }
    }

    /// Nonlinear rigid body of eq. 4-5: thrust along the body's -z, torques from the rotors' positions and reaction
    /// moments, and Euler's equation. Rotors are numbered as in [`MIXER`].
    fn rigid_body(d: &DroneGeometry, x: &SVector<f64, 12>, u: &Vector4<f64>) -> SVector<f64, 12> {
        let l = d.arm_m / 2f64.sqrt();
        let rotors = [[-l, l], [l, l], [l, -l], [-l, -l]];
        let spin = [-1.0, 1.0, -1.0, 1.0];
        let hover = d.mass_kg * GRAVITY / 4.0;
        let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
        for i in 0..4 {
            let f = Vector3::new(0.0, 0.0, -hover * u[i]);
            force += f;
            torque += Vector3::new(rotors[i][0], rotors[i][1], 0.0).cross(&f);
            torque.z += spin[i] * d.moment_per_force_m * hover * u[i];
        }
        let (phi, theta, psi) = (x[3], x[4], x[5]);
        let euler_dot = Vector3::new(x[9], x[10], x[11]);
        let omega = body_rates(phi, theta, euler_dot);
        let inertia = Vector3::from(d.inertia_kgm2);
        let omega_dot = (torque - omega.cross(&inertia.component_mul(&omega))).component_div(&inertia);
        let acceleration = Rotation3::from_euler_angles(phi, theta, psi) * force / d.mass_kg
            + Vector3::new(0.0, 0.0, GRAVITY);
        // d/dt (T omega) = T omega_dot + Tdot omega, with the second term as a finite difference in time.
        let h = 1e-6;
        let later = euler_rates(phi + h * euler_dot.x, theta + h * euler_dot.y, omega);
        let euler_ddot = euler_rates(phi, theta, omega_dot) + (later - euler_dot) / h;
        let mut out = SVector::zeros();
        for i in 0..3 {
            out[i] = x[6 + i];
            out[3 + i] = euler_dot[i];
            out[6 + i] = acceleration[i];
            out[9 + i] = euler_ddot[i];
        }
        out
    }

    #[test]
    fn hover_matrices_against_rigid_body_jacobian() {
        let d = drone();
        let (a, b) = HoverModel::new(&d).continuous();
        let (x0, u0, e) = (SVector::<f64, 12>::zeros(), Vector4::from_element(1.0), 1e-4);
        for j in 0..12 {
            let mut dx = SVector::<f64, 12>::zeros();
            dx[j] = e;
            let column = (rigid_body(&d, &(x0 + dx), &u0) - rigid_body(&d, &(x0 - dx), &u0)) / (2.0 * e);
            assert!((column - a.column(j)).amax() < 1e-5, "A column {j}: {column}");
        }
        for j in 0..4 {
            let mut du = Vector4::zeros();
            du[j] = e;
            let column = (rigid_body(&d, &x0, &(u0 + du)) - rigid_body(&d, &x0, &(u0 - du))) / (2.0 * e);
            assert!((column - b.column(j)).amax() < 1e-5, "B column {j}: {column}");
        }
        assert!(rigid_body(&d, &x0, &u0).amax() < 1e-9, "hover is an equilibrium");
    }

    #[test]
    fn discretised_chain() {
        // Reference: 100000 small Euler steps of the continuous model.
        let chain = HoverModel::new(&drone()).x_chain();
        let d = chain.discrete(0.1);
        let x0 = SVector::<f64, 4>::from([1.0, -0.5, 0.1, 0.3]);
        let (mut x, n) = (x0, 100_000);
        for _ in 0..n {
            x += (chain.a * x + chain.b * 0.2) * (0.1 / f64::from(n));
        }
        assert!((d.step(&x0, 0.2) - x).amax() < 1e-4);
        let twice = chain.discrete(0.05);
        assert!((twice.step(&twice.step(&x0, 0.2), 0.2) - d.step(&x0, 0.2)).amax() < 1e-12);
    }

    #[test]
    fn four_chains_against_the_full_model() {
        let m = HoverModel::new(&drone());
        let (a, b) = m.continuous();
        let full = discretise(&a, &b, 0.1);
        let x0 = SVector::<f64, 12>::from_fn(|i, _| 0.1 * (i as f64 + 1.0));
        let nu = Vector4::new(0.1, -0.05, 0.07, 0.03);
        let mixer = SMatrix::<f64, 4, 4>::from_fn(|i, j| MIXER[i][j]);
        assert!((mixer * mixer.transpose() - SMatrix::<f64, 4, 4>::identity()).amax() < 1e-15);
        let x1 = full.a * x0 + full.b * (mixer.transpose() * nu);
        let x = m
            .x_chain()
            .discrete(0.1)
            .step(&SVector::from([x0[0], x0[6], x0[4], x0[10]]), nu[2]);
        let y = m
            .y_chain()
            .discrete(0.1)
            .step(&SVector::from([x0[1], x0[7], x0[3], x0[9]]), nu[1]);
        let z = m
            .z_chain()
            .discrete(0.1)
            .step(&SVector::from([x0[2], x0[8]]), nu[0]);
        let w = m
            .yaw_chain()
            .discrete(0.1)
            .step(&SVector::from([x0[5], x0[11]]), nu[3]);
        let got = [
            x[0], y[0], z[0], y[2], x[2], w[0], x[1], y[1], z[1], y[3], x[3], w[1],
        ];
        for i in 0..12 {
            assert!((got[i] - x1[i]).abs() < 1e-12, "state {i}");
        }
    }

    #[test]
    fn tilt_of_and_up_of_inverse() {
        let (phi, theta) = tilt_of(&up_of(0.2, -0.3), 0.0);
        assert!((phi - 0.2).abs() < 1e-12 && (theta + 0.3).abs() < 1e-12);
        // At a heading of east, a tilt to the north is a roll to port.
        let (phi, theta) = tilt_of(&up_of(0.0, -0.1), core::f64::consts::FRAC_PI_2);
        assert!((phi + 0.1).abs() < 1e-12 && theta.abs() < 1e-12);
    }
}
