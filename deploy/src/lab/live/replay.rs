//! `alight replay`: a process's log through its pure node again, outputs compared bit for bit.

use std::path::{Path, PathBuf};

use alight_bridge::Bridge;
use alight_shared::config;
use alight_shared::node::Node;
use alight_shared::time::Time;
use alight_usv::VesselNode;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::config::{DroneComputer, VesselComputer};
use crate::drone::mission::MissionShell;
use crate::drone::pilot::PilotShell;
use crate::drone::planner::PlannerShell;
use crate::drone::predictor::PredictorShell;
use crate::exit::{CliError, Exit};
use crate::table;
use crate::process::log::{LogHeader, LogReader};
use crate::process::shell::Shell;
use crate::terminal;

/// Whether this is a log of a process, or a directory of them.
pub fn takes(path: &Path) -> bool {
    path.is_dir() || path.extension().is_some_and(|e| e == "log")
}

/// Replays one log or all logs of a directory.
pub fn run(path: &Path) -> Result<Exit, CliError> {
    let mut same = true;
    for path in logs(path)? {
        let (steps, different) = replay(&path)?;
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        match different {
            None => terminal::line(format_args!(
                "{name:<28} {steps:>8} steps  {}",
                table::verdict("identical", true)
            )),
            Some(step) => {
                same = false;
                let text = format!("differs from step {step} on");
                terminal::line(format_args!(
                    "{name:<28} {steps:>8} steps  {}",
                    table::verdict(&text, false)
                ));
            }
        }
    }
    Ok(if same { Exit::Success } else { Exit::Failed })
}

fn logs(path: &Path) -> Result<Vec<PathBuf>, CliError> {
    if path.is_file() {
        return Ok(vec![path.into()]);
    }
    let entries = std::fs::read_dir(path)
        .map_err(|e| CliError::because(format!("reading the logs in {}", path.display()), e))?;
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

/// Steps of the log, and the first whose output differs.
fn replay(path: &Path) -> Result<(u64, Option<u64>), CliError> {
    let (log, head) =
        LogReader::open(path).map_err(|e| CliError::because(format!("reading {}", path.display()), e))?;
    let LogHeader {
        process,
        boot,
        config,
    } = head;
    let origin = path.display().to_string();
    if process == "vessel" {
        let c: VesselComputer = config::parse(&config, &origin).map_err(|e| CliError(e.to_string()))?;
        return through(log, path, VesselNode::new(&c.vessel, c.vessel_id, boot));
    }
    let c: DroneComputer = config::parse(&config, &origin).map_err(|e| CliError(e.to_string()))?;
    match process.as_str() {
        "bridge" => through(log, path, Bridge::new(&c.bridge, boot)),
        "predictor" => through(log, path, PredictorShell::node(&c, boot)),
        "mission" => through(log, path, MissionShell::node(&c, boot)),
        "planner" => through(log, path, PlannerShell::node(&c, boot)),
        "pilot" => through(log, path, PilotShell::node(&c, boot)),
        "autopilot" => through(log, path, crate::drone::autopilot::node(&c, boot)),
        other => Err(CliError(format!(
            "{origin}: the log of a process {other:?}, which this program does not have"
        ))),
    }
}

fn through<N>(log: LogReader, path: &Path, mut node: N) -> Result<(u64, Option<u64>), CliError>
where
    N: Node<In: DeserializeOwned, Out: Serialize>,
{
    log.replay(|now_ns, input| node.step(Time::from_nanos(now_ns), input))
        .map_err(|e| CliError::because(format!("reading {}", path.display()), e))
}
