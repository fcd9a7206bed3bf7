//! Counted reasons of rejection.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

macro_rules! reasons {
    ($($(#[$doc:meta])* $reason:ident: $name:literal,)*) => {
        /// Reason for rejecting an input.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
        #[repr(u8)]
        pub enum RejectionReason { $($(#[$doc])* $reason,)* }

        impl RejectionReason {
            /// All reasons.
            pub const ALL: &[RejectionReason] = &[$(RejectionReason::$reason),*];

            /// Name used in messages.
            pub const fn name(self) -> &'static str {
                match self { $(RejectionReason::$reason => $name,)* }
            }
        }
    };
}
reasons! {
    /// Longer than any valid message.
    Oversized: "oversized",
    /// The bytes cannot be decoded.
    Malformed: "malformed",
    /// Another layout version.
    Version: "of another version",
    /// About another vessel.
    Vessel: "of another vessel",
    /// For another drone.
    Drone: "for another drone",
    /// From a superseded boot of the sender, or from an unknown one that is not proven newer.
    Boot: "of a former boot",
    /// Received before.
    Duplicate: "repeated",
    /// Older than one received before.
    OutOfOrder: "out of order",
    /// Time of validity too far in the past.
    Stale: "stale",
    /// Time of validity too far in the future.
    Future: "from the future",
    /// Clock offset unknown: the time of validity cannot be converted.
    NoClock: "before the clocks agreed",
    /// A number is not finite or physically implausible.
    OutOfRange: "out of range",
    /// Time reply that matches no pending request.
    Unsolicited: "unsolicited replies",
    /// Time reply with a round trip that is impossible or an outlier.
    RoundTrip: "impossible round trips",
    /// Drone state unknown at the message's time.
    NoDroneState: "without odometry of its time",
    /// Inconsistent with all other measurements.
    Outlier: "outliers",
    /// State reset because it was no longer finite.
    Diverged: "diverged",
    /// In excess of the messages that one step processes.
    Flood: "more than a step takes",
    /// Own output that failed its check.
    Withheld: "withheld outputs",
    /// The author does not own the key on which it published.
    Sender: "under a foreign key",
    /// Landing ordered without knowledge of an abort.
    Unaware: "unaware of an abort",
    /// From a second computer with the identity of the one in use.
    SecondSender: "of a second sender",
    /// Inertial sample identical to too many before it.
    Stuck: "of a stuck sensor",
}

/// Rejections since the start by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rejections([u32; RejectionReason::ALL.len()]);

impl Rejections {
    /// Counts one rejection.
    pub fn count(&mut self, reason: RejectionReason) {
        self.count_many(reason, 1);
    }
    /// Counts `number` rejections.
    pub fn count_many(&mut self, reason: RejectionReason, number: usize) {
        if let Some(n) = self.0.get_mut(reason as usize) {
            *n = n.saturating_add(u32::try_from(number).unwrap_or(u32::MAX));
        }
    }
    /// Rejections for `reason`.
    pub fn of(&self, reason: RejectionReason) -> u32 {
        self.0.get(reason as usize).copied().unwrap_or(0)
    }
    /// All rejections.
    pub fn total(&self) -> u32 {
        self.0.iter().fold(0, |a, b| a.saturating_add(*b))
    }
    /// Iterator over all reasons with their counts.
    pub fn iter(&self) -> impl Iterator<Item = (RejectionReason, u32)> + '_ {
        RejectionReason::ALL.iter().map(|r| (*r, self.of(*r)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rejection_counts_by_reason() {
        let mut r = Rejections::default();
        for (i, reason) in RejectionReason::ALL.iter().enumerate() {
            assert_eq!(*reason as usize, i);
            r.count(*reason);
            assert_eq!(r.of(*reason), 1);
        }
        assert_eq!(r.total(), RejectionReason::ALL.len() as u32);
        assert!(r.iter().all(|(_, n)| n == 1));
    }
}
