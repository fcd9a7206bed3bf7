//! `alight replay`: runs new nodes on recorded inputs and compares the outputs bit for bit.

use alight_shared::msg::ComputerReport;
use std::path::{Path, PathBuf};

use alight_computer::{
    cells,
    config::{DroneComputerConfig, view::ViewConfig},
    exit::{CliError, Exit},
    playback::{ForeignLaw, NodeReplay, Plot, Viewer, replay, shown},
    process::args::ViewArgs,
    record::{
        About, LIVE, Recorder, WORLD,
        flight::store,
        log::{Log, ProcessStart},
        observer::StepObserver,
        reading::{contained, is_whole},
    },
    table::{Table, verdict},
    terminal::{self, Form, note},
};
use alight_shared::time::Span;
use clap::Args;
use serde_json::json;

use crate::{said::Statements, tools::view::start_viewer};

/// Recording to replay.
#[derive(Args, Debug)]
#[command(
    after_help = "With --view a flight runs in real time once the drone has appeared. It waits for no viewer,\n\
and ends with the flight, or 10 s later if there is a viewer."
)]
pub struct ReplayArgs {
    /// Recording (`alight trial --record FILE.mcap`), recorded flight (`alight flights`), or one of its files
    #[arg(value_name = "FILE.mcap|FLIGHT")]
    pub path: PathBuf,
    /// Write the flight to one recording, for Foxglove, Lichtblick and Rerun
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
    /// Draw the last landing to an SVG, by the drone's own estimate: path, displacement, velocities, angles
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// Judge the texts of page and status five times a second, and print each rule that they break
    #[arg(long)]
    pub said: bool,
    #[command(flatten)]
    pub view: ViewArgs,
    /// Output format.
    #[command(flatten)]
    pub form: Form,
}

pub struct Laboratory<'a> {
    /// Law of a recorded baseline planner, which the drone's program does not include.
    pub law: ForeignLaw<'a>,
    pub plot: Option<BeginPlot<'a>>,
}

pub type BeginPlot<'a> = &'a dyn Fn(&Path, &Log) -> Result<Box<dyn Plot>, CliError>;

pub fn run(args: &ReplayArgs, laboratory: &Laboratory<'_>) -> Result<Exit, CliError> {
    let path = &args.path;
    if args.record.is_some() && !path.is_dir() {
        return Err(CliError(format!(
            "--record: {} is not a flight's directory; viewers open recordings directly",
            path.display()
        )));
    }
    let log = contained(path, || recorded(path))?;
    let mut recorder = args.record.as_ref().map(|to| record(to, &log)).transpose()?;
    let view = args.view.over(&ViewConfig::default());
    let mut observer = view.map(|view| observer(args, &log, &view)).transpose()?;
    let mut plot = args
        .plot
        .as_ref()
        .map(|to| plot(to, &log, laboratory))
        .transpose()?;
    let mut observers: Vec<&mut dyn StepObserver> = Vec::new();
    observers.extend(recorder.as_mut().map(|r| r as &mut dyn StepObserver));
    observers.extend(observer.as_mut().map(|w| w.as_mut() as &mut dyn StepObserver));
    // A viewed flight is replayed in real time.
    let is_shown = !log.is_recording() && !observers.is_empty();
    observers.extend(plot.as_mut().map(|p| p.as_mut() as &mut dyn StepObserver));
    let mut said = args.said.then(Statements::default);
    observers.extend(said.as_mut().map(|s| s as &mut dyn StepObserver));
    let nodes = contained(path, || {
        let shift = is_shown.then(|| log.utc_ahead()).transpose()?;
        replay(
            &log,
            laboratory.law,
            shift.unwrap_or(Span::from_nanos(0)),
            observers,
        )
    })?;
    if let (Some(to), Some(recorder)) = (&args.record, recorder) {
        recorder.finish(to, &[("flight", path.display().to_string())])?;
        note(args.form.alone(), format!("recording: {}", to.display()));
    }
    if let (Some(to), Some(plot)) = (&args.plot, plot) {
        plot.write()?;
        note(args.form.alone(), format_args!("plot: {}", to.display()));
    }
    if let Some(observer) = observer {
        observer.linger();
    }
    report(args, &nodes, said.as_ref())
}

