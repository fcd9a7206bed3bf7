//! Recordings of simulated flights: the steps in a flight's directory, computed again, with the truth.

mod lock_step;
mod truth;

use std::path::{Path, PathBuf};

use alight_computer::exit::{CliError, Doing};
use alight_computer::playback::{Viewer, replay, shown};
use alight_computer::record::entry::Entry;
use alight_computer::record::log::Log;
use alight_computer::record::observer::{NodeStep, StepObserver};
use alight_computer::record::{About, BASELINE_FILE, LIVE, NODES, Recorder, WORLD};
use alight_shared::time::{Span, Time, TrueTime};
use alight_shared::wire::{self, WireError};
use alight_sim::baselines::Baseline;
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::trial::{FlownTrial, Watch, fly_with};
use alight_transport::wake::end_requested;
use alight_uav::planner::law::Law;
use alight_uav::settings::DroneSettings;
use serde::{Deserialize, Serialize};

use crate::live::truth::TruthSample;
use lock_step::LockStepLog;
use truth::TruthViews;

/// Content attached as [`BASELINE_FILE`].
#[derive(Serialize, Deserialize)]
struct BaselineFile {
    baseline: Option<Baseline>,
}

/// Law of a recorded baseline; a real flight has none.
pub fn law(text: &str, drone: &DroneSettings) -> Result<Option<Box<dyn Law>>, CliError> {
    let BaselineFile { baseline } = toml::from_str(text).doing(format_args!("reading {BASELINE_FILE}"))?;
    Ok(baseline.map(|b| b.law(&drone.planner, &drone.airframe)))
}

#[derive(Clone, Copy)]
pub struct RecordingScene<'a> {
    pub scenario: &'a Scenario,
    pub nodes: &'a NodeConfigs,
    pub seed: u64,
    /// Sea as named on the command line.
    pub sea: &'a str,
    /// The nodes run as processes.
    pub live: bool,
}

impl RecordingScene<'_> {
    fn about(&self) -> Result<About, CliError> {
        let doing = "writing the scene of a recording";
        let baseline = BaselineFile {
            baseline: self.nodes.baseline,
        };
        let texts = [
            (BASELINE_FILE, toml::to_string(&baseline).doing(doing)?),
            ("scenario.toml", toml::to_string(self.scenario).doing(doing)?),
        ];
        let values = [
            ("seed", self.seed.to_string()),
            ("sea", self.sea.to_string()),
            (LIVE, u32::from(self.live).to_string()),
        ];
        Ok(About {
            values: values.map(|(name, value)| (name.into(), value)).into(),
            texts: texts.map(|(name, text)| (name.into(), text)).into(),
        })
    }
}

/// Flies the subject's trial, records it to `path`, and shows it to `watch`. An error of the recording is returned in
/// addition to the flight.
pub fn fly(
    path: Option<&Path>,
    subject: &RecordingScene<'_>,
    watch: Watch<'_>,
    watcher: Option<&mut (dyn Viewer + 'static)>,
) -> Result<(FlownTrial, Result<(), CliError>), CliError> {
    path.map_or(Ok(()), Recorder::check)?;
    let mut log = LockStepLog::begin(subject.nodes)?;
    let RecordingScene {
        scenario,
        nodes,
        seed,
        sea,
        ..
    } = *subject;
    let flown = fly_with(scenario, nodes, seed, sea, watch, &mut log).doing("setting up the trial")?;
    let written = log.finish();
    let exported = written.and_then(|log| export(log.path(), subject, &flown.outcome, path, watcher));
    Ok((flown, exported))
}

/// Computes the flight of `directory` again, writes it to the recording `path`, and shows it to the observers.
pub fn export(
    directory: &Path,
    subject: &RecordingScene<'_>,
    outcome: &Outcome,
    path: Option<&Path>,
    mut watcher: Option<&mut (dyn Viewer + 'static)>,
) -> Result<(), CliError> {
    let mut log = Log::open(directory)?;
    log.about = subject.about()?;
    for process in NODES.iter().chain([&WORLD]) {
        log.first(process)?;
    }
    let mut recorder = path
        .map(|path| FlightRecorder::create(path, subject, &log))
        .transpose()?;
    let mut observers: Vec<&mut dyn StepObserver> = Vec::new();
    observers.extend(recorder.as_mut().map(|r| r as &mut dyn StepObserver));
    observers.extend(watcher.as_mut().map(|w| &mut **w as &mut dyn StepObserver));
    // The recording has the times of the simulated world.
    let replayed = replay(&log, &law, Span::ZERO, observers)?;
    if let Some(recorder) = recorder {
        recorder.finish(&[
            ("outcome", outcome.outcome.name().to_string()),
            ("reason", outcome.reason.clone()),
            ("digest", outcome.digest.clone()),
        ])?;
    }
    if let Some(watcher) = watcher {
        watcher.linger();
    }
    // The recorded outputs are those of the new computation, which have to equal those of the flight.
    match replayed.iter().find_map(|r| Some((&r.node, r.differs_at_step?))) {
        Some((node, step)) => Err(CliError(format!(
            "recording {}: {node} computes another output at its step {step} than it had in flight; please report it",
            directory.display()
        ))),
        None => Ok(()),
    }
}

struct FlightRecorder {
    path: PathBuf,
    /// None once ended.
    recorder: Option<Recorder>,
    truth: TruthViews,
}

impl FlightRecorder {
    /// Creates the file of a log and writes its constant parts.
    fn create(path: &Path, subject: &RecordingScene<'_>, log: &Log) -> Result<FlightRecorder, CliError> {
        let (recorder, truth) = Recorder::create(path, &shown(log), &log.about, |sink| {
            TruthViews::new(sink, &subject.scenario.drawn(subject.seed))
        })?;
        Ok(FlightRecorder {
            path: path.into(),
            recorder: Some(recorder),
            truth,
        })
    }
    /// Ends the recording with the results of the flight.
    fn finish(mut self, ending: &[(&str, String)]) -> Result<(), CliError> {
        let recorder = self.recorder.take();
        recorder.map_or(Ok(()), |recorder| recorder.finish(&self.path, ending))
    }
    /// Ends the process if requested (Ctrl-C), with a recording that can be read up to now.
    fn end_when_asked(&mut self, t: Time<TrueTime>) {
        let Some(recorder) = self.recorder.take_if(|_| end_requested()) else {
            return;
        };
        let ended = recorder.finish(&self.path, &[("outcome", "interrupted".into())]);
        let line = match ended {
            Ok(()) => format!(
                "interrupted: {} has the first {:.1} s",
                self.path.display(),
                t.secs()
            ),
            Err(e) => format!("alight: {e}"),
        };
        alight_computer::terminal::note(true, line);
        std::process::exit(1);
    }
}

impl StepObserver for FlightRecorder {
    fn of(&mut self, process: &str, boot: u32) {
        self.recorder.iter_mut().for_each(|r| r.of(process, boot));
    }
    fn step(&mut self, t: Time<TrueTime>, step: NodeStep<'_>) {
        self.recorder.iter_mut().for_each(|r| r.step(t, step));
    }
    fn world(&mut self, t: Time<TrueTime>, entry: &[u8]) -> Result<(), WireError> {
        let truth = wire::decode_record::<Entry<TruthSample>>(entry)?.input;
        if let Some(recorder) = &mut self.recorder {
            self.truth.show(recorder, t, &truth.vessel(), truth.drone());
        }
        self.end_when_asked(t);
        Ok(())
    }
}
