//! Flags of the live system.

use std::net::SocketAddr;
use std::path::PathBuf;

use alight_computer::exit::{CliError, Doing};
use alight_computer::process::args::{ProcessArgs, ViewArgs};
use alight_computer::terminal::Form;
use alight_sim::radio::Transport;
use clap::{Args, Parser, ValueEnum};

use crate::args::{Autopilot, SceneArgs};
use crate::live::config::AutopilotKind;
use crate::live::fault::FaultSpec;

/// One landing, live.
#[derive(Args, Clone, Debug)]
pub struct LandArgs {
    /// The scene.
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Seed of sea, noise and start
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Land with so many seeds, from --seed on, each beside the lock-step landing of the same seed
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000),
        conflicts_with_all = ["plot", "record"])]
    pub trials: Option<u32>,
    /// How many of the trials at a time, each with processes of its own
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=64))]
    pub jobs: u16,
    /// The vessel's estimator runs this long before the landing is commanded, s [default: the
    /// scenario's, 60]
    #[arg(long, value_name = "S")]
    pub warm_up: Option<f64>,
    /// Impair the radio: scenario, clean, wifi-near, wifi-far, radio-mesh, storm, blackout-5s,
    /// narrow, or a TOML file
    #[arg(long, value_name = "PROFILE", default_value = "scenario")]
    pub link: String,
    /// Impair it by a link emulator between two network namespaces (needs root) or inside the
    /// processes; auto: the emulator for a --link other than scenario, where it is permitted
    #[arg(long, value_enum, default_value_t = Emulate::Auto)]
    pub emulate: Emulate,
    /// Transport of the radio: quic (with certificates on both sides), udp or tcp
    #[arg(long, default_value = "quic", value_parser = ["quic", "udp", "tcp"])]
    pub transport: String,
    /// For quic: directory of `alight keys` with vessel and drone of these numbers [default: made for
    /// this landing alone]
    #[arg(long, value_name = "DIR")]
    pub certificates: Option<PathBuf>,
    /// Name of this set of processes; several may run side by side
    #[arg(long, default_value = "land")]
    pub instance: String,
    /// The firmware of --autopilot itself flies: it is started beside, and flown from the pad by a person (see
    /// docs/firmware.md)
    #[arg(long, requires = "autopilot")]
    pub external: bool,
    /// Where that firmware's MAVLink is [default: udpin://127.0.0.1:14540 for PX4,
    /// tcpout://127.0.0.1:5760 for ArduPilot]
    #[arg(long, value_name = "URL", requires = "external")]
    pub connect: Option<String>,
    /// Its plant's motors, sensors and port (TOML, keys of [firmware])
    #[arg(long, value_name = "FILE", requires = "external")]
    pub firmware: Option<PathBuf>,
    /// A ground station listens there, UDP, at another link of the simulated autopilot, such as 127.0.0.1:14550
    #[arg(long, value_name = "ADDRESS", conflicts_with_all = ["external", "trials"])]
    pub ground_station: Option<SocketAddr>,
    /// Draw paths, speeds and attitudes to an SVG
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// Record everything to an MCAP file, for Foxglove, Lichtblick, Rerun and `alight replay`
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
    /// Every process records its steps in this directory, a flight for `alight replay`
    #[arg(long, value_name = "DIR")]
    pub log: Option<PathBuf>,
    /// Kill a process, or freeze it for 0.2 to 2 s, in a phase or at the first contact:
    /// KIND:PHASE|contact, such as planner-killed:descent
    #[arg(long, value_name = "FAULT")]
    pub fault: Option<FaultSpec>,
    /// Fly this list of faults (TOML, as `alight storm --list`) on real processes: its scene, seed and faults
    #[arg(long, value_name = "LIST.toml", conflicts_with_all = ["fault", "trials", "seed", "SceneArgs"])]
    pub faults: Option<PathBuf>,
    /// Whether and where people look on.
    #[command(flatten)]
    pub view: ViewArgs,
    /// Output format.
    #[command(flatten)]
    pub form: Form,
    /// End when standard input closes
    #[arg(long, hide = true)]
    pub supervised: bool,
}

impl LandArgs {
    /// Who flies the simulated drone.
    pub fn flown_by(&self) -> AutopilotKind {
        match self.scene.autopilot.filter(|_| self.external) {
            None => AutopilotKind::Internal,
            Some(Autopilot::Px4) => AutopilotKind::Px4,
            Some(Autopilot::Ardupilot) => AutopilotKind::Ardupilot,
        }
    }
}

/// The flags of `alight land` alone.
#[derive(Parser)]
struct LandFlags {
    #[command(flatten)]
    args: LandArgs,
}

/// Reads `flags` as those of `alight land`.
pub fn land_flags(flags: &[String]) -> Result<LandArgs, CliError> {
    let words = core::iter::once("alight land").chain(flags.iter().map(String::as_str));
    LandFlags::try_parse_from(words)
        .map(|f| f.args)
        .doing("the flags of `alight land`")
}

/// The former name of `alight land --trials N`.
// A comment would show in the help of a name that is gone.
#[allow(missing_docs)]
#[derive(Args, Debug)]
pub struct LandsArgs {
    #[arg(long, default_value_t = 20)]
    pub trials: u32,
    #[arg(long, default_value_t = 1)]
    pub seed0: u64,
    #[arg(long, default_value_t = 1)]
    pub jobs: u16,
    #[arg(long, default_value = "lands")]
    pub instance: String,
    #[command(flatten)]
    pub form: Form,
    #[arg(last = true)]
    pub land: Vec<String>,
}

impl LandArgs {
    /// The transport of the radio, as lock-step models it.
    pub fn transport(&self) -> Transport {
        match self.transport.as_str() {
            "tcp" => Transport::Tcp,
            "quic" => Transport::Quic,
            _ => Transport::Udp,
        }
    }
}

/// Where the radio is impaired.
#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
pub enum Emulate {
    /// Between namespaces for a named link, where it is permitted; else inside the processes.
    Auto,
    /// Between namespaces.
    Always,
    /// Inside the processes.
    Never,
}

/// The simulated vehicles.
#[derive(Args, Debug)]
#[command(
    after_help = "`alight config world` prints its file: the drone's set of processes, which has\n\
to run, the addresses of vessel and autopilot, seed, firmware and scenario.\n\
Vessel and drone fly in it with the same epoch_ns in [clock] of theirs.\n\
`alight land` keeps its own in alight-land/world.toml among temporary files."
)]
pub struct WorldArgs {
    /// What every process has
    #[command(flatten)]
    pub process: ProcessArgs,
    /// Who flies the drone [default: the configuration's]
    #[arg(long, value_enum)]
    pub autopilot: Option<AutopilotKind>,
}
