use std::future::Future;

use tokio::runtime::Builder;

use crate::exit::{CliError, Doing};

/// Runs `task` to completion on this thread; at most one more thread looks up names.
pub fn block_on<T>(task: impl Future<Output = Result<T, CliError>>) -> Result<T, CliError> {
    run(&mut Builder::new_current_thread(), task)
}

/// Runs `task` of a process with a radio on this thread, with a spare worker thread, because Zenoh's blocking calls
/// panic in a single-threaded runtime (zenoh-runtime 1.10.2, `src/lib.rs:148`). Zenoh also makes such calls when the
/// last handle of a session is dropped (zenoh 1.10.2, `src/api/session.rs:794`) or its links are listed
/// (`src/net/runtime/mod.rs:543`). Awaiting does not avoid them: except for opening and closing, the awaited future
/// is `ready(self.wait())` (such as `src/api/builders/publisher.rs:511`).
pub fn block_on_with_radio<T>(task: impl Future<Output = Result<T, CliError>>) -> Result<T, CliError> {
    run(Builder::new_multi_thread().worker_threads(1), task)
}

fn run<T>(builder: &mut Builder, task: impl Future<Output = Result<T, CliError>>) -> Result<T, CliError> {
    let runtime = builder.enable_all().max_blocking_threads(1).build();
    runtime.doing("starting to wait for bytes")?.block_on(task)
}
