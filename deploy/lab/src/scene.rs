use std::path::Path;

use alight_computer::{
    config::{
        DroneComputerConfig, VesselComputerConfig,
        method::{self, Tuning},
        view::ViewConfig,
    },
    exit::{CliError, Exit},
    terminal,
};
use alight_shared::{
    config::{self, Check, Keys, commented},
    msg::LandingMode,
};
use alight_sim::{
    harness::{
        outcome::TIME_LIMIT_S,
        scenario::{NodeConfigs, Scenario},
        storm::{Fault, FaultKind, Moment},
    },
    physics::{deck_motion::DeckMotionConfig, sea::SeaConfig},
};
use alight_uav::autopilot::modes::Firmware;
use serde::de::DeserializeOwned;

use crate::{
    args::{AutopilotArg, SceneArgs, WindArg},
    exec,
};

pub fn print_defaults() -> Result<Exit, CliError> {
    let text = commented(&Scenario::default());
    let text = text.map_err(|e| CliError::because("writing the scenario as TOML", e))?;
    terminal::line(text.trim_end());
    Ok(Exit::Success)
}

pub struct Scene {
    pub scenario: Scenario,
    pub nodes: NodeConfigs,
    pub sea: String,
    pub flags: String,
    pub remarks: Vec<String>,
    /// The drone's crew uses knots for winds and speeds.
    pub knots: bool,
}

impl Scene {
    /// Reads the files, applies the flags, checks everything, and prints the remarks.
    pub fn of(args: &SceneArgs) -> Result<Scene, CliError> {
        let scene = Scene::unremarked(args)?;
        // Standard output contains only the result.
        for r in &scene.remarks {
            terminal::note(true, r);
        }
        Ok(scene)
    }

    pub fn unremarked(args: &SceneArgs) -> Result<Scene, CliError> {
        let mut remarks = Vec::new();
        let mut scenario: Scenario = match &args.scenario {
            Some(path) => config::load(path)?,
            None => Scenario::default(),
        };
        let (mut nodes, knots) = configured(args, &mut remarks)?;
        if args.scenario.is_none() {
            // The deck has the tags of the drone's file.
            scenario.deck = scenario.deck.with_tags(&nodes.drone.tags());
        }
        remarks.extend(airframe_remark(args, &scenario, &nodes));
        nodes.predictor = args.predictor.as_deref().map(exec::predictor::predictor);
        let mut sea = set_sea(args, &mut scenario);
        set_vehicles(args, &mut scenario, &mut nodes)?;
        set_conditions(args, &mut scenario);
        if set_deck_motion(args, &mut scenario, &mut remarks)? {
            sea = "with the deck".into();
        }
        scenario.sensors.render.on |= args.render_camera;
        scenario.check(&Keys::ROOT)?;
        let given = args.given().into_iter().filter(|(name, _)| *name != "planner");
        let planner = ("planner", nodes.planner_name().to_string());
        let flags: Vec<String> = given.chain([planner]).map(|(n, v)| written(n, &v)).collect();
        Ok(Scene {
            flags: flags.join(" "),
            scenario,
            nodes,
            sea,
            remarks,
            knots,
        })
    }
    /// View of the scene: every viewer of the page may abort a simulated landing.
    pub fn view(&self) -> ViewConfig {
        ViewConfig {
            abort: true,
            knots: self.knots,
            ..ViewConfig::default()
        }
    }
    /// Sets the world according to the configurations: deck, keep-out volumes, airframe, sensor positions.
    pub fn describe(&mut self) {
        let world = &mut self.scenario;
        let nodes = &self.nodes;
        world.describe(
            &nodes.drone.deck,
            &nodes.vessel.surroundings,
            &nodes.drone.airframe,
        );
        world.sensors.vessel_gnss.antenna_m = nodes.vessel.gnss.antenna_m;
        world.sensors.vessel_imu.lever_arm_m = nodes.vessel.imu.lever_arm_m;
        world.drone.contact.friction = nodes.drone.mission.friction;
    }
}

