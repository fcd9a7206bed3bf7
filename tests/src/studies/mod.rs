//! Measurements over many seeds, other than landing trials.

pub mod aborts;
pub mod estimator;
pub mod fleet;
pub mod forecasts;
pub mod paired;
pub mod prediction;
pub mod splitting;
pub mod statistics;
