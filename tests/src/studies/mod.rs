//! Measurements over many seeds that are not landings.

pub mod aborts;
pub mod camera;
pub mod estimator;
pub mod false_detections;
pub mod fleet;
pub mod paired;
pub mod prediction;
pub mod rao;
pub mod splitting;
pub mod statistics;
pub mod uvdar;
