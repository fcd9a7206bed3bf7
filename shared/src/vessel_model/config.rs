//! Parameters of the vessel model.

use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};

use super::DOFS;
use crate::config;

/// Off-diagonal pair of a symmetric matrix.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coupling {
    /// First degree of freedom, 0 to 5.
    pub row: usize,
    /// Second degree of freedom, 0 to 5.
    pub column: usize,
    /// Value at (row, column) and (column, row), SI.
    pub value: f64,
}

config! {
    /// Parameters of the wave-augmented model. Arrays are in the order surge, sway, heave, roll, pitch, yaw.
    pub struct VesselModelConfig {
        /// Diagonal of M, rigid body and added mass: kg, kg m².
        /// Source: Virtual RobotX WAM-V with engines: 211 kg, diag(120, 393, 446) kg m²; added mass in the
        /// proportions of the Otter (Fossen's MSS toolbox): 0.1, 1.5, 1.0, 0.2, 0.8, 1.7. Roll has the
        /// natural frequency of pitch: a catamaran's (15.6 rad/s) is above any other hull's.
        pub inertia_kg_kgm2: [f64; 6] = [232.0, 528.0, 422.0, 700.0, 707.0, 1204.0], in 0.1..=1e9;
        /// Off-diagonal pairs of M.
        pub inertia_coupling: Vec<Coupling> = Vec::new();
        /// Diagonal of D: N/(m/s), Nm/(rad/s).
        /// Source: Surge, sway, yaw: linear drag of the WAM-V. Heave: damping ratio 0.3, that of the Otter.
        /// Chosen: Roll and pitch: damping ratio 0.7, without a resonance above the waves.
        pub damping_npmps_nmpradps: [f64; 6] = [51.3, 40.0, 2239.0, 6900.0, 7300.0, 400.0], in 0.0..=1e9;
        /// Off-diagonal pairs of D.
        pub damping_coupling: Vec<Coupling> = Vec::new();
        /// Diagonal of G: N/m, Nm/rad. Zero marks a free degree of freedom.
        /// Source: Two half-cylinder hulls of radius 0.213 m and length 4.9 m at +-1.03 m, 211 kg.
        pub stiffness_npm_nmprad: [f64; 6] = [0.0, 0.0, 33.0e3, 35.0e3, 38.0e3, 0.0], in 0.0..=1e10;
        /// Off-diagonal pairs of G, only between stiff degrees of freedom.
        pub stiffness_coupling: Vec<Coupling> = Vec::new();
        /// Damping ratio of the components in the broad default bank.
        /// Source: Fossen 2011, section 8.2.6: 0.05 to 0.1 for one component; six share the band.
        pub bank_damping: f64 = 0.03, in 1e-4..=1.0;
        /// Angular frequencies of the broad default bank, rad/s.
        /// Chosen: periods of 7.9 to 1.8 s, log-spaced: from the swell to the roll of a light boat.
        pub bank_omega_radps: Vec<f64> = vec![0.8, 1.06, 1.41, 1.88, 2.5, 3.4], in 0.1..=10.0;
        /// Standard deviation of the slope of each component in the bank.
        /// Source: Phillips 1958: each octave has the same slope in the saturated range; 0.04 in six bands is
        /// a significant wave height of 3 m with a slope of 5.6 deg.
        pub bank_slope_sd: f64 = 0.04, in 1e-3..=1.0;
        /// Standard deviation of the disturbance: m/s² (surge, sway), m, rad, rad, rad/s².
        /// Chosen: tuned on the simulated vessel. A floating hull has little disturbance in heave and tilt;
        /// the estimator widens it if innovations show more.
        pub disturbance_sd_mps2_m_rad_radps2: [f64; 6] =
            [0.25, 0.25, 0.004, 0.002, 0.002, 0.1], in 0.0..=10.0;
        /// Correlation time of the disturbance, s.
        pub disturbance_time_s: [f64; 6] = [2.0, 2.0, 0.5, 0.5, 0.5, 1.0], in 0.05..=1e3;
        /// Random walk of the slow state after 1 s: m/s (surge, sway), m, rad, rad, rad/s.
        /// Chosen: Small for stiff degrees of freedom: the hull responds at once, as accelerometers show.
        /// Wander of a GNSS height is not included: heave refers to the mean water level, to which a hull
        /// with constant load returns.
        pub slow_walk_mps_m_rad_radps: [f64; 6] = [0.05, 0.05, 5e-4, 5e-4, 5e-4, 0.01], in 0.0..=10.0;
        /// Initial standard deviation of the slow state, in the same units.
        pub slow_sd_mps_m_rad_radps: [f64; 6] = [2.0, 2.0, 3.0, 0.03, 0.03, 0.1], in 0.0..=100.0;
        /// Random walk of eta after 1 s, m, rad: wander of the position reference.
        /// Source: Wander of a GNSS with 1 m bias and 300 s correlation: sqrt(2/300) m.
        pub eta_walk_m_rad: [f64; 6] = [0.08, 0.08, 0.0, 0.0, 0.0, 0.0], in 0.0..=10.0;
    }
    check |this, at| {
        for (key, list) in [
            ("inertia_coupling", &this.inertia_coupling),
            ("damping_coupling", &this.damping_coupling),
            ("stiffness_coupling", &this.stiffness_coupling),
        ] {
            for c in list {
                let ok = c.row < DOFS && c.column < DOFS && c.row != c.column && c.value.is_finite();
                at.require(
                    ok,
                    key,
                    format!("{c:?}"),
                    "two different degrees of freedom 0 to 5 and a finite value",
                )?;
            }
        }
        for c in &this.stiffness_coupling {
            let ok = [c.row, c.column]
                .iter()
                .all(|&d| this.stiffness_npm_nmprad.get(d).is_some_and(|g| *g > 0.0));
            at.require(
                ok,
                "stiffness_coupling",
                format!("{c:?}"),
                "between stiff degrees of freedom",
            )?;
        }
        at.require(
            this.inertia().cholesky().is_some(),
            "inertia_kg_kgm2",
            "the given matrix",
            "a positive definite M",
        )?;
        let stiffest = (0..DOFS)
            .map(|i| this.stiffness_npm_nmprad[i] / this.inertia_kg_kgm2[i])
            .fold(0.0, f64::max);
        at.require(
            stiffest < 1e6,
            "stiffness_npm_nmprad",
            stiffest,
            "natural frequencies below 1000 rad/s",
        )?;
        at.require(
            (1..=12).contains(&this.bank_omega_radps.len()),
            "bank_omega_radps",
            this.bank_omega_radps.len(),
            "1 to 12 frequencies",
        )?;
    }
}

