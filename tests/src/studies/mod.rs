//! Measurements over many seeds that are not landings.

pub mod airborne;
pub mod estimator;
pub mod prediction;
