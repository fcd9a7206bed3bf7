//! Observer of the world: receives the truth and the rows' steps, and changes nothing.

use alight_shared::frames::{DroneBody, VesselBody};
use alight_shared::step::Step;
use alight_shared::time::{Time, TrueTime};
use nalgebra::Vector3;

use crate::physics::body::RigidState;

/// `t`: the world's time.
pub trait WorldObserver {
    /// Truth at the beginning of a tick: the vessel's reference point; the drone and the wind on it (NED,
    /// towards, m/s).
    fn truth(
        &mut self,
        _t: Time<TrueTime>,
        _vessel: &RigidState<VesselBody>,
        _drone: Option<&(RigidState<DroneBody>, Vector3<f64>)>,
    ) {
    }
    /// A step of a row of the vessel or the first drone, in the order of the data flow.
    fn step(&mut self, _t: Time<TrueTime>, _step: &Step<'_>) {}
}

pub struct NoObserver;
impl WorldObserver for NoObserver {}
