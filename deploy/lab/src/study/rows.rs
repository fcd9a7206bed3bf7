//! Rows of a study, from its file and the command line: its scenes, each flown by its planners.

use std::collections::{BTreeMap, BTreeSet};

use alight_computer::{
    config::{DroneComputerConfig, VesselComputerConfig, method::lay},
    exit::{CliError, Doing},
    terminal,
};
use alight_shared::config::{Check, Keys};
use alight_sim::harness::{
    outcome::Outcome,
    scenario::{NodeConfigs, Scenario},
};
use clap::Parser;
use serde::{Serialize, de::DeserializeOwned};
use toml::{Table, Value};

use super::definition::{Changes, Definition, PublishedResult, StudyAxis, StudyGrid};
use crate::{
    args::{PlannerChoice, SceneArgs, StudyArgs},
    scene::Scene,
};

/// Axis of the rows that are not part of a grid.
const ROWS: &str = "row";
/// Tables of configuration keys in a study's row, each named after the flag for that file.
const TABLES: [&str; 3] = ["scenario", "vessel_config", "drone_config"];

#[derive(Clone, Debug)]
pub struct StudyRow {
    pub scenario: String,
    pub planner: String,
    pub group: String,
    pub published: BTreeMap<String, PublishedResult>,
    pub world: Scenario,
    pub nodes: NodeConfigs,
}

impl StudyRow {
    pub fn of(scenario: String, world: Scenario, nodes: NodeConfigs) -> StudyRow {
        StudyRow {
            planner: nodes.planner_name().into(),
            group: scenario.clone(),
            published: BTreeMap::new(),
            scenario,
            world,
            nodes,
        }
    }
    pub fn is_of(&self, o: &Outcome) -> bool {
        (&self.scenario, &self.planner) == (&o.sea, &o.planner)
    }
    pub fn kind(&self) -> &str {
        self.nodes.planner_name()
    }
}

fn joined<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.into_iter().filter(|n| !n.is_empty()).collect();
    names.join(", ")
}

impl Changes {
    fn value(&self, flag: &str) -> Option<String> {
        let (_, value) = self.flags.iter().find(|(key, _)| subject(key) == flag)?;
        Some(match value {
            Value::String(text) => text.clone(),
            Value::Float(v) => v.to_string(),
            Value::Boolean(on) if flag == "draws" => if *on { "on" } else { "off" }.into(),
            Value::Boolean(_) => String::new(),
            Value::Integer(_) | Value::Array(_) | Value::Datetime(_) | Value::Table(_) => value.to_string(),
        })
    }
    fn arguments(&self) -> impl Iterator<Item = String> {
        let flag_text = |(key, value): (&String, &Value)| {
            if value.is_table() && TABLES.contains(&key.as_str())
                || value.as_bool() == Some(false) && key != "draws"
            {
                return None;
            }
            Some(flag_text(&key.replace('_', "-"), &self.value(&subject(key))?))
        };
        self.flags.iter().filter_map(flag_text)
    }
    fn table(&self, name: &str) -> Option<&Table> {
        self.flags.get(name).and_then(Value::as_table)
    }
}

fn flag_text(flag: &str, value: &str) -> String {
    if value.is_empty() {
        format!("--{flag}")
    } else {
        format!("--{flag}={value}")
    }
}

/// Subject of a flag or key; the flags for sea state and sea have the same subject.
fn subject(flag: &str) -> String {
    match flag {
        "sea_state" | "sea-state" => "sea".into(),
        other => other.replace('_', "-"),
    }
}

