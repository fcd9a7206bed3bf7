//! Views of a landing while it goes on: a page for a browser and Foxglove, served by a runtime of one thread.
//!
//! A [`watcher`] is shown the nodes' outputs, live out of shared memory ([`memory_feed`]) or by what computes them, keeps
//! it on a [`board`], and gives the [`server`] a [`picture`] of it some times a second. Nothing in a flight waits for a
//! viewer.

pub mod board;
pub mod camera;
pub mod camera_image;
mod guard;
mod live_sink;
pub mod memory_feed;
pub mod motion;
pub mod picture;
pub mod scene;
pub mod server;
mod track;
pub mod watcher;
