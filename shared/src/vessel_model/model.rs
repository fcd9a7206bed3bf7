//! Exact discrete matrices from the vessel's parameters and a list of wave components.

use nalgebra::{DMatrix, Rotation2, SMatrix, Vector2, Vector3};

use super::{DISTURBANCE, DOFS, ETA, HEAD, NU, SLOW, VesselModelConfig, expm::van_loan};
use crate::geometry::GRAVITY;

/// Wave component of the model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Component {
    /// Angular frequency, rad/s.
    pub omega: f64,
    /// Damping ratio lambda.
    pub damping: f64,
    /// Spectral density of the white noise that drives `w''`, per degree of freedom.
    pub drive: [f64; 6],
}

impl Component {
    /// Drive that gives the oscillator's value a standard deviation of `sd`: `q = 4 lambda omega^3 sd^2`.
    pub fn drive_for(omega: f64, damping: f64, sd: f64) -> f64 {
        4.0 * damping * omega.powi(3) * sd * sd
    }
    /// Stationary standard deviation of the oscillator's value: sqrt(q / (4 lambda omega^3)).
    pub fn stationary_sd(&self, dof: usize) -> f64 {
        let q = self.drive.get(dof).copied().unwrap_or(0.0);
        let d = 4.0 * self.damping * self.omega.powi(3);
        if d > 0.0 { (q / d).max(0.0).sqrt() } else { 0.0 }
    }
}

/// Roll and pitch (rad) of the same deck normal for a heading larger by `delta` (rad), exact for any tilt:
/// the normal `(sin theta cos phi, -sin phi, cos theta cos phi)` is rotated by `-delta` about the vertical.
pub fn turn_tilt(roll: f64, pitch: f64, delta: f64) -> (f64, f64) {
    let n = Vector3::new(pitch.sin() * roll.cos(), -roll.sin(), pitch.cos() * roll.cos());
    let h = Rotation2::new(-delta) * Vector2::new(n.x, n.y);
    ((-h.y).clamp(-1.0, 1.0).asin(), h.x.atan2(n.z))
}

/// Completes a subproblem: drift matrix, noise density, index of the degree in the group, degree of freedom.
type Completion<'a> = dyn Fn(&mut DMatrix<f64>, &mut DMatrix<f64>, usize, usize) + 'a;

/// Continuous model: parameters and components.
#[derive(Clone, Debug)]
pub struct VesselModel {
    config: VesselModelConfig,
    components: Vec<Component>,
    groups: Vec<Vec<usize>>,
    /// `M^-1 D`, `M^-1 G` and the input gain of the wave terms.
    drag: SMatrix<f64, DOFS, DOFS>,
    spring: SMatrix<f64, DOFS, DOFS>,
    gain: SMatrix<f64, DOFS, DOFS>,
}

/// Discrete transition and noise of one step, by group of coupled degrees of freedom. Order within a group:
/// head (eta, nu, slow, disturbance) of each degree, then value and rate per component.
#[derive(Clone, Debug)]
pub struct Discrete {
    /// Duration of the step, s.
    pub dt: f64,
    pub(crate) components: usize,
    pub(crate) groups: Vec<Group>,
}

#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub(crate) dofs: Vec<usize>,
    pub(crate) a: DMatrix<f64>,
    pub(crate) q: DMatrix<f64>,
}

impl VesselModel {
    /// Model of a vessel in a sea of `components`. A checked configuration makes M invertible.
    pub fn new(config: &VesselModelConfig, components: &[Component]) -> Self {
        let m = config.inertia();
        let d = config.damping();
        let g = config.stiffness();
        let inverse = m.try_inverse().unwrap_or_else(SMatrix::zeros);
        let drag = inverse * d;
        let spring = inverse * g;
        let mut gain = SMatrix::<f64, DOFS, DOFS>::identity();
        for i in 0..DOFS {
            if g[(i, i)] > 0.0 {
                gain.set_column(i, &spring.column(i));
            }
        }
        let mut coupled = [[false; DOFS]; DOFS];
        for i in 0..DOFS {
            for j in 0..DOFS {
                coupled[i][j] = i != j && (m[(i, j)] != 0.0 || d[(i, j)] != 0.0 || g[(i, j)] != 0.0);
            }
        }
        VesselModel {
            config: config.clone(),
            components: components.to_vec(),
            groups: connected(&coupled),
            drag,
            spring,
            gain,
        }
    }
    /// Model with the broad default bank, whose directions are unknown.
    pub fn with_bank(config: &VesselModelConfig) -> Self {
        let lambda = config.bank_damping;
        let components: Vec<Component> = config
            .bank_omega_radps
            .iter()
            .map(|&omega| {
                // Deep water: slope k a, orbital acceleration omega² a = slope g. Two axes share the slope,
                // and a hull that does not follow the water has the whole slope along either.
                let slope = config.bank_slope_sd;
                let orbital = slope * GRAVITY;
                let z = orbital / (omega * omega);
                let half = core::f64::consts::FRAC_1_SQRT_2;
                let sd = [
                    orbital,
                    orbital,
                    z,
                    half * slope,
                    half * slope,
                    0.1 * slope * omega * omega,
                ];
                Component {
                    omega,
                    damping: lambda,
                    drive: sd.map(|s| Component::drive_for(omega, lambda, s)),
                }
            })
            .collect();
        Self::new(config, &components)
    }
    /// Parameters of the model.
    pub fn config(&self) -> &VesselModelConfig {
        &self.config
    }
    /// Wave components of the model.
    pub fn components(&self) -> &[Component] {
        &self.components
    }
    /// Groups of degrees of freedom coupled by M, D and G.
    pub fn groups(&self) -> &[Vec<usize>] {
        &self.groups
    }
    /// Whether the degree of freedom has stiffness: its waves are equilibria, not accelerations.
    pub fn is_stiff(&self, dof: usize) -> bool {
        self.config
            .stiffness_npm_nmprad
            .get(dof)
            .is_some_and(|g| *g > 0.0)
    }

