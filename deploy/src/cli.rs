use std::{
    error::Error,
    ffi::OsString,
    fs,
    net::AddrParseError,
    num::{ParseFloatError, ParseIntError},
    path::{Path, PathBuf},
};

use alight_computer::{
    drone,
    drone::{autopilot, bridge, camera, mission, pilot},
    exit::{CliError, Doing, Exit},
    process::{
        args::{AutopilotArgs, CameraArgs, ProcessArgs, ServiceArgs},
        run,
    },
    subject::SHIPPED,
    terminal, vessel,
};
#[cfg(feature = "lab")]
use alight_lab as lab;
use alight_people::{
    explain,
    status::command as status,
    tools::{
        check, config, estimate, example, flights, init, keys, order, replay, replay::Laboratory, schema,
        tag, view,
    },
};
#[cfg(feature = "calibrate")]
use alight_plugins::calibrate;
#[cfg(feature = "ros2")]
use alight_plugins::ros2::command as ros2;
#[cfg(feature = "signalk")]
use alight_plugins::signalk::command as signalk;
use alight_uav::{
    camera::{CameraNode, uvdar::UvdarNode},
    computer::Installed as _,
    mission::MissionNode,
    pilot::Pilot,
    planner::Planner,
    predictor::Predictor,
};
use clap::{
    Arg, ArgAction, Command as Clap, CommandFactory, FromArgMatches, Id, Parser, Subcommand,
    builder::StyledStr,
    error::{ContextKind, ContextValue, ErrorKind},
};
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
#[command(after_help = "Start with:\n  \
alight trial                one landing, computed fast\n  \
alight trial --sea rough --plot landing.svg\n  \
alight trial --trials 100   a success rate, its interval\n  \
alight land                 one landing of all processes\n  \
alight rehearse             what the packages install\n  \
alight explain MESSAGE      what to do about a message\n  \
alight help install         a page: start install sensors\n  \
camera radio autopilots envelope crew operate view\n  \
ground-station commands examples firmware hazards\n  \
recordings\n\n\
Exit codes: 0 success, 1 failed landing, 2 bad input,\n3 this computer was too slow.")]
pub struct Cli {
    #[command(subcommand)]
    pub command: AlightCommand,
}

const GROUPS: [(&str, &[&str]); 3] = [
    ("Simulate", &["trial", "study", "land", "rehearse", "example"]),
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
        ],
    ),
    (
        "Operate",
        &["status", "view", "order", "ros2", "signalk", "flights", "replay"],
    ),
];

const FEATURES: [(&str, &str); 7] = [
    ("calibrate", "calibrate"),
    ("land", "lab"),
    ("rehearse", "lab"),
    ("ros2", "ros2"),
    ("signalk", "signalk"),
    ("study", "lab"),
    ("trial", "lab"),
];

macro_rules! pages {
    ($($name:literal)*) => {
        /// Pages of the documentation by topic, for installations without its files.
        const PAGES: &[(&str, &str)] = &[$(($name, include_str!(concat!("../docs/", $name, ".md")))),*];
    };
}
pages! {
    "start" "install" "autopilots" "sensors" "camera" "radio" "envelope" "crew" "operate" "view" "ground-station"
    "commands" "examples" "firmware" "recordings" "hazards"
}

/// Page of the topic in `alight help TOPIC`, before a command of that name: `alight view --help` prints its flags.
fn page(typed: &[OsString]) -> Option<&'static str> {
    let [_, help, topic] = typed else { return None };
    let topic = topic.to_str().filter(|_| help == "help")?;
    let topic = topic.trim_start_matches("docs/").trim_end_matches(".md");
    PAGES
        .iter()
        .find(|(name, _)| *name == topic)
        .map(|(_, text)| *text)
}

/// Line below the help of each command with the flags of a scene.
const SCENE: &str = "Scene (--sea, --wind, --hull, --vessel and more): alight help scene";

/// Hides the flags of a scene, which `alight help scene` prints; makes `--help` print the short help.
fn brief(command: Clap) -> Clap {
    let is_scene = command.get_name() == "scene";
    let groups = command
        .get_groups()
        .filter(|g| !is_scene && g.get_id() == "SceneArgs");
    let scene: Vec<Id> = groups.flat_map(|g| g.get_args().cloned()).collect();
    let after = command.get_after_help().map(ToString::to_string);
    let help = Arg::new("help").short('h').long("help");
    let help = help.action(ArgAction::HelpShort).help("Print help");
    let command = command
        .mut_args(|a| {
            let is_hidden = a.is_hide_set() || scene.contains(a.get_id());
            a.hide(is_hidden)
        })
        .disable_help_flag(true)
        .arg(help)
        .mut_subcommands(|c| brief(c).disable_help_subcommand(true));
    match after {
        _ if scene.is_empty() => command,
        None => command.after_help(SCENE),
        Some(text) => command.after_help(format!("{text}\n\n{SCENE}")),
    }
}

