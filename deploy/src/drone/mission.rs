//! The drone's mission as a process: wakes with odometry, with a forecast and with a command.

use alight_shared::msg::{
    AutopilotState, Command, DeckForecast, DeckGrant, DroneState, MissionState, Plan, SetPoint,
};
use alight_shared::time::DroneClock;
use alight_shared::transport::TransportError;
use alight_shared::transport::memory::{Listener, Memory};
use alight_shared::transport::process::ProcessKind;
use alight_uav::mission::{Mission, MissionIn, MissionOut};

use crate::process::shell::node_process;

node_process! {
    /// The mission's process: wakes with odometry, with a forecast and with a command.
    MissionShell runs Mission as Mission, reads MissionIn {
        newest forecast: DeckForecast,
        newest drone: DroneState,
        newest autopilot: AutopilotState,
        newest plan: Plan,
        newest set_point: SetPoint,
        newest command: Command,
        newest deck: DeckGrant<DroneClock>,
    },
    publishes MissionOut { state: MissionState }, wakes with [DroneState, DeckForecast, Command],
    makes |computer, boot| {
        let (drone, id) = (&computer.drone, computer.bridge.drone_id);
        Mission::new(&drone.mission(), &drone.airframe, &drone.deck, id, boot)
    }
}
