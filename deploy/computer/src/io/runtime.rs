//! Tokio runtime of a process that awaits bytes.

use std::future::Future;

use tokio::runtime::Builder;

use crate::exit::{CliError, Doing};

/// Runs `task` to its end in this thread; next to it there is at most one that looks up names.
pub fn block_on<T>(task: impl Future<Output = Result<T, CliError>>) -> Result<T, CliError> {
    run(&mut Builder::new_current_thread(), task)
}

/// Runtime of a process with a radio: zenoh's calls may wait, which it rejects inside a runtime of one thread.
pub fn block_on_with_radio<T>(task: impl Future<Output = Result<T, CliError>>) -> Result<T, CliError> {
    run(Builder::new_multi_thread().worker_threads(1), task)
}

fn run<T>(builder: &mut Builder, task: impl Future<Output = Result<T, CliError>>) -> Result<T, CliError> {
    let runtime = builder.enable_all().max_blocking_threads(1).build();
    runtime.doing("starting to wait for bytes")?.block_on(task)
}
