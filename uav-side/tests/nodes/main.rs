//! Tests of the drone's nodes through their public interface, in one program that is built and linked once.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod camera;
mod predictor;
