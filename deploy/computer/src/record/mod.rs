//! Logs of flights, all in MCAP. [`entry`] is what is written of a step, [`log`] reads each of them:
//! - a flight's directory, of files that every process writes by itself ([`flight`]);
//! - a recording: a flight in one file, to look at and to compute again ([`Recorder`]).
//!
//! A recording holds, with the world's time as log time,
//! - `/node/*`: each step of each node, bit for bit; the configurations are attachments;
//! - everything else: Foxglove's well-known schemas where there is one and messages of numbers
//!   ([`schema`]) where the message has none, at display rates ([`views`]).

use std::collections::BTreeMap;

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
/// Extension of a log's files.
const EXTENSION: &str = "mcap";
/// Name of the metadata that states whose steps a file holds, one for each process.
const PROCESS: &str = "process";
/// Name of the metadata with the subject of a recording.
const RECORDING: &str = "recording";
/// Value of that: 0 when its nodes were no processes, which begin by waiting for a predecessor's checkpoint.
pub const LIVE: &str = "live";
/// Name of what is attached to a recording where another planner flew than the drone's.
pub const BASELINE_FILE: &str = "baseline.toml";

/// Topic of the steps of a start after these: one of its own for a process that was started again.
fn topic<'a>(header: &PartHeader, mut before: impl Iterator<Item = &'a PartHeader>) -> String {
    let (process, boot) = (&header.process, header.boot);
    match before.any(|h| h.process == *process) {
        true => format!("/node/{process}/{boot:08x}"),
        false => format!("/node/{process}"),
    }
}

/// Metadata of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct About {
    /// Names and values.
    pub values: BTreeMap<String, String>,
    /// Texts by their names.
    pub texts: BTreeMap<String, String>,
}
