//! Summary of a flight: states, outcome and metrics, in a small file next to the parts.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, Read},
    path::Path,
};

use serde::{Deserialize, Serialize};

use crate::io::store::replace;

pub const SUMMARY_FILE: &str = "flight.json";
/// Maximum number of phases; the newest are kept.
const MAX_PHASES: usize = 200;
const MAX_BYTES: u64 = 1 << 20;

/// Time at which a state was entered, and the reason.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PhaseEntry {
    pub t_s: f64,
    /// State; on the vessel, preceded by the drone's number.
    pub state: String,
    pub reason: String,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FlightSummary {
    /// Name of the computer, such as drone-1 or vessel-1.
    pub computer: String,
    pub program: String,
    pub length_s: f64,
    /// True: the processes were asked to end; false: they still run, or power was lost.
    pub ended: bool,
    pub outcome: String,
    pub reason: String,
    pub phases: Vec<PhaseEntry>,
    pub time_in_s: BTreeMap<String, f64>,
    /// Metrics; each name ends in its unit.
    pub figures: BTreeMap<String, f64>,
}

impl FlightSummary {
    pub fn of(computer: &str) -> FlightSummary {
        FlightSummary {
            computer: computer.into(),
            program: env!("CARGO_PKG_VERSION").into(),
            ..FlightSummary::default()
        }
    }
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
    /// Replaces the file atomically: a power cut leaves either the old or the new one.
    pub fn write(&self, directory: &Path) -> io::Result<()> {
        let path = directory.join(SUMMARY_FILE);
        replace(&path, &serde_json::to_vec_pretty(self)?, true)
    }
}
