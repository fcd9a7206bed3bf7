//! The newest valid copy of an input that arrives once.

use alight_shared::msg::{MESSAGE_VERSION, Message};
use alight_shared::time::{DroneClock, Span, Time};

/// Accepted lead of a time of validity over `now`: one tick and rounding. Messages inside one
/// computer share a clock, so anything further ahead is damaged.
const LEAD: Span = Span::from_millis(50);

/// Keeps the newest valid message of one kind and counts what it refuses.
#[derive(Clone, Debug)]
pub(crate) struct Latest<T> {
    value: Option<T>,
    rejected: u32,
}

impl<T> Default for Latest<T> {
    fn default() -> Self {
        Latest {
            value: None,
            rejected: 0,
        }
    }
}

impl<T: Message<Clock = DroneClock> + Copy> Latest<T> {
    /// Takes `message` when it is of this version, sound, newer than the kept one and not from the
    /// future; else counts a rejection. Says whether it was taken.
    pub(crate) fn offer(&mut self, now: Time<DroneClock>, message: &T) -> bool {
        let h = message.header();
        let newer = self.value.is_none_or(|v| h.at > v.header().at);
        let sound = h.version == MESSAGE_VERSION && newer && h.at - now <= LEAD && message.check().is_ok();
        if sound {
            self.value = Some(*message);
        } else {
            self.rejected = self.rejected.saturating_add(1);
        }
        sound
    }
    /// The newest, however old.
    pub(crate) fn get(&self) -> Option<&T> {
        self.value.as_ref()
    }
    /// The newest, when it is no older than `limit`.
    pub(crate) fn fresh(&self, now: Time<DroneClock>, limit: Span) -> Option<&T> {
        self.value.as_ref().filter(|v| now - v.header().at <= limit)
    }
    /// Age of the newest, s; infinite when there is none.
    pub(crate) fn age_s(&self, now: Time<DroneClock>) -> f64 {
        self.value
            .as_ref()
            .map_or(f64::INFINITY, |v| (now - v.header().at).secs())
    }
    /// Forgets the value, not the count.
    pub(crate) fn forget(&mut self) {
        self.value = None;
    }
    /// Messages refused so far.
    pub(crate) fn rejected(&self) -> u32 {
        self.rejected
    }
}
