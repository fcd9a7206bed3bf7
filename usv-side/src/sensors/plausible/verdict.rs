//! The verdict on a channel of a sensor, with hysteresis, and counts of the values that are left out of it.

use alight_shared::time::{Time, VesselClock};

use super::standstill::Standstill;

/// Length of the window in which a channel loses or regains its credit, s: six waves of 10 s.
pub(super) const WINDOW_S: f64 = 60.0;
/// Values within a window that are impossible each by itself, after which the channel is left out: a single one is one
/// damaged message.
const MAX_IMPOSSIBLE: u32 = 5;

/// Reason why values of a channel are left out, in the channel's SI unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Doubt {
    /// A value beyond its bound.
    Beyond(f64),
    /// A change from one value to the next beyond its bound.
    Jump(f64),
    /// A drift of the mean, per minute.
    Drift(f64),
    /// A mean that is not zero, as it is in waves.
    Mean(f64),
    /// The root mean square of its difference from the rate of change of another channel.
    Disagreement(f64),
    /// An unchanged number until then while another channel moves.
    Standstill(Standstill, Time<VesselClock>),
    /// Gravity so far from down.
    Axes(f64),
}

/// The fate of one value.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taken {
    /// It is used.
    pub(super) believed: bool,
    /// The channel is left out from now on, by values since then.
    pub(super) since: Option<Time<VesselClock>>,
}

/// The state of a channel.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ChannelState {
    out: bool,
    doubt: Option<Doubt>,
    /// Impossible values, and the time of the first of them in their window and of the newest.
    impossible: u32,
    first: Option<Time<VesselClock>>,
    newest: Option<Time<VesselClock>>,
    taken: u64,
    left_out: u64,
}

impl ChannelState {
    /// The channel is left out now.
    pub(super) fn is_out(&self) -> bool {
        self.out
    }
    /// Newest reason, number of values left out, and of all.
    pub(super) fn account(&self) -> Option<(Doubt, u64, u64)> {
        let doubt = self.doubt.filter(|_| self.left_out > 0)?;
        Some((doubt, self.left_out, self.taken))
    }
    /// Takes a value that is impossible by itself; true when the channel is left out from now on.
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
    /// Takes the result of a test over a window; true when the channel is left out from now on. A channel that passes
    /// returns, once no value has been impossible for a window.
    pub(super) fn judge(&mut self, at: Time<VesselClock>, doubt: Option<Doubt>) -> bool {
        let was_out = self.out;
        match doubt {
            Some(_) => (self.out, self.doubt) = (true, doubt),
            None => self.out &= is_recent(self.newest, at),
        }
        self.out && !was_out
    }
    /// Counts a value.
    pub(super) fn count(&mut self, believed: bool) {
        self.taken += 1;
        self.left_out += u64::from(!believed);
    }
    /// Counts earlier values that are left out afterwards.
    pub(super) fn retract(&mut self, count: u64) {
        self.left_out += count;
    }
}

/// Less than a window before or after.
fn is_recent(then: Option<Time<VesselClock>>, at: Time<VesselClock>) -> bool {
    then.is_some_and(|t| (at - t).abs().secs() < WINDOW_S)
}
