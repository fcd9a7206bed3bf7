//! The vessel's side of Alight: sensors to estimate, identification of the sea, broadcast.
//!
//! [`VesselNode`] is the process: it admits what the sensors say, feeds the [`estimator`], which in
//! turn feeds and uses the [`sea_state`] identification, and speaks at the rates that the link bears
//! ([`rate_control`]).

pub mod apparent_slope;
pub mod calibrate;
pub mod commands;
pub mod config;
pub mod deck;
pub mod estimator;
pub mod log;
pub mod node;
pub mod rate_control;
pub mod review;
pub mod sea_state;
pub mod sensors;

pub use commands::OperatorRelay;
pub use config::{BroadcastConfig, GnssConfig, HeadingConfig, ImuConfig, VesselNodeConfig};
pub use deck::{DeckArbiter, DeckConfig};
pub use estimator::Estimator;
pub use node::{KINDS, Rejections, SourceCounts, VesselIn, VesselNode, VesselOut};
