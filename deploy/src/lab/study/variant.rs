//! What is compared within a study: planners, or one planner with something left out.

use alight_sim::harness::scenario::NodeConfigs;
use alight_uav::planner::PlannerKind;
use clap::ValueEnum;

use crate::lab::args::Planner;

/// A change of the nodes' configurations.
pub type Change = fn(&mut NodeConfigs);

/// A planner as a study flies it.
#[derive(Clone, Debug)]
pub struct PlannerVariant {
    /// Its name in tables and rows.
    pub name: String,
    /// The planner.
    pub kind: PlannerKind,
    /// What is different from the shipped configuration.
    pub change: Option<Change>,
}

impl PlannerVariant {
    /// Of a row that was flown elsewhere: by the planner's name, or by that before a comma.
    pub fn named(name: &str) -> Self {
        let kind = name.split(',').next().and_then(|first| {
            Planner::value_variants()
                .iter()
                .map(|p| p.kind())
                .find(|k| k.name() == first)
        });
        PlannerVariant {
            name: name.into(),
            kind: kind.unwrap_or_default(),
            change: None,
        }
    }
    /// The nodes that it needs, from those of a row.
    pub fn nodes(&self, row: &NodeConfigs) -> NodeConfigs {
        let mut nodes = row.clone();
        nodes.drone.planner.kind = self.kind;
        if let Some(change) = self.change {
            change(&mut nodes);
        }
        nodes
    }
}

impl From<PlannerKind> for PlannerVariant {
    fn from(kind: PlannerKind) -> Self {
        PlannerVariant {
            name: kind.name().into(),
            kind,
            change: None,
        }
    }
}
