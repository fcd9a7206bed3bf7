//! Observation and alteration of received messages by a test bench; not used in flight.

use std::sync::{Mutex, PoisonError};

use crate::Received;

pub trait ReceiveChannel: Send {
    fn take(&mut self, packet: Received);
    /// Next packet that the process may read at `now_ns` on the steady clock.
    fn ready(&mut self, now_ns: i64) -> Option<Received>;
}

static CHANNEL: Mutex<Option<Box<dyn ReceiveChannel>>> = Mutex::new(None);

/// Sets the channel of the next radio that this process opens.
pub fn receive_through(channel: Box<dyn ReceiveChannel>) {
    *CHANNEL.lock().unwrap_or_else(PoisonError::into_inner) = Some(channel);
}

pub(super) fn receive_channel() -> Option<Box<dyn ReceiveChannel>> {
    CHANNEL.lock().unwrap_or_else(PoisonError::into_inner).take()
}
