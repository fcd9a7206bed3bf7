//! The deck's checkpoint, for a restart of the vessel's process or computer: its owner, whether it is closed, and the
//! operators' commands.

use alight_shared::msg::{Closure, OperatorCommand};
use alight_shared::time::VesselClock;
use serde::{Deserialize, Serialize};

/// What a drone has to do with the deck.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Claim {
    /// Nothing.
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
    /// Its number.
    pub drone: u32,
    /// The boot id of its newest status.
    pub boot: u32,
    /// What it has to do with the deck.
    pub claim: Claim,
    /// Its waiting place.
    pub place: Option<usize>,
    /// It was where nobody but the deck's owner may be.
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
    /// In the place of one that is missing or cannot be read: nobody is known, so the deck is closed.
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
    /// The command: boot and sequence are those of the operator's message, whose repetitions do not count.
    pub command: OperatorCommand<VesselClock>,
    /// It is repeated to its drone: neither acknowledged nor replaced, given up or made void by an abort.
    pub open: bool,
}
