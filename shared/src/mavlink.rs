//! MAVLink frames: bytes to payloads and back. The one user of the MAVLink crate's reader and writer, whose
//! releases break often; vessel and drone map payloads to their own messages.
//!
//! MAVLink 2's extension fields are read and written by their place in the payload ([`Fields`],
//! [`Outgoing`]): the crate's own feature for them would bring its code generator, and default
//! features of the regular expressions in it, into every program.

use core::convert::Infallible;
use core::fmt;
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read};
use std::sync::Arc;

use ::mavlink::error::{MessageReadError, ParserError};
use ::mavlink::{
    Dialect, MAVLinkMessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkReader, MavlinkVersion, Message,
    SigningConfig, SigningData,
};

pub use ::mavlink::dialects::common as dialect;
pub use ::mavlink::types::CharArray;

/// `EKF_STATUS_REPORT` of ArduPilot's own dialect, the one message of it that is read: its number and its definition's check
/// byte. The whole dialect would be as large again as the common one.
pub const EKF_STATUS_REPORT: (u32, u8) = (193, 71);

/// The common dialect, and what of ArduPilot's is read.
struct Known;

impl Dialect for Known {
    type Message = dialect::MavMessage;
    type EncodeError = Infallible;
    fn message_id(&self, message: &Self::Message) -> u32 {
        message.message_id()
    }
    fn extra_crc(&self, id: u32) -> Option<u8> {
        let (own, crc) = EKF_STATUS_REPORT;
        Some(if id == own {
            crc
        } else {
            dialect::MavMessage::extra_crc(id)
        })
    }
    fn decode(
        &self,
        version: MavlinkVersion,
        id: u32,
        payload: &[u8],
    ) -> Result<dialect::MavMessage, ParserError> {
        dialect::MavMessage::parse(version, id, payload)
    }
    fn encode(
        &self,
        version: MavlinkVersion,
        message: &dialect::MavMessage,
        payload: &mut [u8],
    ) -> Result<usize, Infallible> {
        Ok(message.ser(version, payload))
    }
}

/// `RADIO_STATUS`: telemetry radios insert it themselves, unsigned, into a link that is signed.
const RADIO_STATUS: u32 = 109;
/// Incompatibility flag of a signed frame.
const SIGNED: u8 = 1;

/// Signing of MAVLink 2 frames with one key: ours are signed, and of others only those are taken that the same key signed,
/// later than the ones before (<https://mavlink.io/en/guide/message_signing.html>). Timestamps are this computer's time or
/// the latest that was received, whichever is later, so that a computer whose clock is behind speaks to an autopilot whose
/// clock is right.
#[derive(Clone)]
pub struct Signing {
    key: [u8; 32],
    link: Arc<SigningData>,
    any_time: bool,
}

impl fmt::Debug for Signing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Signing")
    }
}

impl Signing {
    /// With this key.
    pub fn new(key: [u8; 32]) -> Signing {
        let config = SigningConfig::new(key, 0, true, false);
        Signing {
            key,
            link: Arc::new(SigningData::from_config(config)),
            any_time: false,
        }
    }
    /// The same key, for frames stamped at whatever time: of an autopilot that learns the time from our answers.
    #[must_use]
    pub fn at_any_time(&self) -> Signing {
        Signing {
            any_time: true,
            ..self.clone()
        }
    }
    /// Whether the key signed it, at whatever time.
    fn is_signature(&self, frame: &MAVLinkV2MessageRaw) -> bool {
        let mut signature = [0; 6];
        frame.calculate_signature(&self.key, &mut signature);
        frame.signature_value() == signature
    }
}

/// Frames by their signatures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Signatures {
    /// Left out because nobody signed them, though a key is set.
    pub unsigned: u64,
    /// Left out because another key signed them.
    pub other_key: u64,
    /// Left out because they were sent before, or stamped more than a minute before our time.
    pub old: u64,
    /// Taken without looking at the signature, because no key is set.
    pub unchecked: u64,
}

