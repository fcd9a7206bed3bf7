//! Checkpoint of the deck for a restart of the vessel's process or computer: owner, closure, and operator commands.

use alight_shared::{
    admission::Sender,
    msg::{Closure, OperatorCommand},
    time::VesselClock,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, JsonSchema, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Claim {
    #[default]
    Away,
    /// Above the deck, but not steady: the drone keeps the deck, but does not request it.
    Above,
    /// On its way, waiting, or steady above the deck.
    Requesting,
    Landing,
    OnDeck,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
pub struct DroneClaim {
    pub drone: u32,
    pub boot: u32,
    pub claim: Claim,
    pub place: Option<usize>,
    /// The drone was in the space reserved for the owner.
    pub inside: bool,
}

#[derive(Clone, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
pub struct DeckCheckpoint {
    pub owner: Option<u32>,
    /// Reason why the deck is closed; None: it is open.
    pub closed: Option<Closure>,
    /// The owner, and every drone that lands, stands or waits at the deck.
    pub claims: Vec<DroneClaim>,
}

impl DeckCheckpoint {
    /// Checkpoint in place of a missing or unreadable one: no drone is known, so the deck is closed.
    pub fn unknown(closure: Closure) -> DeckCheckpoint {
        DeckCheckpoint {
            closed: Some(closure),
            ..DeckCheckpoint::default()
        }
    }
}

/// Operator command known to the vessel, with its original time.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
pub struct GivenCommand {
    pub operator: Sender,
    /// Command with boot and sequence of the operator's message; its repetitions are rejected.
    pub command: OperatorCommand<VesselClock>,
    /// The command is still repeated: it is not yet acknowledged, replaced, given up, or cancelled by an abort.
    pub open: bool,
}
