//! Interfaces for people: [`explain`]; [`status`]; [`view`], [`ros2`] and [`signalk`]; [`tools`]. Each uses only those before it.

pub mod explain;
pub mod ros2;
pub mod signalk;
pub mod status;
pub mod tools;
pub mod view;
