//! Observation and alteration of a process's messages by a test bench. A process that flies sets none.

use std::sync::{Mutex, PoisonError};

use crate::Received;

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
