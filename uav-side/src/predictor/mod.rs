//! Predictor: fuses the vessel's messages and the drone's vision about the vessel's modes, and predicts the
//! deck's motion over the next seconds, in the drone's frame, with covariance.
//!
//! - [`waves`]: extrapolation of the vessel's modes.
//! - `own`: modes identified by the drone itself while the vessel is silent.
//! - [`axis`]: the Kalman filter of one degree of freedom.
//! - [`filter`]: the six filters, with fusion of late observations.
//! - [`placement`]: the vessel's estimate in the drone's frame.
//! - `beacon`: the vessel's position from its beacon, if nothing else is known.
//! - `identity`: the vessel's own deck among decks with the same tags.
//! - `level`: mean level of the deck.
//! - `agreement`: comparison of the camera with rangefinder and radio.
//! - [`observation`]: messages as measurements of the six degrees of freedom.
//! - `measurement`: measurement function of the filters, and its Jacobian.
//! - [`track`]: the drone's pose at the time of exposure.
//! - [`lever_arm_heave`]: height of the deck due to its tilt.
//! - `relative`: position from a receiver with the vessel as moving base.
//! - `shift`: effect of a jump of the autopilot's estimate on the filters.
//! - [`forecast`]: the forecast over the horizon.
//! - `checkpoint`: state that outlives the process; `succession`: start of a restarted process.
//!
//! Vessel and drone each have a GNSS error of a metre or more, so the drone knows the vessel's position only up to a
//! slowly varying offset, which vision measures. While the radio is silent, the same filters continue with vision
//! alone.

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
mod succession;
pub mod track;
pub mod waves;

pub use config::PredictorConfig;
pub use node::{Predictor, PredictorIn, PredictorOut, PredictorPorts};
