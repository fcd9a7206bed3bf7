//! Measurements over many seeds that are not landings.

pub mod airborne;
pub mod camera;
pub mod empty;
pub mod estimator;
pub mod prediction;
pub mod uvdar;
