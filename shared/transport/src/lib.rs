//! Transports [`memory`] (iceoryx2) between processes of one computer, and [`radio`] (zenoh) between
//! computers. Of the other crates only `alight-computer` uses either: iceoryx2's POSIX layer, for scheduling.
//!
//! Suggested reading order: [`clock`], [`memory`], [`images`], [`wake`], [`radio`].

pub mod access;
pub mod clock;
pub mod images;
mod instance;
pub mod memory;
pub mod observe;
pub mod radio;
pub mod readiness;
pub mod rejections;
pub mod signal;
pub mod statistics;
pub mod wake;
pub mod warnings;

use thiserror::Error;

use alight_shared::admission::Sender;

#[derive(Clone, Debug)]
pub struct Received {
    /// Index of the subscription that received the message.
    pub subscription: usize,
    /// Publisher according to the message's key.
    pub sender: Sender,
    /// Steady clock at the arrival, ns.
    pub at_ns: i64,
    pub bytes: Vec<u8>,
}

#[derive(Debug, Error)]
#[error("{doing}: {what}")]
pub struct TransportError {
    pub doing: String,
    pub what: String,
}

impl TransportError {
    /// Wraps a middleware error with the failed operation.
    pub fn because(doing: impl Into<String>, error: impl core::fmt::Debug) -> Self {
        TransportError {
            doing: doing.into(),
            what: format!("{error:?}"),
        }
    }
}

/// Adds the failed operation to a middleware error.
pub(crate) trait TransportContext<T> {
    fn doing(self, what: impl FnOnce() -> String) -> Result<T, TransportError>;
}
impl<T, E: core::fmt::Debug> TransportContext<T> for Result<T, E> {
    fn doing(self, what: impl FnOnce() -> String) -> Result<T, TransportError> {
        self.map_err(|e| TransportError::because(what(), e))
    }
}
