#[cfg(test)]
use std::ffi::OsString;
use std::{
    ffi::OsStr,
    fmt,
    hash::{BuildHasher as _, RandomState},
    path::PathBuf,
    str::FromStr,
};

use alight_computer::{
    process::args::{ViewArgs, mcap_file},
    quantity::{duration_s, speed_mps, whole},
    terminal::Form,
};
use alight_shared::msg::State;
use alight_sim::{
    baselines::Baseline,
    harness::scenario::NodeConfigs,
    physics::{sea::SeaConfig, vessel, vessel::response::HULLS},
};
use alight_uav::planner::PlannerKind;
use clap::{
    Arg, Args, Command, ValueEnum,
    builder::{PossibleValue, StringValueParser, TypedValueParser},
};

use super::{exec, study::definition};

/// Parses the flags that follow the name of the command, which is the first of `arguments`.
#[cfg(test)]
pub fn typed<T: Args>(arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> T {
    let matches = T::augment_args(Command::new("alight")).try_get_matches_from(arguments);
    T::from_arg_matches(&matches.unwrap()).unwrap()
}

#[derive(Clone)]
pub struct Offering<P>(P, Vec<PossibleValue>);

/// Parser that offers `names` in help, manual pages and completions for a value that `reader` parses.
pub fn offering<P>(reader: P, names: impl IntoIterator<Item: Into<PossibleValue>>) -> Offering<P> {
    Offering(reader, names.into_iter().map(Into::into).collect())
}

impl<P: TypedValueParser> TypedValueParser for Offering<P> {
    type Value = P::Value;
    fn parse_ref(
        &self,
        command: &Command,
        arg: Option<&Arg>,
        value: &OsStr,
    ) -> Result<P::Value, clap::Error> {
        self.0.parse_ref(command, arg, value)
    }
    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(self.1.iter().cloned()))
    }
}

#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
pub enum PlannerArg {
    /// The paper's planner: attitude weights that grow near the deck (FAA).
    MpcFaa,
    /// MPC without FAA.
    Mpc,
    /// Alight's planner: position, velocity and attitude match the deck's at a chosen time.
    Alight,
    /// Baseline of Gupta et al.: Fourier modes of the tag's pose; lands when the tilt permits it.
    MpcNe,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PlannerChoice {
    Included(PlannerArg),
    /// Command with its prefix.
    Exec(String),
}

impl PlannerChoice {
    pub fn select(&self, nodes: &mut NodeConfigs) {
        nodes.baseline = None;
        nodes.own = None;
        match self {
            PlannerChoice::Included(PlannerArg::MpcFaa) => nodes.drone.planner.kind = PlannerKind::MpcFaa,
            PlannerChoice::Included(PlannerArg::Alight) => nodes.drone.planner.kind = PlannerKind::Alight,
            PlannerChoice::Included(PlannerArg::Mpc) => nodes.baseline = Some(Baseline::Mpc),
            PlannerChoice::Included(PlannerArg::MpcNe) => nodes.baseline = Some(Baseline::MpcNe),
            PlannerChoice::Exec(text) => nodes.own = Some(exec::planner(text)),
        }
    }
}

impl FromStr for PlannerChoice {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match command(text) {
            Some(text) => text.map(PlannerChoice::Exec),
            None => PlannerArg::from_str(text, false)
                .map(PlannerChoice::Included)
                .map_err(|_| "no planner of that name: alight, mpc-faa, mpc, mpc-ne or exec:COMMAND".into()),
        }
    }
}

impl fmt::Display for PlannerChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PlannerChoice::Included(planner) => {
                let value = planner.to_possible_value();
                f.write_str(value.as_ref().map_or("", PossibleValue::get_name))
            }
            PlannerChoice::Exec(text) => f.write_str(text),
        }
    }
}

fn planner() -> impl TypedValueParser<Value = PlannerChoice> {
    let included = PlannerArg::value_variants().iter();
    offering(
        PlannerChoice::from_str,
        included.filter_map(ValueEnum::to_possible_value),
    )
}

