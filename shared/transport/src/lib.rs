//! The two transports: [`memory`] between the processes of one
//! computer (iceoryx2), [`radio`] between the computers (zenoh). Nothing outside this crate knows
//! either middleware.
//!
//! Read in this order: [`clock`], [`memory`], [`images`], [`wake`], [`radio`].

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

/// A message that came over the radio.
#[derive(Clone, Debug)]
pub struct Received {
    /// Index of its subscription.
    pub subscription: usize,
    /// Who published it, by its key.
    pub sender: Sender,
    /// The steady clock at its arrival, ns.
    pub at_ns: i64,
    pub bytes: Vec<u8>,
}

/// What a transport could not do.
#[derive(Debug, Error)]
#[error("{doing}: {what}")]
pub struct TransportError {
    /// What was being done.
    pub doing: String,
    /// Error of the middleware.
    pub what: String,
}

impl TransportError {
    /// Wraps a middleware's error with what was being done.
    pub fn because(doing: impl Into<String>, error: impl core::fmt::Debug) -> Self {
        TransportError {
            doing: doing.into(),
            what: format!("{error:?}"),
        }
    }
}

/// Says what was being done when a middleware failed.
pub(crate) trait TransportContext<T> {
    /// The error with what was being done.
    fn doing(self, what: impl FnOnce() -> String) -> Result<T, TransportError>;
}
impl<T, E: core::fmt::Debug> TransportContext<T> for Result<T, E> {
    fn doing(self, what: impl FnOnce() -> String) -> Result<T, TransportError> {
        self.map_err(|e| TransportError::because(what(), e))
    }
}
