//! Baselines: what others would fly, by the same mission, pilot and success rule.
//!
//! | planner | knows the deck by | predicts it by | descends |
//! |---|---|---|---|
//! | `mpc` | tag, radio, wave model | the predictor | at the mission's speed, no attitude alignment |
//! | `mpc-ne` ([`mpc_ne`]) | tag | Fourier modes and a Kalman filter ([`modes`]), 1 s | when predicted tilt lets it |
//!
//! Each is a [`Law`] of the flight planner. What the predictor may use and which of the mission's parameters differ is
//! in [`settings`].

mod fourier;
pub mod jerk;
pub mod modes;
pub mod mpc_ne;
pub mod settings;

#[cfg(test)]
mod tests;

use alight_shared::geometry::DroneGeometry;
use alight_uav::planner::PlannerConfig;
use alight_uav::planner::law::Law;
use serde::{Deserialize, Serialize};

use mpc_ne::MpcNe;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Baseline {
    /// The paper's MPC without attitude alignment: weights do not change with clearance.
    Mpc,
    /// Gupta et al. 2023: lands when its own prediction of the tilt allows it.
    MpcNe,
}

/// The law of `mpc`: nothing of its own.
#[derive(Debug)]
struct Mpc;
impl Law for Mpc {}

impl Baseline {
    pub const ALL: [Baseline; 2] = [Baseline::Mpc, Baseline::MpcNe];

    /// The name on the command line and in tables.
    pub const fn name(&self) -> &'static str {
        match self {
            Baseline::Mpc => "mpc",
            Baseline::MpcNe => "mpc-ne",
        }
    }
    /// Law of the baseline.
    pub fn law(&self, planner: &PlannerConfig, drone: &DroneGeometry) -> Box<dyn Law> {
        match self {
            Baseline::Mpc => Box::new(Mpc),
            Baseline::MpcNe => Box::new(MpcNe::new(&planner.reset, drone)),
        }
    }
}
