//! Estimation: Kalman filter, low-pass filter, offset of clocks, statistics of samples.

mod clock_offset;
mod kalman;
mod low_pass;
mod statistics;

pub use clock_offset::OffsetBounds;
pub use kalman::{Gaussian, LinearTransition, Update, reduce_covariance, symmetrise};
pub use low_pass::{low_pass, low_pass_gain};
pub use statistics::{ValueWithSd, median, moments, quantile};
