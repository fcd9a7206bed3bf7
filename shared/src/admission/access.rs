//! Reasons for which the radio rejects a peer.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reason for rejecting a peer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum AccessRejection {
    /// Session without a certificate.
    NoCertificate = 1,
    /// Certificate of another authority.
    OtherAuthority,
    /// Certificate expired or not valid yet.
    Expired,
    /// Stream without TLS.
    NotTls,
    /// Other failure of the handshake.
    Handshake,
    /// Valid certificate with a name that is not admitted.
    Name,
    /// Message on a key that does not belong to its publisher.
    Key,
}

impl AccessRejection {
    /// All reasons in the order of their numbers.
    pub const ALL: [AccessRejection; 7] = [
        AccessRejection::NoCertificate,
        AccessRejection::OtherAuthority,
        AccessRejection::Expired,
        AccessRejection::NotTls,
        AccessRejection::Handshake,
        AccessRejection::Name,
        AccessRejection::Key,
    ];
    /// Name used in messages.
    pub const fn name(self) -> &'static str {
        match self {
            AccessRejection::NoCertificate => "no certificate",
            AccessRejection::OtherAuthority => "a certificate of another authority",
            AccessRejection::Expired => "an expired certificate",
            AccessRejection::NotTls => "plain TCP, no TLS",
            AccessRejection::Handshake => "a failed handshake",
            AccessRejection::Name => "a name that is not admitted",
            AccessRejection::Key => "a key that is not the publisher's",
        }
    }
}
