//! `alight`: landings of a multirotor on a moving, rocking deck.
//!
//! The command line ([`cli`]) on four libraries: `alight-computer` (the processes of vessel and drone),
//! `alight-people` (user interfaces), `alight-plugins` (ROS 2, Signal K, calibration) and `alight-lab` (simulation
//! and experiments), which the packages omit.

mod cli;

use std::process::ExitCode;

use alight_computer::{exit::Exit, process, terminal};

fn main() -> ExitCode {
    let lines = process::journal::init();
    let result = cli::Cli::read().command.run();
    // Earlier reports must precede the error.
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
