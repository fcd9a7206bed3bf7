//! Commands for people: flights, checks, certificates, configurations, calibration.

pub mod calibrate;
pub mod check;
pub mod command;
pub mod config;
pub mod estimate;
pub mod flights;
pub mod init;
pub mod keys;
pub mod replay;
pub mod ros2;
pub mod schema;
pub mod signalk;
pub mod tag;
pub mod view;
mod view_vessel;
