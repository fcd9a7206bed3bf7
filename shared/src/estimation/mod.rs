//! Estimation: Kalman filter, low-pass filter, statistics of samples.

mod kalman;
mod low_pass;
mod statistics;

pub use kalman::{Gaussian, LinearTransition, Update, symmetrise};
pub use low_pass::{low_pass, low_pass_gain};
pub use statistics::{ValueWithSd, median, moments, quantile};
