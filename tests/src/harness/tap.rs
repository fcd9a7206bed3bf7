//! Tap: an observer of the world, shown the truth and every node's input and output, which changes
//! nothing.

use alight_bridge::{BridgeIn, BridgeOut};
use alight_shared::frames::{DroneBody, VesselBody};
use alight_shared::time::{DroneClock, Time, TrueTime, VesselClock};
use alight_uav::mission::{MissionIn, MissionOut};
use alight_uav::pilot::{PilotIn, PilotOut};
use alight_uav::planner::{PlannerIn, PlannerOut};
use alight_uav::predictor::{PredictorIn, PredictorOut};
use alight_usv::{ComputerIn, ComputerOut};

use crate::physics::body::RigidState;

/// Called in data-flow order once per tick. `t` is the world's time, `now` the node's own.
pub trait Tap {
    /// The vessel's reference point and the drone at the beginning of the tick.
    fn truth(
        &mut self,
        _t: Time<TrueTime>,
        _vessel: &RigidState<VesselBody>,
        _drone: Option<&RigidState<DroneBody>>,
    ) {
    }
    /// The vessel's computer.
    fn vessel(
        &mut self,
        _t: Time<TrueTime>,
        _now: Time<VesselClock>,
        _input: &ComputerIn,
        _output: &ComputerOut,
    ) {
    }
    /// The bridge.
    fn bridge(&mut self, _t: Time<TrueTime>, _now: Time<DroneClock>, _input: &BridgeIn, _output: &BridgeOut) {
    }
    /// The predictor.
    fn predictor(
        &mut self,
        _t: Time<TrueTime>,
        _now: Time<DroneClock>,
        _input: &PredictorIn,
        _output: &PredictorOut,
    ) {
    }
    /// The mission.
    fn mission(
        &mut self,
        _t: Time<TrueTime>,
        _now: Time<DroneClock>,
        _input: &MissionIn,
        _output: &MissionOut,
    ) {
    }
    /// The planner.
    fn planner(
        &mut self,
        _t: Time<TrueTime>,
        _now: Time<DroneClock>,
        _input: &PlannerIn,
        _output: &PlannerOut,
    ) {
    }
    /// The pilot.
    fn pilot(&mut self, _t: Time<TrueTime>, _now: Time<DroneClock>, _input: &PilotIn, _output: &PilotOut) {}
}

/// Nobody looks: compiles to nothing.
pub struct NoTap;
impl Tap for NoTap {}