impl Signatures {
    /// The sum of both.
    #[must_use]
    pub fn plus(self, other: Signatures) -> Signatures {
        Signatures {
            unsigned: self.unsigned + other.unsigned,
            other_key: self.other_key + other.other_key,
            old: self.old + other.old,
            unchecked: self.unchecked + other.unchecked,
        }
    }
    /// What is wrong with the signatures of a link, and its remedy; None where all are as configured.
    pub fn finding(&self) -> Option<(String, &'static str)> {
        let (count, found, remedy) = if self.other_key > 0 {
            (
                self.other_key,
                "left out: another key than signing_key's signed them",
                "give the autopilot and signing_key's file the same passphrase",
            )
        } else if self.old > 0 {
            (
                self.old,
                "left out: sent before, or stamped over a minute before our time",
                "set this computer's clock, and let the autopilot have a GNSS fix",
            )
        } else if self.unsigned > 0 {
            (
                self.unsigned,
                "left out: not signed, and signing_key demands it",
                "set up signing at the autopilot for this link (ArduPilot; PX4 had none in March 2026), or empty signing_key",
            )
        } else {
            (
                self.unchecked,
                "signed, and neither checked nor answered with a signature",
                "set signing_key to a file with the autopilot's passphrase",
            )
        };
        (count > 0).then(|| (format!("{count} MAVLink frames {found}"), remedy))
    }
    /// Whether this frame is taken.
    fn admit(&mut self, raw: &MAVLinkMessageRaw, signing: Option<&Signing>) -> bool {
        let signed = match raw {
            MAVLinkMessageRaw::V1(_) => None,
            MAVLinkMessageRaw::V2(frame) => Some(frame).filter(|f| f.incompatibility_flags() & SIGNED != 0),
        };
        let (count, taken) = match (signing, signed) {
            (None, None) => return true,
            (None, Some(_)) => (&mut self.unchecked, true),
            (Some(_), None) if raw.message_id() == RADIO_STATUS => return true,
            (Some(_), None) => (&mut self.unsigned, false),
            (Some(s), Some(frame)) if !s.is_signature(frame) => (&mut self.other_key, false),
            (Some(s), Some(frame)) if !s.any_time && !s.link.verify_signature(frame) => {
                (&mut self.old, false)
            }
            (Some(_), Some(_)) => return true,
        };
        *count += 1;
        taken
    }
}

/// Bytes that wait to be decoded, at most; what comes beyond is lost, as it is on a full wire.
pub const MAX_WAITING: usize = 1 << 16;

/// What is there to read; `WouldBlock` when nothing is.
#[derive(Debug, Default)]
struct Waiting(VecDeque<u8>);

impl Read for Waiting {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // One at a time: the reader then holds nothing back after a whole frame, and what lies between
        // two frames can be counted.
        match (buffer.first_mut(), self.0.pop_front()) {
            (Some(to), Some(byte)) => {
                *to = byte;
                Ok(1)
            }
            _ => Err(ErrorKind::WouldBlock.into()),
        }
    }
}

/// A frame whose checksum is right.
#[derive(Clone, Debug, PartialEq)]
pub struct RawFrame {
    /// Sender's system.
    pub system: u32,
    /// Sender's component.
    pub component: u8,
    /// Number of the message.
    pub id: u32,
    /// Its payload; MAVLink 2 leaves out zeros at the end.
    pub payload: Vec<u8>,
    version: MavlinkVersion,
}

impl RawFrame {
    /// In the dialect's words; None when a value is not of the dialect.
    pub fn message(&self) -> Option<dialect::MavMessage> {
        dialect::MavMessage::parse(self.version, self.id, &self.payload).ok()
    }
    /// Its fields by place.
    pub fn fields(&self) -> Fields<'_> {
        Fields(&self.payload)
    }
}

