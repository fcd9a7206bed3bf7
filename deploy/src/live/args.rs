//! Flags of the live system.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use crate::args::SceneArgs;

/// The live system.
#[derive(Subcommand, Debug)]
pub enum LiveVerb {
    /// Land once in real time: starts every process of vessel and drone on this machine, with a
    /// simulated world as the vehicles.
    Land(Box<LandArgs>),
    /// Show what runs: processes, topics, ages, drops, link and mission.
    Status(StatusArgs),
    /// Feed a process's log through its node again and compare the outputs bit for bit.
    #[cfg(not(feature = "record"))]
    Replay(ReplayArgs),
    /// Process of the vessel: estimator and broadcast.
    Vessel(ProcessArgs),
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
    /// Process of the simulation: both vehicles, in real time.
    World(ProcessArgs),
}

/// One landing, live.
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
    /// Impair the radio: scenario, clean, wifi-near, wifi-far, radio-mesh, storm, blackout-5s, or a
    /// TOML file
    #[arg(long, value_name = "PROFILE", default_value = "scenario")]
    pub link: String,
    /// Transport of the radio: udp or tcp
    #[arg(long, default_value = "udp", value_parser = ["udp", "tcp"])]
    pub transport: String,
    /// Name of this set of processes; several may run side by side
    #[arg(long, default_value = "land")]
    pub instance: String,
    /// Every process logs what it consumed into this directory, for `alight replay`
    #[arg(long, value_name = "DIR")]
    pub log: Option<PathBuf>,
    /// Print the outcome as one JSON object, the last line
    #[arg(long)]
    pub json: bool,
}

/// What runs.
#[derive(Args, Debug)]
pub struct StatusArgs {
    /// Name of the set of processes
    #[arg(long, default_value = "land")]
    pub instance: String,
    /// Go on showing until stopped
    #[arg(long)]
    pub watch: bool,
    /// Print as one JSON object
    #[arg(long)]
    pub json: bool,
}

/// A log.
#[cfg(not(feature = "record"))]
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
