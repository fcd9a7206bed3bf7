//! Verdict on a sensor channel, with hysteresis, and counts of the rejected values.

use alight_shared::time::{Time, VesselClock};

use super::antenna::Inverted;
use super::standstill::Standstill;

/// Length of the window in which a channel is rejected or accepted again, s: six waves of 10 s.
pub(super) const WINDOW_S: f64 = 60.0;
/// Number of individually impossible values within a window after which the channel is rejected. A single impossible
/// value is a damaged message.
const MAX_IMPOSSIBLE: u32 = 5;

/// Reason for rejecting values of a channel, in the channel's SI unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Doubt {
    /// The value is beyond its bound.
    Beyond(f64),
    /// The change between two values is beyond its bound.
    Jump(f64),
    /// A drift of the mean, per minute.
    Drift(f64),
    /// A non-zero mean of a quantity that has zero mean in waves.
    Mean(f64),
    /// Root mean square difference from the rate of change of another channel.
    Disagreement(f64),
    /// The channel repeated the same number until the given time, while another channel moved.
    Standstill(Standstill, Time<VesselClock>),
    /// Angle between gravity and down.
    Axes(f64),
    /// The antenna moves against this sign of roll or pitch.
    Inverted(Inverted),
}

/// Result for one value.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taken {
    /// The value is used.
    pub(super) believed: bool,
    /// The channel is rejected, starting with values from this time on.
    pub(super) since: Option<Time<VesselClock>>,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ChannelState {
    out: bool,
    doubt: Option<Doubt>,
    /// Number of impossible values in the current window, and times of the first and the newest of them.
    impossible: u32,
    first: Option<Time<VesselClock>>,
    newest: Option<Time<VesselClock>>,
    taken: u64,
    left_out: u64,
}

impl ChannelState {
    /// Whether the channel is rejected at present.
    pub(super) fn is_out(&self) -> bool {
        self.out
    }
    /// Newest reason, number of rejected values, and number of all values.
    pub(super) fn account(&self) -> Option<(Doubt, u64, u64)> {
        let doubt = self.doubt.filter(|_| self.left_out > 0)?;
        Some((doubt, self.left_out, self.taken))
    }
    /// Adds an impossible value. Returns true if the channel is rejected from now on.
    pub(super) fn reject(&mut self, at: Time<VesselClock>, doubt: Doubt) -> bool {
        if !is_recent(self.first, at) {
            (self.first, self.impossible) = (Some(at), 0);
        }
        self.impossible = self.impossible.saturating_add(1);
        (self.newest, self.doubt) = (Some(at), Some(doubt));
        let loses = !self.out && self.impossible >= MAX_IMPOSSIBLE;
        self.out |= loses;
        loses
    }
    /// Adds the result of a test over a window. Returns true if the channel is rejected from now on. A rejected channel
    /// that passes the test is accepted again, provided that no single value has been impossible for the length of a
    /// window.
    pub(super) fn judge(&mut self, at: Time<VesselClock>, doubt: Option<Doubt>) -> bool {
        let was_out = self.out;
        match doubt {
            Some(_) => (self.out, self.doubt) = (true, doubt),
            None => self.out &= is_recent(self.newest, at),
        }
        self.out && !was_out
    }
    pub(super) fn count(&mut self, believed: bool) {
        self.taken += 1;
        self.left_out += u64::from(!believed);
    }
    /// Counts earlier values that are rejected in retrospect.
    pub(super) fn retract(&mut self, count: u64) {
        self.left_out += count;
    }
}

/// Whether two times are less than a window apart.
fn is_recent(then: Option<Time<VesselClock>>, at: Time<VesselClock>) -> bool {
    then.is_some_and(|t| (at - t).abs().secs() < WINDOW_S)
}
