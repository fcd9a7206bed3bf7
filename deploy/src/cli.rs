//! The command line.

use std::path::PathBuf;

use alight_computer::drone::{autopilot, bridge, camera, mission, pilot};
use alight_computer::exit::{CliError, Doing, Exit};
use alight_computer::process::args::{AutopilotArgs, CameraArgs, ProcessArgs, ServiceArgs};
use alight_computer::process::shell;
use alight_computer::{drone, terminal, vessel};
#[cfg(feature = "lab")]
use alight_lab as lab;
use alight_people::status::command as status;
use alight_people::tools::replay::Laboratory;
use alight_people::tools::{
    calibrate, check, command, config, estimate, flights, init, keys, replay, ros2, schema, signalk, tag,
    view,
};
use alight_shared::process::ProcessKind;
use alight_uav::planner::Planner;
use alight_uav::predictor::Predictor;
use clap::builder::StyledStr;
use clap::error::ErrorKind;
use clap::{Command as Clap, CommandFactory, FromArgMatches, Parser, Subcommand};
use clap_complete::Shell;

/// Lands a multirotor on the deck of a small boat that moves and rocks in waves.
#[derive(Parser, Debug)]
#[command(
    version = env!("ALIGHT_VERSION"),
    about,
    arg_required_else_help = true,
    max_term_width = 80,
    subcommand_value_name = "COMMAND"
)]
#[command(
    after_help = "Start with:\n  alight land                      one landing of all processes, in real time\n  \
alight trial                     the same computed as fast as it goes\n  \
alight trial --sea rough --plot landing.svg\n  alight trials --trials 100        a success rate with its interval\n  \
alight rehearse                  what the packages install, on simulated vehicles\n\n\
Exit codes: 0 success, 1 failed landing, 2 bad input, 3 this computer was too slow."
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands that a person gives, by what they are for, in the order in which they are met.
const GROUPS: [(&str, &[&str]); 3] = [
    (
        "Simulate",
        &[
            "land", "trial", "trials", "storm", "rare", "study", "envelope", "rao", "rehearse", "link",
        ],
    ),
    (
        "Install",
        &[
            "init",
            "config",
            "keys",
            "check",
            "calibrate",
            "estimate",
            "tag",
            "vessel",
            "drone",
            "completions",
        ],
    ),
    (
        "Operate",
        &[
            "status", "view", "command", "ros2", "signalk", "schema", "flights", "replay",
        ],
    ),
];

impl Cli {
    /// Reads the command line; on an error, or where help is asked for, prints that and ends the process.
    pub fn read() -> Cli {
        let matches = Cli::grouped().try_get_matches();
        matches
            .and_then(|m| Cli::from_arg_matches(&m))
            .unwrap_or_else(|e| Self::reject(&e))
    }
    /// Shows the error, where a number was expected in words of what is wanted, and ends the process.
    fn reject(e: &clap::Error) -> ! {
        if e.kind() != ErrorKind::ValueValidation {
            e.exit();
        }
        terminal::note(true, Self::in_words(&e.render().to_string()).trim_end());
        std::process::exit(e.exit_code());
    }
    fn in_words(text: &str) -> String {
        [
            (
                "invalid digit found in string",
                "a whole number is needed, such as 3",
            ),
            (
                "cannot parse integer from empty string",
                "a whole number is needed, such as 3",
            ),
            (
                "number too large to fit in target type",
                "a smaller number is needed",
            ),
            (
                "number too small to fit in target type",
                "a larger number is needed",
            ),
            ("invalid float literal", "a number is needed, such as 1.5"),
            (
                "cannot parse float from empty string",
                "a number is needed, such as 1.5",
            ),
        ]
        .iter()
        .fold(text.to_owned(), |text, (said, wanted)| text.replace(said, wanted))
    }
    /// The command line with its commands in groups, which clap has for options alone.
    fn grouped() -> Clap {
        let cli = Cli::command();
        #[cfg(not(feature = "lab"))]
        let cli = cli.mut_subcommand("replay", |replay| replay.mut_arg("plot", |plot| plot.hide(true)));
        let line = |name: &&str| {
            let about = cli.find_subcommand(name)?.get_about()?;
            Some(format!("  {name:<11} {about}\n"))
        };
        let group = |(title, names): (&str, &[&str])| {
            let lines: String = names.iter().filter_map(line).collect();
            format!("{title}:\n{lines}\n")
        };
        let groups: String = GROUPS.into_iter().map(group).collect();
        let hidden = cli
            .get_subcommands()
            .filter(|c| c.is_hide_set() && c.get_about().is_some_and(is_process));
        let hidden: Vec<&str> = hidden.map(Clap::get_name).collect();
        let template = format!(
            "{{about}}\n\n{{usage-heading}} {{usage}}\n\n{groups}Processes that these start:\n  {}\n\n\
             Options:\n{{options}}{{after-help}}",
            hidden
                .chunks(6)
                .map(|c| c.join(", "))
                .collect::<Vec<_>>()
                .join(",\n  ")
        );
        cli.help_template(template)
    }
}

