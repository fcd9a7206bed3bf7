//! The interfaces between Alight's processes and the vehicles, one module each: what a real
//! vessel's sensors and a real autopilot plug into, and the simulated ones today.

#[cfg(feature = "live")]
pub mod autopilot;
pub mod sensors;
