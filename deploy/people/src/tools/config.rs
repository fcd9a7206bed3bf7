//! `alight config`: prints configurations with the descriptions of their keys.

use alight_computer::{
    config::{DroneComputerConfig, VesselComputerConfig, method::KeyOwner},
    exit::{CliError, Doing, Exit},
    terminal,
};
use alight_shared::config::{Check, commented_keys};
use clap::Args;
use serde::Serialize;

/// Configuration of a computer.
#[derive(Args, Debug)]
pub struct ConfigArgs {
    /// Print every key of the file with its default and its meaning, not only those that `alight init` writes
    #[arg(long)]
    pub all: bool,
    /// Print keys of the method, which flight configurations do not set, for --tuning of studies
    #[arg(long, conflicts_with = "all")]
    pub tuning: bool,
}

pub fn vessel(args: &ConfigArgs) -> Result<Exit, CliError> {
    print::<VesselComputerConfig>(args, include_str!("../../../vessel/vessel.toml"))
}

pub fn drone(args: &ConfigArgs) -> Result<Exit, CliError> {
    print::<DroneComputerConfig>(args, include_str!("../../../drone/drone.toml"))
}

fn print<T: Default + Serialize + Check>(args: &ConfigArgs, shipped: &str) -> Result<Exit, CliError> {
    let of = |owner| {
        let text = commented_keys(&T::default(), &|key| KeyOwner::of(key) == owner);
        text.doing("writing the configuration as TOML")
    };
    let text = match (args.all, args.tuning) {
        (true, _) => of(KeyOwner::Flight)?,
        (false, true) => of(KeyOwner::Method)?,
        (false, false) => shipped.into(),
    };
    terminal::line(text.trim_end());
    Ok(Exit::Success)
}
