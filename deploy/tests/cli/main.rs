//! Command line of the program, and its external inputs.

// Helpers of tests may panic, as tests do.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod book;
mod commands;
mod estimate;
mod fuzz;
mod program;
mod record;
mod shipped;
mod unread_keys;