/// Frames from a stream of bytes, however it is cut.
pub struct FrameReader {
    reader: MavlinkReader<Waiting>,
    /// Bytes taken in and bytes of whole frames: what lies between is damage.
    taken: u64,
    whole: u64,
    lost: u64,
    unreadable: u64,
    gaps: u64,
    signing: Option<Signing>,
    signatures: Signatures,
}

impl Default for FrameReader {
    fn default() -> Self {
        FrameReader {
            reader: MavlinkReader::new(Waiting::default()),
            taken: 0,
            whole: 0,
            lost: 0,
            unreadable: 0,
            gaps: 0,
            signing: None,
            signatures: Signatures::default(),
        }
    }
}

impl FrameReader {
    /// Of frames that are signed, where a key is set.
    pub fn signed(signing: Option<Signing>) -> FrameReader {
        FrameReader {
            signing,
            ..FrameReader::default()
        }
    }
    /// Takes bytes in.
    pub fn push(&mut self, bytes: &[u8]) {
        let waiting = &mut self.reader.get_mut().0;
        let taken = bytes.len().min(MAX_WAITING.saturating_sub(waiting.len()));
        waiting.extend(bytes.iter().take(taken));
        self.taken += taken as u64;
        self.lost += (bytes.len() - taken) as u64;
    }
    /// The next frame; None until more bytes are there.
    pub fn next_frame(&mut self) -> Option<RawFrame> {
        loop {
            match self.reader.read_any_raw_message_with_dialect(&Known) {
                Ok(raw) => {
                    let length = match &raw {
                        MAVLinkMessageRaw::V1(r) => r.raw_bytes().len(),
                        MAVLinkMessageRaw::V2(r) => r.raw_bytes().len(),
                    };
                    self.whole += length as u64;
                    let gone = self.taken - self.waiting() as u64;
                    if gone > self.whole {
                        // Bytes before it that were no frame: one stretch of damage.
                        self.gaps += 1;
                        self.whole = gone;
                    }
                    if !self.signatures.admit(&raw, self.signing.as_ref()) {
                        continue;
                    }
                    return Some(RawFrame {
                        system: raw.system_id(),
                        component: raw.component_id(),
                        id: raw.message_id(),
                        payload: raw.payload().to_vec(),
                        version: raw.version(),
                    });
                }
                Err(MessageReadError::Parse(_)) => self.unreadable += 1,
                Err(MessageReadError::Io(_)) => return None,
            }
        }
    }
    /// Bytes that wait.
    pub fn waiting(&self) -> usize {
        self.reader.get_ref().0.len()
    }
    /// Bytes lost because nobody read.
    pub fn lost(&self) -> u64 {
        self.lost
    }
    /// Frames that the reader gave up.
    pub fn unreadable(&self) -> u64 {
        self.unreadable
    }
    /// Frames by their signatures.
    pub fn signatures(&self) -> Signatures {
        self.signatures
    }
    /// Stretches of bytes between frames that were no frame.
    pub fn gaps(&self) -> u64 {
        self.gaps
    }
}

/// Fields of a payload by their place in the message definition, little endian; zero where MAVLink 2 left
/// out zeros.
#[derive(Clone, Copy, Debug)]
pub struct Fields<'a>(pub &'a [u8]);

