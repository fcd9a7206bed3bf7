//! Observer of the world: it receives the truth and the steps of the rows, and changes nothing.

use alight_shared::frames::{DroneBody, VesselBody};
use alight_shared::step::Step;
use alight_shared::time::{Time, TrueTime};
use nalgebra::Vector3;

use crate::physics::body::RigidState;

/// Observer. `t` is the world's time.
pub trait WorldObserver {
    /// Truth at the beginning of the tick: the vessel's reference point, and the drone with the wind that acts on it
    /// (NED, m/s, towards).
    fn truth(
        &mut self,
        _t: Time<TrueTime>,
        _vessel: &RigidState<VesselBody>,
        _drone: Option<&(RigidState<DroneBody>, Vector3<f64>)>,
    ) {
    }
    /// A step of a row of the vessel's computer or the first drone's, in the order in which data flow.
    fn step(&mut self, _t: Time<TrueTime>, _step: &Step<'_>) {}
}

/// An observer that does nothing, and compiles to nothing.
pub struct NoObserver;
impl WorldObserver for NoObserver {}
