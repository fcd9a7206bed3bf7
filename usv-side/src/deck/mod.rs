//! The deck arbiter and the operator relay: the vessel's nodes that exchange messages with drones.

pub mod arbiter;
pub mod checkpoint;
pub mod operator;

pub use arbiter::{ArbiterIn, ArbiterOut, DeckArbiter, DeckConfig, DeckInputs};
pub use checkpoint::{Claim, Closure, DeckCheckpoint, DeckOrder, DroneClaim, PendingAbort, VoidCommand};
pub use operator::{OperatorIn, OperatorOut, OperatorRelay};

/// Most drones that a vessel keeps apart; further ones get neither deck nor commands.
pub const MAX_DRONES: usize = 64;
