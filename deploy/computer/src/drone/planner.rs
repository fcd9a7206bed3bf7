//! The drone's planner as a process: wakes with a forecast and with the mission's state.

use alight_shared::msg::{DeckForecast, DroneState, MissionState, Plan};
use alight_shared::process::ProcessKind;
use alight_transport::TransportError;
use alight_transport::memory::{Listener, Memory, Publisher};
use alight_uav::planner::{Planner, PlannerIn, PlannerOut};

use crate::config::DroneComputer;
use crate::process::shell::{Shell, reads};

reads! {
    /// What the planner reads.
    Inputs => PlannerIn {
        newest forecast: DeckForecast,
        newest mission: MissionState,
        newest drone: DroneState,
    }
}

/// Publishers of the planner.
pub struct PlannerShell(Publisher<Plan>);

impl Shell for PlannerShell {
    type Node = Planner;
    type Reads = Inputs;
    const KIND: ProcessKind = ProcessKind::Planner;

    fn node(computer: &DroneComputer, boot: u32) -> Planner {
        let drone = &computer.drone;
        Planner::new(&drone.planner, &drone.airframe, &drone.deck, boot)
    }
    fn join(memory: &Memory) -> Result<Self, TransportError> {
        Ok(PlannerShell(memory.publisher()?))
    }
    fn wakes(memory: &Memory) -> Result<Vec<Listener>, TransportError> {
        Ok(vec![
            memory.listener::<DeckForecast>()?,
            memory.listener::<MissionState>()?,
        ])
    }
    fn send(&mut self, out: &PlannerOut) -> bool {
        self.0.send_any(out.plan.as_ref());
        out.plan.is_some()
    }
    fn unsent(&self) -> u64 {
        self.0.unsent()
    }
}
