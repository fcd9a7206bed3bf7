//! The drone's nodes from outside, one file a node, one program: it is built and linked once.

// Helpers of tests may panic, as tests do.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod camera;
mod predictor;
