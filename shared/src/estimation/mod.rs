//! Estimation: the Kalman filter that the vessel model rests on.

mod kalman;
mod statistics;

pub use kalman::{Gaussian, Transition, Update, symmetrise};
pub use statistics::{ValueWithSd, median, moments};
