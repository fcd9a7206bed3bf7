//! Flags of the live system.

use std::path::PathBuf;

#[cfg(feature = "live")]
use alight_sim::radio::Transport;
#[cfg(feature = "live")]
use clap::ValueEnum;
use clap::{Args, Subcommand};

use super::calibrate::CalibrateArgs;
use super::check::CheckArgs;
use super::command::CommandArgs;
#[cfg(feature = "live")]
use super::emulator::LinkArgs;
#[cfg(feature = "live")]
use super::fault::FaultSpec;
#[cfg(feature = "live")]
use super::follow::MAX_FOLLOW_S;
use super::keys::KeysArgs;
#[cfg(feature = "live")]
use super::latency::LatencyArgs;
#[cfg(feature = "live")]
use super::plant::AutopilotKind;
#[cfg(feature = "live")]
use crate::args::SceneArgs;

/// The live system.
#[derive(Subcommand, Debug)]
pub enum LiveVerb {
    /// Land once in real time: all processes of vessel and drone, simulated vehicles.
    #[cfg(feature = "live")]
    Land(Box<LandArgs>),
    /// Land live with many seeds, beside the lock-step landings of the same seeds.
    #[cfg(feature = "live")]
    Lands(LandsArgs),
    /// Kill and freeze every process in every phase of a live landing, and say what came of it.
    #[cfg(feature = "live")]
    Faults(FaultsArgs),
    /// Show what runs: processes, topics, ages, drops, link and mission.
    Status(StatusArgs),
    /// Feed a process's log through its node again and compare the outputs bit for bit.
    #[cfg(all(feature = "live", not(feature = "record")))]
    Replay(ReplayArgs),
    /// Process of the vessel: estimator and broadcast.
    Vessel(ProcessArgs),
    /// All processes of the drone's computer, as its service runs them.
    Drone(ProcessArgs),
    /// Tell the drone to land, to break off or to hold, and show its answer.
    Command(CommandArgs),
    /// Process of the drone: its end of the radio.
    Bridge(ProcessArgs),
    /// Process of the drone: the deck's forecast.
    Predictor(ProcessArgs),
    /// Process of the drone: the state machine.
    Mission(ProcessArgs),
    /// Process of the drone: the trajectory.
    Planner(ProcessArgs),
    /// Process of the drone: the set-points.
    Pilot(ProcessArgs),
    /// Process of the vessel: its real sensors (NMEA 0183, UBX, MAVLink), which it starts.
    Sensors(SensorsArgs),
    /// Process of the drone: the link to a real autopilot (PX4, ArduCopter) by MAVLink.
    Autopilot(AutopilotArgs),
    /// Process of the drone: the belly camera's images, and the tag in them.
    Camera(CameraArgs),
    /// Process of the drone: the ultraviolet camera's images, and the markers in them.
    Uvdar(CameraArgs),
    /// Process of the simulation: both vehicles, in real time.
    #[cfg(feature = "live")]
    World(WorldArgs),
    /// Emulate a bad link between two network namespaces of this computer (needs root).
    #[cfg(feature = "live")]
    Link(LinkArgs),
    /// Measure one hop through both middlewares, beside plain sockets.
    #[cfg(feature = "live")]
    Latency(LatencyArgs),
    /// Make a private authority and certificates of vessel and drone; show when they expire.
    Keys(KeysArgs),
    /// Look for what keeps this computer from flying, and say what to do about it.
    Check(CheckArgs),
    /// Measure what the configuration has to say of this vessel and this drone.
    Calibrate(CalibrateArgs),
}