/// Remark if the drone differs from the description in its file.
fn airframe_remark(args: &SceneArgs, scenario: &Scenario, nodes: &NodeConfigs) -> Option<String> {
    let flies = &scenario.airframe;
    let believed = &nodes.drone.airframe;
    (args.drone_config.is_some() && flies != believed).then(|| {
        format!(
            "the drone flies with the [airframe] of --scenario ({} kg), and --drone-config gives \
             ({} kg): set both alike, unless the difference is intended",
            flies.mass_kg, believed.mass_kg
        )
    })
}

fn set_sea(args: &SceneArgs, scenario: &mut Scenario) -> String {
    if let Some(given) = &args.sea {
        scenario.sea = given.config.clone();
        return given.text.clone();
    }
    if let Some(state) = args.sea_state {
        scenario.sea = SeaConfig::of_sea_state(state).unwrap_or_default();
        return format!("sea state {state}");
    }
    if args.scenario.is_some() {
        return "scenario".into();
    }
    if args.hull.is_some() {
        scenario.sea = SeaConfig::jonswap(1.0, 5.0);
        return "jonswap:1,5".into();
    }
    "moderate".into()
}

/// Applies the flags for hull, planner, autopilot and course, and draws the differences from the nodes' assumptions.
fn set_vehicles(args: &SceneArgs, scenario: &mut Scenario, nodes: &mut NodeConfigs) -> Result<(), CliError> {
    if let Some(hull) = &args.hull {
        let installed = scenario.install_hull(nodes, hull);
        installed.map_err(|e| CliError::because("--hull", e))?;
    }
    if let Some(planner) = &args.planner {
        planner.select(nodes);
    }
    if let Some(autopilot) = args.autopilot {
        scenario.drone.autopilot.firmware = match autopilot {
            AutopilotArg::Px4 => Firmware::Px4,
            AutopilotArg::Ardupilot => Firmware::ArduCopter,
        };
    }
    if let Some(course) = args.vessel {
        scenario.vessel.course = course.into();
    }
    if let Some(speed) = args.speed {
        if !scenario.vessel.course.is_under_way() {
            return Err(CliError(format!(
                "--speed {speed}: the vessel is not under way and has no speed; name her course with --vessel \
                 straight, square, zigzag, turn or speed-change"
            )));
        }
        scenario.vessel.speed_mps = speed;
        // The default hull's engines reach 2.2 m/s.
        if args.hull.is_none() {
            scenario.vessel.power();
        }
    }
    if args.draws.unwrap_or(args.hull.is_some() || scenario.draws.on) {
        scenario.differ_from_belief(nodes)
    } else {
        scenario.draws.on = false
    }
    Ok(())
}

fn set_conditions(args: &SceneArgs, scenario: &mut Scenario) {
    match args.wind {
        None => {}
        Some(WindArg::Mean(wind)) => scenario.drone.wind.mean_mps = wind,
        Some(WindArg::Auto) => scenario.raise_wind(),
    }
    if let Some(stay_s) = args.stay {
        scenario.stay_s = stay_s;
    }
    scenario.begin_anyway |= args.begin_anyway;
    if let Some(outage) = args.outage_at {
        let lasts_s = args.outage_duration.unwrap_or(f64::INFINITY);
        let lost = |state| Fault::new(FaultKind::RadioLost, Moment::In(state), 0.0, lasts_s);
        scenario.faults.retain(|f| f.kind != FaultKind::RadioLost);
        scenario.faults.extend(outage.0.map(lost));
    }
}

