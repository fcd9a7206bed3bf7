//! States of the mission and the flight phases they belong to.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Reason, ReasonCode};

/// States of the landing mission (Procházka et al., section IV).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum State {
    /// Waits for a landing command, for the drone to fly, and for the vessel's state.
    #[default]
    Idle,
    /// Climbs or descends vertically to approach height.
    GetAltitude,
    /// Flies towards the predicted vessel at approach height.
    Approach,
    /// Follows the predicted vessel at tracking height.
    Tracking,
    /// Tracking, steady above the deck.
    TrackingStable,
    /// Descends at constant speed relative to the predicted deck.
    Descent,
    /// Final descent, with the full deck pose as reference.
    Flare,
    /// Stands on the deck.
    Landed,
    /// Holds position at a safe height because of old data or by command.
    Hold,
    /// Landing ended without touchdown: aborted by command or out of retries.
    GaveUp,
    /// Searches for the tags of a vessel known by its beacon alone, in a pattern about its predicted position.
    Search,
    /// Stands on the deck before a take-off until every check passes.
    Preparing,
    /// Stands on the deck; the motors start at the end of the countdown.
    Countdown,
    /// Armed on the deck at low thrust; waits for a good moment to take off.
    SpinUp,
    /// Leaves the deck.
    TakeOff,
    /// Climbs away from the vessel.
    ClimbOut,
    /// Take-off stopped before the feet left the deck: stands there until disarmed.
    StandDown,
}

/// Flight phases that select weights and rates.
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
    /// Phase of this state.
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
    /// Name used in messages.
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
    /// Name used in messages, depending on the reason for entering: an ordered abort and a completed match
    /// are not failures.
    pub const fn named(self, entered: &Reason) -> &'static str {
        let ended = matches!(self, State::GaveUp);
        if ended && matches!(entered.code, ReasonCode::Operator | ReasonCode::SwitchAborts) {
            "Aborted"
        } else if ended && matches!(entered.code, ReasonCode::Matched) {
            "Matched"
        } else {
            self.name()
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
    /// Outcome of a landing that ended in this state, for messages; None: it continues, or there was none.
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
    /// Whether a landing is in progress.
    pub const fn is_landing(self) -> bool {
        !matches!(self, State::Idle | State::StandDown) && !self.is_take_off() && self.ending().is_none()
    }
    /// Whether a take-off is in progress.
    pub const fn is_take_off(self) -> bool {
        matches!(
            self,
            State::Preparing | State::Countdown | State::SpinUp | State::TakeOff | State::ClimbOut
        )
    }
    /// Whether the drone stands on the deck before a take-off or after a stopped one.
    pub const fn stands_for_take_off(self) -> bool {
        matches!(
            self,
            State::Preparing | State::Countdown | State::SpinUp | State::StandDown
        )
    }
    /// Whether motors start, turn next to the crew or have not stopped yet: everybody near the drone must leave.
    pub const fn starts_motors(self) -> bool {
        matches!(
            self,
            State::Countdown | State::SpinUp | State::TakeOff | State::StandDown
        )
    }
    /// Whether motors that were started for a stopped take-off have to stop.
    pub const fn wants_motors_off(self) -> bool {
        matches!(
            self,
            State::Idle | State::Preparing | State::Countdown | State::StandDown
        )
    }
    /// Whether the drone descends to the deck, or stands on it after a landing.
    pub const fn meets_deck(self) -> bool {
        matches!(self, State::Descent | State::Flare | State::Landed)
    }
    /// Whether the mission was stopped or ended unplanned.
    pub const fn is_setback(self) -> bool {
        matches!(self, State::Hold | State::GaveUp | State::StandDown)
    }
    /// State with the reason for entering it: `Hold: operator's command`.
    pub fn because(self, entered: &Reason) -> String {
        let reason = entered.to_string();
        if reason.is_empty() {
            self.named(entered).into()
        } else {
            format!("{}: {reason}", self.named(entered))
        }
    }
}
