//! Verdict on a sensor channel, with hysteresis, and counts of rejected values.

use alight_shared::time::{Time, VesselClock};

use super::{antenna::Inverted, standstill::Standstill};

/// Length of the window for rejection or acceptance, s: six waves of 10 s.
pub(super) const WINDOW_S: f64 = 60.0;
/// Number of individually impossible values in a window that reject the channel; a single one is a damaged message.
const MAX_IMPOSSIBLE: u32 = 5;

/// Reason for rejecting values, in the channel's SI unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Doubt {
    /// Value beyond its bound.
    Beyond(f64),
    /// Change between two values beyond its bound.
    Jump(f64),
    /// Drift of the mean, per minute.
    Drift(f64),
    /// Mean of a quantity that averages to zero in waves.
    Mean(f64),
    /// Root mean square difference from the rate of change of another channel.
    Disagreement(f64),
    /// Repetition of one number until this time, while another channel moved.
    Standstill(Standstill, Time<VesselClock>),
    /// Repetition of another quantity.
    Copy,
    /// Angle between gravity and down.
    Axes(f64),
    /// The antenna moves against this sign of roll or pitch.
    Inverted(Inverted),
    /// Metres of heave for each metre of the fixes' height.
    OfHeight(f64),
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Taken {
    pub(super) believed: bool,
    /// Start of the rejection that begins with this value.
    pub(super) since: Option<Time<VesselClock>>,
}

impl Taken {
    /// Verdict on this value alone.
    pub(super) fn now(believed: bool) -> Taken {
        let since = None;
        Taken { believed, since }
    }
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ChannelState {
    out: bool,
    doubt: Option<Doubt>,
    /// Number of impossible values in the window, and times of the first and the newest one.
    impossible: u32,
    first: Option<Time<VesselClock>>,
    newest: Option<Time<VesselClock>>,
    taken: u64,
    left_out: u64,
}

impl ChannelState {
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
    /// Adds the result of a test over a window. Returns true if the channel is rejected from now on. A passed
    /// test ends a rejection if no single value was impossible for a window.
    pub(super) fn judge(&mut self, at: Time<VesselClock>, doubt: Option<Doubt>) -> bool {
        let was_out = self.out;
        match doubt {
            Some(_) => (self.out, self.doubt) = (true, doubt),
            None => self.out &= is_recent(self.newest, at),
        }
        self.out && !was_out
    }
    /// Adds a value with the reason why it is impossible, if any. Returns true if the channel is rejected from now on.
    pub(super) fn take(&mut self, at: Time<VesselClock>, doubt: Option<Doubt>) -> bool {
        match doubt {
            Some(doubt) => self.reject(at, doubt),
            None => self.judge(at, None),
        }
    }
    /// Whether a value was impossible within the last seconds.
    pub(super) fn was_impossible(&self, at: Time<VesselClock>, within_s: f64) -> bool {
        self.newest
            .is_some_and(|then| (at - then).abs().secs() < within_s)
    }
    pub(super) fn count(&mut self, believed: bool) {
        self.taken += 1;
        self.left_out += u64::from(!believed);
    }
    /// Counts earlier values, rejected in retrospect.
    pub(super) fn retract(&mut self, count: u64) {
        self.left_out += count;
    }
}

/// Whether two times are less than a window apart.
fn is_recent(then: Option<Time<VesselClock>>, at: Time<VesselClock>) -> bool {
    then.is_some_and(|t| (at - t).abs().secs() < WINDOW_S)
}
