//! The summary of a flight: states, outcome and metrics, in a small file next to the parts.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::io::store::replace;

/// Name of the file in the flight's directory.
pub const SUMMARY_FILE: &str = "flight.json";
/// Maximum number of phases that are kept; the newest stay.
const MAX_PHASES: usize = 200;
/// Maximum size of the file, bytes.
const MAX_BYTES: u64 = 1 << 20;

/// A state, and the time and reason of its entry.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PhaseEntry {
    /// Time since the flight began, s.
    pub t_s: f64,
    /// The state; on the vessel, after the drone's number.
    pub state: String,
    pub reason: String,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FlightSummary {
    /// Computer of the flight: drone-1, vessel-1.
    pub computer: String,
    /// Version of the program.
    pub program: String,
    /// Duration of the flight, s.
    pub length_s: f64,
    /// True: the processes were asked to end; false: they run, or power was lost.
    pub ended: bool,
    pub outcome: String,
    pub reason: String,
    /// States in order; at most the newest 200.
    pub phases: Vec<PhaseEntry>,
    /// Time in each state, s.
    pub time_in_s: BTreeMap<String, f64>,
    /// Metrics with their units in their names.
    pub figures: BTreeMap<String, f64>,
}

impl FlightSummary {
    /// Summary of a flight of this computer that begins.
    pub fn of(computer: &str) -> FlightSummary {
        FlightSummary {
            computer: computer.into(),
            program: env!("CARGO_PKG_VERSION").into(),
            ..FlightSummary::default()
        }
    }
    /// Adds a state that was entered.
    pub fn enter(&mut self, t_s: f64, state: &str, reason: String) {
        if self.phases.len() >= MAX_PHASES {
            self.phases.remove(0);
        }
        self.phases.push(PhaseEntry {
            t_s,
            state: state.into(),
            reason,
        });
    }
    /// The summary in the flight's directory; None if it is missing or unreadable.
    pub fn read(directory: &Path) -> Option<FlightSummary> {
        let mut text = String::new();
        let file = File::open(directory.join(SUMMARY_FILE)).ok()?;
        file.take(MAX_BYTES).read_to_string(&mut text).ok()?;
        serde_json::from_str(&text).ok()
    }
    /// Replaces the file on the disk atomically: a power cut leaves the old or the new one.
    pub fn write(&self, directory: &Path) -> io::Result<()> {
        let path = directory.join(SUMMARY_FILE);
        replace(&path, &serde_json::to_vec_pretty(self)?, true)
    }
}
