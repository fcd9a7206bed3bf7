//! From flags and files to a scenario and the configuration of the nodes.

use std::path::Path;

use alight_shared::config::{self, Check, Keys, commented};
use alight_sim::harness::scenario::{NodeConfigs, Scenario, StateOutage};
use alight_sim::physics::deck_motion;

use clap::ValueEnum;

use crate::config::{DroneComputer, VesselComputer};
use crate::exit::{CliError, Exit};
use crate::lab::args::{Course, SceneArgs};
use crate::terminal;

/// The configuration of all nodes, as the files of their computers have it; defaults without.
pub fn nodes(vessel: Option<&Path>, drone: Option<&Path>) -> Result<NodeConfigs, CliError> {
    let vessel: VesselComputer = vessel.map(config::load).transpose()?.unwrap_or_default();
    let drone: DroneComputer = drone.map(config::load).transpose()?.unwrap_or_default();
    Ok(NodeConfigs {
        vessel: vessel.vessel,
        bridge: drone.bridge,
        drone: drone.drone,
        baseline: None,
    })
}

/// Prints the simulated world's configuration with every default.
pub fn print_defaults() -> Result<Exit, CliError> {
    let text = commented(&Scenario::default());
    let text = text.map_err(|e| CliError::because("writing the scenario as TOML", e))?;
    terminal::line(text.trim_end());
    Ok(Exit::Success)
}

/// What is flown.
pub struct Scene {
    /// The world.
    pub scenario: Scenario,
    /// The nodes.
    pub nodes: NodeConfigs,
    /// The sea as the person named it.
    pub sea: String,
    /// The flags that lead to this scene, for a replay command.
    pub flags: String,
}

fn quoted(path: &Path) -> String {
    format!("'{}'", path.display())
}

impl Scene {
    /// Files first, then flags over them; everything checked.
    pub fn of(args: &SceneArgs) -> Result<Scene, CliError> {
        let mut flags = Vec::new();
        let mut flag = |name: &str, value: String| flags.push(format!("--{name} {value}"));
        let mut scenario = match &args.scenario {
            Some(path) => {
                flag("scenario", quoted(path));
                config::load::<Scenario>(path).map_err(|e| CliError(e.to_string()))?
            }
            None => Scenario::default(),
        };
        let mut nodes = self::nodes(args.vessel_config.as_deref(), args.drone_config.as_deref())?;
        if let Some(path) = &args.vessel_config {
            flag("vessel-config", quoted(path));
        }
        if let Some(path) = &args.drone_config {
            flag("drone-config", quoted(path));
        }
        let mut sea = if args.scenario.is_some() {
            "scenario".to_string()
        } else {
            "moderate".into()
        };
        if let Some(given) = &args.sea {
            flag("sea", given.text.clone());
            scenario.sea = given.config.clone();
            sea.clone_from(&given.text);
        }
        if let Some(planner) = args.planner {
            nodes.select(planner.kind());
        }
        flag("planner", nodes.bench_planner().name().into());
        if let Some(course) = args.vessel {
            use alight_sim::physics::vessel::Course as Motion;
            flag("vessel", format!("{course:?}").to_lowercase());
            scenario.vessel.course = match course {
                Course::Drift => Motion::Drift,
                Course::Straight => Motion::Straight,
                Course::Square => Motion::Square,
            };
        }
        if let Some(speed) = args.speed {
            flag("speed", speed.to_string());
            scenario.vessel.speed_mps = speed;
        }
        if let Some(wind) = args.wind {
            flag("wind", wind.to_string());
            scenario.drone.wind.mean_mps = wind;
        }
        if let Some(lost) = args.radio_lost {
            scenario.radio_outage = lost.state().map(|state| StateOutage {
                state,
                after_s: 0.0,
                duration_s: args.radio_back.unwrap_or(f64::INFINITY),
            });
            let name = lost
                .to_possible_value()
                .map_or_else(String::new, |v| v.get_name().into());
            flag("radio-lost", name);
            if let Some(back) = args.radio_back {
                flag("radio-back", back.to_string());
            }
        }
        if let Some(path) = &args.deck_motion {
            let mut motion = deck_motion::DeckMotionConfig {
                file: path.clone(),
                ..Default::default()
            };
            flag("deck-motion", quoted(path));
            if let Some(scale) = args.motion_scale {
                flag("motion-scale", scale.to_string());
                motion.scale = scale;
            }
            if let Some(speed) = args.motion_speed {
                flag("motion-speed", speed.to_string());
                motion.speed = speed;
            }
            if let Some(start) = args.motion_start {
                flag("motion-start", start.to_string());
                motion.start_s = start;
            }
            if args.keep_mean {
                flags.push("--keep-mean".into());
                motion.keep_mean = true;
            }
            scenario.deck_motion = Some(motion);
        }
        if args.pixels {
            flags.push("--pixels".into());
            scenario.sensors.render.on = true;
        }
        scenario.check(&Keys::ROOT)?;
        Ok(Scene {
            scenario,
            nodes,
            sea,
            flags: flags.join(" "),
        })
    }
}

/// Seconds since the call, by the computer's clock: only ever shown, never used.
#[allow(clippy::disallowed_methods)]
pub fn stopwatch() -> impl Fn() -> f64 {
    let start = std::time::Instant::now();
    move || start.elapsed().as_secs_f64()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shipped_scenarios_are_accepted_and_change_something() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios");
        let mut count = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let scenario: Scenario = config::load(&entry.unwrap().path()).unwrap();
            assert_ne!(scenario, Scenario::default());
            count += 1;
        }
        assert!(count >= 5);
    }

    #[test]
    fn printed_scenario_reads_back_as_the_defaults() {
        let text = commented(&Scenario::default()).unwrap();
        let read: Scenario = config::parse(&text, "scenario").unwrap();
        assert_eq!(read, Scenario::default());
    }
}
