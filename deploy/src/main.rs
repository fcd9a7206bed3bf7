//! `alight`: lands a multirotor on a moving, rocking deck.

// Some of what the live landing shares with the processes is unused without it.
#![cfg_attr(not(all(feature = "sim", feature = "live")), allow(dead_code))]

#[cfg(feature = "sim")]
mod args;
mod cli;
mod configs;
#[cfg(feature = "flight")]
mod estimate;
#[cfg(feature = "flight")]
mod live;
#[cfg(feature = "sim")]
mod plot;
#[cfg(feature = "record")]
mod record;
#[cfg(feature = "sim")]
mod scene;
#[cfg(feature = "sim")]
mod study;
#[cfg(feature = "sim")]
mod table;
mod terminal;
#[cfg(feature = "sim")]
mod trial;
#[cfg(feature = "sim")]
mod trials;

use std::fmt;
use std::process::ExitCode;

use clap::Parser;

use cli::{Cli, Verb};

/// How a command ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// Exit code 0.
    Success,
    /// Exit code 1: it ran, and the landing (or one of them) failed.
    Failed,
    /// Exit code 2: a check found something that does not work.
    Broken,
}

/// Bad input or an output that cannot be written: exit code 2, the message says what to do.
#[derive(Debug)]
pub struct CliError(pub String);

impl fmt::Display for CliError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0)
    }
}

impl CliError {
    /// Wraps any error with what was being done.
    pub fn because(doing: impl fmt::Display, error: impl fmt::Display) -> Self {
        CliError(format!("{doing}: {error}"))
    }
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let end = match &cli.command {
        #[cfg(feature = "sim")]
        Verb::Trial(a) => trial::run(a),
        #[cfg(feature = "sim")]
        Verb::Trials(a) => trials::run(a),
        #[cfg(feature = "sim")]
        Verb::Study(a) => study::run(a),
        #[cfg(all(feature = "record", feature = "live"))]
        Verb::Replay(a) if live::replay::takes(&a.path) => live::replay::run(&a.path),
        #[cfg(feature = "record")]
        Verb::Replay(a) => record::replay::run(a),
        #[cfg(feature = "sim")]
        Verb::Response(a) => study::response(a),
        Verb::Config(a) => configs::print(a),
        #[cfg(feature = "flight")]
        Verb::Estimate(a) => estimate::run(a),
        #[cfg(feature = "flight")]
        Verb::Live(verb) => live::run(verb),
    };
    match end {
        Ok(Exit::Success) => ExitCode::SUCCESS,
        Ok(Exit::Failed) => ExitCode::from(1),
        Ok(Exit::Broken) => ExitCode::from(2),
        Err(refused) => {
            eprintln!("alight: {refused}");
            ExitCode::from(2)
        }
    }
}
