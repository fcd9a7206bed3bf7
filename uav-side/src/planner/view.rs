//! Inputs of a planner's references.

use alight_shared::msg::{DeckForecast, MissionState};

#[derive(Clone, Debug, PartialEq)]
pub struct View {
    pub mission: MissionState,
    pub forecast: Option<DeckForecast>,
}
