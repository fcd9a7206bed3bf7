//! Observation and alteration of a process's messages by a test bench. A process that flies sets none.

use std::sync::{Mutex, OnceLock, PoisonError};

use crate::transport::Received;

/// Stands around the sends of a process.
pub trait SendObserver: Send + Sync {
    /// Calls `send` once. `name` is the topic's or the radio key's, `order` the message's boot and sequence
    /// number where it has them, `bytes` the message encoded.
    fn around(
        &self,
        name: &str,
        order: Option<(u32, u32)>,
        bytes: &dyn Fn() -> Option<Vec<u8>>,
        send: &mut dyn FnMut(),
    );
}

static OBSERVER: OnceLock<Box<dyn SendObserver>> = OnceLock::new();

/// Sets the observer of this process, before it makes publishers or a radio; false when there is one already.
pub fn observe(observer: Box<dyn SendObserver>) -> bool {
    OBSERVER.set(observer).is_ok()
}

pub(super) fn observer() -> Option<&'static dyn SendObserver> {
    OBSERVER.get().map(Box::as_ref)
}

/// Stands between the radio and a process.
pub trait ReceiveChannel: Send {
    /// A packet came.
    fn take(&mut self, packet: Received);
    /// The next packet that the process may read by `now_ns` of the steady clock.
    fn ready(&mut self, now_ns: i64) -> Option<Received>;
}

static CHANNEL: Mutex<Option<Box<dyn ReceiveChannel>>> = Mutex::new(None);

/// Sets the channel of the radio that this process opens next.
pub fn receive_through(channel: Box<dyn ReceiveChannel>) {
    *CHANNEL.lock().unwrap_or_else(PoisonError::into_inner) = Some(channel);
}

pub(super) fn receive_channel() -> Option<Box<dyn ReceiveChannel>> {
    CHANNEL.lock().unwrap_or_else(PoisonError::into_inner).take()
}