/// `exec:COMMAND` or `exec-measured:COMMAND`; None without such a prefix.
fn command(text: &str) -> Option<Result<String, String>> {
    Some(match exec::command(text)?.trim() {
        "" => Err("name its command: exec:python3 mine.py".into()),
        _ => Ok(text.into()),
    })
}

#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
pub enum AutopilotArg {
    /// PX4.
    Px4,
    /// ArduCopter.
    Ardupilot,
}

#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
pub enum CourseArg {
    /// Engines off.
    Drift,
    /// A straight line at --speed.
    Straight,
    /// A square path at --speed.
    Square,
    /// Turns by 20 to 40 deg to either side every 10 to 20 s, at --speed.
    Zigzag,
    /// A straight line at --speed with one turn by 45 to 120 deg, up to 4 s after the first descent begins.
    Turn,
    /// A straight line with one change of --speed by half, up to 4 s after the first descent begins.
    SpeedChange,
    /// Station-keeping, in the limit cycle of thrusters with a dead band (drawn, 20 to 50 s)
    StationKeeping,
    /// Sheering about an anchor by 20 to 40 deg to either side.
    Anchored,
}

impl From<CourseArg> for vessel::VesselCourse {
    fn from(course: CourseArg) -> Self {
        match course {
            CourseArg::Drift => vessel::VesselCourse::Drift,
            CourseArg::Straight => vessel::VesselCourse::Straight,
            CourseArg::Square => vessel::VesselCourse::Square,
            CourseArg::Zigzag => vessel::VesselCourse::Zigzag,
            CourseArg::Turn => vessel::VesselCourse::Turn,
            CourseArg::SpeedChange => vessel::VesselCourse::SpeedChange,
            CourseArg::StationKeeping => vessel::VesselCourse::StationKeeping,
            CourseArg::Anchored => vessel::VesselCourse::Anchored,
        }
    }
}

pub const PHASES: [(&str, State); 8] = [
    ("get-altitude", State::GetAltitude),
    ("approach", State::Approach),
    ("search", State::Search),
    ("tracking", State::Tracking),
    ("tracking-stable", State::TrackingStable),
    ("descent", State::Descent),
    ("flare", State::Flare),
    ("landed", State::Landed),
];

pub fn phase(name: &str) -> Result<State, String> {
    let found = PHASES.iter().find(|(n, _)| *n == name).map(|(_, state)| *state);
    found.ok_or_else(|| format!("no phase of that name: {}", PHASES.map(|p| p.0).join(", ")))
}

/// Start of a radio outage: the mission's first entry into a phase, or never.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutageAt(pub Option<State>);

impl FromStr for OutageAt {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "never" => Ok(OutageAt(None)),
            name => phase(name).map(|state| OutageAt(Some(state))),
        }
    }
}

impl fmt::Display for OutageAt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let phase = PHASES.iter().find(|(_, state)| Some(*state) == self.0);
        f.write_str(phase.map_or("never", |(name, _)| name))
    }
}

#[derive(Clone, Debug)]
pub struct SeaArg {
    pub text: String,
    pub config: SeaConfig,
}

impl FromStr for SeaArg {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        if text.parse::<f64>().is_ok() {
            return Err(
                "a sea by its state is --sea-state, 1 to 5; --sea takes a name or AMPLITUDE_M,PERIOD_S"
                    .into(),
            );
        }
        Ok(SeaArg {
            text: text.into(),
            config: text.parse()?,
        })
    }
}

/// Seed, or one that is drawn: `random`.
fn seed(text: &str) -> Result<u64, String> {
    if text == "random" {
        // Exact in JSON numbers, and with room for many trials.
        return Ok(RandomState::new().hash_one(0) >> 16);
    }
    text.parse()
        .map_err(|_| "a whole number is needed, or random".into())
}

fn on_off(text: &str) -> Result<bool, String> {
    match text {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err("give on or off".into()),
    }
}

/// Named seas; other seas are given as amplitude and period, or as wave systems.
const SEAS: [&str; 5] = ["calm", "slight", "moderate", "rough", "very-rough"];

