//! Recordings of simulated flights: what the world's tap shows, and the truth beside it.

mod truth;

use std::path::Path;

use alight_bridge::{BridgeConfig, BridgeIn, BridgeOut};
use alight_computer::config::{DroneComputer, VesselComputer};
use alight_computer::exit::{CliError, Doing};
use alight_computer::playback::Viewer;
use alight_computer::record::entry::{Entry, PartHeader};
use alight_computer::record::observer::{NodeStep, StepObserver};
use alight_computer::record::{BASELINE_FILE, LIVE, NODES, Recorder};
use alight_shared::frames::{DroneBody, VesselBody};
use alight_shared::time::{DroneClock, Time, TrueTime, VesselClock};
use alight_shared::wire::{self, WireError};
use alight_sim::baselines::Baseline;
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::physics::{BOOT, DRONE_ID, VESSEL_ID};
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::tap::Tap;
use alight_sim::harness::trial::{FlownTrial, Watch, fly_with};
use alight_sim::physics::body::RigidState;
use alight_transport::wake::end_requested;
use alight_uav::mission::{MissionIn, MissionOut};
use alight_uav::pilot::{PilotIn, PilotOut};
use alight_uav::planner::law::Law;
use alight_uav::planner::{PlannerIn, PlannerOut};
use alight_uav::predictor::{PredictorIn, PredictorOut};
use alight_uav::settings::DroneSettings;
use alight_usv::{ComputerIn, ComputerOut};
use serde::{Deserialize, Serialize};

use crate::live::truth::Truth;
use truth::TruthViews;

/// What is attached as [`BASELINE_FILE`].
#[derive(Serialize, Deserialize)]
struct BaselineFile {
    baseline: Option<Baseline>,
}

/// The law of a recorded baseline; a real flight has none.
pub fn law(text: &str, drone: &DroneSettings) -> Result<Option<Box<dyn Law>>, CliError> {
    let BaselineFile { baseline } = toml::from_str(text).doing(format_args!("reading {BASELINE_FILE}"))?;
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
}

/// Whose steps a flight in lock-step has: a computer's file holds what its nodes are made of.
fn lock_step(nodes: &NodeConfigs) -> Result<Vec<PartHeader>, CliError> {
    let vessel = VesselComputer {
        vessel_id: VESSEL_ID,
        deck: nodes.deck.clone(),
        vessel: nodes.vessel.clone(),
        ..VesselComputer::default()
    };
    let drone = DroneComputer {
        bridge: BridgeConfig {
            drone_id: DRONE_ID,
            ..nodes.bridge.clone()
        },
        drone: nodes.settings(),
        ..DroneComputer::default()
    };
    let vessel = toml::to_string(&vessel).doing("writing the vessel's configuration")?;
    let drone = toml::to_string(&drone).doing("writing the drone's configuration")?;
    let header = |node: &str| PartHeader {
        process: node.into(),
        boot: BOOT,
        config: if node == "vessel" { &vessel } else { &drone }.clone(),
        ..PartHeader::default()
    };
    Ok(NODES.map(header).into())
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
    watcher: Option<&mut (dyn Viewer + 'static)>,
) -> Result<(FlownTrial, Result<(), CliError>), CliError> {
    let headers = lock_step(subject.nodes)?;
    let recorder = path
        .map(|path| FlightRecorder::create(path, subject, &headers, false))
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
    } = *subject;
    let flown = fly_with(scenario, nodes, seed, sea, watch, &mut shown).doing("setting up the trial")?;
    let Shown { recorder, watcher } = shown;
    let recorded = recorder.map_or(Ok(()), |(recorder, path)| recorder.finish(path, &flown.outcome));
    if let Some(watcher) = watcher {
        watcher.linger();
    }
    Ok((flown, recorded))
}

impl FlightRecorder {
    /// Creates the file of nodes with these headers and writes what does not change. `live`: they were processes.
    pub fn create(
        path: &Path,
        subject: &Subject<'_>,
        headers: &[PartHeader],
        live: bool,
    ) -> Result<FlightRecorder, CliError> {
        let doing = format_args!("recording to {}", path.display());
        let baseline = BaselineFile {
            baseline: subject.nodes.baseline,
        };
        let texts = [
            (BASELINE_FILE, toml::to_string(&baseline).doing(doing)?),
            ("scenario.toml", toml::to_string(subject.scenario).doing(doing)?),
        ];
        let values = [
            ("seed", subject.seed.to_string()),
            ("sea", subject.sea.to_string()),
            (LIVE, u32::from(live).to_string()),
        ];
        let (recorder, truth) = Recorder::create(path, headers, &texts, &values, |sink| {
            TruthViews::new(sink, &subject.scenario.drawn(subject.seed))
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
    fn truth(
        &mut self,
        t: Time<TrueTime>,
        vessel: &RigidState<VesselBody>,
        drone: Option<&RigidState<DroneBody>>,
    ) {
        self.truth.show(&mut self.recorder, t, vessel, drone);
    }
}

impl StepObserver for FlightRecorder {
    fn step(&mut self, t: Time<TrueTime>, step: NodeStep<'_>) {
        self.recorder.step(t, step);
    }
    fn world(&mut self, t: Time<TrueTime>, entry: &[u8]) -> Result<(), WireError> {
        let truth = wire::decode_record::<Entry<Truth>>(entry)?.input;
        self.truth(t, &truth.vessel(), truth.drone().as_ref());
        Ok(())
    }
}

/// The file and who looks on.
struct Shown<'a> {
    recorder: Option<(FlightRecorder, &'a Path)>,
    watcher: Option<&'a mut (dyn Viewer + 'static)>,
}

impl Shown<'_> {
    fn step(&mut self, t: Time<TrueTime>, step: NodeStep<'_>) {
        if let Some((recorder, _)) = &mut self.recorder {
            recorder.step(t, step);
        }
        if let Some(watcher) = &mut self.watcher {
            watcher.step(t, step);
        }
    }
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
            Ok(()) => alight_computer::terminal::note(
                true,
                format_args!("interrupted: {} has the first {:.1} s", path.display(), t.secs()),
            ),
            Err(e) => alight_computer::terminal::note(true, format_args!("alight: {e}")),
        }
        std::process::exit(1);
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
        self.step(t, NodeStep::Vessel(now, i, o));
    }
    fn bridge(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &BridgeIn, o: &BridgeOut) {
        self.step(t, NodeStep::Bridge(now, i, o));
    }
    fn predictor(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PredictorIn, o: &PredictorOut) {
        self.step(t, NodeStep::Predictor(now, i, o));
    }
    fn mission(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &MissionIn, o: &MissionOut) {
        self.step(t, NodeStep::Mission(now, i, o));
    }
    fn planner(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PlannerIn, o: &PlannerOut) {
        self.step(t, NodeStep::Planner(now, i, o));
    }
    fn pilot(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PilotIn, o: &PilotOut) {
        self.step(t, NodeStep::Pilot(now, i, o));
    }
}
