//! Which start of the vessel's computer is listened to, and the order of its messages.
//!
//! One identity has one current computer. Two computers with one certificate look like one that is started again and again, but for
//! one thing: a computer that was started again is not received any more under its former boot. So another boot is
//! listened to only once the current computer is silent, for [`RESTART_SILENCE`] where nothing speaks against a restart. A boot that
//! was received before a message that the current computer sent later is that of a second computer ([`Boots::second`]), and it is
//! listened to only after [`CURRENT_SILENCE`]. If the former computer turns out to live after a restart was believed, it is
//! the current computer again.

use std::collections::VecDeque;

use alight_shared::admission::RejectionReason;
use alight_shared::time::{DroneClock, Span, Time};

/// Other boots that are remembered.
const MAX_OTHERS: usize = 16;
/// The current computer is silent for this long before a boot that was never received at the same time counts as its next start: fifteen
/// estimates, and half of what an estimate may be old.
pub const RESTART_SILENCE: Span = Span::from_millis(500);
/// Before that of a second computer does: longer than a descent and flare (38 s), and what the vessel's deck arbiter waits
/// for before it believes that a silent drone has ended its landing.
pub const CURRENT_SILENCE: Span = Span::from_millis(60_000);
/// A second computer that was not received for this long is not reported any more.
const SECOND_TIMEOUT: Span = Span::from_millis(10_000);

/// Which start of the vessel's computer is listened to.
#[derive(Clone, Debug, Default)]
pub struct Boots {
    current: Option<CurrentComputer>,
    others: VecDeque<Other>,
}

#[derive(Clone, Copy, Debug)]
struct CurrentComputer {
    boot: u32,
    received: Time<DroneClock>,
    /// Since when it is listened to.
    adopted: Time<DroneClock>,
    /// The one whose next start it was taken for.
    predecessor: Option<u32>,
}

/// A boot that is not listened to.
#[derive(Clone, Copy, Debug)]
struct Other {
    boot: u32,
    first: Time<DroneClock>,
    newest: Time<DroneClock>,
    /// It was listened to before.
    retired: bool,
    /// It and the current computer lived at one time.
    is_second: bool,
}

/// Meaning of a boot id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Boot {
    /// The one that is listened to.
    Current,
    /// The first that was ever received.
    First,
    /// The current computer is silent for long enough: its next start, if a message proves to be newer than its.
    Next,
    /// Not known to be newer than the current computer, which was received just now; or superseded.
    Other,
    /// Another computer with the same identity, at the same time as the current computer.
    Second,
}

