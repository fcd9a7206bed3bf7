//! Recordings of simulated flights: what the world's tap shows, and the truth beside it.

mod truth;

use std::path::Path;

use alight_bridge::{BridgeIn, BridgeOut};
use alight_shared::frames::{DroneBody, VesselBody};
use alight_shared::time::{DroneClock, Time, TrueTime, VesselClock};
use alight_shared::transport::wake::end_requested;
use alight_sim::baselines::Baseline;
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::physics::{BOOT, DRONE_ID, VESSEL_ID};
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::tap::Tap;
use alight_sim::harness::trial::{FlownTrial, Watch, fly_with};
use alight_sim::physics::body::RigidState;
use alight_uav::mission::{MissionIn, MissionOut};
use alight_uav::pilot::{PilotIn, PilotOut};
use alight_uav::planner::law::Law;
use alight_uav::planner::{PlannerIn, PlannerOut};
use alight_uav::predictor::{PredictorIn, PredictorOut};
use alight_uav::settings::DroneSettings;
use alight_usv::{ComputerIn, ComputerOut};
use serde::{Deserialize, Serialize};

use crate::config::DroneFile;
use crate::exit::{CliError, Doing};
use crate::record::onlooker::Onlooker;
use crate::record::reading::Recording;
use crate::record::{DECK_FILE, DRONE_FILE, LIVE, NODES, Recorder, VESSEL_FILE};
use crate::view::watcher::Watcher;
use truth::TruthViews;

/// Boot ids of the nodes in lock-step.
pub const LOCK_STEP_BOOTS: [u32; NODES.len()] = [BOOT; NODES.len()];

/// Name of the attached baseline, if one flew in place of the drone's planner.
const BASELINE_FILE: &str = "baseline.toml";

/// What is attached as [`BASELINE_FILE`].
#[derive(Serialize, Deserialize)]
struct BaselineFile {
    baseline: Option<Baseline>,
}

/// The law of a recorded baseline.
pub fn law(recording: &Recording, drone: &DroneSettings) -> Result<Option<Box<dyn Law>>, CliError> {
    // A recording of a live flight has none.
    let text = recording.text(BASELINE_FILE).unwrap_or_default();
    let BaselineFile { baseline } = toml::from_str(&text).doing(format_args!("reading {BASELINE_FILE}"))?;
    Ok(baseline.map(|b| b.law(&drone.planner, &drone.airframe)))
}

/// What is recorded.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// The world.
    pub scenario: &'a Scenario,
    /// The nodes.
    pub nodes: &'a NodeConfigs,
    /// The seed.
    pub seed: u64,
    /// The sea as the person named it.
    pub sea: &'a str,
    /// Boot ids of the nodes, in the order of [`NODES`].
    pub boots: [u32; NODES.len()],
    /// The mission was a process, which begins by waiting for a predecessor's checkpoint.
    pub live: bool,
}

/// Records a simulated flight.
pub struct FlightRecorder {
    recorder: Recorder,
    truth: TruthViews,
}

/// Flies the subject's trial, records it to `path`, and shows it to who looks on. What the recording failed by stands
/// beside what was flown.
pub fn fly(
    path: Option<&Path>,
    subject: &Subject<'_>,
    watch: Watch<'_>,
    watcher: Option<&mut Watcher>,
) -> Result<(FlownTrial, Result<(), CliError>), CliError> {
    let recorder = path
        .map(|path| FlightRecorder::create(path, subject))
        .transpose()?;
    let mut shown = Shown {
        recorder: recorder.zip(path),
        watcher,
    };
    let Subject {
        scenario,
        nodes,
        seed,
        sea,
        boots: _,
        live: _,
    } = *subject;
    let flown = fly_with(scenario, nodes, seed, sea, watch, &mut shown).doing("setting up the trial")?;
    let Shown { recorder, watcher } = shown;
    let recorded = recorder.map_or(Ok(()), |(recorder, path)| recorder.finish(path, &flown.outcome));
    if let Some(watcher) = watcher {
        watcher.linger();
    }
    Ok((flown, recorded))
}

/// The file and who looks on.
struct Shown<'a> {
    recorder: Option<(FlightRecorder, &'a Path)>,
    watcher: Option<&'a mut Watcher>,
}

impl Shown<'_> {
    /// Ends the process when it was asked to (Ctrl-C), with a recording that can be read up to now.
    fn end_when_asked(&mut self, t: Time<TrueTime>) {
        if self.recorder.is_none() || !end_requested() {
            return;
        }
        let Some((FlightRecorder { recorder, .. }, path)) = self.recorder.take() else {
            return;
        };
        let ended = recorder.finish(path, &[("outcome", "interrupted".into())]);
        match ended {
            Ok(()) => crate::terminal::note(
                true,
                format_args!("interrupted: {} has the first {:.1} s", path.display(), t.secs()),
            ),
            Err(e) => crate::terminal::note(true, format_args!("alight: {e}")),
        }
        std::process::exit(1);
    }
}