/// Flag of `command` that `typed` becomes when two neighbouring letters are swapped.
fn transposed(command: &Clap, typed: &str) -> Option<String> {
    let is_near = |long: &&str| {
        (1..long.len()).any(|k| {
            let mut letters = long.as_bytes().to_vec();
            letters.swap(k - 1, k);
            letters == typed.as_bytes()
        })
    };
    let near = command.get_arguments().filter_map(Arg::get_long).find(is_near)?;
    Some(format!("--{near}"))
}

fn named<'a>(cli: &'a Clap, typed: &[OsString]) -> &'a Clap {
    let mut command = cli;
    for name in typed.iter().skip(1) {
        let Some(inner) = command.find_subcommand(name) else {
            break;
        };
        command = inner;
    }
    command
}

/// Input that a parser of the standard library expects; its own error does not state it.
fn expected(cause: &(dyn Error + 'static)) -> Option<&'static str> {
    if cause.is::<ParseIntError>() {
        return Some("a whole number is needed, such as 3");
    }
    if cause.is::<ParseFloatError>() {
        return Some("a number is needed, such as 1.5");
    }
    if cause.is::<AddrParseError>() {
        return Some("ADDRESS:PORT is needed, such as 127.0.0.1:7450");
    }
    None
}

impl Cli {
    /// Reads the command line. On an error or a request for help, prints it and ends the process.
    pub fn read() -> Cli {
        let typed: Vec<OsString> = std::env::args_os().collect();
        if let Some(page) = page(&typed) {
            terminal::line(page.trim_end());
            std::process::exit(0);
        }
        let cli = Cli::grouped();
        let matches = cli.clone().try_get_matches_from(&typed);
        matches
            .and_then(|m| Cli::from_arg_matches(&m))
            .unwrap_or_else(|e| Self::reject(e, named(&cli, &typed), &typed))
    }
    /// Prints help, or the error of `command` with the expected input, and ends the process.
    fn reject(mut e: clap::Error, command: &Clap, typed: &[OsString]) -> ! {
        if let Some(help) = order::help(command, typed).filter(|_| e.kind() == ErrorKind::DisplayHelp) {
            terminal::line(help.trim_end());
            std::process::exit(0);
        }
        if let Some(ContextValue::String(typed)) = e.get(ContextKind::InvalidArg)
            && e.kind() == ErrorKind::UnknownArgument
            && let Some(flag) = transposed(command, typed.trim_start_matches('-'))
        {
            e.remove(ContextKind::Usage);
            e.insert(ContextKind::SuggestedArg, ContextValue::String(flag));
        }
        if let Some(ContextValue::String(typed)) = e.get(ContextKind::InvalidSubcommand)
            && let Some((name, feature)) = FEATURES.iter().find(|(name, _)| name == typed)
        {
            let text = format!(
                "error: this program was built without `{name}`; cargo build --release --features {feature} builds it"
            );
            terminal::note(true, text);
            std::process::exit(e.exit_code());
        }
        if let Some(cause) = e.source()
            && let Some(expected) = expected(cause)
            && let Some(arg) = e.get(ContextKind::InvalidArg)
            && let Some(value) = e.get(ContextKind::InvalidValue)
        {
            let text = format!("error: invalid value '{value}' for '{arg}': {cause}: {expected}");
            terminal::note(true, text);
            std::process::exit(e.exit_code());
        }
        e.exit();
    }
    /// Command line with its commands in groups; clap groups only options.
    fn grouped() -> Clap {
        let cli = brief(Cli::command());
        #[cfg(not(feature = "lab"))]
        let cli = cli.mut_subcommand("replay", |replay| replay.mut_arg("plot", |plot| plot.hide(true)));
        let line = |name: &&str| {
            let about = cli.find_subcommand(name)?.get_about()?;
            Some(format!("  {name:<9} {about}\n"))
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

#[derive(Subcommand, Debug)]
pub enum AlightCommand {
    /// Simulation and experiments.
    #[cfg(feature = "lab")]
    #[command(flatten)]
    Lab(Box<lab::LabCommand>),
    /// Ask for boat and drone; write, check both files.
    Init(init::InitArgs),
    /// Print configurations, messages, completions.
    #[command(subcommand)]
    Config(ConfigCommand),
    /// Run the estimator over a boat's recording.
    Estimate(estimate::EstimateArgs),
    /// List the flights recorded here, with outcomes.
    Flights(flights::FlightsArgs),
    /// Replay a flight: is it bit-identical?
    Replay(replay::ReplayArgs),
    /// Write files that the pages use; list them.
    Example(example::ExampleArgs),
    /// Show processes, topics, ages, link and mission.
    Status(status::StatusArgs),
    /// Show deck, drone and alarms in a browser.
    View(view::ViewCommand),
    /// Run a ROS 2 node: poses, diagnostics, orders.
    #[cfg(feature = "ros2")]
    Ros2(ros2::Ros2Args),
    /// Show deck, drone and alarms on Signal K.
    #[cfg(feature = "signalk")]
    #[command(name = "signalk")]
    SignalK(signalk::SignalKArgs),
    /// All processes of the vessel's computer.
    #[command(mut_arg("config", |a| a.required(false).default_value(SHIPPED[0])))]
    Vessel(ServiceArgs),
    /// All processes of the drone's computer.
    #[command(mut_arg("config", |a| a.required(false).default_value(SHIPPED[1])))]
    Drone(ServiceArgs),
    /// Order the drone to land, abort or hold.
    // `command` is the name of earlier versions, for one release more.
    #[command(name = "order", alias = "command")]
    Operate(order::CommandArgs),
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
    /// Process of the drone: the belly camera's images and tag detections.
    #[command(hide = true)]
    Camera(CameraArgs),
    /// Process of the drone: the ultraviolet camera's images and marker detections.
    #[command(hide = true)]
    Uvdar(CameraArgs),
    /// Make and show certificates of vessel and drone.
    Keys(keys::KeysArgs),
    /// Find faults that keep this computer from flying.
    Check(check::CheckArgs),
    /// List the deck's tags; print them at true scale.
    Tag(tag::TagArgs),
    /// Measure values for the files of boat and drone.
    #[cfg(feature = "calibrate")]
    Calibrate(calibrate::CalibrateArgs),
    /// Advice on a message of the mission.
    #[command(hide = true)]
    Explain(explain::ExplainArgs),
    /// Write manual pages for man(1) into a directory.
    #[command(hide = true)]
    Manual {
        /// Directory, which must exist.
        directory: PathBuf,
    },
}

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

/// Formats of the JSON lines exchanged with planners and predictors that are other programs.
const LINES: &[alight_shared::schema::LineFormat] = {
    #[cfg(feature = "lab")]
    let lines = &lab::exec::LINES;
    #[cfg(not(feature = "lab"))]
    let lines = &[];
    lines
};

impl AlightCommand {
    pub fn run(&self) -> Result<Exit, CliError> {
        match self {
            #[cfg(feature = "lab")]
            AlightCommand::Lab(c) => c.run(env!("ALIGHT_VERSION"), &view::start_viewer),
            AlightCommand::Init(a) => init::run(a),
            AlightCommand::Config(c) => c.run(),
            AlightCommand::Estimate(a) => estimate::run(a),
            AlightCommand::Flights(a) => flights::run(a),
            AlightCommand::Replay(a) => replay::run(a, &LABORATORY),
            AlightCommand::Example(a) => example::run(a),
            AlightCommand::Status(a) => status::run(a),
            AlightCommand::View(a) => view::run(a),
            #[cfg(feature = "ros2")]
            AlightCommand::Ros2(a) => ros2::run(a),
            #[cfg(feature = "signalk")]
            AlightCommand::SignalK(a) => signalk::run(a),
            AlightCommand::Vessel(a) => vessel::run(a),
            AlightCommand::Drone(a) => drone::run(a),
            AlightCommand::Operate(a) => order::run(a),
            AlightCommand::Bridge(a) => bridge::run(a),
            AlightCommand::Predictor(a) => run::run(a, Predictor::installed, ()),
            AlightCommand::Mission(a) => run::run(a, MissionNode::installed, mission::RejectionReport),
            AlightCommand::Planner(a) => run::run(a, Planner::installed, ()),
            AlightCommand::Pilot(a) => run::run(a, Pilot::installed, pilot::Ages::default()),
            AlightCommand::Estimator(a) => vessel::estimator::run(a),
            AlightCommand::Sensors(a) => vessel::sensors::run(a),
            AlightCommand::Autopilot(a) => autopilot::run(a),
            AlightCommand::Camera(a) => camera::run::<CameraNode>(a),
            AlightCommand::Uvdar(a) => camera::run::<UvdarNode>(a),
            AlightCommand::Keys(a) => keys::run(a),
            AlightCommand::Check(a) => check::run(a),
            AlightCommand::Tag(a) => tag::run(a),
            #[cfg(feature = "calibrate")]
            AlightCommand::Calibrate(a) => calibrate::run(a),
            AlightCommand::Explain(a) => explain::run(a),
            AlightCommand::Manual { directory } => {
                let doing = format_args!("writing manual pages to {}", directory.display());
                clap_mangen::generate_to(Cli::command(), directory).doing(doing)?;
                let mut cli = Cli::command();
                cli.build();
                name_values(&cli, directory).doing(doing)?;
                Ok(Exit::Success)
            }
        }
    }
}

/// Adds the values of the flags to the synopsis of each manual page; clap_mangen omits them.
fn name_values(command: &Clap, directory: &Path) -> std::io::Result<()> {
    let name = command.get_display_name().unwrap_or(command.get_name());
    let path = directory.join(format!("{name}.1"));
    if path.exists() {
        let mut page = fs::read_to_string(&path)?;
        let valued = command.get_arguments().filter(|a| a.get_action().takes_values());
        for arg in valued {
            let (Some(long), Some(names)) = (arg.get_long(), arg.get_value_names()) else {
                continue;
            };
            let flag = format!("[\\fB\\-\\-{}\\fR", long.replace('-', "\\-"));
            let values = names.join(" ").replace('-', "\\-");
            page = page.replace(&format!("{flag}]"), &format!("{flag} \\fI{values}\\fR]"));
        }
        fs::write(&path, page)?;
    }
    command
        .get_subcommands()
        .try_for_each(|c| name_values(c, directory))
}

/// Configurations, and data for other programs and shells.
#[derive(Subcommand, Debug)]
pub enum ConfigCommand {
    /// The configuration of the vessel's computer, as shipped.
    Vessel(config::ConfigArgs),
    /// The configuration of the drone's computer, as shipped.
    Drone(config::ConfigArgs),
    /// The configuration of the simulated world, with every default.
    #[cfg(feature = "lab")]
    Scenario,
    /// The configuration of the simulation's process (`alight world`), with every default.
    #[cfg(feature = "lab")]
    World,
    /// The messages on Zenoh and iceoryx2, or the fields of one.
    Schema(schema::SchemaArgs),
    /// A script that completes these commands in a shell.
    Completions {
        /// Shell to complete for.
        shell: Shell,
    },
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
            ConfigCommand::Schema(a) => schema::run(a, LINES),
            ConfigCommand::Completions { shell } => {
                let mut script = Vec::new();
                clap_complete::generate(*shell, &mut Cli::command(), "alight", &mut script);
                terminal::line(String::from_utf8_lossy(&script).trim_end());
                Ok(Exit::Success)
            }
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
        let shown = GROUPS.iter().map(|(_, names)| names.len()).sum::<usize>();
        assert_eq!(shown, 21);
    }

    fn all(command: &Clap, name: &str, found: &mut Vec<(String, Clap)>) {
        for inner in command.get_subcommands().filter(|c| !c.is_hide_set()) {
            let name = format!("{name} {}", inner.get_name());
            found.push((name.clone(), inner.clone()));
            all(inner, &name, found);
        }
    }

    #[test]
    fn help_within_40_lines() {
        let cli = Cli::grouped();
        let mut commands = Vec::new();
        all(&cli, "alight", &mut commands);
        let mut long = Vec::new();
        for (name, command) in commands {
            let text = command.term_width(80).render_help().to_string();
            let wide = text.lines().any(|l| l.chars().count() > 80);
            let lines = text.lines().count();
            if wide || lines > 40 {
                long.push(format!("{name}: {lines} lines"));
            }
        }
        assert!(long.is_empty(), "{long:#?}");
        let text = cli.term_width(60).render_help().to_string();
        assert!(text.lines().all(|l| l.chars().count() <= 60), "{text}");
    }
}
