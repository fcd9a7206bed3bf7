//! Blocking wait for messages: an iceoryx2 wait set over listeners.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use iceoryx2::prelude::*;
use iceoryx2::waitset::WaitSetRunResult;
use iceoryx2_bb_posix::signal::SignalHandler;
use signal_hook::consts::{SIGINT, SIGTERM};

use crate::clock::steady_ns;
use crate::instance::Ipc;
use crate::memory::{Instance, Listener, Memory};
use crate::{Doing, TransportError};
use alight_shared::plain::Plain;

/// Set by SIGTERM or SIGINT, for good. iceoryx2 keeps the newest signal alone and forgets it when it is looked at, and
/// systemd sends SIGCONT right after SIGTERM.
static END: LazyLock<Arc<AtomicBool>> = LazyLock::new(|| {
    // Installs iceoryx2's handlers first, which those registered here then call.
    let asked = SignalHandler::termination_requested();
    let end = Arc::new(AtomicBool::new(asked));
    for signal in [SIGTERM, SIGINT] {
        // It fails for signals alone that no program may catch.
        let _registered = signal_hook::flag::register(signal, Arc::clone(&end));
    }
    end
});

/// Whether the process was asked to end (SIGTERM or SIGINT), now or at any time since the first call.
pub fn end_requested() -> bool {
    END.load(Ordering::Relaxed)
}

/// Calls `step` whenever one of `listeners` was woken, and at the latest `timeout` after the last
/// time, as long as `step` says so and until the process is asked to end.
pub fn run(
    listeners: &[&Listener],
    timeout: Duration,
    mut step: impl FnMut() -> bool,
) -> Result<(), TransportError> {
    let doing = || "waiting for messages".to_owned();
    let _watched = end_requested();
    let waits = WaitSetBuilder::new().create::<Ipc>().doing(doing)?;
    let mut guards = Vec::with_capacity(listeners.len());
    for listener in listeners {
        guards.push(waits.attach_notification(&listener.port).doing(doing)?);
    }
    loop {
        match waits
            .wait_and_process_once_with_timeout(|_| CallbackProgression::Continue, timeout)
            .doing(doing)?
        {
            WaitSetRunResult::TerminationRequest => return Ok(()),
            // Any signal ends the wait, not only one that means the end.
            WaitSetRunResult::Interrupt if end_requested() => return Ok(()),
            _ => {}
        }
        for listener in listeners {
            listener.drain();
        }
        if !step() {
            return Ok(());
        }
    }
}

/// Joins the instance as `name` and calls `each` with the messages of one topic as they come, at the latest
/// `timeout` after the last time, as long as `each` says so.
pub fn follow<T: Plain>(
    instance: &Instance,
    name: &str,
    timeout: Duration,
    mut each: impl FnMut(Vec<T>) -> bool,
) -> Result<(), TransportError> {
    let memory = Memory::join(instance, name)?;
    let mut subscriber = memory.subscriber::<T>()?;
    let listener = memory.listener::<T>()?;
    run(&[&listener], timeout, || each(subscriber.all(steady_ns())))
}
