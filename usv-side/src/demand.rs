//! What the drones want of the vessel's helm: found by the deck arbiter, answered by the helm.

use serde::{Deserialize, Serialize};

/// What the drones want of the helm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Demand {
    /// Nothing.
    #[default]
    Nothing,
    /// One stands on the deck, motors off.
    Stands,
    /// One stands on the deck, armed: after its landing, or before its take-off.
    Armed,
    /// One comes for the deck.
    Comes,
    /// One is on its way down.
    Descends,
}
