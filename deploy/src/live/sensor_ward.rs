//! The vessel's real sensors as a process beside the vessel's own, which starts it when sensors are
//! configured, hears what became of each source's bytes, and starts it again when it ended or fell silent.

use alight_shared::transport::process::ProcessKind;
use alight_usv::sensors::SourceStatus;
use serde::{Deserialize, Serialize};

use super::args::ProcessArgs;
use super::autopilot_url::AutopilotUrl;
use super::config::VesselComputer;
use super::supervisor::{Event, Supervisor};
use crate::Refused;

/// Time between two words of the process about its sources, ns.
pub const WORD_NS: i64 = 500_000_000;
/// Silent for this long it is killed and started again, ns: six words.
const SILENT_NS: i64 = 6 * WORD_NS;

/// What the process says about one source: a line of JSON.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SourceWord {
    /// Its place in the configuration.
    pub number: usize,
    /// Its name.
    pub source: String,
    /// What became of its bytes.
    pub status: SourceStatus,
    /// Age of its newest measurement, s; None before the first.
    pub age_s: Option<f64>,
    /// Why nothing can come, if that is so.
    pub why: Option<String>,
}

/// The process, if the vessel has real sensors.
pub struct SensorWard {
    supervisor: Option<Supervisor>,
    /// What it said last of each source, and when, ns of the steady clock.
    words: Vec<Option<(i64, SourceWord)>>,
    last_ns: i64,
}

impl SensorWard {
    /// Starts the process where sensors are configured. An address that is none is refused here.
    pub fn start(computer: &VesselComputer, args: &ProcessArgs, now_ns: i64) -> Result<SensorWard, Refused> {
        let sources = &computer.sensor.sources;
        for source in sources {
            let of = |e| Refused(format!("sensor {}: {e}", source.name));
            source.connect.parse::<AutopilotUrl>().map_err(of)?;
        }
        let mut supervisor = (!sources.is_empty()).then(|| {
            Supervisor::new(std::env::temp_dir(), None)
                .journalled()
                .unraised()
        });
        if let Some(s) = &mut supervisor {
            s.start(ProcessKind::Sensors, args.config.clone(), Vec::new())?;
        }
        Ok(SensorWard {
            supervisor,
            words: vec![None; sources.len()],
            last_ns: now_ns,
        })
    }
    /// Looks after it; what there is to tell a person.
    pub fn tend(&mut self, now_ns: i64) -> Vec<String> {
        let Some(supervisor) = &mut self.supervisor else {
            return Vec::new();
        };
        let mut told = Vec::new();
        for line in supervisor.said() {
            match serde_json::from_str::<SourceWord>(&line) {
                Ok(word) => {
                    self.last_ns = now_ns;
                    if let Some(slot) = self.words.get_mut(word.number) {
                        *slot = Some((now_ns, word));
                    }
                }
                Err(_) => told.push(line),
            }
        }
        match supervisor.tend() {
            Ok(events) => told.extend(
                events
                    .into_iter()
                    .map(|Event::Ended(_, status)| format!("sensors ended ({status}) and is started again")),
            ),
            // Without sensors the drones hear that there is no estimate, and who may land there: it goes on.
            Err(e) => told.push(e.to_string()),
        }
        let began = supervisor.began_ns(ProcessKind::Sensors);
        let silent_ns = now_ns - began.map_or(now_ns, |b| b.max(self.last_ns));
        if silent_ns > SILENT_NS {
            told.push(format!(
                "sensors was silent for {:.1} s and is killed",
                silent_ns as f64 * 1e-9
            ));
            supervisor.kill(ProcessKind::Sensors);
            self.last_ns = now_ns;
        }
        told
    }
    /// The process's number, while it runs.
    pub fn pid(&self) -> Option<u32> {
        self.supervisor.as_ref()?.pid(ProcessKind::Sensors)
    }
    /// What it said last of each source, in their order, and how long ago, s.
    pub fn words(&self, now_ns: i64) -> impl Iterator<Item = (f64, &SourceWord)> {
        self.words
            .iter()
            .flatten()
            .map(move |(at, word)| ((now_ns - at).max(0) as f64 * 1e-9, word))
    }
}
