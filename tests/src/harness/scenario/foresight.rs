use alight_shared::config;
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TruePart {
    /// Future motion; the current state is estimated.
    #[default]
    Motion,
    /// Current state; the motion after it is predicted.
    State,
    Whole,
    /// Motion of the next half second.
    Contact,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Dof {
    Surge,
    Sway,
    Heave,
    Roll,
    Pitch,
    Yaw,
}

config! {
    /// Parts of the drone's forecasts that are replaced by the truth, for an error budget.
    pub struct ForesightConfig {
        /// True part: "motion" from now on, the current "state", "whole" (both), or "contact" (motion of the
        /// next half second).
        pub part: TruePart = TruePart::Motion;
        /// True degrees of freedom; empty: all.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub dofs: Vec<Dof> = Vec::new();
    }
}
