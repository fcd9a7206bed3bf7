//! Plug-ins of the program: no part of a landing, and named by nothing but the command line. Each is a feature.

#[cfg(feature = "calibrate")]
pub mod calibrate;
#[cfg(feature = "ros2")]
pub mod ros2;
#[cfg(feature = "signalk")]
pub mod signalk;
