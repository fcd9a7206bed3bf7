//! Levels of the deck's digital inputs.

use alight_shared::time::{Span, Time, VesselClock};
use serde::{Deserialize, Serialize};

/// An input counts as unread after this long: four periods.
const FRESH: Span = Span::from_millis(2000);

/// Levels of the digital inputs that were read since the last step; None: not read, unreadable or not configured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeckInputs {
    /// The crew's switch is closed.
    pub closed: Option<bool>,
    /// The sensor reports something on the deck.
    pub occupied: Option<bool>,
    /// By the helm's switch the vessel turns or may turn.
    pub turning: Option<bool>,
}

/// A digital input as it was last read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    pub(super) level: bool,
    pub(super) at: Time<VesselClock>,
}

impl Reading {
    /// Whether an input that is configured is active: also when it was not read for too long.
    pub(super) fn active(newest: Option<Reading>, configured: bool, now: Time<VesselClock>) -> bool {
        configured && newest.is_none_or(|r| r.level || now - r.at > FRESH)
    }
}