fn is_process(about: &StyledStr) -> bool {
    about.to_string().starts_with("Process of ")
}

/// What to do.
#[derive(Subcommand, Debug)]
pub enum Command {
    /// Simulation and experiments.
    #[cfg(feature = "lab")]
    #[command(flatten)]
    Lab(Box<lab::LabCommand>),
    /// Ask for boat and drone; write and check both configurations.
    Init(init::InitArgs),
    /// Print a configuration, to start from.
    #[command(subcommand)]
    Config(ConfigCommand),
    /// Run the estimator over a boat's recording; show how well it fits.
    Estimate(estimate::EstimateArgs),
    /// List the flights that this computer recorded, with outcomes.
    Flights(flights::FlightsArgs),
    /// Compute a flight again: is every output bit-identical?
    Replay(replay::ReplayArgs),
    /// Show what runs: processes, topics, ages, drops, link and mission.
    Status(status::StatusArgs),
    /// Show what runs in a browser or in Foxglove: deck, drone, alarms.
    View(view::ViewCommand),
    /// Be a node of ROS 2: poses, diagnostics, orders to land and abort.
    Ros2(ros2::Ros2Args),
    /// List the messages on Zenoh and iceoryx2, and the fields of one.
    Schema(schema::SchemaArgs),
    /// Show deck, drone and alarms on the boat's Signal K server.
    #[command(name = "signalk")]
    SignalK(signalk::SignalKArgs),
    /// All processes of the vessel's computer, as its service runs them.
    Vessel(ServiceArgs),
    /// All processes of the drone's computer, as its service runs them.
    Drone(ServiceArgs),
    /// Command the drone to land, abort or hold, and show its answer.
    #[command(name = "command")]
    Operate(command::CommandArgs),
    /// Process of the drone: the radio.
    #[command(hide = true)]
    Bridge(ProcessArgs),
    /// Process of the drone: prediction of the deck.
    #[command(hide = true)]
    Predictor(ProcessArgs),
    /// Process of the drone: the mission, a state machine.
    #[command(hide = true)]
    Mission(ProcessArgs),
    /// Process of the drone: the planner.
    #[command(hide = true)]
    Planner(ProcessArgs),
    /// Process of the drone: the pilot, set-points.
    #[command(hide = true)]
    Pilot(ProcessArgs),
    /// Process of the vessel: estimator, deck arbiter and broadcast.
    #[command(hide = true)]
    Estimator(ProcessArgs),
    /// Process of the vessel: its real sensors (NMEA, Signal K, UBX, MAVLink).
    #[command(hide = true)]
    Sensors(ProcessArgs),
    /// Process of the drone: the link to a real autopilot (PX4, ArduCopter) by MAVLink.
    #[command(hide = true)]
    Autopilot(AutopilotArgs),
    /// Process of the drone: the belly camera's images, and the tag in them.
    #[command(hide = true)]
    Camera(CameraArgs),
    /// Process of the drone: the ultraviolet camera's images, and the markers in them.
    #[command(hide = true)]
    Uvdar(CameraArgs),
    /// Make certificates of vessel and drone; show when they expire.
    Keys(keys::KeysArgs),
    /// Find what keeps this computer from flying, with the remedy.
    Check(check::CheckArgs),
    /// List the deck's tags, and print them at true scale.
    Tag(tag::TagArgs),
    /// Measure what the configuration of this vessel and this drone needs.
    Calibrate(calibrate::CalibrateArgs),
    /// Print what completes these commands in a shell.
    Completions {
        /// Which shell.
        shell: Shell,
    },
    /// Write manual pages for man(1) into a directory.
    #[command(hide = true)]
    Manual {
        /// The directory, which exists.
        directory: PathBuf,
    },
}