impl VesselModelConfig {
    fn matrix(diagonal: &[f64; 6], couplings: &[Coupling]) -> SMatrix<f64, DOFS, DOFS> {
        let mut m = SMatrix::<f64, DOFS, DOFS>::from_diagonal(&(*diagonal).into());
        for c in couplings {
            if c.row < DOFS && c.column < DOFS && c.row != c.column {
                m[(c.row, c.column)] = c.value;
                m[(c.column, c.row)] = c.value;
            }
        }
        m
    }
    /// Mass matrix M, kg, kg m².
    pub fn inertia(&self) -> SMatrix<f64, DOFS, DOFS> {
        Self::matrix(&self.inertia_kg_kgm2, &self.inertia_coupling)
    }
    /// Damping matrix D, N/(m/s), Nm/(rad/s).
    pub fn damping(&self) -> SMatrix<f64, DOFS, DOFS> {
        Self::matrix(&self.damping_npmps_nmpradps, &self.damping_coupling)
    }
    /// Stiffness matrix G, N/m, Nm/rad.
    pub fn stiffness(&self) -> SMatrix<f64, DOFS, DOFS> {
        Self::matrix(&self.stiffness_npm_nmprad, &self.stiffness_coupling)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Check, Keys};

    #[test]
    fn vessel_model_config_default_and_negative_inertia() {
        assert!(VesselModelConfig::default().check(&Keys::ROOT).is_ok());
        let mut c = VesselModelConfig::default();
        c.inertia_kg_kgm2[2] = -1.0;
        assert!(c.check(&Keys::ROOT).is_err());
    }
}
