//! Commands to the boat's autopilot, and its reports, for any kind of it.

use alight_shared::time::{Time, VesselClock};

/// Command to the boat's autopilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum HelmCommand {
    Nothing,
    Steer { heading_rad: f64, speed_mps: f64 },
    GiveBack { mode: Option<u32> },
}

/// Report of the boat's autopilot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ReadBack {
    /// It is there.
    pub present: bool,
    /// Mode, where it reports one.
    pub mode: Option<u32>,
    /// When it did last.
    pub reported: Option<Time<VesselClock>>,
    /// It takes our commands in that mode.
    pub is_ours: bool,
    /// It denied the mode.
    pub denied: bool,
    /// It reports a hand on the helm.
    pub by_hand: bool,
}

impl ReadBack {
    /// It reports the mode in which it takes set-points: ours, or somebody else's.
    pub(super) fn is_steered(&self) -> bool {
        self.present && self.is_ours && self.mode.is_some()
    }
}
