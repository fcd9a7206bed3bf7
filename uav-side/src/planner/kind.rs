//! Kinds of planner, each with its own law and state.

use alight_shared::geometry::DroneGeometry;

use super::alignment::FaaAlignment;
use super::config::{PlannerConfig, PlannerKind};
use super::law::Law;
use super::rendezvous::Rendezvous;

/// The planner that flies, with what it remembers.
#[derive(Debug)]
pub enum Kind {
    /// `mpc-faa`.
    MpcFaa(FaaAlignment),
    /// `alight`.
    Alight(Box<Rendezvous>),
    /// A law from elsewhere: the baselines of the bench.
    Other(Box<dyn Law>),
}

impl Kind {
    /// The kind that the configuration names.
    pub fn new(config: &PlannerConfig, drone: &DroneGeometry) -> Self {
        match config.kind {
            PlannerKind::MpcFaa => Kind::MpcFaa(FaaAlignment::new(&config.faa, drone)),
            PlannerKind::Alight => Kind::Alight(Box::new(Rendezvous::new(config, drone))),
        }
    }
    /// Its law.
    pub fn law(&self) -> &dyn Law {
        match self {
            Kind::MpcFaa(law) => law,
            Kind::Alight(law) => law.as_ref(),
            Kind::Other(law) => law.as_ref(),
        }
    }
    /// The same, to be used.
    pub fn law_mut(&mut self) -> &mut dyn Law {
        match self {
            Kind::MpcFaa(law) => law,
            Kind::Alight(law) => law.as_mut(),
            Kind::Other(law) => law.as_mut(),
        }
    }
}
