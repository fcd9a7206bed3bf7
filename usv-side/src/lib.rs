//! The vessel's side of Alight: sensors to estimate, identification of the sea, broadcast.
//!
//! [`VesselNode`] is the process: it admits what the sensors say, feeds the [`estimator`], which in
//! turn feeds and uses the [`sea_state`] identification, and speaks at the rates that the link bears
//! ([`throttle`]).

pub mod calibrate;
pub mod commands;
pub mod config;
pub mod deck;
pub mod estimator;
pub mod felt;
pub mod log;
pub mod node;
pub mod review;
pub mod sea_state;
pub mod sensors;
pub mod throttle;

pub use commands::Commands;
pub use config::{BroadcastConfig, GnssConfig, HeadingConfig, ImuConfig, VesselNodeConfig};
pub use deck::{DeckConfig, DeckKeeper};
pub use estimator::Estimator;
pub use node::{KINDS, Refused, SourceCounts, VesselIn, VesselNode, VesselOut};
