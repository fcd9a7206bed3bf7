//! Supervision of the processes beside the vessel's: the one that reads its real sensors, started where sensors are
//! configured, whose reports are taken in and which is restarted when it ended or reports nothing; and the viewers'
//! server, where somebody looks on.

use std::path::Path;

use alight_shared::transport::process::ProcessKind;
use alight_usv::sensors::{Remark, SourceStatus};
use serde::{Deserialize, Serialize};

use crate::config::VesselComputer;
use crate::config::link_url::LinkUrl;
use crate::exit::CliError;
use crate::process::args::{ProcessArgs, ViewArgs};
use crate::process::supervision::Limits;
use crate::process::supervisor::{self, Supervisor};

/// Time between two reports of the process about its sources, ns.
pub const REPORT_PERIOD_NS: i64 = 500_000_000;
/// Without a report for this long it is killed and restarted, s: six periods.
const SILENCE_TIMEOUT_S: f64 = 6e-9 * REPORT_PERIOD_NS as f64;

/// The report about one source: a line of JSON.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SourceReport {
    /// Its place in the configuration.
    pub number: usize,
    /// Its name.
    pub source: String,
    /// What became of its bytes.
    pub status: SourceStatus,
    /// Age of its newest measurement, s; None before the first.
    pub age_s: Option<f64>,
    /// Why its link is down, if it is.
    pub why: Option<String>,
    /// What else is to be said of its bytes.
    #[serde(default)]
    pub remarks: Vec<Remark>,
}

/// The processes, if the vessel has real sensors or somebody looks on.
pub struct SensorSupervisor {
    supervisor: Option<Supervisor>,
    /// The newest report about each source, and when it came, ns of the steady clock.
    reports: Vec<Option<(i64, SourceReport)>>,
    last_ns: i64,
}

impl SensorSupervisor {
    /// Starts the process where sensors are configured, with the configuration in this file; a malformed address is rejected
    /// here.
    pub fn start(
        computer: &VesselComputer,
        args: &ProcessArgs,
        view: &ViewArgs,
        config: &Path,
        now_ns: i64,
    ) -> Result<SensorSupervisor, CliError> {
        let sources = &computer.sensor.sources;
        for source in sources {
            let of = |e| CliError(format!("sensor {}: {e}", source.name));
            source.connect.parse::<LinkUrl>().map_err(of)?;
        }
        let view = view.over(&computer.view);
        let supervisor = if sources.is_empty() && view.is_none() {
            None
        } else {
            let limits = Limits {
                silence_timeout_s: Some(SILENCE_TIMEOUT_S),
                max_failures: None,
            };
            let mut supervisor =
                Supervisor::new(std::env::temp_dir(), args.flight.clone(), limits)?.inheriting_stderr();
            if !sources.is_empty() {
                let arguments = supervisor::arguments(ProcessKind::Sensors, config);
                supervisor.start(ProcessKind::Sensors, arguments, Vec::new())?;
            }
            if let Some(view) = view {
                supervisor.start_view(config, &view)?;
            }
            Some(supervisor)
        };
        Ok(SensorSupervisor {
            supervisor,
            reports: vec![None; sources.len()],
            last_ns: now_ns,
        })
    }
    /// Supervises it; lines for people.
    pub fn poll(&mut self, now_ns: i64) -> Vec<String> {
        let Some(supervisor) = &mut self.supervisor else {
            return Vec::new();
        };
        let mut lines = Vec::new();
        for line in supervisor.output_lines() {
            match serde_json::from_str::<SourceReport>(&line) {
                Ok(report) => {
                    self.last_ns = now_ns;
                    if let Some(slot) = self.reports.get_mut(report.number) {
                        *slot = Some((now_ns, report));
                    }
                }
                Err(_) => lines.push(line),
            }
        }
        let last_ns = self.last_ns;
        match supervisor.poll(|kind| (kind == ProcessKind::Sensors).then_some(last_ns)) {
            Ok(events) => lines.extend(events.iter().map(ToString::to_string)),
            // Without sensors the vessel still reports that there is no estimate, and arbitrates the deck.
            Err(e) => lines.push(e.to_string()),
        }
        lines
    }
    /// The process's number, while it runs.
    pub fn pid(&self) -> Option<u32> {
        self.supervisor.as_ref()?.pid(ProcessKind::Sensors)
    }
    /// The newest report about each source, in their order, and its age, s.
    pub fn reports(&self, now_ns: i64) -> impl Iterator<Item = (f64, &SourceReport)> {
        self.reports
            .iter()
            .flatten()
            .map(move |(at, report)| ((now_ns - at).max(0) as f64 * 1e-9, report))
    }
}