pub fn sea() -> impl TypedValueParser<Value = SeaArg> {
    offering(SeaArg::from_str, SEAS)
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WindArg {
    /// Wind that raises the given sea, blowing along its waves.
    Auto,
    Mean(f64),
}

impl FromStr for WindArg {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(WindArg::Auto);
        }
        speed_mps(text)
            .map(WindArg::Mean)
            .map_err(|e| format!("{e}; or auto"))
    }
}

impl fmt::Display for WindArg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            WindArg::Auto => f.write_str("auto"),
            WindArg::Mean(speed) => write!(f, "{speed}"),
        }
    }
}

/// Scene of a trial.
#[derive(Args, Debug, Clone)]
pub struct SceneArgs {
    /// Sea by name, AMPLITUDE_M,PERIOD_S, or wave systems by significant height (m), peak period (s) and direction
    /// from the mean (deg): jonswap:0.8,4.5+pm:1,8@60 [default: moderate; with --hull jonswap:1,5]
    #[arg(long, value_name = "NAME|A,T|SYSTEMS", allow_hyphen_values = true, value_parser = sea())]
    pub sea: Option<SeaArg>,
    /// Fully developed sea of this state, 1 to 5 (WMO code table 3700: height in the middle of its class; period of
    /// Pierson and Moskowitz)
    #[arg(long, value_name = "1..5", conflicts_with = "sea",
          value_parser = whole::<u8>(1..=5))]
    pub sea_state: Option<u8>,
    /// Hull that the sea moves by its response table, instead of the simulated one: a name or a CSV with a .toml of the
    /// same name
    #[arg(long, value_name = "NAME|FILE.csv", conflicts_with = "deck_motion",
          value_parser = offering(StringValueParser::new(), HULLS))]
    pub hull: Option<String>,
    /// Planner to fly, or exec:COMMAND, a program of yours (alight help examples) with the solve times that it states;
    /// exec-measured:COMMAND with those measured [default: that of the configuration, alight]
    #[arg(long, value_name = "NAME|exec:COMMAND", value_parser = planner())]
    pub planner: Option<PlannerChoice>,
    /// Program of yours that predicts the deck (alight help examples)
    #[arg(long, value_name = "exec:COMMAND",
          value_parser = |text: &str| command(text).unwrap_or(Err("give exec:COMMAND".into())))]
    pub predictor: Option<String>,
    /// Firmware that the simulated autopilot resembles [default: that of the scenario, px4]
    #[arg(long, value_enum)]
    pub autopilot: Option<AutopilotArg>,
    /// Course of the vessel [default: drift]
    #[arg(long, value_enum)]
    pub vessel: Option<CourseArg>,
    /// Vessel's speed on a course under way, m/s, or with a unit: 5kn [default: 2]
    #[arg(long, value_name = "M/S", allow_negative_numbers = true, value_parser = speed_mps)]
    pub speed: Option<f64>,
    /// Mean wind with gusts, m/s, or with a unit: 15kn; auto: wind that raises the sea, along its waves [default: 0]
    #[arg(long, value_name = "M/S|auto", allow_negative_numbers = true,
          value_parser = offering(WindArg::from_str, ["auto"]))]
    pub wind: Option<WindArg>,
    /// Draw noise, inertia, drag, lag, friction, deck and hull per seed around the nodes' values, and start the
    /// autopilot with another hover thrust [default: on with --hull]
    #[arg(long, value_name = "on|off", value_parser = offering(on_off, ["on", "off"]))]
    pub draws: Option<bool>,
    /// Phase at whose first entry a radio outage begins [default: never]
    #[arg(long, value_name = "PHASE",
          value_parser = offering(OutageAt::from_str, PHASES.map(|p| p.0)))]
    pub outage_at: Option<OutageAt>,
    /// Duration of the outage, s, or with a unit: 5min [default: for good]
    #[arg(long, value_name = "TIME", requires = "outage_at", value_parser = duration_s)]
    pub outage_duration: Option<f64>,
    /// Time after the landing at which its position is evaluated, s
    #[arg(long, value_name = "TIME", value_parser = duration_s)]
    pub stay: Option<f64>,
    /// Descend at a random moment, regardless of the predicted probability, to compare prediction and result
    #[arg(long)]
    pub begin_anyway: bool,
    /// Scenario file (TOML; `alight config scenario` prints the defaults); flags override it
    #[arg(long, value_name = "FILE")]
    pub scenario: Option<PathBuf>,
    /// Configuration of the vessel's side (TOML; `alight config vessel`)
    #[arg(long, value_name = "FILE")]
    pub vessel_config: Option<PathBuf>,
    /// Configuration of the drone's side (TOML; `alight config drone`)
    #[arg(long, value_name = "FILE")]
    pub drone_config: Option<PathBuf>,
    /// Keys of the method (TOML; `alight config drone --tuning` prints them), which flight configurations do not set
    #[arg(long, value_name = "FILE")]
    pub tuning: Option<PathBuf>,
    /// Recorded deck motion instead of the simulated vessel: CSV with t_s, roll_deg, pitch_deg and any of heave_m,
    /// heading_deg, surge_m, sway_m; without --sea the water moves with its heave
    #[arg(long, value_name = "FILE.csv")]
    pub deck_motion: Option<PathBuf>,
    /// Factor on the recorded deviations [default: 1]
    #[arg(long, value_name = "FACTOR", requires = "deck_motion")]
    pub motion_scale: Option<f64>,
    /// Factor on the recording's speed [default: 1]
    #[arg(long, value_name = "FACTOR", requires = "deck_motion")]
    pub motion_speed: Option<f64>,
    /// Start of the trial in the recording, s [default: 0]
    #[arg(long, value_name = "TIME", requires = "deck_motion", value_parser = duration_s)]
    pub motion_start: Option<f64>,
    /// Render the belly camera and detect the tag in its images, instead of simulating detections by a measurement
    /// model
    #[arg(long)]
    pub render_camera: bool,
    /// Keep the recording's mean tilt instead of removing it
    #[arg(long, requires = "deck_motion")]
    pub keep_mean: bool,
}

