//! The drone's planner as a process.

use alight_shared::process::ProcessKind;
use alight_uav::planner::Planner;

use crate::config::DroneComputer;
use crate::process::shell::Shell;

/// The planner's process.
#[derive(Default)]
pub struct PlannerShell;

impl Shell for PlannerShell {
    type Node = Planner;
    const KIND: ProcessKind = ProcessKind::Planner;

    fn node(computer: &DroneComputer, boot: u32) -> Planner {
        let drone = &computer.drone;
        Planner::new(&drone.planner, &drone.airframe, &drone.deck, boot)
    }
}
