//! The simulated world of Alight. The true world and the nodes share no model.
//!
//! Start at [`harness::world`]: `World::tick` follows the architecture diagram. [`harness::trial`] flies one landing.
//! Lower layers do not depend on higher layers: physics < sensors, radio, autopilots, baselines < harness < studies, charts.

pub mod autopilots;
pub mod baselines;
pub mod chart;
pub mod harness;
pub mod physics;
pub mod radio;
pub mod sensors;
pub mod studies;
