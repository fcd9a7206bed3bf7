//! What a study flies: scenes, and planners or one planner with something left out.

use alight_sim::baselines::BenchPlanner;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::physics::sea::SeaConfig;

use crate::exit::CliError;
use crate::lab::args::{SceneArgs, WindArg};
use crate::lab::scene::Scene;

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

/// The sea that the command line names, else these: names, and systems as on the command line.
pub fn seas(
    args: &SceneArgs,
    base: &Scene,
    otherwise: &[(&str, &str)],
) -> Result<Vec<(String, SeaConfig)>, CliError> {
    if args.sea.is_some() || args.sea_state.is_some() || args.scenario.is_some() {
        return Ok(vec![(base.sea.clone(), base.scenario.sea.clone())]);
    }
    let named = |(name, systems): &(&str, &str)| Ok(((*name).into(), systems.parse().map_err(CliError)?));
    otherwise.iter().map(named).collect()
}

/// The scene's settings on a hull by its table, or on the simulated one, in a sea; what the nodes know differs from it
/// unless `--draws off`.
pub fn on_hull(
    args: &SceneArgs,
    base: &Scene,
    hull: Option<&str>,
    sea: &SeaConfig,
) -> Result<StudyScene, CliError> {
    let (mut world, mut nodes) = (base.scenario.clone(), base.nodes.clone());
    world.sea = sea.clone();
    if let Some(hull) = hull {
        world
            .install_hull(&mut nodes, hull)
            .map_err(|e| CliError::because("--hull", e))?;
    }
    if args.draws.unwrap_or(true) {
        world.differ_from_belief(&mut nodes);
    }
    if args.wind == Some(WindArg::Auto) {
        world.raise_wind();
    }
    Ok(StudyScene {
        name: String::new(),
        world,
        nodes,
    })
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
