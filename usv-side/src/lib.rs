//! The vessel's side of Alight: state estimation from sensors, identification of the sea, broadcast.
//!
//! | module | what |
//! |---|---|
//! | [`computer`] | [`VesselComputer`]: all nodes of the vessel, stepped by world and process |
//! | [`sensors`] | bytes of the vessel's sensors to measurements with time stamps |
//! | [`node`] | [`VesselNode`]: admission, [`estimator`], broadcast, time replies |
//! | [`estimator`] | the Kalman filter |
//! | [`alight_shared::motion_model`] | identification of the motion, prediction and its measured error |
//! | [`advice`] | heading and speed with the highest probability of a landing |
//! | [`rate_control`] | message rates that the radio carries |
//! | [`rtcm_relay`] | RTCM of the vessel's receiver to the drones, within a budget |
//! | [`followed`] | check whether the drones follow this computer or another with its identity |
//! | [`deck`] | the deck arbiter and the operator relay |
//! | [`calibrate`], [`log`], [`review`] | offline tools, not used in flight |

pub mod advice;
pub mod calibrate;
pub mod computer;
pub mod config;
pub mod deck;
pub mod estimator;
#[cfg(test)]
mod fixtures;
pub mod followed;
pub mod log;
mod mavlink_systems;
pub mod node;
pub mod rate_control;
pub mod review;
pub mod rtcm_relay;
pub mod sensors;

pub use advice::{Advice, AdviceConfig, Advisor, CourseOutlook};
pub use computer::{ComputerIn, ComputerOut, VesselCheckpoint, VesselComputer, VesselEvent};
pub use config::{BroadcastConfig, GnssConfig, HeadingConfig, ImuConfig, VesselNodeConfig};
pub use deck::DeckConfig;
pub use estimator::Estimator;
pub use node::{KINDS, SourceCounts, VesselIn, VesselNode, VesselOut};