impl Fields<'_> {
    /// `N` bytes at `at`.
    pub fn bytes<const N: usize>(&self, at: usize) -> [u8; N] {
        core::array::from_fn(|k| self.0.get(at + k).copied().unwrap_or(0))
    }
    /// An unsigned number of 64 bits.
    pub fn u64(&self, at: usize) -> u64 {
        u64::from_le_bytes(self.bytes(at))
    }
    /// An unsigned number of 32 bits.
    pub fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.bytes(at))
    }
    /// A number of 32 bits.
    pub fn i32(&self, at: usize) -> f64 {
        i32::from_le_bytes(self.bytes(at)).into()
    }
    /// An unsigned number of 16 bits.
    pub fn u16(&self, at: usize) -> u16 {
        u16::from_le_bytes(self.bytes(at))
    }
    /// A number of 16 bits.
    pub fn i16(&self, at: usize) -> f64 {
        i16::from_le_bytes(self.bytes(at)).into()
    }
    /// A byte.
    pub fn u8(&self, at: usize) -> u8 {
        let [b] = self.bytes(at);
        b
    }
    /// A float.
    pub fn float(&self, at: usize) -> f64 {
        f32::from_le_bytes(self.bytes(at)).into()
    }
    /// Floats in a row.
    pub fn floats<const N: usize>(&self, at: usize) -> [f64; N] {
        core::array::from_fn(|k| self.float(at + 4 * k))
    }
}

/// Who sends a frame; `sequence` counts frames of this sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sender {
    /// System.
    pub system: u8,
    /// Component.
    pub component: u8,
    /// Number of the frame.
    pub sequence: u8,
}

impl From<Sender> for MavHeader {
    fn from(s: Sender) -> MavHeader {
        MavHeader {
            system_id: s.system.into(),
            component_id: s.component,
            sequence: s.sequence,
        }
    }
}

/// A message to be sent: its number, its definition's check byte, its payload.
pub struct Outgoing {
    id: u32,
    crc: u8,
    payload: Vec<u8>,
}

impl Outgoing {
    /// Message `id`, whose definition has the check byte `crc`, with this payload; its zeros at the end are left out.
    pub fn new(id: u32, crc: u8, mut payload: Vec<u8>) -> Outgoing {
        // All but those of the first byte, as MAVLink 2 has it.
        payload.truncate(payload.iter().rposition(|b| *b != 0).map_or(1, |k| k + 1));
        Outgoing { id, crc, payload }
    }
}

impl From<&dialect::MavMessage> for Outgoing {
    fn from(message: &dialect::MavMessage) -> Outgoing {
        let mut payload = vec![0; 255];
        let length = message.ser(MavlinkVersion::V2, &mut payload);
        payload.truncate(length);
        let id = message.message_id();
        Outgoing::new(id, dialect::MavMessage::extra_crc(id), payload)
    }
}

/// Messages by number and payload.
struct Bytes(u8);

impl Dialect for Bytes {
    type Message = Outgoing;
    type EncodeError = Infallible;
    fn message_id(&self, message: &Outgoing) -> u32 {
        message.id
    }
    fn extra_crc(&self, _: u32) -> Option<u8> {
        Some(self.0)
    }
    fn decode(&self, _: MavlinkVersion, id: u32, payload: &[u8]) -> Result<Outgoing, ParserError> {
        Ok(Outgoing::new(id, self.0, payload.to_vec()))
    }
    fn encode(&self, _: MavlinkVersion, message: &Outgoing, payload: &mut [u8]) -> Result<usize, Infallible> {
        payload
            .iter_mut()
            .zip(&message.payload)
            .for_each(|(to, b)| *to = *b);
        Ok(message.payload.len().min(payload.len()))
    }
}

