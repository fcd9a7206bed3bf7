//! Observer of the world: receives the truth and the rows' steps, and changes nothing.

use alight_shared::{
    frames::{DroneBody, VesselBody},
    step::Step,
    time::WorldTime,
};
use nalgebra::Vector3;

use crate::physics::body::RigidState;

/// `t` is the world's time in all methods.
pub trait WorldObserver {
    /// Truth at the beginning of a tick: the vessel's reference point, the drone, and the wind on the drone
    /// (NED, direction towards which it blows, m/s).
    fn truth(
        &mut self,
        _t: WorldTime,
        _vessel: &RigidState<VesselBody>,
        _drone: Option<&(RigidState<DroneBody>, Vector3<f64>)>,
    ) {
    }
    /// Step of a row of the vessel or the first drone, in the order of the data flow.
    fn step(&mut self, _t: WorldTime, _step: &Step<'_>) {}
}

pub struct NoObserver;
impl WorldObserver for NoObserver {}
