//! Observer of a flight that goes on or is computed again: shown every step, changes none.

use alight_bridge::BridgeOut;
use alight_shared::time::{DroneClock, Time, TrueTime};
use alight_uav::mission::{MissionIn, MissionOut};
use alight_uav::pilot::{PilotIn, PilotOut};
use alight_uav::planner::PlannerOut;
use alight_uav::predictor::{PredictorIn, PredictorOut};
use alight_usv::{ComputerIn, ComputerOut};

/// Is shown each node's steps. `t` is the world's time, `now` the node's own.
pub trait Onlooker {
    /// A step of the vessel.
    fn vessel(&mut self, _t: Time<TrueTime>, _i: &ComputerIn, _o: &ComputerOut) {}
    /// A step of the bridge.
    fn bridge(&mut self, _t: Time<TrueTime>, _o: &BridgeOut) {}
    /// A step of the predictor.
    fn predictor(&mut self, _t: Time<TrueTime>, _i: &PredictorIn, _o: &PredictorOut) {}
    /// A step of the mission.
    fn mission(&mut self, _t: Time<TrueTime>, _i: &MissionIn, _o: &MissionOut) {}
    /// A step of the planner.
    fn planner(&mut self, _t: Time<TrueTime>, _now: Time<DroneClock>, _o: &PlannerOut) {}
    /// A step of the pilot.
    fn pilot(&mut self, _t: Time<TrueTime>, _now: Time<DroneClock>, _i: &PilotIn, _o: &PilotOut) {}
}

/// Nobody looks on.
pub struct Nobody;

impl Onlooker for Nobody {}
