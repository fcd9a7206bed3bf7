//! The drone's predictor as a process.

use alight_shared::process::ProcessKind;
use alight_uav::predictor::Predictor;

use crate::config::DroneComputer;
use crate::process::shell::Shell;

/// The predictor's process.
#[derive(Default)]
pub struct PredictorShell;

impl Shell for PredictorShell {
    type Node = Predictor;
    const KIND: ProcessKind = ProcessKind::Predictor;

    fn node(computer: &DroneComputer, boot: u32) -> Predictor {
        Predictor::new(&computer.drone.predictor(), boot).as_successor()
    }
}
