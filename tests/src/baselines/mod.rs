//! Baseline planners, flown with the same mission, pilot and success criteria as Alight's planner.
//!
//! | planner | deck from | prediction by | descent |
//! |---|---|---|---|
//! | `mpc` | tag, radio, wave model | the predictor | at the mission's speed, no attitude alignment |
//! | `mpc-ne` ([`mpc_ne`]) | tag | Fourier modes and a Kalman filter ([`modes`]), 1 s | when the predicted tilt permits it |
//!
//! Each is a [`Law`] of the flight planner. [`settings`] has the baseline's predictor and mission settings.
//! [`own`] flies a law that the caller supplies.

mod fourier;
pub mod jerk;
pub mod modes;
pub mod mpc_ne;
pub mod own;
pub mod settings;

#[cfg(test)]
mod tests;

use alight_shared::geometry::DroneGeometry;
use alight_uav::planner::{PlannerConfig, law::Law};
use serde::{Deserialize, Serialize};

use mpc_ne::MpcNe;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Baseline {
    /// The paper's MPC without attitude alignment: weights do not depend on clearance.
    Mpc,
    /// Gupta et al. 2023: lands when its prediction of the tilt permits it.
    MpcNe,
}

#[derive(Debug)]
struct Mpc;
impl Law for Mpc {}

impl Baseline {
    pub const ALL: [Baseline; 2] = [Baseline::Mpc, Baseline::MpcNe];

    pub const fn name(&self) -> &'static str {
        match self {
            Baseline::Mpc => "mpc",
            Baseline::MpcNe => "mpc-ne",
        }
    }
    pub fn law(&self, planner: &PlannerConfig, drone: &DroneGeometry) -> Box<dyn Law> {
        match self {
            Baseline::Mpc => Box::new(Mpc),
            Baseline::MpcNe => Box::new(MpcNe::new(&planner.reset, drone)),
        }
    }
}