impl SceneArgs {
    pub fn given(&self) -> Vec<(&'static str, String)> {
        fn text<T: ToString>(value: Option<&T>) -> Option<String> {
            value.map(ToString::to_string)
        }
        fn named<T: ValueEnum>(value: Option<&T>) -> Option<String> {
            Some(value?.to_possible_value()?.get_name().into())
        }
        let path = |p: &Option<PathBuf>| p.as_ref().map(|p| p.display().to_string());
        let set = |on: bool| on.then(String::new);
        let flags = [
            ("scenario", path(&self.scenario)),
            ("vessel-config", path(&self.vessel_config)),
            ("drone-config", path(&self.drone_config)),
            ("tuning", path(&self.tuning)),
            ("sea", self.sea.as_ref().map(|s| s.text.clone())),
            ("sea-state", text(self.sea_state.as_ref())),
            ("hull", self.hull.clone()),
            ("planner", text(self.planner.as_ref())),
            ("predictor", self.predictor.clone()),
            ("autopilot", named(self.autopilot.as_ref())),
            ("vessel", named(self.vessel.as_ref())),
            ("speed", text(self.speed.as_ref())),
            ("draws", self.draws.map(|on| if on { "on" } else { "off" }.into())),
            ("wind", text(self.wind.as_ref())),
            ("stay", text(self.stay.as_ref())),
            ("begin-anyway", set(self.begin_anyway)),
            ("outage-at", text(self.outage_at.as_ref())),
            ("outage-duration", text(self.outage_duration.as_ref())),
            ("deck-motion", path(&self.deck_motion)),
            ("motion-scale", text(self.motion_scale.as_ref())),
            ("motion-speed", text(self.motion_speed.as_ref())),
            ("motion-start", text(self.motion_start.as_ref())),
            ("render-camera", set(self.render_camera)),
            ("keep-mean", set(self.keep_mean)),
        ];
        flags
            .into_iter()
            .filter_map(|(name, value)| Some((name, value?)))
            .collect()
    }
}

