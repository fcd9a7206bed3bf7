//! The two transports, behind the feature `transport`: [`memory`] between the processes of one
//! computer (iceoryx2), [`radio`] between the computers (zenoh). Nothing outside this module knows
//! either middleware, and nothing else of Alight holds `unsafe` code.
//!
//! Read in this order: [`clock`], [`plain`] (what may lie in shared memory, and on which topic),
//! [`memory`], [`images`], [`wake`], [`process`] (what a process publishes about itself), [`radio`].

pub mod access;
pub mod clock;
pub mod images;
mod instance;
pub mod memory;
pub mod metrics;
pub mod observe;
pub mod plain;
pub mod process;
pub mod radio;
pub mod readiness;
pub mod rejections;
pub mod statistics;
pub mod wake;

use thiserror::Error;

use crate::admission::Sender;

/// A message that came over the radio.
#[derive(Clone, Debug)]
pub struct Received {
    /// Index of its subscription.
    pub subscription: usize,
    /// Who published it, by its key.
    pub sender: Sender,
    /// The steady clock at its arrival, ns.
    pub at_ns: i64,
    /// Its content.
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
pub(crate) trait Doing<T> {
    /// The error with what was being done.
    fn doing(self, what: impl FnOnce() -> String) -> Result<T, TransportError>;
}
impl<T, E: core::fmt::Debug> Doing<T> for Result<T, E> {
    fn doing(self, what: impl FnOnce() -> String) -> Result<T, TransportError> {
        self.map_err(|e| TransportError::because(what(), e))
    }
}
