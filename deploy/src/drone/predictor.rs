//! The drone's predictor as a process: wakes with the autopilot's odometry.

use alight_shared::msg::{
    DeckForecast, DroneState, LinkState, RangeSample, TagPose, UvdarFix, VesselEstimate, VesselPrediction,
    VesselSurroundings, WaveModel,
};
use alight_shared::time::DroneClock;
use alight_shared::transport::TransportError;
use alight_shared::transport::memory::{Listener, Memory};
use alight_shared::transport::process::ProcessKind;
use alight_uav::predictor::{Predictor, PredictorIn, PredictorOut};

use crate::process::shell::node_process;

node_process! {
    /// The predictor's process: wakes with odometry.
    PredictorShell runs Predictor as Predictor, reads PredictorIn {
        newest estimate: VesselEstimate<DroneClock>,
        newest wave: WaveModel<DroneClock>,
        newest prediction: VesselPrediction<DroneClock>,
        newest surroundings: VesselSurroundings<DroneClock>,
        newest link: LinkState,
        newest drone: DroneState,
        all tags: TagPose,
        all uvdar: UvdarFix,
        all ranges: RangeSample,
    },
    publishes PredictorOut { forecast: DeckForecast }, wakes with [DroneState],
    makes |computer, boot| Predictor::new(&computer.drone.predictor(), boot)
}
