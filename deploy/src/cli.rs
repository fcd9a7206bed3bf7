//! The command line.

use clap::{Args, Parser, Subcommand, ValueEnum};

#[cfg(feature = "sim")]
use crate::args::{ResponseArgs, StudyArgs, TrialArgs, TrialsArgs};

/// Lands a multirotor on the deck of a small boat that moves and rocks in waves.
#[derive(Parser, Debug)]
#[command(version, about, arg_required_else_help = true, max_term_width = 100)]
#[command(
    after_help = "Start with:\n  alight land                      one landing of all processes, in real time\n  \
alight trial                     the same computed as fast as it goes\n  \
alight trial --sea rough --plot landing.svg\n  alight trials --trials 100        a success rate with its interval\n\n\
Exit codes: 0 success, 1 failed landing, 2 bad input."
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Verb,
}

/// What to do.
#[derive(Subcommand, Debug)]
pub enum Verb {
    /// Fly one landing in the simulated world and say how it went.
    #[cfg(feature = "sim")]
    Trial(TrialArgs),
    /// Fly many landings and print the success rate with its interval.
    #[cfg(feature = "sim")]
    Trials(TrialsArgs),
    /// Measure one thing over many seeds.
    #[cfg(feature = "sim")]
    Study(StudyArgs),
    /// Compute a recording again and say whether every output is bit-identical.
    #[cfg(feature = "record")]
    Replay(crate::record::args::ReplayArgs),
    /// Print the simulated vessel's response in surge, heave and pitch against wave length.
    #[cfg(feature = "sim")]
    Response(ResponseArgs),
    /// Print a default configuration.
    Config(ConfigArgs),
    /// Run the vessel's estimator over a recording of a boat and say how well it fits.
    #[cfg(feature = "flight")]
    Estimate(crate::estimate::EstimateArgs),
    /// The live system.
    #[cfg(feature = "flight")]
    #[command(flatten)]
    Live(crate::live::args::LiveVerb),
}

/// Which configuration.
#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
pub enum ConfigKind {
    /// The vessel's side.
    Vessel,
    /// The drone's side.
    Drone,
    /// The simulated world.
    #[cfg(feature = "sim")]
    Scenario,
    /// The whole file of the vessel's computer, for `alight vessel`.
    #[cfg(feature = "flight")]
    VesselComputer,
    /// The whole file of the drone's computer, for `alight drone`.
    #[cfg(feature = "flight")]
    DroneComputer,
}

/// A configuration to print.
#[derive(Args, Debug)]
pub struct ConfigArgs {
    /// Which
    #[arg(value_enum)]
    pub kind: ConfigKind,
}
