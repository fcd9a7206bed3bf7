//! The tap: every node's step to its own channel, and what a person looks at besides.

use std::path::Path;

use alight_bridge::{BridgeIn, BridgeOut};
use alight_shared::frames::{DroneBody, VesselBody};
use alight_shared::time::{DroneClock, Time, TrueTime, VesselClock};
use alight_shared::wire::{self, WireError};
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::tap::Tap;
use alight_sim::harness::world::{DRONE_ID, VESSEL_ID};
use alight_sim::physics::body::RigidState;
use alight_uav::mission::{MissionIn, MissionOut};
use alight_uav::pilot::{PilotIn, PilotOut};
use alight_uav::planner::{PlannerIn, PlannerOut};
use alight_uav::predictor::{PredictorIn, PredictorOut};
use alight_usv::{VesselIn, VesselOut};
use mcap::McapError;
use serde::Serialize;

use crate::config::DroneFile;
use crate::exit::CliError;
use crate::record::entry::{ENCODING, Entry, FORMAT, MissionEntry, Newest, PilotEntry, PlannerEntry};
use crate::record::show::Show;
use crate::record::sink::{Channel, Opening, Sink};
use crate::record::{NODES, topic};

/// What is recorded.
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
}

/// Records a flight.
pub struct Recorder {
    sink: Sink,
    /// In the order of [`NODES`].
    inputs: [Channel; NODES.len()],
    newest: Newest,
    show: Show,
    failed: Option<WireError>,
}

impl Recorder {
    /// Creates the file and writes what does not change: configurations and initial state (a node
    /// begins as its configuration makes it).
    pub fn create(path: &Path, subject: &Subject<'_>) -> Result<Recorder, CliError> {
        let doing = || format!("recording to {}", path.display());
        let vessel = toml::to_string(&subject.nodes.vessel).map_err(|e| CliError::because(doing(), e))?;
        let drone = toml::to_string(&DroneFile {
            bridge: subject.nodes.bridge.clone(),
            drone: subject.nodes.drone.clone(),
        })
        .map_err(|e| CliError::because(doing(), e))?;
        let scenario = toml::to_string(subject.scenario).map_err(|e| CliError::because(doing(), e))?;
        let texts = [
            (crate::record::VESSEL_FILE, vessel),
            (crate::record::DRONE_FILE, drone),
            ("scenario.toml", scenario),
        ];
        Self::open(path, subject, &texts)
            .map_err(|e| CliError::because(doing(), format!("{e}; choose a path that can be written")))
    }
    fn open(path: &Path, subject: &Subject<'_>, texts: &[(&str, String)]) -> Result<Recorder, McapError> {
        let mut opening = Opening::create(path)?;
        let values = [
            ("format", FORMAT.to_string()),
            ("program", env!("CARGO_PKG_VERSION").to_string()),
            ("seed", subject.seed.to_string()),
            ("sea", subject.sea.to_string()),
            ("vessel_id", VESSEL_ID.to_string()),
            ("drone_id", DRONE_ID.to_string()),
        ];
        let boots = NODES.iter().zip(subject.boots);
        let boots: Vec<(String, String)> = boots
            .map(|(node, boot)| (crate::record::boot(node), boot.to_string()))
            .collect();
        let all: Vec<(&str, String)> = values
            .into_iter()
            .chain(boots.iter().map(|(name, boot)| (name.as_str(), boot.clone())))
            .collect();
        opening.metadata(crate::record::RECORDING, &all)?;
        for (name, text) in texts {
            opening.attach(name, text)?;
        }
        let mut inputs = [Channel::default(); NODES.len()];
        for (channel, node) in inputs.iter_mut().zip(NODES) {
            *channel = opening.raw(&topic(node), ENCODING)?;
        }
        let show = Show::new(&mut opening, subject.scenario)?;
        Ok(Recorder {
            sink: opening.start(),
            inputs,
            newest: Newest::default(),
            show,
            failed: None,
        })
    }

    fn entry<I: Serialize, O: Serialize>(
        &mut self,
        node: usize,
        t: Time<TrueTime>,
        now_ns: i64,
        input: I,
        output: &O,
    ) {
        let wrote = wire::hash_record(output).and_then(|output| {
            let entry = Entry {
                now_ns,
                input,
                output,
            };
            self.sink
                .message(self.inputs[node], stamp(t), |to| wire::append_record(to, &entry))
        });
        if let Err(e) = wrote {
            self.failed.get_or_insert(e);
        }
    }

    /// Ends the recording with what came out of the flight.
    pub fn finish(self, path: &Path, outcome: &[(&str, String)]) -> Result<(), CliError> {
        let doing = || format!("recording to {}", path.display());
        self.sink
            .finish("outcome", outcome)
            .map_err(|e| CliError::because(doing(), e))?;
        match self.failed {
            Some(e) => Err(CliError::because(doing(), e)),
            None => Ok(()),
        }
    }
}

/// Time of a message in the file: the world's time.
pub fn stamp(t: Time<TrueTime>) -> u64 {
    u64::try_from(t.nanos()).unwrap_or_default()
}

impl Tap for Recorder {
    fn truth(
        &mut self,
        t: Time<TrueTime>,
        vessel: &RigidState<VesselBody>,
        drone: Option<&RigidState<DroneBody>>,
    ) {
        self.show.truth(&mut self.sink, t, vessel, drone);
    }
    fn vessel(&mut self, t: Time<TrueTime>, now: Time<VesselClock>, i: &VesselIn, o: &VesselOut) {
        self.entry(0, t, now.nanos(), i, o);
        self.show.vessel(&mut self.sink, t, i, o);
    }
    fn bridge(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &BridgeIn, o: &BridgeOut) {
        self.entry(1, t, now.nanos(), i, o);
        self.show.bridge(&mut self.sink, t, o);
    }
    fn predictor(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PredictorIn, o: &PredictorOut) {
        self.entry(2, t, now.nanos(), i, o);
        self.newest.recorded(i.drone.as_ref());
        self.show.predictor(&mut self.sink, t, i, o);
    }
    fn mission(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &MissionIn, o: &MissionOut) {
        let entry = MissionEntry::of(i, &mut self.newest);
        self.entry(3, t, now.nanos(), entry, o);
        self.show.mission(&mut self.sink, t, i, o);
    }
    fn planner(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PlannerIn, o: &PlannerOut) {
        let entry = PlannerEntry::of(i, &mut self.newest);
        self.entry(4, t, now.nanos(), entry, o);
        self.show.planner(&mut self.sink, t, now, o);
    }
    fn pilot(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PilotIn, o: &PilotOut) {
        let entry = PilotEntry::of(i, &mut self.newest);
        self.entry(5, t, now.nanos(), entry, o);
        self.show.pilot(&mut self.sink, t, now, i, o);
    }
}
