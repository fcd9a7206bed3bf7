//! Processes: the loop around a row and its edge (wait, step, publish, record, report at 2 Hz, end on request), and
//! the supervisor that starts and restarts them.

pub mod args;
pub mod checkpoints;
pub mod facts;
pub mod flight;
pub mod instance;
pub mod journal;
pub mod lateness;
pub mod life;
pub mod local_command;
pub mod metrics;
pub mod notify;
pub mod observer;
pub mod radio_port;
pub mod radio_rates;
pub mod run;
pub mod scheduling;
pub mod sealed;
pub mod service;
pub mod snapshot;
pub mod start;
pub mod supervision;
pub mod supervisor;
mod tables;
