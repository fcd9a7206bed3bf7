//! Configuration files of vessel and drone.

#[cfg(feature = "sim")]
use std::path::Path;

use alight_bridge::BridgeConfig;
use alight_shared::config;
#[cfg(feature = "sim")]
use alight_shared::config::ConfigError;
#[cfg(feature = "sim")]
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_uav::settings::DroneSettings;
use alight_usv::VesselNodeConfig;

use crate::cli::{ConfigArgs, ConfigKind};
#[cfg(feature = "flight")]
use crate::live::config::{DroneComputer, VesselComputer};
use crate::{CliError, Exit, terminal};

config! {
    /// The drone's file: `[bridge]` and `[drone.*]`.
    pub struct DroneFile {
        /// The bridge.
        pub bridge: BridgeConfig;
        /// Predictor, mission, planner, pilot and what they know of drone and deck.
        pub drone: DroneSettings;
    }
}

/// The configuration of all nodes: files where given, defaults elsewhere.
#[cfg(feature = "sim")]
pub fn nodes(vessel: Option<&Path>, drone: Option<&Path>) -> Result<NodeConfigs, CliError> {
    let refused = |e: ConfigError| CliError(e.to_string());
    let vessel = match vessel {
        Some(path) => config::load(path).map_err(refused)?,
        None => VesselNodeConfig::default(),
    };
    let file = match drone {
        Some(path) => config::load(path).map_err(refused)?,
        None => DroneFile::default(),
    };
    Ok(NodeConfigs {
        vessel,
        bridge: file.bridge,
        drone: file.drone,
    })
}

/// Prints a default configuration.
pub fn print(args: &ConfigArgs) -> Result<Exit, CliError> {
    let text = match args.kind {
        ConfigKind::Vessel => toml::to_string(&VesselNodeConfig::default()),
        ConfigKind::Drone => toml::to_string(&DroneFile::default()),
        #[cfg(feature = "sim")]
        ConfigKind::Scenario => toml::to_string(&Scenario::default()),
        #[cfg(feature = "flight")]
        ConfigKind::VesselComputer => toml::to_string(&VesselComputer::default()),
        #[cfg(feature = "flight")]
        ConfigKind::DroneComputer => toml::to_string(&DroneComputer::default()),
    };
    terminal::line(
        text.map_err(|e| CliError::because("writing the configuration as TOML", e))?
            .trim_end(),
    );
    Ok(Exit::Success)
}

#[cfg(all(test, feature = "sim"))]
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
    fn printed_defaults_read_back_as_the_defaults() {
        let text = toml::to_string(&DroneFile::default()).unwrap();
        assert_eq!(
            config::parse::<DroneFile>(&text, "drone").unwrap(),
            DroneFile::default()
        );
        let text = toml::to_string(&VesselNodeConfig::default()).unwrap();
        assert_eq!(
            config::parse::<VesselNodeConfig>(&text, "vessel").unwrap(),
            VesselNodeConfig::default()
        );
        let text = toml::to_string(&Scenario::default()).unwrap();
        assert_eq!(
            config::parse::<Scenario>(&text, "scenario").unwrap(),
            Scenario::default()
        );
    }
}
