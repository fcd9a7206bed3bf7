//! The drone's planner as a process: wakes with a forecast and with the mission's state.

use alight_shared::msg::{AutopilotState, DeckForecast, DroneState, MissionState, Plan};
use alight_shared::transport::TransportError;
use alight_shared::transport::memory::{Listener, Memory};
use alight_shared::transport::process::ProcessKind;
use alight_uav::planner::{Planner, PlannerIn, PlannerOut};

use crate::process::shell::node_process;

node_process! {
    /// The planner's process: wakes with a forecast and with the mission's state.
    PlannerShell runs Planner as Planner, reads PlannerIn {
        newest forecast: DeckForecast,
        newest mission: MissionState,
        newest drone: DroneState,
        newest autopilot: AutopilotState,
    },
    publishes PlannerOut { plan: Plan }, wakes with [DeckForecast, MissionState],
    makes |computer, boot| {
        let drone = &computer.drone;
        Planner::new(&drone.planner, &drone.airframe, &drone.deck, boot)
    }
}
