//! Requests of the drones to the vessel's helm: found by the deck arbiter, answered by the helm.

use serde::{Deserialize, Serialize};

/// Request of the drones to the helm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Demand {
    /// Nothing.
    #[default]
    Nothing,
    /// One stands on the deck.
    Stands,
    /// One comes for the deck, or waits on it for its take-off.
    Comes,
    /// One is on its way down, or takes off.
    Descends,
}
