//! Deck arbiter, operator relay, and the monitor of drone reports.

pub mod arbiter;
pub mod checkpoint;
pub mod config;
pub mod inputs;
pub mod monitor;
pub mod operator;
mod stated_course;

pub use arbiter::{ArbiterIn, ArbiterOut, DeckArbiter, clearance::ClearanceEnd};
pub use checkpoint::{Claim, DeckCheckpoint, DroneClaim, GivenCommand};
pub use config::DeckConfig;
pub use inputs::DeckInputs;
pub use monitor::DroneMonitor;
pub use operator::{OperatorIn, OperatorOut, OperatorRelay};

/// Maximum number of drones that a vessel tracks; further ones get neither deck nor commands.
pub const MAX_DRONES: usize = 64;
