//! Flags of `alight rehearse`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use crate::lab::args::{Autopilot, SeaArg};

/// Every service as it is installed, against the simulated world.
#[derive(Args, Debug)]
#[command(after_help = "Start with:\n  alight rehearse\n  \
alight rehearse --vessel-config vessel.toml --drone-config drone.toml\n\n\
Exit codes: 0 every step is OK, 1 one is not, 2 bad input.")]
pub struct RehearseArgs {
    /// The vessel's file as an installer wrote it [default: as it is shipped]
    #[arg(long, value_name = "FILE")]
    pub vessel_config: Option<PathBuf>,
    /// The drone's [default: as it is shipped]
    #[arg(long, value_name = "FILE")]
    pub drone_config: Option<PathBuf>,
    /// The program whose services are rehearsed, such as /usr/bin/alight of a package [default: this one]
    #[arg(long, value_name = "FILE")]
    pub program: Option<PathBuf>,
    /// Seed of sea, noise and start
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(0..=1_000_000_000))]
    pub seed: u64,
    /// calm, slight, moderate, rough, very-rough, or as for `alight trial`
    #[arg(long, default_value = "moderate")]
    pub sea: SeaArg,
    /// Kill a service once while the drone follows: it is started again as systemd does, and the landing is still made
    #[arg(long, value_enum, value_name = "SERVICE")]
    pub restart: Option<Restart>,
    /// Whose character the simulated autopilot has; with --autopilot-at the firmware that flies [default: px4]
    #[arg(long, value_enum)]
    pub autopilot: Option<Autopilot>,
    /// A maker's firmware flies, started beside by a person: where its MAVLink is, such as udpin://127.0.0.1:14540
    /// (deploy/docs/firmware.md)
    #[arg(long, value_name = "URL")]
    pub autopilot_at: Option<String>,
    /// Its plant's motors, sensors and port (TOML, keys of [firmware])
    #[arg(long, value_name = "FILE", requires = "autopilot_at")]
    pub firmware: Option<PathBuf>,
    /// The landing is commanded so long after the vehicles are there, s [default: 40; 180 with --autopilot-at]
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u16).range(10..=600))]
    pub warm_up: Option<u16>,
    /// The landing has this long, s
    #[arg(long, value_name = "S", default_value_t = 180, value_parser = clap::value_parser!(u16).range(30..=180))]
    pub time_limit: u16,
    /// Leave configurations and what the services wrote in this new directory
    #[arg(long, value_name = "DIR")]
    pub keep: Option<PathBuf>,
    /// Print what was seen as one JSON object, the last line
    #[arg(long)]
    pub json: bool,
    /// End when standard input closes
    #[arg(long, hide = true)]
    pub supervised: bool,
}

/// A service that is killed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Restart {
    /// The vessel's.
    Vessel,
}

impl RehearseArgs {
    /// From the vehicles' first moment to the command, s.
    pub fn warm_up_s(&self) -> f64 {
        let usual = if self.autopilot_at.is_some() { 180 } else { 40 };
        f64::from(self.warm_up.unwrap_or(usual))
    }
}
