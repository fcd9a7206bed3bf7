//! The simulated world of Alight: truth that shares no model with the nodes.
//!
//! Start at [`world`]: `World::tick` is the architecture diagram. [`trial`] flies one landing.

pub mod age;
pub mod body;
pub mod deck_motion;
pub mod drone;
pub mod eye;
pub mod firmware;
pub mod outcome;
pub mod paired;
pub mod physics;
pub mod radio;
pub mod response;
pub mod scenario;
pub mod sea;
pub mod sensors;
pub mod statistics;
pub mod streams;
pub mod studies;
pub mod tap;
pub mod trace;
pub mod trial;
pub mod vessel;
pub mod world;
