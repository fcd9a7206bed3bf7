//! The vessel's side of Alight: sensors to estimate, identification of the sea, broadcast.
//!
//! | module | what |
//! |---|---|
//! | [`computer`] | [`VesselComputer`]: all nodes of the vessel, as world and process step them |
//! | [`sensors`] | bytes of the vessel's sensors to measurements with their time |
//! | [`node`] | [`VesselNode`]: admission, [`estimator`], broadcast, time replies |
//! | [`estimator`] | the Kalman filter |
//! | [`alight_shared::motion_model`] | identification of the motion, prediction and the measured spread of its error |
//! | [`advice`] | heading and speed on which a landing is most likely to succeed |
//! | [`rate_control`] | the rates that the radio carries |
//! | [`rtcm_relay`] | RTCM of the vessel's receiver to the drones, within a budget |
//! | [`followed`] | whether the drones listen to this computer, or to another with its identity |
//! | [`deck`] | the deck arbiter and the operator relay |
//! | [`calibrate`], [`log`], [`review`] | offline: nothing of them runs in flight |

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
