//! `alight config`: a configuration with its declarations.

use alight_computer::config::{DroneComputer, VesselComputer};
use alight_computer::exit::{CliError, Doing, Exit};
use alight_computer::terminal;
use alight_shared::config::commented;
use clap::Args;

/// A configuration of a computer.
#[derive(Args, Debug)]
pub struct ConfigArgs {
    /// Every key with its default and its meaning, not only what an installer decides
    #[arg(long)]
    pub all: bool,
}

/// Prints the vessel's: as it is shipped, or with all its keys.
pub fn vessel(args: &ConfigArgs) -> Result<Exit, CliError> {
    print(args, include_str!("../../../vessel/vessel.toml"), || {
        commented(&VesselComputer::default())
    })
}

/// Prints the drone's: as it is shipped, or with all its keys.
pub fn drone(args: &ConfigArgs) -> Result<Exit, CliError> {
    print(args, include_str!("../../../drone/drone.toml"), || {
        commented(&DroneComputer::default())
    })
}

fn print(
    args: &ConfigArgs,
    shipped: &str,
    all: impl FnOnce() -> Result<String, toml::ser::Error>,
) -> Result<Exit, CliError> {
    let text = if args.all {
        all().doing("writing the configuration as TOML")?
    } else {
        shipped.into()
    };
    terminal::line(text.trim_end());
    Ok(Exit::Success)
}
