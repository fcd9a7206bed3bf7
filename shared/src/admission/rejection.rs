//! Reasons of rejection, counted.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

macro_rules! reasons {
    ($($(#[$doc:meta])* $reason:ident: $name:literal,)*) => {
        /// Why an input is not used.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
        #[repr(u8)]
        pub enum RejectionReason { $($(#[$doc])* $reason,)* }

        impl RejectionReason {
            /// Every reason.
            pub const ALL: &[RejectionReason] = &[$(RejectionReason::$reason),*];

            /// The name in messages.
            pub const fn name(self) -> &'static str {
                match self { $(RejectionReason::$reason => $name,)* }
            }
        }
    };
}
reasons! {
    /// Longer than any message.
    Oversized: "oversized",
    /// The bytes are not such a message.
    Malformed: "malformed",
    /// Another version of the layout.
    Version: "of another version",
    /// Another vessel's.
    Vessel: "of another vessel",
    /// For another drone.
    Drone: "for another drone",
    /// From a boot of the sender that has been superseded, or from an unknown one without proof that it
    /// is the newer.
    Boot: "of a former boot",
    /// Already had this one.
    Duplicate: "repeated",
    /// A newer one has come already.
    OutOfOrder: "out of order",
    /// The time of validity is too long ago.
    Stale: "stale",
    /// It claims to be valid later than its arrival allows.
    Future: "from the future",
    /// The clocks' offset is not known yet: its time of validity cannot be converted.
    NoClock: "before the clocks agreed",
    /// A number is not finite or outside what physics allows.
    OutOfRange: "out of range",
    /// A time reply that answers none of our open requests.
    Unsolicited: "unsolicited replies",
    /// A time reply with an impossible round trip, or one that contradicts all others.
    RoundTrip: "impossible round trips",
    /// The drone's place at the message's time is not known.
    NoDroneState: "without odometry of its time",
    /// Contradicts everything else.
    Outlier: "outliers",
    /// The state had to be given up because it was no longer finite.
    Diverged: "diverged",
    /// More than one step takes.
    Flood: "more than a step takes",
    /// An output of ours that failed its own check.
    Withheld: "withheld outputs",
    /// It names another author than the key that it was published on.
    Sender: "under a foreign key",
    /// A landing that was ordered without knowing of an abort.
    Unaware: "unaware of an abort",
    /// From a second computer with the identity of the one that is listened to.
    SecondSender: "of a second sender",
    /// An inertial sample with the very numbers of too many before it.
    Stuck: "of a stuck sensor",
}

/// Rejections since the start, per reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rejections([u32; RejectionReason::ALL.len()]);

impl Rejections {
    /// Counts one.
    pub fn count(&mut self, reason: RejectionReason) {
        self.count_many(reason, 1);
    }
    /// Counts so many.
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
    /// Every reason with its count.
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
