//! Plug-ins of the program. No landing uses them; only the command line refers to them. Each is a feature.

#[cfg(feature = "calibrate")]
pub mod calibrate;
#[cfg(feature = "ros2")]
pub mod ros2;
#[cfg(feature = "signalk")]
pub mod signalk;
