//! Why the radio rejected a peer.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Why a peer was rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum AccessRejection {
    /// A session without a certificate.
    NoCertificate = 1,
    /// A certificate of another authority.
    OtherAuthority,
    /// An expired certificate, or one not yet valid.
    Expired,
    /// A stream without TLS.
    NotTls,
    /// Another failure of the handshake.
    Handshake,
    /// A good certificate whose name is not among our peers.
    Name,
    /// A peer's message on a key that is not its own.
    Key,
}

impl AccessRejection {
    /// All, in the order of their numbers.
    pub const ALL: [AccessRejection; 7] = [
        AccessRejection::NoCertificate,
        AccessRejection::OtherAuthority,
        AccessRejection::Expired,
        AccessRejection::NotTls,
        AccessRejection::Handshake,
        AccessRejection::Name,
        AccessRejection::Key,
    ];
    /// Name of the access for messages.
    pub const fn name(self) -> &'static str {
        match self {
            AccessRejection::NoCertificate => "no certificate",
            AccessRejection::OtherAuthority => "a certificate of another authority",
            AccessRejection::Expired => "an expired certificate",
            AccessRejection::NotTls => "plain TCP, no TLS",
            AccessRejection::Handshake => "a failed handshake",
            AccessRejection::Name => "a name that is not admitted",
            AccessRejection::Key => "a key that is not the speaker's",
        }
    }
}
