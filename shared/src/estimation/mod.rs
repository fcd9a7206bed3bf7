//! Estimation: the Kalman filter that the vessel model rests on.

mod kalman;

pub use kalman::{Gaussian, Transition, Update, symmetrise};
