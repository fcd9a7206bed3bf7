//! Blocking wait for messages: an iceoryx2 wait set over listeners.

use std::time::Duration;

use iceoryx2::prelude::*;

pub use crate::signal::end_requested;
use crate::{
    TransportContext, TransportError,
    clock::steady_ns,
    instance::Ipc,
    memory::{Instance, Listener, Memory},
};
use alight_shared::plain::Plain;

/// Calls `step` when one of `listeners` wakes, and at least every `timeout`, until it returns false or the
/// process is asked to end.
pub fn run(
    listeners: &[&Listener],
    timeout: Duration,
    mut step: impl FnMut() -> bool,
) -> Result<(), TransportError> {
    let doing = || "waiting for messages".to_owned();
    let _watched = end_requested();
    let waits = WaitSetBuilder::new()
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<Ipc>()
        .doing(doing)?;
    let mut guards = Vec::with_capacity(listeners.len());
    for listener in listeners {
        guards.push(waits.attach_notification(&listener.port).doing(doing)?);
    }
    loop {
        waits
            .wait_and_process_once_with_timeout(|_| CallbackProgression::Continue, timeout)
            .doing(doing)?;
        if end_requested() {
            return Ok(());
        }
        for listener in listeners {
            listener.drain();
        }
        if !step() {
            return Ok(());
        }
    }
}

/// Joins the instance as `name` and calls `each` with new messages of a topic, at least every `timeout`,
/// until it returns false.
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