/// Keeps the choices that match the given flags; if none matches, the flags replace the choices. Without axes, only
/// flags that every row sets are compared.
fn narrow(axis: &mut StudyAxis, given: &[(&str, String)]) {
    let varied = |flag: &str| {
        let mut set = axis.choice.iter().map(|c| c.value(&subject(flag)).is_some());
        if axis.name == ROWS {
            set.all(|s| s)
        } else {
            set.any(|s| s)
        }
    };
    let own: Vec<&(&str, String)> = given.iter().filter(|(flag, _)| varied(flag)).collect();
    if own.is_empty() {
        return;
    }
    let agrees = |c: &Changes| {
        let same = |(flag, value): &&(&str, String)| c.value(&subject(flag)).as_ref() == Some(value);
        own.iter().all(same)
    };
    if axis.choice.iter().any(agrees) {
        axis.choice.retain(agrees);
        return;
    }
    let name = |(flag, value): &&(&str, String)| match value.parse::<f64>() {
        Ok(_) => format!("{} {value}", flag.replace('-', " ")),
        Err(_) => value.clone(),
    };
    axis.choice = vec![Changes {
        name: own.iter().map(name).collect::<Vec<_>>().join(" "),
        ..Changes::default()
    }];
}

#[derive(Parser)]
#[command(no_binary_name = true, args_override_self = true)]
struct SceneFlags {
    #[command(flatten)]
    scene: SceneArgs,
}

fn with<T: Serialize + DeserializeOwned + Check>(
    base: T,
    name: &str,
    changes: &[&Changes],
) -> Result<T, CliError> {
    let mut over = Table::new();
    for t in changes.iter().filter_map(|c| c.table(name)) {
        lay(t, &mut over);
    }
    if over.is_empty() {
        return Ok(base);
    }
    let mut table = Table::try_from(&base).doing(name)?;
    lay(&over, &mut table);
    let changed: T = table.try_into().doing(name)?;
    changed.check(&Keys::ROOT)?;
    Ok(changed)
}

/// Scene of the command line's flags with changes applied; later changes take precedence.
fn scene(given: &[(&str, String)], changes: &[&Changes], planner: &Changes) -> Result<Scene, CliError> {
    let given = given.iter().map(|(flag, value)| flag_text(flag, value));
    let arguments = changes
        .iter()
        .flat_map(|c| c.arguments())
        .chain(given)
        .chain(planner.arguments());
    let flags = SceneFlags::try_parse_from(arguments).map_err(|e| {
        let why = e.to_string();
        CliError(why.lines().next().unwrap_or_default().replace("error: ", ""))
    })?;
    let mut scene = Scene::unremarked(&flags.scene)?;
    let changes = [changes, &[planner]].concat();
    scene.scenario = with(scene.scenario, TABLES[0], &changes)?;
    let nodes = &mut scene.nodes;
    let vessel = VesselComputerConfig {
        vessel: nodes.vessel.clone(),
        deck: nodes.deck.clone(),
        ..VesselComputerConfig::default()
    };
    let vessel = with(vessel, TABLES[1], &changes)?;
    nodes.vessel = vessel.vessel;
    nodes.deck = vessel.deck;
    let drone = DroneComputerConfig {
        bridge: nodes.bridge.clone(),
        autopilot: nodes.autopilot.clone(),
        drone: nodes.drone.clone(),
        ..DroneComputerConfig::default()
    };
    let drone = with(drone, TABLES[2], &changes)?;
    nodes.bridge = drone.bridge;
    nodes.autopilot = drone.autopilot;
    nodes.drone = drone.drone;
    if changes.iter().any(|c| c.as_configured) {
        scene.describe();
    }
    let vessel = &mut scene.scenario.vessel;
    if changes.iter().any(|c| c.powered) {
        vessel.power();
    }
    scene.scenario.check(&Keys::ROOT)?;
    Ok(scene)
}

fn combinations(axes: &[StudyAxis]) -> Vec<Vec<&Changes>> {
    let mut rows: Vec<Vec<&Changes>> = vec![Vec::new()];
    for axis in axes {
        let longer = rows
            .iter()
            .flat_map(|row| axis.choice.iter().map(|c| [&row[..], &[c]].concat()));
        rows = longer.collect();
    }
    rows
}

