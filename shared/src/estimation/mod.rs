//! Estimation: Kalman filter, measurement sources, low-pass filter, clock offsets, source clocks, statistics.

mod aid_source;
mod clock_offset;
mod kalman;
mod low_pass;
mod source_clock;
mod statistics;

pub use aid_source::AidSource;
pub use clock_offset::OffsetBounds;
pub use kalman::{Gaussian, LinearTransition, Update, reduce_covariance, symmetrise};
pub use low_pass::{low_pass, low_pass_gain};
pub use source_clock::{CLOCK_DRIFT, JITTER_S, Rollover, SourceClock};
pub use statistics::{ValueWithSd, median, moments, quantile};
