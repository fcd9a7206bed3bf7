//! Parts of the drone's forecasts that are replaced by the truth.

use alight_shared::config;
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TruePart {
    /// The motion from now on, relative to the estimated present state.
    #[default]
    Motion,
    /// The present state; the motion after it is predicted.
    State,
    Whole,
    /// The motion of the next half second.
    Contact,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Dof {
    /// Along the vessel's length.
    Surge,
    /// To starboard.
    Sway,
    /// Down.
    Heave,
    /// About the longitudinal axis.
    Roll,
    /// About the transverse axis.
    Pitch,
    /// About the down axis.
    Yaw,
}

config! {
    /// Parts of the drone's forecasts that are replaced by the truth, for an error budget.
    pub struct ForesightConfig {
        /// The part that is true: "motion" from now on, "state" now, "whole" (both), or "contact" (the motion of the
        /// next half second).
        pub part: TruePart = TruePart::Motion;
        /// Degrees of freedom to which the truth applies; empty: all.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub dofs: Vec<Dof> = Vec::new();
    }
}
