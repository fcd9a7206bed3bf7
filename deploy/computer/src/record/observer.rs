//! Observer of a flight that goes on or is computed again: shown every step, changes none.

use alight_bridge::{BridgeIn, BridgeOut};
use alight_shared::time::{DroneClock, Time, TrueTime, VesselClock};
use alight_shared::wire::WireError;
use alight_uav::mission::{MissionIn, MissionOut};
use alight_uav::pilot::{PilotIn, PilotOut};
use alight_uav::planner::{PlannerIn, PlannerOut};
use alight_uav::predictor::{PredictorIn, PredictorOut};
use alight_usv::{ComputerIn, ComputerOut};

/// A step: the node's own time, input and output.
#[derive(Clone, Copy)]
pub enum NodeStep<'a> {
    /// Step of the vessel's computer.
    Vessel(Time<VesselClock>, &'a ComputerIn, &'a ComputerOut),
    /// Step of the bridge.
    Bridge(Time<DroneClock>, &'a BridgeIn, &'a BridgeOut),
    /// Step of the predictor.
    Predictor(Time<DroneClock>, &'a PredictorIn, &'a PredictorOut),
    /// Step of the mission.
    Mission(Time<DroneClock>, &'a MissionIn, &'a MissionOut),
    /// Step of the planner.
    Planner(Time<DroneClock>, &'a PlannerIn, &'a PlannerOut),
    /// Step of the pilot.
    Pilot(Time<DroneClock>, &'a PilotIn, &'a PilotOut),
}

/// Is shown each step.
pub trait StepObserver {
    /// The next step is of the start of this process with this boot id.
    fn of(&mut self, _process: &str, _boot: u32) {}
    /// A step at `t`, the world's time.
    fn step(&mut self, t: Time<TrueTime>, step: NodeStep<'_>);
    /// A step of the simulated world, as its process recorded it.
    fn world(&mut self, _t: Time<TrueTime>, _entry: &[u8]) -> Result<(), WireError> {
        Ok(())
    }
}

/// All of them.
impl StepObserver for Vec<&mut dyn StepObserver> {
    fn of(&mut self, process: &str, boot: u32) {
        self.iter_mut().for_each(|o| o.of(process, boot));
    }
    fn step(&mut self, t: Time<TrueTime>, step: NodeStep<'_>) {
        self.iter_mut().for_each(|o| o.step(t, step));
    }
    fn world(&mut self, t: Time<TrueTime>, entry: &[u8]) -> Result<(), WireError> {
        self.iter_mut().try_for_each(|o| o.world(t, entry))
    }
}
