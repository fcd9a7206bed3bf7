//! Commands for people: what runs, what is wrong, certificates, configurations, calibration.

pub mod calibrate;
pub mod check;
pub mod command;
pub mod config;
pub mod estimate;
pub mod keys;
pub mod replay;
pub mod status;
pub mod vessel_status;
pub mod view;
mod view_vessel;