/// One landing, live.
#[cfg(feature = "live")]
#[derive(Args, Debug)]
pub struct LandArgs {
    /// The scene.
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Seed of sea, noise and start
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
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
    /// Who flies the simulated drone: internal, or the firmware of PX4 or ArduPilot, which is started
    /// beside and flown from the pad by a person (see deploy/README.md)
    #[arg(long, value_enum, default_value_t = AutopilotKind::Internal)]
    pub autopilot: AutopilotKind,
    /// Where that firmware's MAVLink is [default: udpin://0.0.0.0:14540 for PX4,
    /// tcpout://127.0.0.1:5760 for ArduPilot]
    #[arg(long, value_name = "URL", requires = "autopilot")]
    pub connect: Option<String>,
    /// Its plant's motors, sensors and port (TOML, keys of [firmware])
    #[arg(long, value_name = "FILE", requires = "autopilot")]
    pub firmware: Option<PathBuf>,
    /// Plain Unix and UDP sockets carry the same messages beside the middlewares; the report compares
    #[arg(long)]
    pub relay: bool,
    /// Draw paths, speeds and attitudes to an SVG
    #[arg(long, value_name = "FILE.svg", conflicts_with = "follow")]
    pub plot: Option<PathBuf>,
    /// Record everything to an MCAP file, for Foxglove, Lichtblick, Rerun and `alight replay`
    #[cfg(feature = "record")]
    #[arg(long, value_name = "FILE.mcap", conflicts_with = "follow")]
    pub record: Option<PathBuf>,
    /// Follow the vessel for this long after the start instead of landing, s
    #[arg(long, value_name = "S", value_parser = follow_s)]
    pub follow: Option<f64>,
    /// Write what the processes use, and their files, to this file (CSV) once a minute
    #[arg(long, value_name = "FILE.csv")]
    pub usage: Option<PathBuf>,
    /// Every process logs what it consumed into this directory, for `alight replay`
    #[arg(long, value_name = "DIR")]
    pub log: Option<PathBuf>,
    /// Kill a process, or freeze it for 2 s, in a phase: PROCESS:kill|freeze:PHASE, such as
    /// planner:kill:descent
    #[arg(long, value_name = "FAULT")]
    pub fault: Option<FaultSpec>,
    /// Print the outcome as one JSON object, the last line
    #[arg(long)]
    pub json: bool,
    /// End when standard input closes
    #[arg(long, hide = true)]
    pub supervised: bool,
}

/// Many landings, live.
#[cfg(feature = "live")]
#[derive(Args, Debug)]
pub struct LandsArgs {
    /// How many
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub trials: u32,
    /// First seed; seeds SEED0 to SEED0+TRIALS-1 are flown
    #[arg(long, default_value_t = 1)]
    pub seed0: u64,
    /// How many at a time, each with processes of its own
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=64))]
    pub jobs: u16,
    /// Names of the sets of processes begin with this
    #[arg(long, default_value = "lands")]
    pub instance: String,
    /// Print the summary as one JSON object, the last line
    #[arg(long)]
    pub json: bool,
    /// Flags of `alight land`, for all of them
    #[arg(last = true, value_name = "LAND FLAGS")]
    pub land: Vec<String>,
}

/// Faults, live.
#[cfg(feature = "live")]
#[derive(Args, Debug)]
pub struct FaultsArgs {
    /// Only this one (may be repeated) [default: 6 processes, killed and frozen, in approach,
    /// tracking, descent and flare]
    #[arg(long, value_name = "FAULT")]
    pub fault: Vec<FaultSpec>,
    /// Every case so many times, each with a seed of its own
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub repeat: u32,
    /// Seed of the first case; each next case has the next seed
    #[arg(long, default_value_t = 1)]
    pub seed0: u64,
    /// How many at a time, each with processes of its own
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..=64))]
    pub jobs: u16,
    /// Names of the sets of processes begin with this
    #[arg(long, default_value = "faults")]
    pub instance: String,
    /// Print the cases as one JSON list, the last line
    #[arg(long)]
    pub json: bool,
    /// Flags of `alight land`, for all of them
    #[arg(last = true, value_name = "LAND FLAGS")]
    pub land: Vec<String>,
}

