//! The drone's predictor as a process: wakes with the autopilot's odometry. Its checkpoint goes to the
//! supervisor, which republishes it to a predictor that begins.

use alight_shared::msg::{
    AutopilotState, DeckBeacon, DeckForecast, DroneState, LinkState, PredictorCheckpoint, RangeSample,
    TagPose, UvdarFix, VesselEstimate, VesselPrediction, VesselSurroundings, WaveModel,
};
use alight_shared::process::ProcessKind;
use alight_shared::time::DroneClock;
use alight_transport::TransportError;
use alight_transport::memory::{Listener, Memory, Publisher};
use alight_uav::predictor::{Predictor, PredictorIn, PredictorOut};

use crate::config::DroneComputer;
use crate::process::keeper::OwnCheckpoint;
use crate::process::shell::{Shell, reads};

reads! {
    /// What the predictor reads.
    Inputs => PredictorIn {
        newest estimate: VesselEstimate<DroneClock>,
        newest wave: WaveModel<DroneClock>,
        newest prediction: VesselPrediction<DroneClock>,
        newest surroundings: VesselSurroundings<DroneClock>,
        newest link: LinkState,
        newest drone: DroneState,
        newest autopilot: AutopilotState,
        all beacons: DeckBeacon,
        all tags: TagPose,
        all uvdar: UvdarFix,
        all ranges: RangeSample,
        ; checkpoint
    }
}

/// Publishers of the predictor, its checkpoint's too.
pub struct PredictorShell {
    forecast: Publisher<DeckForecast>,
    checkpoint: OwnCheckpoint<PredictorCheckpoint>,
}

impl Shell for PredictorShell {
    type Node = Predictor;
    type Reads = Inputs;
    const KIND: ProcessKind = ProcessKind::Predictor;

    fn node(computer: &DroneComputer, boot: u32) -> Predictor {
        Predictor::new(&computer.drone.predictor(), boot).as_successor()
    }
    fn join(memory: &Memory) -> Result<Self, TransportError> {
        Ok(PredictorShell {
            forecast: memory.publisher()?,
            checkpoint: OwnCheckpoint::join(memory)?,
        })
    }
    fn wakes(memory: &Memory) -> Result<Vec<Listener>, TransportError> {
        Ok(vec![memory.listener::<DroneState>()?])
    }
    fn complete(&mut self, t: i64, input: &mut PredictorIn) {
        input.checkpoint = self.checkpoint.predecessor(t);
    }
    fn send(&mut self, out: &PredictorOut) -> bool {
        self.forecast.send_any(out.forecast.as_ref());
        self.checkpoint.publish(out.checkpoint.as_ref());
        out.forecast.is_some()
    }
    fn unsent(&self) -> u64 {
        self.forecast.unsent() + self.checkpoint.unsent()
    }
}
