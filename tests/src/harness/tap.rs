//! Tap: an observer of the world, shown the truth and the steps of the rows, which changes nothing.

use alight_shared::frames::{DroneBody, VesselBody};
use alight_shared::step::Step;
use alight_shared::time::{Time, TrueTime};
use nalgebra::Vector3;

use crate::physics::body::RigidState;

/// Looks on. `t` is the world's time.
pub trait Tap {
    /// The vessel's reference point, and the drone with the wind that it meets (NED, m/s, towards), at the beginning of the
    /// tick.
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

/// An observer that does nothing: compiles to nothing.
pub struct NoTap;
impl Tap for NoTap {}