/// Planners of the command line, otherwise the study's, otherwise the configured planner.
fn planners(definition: &Definition, wanted: &[PlannerChoice]) -> Result<Vec<Changes>, CliError> {
    let mut all: Vec<Changes> = Vec::new();
    for name in wanted.iter().map(PlannerChoice::to_string) {
        if all.iter().all(|c| c.name != name) {
            all.push(Changes {
                flags: Table::from_iter([("planner".into(), name.clone().into())]),
                name,
                ..Changes::default()
            });
        }
    }
    if all.is_empty() {
        all.clone_from(&definition.planner);
    }
    for planner in &all {
        let mut keys = planner.flags.keys();
        if planner.as_configured || planner.powered || keys.any(|k| k != "planner" && k != TABLES[2]) {
            return Err(CliError(format!(
                "the planner `{}`: only `planner` and `drone_config` may differ among planners; put the rest into rows",
                planner.name
            )));
        }
    }
    if all.is_empty() {
        all.push(Changes::default());
    }
    Ok(all)
}

pub struct Rows {
    pub rows: Vec<StudyRow>,
    /// No flag has removed a scene.
    pub whole: bool,
    /// Number of the study's scenes.
    pub scenes: usize,
}

impl Rows {
    pub fn keep(&mut self, number: u32) -> Result<(), CliError> {
        let count = self.rows.len();
        let index = number as usize - 1;
        if index >= count {
            return Err(CliError(format!("--row {number}: there are {count} rows")));
        }
        self.rows = vec![self.rows.swap_remove(index)];
        self.whole = false;
        Ok(())
    }
}

