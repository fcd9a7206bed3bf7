//! The simulated world of Alight: truth that shares no model with the nodes.
//!
//! Start at [`harness::world`]: `World::tick` is the architecture diagram. [`harness::trial`] flies one
//! landing. Lower layers know nothing of the ones above: physics < sensors, radio, autopilots,
//! baselines < harness < studies.

pub mod autopilots;
pub mod baselines;
pub mod harness;
pub mod physics;
pub mod radio;
pub mod sensors;
pub mod studies;