    /// Coefficients of `nu_dot` of degree of freedom `i` by the head of `k`: (eta, nu, slow, disturbance);
    /// the last also applies to wave values.
    pub fn acceleration_row(&self, i: usize, k: usize) -> [f64; HEAD] {
        let drag = self.drag[(i, k)];
        let spring = self.spring[(i, k)];
        let gain = self.gain[(i, k)];
        let slow = if self.is_stiff(k) { spring } else { drag };
        [-spring, -drag, slow, gain]
    }

    /// Exact discretisation over `dt` seconds. Noise sources are independent, so a group is the superposition
    /// of small subproblems: {eta, nu, slow, disturbance}, and {eta, nu, oscillator} for each component.
    pub fn discretise(&self, dt: f64) -> Discrete {
        let groups = self.groups.iter().map(|g| self.discretise_group(g, dt)).collect();
        Discrete {
            dt,
            components: self.components.len(),
            groups,
        }
    }

    fn discretise_group(&self, dofs: &[usize], dt: f64) -> Group {
        let d = dofs.len();
        let nc = self.components.len();
        let stride = HEAD + 2 * nc;
        let n = d * stride;
        let mut a = DMatrix::zeros(n, n);
        let mut q = DMatrix::zeros(n, n);
        let c = &self.config;
        let core = |second: &Completion<'_>| {
            let mut f = DMatrix::zeros(HEAD * d, HEAD * d);
            let mut w = DMatrix::zeros(HEAD * d, HEAD * d);
            for (li, &i) in dofs.iter().enumerate() {
                f[(HEAD * li + ETA, HEAD * li + NU)] = 1.0;
                for (lk, &k) in dofs.iter().enumerate() {
                    let row = self.acceleration_row(i, k);
                    f[(HEAD * li + NU, HEAD * lk + ETA)] = row[ETA];
                    f[(HEAD * li + NU, HEAD * lk + NU)] = row[NU];
                }
                second(&mut f, &mut w, li, i);
            }
            van_loan(&f, &w, dt)
        };
        let (fa, fq) = core(&|f, w, li, i| {
            let r = HEAD * li;
            for (lk, &k) in dofs.iter().enumerate() {
                let row = self.acceleration_row(i, k);
                f[(r + NU, HEAD * lk + SLOW)] = row[SLOW];
                f[(r + NU, HEAD * lk + DISTURBANCE)] = row[DISTURBANCE];
            }
            let tau = c.disturbance_time_s[i];
            f[(r + DISTURBANCE, r + DISTURBANCE)] = -1.0 / tau;
            w[(r + ETA, r + ETA)] = c.eta_walk_m_rad[i].powi(2);
            w[(r + SLOW, r + SLOW)] = c.slow_walk_mps_m_rad_radps[i].powi(2);
            w[(r + DISTURBANCE, r + DISTURBANCE)] = 2.0 * c.disturbance_sd_mps2_m_rad_radps2[i].powi(2) / tau;
        });
        let at = |s: usize| (s / HEAD) * stride + s % HEAD;
        for i in 0..HEAD * d {
            for j in 0..HEAD * d {
                a[(at(i), at(j))] = fa[(i, j)];
                q[(at(i), at(j))] = fq[(i, j)];
            }
        }
        for (index, wave) in self.components.iter().enumerate() {
            let (oa, oq) = core(&|f, w, li, i| {
                // Slots 2 and 3 hold the oscillator here.
                let r = HEAD * li;
                let o = wave.omega;
                for (lk, &k) in dofs.iter().enumerate() {
                    f[(r + NU, HEAD * lk + 2)] = self.gain[(i, k)];
                }
                f[(r + 2, r + 3)] = 1.0;
                f[(r + 3, r + 2)] = -o * o;
                f[(r + 3, r + 3)] = -2.0 * wave.damping * o;
                w[(r + 3, r + 3)] = wave.drive[i];
            });
            let osc = |s: usize| {
                let dof = s / HEAD;
                let slot = s % HEAD;
                dof * stride
                    + if slot < 2 {
                        slot
                    } else {
                        HEAD + 2 * index + slot - 2
                    }
            };
            for i in 0..HEAD * d {
                for j in 0..HEAD * d {
                    q[(osc(i), osc(j))] += oq[(i, j)];
                    if j % HEAD >= 2 {
                        a[(osc(i), osc(j))] = oa[(i, j)];
                    }
                }
            }
        }
        Group {
            dofs: dofs.to_vec(),
            a,
            q,
        }
    }
}

/// Connected sets of a symmetric relation, each in ascending order.
pub(crate) fn connected(related: &[[bool; DOFS]; DOFS]) -> Vec<Vec<usize>> {
    let mut label: [usize; DOFS] = core::array::from_fn(|i| i);
    for _ in 0..DOFS {
        for i in 0..DOFS {
            for j in 0..DOFS {
                if related[i][j] || related[j][i] {
                    let smallest = label[i].min(label[j]);
                    label[i] = smallest;
                    label[j] = smallest;
                }
            }
        }
    }
    (0..DOFS)
        .map(|l| (0..DOFS).filter(|&i| label[i] == l).collect::<Vec<_>>())
        .filter(|g| !g.is_empty())
        .collect()
}