pub fn expand(definition: &Definition, args: &StudyArgs) -> Result<Rows, CliError> {
    let given = args.scene.given();
    let planners = planners(definition, &args.planners)?;
    let rows = StudyAxis {
        name: ROWS.into(),
        choice: definition.row.clone(),
    };
    let rows = (!definition.row.is_empty()).then(|| StudyGrid { axis: vec![rows] });
    let mut grids: Vec<StudyGrid> = rows.into_iter().chain(definition.grid.iter().cloned()).collect();
    let count = |grids: &[StudyGrid]| grids.iter().map(|g| combinations(&g.axis).len()).sum::<usize>();
    let all = count(&grids);
    for axis in grids.iter_mut().flat_map(|g| &mut g.axis) {
        narrow(axis, &given);
    }
    let mut out = Rows {
        rows: Vec::new(),
        whole: count(&grids) == all,
        scenes: all,
    };
    let mut names = BTreeSet::new();
    let mut remarks = BTreeSet::new();
    for grid in &grids {
        let pooled = grid
            .axis
            .iter()
            .position(|a| Some(&a.name) == definition.pooled_by.as_ref());
        for choices in combinations(&grid.axis) {
            let name = joined(choices.iter().map(|c| c.name.as_str()));
            if !names.insert(name.clone()) {
                return Err(CliError(format!(
                    "two rows are called `{name}`; give each a unique name"
                )));
            }
            let changes = [&[&definition.all][..], &choices].concat();
            for planner in &planners {
                let scene = scene(&given, &changes, planner).doing(format_args!("the row `{name}`"))?;
                remarks.extend(scene.remarks);
                let mut row = StudyRow::of(name.clone(), scene.scenario, scene.nodes);
                row.published = choices.iter().flat_map(|c| c.published.clone()).collect();
                if let Some(choice) = pooled.and_then(|k| choices.get(k)) {
                    row.group = choice.name.clone();
                }
                if !planner.name.is_empty() {
                    row.planner = planner.name.clone();
                }
                out.rows.push(row);
            }
        }
    }
    for r in &remarks {
        terminal::note(true, r);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::{
        super::definition::{parse, tests::shipped},
        *,
    };
    use crate::args::typed;
    use alight_sim::physics::vessel::VesselCourse;

    fn expanded(definition: &Definition, arguments: &str) -> Result<Vec<StudyRow>, CliError> {
        let arguments = ["study", "x"].into_iter().chain(arguments.split_whitespace());
        expand(definition, &typed(arguments)).map(|e| e.rows)
    }
    fn of(name: &str) -> Definition {
        shipped().find(|(n, _)| *n == name).unwrap().1
    }

    #[test]
    fn shipped_studies_have_rows_that_differ() {
        for (name, definition) in shipped() {
            let rows = expanded(&definition, "").unwrap_or_else(|e| panic!("{name}: {e}"));
            for (k, a) in rows.iter().enumerate() {
                let same = |b: &&StudyRow| (&a.world, &a.nodes) == (&b.world, &b.nodes);
                let twin = rows[..k].iter().find(same).map(|b| (&b.scenario, &b.planner));
                assert!(twin.is_none(), "{name}: {} {} is {twin:?}", a.scenario, a.planner);
            }
        }
    }

    #[test]
    fn sizes_of_world_and_nodes() {
        for row in expanded(&of("size"), "").unwrap() {
            let world = &row.world;
            let nodes = &row.nodes;
            let name = &row.scenario;
            assert_eq!(
                (world.deck, nodes.vessel.deck),
                (nodes.drone.deck, nodes.drone.deck),
                "{name}"
            );
            assert_eq!(world.airframe, nodes.drone.airframe, "{name}");
            assert!(world.deck.largest_tag_m() < world.deck.width_m, "{name}");
        }
    }

    #[test]
    fn flags_next_to_the_rows() {
        let names = |study: &str, arguments: &str| -> Vec<String> {
            let rows = expanded(&of(study), arguments).unwrap();
            rows.into_iter().map(|r| r.scenario).collect()
        };
        assert_eq!(names("wind", "--wind 5"), ["5 m/s"]);
        assert_eq!(names("wind", "--wind 6"), ["wind 6"]);
        assert_eq!(names("wind", "--sea rough").len(), 7);
        assert_eq!(names("seas", "--hull mono-5m").len(), 6);
        assert_eq!(
            names("seas", "--hull mono-5m --sea-state 3"),
            ["mono-5m, sea state 3"]
        );
        let moving = names("moving", "--vessel straight --speed 7");
        assert!(
            moving.len() == 10 && moving.iter().all(|n| n.starts_with("straight 7 m/s, ")),
            "{moving:?}"
        );
        let rows = expanded(&of("moving"), "--vessel drift --draws off").unwrap();
        assert!(
            rows.len() == 10
                && rows
                    .iter()
                    .all(|r| !r.world.draws.on && r.world.vessel.course == VesselCourse::Drift)
        );
    }

    #[test]
    fn own_study_changes_flags_and_files() {
        let text = "title = \"ours\"\n[[row]]\nname = \"a\"\nsea_state = 2\nvessel = \"straight\"\nspeed = 1\n\
                    scenario.start.warm_up_s = 30\ndrone_config.drone.mission.steady_s = 3.0\n";
        let rows = expanded(&parse(text, "own").unwrap(), "--planners alight,mpc").unwrap();
        assert_eq!(
            rows.iter().map(|r| r.planner.as_str()).collect::<Vec<_>>(),
            ["alight", "mpc"]
        );
        for row in rows {
            assert_eq!(
                (row.world.start.warm_up_s, row.world.vessel.speed_mps),
                (30.0, 1.0)
            );
            assert_eq!(row.nodes.drone.mission.steady_s, 3.0);
        }
        let text = "title = \"ours\"\n[[row]]\nname = \"a\"\n[[row]]\nname = \"b\"\nwind = 6\n";
        let rows = expanded(&parse(text, "own").unwrap(), "--wind 8").unwrap();
        assert!(rows.len() == 2 && rows.iter().all(|r| r.world.drone.wind.mean_mps == 8.0));
        for (text, why) in [
            ("see = \"rough\"", "--see"),
            ("sea = \"stormy\"", "stormy"),
            ("scenario.sea.height = 1", "height"),
            ("drone_config.drone.airframe.mass_kg = -1", "mass_kg"),
            ("table.sea = 1", "--table"),
        ] {
            let own = parse(&format!("title = \"ours\"\n[[row]]\nname = \"a\"\n{text}"), "own").unwrap();
            let e = expanded(&own, "").unwrap_err().0;
            assert!(e.contains(why) && e.contains("the row `a`"), "{e}");
        }
    }
}