/// One landing, or many.
#[derive(Args, Debug)]
#[command(
    after_help = "With --view the landing runs in real time once the drone has appeared. It\n\
waits for no viewer, and ends with the flight, or 10 s later with a viewer."
)]
pub struct TrialArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Seed of sea, noise and start, or the first of many: the same seed gives the same bits; random: none that a
    /// planner could know
    #[arg(long, alias = "seed0", default_value_t = 1, allow_negative_numbers = true, value_parser = seed)]
    pub seed: u64,
    /// Fly N landings, and print the success rate with its interval
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=1_000_000),
          conflicts_with_all = ["plot", "record", "view"])]
    pub trials: Option<u32>,
    /// Threads of --trials [default: all cores]
    #[arg(long, value_name = "N", requires = "trials", value_parser = whole::<u16>(1..=1024))]
    pub jobs: Option<u16>,
    /// Spread the starts of --trials over the recording: trial i begins at motion-start + i * this, s
    #[arg(long, value_name = "TIME", requires = "trials", requires = "deck_motion", value_parser = duration_s)]
    pub motion_stride: Option<f64>,
    /// Also write one line per landing of --trials (CSV) to this file
    #[arg(long, value_name = "FILE.csv", requires = "trials")]
    pub rows: Option<PathBuf>,
    /// Draw paths, speeds and attitudes to an SVG
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// Record everything to an MCAP file, for Foxglove, Lichtblick, Rerun and `alight replay`
    #[arg(long, value_name = "FILE.mcap", value_parser = mcap_file)]
    pub record: Option<PathBuf>,
    #[command(flatten)]
    pub view: ViewArgs,
    /// Output format.
    #[command(flatten)]
    pub form: Form,
}

#[derive(Clone, Copy, Debug)]
pub struct Shard {
    /// Number of the shard, from 1.
    pub index: u64,
    pub count: u64,
}

impl FromStr for Shard {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is not a shard: give I/N with 1 <= I <= N <= 100000, e.g. 2/8");
        let (i, n) = text.split_once('/').ok_or_else(wrong)?;
        let index = i.parse().map_err(|_| wrong())?;
        let count = n.parse().map_err(|_| wrong())?;
        if !(1..=100_000).contains(&count) || !(1..=count).contains(&index) {
            return Err(wrong());
        }
        Ok(Shard { index, count })
    }
}