/// Times that the drone can be told to follow: up to what a mission may take.
#[cfg(feature = "live")]
fn follow_s(text: &str) -> Result<f64, String> {
    let s: f64 = text.parse().map_err(|e| format!("{e}"))?;
    if (1.0..=MAX_FOLLOW_S).contains(&s) {
        Ok(s)
    } else {
        Err(format!("1 to {MAX_FOLLOW_S} seconds"))
    }
}

#[cfg(feature = "live")]
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
#[cfg(feature = "live")]
#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
pub enum Emulate {
    /// Between namespaces for a named link, where it is permitted; else inside the processes.
    Auto,
    /// Between namespaces.
    Always,
    /// Inside the processes.
    Never,
}

/// What runs.
#[derive(Args, Debug)]
#[command(
    after_help = "Run it as the user that runs Alight: sudo -u alight alight status\n\
Exit codes on a vessel: 0 fine, 1 warnings or nothing runs, 2 broken. On a drone: 0 runs, 1 nothing runs."
)]
pub struct StatusArgs {
    /// Name of the set of processes [default: the configuration's; without one: land]
    #[arg(long)]
    pub instance: Option<String>,
    /// Configuration of the vessel's or the drone's computer (TOML) [default: /etc/alight/vessel.toml or
    /// /etc/alight/drone.toml, whichever is there]
    #[arg(long, value_name = "FILE", conflicts_with = "instance")]
    pub config: Option<PathBuf>,
    /// Go on showing until stopped
    #[arg(long)]
    pub watch: bool,
    /// Print as one JSON object
    #[arg(long)]
    pub json: bool,
}

/// A log.
#[cfg(all(feature = "live", not(feature = "record")))]
#[derive(Args, Debug)]
pub struct ReplayArgs {
    /// Directory with the logs of `--log`, or one log file
    pub path: PathBuf,
}

/// A process.
#[derive(Args, Debug)]
pub struct ProcessArgs {
    /// Its computer's configuration (TOML)
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// Log what it consumed into this directory
    #[arg(long, value_name = "DIR")]
    pub log: Option<PathBuf>,
    /// End when standard input closes: a supervisor that dies takes its processes with it
    #[arg(long, hide = true)]
    pub supervised: bool,
}

/// One of the drone's cameras.
#[derive(Args, Debug)]
pub struct CameraArgs {
    /// The process.
    #[command(flatten)]
    pub process: ProcessArgs,
    /// Where images come from, in the place of camera.source or uvdar.source
    #[arg(long, value_name = "SOURCE")]
    pub source: Option<String>,
    /// Look at what the source has without the drone's other processes, and print each sighting (JSON)
    #[arg(long)]
    pub print: bool,
}

/// The vessel's real sensors.
#[derive(Args, Debug)]
pub struct SensorsArgs {
    /// The vessel's configuration (TOML), with a table [[sensor.sources]] for each sensor
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// Say what became of each source's bytes as JSON objects, one a line
    #[arg(long)]
    pub json: bool,
    /// End when standard input closes
    #[arg(long, hide = true)]
    pub supervised: bool,
}

/// The simulated vehicles.
#[cfg(feature = "live")]
#[derive(Args, Debug)]
pub struct WorldArgs {
    /// What every process has
    #[command(flatten)]
    pub process: ProcessArgs,
    /// Who flies the drone [default: the configuration's]
    #[arg(long, value_enum)]
    pub autopilot: Option<AutopilotKind>,
}

/// The link to a real autopilot.
#[derive(Args, Debug)]
pub struct AutopilotArgs {
    /// What every process has
    #[command(flatten)]
    pub process: ProcessArgs,
    /// Where the autopilot is: udpin://0.0.0.0:14540, udpout://HOST:PORT, tcpout://HOST:PORT,
    /// tcpin://0.0.0.0:PORT, serial:///dev/ttyACM0:921600 [default: the configuration's]
    #[arg(long, value_name = "URL")]
    pub connect: Option<String>,
}
