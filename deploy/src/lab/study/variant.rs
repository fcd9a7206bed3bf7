//! What a study flies: scenes, and planners or one planner with something left out.

use alight_sim::baselines::BenchPlanner;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};

/// One scene of a study.
#[derive(Clone)]
pub struct StudyScene {
    /// Its name in tables.
    pub name: String,
    /// The world.
    pub world: Scenario,
    /// The nodes.
    pub nodes: NodeConfigs,
}

/// Makes a row: its name, and what it changes in the scene.
pub type MakeScene<'a> = &'a dyn Fn(&str, &dyn Fn(&mut Scenario)) -> StudyScene;

/// A change of the nodes' configurations.
pub type Change = fn(&mut NodeConfigs);

/// A planner as a study flies it.
#[derive(Clone, Debug)]
pub struct PlannerVariant {
    /// Its name in tables and rows.
    pub name: String,
    /// The planner.
    pub kind: BenchPlanner,
    /// What is different from the shipped configuration.
    pub change: Option<Change>,
}

impl PlannerVariant {
    /// Of a row that was flown elsewhere: by the planner's name, or by that before a comma.
    pub fn named(name: &str) -> Self {
        let kind = name.split(',').next().and_then(BenchPlanner::named);
        PlannerVariant {
            name: name.into(),
            kind: kind.unwrap_or_default(),
            change: None,
        }
    }
    /// The nodes that it needs, from those of a row.
    pub fn nodes(&self, row: &NodeConfigs) -> NodeConfigs {
        let mut nodes = row.clone();
        nodes.select(self.kind);
        if let Some(change) = self.change {
            change(&mut nodes);
        }
        nodes
    }
}

impl From<BenchPlanner> for PlannerVariant {
    fn from(kind: BenchPlanner) -> Self {
        PlannerVariant {
            name: kind.name().into(),
            kind,
            change: None,
        }
    }
}
