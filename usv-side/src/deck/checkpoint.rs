//! The deck's checkpoint, for a restart of the vessel's process or computer: its owner, whether it is closed, and the
//! operators' commands.

use alight_shared::admission::Sender;
use alight_shared::msg::{Closure, OperatorCommand};
use alight_shared::time::VesselClock;
use serde::{Deserialize, Serialize};

/// Relation of a drone to the deck.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Claim {
    #[default]
    Away,
    /// Above it, not stably: keeps it, does not request it.
    Above,
    /// On its way there, waits for it, or is stably above it.
    Requesting,
    /// In descent or flare.
    Landing,
    /// Stands on it.
    OnDeck,
}

/// A drone that has to do with the deck.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DroneClaim {
    /// Number of the drone.
    pub drone: u32,
    /// The boot id of its newest status.
    pub boot: u32,
    /// Relation of the drone to the deck.
    pub claim: Claim,
    /// Waiting place of the drone.
    pub place: Option<usize>,
    /// It was where only the deck's owner may be.
    pub inside: bool,
}

/// The arbiter's checkpoint.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeckCheckpoint {
    /// The drone that owns the deck.
    pub owner: Option<u32>,
    /// Why the deck is closed, if it is.
    pub closed: Option<Closure>,
    /// The owner, and every drone that lands, stands or waits there.
    pub claims: Vec<DroneClaim>,
}

impl DeckCheckpoint {
    /// Replaces a checkpoint that is missing or cannot be read: no drone is known, so the deck is closed.
    pub fn unknown(closure: Closure) -> DeckCheckpoint {
        DeckCheckpoint {
            closed: Some(closure),
            ..DeckCheckpoint::default()
        }
    }
}

/// An operator's command that the vessel knows, with the time at which it was given.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GivenCommand {
    /// Who gave it.
    pub operator: Sender,
    /// The command: boot and sequence are those of the operator's message, whose repetitions do not count.
    pub command: OperatorCommand<VesselClock>,
    /// It is repeated to its drone: neither acknowledged nor replaced, given up or made void by an abort.
    pub open: bool,
}
