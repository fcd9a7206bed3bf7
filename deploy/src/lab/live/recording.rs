//! `alight land --record`: one MCAP file made of what the processes and the world recorded.

use std::path::Path;

use alight_shared::time::{Span, Time, TrueTime};
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::tap::Tap;

use crate::config::{DroneComputer, VesselComputer};
use crate::exit::CliError;
use crate::lab::live::truth::Truth;
use crate::lab::record::{FlightRecorder, Subject};
use crate::record::NODES;
use crate::tools::recording::{
    Playback, StepStream, first_start, nodes, play, record_steps, up_to_first_end,
};

impl Playback<FlightRecorder> for StepStream<Truth> {
    fn due(&self) -> Option<Time<TrueTime>> {
        self.newest().map(|(ns, _)| Time::from_nanos(ns))
    }
    fn play(&mut self, recorder: &mut FlightRecorder) -> Result<(), CliError> {
        if let Some((ns, truth)) = self.newest() {
            recorder.truth(Time::from_nanos(ns), &truth.vessel(), truth.drone().as_ref());
        }
        self.advance()
    }
}

/// Records to `path` what lies in `directory`. Processes that were started again are in it up to
/// then; says so.
pub fn write(
    path: &Path,
    directory: &Path,
    computers: (&VesselComputer, &DroneComputer),
    mut subject: Subject<'_>,
    outcome: &Outcome,
) -> Result<Vec<String>, CliError> {
    let planner = |boot| subject.nodes.planner(boot);
    let found = nodes(
        directory,
        computers,
        planner,
        record_steps!(FlightRecorder),
        Span::from_nanos(0),
    )?;
    for ((to, boot), node) in subject.boots.iter_mut().zip(found.boots).zip(NODES) {
        *to = boot.ok_or_else(|| CliError(format!("the {node} has recorded nothing")))?;
    }
    let truth: StepStream<Truth> = StepStream::of(&first_start(directory, "world")?)?;
    // Of equal times the truth comes first.
    let mut all: Vec<Box<dyn Playback<FlightRecorder>>> = vec![Box::new(truth)];
    all.extend(found.playbacks);
    let mut recorder = FlightRecorder::create(path, &subject)?;
    play(all, &mut recorder)?;
    recorder.finish(path, outcome)?;
    Ok(up_to_first_end(&found.restarted))
}
