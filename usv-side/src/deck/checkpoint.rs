//! The deck's checkpoint, for a restart of the vessel's process or computer: its owner, whether it is closed, and the
//! operators' commands.

use alight_shared::msg::OperatorCommand;
use alight_shared::time::VesselClock;
use serde::{Deserialize, Serialize};

/// The crew's order about the deck, or about the vessel's course under a drone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DeckOrder {
    /// Nobody descends.
    Closed,
    /// Nothing lies on it: it is free but for drones that report from it now, or may be on their way down unheard.
    Open,
    /// The same, and this drone is neither there nor above it.
    Clear(u32),
    /// Course and speed are kept for so many seconds; 0: nothing is stated any more.
    Steady(u32),
    /// The vessel turns or may turn, until another order about her course.
    Turning,
}

/// Why the deck is closed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Closure {
    /// The crew closed it.
    Crew,
    /// Its checkpoint is damaged: who stands on it is not known.
    #[serde(alias = "memory_damaged")]
    CheckpointDamaged,
    /// The crew's switch is closed, or cannot be read.
    Switch,
    /// By its sensor something lies on it that is no drone, or the sensor cannot be read.
    Sensor,
    /// There is no checkpoint: who stands on it is not known.
    CheckpointMissing,
    /// Its checkpoint cannot be written, so that what was found may be older than what happened.
    CheckpointUnwritable,
}

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
