use std::path::PathBuf;

use alight_computer::{
    quantity::{seconds, whole},
    terminal::Form,
};
use clap::Args;

use crate::{
    args::{AutopilotArg, SeaArg, sea},
    live::fault::FaultSpec,
};

/// Rehearsal of every service as installed, against the simulated world.
#[derive(Args, Debug)]
#[command(after_help = "Start with:\n  alight rehearse\n  \
alight rehearse --vessel-config vessel.toml --drone-config drone.toml\n\n\
Exit codes: 0 every step is OK, 1 one is not, 2 bad input.")]
pub struct RehearseArgs {
    /// Vessel's configuration [default: as shipped]
    #[arg(long, value_name = "FILE")]
    pub vessel_config: Option<PathBuf>,
    /// Drone's configuration [default: as shipped]
    #[arg(long, value_name = "FILE")]
    pub drone_config: Option<PathBuf>,
    /// Program to rehearse [default: this one]
    ///
    /// The rehearsal runs the services of this program, for example of a package's /usr/bin/alight.
    #[arg(long, value_name = "FILE")]
    pub program: Option<PathBuf>,
    /// Seed of sea, noise and start
    #[arg(long, default_value_t = 1, value_parser = whole::<u64>(0..=1_000_000_000))]
    pub seed: u64,
    /// Sea, as for `alight trial`
    #[arg(long, default_value = "moderate", hide_possible_values = true, value_parser = sea())]
    pub sea: SeaArg,
    /// Kill or freeze a process: KIND:PHASE|contact, such as vessel-restarted:tracking
    ///
    /// The fault occurs in a phase or at the first contact, as with `alight land`; a freeze lasts 0.2 to 2 s. On the
    /// vessel the whole service is killed and restarted as by systemd.
    #[arg(long, value_name = "FAULT")]
    pub fault: Option<FaultSpec>,
    /// Simulated autopilot's firmware [default: px4]
    ///
    /// With --autopilot-at it names the firmware that flies.
    #[arg(long, value_name = "NAME", value_enum)]
    pub autopilot: Option<AutopilotArg>,
    /// MAVLink of a maker's firmware, such as udpin://127.0.0.1:14540 (alight help firmware)
    ///
    /// The firmware flies; the pilot starts it.
    #[arg(long, value_name = "URL")]
    pub autopilot_at: Option<String>,
    /// Motors, sensors and port of its plant (TOML)
    ///
    /// The keys are those of [firmware].
    #[arg(long, value_name = "FILE", requires = "autopilot_at")]
    pub firmware: Option<PathBuf>,
    /// Time before the order to land, s [default: 40]
    ///
    /// It begins once the vehicles have appeared. With --autopilot-at the default is 180.
    #[arg(long, value_name = "TIME", value_parser = seconds(10..=600))]
    pub warm_up: Option<u32>,
    /// Maximum time of the landing, s
    #[arg(long, value_name = "TIME", default_value_t = 180, value_parser = seconds(30..=180))]
    pub time_limit: u32,
    /// Keep the files in this new directory
    ///
    /// These are the configurations and the output of the services.
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
    /// Time from the start of the simulated vehicles to the command, s.
    pub fn warm_up_s(&self) -> f64 {
        let usual = if self.autopilot_at.is_some() { 180 } else { 40 };
        f64::from(self.warm_up.unwrap_or(usual))
    }
}
