//! Sender of a message: the name in its key. Access control binds that name to the publisher's certificate.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::RejectionReason;
use crate::{
    time::{Clock, Time},
    wire::{self, WireError},
};

/// Publisher of a message by its key `alight/NAME/TOPIC`. The sender stated in the message must match it, so
/// that a certificate permits only messages under its own name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, JsonSchema, Serialize, Deserialize)]
pub enum Sender {
    /// `vessel-N`.
    Vessel(u32),
    /// `drone-N`.
    Drone(u32),
    /// `operator-N`.
    Operator(u32),
    /// Another name, or a key of another layout.
    #[default]
    Unknown,
}

impl Sender {
    /// Publisher of a message on this key.
    pub fn of_key(key: &str) -> Sender {
        let mut chunks = key.split('/');
        let root = chunks.next();
        let name = chunks.next().unwrap_or_default();
        let (kind, digits) = name.split_once('-').unwrap_or_default();
        // Only the canonical spelling of a number is accepted, without sign or leading zeros.
        let number = digits.parse().ok().filter(|n: &u32| n.to_string() == digits);
        match (root, kind, number) {
            (Some("alight"), "vessel", Some(n)) => Sender::Vessel(n),
            (Some("alight"), "drone", Some(n)) => Sender::Drone(n),
            (Some("alight"), "operator", Some(n)) => Sender::Operator(n),
            (_, _, _) => Sender::Unknown,
        }
    }
    /// Checks that a message with author `claimed` comes from this publisher.
    pub fn check(self, claimed: Sender) -> Result<(), RejectionReason> {
        if self == claimed {
            Ok(())
        } else {
            Err(RejectionReason::Sender)
        }
    }
}

/// Message received by radio.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(bound(serialize = "M: Serialize", deserialize = "M: Deserialize<'de>"))]
pub struct Arrival<C: Clock, M> {
    /// Time of arrival.
    pub at: Time<C>,
    /// Publisher that owns the key.
    pub sender: Sender,
    /// Content.
    pub message: M,
}

impl<C: Clock> Arrival<C, Vec<u8>> {
    /// The same arrival with its message decoded.
    pub fn decoded<M: DeserializeOwned>(&self) -> Result<Arrival<C, M>, WireError> {
        Ok(Arrival {
            at: self.at,
            sender: self.sender,
            message: wire::decode(&self.message)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sender_by_the_name_in_the_key() {
        for (key, sender) in [
            ("alight/drone-12/status", Sender::Drone(12)),
            ("alight/vessel-1/time/reply", Sender::Vessel(1)),
            ("alight/operator-3/command", Sender::Operator(3)),
            ("alight/drone-012/status", Sender::Unknown),
            ("alight/drone-+1/status", Sender::Unknown),
            ("alight/drone-$*/status", Sender::Unknown),
            ("alight/*/status", Sender::Unknown),
            ("alight/drone-4294967296/status", Sender::Unknown),
            ("other/drone-1/status", Sender::Unknown),
            ("alight", Sender::Unknown),
            ("", Sender::Unknown),
        ] {
            assert_eq!(Sender::of_key(key), sender, "{key}");
        }
        assert_eq!(
            Sender::Drone(2).check(Sender::Drone(1)),
            Err(RejectionReason::Sender)
        );
        assert_eq!(Sender::Drone(2).check(Sender::Drone(2)), Ok(()));
    }
}
