//! Selection of the vessel's current computer among restarts and duplicates, and the order of its messages.
//!
//! Only one computer is current for an identity. Two computers with one certificate look like a computer that restarts
//! repeatedly, except that a restarted computer no longer sends under its former boot. A new boot is therefore accepted
//! only after the current computer has been silent: for [`RESTART_SILENCE`] if nothing contradicts a restart. A boot
//! that was received before a later message of the current computer belongs to a second computer ([`Boots::second`]),
//! and is accepted only after [`CURRENT_SILENCE`]. If the former computer sends again after an assumed restart, it
//! becomes the current computer again.

use std::collections::VecDeque;

use alight_shared::{
    admission::RejectionReason,
    time::{DroneTime, Span},
};

const MAX_OTHERS: usize = 16;
/// Silence of the current computer after which a boot that was never received at the same time counts as its restart:
/// fifteen estimates, and half of the maximum age of an estimate.
pub const RESTART_SILENCE: Span = Span::from_millis(500);
/// Silence of the current computer after which a second computer replaces it: longer than a descent and flare (38 s),
/// and than the time after which the vessel's deck arbiter assumes that a silent drone has ended its landing.
pub const CURRENT_SILENCE: Span = Span::from_millis(60_000);
/// Time after which a silent second computer is no longer reported.
const SECOND_TIMEOUT: Span = Span::from_millis(10_000);

#[derive(Clone, Debug, Default)]
pub struct Boots {
    current: Option<CurrentComputer>,
    others: VecDeque<Other>,
}

#[derive(Clone, Copy, Debug)]
struct CurrentComputer {
    boot: u32,
    received: DroneTime,
    adopted: DroneTime,
    /// Boot of the computer whose restart this one is assumed to be.
    predecessor: Option<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Other {
    boot: u32,
    first: DroneTime,
    newest: DroneTime,
    retired: bool,
    is_second: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Boot {
    Current,
    First,
    /// Possible restart of the current computer after a sufficient silence; a message must prove it newer.
    Next,
    /// The boot is superseded, or not proven newer than the current computer, which was received recently.
    Other,
    /// Another computer with the same identity, active at the same time as the current one.
    Second,
}

impl Boots {
    /// Classifies a message with this `boot` that arrives at `now`.
    pub fn observe(&mut self, now: DroneTime, boot: u32) -> Boot {
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
    /// Records an admitted message of the current computer that was sent at `sent` or later, on our clock. Any other
    /// boot that was received before `sent` belongs to another computer.
    pub fn received(&mut self, now: DroneTime, sent: DroneTime) {
        if let Some(current) = &mut self.current {
            current.received = current.received.max(now);
            let lived = |o: &&mut Other| !o.retired && o.first < sent;
            for o in self.others.iter_mut().filter(lived) {
                o.is_second = true;
            }
        }
    }
    pub fn adopt(&mut self, now: DroneTime, boot: u32) {
        let second = self.others.iter().any(|o| o.boot == boot && o.is_second);
        self.others.retain(|o| o.boot != boot);
        let former = self.current.replace(CurrentComputer {
            boot,
            received: now,
            adopted: now,
            // A second computer is not a restart of the first, which may return at any time.
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
    /// Records a reply of this boot to a request sent at `asked`. Returns true if the reply is from the former
    /// computer: the supposed restart is then another computer, and the former must become current again.
    pub fn returns(&mut self, now: DroneTime, boot: u32, asked: DroneTime) -> bool {
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
        for o in second {
            o.is_second = true;
            o.newest = now;
        }
        true
    }
    /// Boot of a second computer with the vessel's identity that was received recently.
    pub fn second(&self, now: DroneTime) -> Option<u32> {
        let lately = |o: &&Other| o.is_second && now - o.newest <= SECOND_TIMEOUT;
        self.others.iter().rfind(lately).map(|o| o.boot)
    }
    fn remember(&mut self, other: Other) {
        if self.others.len() == MAX_OTHERS {
            // Boots known to belong to a second computer are dropped last.
            let spare = self.others.iter().position(|o| !o.is_second).unwrap_or(0);
            self.others.remove(spare);
        }
        self.others.push_back(other);
    }
}

/// Order of one kind of message within a boot.
#[derive(Clone, Copy, Debug, Default)]
pub struct SequenceOrder {
    newest: Option<u32>,
    /// Bit mask of admitted messages: the newest is the lowest bit.
    admitted: u64,
}

impl SequenceOrder {
    /// Sequence numbers since the newest admitted message (1 without loss); rejects repeated and late messages.
    pub fn advance(&self, sequence: u32) -> Result<u32, RejectionReason> {
        match self.newest {
            None => Ok(1),
            Some(n) if sequence == n => Err(RejectionReason::Duplicate),
            Some(n) if sequence < n => Err(RejectionReason::OutOfOrder),
            Some(n) => Ok(sequence - n),
        }
    }
    /// Like [`Self::advance`], for messages that may overtake one another; rejects those 64 or more behind the newest.
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
    pub fn admit(&mut self, sequence: u32) {
        self.newest = Some(sequence);
    }
    /// Marks a `sequence` admitted by [`Self::advance_unordered`].
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
    use alight_shared::time::Time;

    fn at(s: f64) -> DroneTime {
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
        // Sent before the other computer was first received: the current computer may have ended since.
        b.received(at(1.2), at(0.9));
        assert_eq!(b.second(at(1.2)), None);
        b.received(at(1.3), at(1.1));
        assert_eq!(b.second(at(1.3)), Some(8));
        // An outage within a flight never transfers the identity to the second computer.
        assert_eq!(b.observe(at(61.0), 8), Boot::Second);
        assert_eq!(b.observe(at(62.0), 8), Boot::Next);
        b.adopt(at(62.0), 8);
        // The first is now the second computer, and only the same evidence makes it current again.
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
        // The reply may have been sent before the restart.
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