/// What a replay has of the laboratory.
const LABORATORY: Laboratory<'static> = {
    #[cfg(feature = "lab")]
    let laboratory = Laboratory {
        law: &lab::record::law,
        plot: Some(&lab::replay_plot::begin),
    };
    #[cfg(not(feature = "lab"))]
    let laboratory = Laboratory {
        law: &|_, _| Ok(None),
        plot: None,
    };
    laboratory
};

impl Command {
    /// Runs it to its end.
    pub fn run(&self) -> Result<Exit, CliError> {
        match self {
            #[cfg(feature = "lab")]
            Command::Lab(c) => c.run(&view::start_viewer),
            Command::Init(a) => init::run(a),
            Command::Config(c) => c.run(),
            Command::Estimate(a) => estimate::run(a),
            Command::Flights(a) => flights::run(a),
            Command::Replay(a) => replay::run(a, &LABORATORY),
            Command::Status(a) => status::run(a),
            Command::View(a) => view::run(a),
            Command::Ros2(a) => ros2::run(a),
            Command::Schema(a) => schema::run(a),
            Command::SignalK(a) => signalk::run(a),
            Command::Vessel(a) => vessel::run(a),
            Command::Drone(a) => drone::run(a),
            Command::Operate(a) => command::run(a),
            Command::Bridge(a) => bridge::run(a),
            Command::Predictor(a) => shell::run::<Predictor>(a, ()),
            Command::Mission(a) => shell::run(a, mission::Rejections),
            Command::Planner(a) => shell::run::<Planner>(a, ()),
            Command::Pilot(a) => shell::run(a, pilot::Ages::default()),
            Command::Estimator(a) => vessel::estimator::run(a),
            Command::Sensors(a) => vessel::sensors::run(a),
            Command::Autopilot(a) => autopilot::run(a),
            Command::Camera(a) => camera::run(a, ProcessKind::Camera),
            Command::Uvdar(a) => camera::run(a, ProcessKind::Uvdar),
            Command::Keys(a) => keys::run(a),
            Command::Check(a) => check::run(a),
            Command::Tag(a) => tag::run(a),
            Command::Calibrate(a) => calibrate::run(a),
            Command::Completions { shell } => {
                let mut script = Vec::new();
                clap_complete::generate(*shell, &mut Cli::command(), "alight", &mut script);
                terminal::line(String::from_utf8_lossy(&script).trim_end());
                Ok(Exit::Success)
            }
            Command::Manual { directory } => {
                let doing = format_args!("writing manual pages to {}", directory.display());
                clap_mangen::generate_to(Cli::command(), directory).doing(doing)?;
                Ok(Exit::Success)
            }
        }
    }
}

/// Whose configuration.
#[derive(Subcommand, Debug)]
pub enum ConfigCommand {
    /// The vessel's computer's, as it is shipped.
    Vessel(config::ConfigArgs),
    /// The drone's computer's, as it is shipped.
    Drone(config::ConfigArgs),
    /// The simulated world's, with every default.
    #[cfg(feature = "lab")]
    Scenario,
    /// The process's of the simulation (`alight world`), with every default.
    #[cfg(feature = "lab")]
    World,
}

impl ConfigCommand {
    fn run(&self) -> Result<Exit, CliError> {
        match self {
            ConfigCommand::Vessel(a) => config::vessel(a),
            ConfigCommand::Drone(a) => config::drone(a),
            #[cfg(feature = "lab")]
            ConfigCommand::Scenario => lab::scene::print_defaults(),
            #[cfg(feature = "lab")]
            ConfigCommand::World => lab::live::config::print_world(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn help_groups() {
        let cli = Cli::command();
        cli.clone().debug_assert();
        let grouped = |name: &str| GROUPS.iter().filter(|(_, names)| names.contains(&name)).count();
        for command in cli.get_subcommands() {
            let shown = usize::from(!command.is_hide_set());
            assert_eq!(grouped(command.get_name()), shown, "{}", command.get_name());
        }
    }
}
