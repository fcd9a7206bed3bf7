//! Recordings of simulated flights: the steps in a flight's directory, replayed, with the truth.

mod lock_step;
mod truth;

use std::path::{Path, PathBuf};

use alight_computer::{
    exit::{CliError, Doing},
    playback::{Viewer, replay, shown},
    record::{
        About, BASELINE_FILE, FOREIGN_FORECASTS, FOREIGN_PLANS, LIVE, Recorder, WORLD,
        entry::{Entry, PartHeader},
        log::Log,
        observer::StepObserver,
    },
};
use alight_shared::{
    frames::{DroneBody, VesselBody},
    process::ProcessKind,
    step::Step,
    time::{Span, WorldTime},
    wire::{self, WireError},
};
use alight_sim::{
    baselines::Baseline,
    harness::{
        outcome::Outcome,
        scenario::{NodeConfigs, Scenario},
        trial::{FlownTrial, Watch, fly_with},
    },
    physics::body::RigidState,
};
use alight_transport::wake::end_requested;
use alight_uav::{planner::law::Law, settings::DroneSettings};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::live::truth::TruthSample;
use lock_step::LockStepObservers;
use truth::TruthViews;

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
    pub sea: &'a str,
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
        let planner = self.nodes.own.as_ref().map(|_| FOREIGN_PLANS);
        let predictor = self.nodes.predictor.as_ref().map(|_| FOREIGN_FORECASTS);
        let foreign = planner.into_iter().chain(predictor).map(|key| (key, "1".into()));
        let values = values.into_iter().chain(foreign);
        Ok(About {
            values: values.map(|(name, value)| (name.into(), value)).collect(),
            texts: texts.map(|(name, text)| (name.into(), text)).into(),
        })
    }
}

/// Flies the trial, records it to `path`, and shows it to `watch`. A recording error is returned in addition to the
/// flight.
pub fn fly(
    path: Option<&Path>,
    subject: &RecordingScene<'_>,
    watch: Watch<'_>,
    mut observer: Option<&mut (dyn Viewer + 'static)>,
) -> Result<(FlownTrial, Result<(), CliError>), CliError> {
    let recorder = path
        .map(|path| FlightRecorder::create(path, subject))
        .transpose()?;
    let mut observers = LockStepObservers::new(subject, recorder, observer.as_deref_mut())?;
    let RecordingScene {
        scenario,
        nodes,
        seed,
        sea,
        ..
    } = *subject;
    let flown = fly_with(scenario, nodes, seed, sea, watch, &mut observers).doing("setting up the trial")?;
    let recorded = observers.recorder.map_or(Ok(()), |r| r.finish(&flown.outcome));
    if let Some(observer) = observer {
        observer.linger();
    }
    Ok((flown, recorded))
}

/// Replays the flight in `directory`, writes it to the recording `path`, and shows it to the observers.
pub fn export(
    directory: &Path,
    subject: &RecordingScene<'_>,
    outcome: &Outcome,
    path: &Path,
) -> Result<(), CliError> {
    let mut log = Log::open(directory)?;
    log.about = subject.about()?;
    log.first(WORLD)?;
    let mut recorder = FlightRecorder::create(path, subject)?;
    for header in shown(&log) {
        recorder.begin(header);
    }
    // The recording has the times of the simulated world.
    let observers: Vec<&mut dyn StepObserver> = vec![&mut recorder];
    let replayed = replay(&log, &law, Span::ZERO, observers)?;
    recorder.finish(outcome)?;
    // The replay's outputs are recorded, so they must equal those of the flight.
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
    recorder: Option<Recorder>,
    truth: TruthViews,
}

impl FlightRecorder {
    fn create(path: &Path, subject: &RecordingScene<'_>) -> Result<FlightRecorder, CliError> {
        let (recorder, truth) = Recorder::create(path, &subject.about()?, |sink| {
            TruthViews::new(sink, &subject.scenario.drawn(subject.seed))
        })?;
        Ok(FlightRecorder {
            path: path.into(),
            recorder: Some(recorder),
            truth,
        })
    }
    fn begin(&mut self, header: PartHeader) {
        if let Some(r) = &mut self.recorder {
            r.begin(header.clone());
        }
    }
    fn has(&self, process: ProcessKind, boot: u32) -> bool {
        let recorder = self.recorder.as_ref();
        recorder.is_none_or(|r| r.channel(process.name(), boot).is_some())
    }
    /// Records the truth at the beginning of a tick. If asked to end (Ctrl-C), ends the process with a recording that
    /// is readable up to now.
    fn truth(
        &mut self,
        t: WorldTime,
        vessel: &RigidState<VesselBody>,
        drone: Option<(RigidState<DroneBody>, Vector3<f64>)>,
    ) {
        if let Some(recorder) = &mut self.recorder {
            self.truth.show(recorder, t, vessel, drone);
        }
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
    fn finish(mut self, outcome: &Outcome) -> Result<(), CliError> {
        let ending = [
            ("outcome", outcome.outcome.name().to_string()),
            ("reason", outcome.reason.clone()),
            ("digest", outcome.digest.clone()),
        ];
        let recorder = self.recorder.take();
        recorder.map_or(Ok(()), |recorder| recorder.finish(&self.path, &ending))
    }
}

impl StepObserver for FlightRecorder {
    fn step(&mut self, t: WorldTime, step: &Step<'_>) {
        if let Some(r) = &mut self.recorder {
            r.step(t, step);
        }
    }
    fn recorded(&mut self, t: WorldTime, of: &PartHeader, entry: &[u8]) -> Result<(), WireError> {
        if of.process == WORLD {
            let truth = wire::decode_record::<Entry<TruthSample>>(entry)?.input;
            self.truth(t, &truth.vessel(), truth.drone());
            return Ok(());
        }
        let mut all = self.recorder.iter_mut();
        all.try_for_each(|r| r.recorded(t, of, entry))
    }
}
