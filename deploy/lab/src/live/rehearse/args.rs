//! Flags of `alight rehearse`.

use std::path::PathBuf;

use alight_computer::terminal::Form;
use alight_shared::msg::State;
use alight_sim::harness::storm::{Kind, Moment};
use clap::Args;

use crate::args::{Autopilot, SeaArg};
use crate::live::fault::FaultSpec;

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
    /// Kill a process, or freeze it for 0.2 to 2 s, in a phase or at the first contact, as with `alight land`; of the vessel
    /// the whole service is killed, and started again as systemd does: KIND:PHASE|contact, such as
    /// vessel-restarted:tracking
    #[arg(long, value_name = "FAULT")]
    pub fault: Option<FaultSpec>,
    /// The former name of `--fault vessel-restarted:tracking`
    #[arg(long, hide = true, value_parser = ["vessel"], conflicts_with = "fault")]
    pub restart: Option<String>,
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
    /// Output format.
    #[command(flatten)]
    pub form: Form,
    /// End when standard input closes
    #[arg(long, hide = true)]
    pub supervised: bool,
}

impl RehearseArgs {
    /// The fault of this rehearsal.
    pub fn fault(&self) -> Option<FaultSpec> {
        let vessel = FaultSpec {
            kind: Kind::VesselRestarted,
            moment: Moment::In(State::Tracking),
        };
        self.fault.or(self.restart.as_ref().map(|_| vessel))
    }
    /// From the vehicles' first moment to the command, s.
    pub fn warm_up_s(&self) -> f64 {
        let usual = if self.autopilot_at.is_some() { 180 } else { 40 };
        f64::from(self.warm_up.unwrap_or(usual))
    }
}
