//! What may come in: identity, order, age and sense of every message, each refusal counted with
//! its reason.

use std::collections::VecDeque;

use alight_shared::msg::{Header, MESSAGE_VERSION};
use alight_shared::time::VesselClock;

/// Why a packet was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Reason {
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
    Absurd,
    /// A time reply that answers none of our open requests.
    Unasked,
    /// A time reply with an impossible round trip, or one that contradicts all others.
    RoundTrip,
}

impl Reason {
    /// Every reason.
    pub const ALL: [Reason; 14] = [
        Reason::Oversized,
        Reason::Malformed,
        Reason::Version,
        Reason::Vessel,
        Reason::Drone,
        Reason::Boot,
        Reason::Duplicate,
        Reason::Order,
        Reason::Stale,
        Reason::Future,
        Reason::NoClock,
        Reason::Absurd,
        Reason::Unasked,
        Reason::RoundTrip,
    ];

    /// The name that a person reads.
    pub const fn name(self) -> &'static str {
        match self {
            Reason::Oversized => "oversized",
            Reason::Malformed => "malformed",
            Reason::Version => "of another version",
            Reason::Vessel => "of another vessel",
            Reason::Drone => "for another drone",
            Reason::Boot => "of a former boot",
            Reason::Duplicate => "repeated",
            Reason::Order => "overtaken",
            Reason::Stale => "stale",
            Reason::Future => "from the future",
            Reason::NoClock => "before the clocks agreed",
            Reason::Absurd => "absurd",
            Reason::Unasked => "unasked replies",
            Reason::RoundTrip => "impossible round trips",
        }
    }
}

/// Refusals since the start, per reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rejections([u32; Reason::ALL.len()]);

impl Rejections {
    /// Counts one.
    pub fn count(&mut self, reason: Reason) {
        if let Some(n) = self.0.get_mut(reason as usize) {
            *n = n.saturating_add(1);
        }
    }
    /// Refusals for `reason`.
    pub fn of(&self, reason: Reason) -> u32 {
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
    pub fn look(&self, boot: u32) -> Boot {
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
pub fn identity(header: &Header<VesselClock>, vessel_id: u32, drone_id: u32) -> Result<(), Reason> {
    if header.version != MESSAGE_VERSION {
        return Err(Reason::Version);
    }
    if header.vessel != vessel_id {
        return Err(Reason::Vessel);
    }
    if header.drone != 0 && header.drone != drone_id {
        return Err(Reason::Drone);
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
    pub fn advance(&self, sequence: u32) -> Result<u32, Reason> {
        match self.newest {
            None => Ok(1),
            Some(n) if sequence == n => Err(Reason::Duplicate),
            Some(n) if sequence < n => Err(Reason::Order),
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
    fn every_reason_has_its_own_counter() {
        let mut r = Rejections::default();
        for (i, reason) in Reason::ALL.iter().enumerate() {
            assert_eq!(*reason as usize, i);
            r.count(*reason);
            assert_eq!(r.of(*reason), 1);
        }
        assert_eq!(r.total(), Reason::ALL.len() as u32);
    }

    #[test]
    fn a_superseded_boot_never_comes_back() {
        let mut b = Boots::default();
        assert_eq!(b.look(7), Boot::First);
        b.adopt(7);
        assert_eq!(b.look(8), Boot::Unknown);
        b.adopt(8);
        assert_eq!((b.look(7), b.look(8)), (Boot::Retired, Boot::Current));
    }
}
