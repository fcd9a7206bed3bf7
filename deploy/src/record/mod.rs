//! Recordings: a flight in one MCAP file, to look at and to compute again.
//!
//! A recording holds, with the world's time as log time,
//! - `/node/*`: each step of each node, bit for bit ([`entry`]); the configurations are
//!   attachments. [`replay`] feeds them to new nodes and compares every output.
//! - everything else: Foxglove's well-known schemas where there is one and flat protobuf messages
//!   of figures where there is none ([`show`]), at display rates.

pub mod args;
mod cloud;
pub mod entry;
mod figures;
mod flat;
mod outline;
pub mod reading;
pub mod readings;
mod recorder;
pub mod replay;
mod scene;
mod show;
mod sink;

use std::path::Path;

use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::trial::{FlownTrial, Watch};

use crate::exit::CliError;

pub use recorder::{Recorder, Subject};

/// The nodes in data-flow order.
pub const NODES: [&str; 6] = ["vessel", "bridge", "predictor", "mission", "planner", "pilot"];
/// Boot ids of the nodes in lock-step.
pub const LOCK_STEP_BOOTS: [u32; NODES.len()] = [alight_sim::harness::world::BOOT; NODES.len()];
/// Name of the metadata that says what was recorded.
const RECORDING: &str = "recording";
/// Name of the attached configuration of the vessel's side.
pub const VESSEL_FILE: &str = "vessel.toml";
/// Name of the attached configuration of the drone's side.
pub const DRONE_FILE: &str = "drone.toml";

/// Flies the subject's trial and records it to `path`.
pub fn fly(path: &Path, subject: &Subject<'_>, watch: Watch<'_>) -> Result<FlownTrial, CliError> {
    let mut recorder = Recorder::create(path, subject)?;
    let Subject {
        scenario,
        nodes,
        seed,
        sea,
        boots: _,
    } = *subject;
    let flight = alight_sim::harness::trial::fly_with(scenario, nodes, seed, sea, watch, &mut recorder)
        .map_err(|e| CliError::because("setting up the trial", e))?;
    recorder.finish(path, &ending(&flight.outcome))?;
    Ok(flight)
}

/// What came out, as a recording says it at its end.
pub fn ending(outcome: &Outcome) -> [(&'static str, String); 3] {
    [
        ("outcome", outcome.outcome.name().to_string()),
        ("reason", outcome.reason.clone()),
        ("digest", outcome.digest.clone()),
    ]
}

/// Name of a node's boot id.
fn boot(node: &str) -> String {
    format!("boot_{node}")
}
/// Where a node's steps are.
fn topic(node: &str) -> String {
    format!("/node/{node}")
}
