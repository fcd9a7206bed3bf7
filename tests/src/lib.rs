//! The simulated world of Alight. The true world shares no model with the nodes.
//!
//! Start at [`harness::world`]: `World::tick` follows the architecture diagram. [`harness::trial`] flies one landing.
//! Lower layers do not depend on higher ones: physics < sensors, radio, autopilots, baselines < harness < studies.

pub mod autopilots;
pub mod baselines;
pub mod harness;
pub mod physics;
pub mod radio;
pub mod sensors;
pub mod studies;
