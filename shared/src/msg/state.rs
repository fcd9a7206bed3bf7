//! States of the mission, and the phases that they belong to.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Reason;

/// States of the landing mission (Procházka et al., section IV).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum State {
    /// Waits for a landing command, flight and the vessel's state.
    #[default]
    Idle,
    /// Straight up or down to the approach height.
    GetAltitude,
    /// Towards the predicted vessel at approach height.
    Approach,
    /// Follows the predicted vessel at tracking height.
    Tracking,
    /// Tracking, stably above the deck.
    TrackingStable,
    /// Descends at constant speed relative to the predicted deck.
    Descent,
    /// The last part, with the full deck pose as reference.
    Flare,
    /// On the deck.
    Landed,
    /// Holds position at a safe height: data too old, or commanded.
    Hold,
    /// Ended without landing: aborted by command or out of retries.
    GaveUp,
    /// Looks for the tags of a vessel that is known by its beacon alone, in a pattern about the beacon's predicted place.
    Search,
    /// Stands on the deck and is to take off: waits until every check passes.
    Preparing,
    /// Stands on the deck; the motors start when the countdown ends.
    Countdown,
    /// Armed on the deck with little thrust: waits for the moment to leave it.
    SpinUp,
    /// Leaves the deck.
    TakeOff,
    /// Climbs away from the vessel.
    ClimbOut,
    /// A take-off was stopped before the feet left the deck: stands there until it is disarmed.
    StandDown,
}

/// Phases that choose weights and rates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum Phase {
    /// No planning.
    #[default]
    None,
    /// Far from the vessel.
    Navigation,
    /// Above the vessel.
    Follow,
    /// Descent and flare.
    Landing,
}

impl State {
    /// The phase that a state belongs to.
    pub const fn phase(self) -> Phase {
        match self {
            State::Idle
            | State::Landed
            | State::Preparing
            | State::Countdown
            | State::SpinUp
            | State::TakeOff
            | State::StandDown => Phase::None,
            State::GetAltitude
            | State::Approach
            | State::Search
            | State::Hold
            | State::GaveUp
            | State::ClimbOut => Phase::Navigation,
            State::Tracking | State::TrackingStable => Phase::Follow,
            State::Descent | State::Flare => Phase::Landing,
        }
    }
    /// The name in messages.
    pub const fn name(self) -> &'static str {
        match self {
            State::Idle => "Idle",
            State::GetAltitude => "Get altitude",
            State::Approach => "Approach",
            State::Tracking => "Tracking",
            State::TrackingStable => "Tracking stable",
            State::Descent => "Descent",
            State::Flare => "Flare",
            State::Landed => "Landed",
            State::Hold => "Hold",
            State::GaveUp => "Gave up",
            State::Search => "Search",
            State::Preparing => "Preparing",
            State::Countdown => "Countdown",
            State::SpinUp => "Spin up",
            State::TakeOff => "Take-off",
            State::ClimbOut => "Climb out",
            State::StandDown => "Stand down",
        }
    }
    /// Activity of the drone in this state, for messages.
    pub const fn does(self) -> &'static str {
        match self {
            State::Idle => "not landing: the autopilot or a pilot flies",
            State::GetAltitude => "climbs or sinks in place to the approach height",
            State::Approach => "flies to the predicted vessel at the approach height",
            State::Tracking => "follows the predicted deck at the tracking height",
            State::TrackingStable => "follows the predicted deck, steady above it",
            State::Descent => "descends to the predicted deck",
            State::Flare => "sets down with the deck's attitude",
            State::Landed => "stands on the deck",
            State::Hold => "holds its position at a safe height",
            State::GaveUp => "holds its position: the landing has ended without a touchdown",
            State::Search => "looks for the deck's tags around its beacon",
            State::Preparing => "stands on the deck and is checked before its take-off",
            State::Countdown => "stands on the deck: the motors start when the countdown ends",
            State::SpinUp => "armed on the deck, waits for the moment to take off",
            State::TakeOff => "leaves the deck",
            State::ClimbOut => "climbs away from the vessel",
            State::StandDown => "stands on the deck after a stopped take-off, to be disarmed",
        }
    }
    /// Ending of a landing that left the drone in this state, for messages; None: it goes on, or there was none.
    pub const fn ending(self) -> Option<&'static str> {
        match self {
            State::Landed => Some("landed"),
            State::GaveUp => Some("gave up"),
            State::Idle
            | State::GetAltitude
            | State::Approach
            | State::Search
            | State::Tracking
            | State::TrackingStable
            | State::Descent
            | State::Flare
            | State::Hold
            | State::Preparing
            | State::Countdown
            | State::SpinUp
            | State::TakeOff
            | State::ClimbOut
            | State::StandDown => None,
        }
    }
    /// A landing goes on in it.
    pub const fn is_landing(self) -> bool {
        !matches!(self, State::Idle | State::StandDown) && !self.is_take_off() && self.ending().is_none()
    }
    /// A take-off goes on in it.
    pub const fn is_take_off(self) -> bool {
        matches!(
            self,
            State::Preparing | State::Countdown | State::SpinUp | State::TakeOff | State::ClimbOut
        )
    }
    /// A drone that is to take off, or was to, stands on the deck in it.
    pub const fn stands_for_take_off(self) -> bool {
        matches!(
            self,
            State::Preparing | State::Countdown | State::SpinUp | State::StandDown
        )
    }
    /// Motors start in it, turn next to the crew, or have not stopped yet: whoever is near the drone has to get away from it.
    pub const fn starts_motors(self) -> bool {
        matches!(
            self,
            State::Countdown | State::SpinUp | State::TakeOff | State::StandDown
        )
    }
    /// Whether a take-off that was stopped on the deck leaves the drone here: motors that were started for it are to stop.
    pub const fn wants_motors_off(self) -> bool {
        matches!(
            self,
            State::Idle | State::Preparing | State::Countdown | State::StandDown
        )
    }
    /// The drone is on its way down to the deck, or on it after a landing.
    pub const fn meets_deck(self) -> bool {
        matches!(self, State::Descent | State::Flare | State::Landed)
    }
    /// The mission's plan was stopped or has ended otherwise than planned.
    pub const fn is_setback(self) -> bool {
        matches!(self, State::Hold | State::GaveUp | State::StandDown)
    }
    /// The state with why it was entered, for people: `Hold: operator's command`.
    pub fn because(self, entered: &Reason) -> String {
        let reason = entered.to_string();
        if reason.is_empty() {
            self.name().into()
        } else {
            format!("{}: {reason}", self.name())
        }
    }
}
