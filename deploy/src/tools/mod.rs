//! Commands for people: status, flights, checks, certificates, configurations, calibration.

pub mod calibrate;
pub mod check;
pub mod command;
pub mod config;
pub mod estimate;
pub mod flights;
pub mod keys;
pub mod playback;
pub mod replay;
pub mod status;
pub mod tag;
mod vessel_sources;
pub mod vessel_status;
pub mod view;
mod view_vessel;
