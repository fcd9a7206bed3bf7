//! The predictor: the vessel's messages and the drone's vision fused about the vessel's modes, propagated to the
//! deck's motion over the next seconds, in the drone's own frame, with covariance.
//!
//! - [`waves`]: the vessel's modes, rolled on.
//! - `own`: the same, identified by the drone itself where the vessel is silent.
//! - [`axis`]: the Kalman filter of one degree of freedom.
//! - [`filter`]: the six of them, and how late observations are fused at their own time.
//! - [`placement`]: the vessel's estimate in the drone's frame.
//! - `beacon`: the vessel's place by its beacon, where nothing else is known.
//! - `identity`: which of several decks with the same tags is the vessel's own.
//! - `level`: the deck's mean level.
//! - `agreement`: whether camera, rangefinder and radio contradict each other.
//! - [`observation`]: each message as a measurement of the six degrees of freedom.
//! - `measurement`: what the filters predict of a measurement, and its Jacobian.
//! - [`track`]: where the drone was at the time of exposure.
//! - [`lever_arm_heave`]: the deck's height due to its tilt.
//! - `relative`: the place by a receiver with the vessel's as its moving base, and its trust.
//! - `shift`: what of it moves where the autopilot's estimate jumps.
//! - [`forecast`]: the horizon.
//! - `checkpoint`: what outlives the process.
//!
//! The vessel and the drone each have a GNSS error of a metre or more, so the vessel's position is
//! known to the drone only up to a slow offset; vision measures that offset. With the radio
//! silent the same filters go on by vision alone.

mod agreement;
pub mod axis;
mod beacon;
mod checkpoint;
mod config;
pub mod filter;
pub mod forecast;
mod identity;
mod level;
pub mod lever_arm_heave;
mod measurement;
mod node;
pub mod observation;
mod own;
pub mod placement;
mod relative;
mod shift;
pub mod track;
pub mod waves;

pub use config::PredictorConfig;
pub use node::{Predictor, PredictorIn, PredictorOut, PredictorPorts};
