//! The program's processes on real sockets and shared memory. No test asserts a time; timeouts only end hanging
//! tests.

// Tests of processes have to wait for them, and fail when one misbehaves.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic
)]

mod access;
mod buses;
mod cameras;
mod common;
mod faults;
mod firmware;
mod ground;
mod hostile;
mod installed;
mod landing;
mod link;
mod radio;
mod real_firmware;
mod recorder;
mod rehearse;
mod ros2;
mod sensors;
mod signalk;
mod survival;
mod view;
mod wire;
