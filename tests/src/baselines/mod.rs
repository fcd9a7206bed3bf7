//! Baselines: what others would fly, by the same mission, pilot and success rule.
//!
//! | planner | knows the deck by | predicts it by | descends |
//! |---|---|---|---|
//! | `mpc` | tag, radio, wave model | the predictor | at the mission's speed, no attitude alignment |
//! | `mpc-ne` ([`mpc_ne`]) | tag | Fourier modes and a Kalman filter ([`modes`]), 1 s | when predicted tilt lets it |
//! | `wait-calm` ([`wait_calm`]) | tag, radio, wave model | the predictor | in a predicted calm |
//! | `precision-land` ([`precision_land`]) | tag | not at all | at constant speed over the earth |
//! | `gnss-radio` ([`gnss_radio`]) | radio | constant velocity | at the mission's speed |
//!
//! Each is a [`Law`] of the flight planner. All but `mpc-ne` limit the [`View`]: the deck as their law believes
//! it and what they make of the mission's permission. The common references and the MPC without attitude
//! alignment do the rest. What the predictor may use and which of the mission's parameters differ is in
//! [`settings`].

pub mod config;
mod fourier;
pub mod gnss_radio;
pub mod jerk;
pub mod modes;
pub mod mpc_ne;
pub mod precision_land;
pub mod settings;
pub mod wait_calm;

#[cfg(test)]
mod tests;

use alight_shared::geometry::DroneGeometry;
use alight_uav::planner::law::Law;
use alight_uav::planner::{PlannerConfig, PlannerKind};
use serde::{Deserialize, Serialize};

use config::{GnssRadioConfig, MpcNeConfig, PrecisionLandConfig, WaitCalmConfig};
use gnss_radio::GnssRadio;
use mpc_ne::MpcNe;
use precision_land::PrecisionLand;
use wait_calm::WaitCalm;

/// A baseline with its parameters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Baseline {
    /// The paper's MPC without attitude alignment: weights do not change with clearance.
    Mpc,
    /// Gupta et al. 2023: lands when its own prediction of the tilt allows it.
    MpcNe(MpcNeConfig),
    /// `mpc` that descends only in a predicted calm.
    WaitCalm(WaitCalmConfig),
    /// Precision landing of today's autopilots.
    PrecisionLand(PrecisionLandConfig),
    /// Position by radio, constant velocity.
    GnssRadio(GnssRadioConfig),
}

/// The law of `mpc`: nothing of its own.
#[derive(Debug)]
struct Mpc;
impl Law for Mpc {}

impl Baseline {
    /// All of them with their default parameters.
    pub fn all() -> [Baseline; 5] {
        [
            Baseline::Mpc,
            Baseline::MpcNe(MpcNeConfig::default()),
            Baseline::WaitCalm(WaitCalmConfig::default()),
            Baseline::PrecisionLand(PrecisionLandConfig::default()),
            Baseline::GnssRadio(GnssRadioConfig::default()),
        ]
    }
    /// The name on the command line and in tables.
    pub const fn name(&self) -> &'static str {
        match self {
            Baseline::Mpc => "mpc",
            Baseline::MpcNe(_) => "mpc-ne",
            Baseline::WaitCalm(_) => "wait-calm",
            Baseline::PrecisionLand(_) => "precision-land",
            Baseline::GnssRadio(_) => "gnss-radio",
        }
    }
    /// Its law.
    pub fn law(&self, planner: &PlannerConfig, drone: &DroneGeometry) -> Box<dyn Law> {
        match *self {
            Baseline::Mpc => Box::new(Mpc),
            Baseline::MpcNe(c) => Box::new(MpcNe::new(&c, &planner.reset, drone)),
            Baseline::WaitCalm(c) => Box::new(WaitCalm::new(&c, drone)),
            Baseline::PrecisionLand(c) => Box::new(PrecisionLand::new(&c, drone)),
            Baseline::GnssRadio(c) => Box::new(GnssRadio::new(&c)),
        }
    }
}

/// A planner that the bench flies.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "one for a whole trial")]
pub enum BenchPlanner {
    /// One that a drone carries.
    Flight(PlannerKind),
    /// One to compare with.
    Baseline(Baseline),
}

impl BenchPlanner {
    /// The name on the command line and in tables.
    pub const fn name(&self) -> &'static str {
        match self {
            BenchPlanner::Flight(kind) => kind.name(),
            BenchPlanner::Baseline(baseline) => baseline.name(),
        }
    }
    /// The planner of that name.
    pub fn named(name: &str) -> Option<BenchPlanner> {
        let flight = [PlannerKind::MpcFaa, PlannerKind::Alight].map(BenchPlanner::Flight);
        let baselines = Baseline::all().map(BenchPlanner::Baseline);
        flight.into_iter().chain(baselines).find(|p| p.name() == name)
    }
}

impl Default for BenchPlanner {
    fn default() -> Self {
        BenchPlanner::Flight(PlannerKind::default())
    }
}
