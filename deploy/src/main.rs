//! `alight`: landings of a multirotor on a moving, rocking deck.
//!
//! What a vessel and a drone install, in layers, each of which uses only those before it: [`exit`] and
//! [`terminal`]; [`config`]; [`certificates`] and [`io`]; [`record`]; [`process`], [`vessel`] and [`drone`];
//! [`status`]; [`view`], [`ros2`] and [`signalk`]; [`tools`]. [`lab`] is simulation and experiments, and is no part of the packages; [`cli`] names every command.

// Some of what only the laboratory uses is unused without it.
#![cfg_attr(not(feature = "lab"), allow(dead_code))]

mod certificates;
mod cli;
mod config;
mod drone;
mod exit;
mod io;
#[cfg(feature = "lab")]
mod lab;
mod process;
mod record;
mod ros2;
mod signalk;
mod status;
mod table;
mod terminal;
mod tools;
mod vessel;
mod view;

use std::process::ExitCode;

use exit::Exit;

fn main() -> ExitCode {
    let lines = process::journal::init();
    let result = cli::Cli::read().command.run();
    // What was reported before comes before the error.
    drop(lines);
    match result {
        Ok(Exit::Success) => ExitCode::SUCCESS,
        Ok(Exit::Failed) => ExitCode::from(1),
        Ok(Exit::Broken) => ExitCode::from(2),
        Ok(Exit::TooSlow) => ExitCode::from(3),
        Err(error) => {
            terminal::note(true, format_args!("alight: {error}"));
            ExitCode::from(2)
        }
    }
}