impl Boots {
    /// Meaning of a message of this `boot` that arrives at `now`.
    pub fn observe(&mut self, now: Time<DroneClock>, boot: u32) -> Boot {
        let Some(current) = self.current else {
            return Boot::First;
        };
        if current.boot == boot {
            return Boot::Current;
        }
        let silence = now - current.received;
        let other = match self.others.iter_mut().find(|o| o.boot == boot) {
            Some(known) => {
                known.newest = now;
                *known
            }
            None => {
                let new = Other {
                    boot,
                    first: now,
                    newest: now,
                    retired: false,
                    is_second: false,
                };
                self.remember(new);
                new
            }
        };
        match other {
            Other { is_second: true, .. } if silence > CURRENT_SILENCE => Boot::Next,
            Other { is_second: true, .. } => Boot::Second,
            Other { retired: false, .. } if silence > RESTART_SILENCE => Boot::Next,
            Other { .. } => Boot::Other,
        }
    }
    /// A message of the current computer was admitted that it sent at `sent` or later, on our clock: whoever was received before
    /// that is another computer.
    pub fn received(&mut self, now: Time<DroneClock>, sent: Time<DroneClock>) {
        if let Some(current) = &mut self.current {
            current.received = current.received.max(now);
            let lived = |o: &&mut Other| !o.retired && o.first < sent;
            self.others
                .iter_mut()
                .filter(lived)
                .for_each(|o| o.is_second = true);
        }
    }
    /// From now on `boot` is listened to.
    pub fn adopt(&mut self, now: Time<DroneClock>, boot: u32) {
        let second = self.others.iter().any(|o| o.boot == boot && o.is_second);
        self.others.retain(|o| o.boot != boot);
        let former = self.current.replace(CurrentComputer {
            boot,
            received: now,
            adopted: now,
            // A second computer is no next start of the first, which may be back at any time.
            predecessor: self.current.map(|h| h.boot).filter(|_| !second),
        });
        if let Some(former) = former.filter(|f| f.boot != boot) {
            self.remember(Other {
                boot: former.boot,
                first: former.received,
                newest: former.received,
                retired: true,
                is_second: second,
            });
        }
    }
    /// A computer with this boot answered a request of `asked`. True where it is the former computer, which was taken for
    /// ended before: it lives, so that its supposed next start is another computer. It is to be listened to again.
    pub fn returns(&mut self, now: Time<DroneClock>, boot: u32, asked: Time<DroneClock>) -> bool {
        let Some(current) = self
            .current
            .filter(|h| h.predecessor == Some(boot) && asked > h.adopted)
        else {
            return false;
        };
        self.adopt(now, boot);
        if let Some(returned) = &mut self.current {
            returned.predecessor = None;
        }
        let second = self.others.iter_mut().filter(|o| o.boot == current.boot);
        second.for_each(|o| (o.is_second, o.newest) = (true, now));
        true
    }
    /// The boot of a second computer with the vessel's identity that was received lately.
    pub fn second(&self, now: Time<DroneClock>) -> Option<u32> {
        let lately = |o: &&Other| o.is_second && now - o.newest <= SECOND_TIMEOUT;
        self.others.iter().rfind(lately).map(|o| o.boot)
    }
    /// Forgets the oldest for a new one.
    fn remember(&mut self, other: Other) {
        if self.others.len() == MAX_OTHERS {
            // One that is known to live at the same time as the current computer last.
            let spare = self.others.iter().position(|o| !o.is_second).unwrap_or(0);
            self.others.remove(spare);
        }
        self.others.push_back(other);
    }
}

/// The order of one kind of message within a boot.
#[derive(Clone, Copy, Debug, Default)]
pub struct SequenceOrder {
    newest: Option<u32>,
    /// The newest as the lowest bit and those before it, each that was admitted.
    admitted: u64,
}

