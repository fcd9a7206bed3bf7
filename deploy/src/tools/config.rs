//! `alight config`: prints a configuration.

#[cfg(feature = "lab")]
use alight_sim::harness::scenario::Scenario;
use alight_usv::VesselNodeConfig;
use clap::{Args, ValueEnum};

use crate::config::{DroneComputer, DroneFile, VesselComputer};
use crate::exit::{CliError, Exit};
use crate::terminal;

/// Which configuration.
#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
pub enum ConfigKind {
    /// The vessel's side.
    Vessel,
    /// The drone's side.
    Drone,
    /// The simulated world.
    #[cfg(feature = "lab")]
    Scenario,
    /// The whole file of the vessel's computer, for `alight vessel`.
    VesselComputer,
    /// The whole file of the drone's computer, for `alight drone`.
    DroneComputer,
}

/// A configuration to print.
#[derive(Args, Debug)]
pub struct ConfigArgs {
    /// Which
    #[arg(value_enum)]
    pub kind: ConfigKind,
}

/// Prints a default configuration.
pub fn run(args: &ConfigArgs) -> Result<Exit, CliError> {
    let text = match args.kind {
        ConfigKind::Vessel => toml::to_string(&VesselNodeConfig::default()),
        ConfigKind::Drone => toml::to_string(&DroneFile::default()),
        #[cfg(feature = "lab")]
        ConfigKind::Scenario => toml::to_string(&Scenario::default()),
        ConfigKind::VesselComputer => toml::to_string(&VesselComputer::default()),
        ConfigKind::DroneComputer => toml::to_string(&DroneComputer::default()),
    };
    terminal::line(
        text.map_err(|e| CliError::because("writing the configuration as TOML", e))?
            .trim_end(),
    );
    Ok(Exit::Success)
}

#[cfg(all(test, feature = "lab"))]
mod tests {
    use super::*;
    use alight_shared::config;
    use std::path::Path;

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