fn report(args: &ReplayArgs, nodes: &[NodeReplay], said: Option<&Statements>) -> Result<Exit, CliError> {
    let mut table = Table::new(1..3, ["node", "steps", "differs from step", "at"]);
    for n in nodes {
        table.row(cells![
            n.node,
            n.steps,
            n.differs_at_step
                .map_or_else(|| "-".into(), |step| step.to_string()),
            n.differs_at_s.map_or_else(String::new, |t| format!("{t:.2} s")),
        ]);
    }
    let differing = nodes.iter().filter(|n| n.differs_at_step.is_some());
    let first = differing.min_by(|a, b| {
        a.differs_at_s
            .unwrap_or(0.0)
            .total_cmp(&b.differs_at_s.unwrap_or(0.0))
    });
    let text = first.map_or_else(
        || "bit-identical".to_string(),
        |n| match n.differs_at_s {
            Some(t) => format!("first difference: {} at {t:.2} s of the recording", n.node),
            None => format!("the outputs of {} differ", n.node),
        },
    );
    note(args.form.alone(), table.text());
    let value = json!({"identical": first.is_none(), "verdict": text, "nodes": nodes, "said": said});
    if !args.form.print(&value, nodes)? {
        if let Some(said) = said {
            terminal::line(said.text());
        }
        terminal::line(verdict(&text, first.is_none()));
    }
    let is_broken = said.is_some_and(|s| !s.broken.is_empty());
    Ok(Exit::of(first.is_none() && !is_broken))
}

fn plot(to: &Path, log: &Log, laboratory: &Laboratory<'_>) -> Result<Box<dyn Plot>, CliError> {
    let begin = laboratory.plot.ok_or_else(|| {
        CliError(
            "--plot: this program flies and draws nothing; copy the flight to a computer with the whole program and run \
             alight replay there"
                .into(),
        )
    })?;
    begin(to, log)
}

fn record(to: &Path, log: &Log) -> Result<Recorder, CliError> {
    let headers = shown(log);
    if headers.is_empty() {
        return Err(CliError(format!(
            "{}: no steps of a node to record",
            log.path().display()
        )));
    }
    let live = (LIVE.to_string(), "1".to_string());
    let about = About {
        values: [live].into(),
        ..log.about.clone()
    };
    let (mut recorder, ()) = Recorder::create(to, &about, |_| Ok(()))?;
    headers.into_iter().for_each(|header| recorder.begin(header));
    Ok(recorder)
}

fn observer(args: &ReplayArgs, log: &Log, view: &ViewConfig) -> Result<Box<dyn Viewer>, CliError> {
    let drone = log
        .find("mission")
        .map(ProcessStart::config::<DroneComputerConfig>)
        .transpose()?;
    let known = ComputerReport {
        title: format!("replay of {}", args.path.display()).as_str().into(),
        deck: drone.as_ref().map(|d| d.drone.deck.dimensions()),
        ..ComputerReport::default()
    };
    let bodies = drone.map(|d| (d.drone.deck, d.drone.airframe));
    let observer = start_viewer(view, "replay", known, bodies)?;
    observer.begin(args.form.alone());
    Ok(observer)
}

/// Log of the recording at `path`; reports its files without an end.
fn recorded(path: &Path) -> Result<Log, CliError> {
    let log = Log::open(path)?;
    if log.starts.iter().all(|s| s.header.process == WORLD) {
        let below = store::flights(path).is_ok_and(|f| !f.is_empty());
        return Err(CliError(format!(
            "{}: {}",
            path.display(),
            if below {
                "holds flights but is not one; name one of them (`alight flights` lists them)"
            } else {
                "no step is recorded there; `alight flights` lists the flights of this computer"
            }
        )));
    }
    let files = log.starts.iter().flat_map(|s| &s.files);
    let cut = files.filter(|p| !is_whole(p)).count();
    if cut > 0 && !log.is_recording() {
        note(
            true,
            format!(
                "files without an end: {cut}, read up to their last whole chunk; their processes run, or were killed"
            ),
        );
    }
    Ok(log)
}
