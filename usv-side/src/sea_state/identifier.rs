//! The identifier.

use alight_shared::time::{Time, VesselClock};

use super::{MotionSample, SeaState, SeaStateConfig};

/// Identifies the sea from the vessel's own motion.
#[derive(Clone, Debug)]
pub struct Identifier {
    state: Option<SeaState>,
}

impl Identifier {
    /// An identifier without a record.
    pub fn new(_config: &SeaStateConfig) -> Self {
        Identifier { state: None }
    }

    /// Takes a sample; a sample that is not finite, absurd, repeated or older than the newest is
    /// counted and dropped.
    pub fn push(&mut self, _sample: &MotionSample) {}

    /// Does the work that is due at `now`, at most once in `update_period_s`, and returns the
    /// newest state: `None` before `min_window_s` of record.
    pub fn update(&mut self, _now: Time<VesselClock>) -> Option<&SeaState> {
        self.state.as_ref()
    }

    /// Samples dropped so far.
    pub fn rejected(&self) -> u64 {
        0
    }
}
