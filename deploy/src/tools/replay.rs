//! `alight replay`: recorded inputs through new nodes, outputs compared bit for bit.

use std::path::{Path, PathBuf};

use alight_bridge::Bridge;
use alight_shared::config;
use alight_shared::node::Node;
use alight_shared::time::Time;
use clap::Args;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::json;

use crate::cells;
use crate::config::view::ViewConfig;
use crate::config::{DroneComputer, DroneFile, VesselComputer};
use crate::drone::autopilot;
use crate::drone::mission::MissionShell;
use crate::drone::pilot::PilotShell;
use crate::drone::planner::PlannerShell;
use crate::drone::predictor::PredictorShell;
use crate::exit::{CliError, Doing, Exit};
use crate::process::args::ViewArgs;
use crate::process::log::{LogError, LogHeader, LogReader};
use crate::process::shell::Shell;
use crate::process::supervision::SupervisorNode;
use crate::process::supervisor::SUPERVISOR;
use crate::record::DRONE_FILE;
use crate::record::onlooker::Nobody;
use crate::record::reading::{Recording, contained};
use crate::record::replay::{ForeignLaw, NodeReplay, replay};
use crate::table::{Table, verdict};
use crate::terminal::{self, note};
use crate::tools::view::served;
use crate::view::board::Known;
use crate::view::watcher::Watcher;

/// A recording to compute again.
#[derive(Args, Debug)]
#[command(
    after_help = "With --view a recording (FILE.mcap) is held back to real time once the drone has appeared. It waits for no viewer,\n\
and ends when it is over, or 10 s later while somebody still looks on."
)]
pub struct ReplayArgs {
    /// Recording (`alight trial --record FILE.mcap`), or logs of live processes (`--log DIR`)
    #[arg(value_name = "FILE.mcap|DIR")]
    pub path: PathBuf,
    /// Whether and where people look on.
    #[command(flatten)]
    pub view: ViewArgs,
    /// Print the result as one JSON object, the last line
    #[arg(long)]
    pub json: bool,
}

/// Replays and reports.
pub fn run(args: &ReplayArgs, law: ForeignLaw) -> Result<Exit, CliError> {
    let path = &args.path;
    let view = args.view.over(&ViewConfig::default());
    let nodes = if path.is_dir() || path.extension().is_some_and(|e| e == "log") {
        if view.is_some() {
            return Err(CliError(
                "--view: logs are computed one process after the other; name a recording (FILE.mcap)".into(),
            ));
        }
        let logs = logs(path)?;
        logs.iter()
            .filter_map(|log| replay_log(log).transpose())
            .collect::<Result<Vec<_>, CliError>>()?
    } else {
        match &view {
            None => contained(path, || replay(path, law, &mut Nobody))?,
            Some(view) => watched(args, view, law)?,
        }
    };
    let mut table = Table::new(1..3, ["node", "steps", "differs from step", "at"]);
    for n in &nodes {
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
    note(args.json, table.text());
    if args.json {
        terminal::line(json!({"identical": first.is_none(), "verdict": text, "nodes": nodes}));
    } else {
        terminal::line(verdict(&text, first.is_none()));
    }
    Ok(Exit::of(first.is_none()))
}

/// Replays before the eyes of who looks on.
fn watched(args: &ReplayArgs, view: &ViewConfig, law: ForeignLaw) -> Result<Vec<NodeReplay>, CliError> {
    let path = &args.path;
    let DroneFile { drone, .. } = contained(path, || {
        Recording::open(path)?.configuration::<DroneFile>(DRONE_FILE)
    })?;
    let known = Known {
        title: format!("replay of {}", path.display()),
        deck: Some(drone.deck),
        ..Known::default()
    };
    let bodies = Some((drone.deck, drone.airframe));
    let mut watcher = Watcher::start(served(view, "replay")?, known, &bodies, true)?;
    watcher
        .server
        .lines()
        .into_iter()
        .for_each(|line| note(args.json, line));
    let nodes = contained(path, || replay(path, law, &mut watcher))?;
    watcher.linger();
    Ok(nodes)
}

fn logs(path: &Path) -> Result<Vec<PathBuf>, CliError> {
    if path.is_file() {
        return Ok(vec![path.into()]);
    }
    let entries = std::fs::read_dir(path).doing(format_args!("reading the logs in {}", path.display()))?;
    let mut logs: Vec<PathBuf> = entries
        .flatten()
        .map(|e| e.path())
        .filter(|p| p.extension().is_some_and(|e| e == "log"))
        // The truth, beside the logs of a landing that was recorded: no node computes it.
        .filter(|p| {
            !p.file_name()
                .is_some_and(|n| n.to_string_lossy().starts_with("world-"))
        })
        .collect();
    logs.sort();
    if logs.is_empty() {
        return Err(CliError(format!(
            "{}: no log (*.log) there; `alight land --log DIR` writes some",
            path.display()
        )));
    }
    Ok(logs)
}

/// Replays one log of a process; None for one that begins later than its process.
fn replay_log(path: &Path) -> Result<Option<NodeReplay>, CliError> {
    let doing = format_args!("reading {}", path.display());
    let (log, head) = LogReader::open(path).doing(doing)?;
    let LogHeader {
        process,
        boot,
        first_step,
        config,
    } = head;
    let origin = path.display().to_string();
    if first_step > 0 {
        note(
            true,
            format!("{origin}: begins at step {first_step} of {process}, and is not computed again"),
        );
        return Ok(None);
    }
    let vessel = || config::parse::<VesselComputer>(&config, &origin);
    let drone = || config::parse::<DroneComputer>(&config, &origin);
    let replayed = match process.as_str() {
        "vessel" => through(log, vessel()?.node(boot)),
        SUPERVISOR => {
            let limits = toml::from_str(&config).doing(&origin)?;
            through(log, SupervisorNode::new(limits))
        }
        "bridge" => through(log, Bridge::new(&drone()?.bridge, boot)),
        "predictor" => through(log, PredictorShell::node(&drone()?, boot)),
        "mission" => through(log, MissionShell::node(&drone()?, boot)),
        "planner" => through(log, PlannerShell::node(&drone()?, boot)),
        "pilot" => through(log, PilotShell::node(&drone()?, boot)),
        "autopilot" => through(log, autopilot::node(&drone()?, boot)),
        other => {
            return Err(CliError(format!(
                "{origin}: the log of a process {other:?}, which this program does not have"
            )));
        }
    };
    let (steps, differs_at_step) = replayed.doing(doing)?;
    let name = path.file_stem().unwrap_or_default();
    Ok(Some(NodeReplay {
        node: name.to_string_lossy().into_owned(),
        steps,
        differs_at_s: None,
        differs_at_step,
    }))
}

fn through<N>(log: LogReader, mut node: N) -> Result<(u64, Option<u64>), LogError>
where
    N: Node<In: DeserializeOwned, Out: Serialize>,
{
    log.replay(|now_ns, input| node.step(Time::from_nanos(now_ns), input))
}