/// Sets the recorded motion of the deck from its file; returns whether the water follows the deck.
fn set_deck_motion(
    args: &SceneArgs,
    scenario: &mut Scenario,
    remarks: &mut Vec<String>,
) -> Result<bool, CliError> {
    if let Some(path) = &args.deck_motion {
        let default = DeckMotionConfig::default();
        scenario.deck_motion = Some(DeckMotionConfig {
            file: path.into(),
            scale: args.motion_scale.unwrap_or(default.scale),
            speed: args.motion_speed.unwrap_or(default.speed),
            start_s: args.motion_start.unwrap_or(default.start_s),
            keep_mean: args.keep_mean || default.keep_mean,
            ..default
        });
    }
    let trial_s = scenario.start.warm_up_s + TIME_LIMIT_S;
    let Some(motion) = &mut scenario.deck_motion else {
        return Ok(false);
    };
    let Some(facts) = motion.facts(trial_s).map_err(|e| CliError(e.to_string()))? else {
        return Ok(false);
    };
    let file = motion.file.display();
    remarks.extend(facts.remarks.iter().map(|r| format!("{file}: {r}")));
    let is_sea_given = args.sea.is_some() || args.sea_state.is_some() || args.scenario.is_some();
    if facts.heave && !is_sea_given {
        motion.water_follows = true;
        scenario.sea = SeaConfig::paper(0.0, 5.0);
        return Ok(true);
    }
    if facts.heave && args.deck_motion.is_some() {
        remarks.push(format!(
            "{file}: the deck heaves, and the water of the given sea does not follow it: the deck may \
             sink into the water; without --sea, --sea-state and --scenario the water follows"
        ));
    }
    Ok(false)
}

pub fn written(name: &str, value: &str) -> String {
    match value {
        "" => format!("--{name}"),
        v => format!("--{name} {}", quoted(v)),
    }
}

/// Argument quoted for a shell.
pub fn quoted(argument: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./,:=+%@".contains(c);
    if !argument.is_empty() && argument.chars().all(plain) {
        argument.into()
    } else {
        format!("'{}'", argument.replace('\'', "'\\''"))
    }
}

/// Nodes configured by the files of the computers and of the tuning, and whether the drone's crew uses knots.
fn configured(args: &SceneArgs, remarks: &mut Vec<String>) -> Result<(NodeConfigs, bool), CliError> {
    let tuning = args.tuning.as_deref().map(Tuning::load).transpose()?;
    let tuning = tuning.unwrap_or_default();
    let vessel: VesselComputerConfig = tuning.over(computer(args.vessel_config.as_deref())?)?;
    let mut drone: DroneComputerConfig = tuning.over(computer(args.drone_config.as_deref())?)?;
    let mode = &mut drone.drone.mission.mode;
    if *mode == LandingMode::Shadow {
        remarks.push(
            "--drone-config has drone.mission.mode = \"shadow\", in which a pilot flies: the simulation flies \"land\""
                .into(),
        );
        *mode = LandingMode::Land;
    }
    let nodes = NodeConfigs {
        vessel: vessel.vessel,
        deck: vessel.deck,
        bridge: drone.bridge,
        autopilot: drone.autopilot,
        drone: drone.drone,
        baseline: None,
        own: None,
        predictor: None,
    };
    Ok((nodes, drone.view.knots))
}

/// Configuration of a computer, with defaults if there is no file. If the file is a hull's, the error names the right
/// flag.
fn computer<T: DeserializeOwned + Check + Default>(file: Option<&Path>) -> Result<T, CliError> {
    let Some(path) = file else {
        return Ok(T::default());
    };
    method::load(path).map_err(|e| {
        let table = path.with_extension("csv");
        if !table.exists() {
            return e.into();
        }
        CliError(format!(
            "{e}\na hull's file is given with --hull {}",
            table.display()
        ))
    })
}

/// Seconds since the call, by the computer's clock: only displayed, never used.
#[allow(clippy::disallowed_methods)]
pub fn stopwatch() -> impl Fn() -> f64 {
    let start = std::time::Instant::now();
    move || start.elapsed().as_secs_f64()
}