/// Study to fly.
#[derive(Args, Debug)]
pub struct StudyArgs {
    /// Study by name, or a study file (alight help commands)
    #[arg(value_name = "STUDY|FILE.toml",
          value_parser = offering(StringValueParser::new(), definition::offered()))]
    pub name: Option<String>,
    /// Directories of shards, for merge
    pub dirs: Vec<PathBuf>,
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Planners to compare [default: the study's]
    ///
    /// A study without planners flies the configured one.
    #[arg(long, value_name = "NAME,..", value_parser = planner(), value_delimiter = ',')]
    pub planners: Vec<PlannerChoice>,
    /// Trials per row
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = whole::<u32>(1..=1_000_000))]
    pub trials: u32,
    /// First seed, or random [default: 1; a benchmark's own]
    #[arg(long, value_name = "SEED", value_parser = seed)]
    pub seed0: Option<u64>,
    /// Threads [default: all cores]
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=1024))]
    pub jobs: Option<u16>,
    /// Directory for rows and table
    ///
    /// A study that was interrupted continues there. The files are rows.csv and summary.json (the output of --json), and
    /// the scenes and configurations of the rows, for replay. `python3 -m alight DIR` draws it.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Fly only part I of N, for several machines
    #[arg(long, value_name = "I/N")]
    pub shard: Option<Shard>,
    /// Fly only this row, counted from 1
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=u32::MAX.into()))]
    pub row: Option<u32>,
    /// Print commands of SEEDS seeds, for a scheduler
    ///
    /// Nothing is flown. Each line is a command of one row, for example for HyperQueue.
    #[arg(long, value_name = "SEEDS", value_parser = whole::<u32>(1..=u32::MAX.into()),
        conflicts_with_all = ["shard", "row", "json", "csv", "within"])]
    pub tasks: Option<u32>,
    /// Write the decks' motion as CSV: truth, sensors
    ///
    /// Motion of the first seed, from the beginning of the warm-up. No drone lands. README.txt names the columns.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["shard", "tasks", "out", "json", "csv", "within"])]
    pub motion: Option<PathBuf>,
    /// Compare the drones' forecasts with the true decks
    ///
    /// RMS error and fraction within the stated 95 % at 0.5, 1, 2 and 3 s, in the frame of the drone's odometry, while it
    /// sees the deck. ridge: regression on the true motion of two minutes; held: the forecast's present, unchanged. Rows
    /// with --predictor are also flown with the drone's own one.
    #[arg(long, conflicts_with_all = ["shard", "tasks", "motion", "verify", "out", "within"])]
    pub forecasts: bool,
    /// Fly these rows again, and compare digests
    #[arg(long, value_name = "result.json", conflicts_with_all = ["shard", "tasks", "motion", "out", "json", "csv", "within"])]
    pub verify: Option<PathBuf>,
    /// End a row once its rate is known to PERCENT %
    ///
    /// PERCENT applies upward and downward. The interval is Wilson's of 95 %, computed every 20 trials; a row has at
    /// most --trials.
    #[arg(long, value_name = "PERCENT", value_parser = whole::<u8>(1..=50), conflicts_with = "shard")]
    pub within: Option<u8>,
    /// Output format.
    #[command(flatten)]
    pub form: Form,
}

/// Wind of an envelope, m/s, bounded so that with the vessel's own speed it remains within a scenario's range.
fn wind_speed(text: &str) -> Result<f64, String> {
    let speed = speed_mps(text).ok().filter(|v| (0.5..=20.0).contains(v));
    speed.ok_or_else(|| format!("`{text}` is not a valid wind: give 0.5 to 20 m/s"))
}

/// Envelope to fly.
#[derive(Args, Debug)]
#[command(
    after_help = "Start with:\n  alight study envelope --quick --hull mono-5m --drone-config drone.toml\n\n\
The boat is --hull with --vessel-config (deck, keep-out volumes) and --vessel, --speed; the drone is --drone-config."
)]
pub struct EnvelopeArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Fly a coarse grid: about ten minutes on two cores
    #[arg(long)]
    pub quick: bool,
    /// Relative winds, m/s, or with a unit: 10kn [default: 2,4,6,8,10,12,14; with --quick 4,6,8,10,12]
    #[arg(long, value_name = "M/S,..", value_delimiter = ',', value_parser = wind_speed)]
    pub winds: Vec<f64>,
    /// Number of wind directions, evenly spaced all round [default: 12; with --quick 8]
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=36))]
    pub directions: Option<u16>,
    /// Sea states (WMO code table 3700) [default: 1,2,3,4; with --quick 2,3,4]
    #[arg(long, value_name = "1..5,..", value_delimiter = ',', value_parser = whole::<u8>(1..=5))]
    pub sea_states: Vec<u8>,
    /// Landings per cell [default: enough to show --rate, 35 for 90 %; with --quick 5]
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=10_000))]
    pub trials: Option<u32>,
    /// Percentage of landings that must succeed up to the limit, by the lower end of the 95 % interval
    #[arg(long, value_name = "PERCENT", default_value_t = 90, value_parser = whole::<u8>(50..=99))]
    pub rate: u8,
    /// First seed
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    pub seed0: u64,
    /// Threads [default: all cores]
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=1024))]
    pub jobs: Option<u16>,
    /// Directory for cells and rows; an interrupted run continues there
    ///
    /// The files are envelope.json and rows.csv. `python3 -m alight DIR` draws it.
    #[arg(long, value_name = "DIR", default_value = "envelope")]
    pub out: PathBuf,
    /// Output format.
    #[command(flatten)]
    pub form: Form,
}
