//! `alight land --record`: one MCAP file made of what the processes and the world recorded.

use std::path::Path;

use alight_computer::exit::CliError;
use alight_computer::playback::{replay, shown};
use alight_computer::record::log::Log;
use alight_computer::record::{NODES, WORLD};
use alight_shared::time::Span;
use alight_sim::harness::outcome::Outcome;
use alight_uav::settings::DroneSettings;

use crate::record::{FlightRecorder, Subject};

/// Records to `path` what lies in `directory`. Processes that were started again are in it up to
/// then; says so.
pub fn write(
    path: &Path,
    directory: &Path,
    subject: &Subject<'_>,
    outcome: &Outcome,
) -> Result<Vec<String>, CliError> {
    let log = Log::open(directory)?;
    for process in NODES.iter().chain([&WORLD]) {
        log.first(process)?;
    }
    let (headers, lines) = shown(&log);
    let mut recorder = FlightRecorder::create(path, subject, &headers, true)?;
    let law = |_: &str, drone: &DroneSettings| {
        let baseline = subject.nodes.baseline;
        Ok(baseline.map(|b| b.law(&drone.planner, &drone.airframe)))
    };
    // The recording has the times of the simulated world.
    replay(&log, &law, Span::from_nanos(0), vec![&mut recorder])?;
    recorder.finish(path, outcome)?;
    Ok(lines)
}
