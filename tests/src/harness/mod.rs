//! The world in lock-step with the nodes: one landing, the judge of its outcome, and observers.

mod ashore;
pub mod bus;
pub mod cameras;
mod drone_computer;
mod edge;
pub mod errors;
pub mod failing;
pub(crate) mod foresight;
pub mod link;
pub mod mutant;
pub mod observer;
pub mod outcome;
pub mod physics;
pub mod rig;
pub mod scenario;
pub mod storm;
pub mod trace;
pub mod trial;
pub mod vessel_computer;
pub mod world;