/// The bytes of a frame, signed where a key is set; none of a number that MAVLink does not have.
pub fn encode(from: Sender, message: impl Into<Outgoing>, signing: Option<&Signing>) -> Vec<u8> {
    let message = message.into();
    let (mut raw, dialect) = (MAVLinkV2MessageRaw::new(), Bytes(message.crc));
    let encoded = match signing {
        Some(_) => raw.serialize_message_with_dialect_for_signing(from.into(), &dialect, &message),
        None => raw.serialize_message_with_dialect(from.into(), &dialect, &message),
    };
    if encoded.is_err() {
        return Vec::new();
    }
    if let Some(signing) = signing {
        signing.link.sign_message(&mut raw);
    }
    raw.raw_bytes().to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SENDER: Sender = Sender {
        system: 1,
        component: 1,
        sequence: 7,
    };

    fn heartbeat(signing: Option<&Signing>) -> Vec<u8> {
        encode(
            SENDER,
            Outgoing::new(0, 50, vec![3, 0, 0, 0, 2, 12, 81, 4, 3]),
            signing,
        )
    }
    /// How many of these frames a link with this key takes, and what became of the others.
    fn taken(signing: Option<Signing>, frames: &[Vec<u8>]) -> (usize, Signatures) {
        let mut reader = FrameReader::signed(signing);
        frames.iter().for_each(|bytes| reader.push(bytes));
        let taken = core::iter::from_fn(|| reader.next_frame()).count();
        (taken, reader.signatures())
    }

    #[test]
    fn frames_by_their_signatures() {
        let [ours, other] = [[1; 32], [2; 32]].map(Signing::new);
        let [signed, later] = [(); 2].map(|()| heartbeat(Some(&ours)));
        let mut changed = heartbeat(Some(&ours));
        // The signature alone, which the checksum does not cover.
        *changed.last_mut().unwrap() ^= 1;
        let frames = [
            signed.clone(),
            later,
            signed,
            heartbeat(None),
            heartbeat(Some(&other)),
            changed,
        ];
        let counts = Signatures {
            unsigned: 1,
            other_key: 2,
            old: 1,
            unchecked: 0,
        };
        assert_eq!(taken(Some(Signing::new([1; 32])), &frames), (2, counts));
        let unchecked = Signatures {
            unchecked: 5,
            ..Signatures::default()
        };
        assert_eq!(taken(None, &frames), (6, unchecked));
    }

    #[test]
    fn status_of_a_radio_in_a_signed_link() {
        let status = encode(SENDER, Outgoing::new(RADIO_STATUS, 185, vec![1; 9]), None);
        assert_eq!(taken(Some(Signing::new([1; 32])), &[status]).0, 1);
    }

    /// Computed outside, by the specification: SHA-256 of key, frame, link and timestamp, its first six bytes.
    #[test]
    fn signature_by_the_specification() {
        let frame = "fd 09 01 00 00 01 01 00 00 00 03 00 00 00 02 0c 51 04 03 95 f8 00 00 00 00 00 00 80 b3 8d 25 8d 8d ca";
        let frame = frame
            .split(' ')
            .map(|b| u8::from_str_radix(b, 16).unwrap())
            .collect();
        assert_eq!(
            taken(Some(Signing::new([0x42; 32])), &[frame]),
            (1, Signatures::default())
        );
    }

    /// A computer whose clock is behind: its frames are stamped after those that it received.
    #[test]
    fn timestamp_after_the_latest_received() {
        let (autopilot, ours) = (Signing::new([1; 32]), Signing::new([1; 32]));
        // Ahead of every clock.
        let mut ahead = MAVLinkV2MessageRaw::new();
        let message = Outgoing::new(0, 50, vec![3; 9]);
        ahead
            .serialize_message_with_dialect_for_signing(SENDER.into(), &Bytes(50), &message)
            .unwrap();
        *ahead.signature_timestamp_bytes_mut().last_mut().unwrap() = 0x7f;
        let mut signature = [0; 6];
        ahead.calculate_signature(&[1; 32], &mut signature);
        ahead.signature_value_mut().copy_from_slice(&signature);
        let ahead = ahead.raw_bytes().to_vec();
        let of_ours = || {
            let companion = Sender {
                component: 191,
                ..SENDER
            };
            encode(companion, Outgoing::new(0, 50, vec![3; 9]), Some(&ours))
        };
        let before = of_ours();
        assert_eq!(taken(Some(ours.clone()), core::slice::from_ref(&ahead)).0, 1);
        // The autopilot has stamped as late, and takes nothing that is older by a minute.
        let frames = [ahead, before, of_ours()];
        assert_eq!(taken(Some(autopilot), &frames).0, 2);
    }
}
