//! Plug-ins of the program, each a feature. Only the command line refers to them; no landing uses them.

#[cfg(feature = "calibrate")]
pub mod calibrate;
#[cfg(feature = "ros2")]
pub mod ros2;
#[cfg(feature = "signalk")]
pub mod signalk;
