//! View: inputs of a planner's references.

use alight_shared::msg::{DeckForecast, MissionState};

/// Permission and deck that the references are made for.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// State of the mission, with what it permits.
    pub mission: MissionState,
    /// The predicted deck.
    pub forecast: Option<DeckForecast>,
}
