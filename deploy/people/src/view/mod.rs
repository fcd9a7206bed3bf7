//! Views of a landing in progress: a page for a browser and Foxglove, served by a single-threaded runtime.
//!
//! A [`view_observer`] receives the nodes' outputs, from shared memory ([`memory_observer`]) or from a simulation,
//! keeps them on a [`board`], and gives the [`server`] a [`picture`] of it several times a second. No flight waits
//! for a viewer.

pub mod board;
pub mod camera;
pub mod camera_image;
mod guard;
mod live_sink;
pub mod memory_observer;
pub mod motion;
pub mod picture;
pub mod scene;
pub mod server;
mod track;
pub mod view_observer;
