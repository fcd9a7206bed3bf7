//! `alight replay`: recorded inputs through new nodes, outputs compared bit for bit.

use std::path::{Path, PathBuf};

use alight_bridge::Bridge;
use alight_shared::node::Node;
use alight_shared::time::Time;
use alight_shared::{config, wire};
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
use crate::process::shell::Shell;
use crate::process::supervision::SupervisorNode;
use crate::process::supervisor::SUPERVISOR;
use crate::record::DRONE_FILE;
use crate::record::flight::reading::{Start, Steps, is_part, is_whole, starts};
use crate::record::flight::recorder::PartHeader;
use crate::record::flight::store;
use crate::record::onlooker::Nobody;
use crate::record::reading::{Recording, contained};
use crate::record::replay::{ForeignLaw, NodeReplay, replay};
use crate::table::{Table, verdict};
use crate::terminal::{self, note};
use crate::tools::recording;
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
    /// Recording (`alight trial --record FILE.mcap`), or a flight of the recorder (`alight flights`), or one of its files
    #[arg(value_name = "FILE.mcap|FLIGHT")]
    pub path: PathBuf,
    /// Write the flight to one recording, for Foxglove, Lichtblick and Rerun
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
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
    if args.record.is_some() && !path.is_dir() {
        return Err(CliError(format!(
            "--record: {} is no flight's directory; viewers open a recording as it is",
            path.display()
        )));
    }
    let view = args.view.over(&ViewConfig::default());
    let nodes = if path.is_dir() || is_part(path) {
        if view.is_some() {
            return Err(CliError(
                "--view: a flight is computed one process after the other; make a recording of it first \
                 (--record FILE.mcap)"
                    .into(),
            ));
        }
        contained(path, || replay_starts(path))?
    } else {
        match &view {
            None => contained(path, || replay(path, law, &mut Nobody))?,
            Some(view) => watched(args, view, law)?,
        }
    };
    if let Some(to) = &args.record {
        for line in contained(path, || recording::write(to, path))? {
            note(args.json, line);
        }
    }
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

/// The starts of processes that are recorded at `path`: a flight's directory, or a part.
fn recorded(path: &Path) -> Result<Vec<Start>, CliError> {
    let mut starts = starts(path)?;
    // The truth, beside the parts of a landing that was recorded: no node computes it.
    starts.retain(|s| s.process != "world");
    if starts.is_empty() {
        let below = store::flights(path).is_ok_and(|f| !f.is_empty());
        return Err(CliError(format!(
            "{}: {}",
            path.display(),
            if below {
                "holds flights and is none; name one of them (`alight flights` lists them)"
            } else {
                "no step is recorded there; `alight flights` lists the flights of this computer"
            }
        )));
    }
    Ok(starts)
}

/// Replays the starts; an error where none begins with its process.
fn replay_starts(path: &Path) -> Result<Vec<NodeReplay>, CliError> {
    let starts = recorded(path)?;
    let cut = starts
        .iter()
        .flat_map(|s| &s.parts)
        .filter(|p| !is_whole(p))
        .count();
    if cut > 0 {
        note(
            true,
            format!(
                "files without an end: {cut}, read up to their last whole chunk; their processes run, or were killed"
            ),
        );
    }
    let replayed = starts
        .iter()
        .filter_map(|start| replay_start(start).transpose())
        .collect::<Result<Vec<_>, CliError>>()?;
    if replayed.is_empty() {
        return Err(CliError(format!(
            "{}: no process is recorded from its beginning, and none can be computed again; name the flight's directory",
            path.display()
        )));
    }
    Ok(replayed)
}

/// Replays one start of a process; None for one that is recorded from a later step on.
fn replay_start(start: &Start) -> Result<Option<NodeReplay>, CliError> {
    let steps = Steps::of(start)?;
    let (origin, name) = (steps.path().display().to_string(), start.name());
    let PartHeader {
        process,
        boot,
        first_step,
        config,
        ..
    } = steps.header().clone();
    if first_step > 0 {
        note(
            true,
            format!("{origin}: begins at step {first_step} of {process}, and is not computed again"),
        );
        return Ok(None);
    }
    let vessel = || config::parse::<VesselComputer>(&config, &origin);
    let drone = || config::parse::<DroneComputer>(&config, &origin);
    match process.as_str() {
        "vessel" => through(steps, vessel()?.node(boot), name),
        SUPERVISOR => {
            let limits = toml::from_str(&config).doing(&origin)?;
            through(steps, SupervisorNode::new(limits), name)
        }
        "bridge" => through(steps, Bridge::new(&drone()?.bridge, boot), name),
        "predictor" => through(steps, PredictorShell::node(&drone()?, boot), name),
        "mission" => through(steps, MissionShell::node(&drone()?, boot), name),
        "planner" => through(steps, PlannerShell::node(&drone()?, boot), name),
        "pilot" => through(steps, PilotShell::node(&drone()?, boot), name),
        "autopilot" => through(steps, autopilot::node(&drone()?, boot), name),
        other => Err(CliError(format!(
            "{origin}: steps of a process {other:?}, which this program does not have"
        ))),
    }
    .map(Some)
}

/// Every step through the node that begins: up to the first that is missing, without which its state is not known.
fn through<N>(mut steps: Steps, mut node: N, name: String) -> Result<NodeReplay, CliError>
where
    N: Node<In: DeserializeOwned, Out: Serialize>,
{
    let mut replayed = NodeReplay {
        node: name,
        steps: 0,
        differs_at_s: None,
        differs_at_step: None,
    };
    loop {
        let origin = steps.path().display().to_string();
        let Some(step) = steps.next()? else { break };
        if step.number != replayed.steps {
            note(
                true,
                format!(
                    "{origin}: steps {} to {} are missing, and what follows is not computed again",
                    replayed.steps,
                    step.number.saturating_sub(1)
                ),
            );
            break;
        }
        let doing = format_args!("{origin}, step {}", step.number);
        let (now_ns, input, output_hash) = step.entry::<N::In>().doing(doing)?;
        let output = node.step(Time::from_nanos(now_ns), &input);
        if wire::hash_record(&output).doing(doing)? != output_hash {
            replayed.differs_at_step.get_or_insert(step.number);
        }
        replayed.steps += 1;
    }
    Ok(replayed)
}
