//! What may come in: identity, order, age and sense of every message, each refusal counted with
//! its reason.

use std::collections::VecDeque;

use alight_shared::msg::{Header, MESSAGE_VERSION};
use alight_shared::time::VesselClock;

/// Why a packet was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum RejectionReason {
    /// Longer than any message.
    Oversized,
    /// The bytes are not such a message.
    Malformed,
    /// Another version of the layout.
    Version,
    /// Another vessel's.
    Vessel,
    /// For another drone.
    Drone,
    /// From a boot of the vessel's computer that has been superseded, or from an unknown one
    /// without proof that it is the newer.
    Boot,
    /// Already had this one.
    Duplicate,
    /// A newer one has come already.
    Order,
    /// Its time of validity is too long ago.
    Stale,
    /// It claims to be valid later than its arrival allows.
    Future,
    /// The clocks' offset is not known yet: its time of validity cannot be converted.
    NoClock,
    /// A number is not finite or outside what physics allows.
    OutOfRange,
    /// A time reply that answers none of our open requests.
    Unsolicited,
    /// A time reply with an impossible round trip, or one that contradicts all others.
    RoundTrip,
}

impl RejectionReason {
    /// Every reason.
    pub const ALL: [RejectionReason; 14] = [
        RejectionReason::Oversized,
        RejectionReason::Malformed,
        RejectionReason::Version,
        RejectionReason::Vessel,
        RejectionReason::Drone,
        RejectionReason::Boot,
        RejectionReason::Duplicate,
        RejectionReason::Order,
        RejectionReason::Stale,
        RejectionReason::Future,
        RejectionReason::NoClock,
        RejectionReason::OutOfRange,
        RejectionReason::Unsolicited,
        RejectionReason::RoundTrip,
    ];

    /// The name that a person reads.
    pub const fn name(self) -> &'static str {
        match self {
            RejectionReason::Oversized => "oversized",
            RejectionReason::Malformed => "malformed",
            RejectionReason::Version => "of another version",
            RejectionReason::Vessel => "of another vessel",
            RejectionReason::Drone => "for another drone",
            RejectionReason::Boot => "of a former boot",
            RejectionReason::Duplicate => "repeated",
            RejectionReason::Order => "overtaken",
            RejectionReason::Stale => "stale",
            RejectionReason::Future => "from the future",
            RejectionReason::NoClock => "before the clocks agreed",
            RejectionReason::OutOfRange => "absurd",
            RejectionReason::Unsolicited => "unasked replies",
            RejectionReason::RoundTrip => "impossible round trips",
        }
    }
}

/// Refusals since the start, per reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rejections([u32; RejectionReason::ALL.len()]);

impl Rejections {
    /// Counts one.
    pub fn count(&mut self, reason: RejectionReason) {
        if let Some(n) = self.0.get_mut(reason as usize) {
            *n = n.saturating_add(1);
        }
    }
    /// Refusals for `reason`.
    pub fn of(&self, reason: RejectionReason) -> u32 {
        self.0.get(reason as usize).copied().unwrap_or(0)
    }
    /// All refusals.
    pub fn total(&self) -> u32 {
        self.0.iter().fold(0, |a, b| a.saturating_add(*b))
    }
}

/// Superseded boots that are remembered.
const MAX_RETIRED: usize = 16;

/// Which start of the vessel's computer is listened to.
#[derive(Clone, Debug, Default)]
pub struct Boots {
    current: Option<u32>,
    retired: VecDeque<u32>,
}

/// What a boot id means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Boot {
    /// The one that is listened to.
    Current,
    /// The first that was ever heard.
    First,
    /// Never heard before: a restart, or a message from before we began to listen.
    Unknown,
    /// Superseded.
    Retired,
}

impl Boots {
    /// What `boot` means.
    pub fn classify(&self, boot: u32) -> Boot {
        match self.current {
            None => Boot::First,
            Some(c) if c == boot => Boot::Current,
            Some(_) if self.retired.contains(&boot) => Boot::Retired,
            Some(_) => Boot::Unknown,
        }
    }
    /// From now on `boot` is listened to and its predecessor never again.
    pub fn adopt(&mut self, boot: u32) {
        if let Some(old) = self.current.replace(boot)
            && old != boot
        {
            if self.retired.len() == MAX_RETIRED {
                self.retired.pop_front();
            }
            self.retired.push_back(old);
        }
    }
}

/// Identity of a message: version, vessel, drone.
pub fn identity(header: &Header<VesselClock>, vessel_id: u32, drone_id: u32) -> Result<(), RejectionReason> {
    if header.version != MESSAGE_VERSION {
        return Err(RejectionReason::Version);
    }
    if header.vessel != vessel_id {
        return Err(RejectionReason::Vessel);
    }
    if header.drone != 0 && header.drone != drone_id {
        return Err(RejectionReason::Drone);
    }
    Ok(())
}

/// The order of one kind of message within a boot.
#[derive(Clone, Copy, Debug, Default)]
pub struct Order {
    newest: Option<u32>,
}

impl Order {
    /// Sequence numbers since the newest admitted (1 without loss); refuses repeated and late ones.
    pub fn advance(&self, sequence: u32) -> Result<u32, RejectionReason> {
        match self.newest {
            None => Ok(1),
            Some(n) if sequence == n => Err(RejectionReason::Duplicate),
            Some(n) if sequence < n => Err(RejectionReason::Order),
            Some(n) => Ok(sequence - n),
        }
    }
    /// `sequence` was admitted.
    pub fn admit(&mut self, sequence: u32) {
        self.newest = Some(sequence);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rejections_count_each_reason_on_its_own() {
        let mut r = Rejections::default();
        for (i, reason) in RejectionReason::ALL.iter().enumerate() {
            assert_eq!(*reason as usize, i);
            r.count(*reason);
            assert_eq!(r.of(*reason), 1);
        }
        assert_eq!(r.total(), RejectionReason::ALL.len() as u32);
    }

    #[test]
    fn boots_never_return_to_a_superseded_one() {
        let mut b = Boots::default();
        assert_eq!(b.classify(7), Boot::First);
        b.adopt(7);
        assert_eq!(b.classify(8), Boot::Unknown);
        b.adopt(8);
        assert_eq!((b.classify(7), b.classify(8)), (Boot::Retired, Boot::Current));
    }
}
