//! Estimation: Kalman filter.

mod kalman;
mod statistics;

pub use kalman::{Gaussian, Transition, Update, symmetrise};
pub use statistics::{ValueWithSd, median, moments};
