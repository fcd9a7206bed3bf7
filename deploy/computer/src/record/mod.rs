//! Logs of flights, all in MCAP. [`entry`] is the record of a step; [`log`] reads a flight's directory, with
//! a file for each process ([`flight`]), and a recording, which is a flight in one file for viewing and
//! replay ([`Recorder`]).
//!
//! A recording holds, with the world's time as log time,
//! - `/node/*`: each step of each node, bit for bit; the configurations are attachments;
//! - all other topics: messages of Foxglove's well-known schemas, or our own messages of numbers ([`schema`]) for
//!   content without a well-known schema, at display rates ([`views`]).

use std::collections::BTreeMap;

use alight_shared::process::ProcessKind;
use entry::PartHeader;

pub mod cloud;
pub mod entry;
pub mod flight;
pub mod geometry;
pub mod log;
pub mod messages;
pub mod observer;
mod outline;
pub mod reading;
mod recorder;
pub mod scenery;
pub mod schema;
pub mod shapes;
pub mod sink;
pub mod views;

pub use recorder::Recorder;

/// Name of the process that records the truth of a simulated world.
pub const WORLD: &str = "world";
const EXTENSION: &str = "mcap";
/// Metadata record that identifies the process of a file's steps; one for each process.
const PROCESS: &str = "process";
const RECORDING: &str = "recording";
/// Key in that record: 0 if the nodes were not processes, which begin by waiting for a predecessor's checkpoint.
pub const LIVE: &str = "live";
/// Keys in that record: 1 if another program was the planner, or the predictor. Its steps then hold their outputs in
/// place of their inputs.
pub const FOREIGN_PLANS: &str = "foreign_plans";
pub const FOREIGN_FORECASTS: &str = "foreign_forecasts";
/// Attachment of a recording in which a planner other than the drone's flew.
pub const BASELINE_FILE: &str = "baseline.toml";

/// Topic of the steps of a start; a restarted process has a separate topic, so `before` lists the earlier starts.
fn topic<'a>(header: &PartHeader, mut before: impl Iterator<Item = &'a PartHeader>) -> String {
    let process = &header.process;
    let boot = header.boot;
    if before.any(|h| h.process == *process) {
        format!("/node/{process}/{boot:08x}")
    } else {
        format!("/node/{process}")
    }
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct About {
    pub values: BTreeMap<String, String>,
    pub texts: BTreeMap<String, String>,
}

impl About {
    /// Processes whose outputs are those of another program, so that their steps hold only these.
    pub fn foreign(&self) -> Vec<ProcessKind> {
        let keys = [
            (FOREIGN_PLANS, ProcessKind::Planner),
            (FOREIGN_FORECASTS, ProcessKind::Predictor),
        ];
        let known = keys.into_iter().filter(|(key, _)| self.values.contains_key(*key));
        known.map(|(_, process)| process).collect()
    }
}
