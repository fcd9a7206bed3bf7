//! Plug-ins of the program, which no landing uses and only the command line names. Each is a feature.

#[cfg(feature = "calibrate")]
pub mod calibrate;
#[cfg(feature = "ros2")]
pub mod ros2;
#[cfg(feature = "signalk")]
pub mod signalk;
