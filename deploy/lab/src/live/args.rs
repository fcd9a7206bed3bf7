use std::{net::SocketAddr, path::PathBuf};

use alight_computer::{
    process::args::{ProcessArgs, ViewArgs, mcap_file},
    quantity::duration_s,
    subject::SIMULATED,
    terminal::Form,
};
use clap::{Args, ValueEnum, builder::StringValueParser};

use crate::{
    args::{AutopilotArg, SceneArgs, offering},
    live::{config::AutopilotKind, fault::FaultSpec, profile},
};

/// One live landing.
#[derive(Args, Clone, Debug)]
pub struct LandArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Seed of sea, noise and start
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Rejected: alight trial flies many.
    #[arg(long, hide = true)]
    pub trials: Option<u32>,
    /// Time before the order to land, s [default: 60]
    ///
    /// The vessel's estimator runs during this time. The default is the scenario's.
    #[arg(long, value_name = "TIME", value_parser = duration_s)]
    pub warm_up: Option<f64>,
    /// Impair the radio: scenario, a profile, or a TOML file
    ///
    /// Profiles: clean, wifi-near, wifi-far, radio-mesh, storm, blackout-5s, narrow.
    #[arg(long, value_name = "PROFILE", default_value = "scenario", hide_possible_values = true,
          value_parser = offering(StringValueParser::new(), profile::names()))]
    pub link: String,
    /// Use network namespaces for the radio (root)
    ///
    /// Between namespaces a link emulator impairs the radio, otherwise the processes do. auto: the emulator for a
    /// --link other than scenario, if it is permitted.
    #[arg(long, value_name = "WHEN", value_enum, default_value_t = Emulate::Auto)]
    pub emulate: Emulate,
    /// Transport of the radio
    ///
    /// quic uses certificates on both sides.
    #[arg(long, value_name = "NAME", default_value = "quic", value_parser = ["quic", "udp", "tcp"])]
    pub transport: String,
    /// Directory of `alight keys`, for quic
    ///
    /// It contains certificates for the numbers of this vessel and drone. Without it, certificates are created for
    /// this landing.
    #[arg(long, value_name = "DIR")]
    pub certificates: Option<PathBuf>,
    /// Name of this set of processes
    ///
    /// Several sets with different names may run at the same time.
    #[arg(long, value_name = "NAME", default_value = SIMULATED)]
    pub instance: String,
    /// Let the firmware fly (alight help firmware)
    ///
    /// The firmware is the one named by --autopilot. The pilot starts it, and flies it from the pad.
    #[arg(long, requires = "autopilot")]
    pub external: bool,
    /// MAVLink of that firmware [default: the usual]
    ///
    /// The default is udpin://127.0.0.1:14540 for PX4 and tcpout://127.0.0.1:5760 for ArduPilot.
    #[arg(long, value_name = "URL", requires = "external")]
    pub connect: Option<String>,
    /// Motors, sensors and port of its plant (TOML)
    ///
    /// The keys are those of [firmware].
    #[arg(long, value_name = "FILE", requires = "external")]
    pub firmware: Option<PathBuf>,
    /// Ground station, such as 127.0.0.1:14550
    ///
    /// It listens to UDP there, on another link of the simulated autopilot.
    #[arg(long, value_name = "UDP", conflicts_with = "external")]
    pub ground_station: Option<SocketAddr>,
    /// Draw paths, speeds and attitudes to an SVG
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// Record to MCAP (Foxglove, `alight replay`)
    ///
    /// Lichtblick and Rerun also read it.
    #[arg(long, value_name = "FILE.mcap", value_parser = mcap_file)]
    pub record: Option<PathBuf>,
    /// Record every process for `alight replay`
    ///
    /// The steps of all processes form a recorded flight.
    #[arg(long, value_name = "DIR")]
    pub log: Option<PathBuf>,
    /// Kill or freeze a process: KIND:PHASE|contact
    ///
    /// The fault occurs in a phase or at the first contact, such as planner-killed:descent. A freeze lasts 0.2 to 2
    /// s.
    #[arg(long, value_name = "FAULT")]
    pub fault: Option<FaultSpec>,
    /// Fly a list of faults of `alight study storm`
    ///
    /// The list gives scene, seed and faults (TOML, as for `alight study storm --list`).
    #[arg(long, value_name = "LIST.toml", conflicts_with_all = ["fault", "seed", "SceneArgs"])]
    pub faults: Option<PathBuf>,
    #[command(flatten)]
    pub view: ViewArgs,
    /// Print every metric, delays and the processes' load
    #[arg(short, long)]
    pub verbose: bool,
    /// Output format.
    #[command(flatten)]
    pub form: Form,
    /// End when standard input closes
    #[arg(long, hide = true)]
    pub supervised: bool,
}

/// Time in which the crew can practise what follows an abort or a takeover, s.
const GOES_ON_S: f64 = 300.0;

impl LandArgs {
    pub fn goes_on_s(&self) -> f64 {
        let tests = self.fault.is_some() || self.faults.is_some() || self.scene.stay.is_some();
        if tests { 0.0 } else { GOES_ON_S }
    }
    pub fn flown_by(&self) -> AutopilotKind {
        match self.scene.autopilot.filter(|_| self.external) {
            None => AutopilotKind::Internal,
            Some(AutopilotArg::Px4) => AutopilotKind::Px4,
            Some(AutopilotArg::Ardupilot) => AutopilotKind::Ardupilot,
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
pub enum Emulate {
    /// Between namespaces for a named link, if permitted; otherwise inside the processes.
    Auto,
    /// Between namespaces.
    Always,
    /// Inside the processes.
    Never,
}

/// Simulated vehicles.
#[derive(Args, Debug)]
#[command(
    after_help = "`alight config world` prints its file: the drone's set of processes, which has\n\
to run, the addresses of vessel and autopilot, seed, firmware and scenario.\n\
`alight land` keeps its own in alight-sim/world.toml among temporary files."
)]
pub struct WorldArgs {
    /// Flags of every process
    #[command(flatten)]
    pub process: ProcessArgs,
    /// Drone's autopilot [default: the configuration's]
    #[arg(long, value_enum)]
    pub autopilot: Option<AutopilotKind>,
}
