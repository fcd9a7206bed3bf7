//! The recorder: every node's step to its own channel, and views for people.

use std::path::Path;

use alight_bridge::{BridgeIn, BridgeOut};
use alight_shared::time::{DroneClock, Time, TrueTime, VesselClock};
use alight_shared::wire::{self, WireError};
use alight_uav::mission::{MissionIn, MissionOut};
use alight_uav::pilot::{PilotIn, PilotOut};
use alight_uav::planner::{PlannerIn, PlannerOut};
use alight_uav::predictor::{PredictorIn, PredictorOut};
use alight_usv::{ComputerIn, ComputerOut};
use mcap::McapError;
use serde::Serialize;

use crate::exit::CliError;
use crate::record::entry::{ENCODING, Entry, FORMAT, MissionEntry, Newest, PilotEntry, PlannerEntry};
use crate::record::sink::{Channel, Opening, Sink, TakeMessages, unwritable};
use crate::record::views::{Views, stamp};
use crate::record::{NODES, RECORDING, boot, topic};

/// Records a flight.
pub struct Recorder {
    /// The file.
    pub sink: Sink,
    /// What a person looks at.
    pub views: Views,
    /// In the order of [`NODES`].
    inputs: [Channel; NODES.len()],
    newest: Newest,
    failed: Option<WireError>,
}

impl Recorder {
    /// Creates the file with the attached `texts`, the `values` that say what is recorded, the boot ids of
    /// the nodes in the order of [`NODES`], and the channels that `more` opens beside its own.
    pub fn create<T>(
        path: &Path,
        texts: &[(&str, String)],
        values: &[(&str, String)],
        boots: [u32; NODES.len()],
        more: impl FnOnce(&mut Opening) -> Result<T, McapError>,
    ) -> Result<(Recorder, T), CliError> {
        let create = || -> Result<(Recorder, T), McapError> {
            let mut opening = Opening::create(path)?;
            let own = [
                ("format".to_string(), FORMAT.to_string()),
                ("program".to_string(), env!("CARGO_PKG_VERSION").to_string()),
            ];
            let values = values
                .iter()
                .map(|(name, value)| (name.to_string(), value.clone()));
            let boots = NODES
                .iter()
                .zip(boots)
                .map(|(node, id)| (boot(node), id.to_string()));
            opening.metadata(RECORDING, own.into_iter().chain(values).chain(boots).collect())?;
            for (name, text) in texts {
                opening.attach(name, text)?;
            }
            let mut inputs = [Channel::default(); NODES.len()];
            for (channel, node) in inputs.iter_mut().zip(NODES) {
                *channel = opening.raw(&topic(node), ENCODING)?;
            }
            let (views, more) = (Views::new(&mut opening)?, more(&mut opening)?);
            let recorder = Recorder {
                sink: opening.start(),
                views,
                inputs,
                newest: Newest::default(),
                failed: None,
            };
            Ok((recorder, more))
        };
        create()
            .map_err(|e| CliError::because(format!("recording to {}", path.display()), unwritable(path, &e)))
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
        let doing = format_args!("recording to {}", path.display());
        let written = self.sink.finish("outcome", outcome);
        written.map_err(|e| CliError::because(doing, unwritable(path, &e)))?;
        match self.failed {
            Some(e) => Err(CliError::because(doing, e)),
            None => Ok(()),
        }
    }

    /// A step of the vessel.
    pub fn vessel(&mut self, t: Time<TrueTime>, now: Time<VesselClock>, i: &ComputerIn, o: &ComputerOut) {
        self.entry(0, t, now.nanos(), i, o);
        self.views.vessel(&mut self.sink, t, &i.vessel, &o.vessel);
    }
    /// A step of the bridge.
    pub fn bridge(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &BridgeIn, o: &BridgeOut) {
        self.entry(1, t, now.nanos(), i, o);
        self.views.bridge(&mut self.sink, t, o);
    }
    /// A step of the predictor.
    pub fn predictor(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PredictorIn, o: &PredictorOut) {
        self.entry(2, t, now.nanos(), i, o);
        self.newest.recorded(i.drone.as_ref());
        self.views.predictor(&mut self.sink, t, i, o);
    }
    /// A step of the mission.
    pub fn mission(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &MissionIn, o: &MissionOut) {
        let entry = MissionEntry::of(i, &mut self.newest);
        self.entry(3, t, now.nanos(), entry, o);
        self.views.mission(&mut self.sink, t, i, o);
    }
    /// A step of the planner.
    pub fn planner(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PlannerIn, o: &PlannerOut) {
        let entry = PlannerEntry::of(i, &mut self.newest);
        self.entry(4, t, now.nanos(), entry, o);
        self.views.planner(&mut self.sink, t, now, o);
    }
    /// A step of the pilot.
    pub fn pilot(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, i: &PilotIn, o: &PilotOut) {
        let entry = PilotEntry::of(i, &mut self.newest);
        self.entry(5, t, now.nanos(), entry, o);
        self.views.pilot(&mut self.sink, t, now, i, o);
    }
}