impl FlightRecorder {
    /// Creates the file and writes what does not change: configurations and initial state (a node
    /// begins as its configuration makes it).
    pub fn create(path: &Path, subject: &Subject<'_>) -> Result<FlightRecorder, CliError> {
        let doing = |e: toml::ser::Error| CliError::because(format!("recording to {}", path.display()), e);
        let drone = DroneFile {
            bridge: subject.nodes.bridge.clone(),
            drone: subject.nodes.settings(),
        };
        let baseline = BaselineFile {
            baseline: subject.nodes.baseline,
        };
        let texts = [
            (
                VESSEL_FILE,
                toml::to_string(&subject.nodes.vessel).map_err(doing)?,
            ),
            (DECK_FILE, toml::to_string(&subject.nodes.deck).map_err(doing)?),
            (DRONE_FILE, toml::to_string(&drone).map_err(doing)?),
            (BASELINE_FILE, toml::to_string(&baseline).map_err(doing)?),
            ("scenario.toml", toml::to_string(subject.scenario).map_err(doing)?),
        ];
        let values = [
            ("seed", subject.seed.to_string()),
            ("sea", subject.sea.to_string()),
            ("vessel_id", VESSEL_ID.to_string()),
            ("drone_id", DRONE_ID.to_string()),
            (LIVE, u32::from(subject.live).to_string()),
        ];
        let (recorder, truth) = Recorder::create(path, &texts, &values, subject.boots, |opening| {
            TruthViews::new(opening, &subject.scenario.drawn(subject.seed))
        })?;
        Ok(FlightRecorder { recorder, truth })
    }
    /// Ends the recording with what came out of the flight.
    pub fn finish(self, path: &Path, outcome: &Outcome) -> Result<(), CliError> {
        let ending = [
            ("outcome", outcome.outcome.name().to_string()),
            ("reason", outcome.reason.clone()),
            ("digest", outcome.digest.clone()),
        ];
        self.recorder.finish(path, &ending)
    }
}

impl Tap for FlightRecorder {
    fn truth(
        &mut self,
        t: Time<TrueTime>,
        vessel: &RigidState<VesselBody>,
        drone: Option<&RigidState<DroneBody>>,
    ) {
        self.truth.show(&mut self.recorder, t, vessel, drone);
    }
    fn vessel(&mut self, t: Time<TrueTime>, now: Time<VesselClock>, i: &ComputerIn, o: &ComputerOut) {
        self.recorder.vessel(t, now, i, o);
    }
    fn bridge(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &BridgeIn, o: &BridgeOut) {
        self.recorder.bridge(t, now, i, o);
    }
    fn predictor(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PredictorIn, o: &PredictorOut) {
        self.recorder.predictor(t, now, i, o);
    }
    fn mission(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &MissionIn, o: &MissionOut) {
        self.recorder.mission(t, now, i, o);
    }
    fn planner(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PlannerIn, o: &PlannerOut) {
        self.recorder.planner(t, now, i, o);
    }
    fn pilot(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PilotIn, o: &PilotOut) {
        self.recorder.pilot(t, now, i, o);
    }
}

impl Tap for Shown<'_> {
    fn truth(
        &mut self,
        t: Time<TrueTime>,
        vessel: &RigidState<VesselBody>,
        drone: Option<&RigidState<DroneBody>>,
    ) {
        if let Some((recorder, _)) = &mut self.recorder {
            recorder.truth(t, vessel, drone);
        }
        self.end_when_asked(t);
    }
    fn vessel(&mut self, t: Time<TrueTime>, now: Time<VesselClock>, i: &ComputerIn, o: &ComputerOut) {
        if let Some((recorder, _)) = &mut self.recorder {
            recorder.vessel(t, now, i, o);
        }
        if let Some(watcher) = &mut self.watcher {
            watcher.vessel(t, i, o);
        }
    }
    fn bridge(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &BridgeIn, o: &BridgeOut) {
        if let Some((recorder, _)) = &mut self.recorder {
            recorder.bridge(t, now, i, o);
        }
        if let Some(watcher) = &mut self.watcher {
            watcher.bridge(t, o);
        }
    }
    fn predictor(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PredictorIn, o: &PredictorOut) {
        if let Some((recorder, _)) = &mut self.recorder {
            recorder.predictor(t, now, i, o);
        }
        if let Some(watcher) = &mut self.watcher {
            watcher.predictor(t, i, o);
        }
    }
    fn mission(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &MissionIn, o: &MissionOut) {
        if let Some((recorder, _)) = &mut self.recorder {
            recorder.mission(t, now, i, o);
        }
        if let Some(watcher) = &mut self.watcher {
            watcher.mission(t, i, o);
        }
    }
    fn planner(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PlannerIn, o: &PlannerOut) {
        if let Some((recorder, _)) = &mut self.recorder {
            recorder.planner(t, now, i, o);
        }
        if let Some(watcher) = &mut self.watcher {
            watcher.planner(t, now, o);
        }
    }
    fn pilot(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PilotIn, o: &PilotOut) {
        if let Some((recorder, _)) = &mut self.recorder {
            recorder.pilot(t, now, i, o);
        }
        if let Some(watcher) = &mut self.watcher {
            watcher.pilot(t, now, i, o);
        }
    }
}
