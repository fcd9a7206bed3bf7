use alight_shared::time::{Span, VesselTime};
use serde::{Deserialize, Serialize};

/// Age after which an input counts as unread: four periods.
const FRESH: Span = Span::from_millis(2000);

/// Levels of the digital inputs since the last step; None: unread, unreadable or not configured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeckInputs {
    pub closed: Option<bool>,
    pub occupied: Option<bool>,
    /// The helm's switch shows that the vessel turns or may turn.
    pub turning: Option<bool>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    pub(super) level: bool,
    pub(super) at: VesselTime,
}

impl Reading {
    /// Whether a configured input is active, or has not been read for too long.
    pub(super) fn active(newest: Option<Reading>, configured: bool, now: VesselTime) -> bool {
        configured && newest.is_none_or(|r| r.level || now - r.at > FRESH)
    }
}
