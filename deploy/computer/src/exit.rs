use std::fmt;

use alight_shared::config::ConfigError;
use alight_transport::TransportError;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    Success,
    /// Exit code 1: the command ran, and a landing failed.
    Failed,
    /// Exit code 2: a check found a fault.
    Broken,
    /// Exit code 3: this computer did not keep up with real time, so the result is invalid.
    TooSlow,
}

impl Exit {
    pub const fn of(success: bool) -> Exit {
        if success { Exit::Success } else { Exit::Failed }
    }
}

/// Bad input, or an output that cannot be written: exit code 2. The message names the remedy.
#[derive(Debug)]
pub struct CliError(pub String);

impl fmt::Display for CliError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0)
    }
}

impl CliError {
    pub fn because(doing: impl fmt::Display, error: impl fmt::Display) -> Self {
        CliError(format!("{doing}: {error}"))
    }
}

pub trait Doing<T> {
    fn doing(self, what: impl fmt::Display) -> Result<T, CliError>;
}

impl<T, E: fmt::Display> Doing<T> for Result<T, E> {
    fn doing(self, what: impl fmt::Display) -> Result<T, CliError> {
        self.map_err(|e| CliError::because(what, e))
    }
}

impl From<TransportError> for CliError {
    fn from(e: TransportError) -> Self {
        CliError(e.to_string())
    }
}

impl From<ConfigError> for CliError {
    fn from(e: ConfigError) -> Self {
        CliError(e.to_string())
    }
}
