//! The drone's mission as a process.

use alight_shared::metrics::Metric;
use alight_shared::process::ProcessKind;
use alight_shared::time::{DroneClock, Time};
use alight_uav::mission::{Mission, MissionIn, MissionOut};
use tracing::warn;

use crate::config::DroneComputer;
use crate::process::shell::Shell;

/// The mission's process.
#[derive(Default)]
pub struct MissionShell;

impl Shell for MissionShell {
    type Node = Mission;
    const KIND: ProcessKind = ProcessKind::Mission;

    fn node(computer: &DroneComputer, boot: u32) -> Mission {
        let (drone, id) = (&computer.drone, computer.bridge.drone_id);
        Mission::new(&drone.mission(), &drone.airframe, &drone.deck, id, boot).as_successor()
    }
    fn after_step(&mut self, _input: &MissionIn, out: &MissionOut, _sent: Time<DroneClock>) -> Vec<Metric> {
        if let Some(why) = out.rejected {
            warn!(
                "the checkpoint of the mission before this one does not count: it is {why}; what a ground station set is \
                 the file's again: set it again before the next landing"
            );
        }
        Vec::new()
    }
}
