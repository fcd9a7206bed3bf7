//! Parts of the truth that the drone's forecasts have.

use alight_shared::config;
use serde::{Deserialize, Serialize};

/// A part of a forecast.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TruePart {
    /// The motion from now on, about the deck as the drone takes it to be now.
    #[default]
    Motion,
    /// The state now; the motion from there is predicted.
    State,
    Whole,
    /// The motion of the next half second.
    Contact,
}

/// A degree of freedom of the deck.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Dof {
    /// Along the vessel.
    Surge,
    /// To starboard.
    Sway,
    /// Down.
    Heave,
    /// About the vessel's length.
    Roll,
    /// About her beam.
    Pitch,
    /// About down.
    Yaw,
}

config! {
    /// Parts of the truth that the drone's forecasts have, for an error budget.
    pub struct ForesightConfig {
        /// The part that is true: "motion" from now on, "state" now, "whole" (both), or "contact" (the motion of the next
        /// half second).
        pub part: TruePart = TruePart::Motion;
        /// The degrees of freedom of which it is; empty: all.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub dofs: Vec<Dof> = Vec::new();
    }
}
