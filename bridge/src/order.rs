//! Order of the vessel's messages: boot number of its computer, then sequence number.

use std::collections::VecDeque;

use alight_shared::admission::RejectionReason;

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
    /// The first that was ever received.
    First,
    /// Never received before: a restart, or a message from before we began to listen.
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

/// The order of one kind of message within a boot.
#[derive(Clone, Copy, Debug, Default)]
pub struct SequenceOrder {
    newest: Option<u32>,
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
    /// `sequence` was admitted.
    pub fn admit(&mut self, sequence: u32) {
        self.newest = Some(sequence);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn superseded_boot() {
        let mut b = Boots::default();
        assert_eq!(b.classify(7), Boot::First);
        b.adopt(7);
        assert_eq!(b.classify(8), Boot::Unknown);
        b.adopt(8);
        assert_eq!((b.classify(7), b.classify(8)), (Boot::Retired, Boot::Current));
    }
}