impl SequenceOrder {
    /// Sequence numbers since the newest admitted (1 without loss); rejects repeated and late ones.
    pub fn advance(&self, sequence: u32) -> Result<u32, RejectionReason> {
        match self.newest {
            None => Ok(1),
            Some(n) if sequence == n => Err(RejectionReason::Duplicate),
            Some(n) if sequence < n => Err(RejectionReason::OutOfOrder),
            Some(n) => Ok(sequence - n),
        }
    }
    /// Sequence numbers since the newest admitted where each message counts by itself and may overtake others: rejects repeated ones, and those of 64 before.
    pub fn advance_unordered(&self, sequence: u32) -> Result<u32, RejectionReason> {
        match (self.advance(sequence), self.newest) {
            (Err(RejectionReason::OutOfOrder), Some(n)) => match self.admitted.checked_shr(n - sequence) {
                Some(before) if before & 1 == 0 => Ok(0),
                Some(_) => Err(RejectionReason::Duplicate),
                None => Err(RejectionReason::OutOfOrder),
            },
            (advance, _) => advance,
        }
    }
    /// `sequence` was admitted.
    pub fn admit(&mut self, sequence: u32) {
        self.newest = Some(sequence);
    }
    /// `sequence` was admitted by [`Self::advance_unordered`].
    pub fn admit_unordered(&mut self, sequence: u32) {
        let newest = self.newest.map_or(sequence, |n| n.max(sequence));
        let shift = |from: u32| newest - from;
        let before = self
            .newest
            .map_or(0, |n| self.admitted.checked_shl(shift(n)).unwrap_or(0));
        self.admitted = before | 1_u64.checked_shl(shift(sequence)).unwrap_or(0);
        self.newest = Some(newest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(s: f64) -> Time<DroneClock> {
        Time::from_secs(s)
    }

    #[test]
    fn messages_that_overtake_others() {
        let mut order = SequenceOrder::default();
        let mut admit = |sequence: u32| {
            let advance = order.advance_unordered(sequence);
            advance.inspect(|_| order.admit_unordered(sequence))
        };
        assert_eq!([10, 13, 11].map(&mut admit), [Ok(1), Ok(3), Ok(0)]);
        let repeated = Err(RejectionReason::Duplicate);
        assert_eq!(
            [13, 11, 10, 12].map(&mut admit),
            [repeated, repeated, repeated, Ok(0)]
        );
        assert_eq!(
            [200, 137, 136].map(&mut admit),
            [Ok(187), Ok(0), Err(RejectionReason::OutOfOrder)]
        );
    }

    #[test]
    fn next_start_of_a_silent_computer() {
        let mut b = Boots::default();
        assert_eq!(b.observe(at(0.0), 7), Boot::First);
        b.adopt(at(0.0), 7);
        assert_eq!(
            b.observe(at(0.4), 8),
            Boot::Other,
            "the current computer was received just now"
        );
        assert_eq!(b.observe(at(0.6), 8), Boot::Next);
        b.adopt(at(0.6), 8);
        assert_eq!(
            (b.observe(at(0.7), 7), b.observe(at(0.7), 8)),
            (Boot::Other, Boot::Current)
        );
        assert_eq!(b.second(at(0.7)), None, "a late packet of the former start");
        assert_eq!(b.observe(at(5.0), 7), Boot::Other, "superseded for good");
    }

    #[test]
    fn second_computer_next_to_the_current() {
        let mut b = Boots::default();
        b.adopt(at(0.0), 7);
        b.observe(at(1.0), 8);
        // Under way before the other was received first: the current computer may have ended meanwhile.
        b.received(at(1.2), at(0.9));
        assert_eq!(b.second(at(1.2)), None);
        b.received(at(1.3), at(1.1));
        assert_eq!(b.second(at(1.3)), Some(8));
        // No outage of the first that a flight has gives it to the second.
        assert_eq!(b.observe(at(61.0), 8), Boot::Second);
        assert_eq!(b.observe(at(62.0), 8), Boot::Next);
        b.adopt(at(62.0), 8);
        // The first is the second now, and takes it back by nothing less.
        assert!(!b.returns(at(64.0), 7, at(63.0)));
        b.received(at(65.0), at(65.0));
        assert_eq!(b.observe(at(65.1), 7), Boot::Second);
        assert_eq!(b.second(at(65.1)), Some(7));
        assert_eq!(b.second(at(80.0)), None, "switched off");
    }

    #[test]
    fn current_computer_back_after_an_outage() {
        let mut b = Boots::default();
        b.adopt(at(0.0), 7);
        assert_eq!(b.observe(at(2.0), 8), Boot::Next);
        b.adopt(at(2.0), 8);
        // An answer to what was asked before may have been under way.
        assert!(!b.returns(at(2.4), 7, at(1.9)));
        assert!(b.returns(at(2.6), 7, at(2.5)));
        assert_eq!(
            (b.observe(at(2.7), 7), b.observe(at(2.7), 8)),
            (Boot::Current, Boot::Second)
        );
        assert_eq!(b.second(at(2.7)), Some(8));
    }

    #[test]
    fn many_boots() {
        let mut b = Boots::default();
        b.adopt(at(0.0), 7);
        b.observe(at(0.1), 8);
        b.received(at(0.2), at(0.2));
        for boot in 100..200 {
            b.observe(at(0.3), boot);
        }
        assert!(b.others.len() <= MAX_OTHERS);
        assert_eq!(b.second(at(0.3)), Some(8));
    }
}
