//! MAVLink frames: bytes to payloads and back. No other module uses the MAVLink crate's reader and writer,
//! whose releases often break compatibility. Vessel and drone use its messages ([`dialect`]).

mod signing;

use core::convert::Infallible;
use std::{
    collections::VecDeque,
    io::{self, ErrorKind, Read},
};

use ::mavlink::{
    Dialect, MAVLinkMessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkReader, MavlinkVersion,
    error::{MessageReadError, ParserError},
};
use dialect::{EstimatorStatusFlags, MavMessage};

use crate::geodesy::Datum;

pub use ::mavlink::{Message, MessageData, dialects::common as dialect, types::CharArray};
pub use signing::{MAX_STREAMS, Signatures, Signing, SigningTimes, StreamTime};

/// Number of `EKF_STATUS_REPORT`, the only message of ArduPilot's dialect that is read. Its whole dialect is as large as
/// the common one.
pub const EKF_STATUS_REPORT: u32 = 193;
/// CRC_EXTRA of `EKF_STATUS_REPORT`.
const EKF_STATUS_CRC: u8 = 71;

/// Common dialect and the ArduPilot messages that are read.
struct Known;

impl Dialect for Known {
    type Message = MavMessage;
    type EncodeError = Infallible;
    fn message_id(&self, message: &Self::Message) -> u32 {
        message.message_id()
    }
    fn extra_crc(&self, id: u32) -> Option<u8> {
        Some(match id {
            EKF_STATUS_REPORT => EKF_STATUS_CRC,
            _ => MavMessage::extra_crc(id),
        })
    }
    fn decode(&self, version: MavlinkVersion, id: u32, payload: &[u8]) -> Result<MavMessage, ParserError> {
        MavMessage::parse(version, id, payload)
    }
    fn encode(
        &self,
        version: MavlinkVersion,
        message: &MavMessage,
        payload: &mut [u8],
    ) -> Result<usize, Infallible> {
        Ok(message.ser(version, payload))
    }
}

/// Maximum number of bytes waiting to be decoded; any excess is lost, as on a saturated link.
pub const MAX_WAITING: usize = 1 << 16;

/// Bytes ready to be read; `WouldBlock` when empty.
#[derive(Debug, Default)]
struct Waiting(VecDeque<u8>);

impl Read for Waiting {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // One byte at a time: the reader buffers nothing beyond a frame, and bytes in between can be counted.
        match (buffer.first_mut(), self.0.pop_front()) {
            (Some(to), Some(byte)) => {
                *to = byte;
                Ok(1)
            }
            _ => Err(ErrorKind::WouldBlock.into()),
        }
    }
}

/// Frame with a valid checksum.
#[derive(Clone, Debug, PartialEq)]
pub struct RawFrame {
    /// System of the sender.
    pub system: u32,
    /// Component of the sender.
    pub component: u8,
    /// Number of the message.
    pub id: u32,
    /// Payload; MAVLink 2 omits trailing zeros.
    pub payload: Vec<u8>,
    version: MavlinkVersion,
}

impl RawFrame {
    /// Decoded message; None if a value is not part of the dialect.
    pub fn message(&self) -> Option<MavMessage> {
        MavMessage::parse(self.version, self.id, &self.payload).ok()
    }
    /// Flags of `EKF_STATUS_REPORT`; None for other messages.
    pub fn ekf_status(&self) -> Option<EstimatorStatusFlags> {
        if self.id != EKF_STATUS_REPORT {
            return None;
        }
        // After five floats; trailing zeros are omitted.
        let byte = |at: usize| self.payload.get(at).copied().unwrap_or(0);
        let bits = u16::from_le_bytes([byte(20), byte(21)]);
        Some(EstimatorStatusFlags::from_bits_retain(bits))
    }
}

/// Frames from a byte stream that is cut at arbitrary points.
pub struct FrameReader {
    reader: MavlinkReader<Waiting>,
    /// Bytes received and bytes of complete frames; the difference is the number of damaged bytes.
    taken: u64,
    whole: u64,
    lost: u64,
    unreadable: u64,
    gaps: u64,
    signing: Option<Signing>,
    signatures: Signatures,
    /// Selects messages that are accepted with any signature time.
    whenever: Option<fn(&MavMessage) -> bool>,
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
            whenever: None,
        }
    }
}

impl FrameReader {
    /// Reader that requires signed frames if a key is set.
    pub fn signed(signing: Option<Signing>) -> FrameReader {
        FrameReader {
            signing,
            ..FrameReader::default()
        }
    }
    /// Accepts messages selected by `message` with any signature time, to tolerate a wrong clock or a replay.
    #[must_use]
    pub fn whenever(self, message: fn(&MavMessage) -> bool) -> FrameReader {
        FrameReader {
            whenever: Some(message),
            ..self
        }
    }
    /// Appends received bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        let waiting = &mut self.reader.get_mut().0;
        let taken = bytes.len().min(MAX_WAITING.saturating_sub(waiting.len()));
        waiting.extend(bytes.iter().take(taken));
        self.taken += taken as u64;
        self.lost += (bytes.len() - taken) as u64;
    }
    /// Next frame; None until more bytes arrive.
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
                        // Invalid bytes before a frame count as one damaged stretch.
                        self.gaps += 1;
                        self.whole = gone;
                    }
                    let frame = RawFrame {
                        system: raw.system_id(),
                        component: raw.component_id(),
                        id: raw.message_id(),
                        payload: raw.payload().to_vec(),
                        version: raw.version(),
                    };
                    let whenever = || {
                        let message = self.whenever.zip(frame.message());
                        message.is_some_and(|(counts, message)| counts(&message))
                    };
                    if self.signatures.admit(&raw, self.signing.as_ref(), whenever) {
                        return Some(frame);
                    }
                }
                Err(MessageReadError::Parse(_)) => self.unreadable += 1,
                Err(MessageReadError::Io(_)) => return None,
            }
        }
    }
    /// Number of bytes waiting.
    pub fn waiting(&self) -> usize {
        self.reader.get_ref().0.len()
    }
    /// Number of bytes lost because they were not read in time.
    pub fn lost(&self) -> u64 {
        self.lost
    }
    /// Number of frames that could not be read.
    pub fn unreadable(&self) -> u64 {
        self.unreadable
    }
    /// Counts of frames by signature.
    pub fn signatures(&self) -> Signatures {
        self.signatures
    }
    /// Number of stretches of invalid bytes between frames.
    pub fn gaps(&self) -> u64 {
        self.gaps
    }
}

/// Recorded form of a message: its number and payload.
pub mod recorded {
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};

    use super::{MavMessage, MavlinkVersion, Message, Outgoing};

    /// Writes number and payload.
    ///
    /// # Errors
    /// Those of the serialiser.
    pub fn serialize<S: Serializer>(message: &MavMessage, to: S) -> Result<S::Ok, S::Error> {
        let Outgoing { id, payload, .. } = Outgoing::from(message);
        (id, payload).serialize(to)
    }
    /// Reads number and payload.
    ///
    /// # Errors
    /// Those of the deserialiser, and a number or value that is not part of the dialect.
    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<MavMessage, D::Error> {
        let (id, payload) = <(u32, Vec<u8>)>::deserialize(from)?;
        MavMessage::parse(MavlinkVersion::V2, id, &payload).map_err(D::Error::custom)
    }
}

/// Array of a message's fields, to be read or assigned: `fields!(d, x y z)` is `[d.x, d.y, d.z]`.
#[macro_export]
macro_rules! mavlink_fields {
    ($message:ident, $($field:ident)+) => { [$($message.$field),+] };
}
pub use mavlink_fields as fields;

/// Place from units of 1e-7 deg and mm.
pub fn place(latitude: i32, longitude: i32, height: i32) -> Datum {
    Datum::new(
        f64::from(latitude) * 1e-7,
        f64::from(longitude) * 1e-7,
        f64::from(height) * 1e-3,
    )
}

/// Sender of a frame with its frame counter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MavlinkSender {
    /// System id.
    pub system: u8,
    /// Component id.
    pub component: u8,
    /// Sequence number of the frame.
    pub sequence: u8,
}

impl From<MavlinkSender> for MavHeader {
    fn from(s: MavlinkSender) -> MavHeader {
        MavHeader {
            system_id: s.system.into(),
            component_id: s.component,
            sequence: s.sequence,
        }
    }
}

/// Message to send: number, CRC_EXTRA and payload.
pub struct Outgoing {
    id: u32,
    crc: u8,
    payload: Vec<u8>,
}

impl Outgoing {
    /// Message `id` with CRC_EXTRA `crc` and this payload, without trailing zeros.
    pub fn new(id: u32, crc: u8, mut payload: Vec<u8>) -> Outgoing {
        // MAVLink 2 keeps the first byte even if it is zero.
        payload.truncate(payload.iter().rposition(|b| *b != 0).map_or(1, |k| k + 1));
        Outgoing { id, crc, payload }
    }
    /// `EKF_STATUS_REPORT` with these flags.
    pub fn ekf_status(flags: EstimatorStatusFlags) -> Outgoing {
        Outgoing::new(
            EKF_STATUS_REPORT,
            EKF_STATUS_CRC,
            [&[0; 20][..], &flags.bits().to_le_bytes()].concat(),
        )
    }
}

impl From<&MavMessage> for Outgoing {
    fn from(message: &MavMessage) -> Outgoing {
        let mut payload = vec![0; 255];
        let length = message.ser(MavlinkVersion::V2, &mut payload);
        payload.truncate(length);
        let id = message.message_id();
        Outgoing::new(id, MavMessage::extra_crc(id), payload)
    }
}

/// Message already encoded as number and payload.
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
        for (to, b) in payload.iter_mut().zip(&message.payload) {
            *to = *b;
        }
        Ok(message.payload.len().min(payload.len()))
    }
}

/// Bytes of a frame, signed if a key is set; empty for a message number unknown to MAVLink.
pub fn encode(from: MavlinkSender, message: impl Into<Outgoing>, signing: Option<&Signing>) -> Vec<u8> {
    let message = message.into();
    let mut raw = MAVLinkV2MessageRaw::new();
    let dialect = Bytes(message.crc);
    let encoded = match signing {
        Some(_) => raw.serialize_message_with_dialect_for_signing(from.into(), &dialect, &message),
        None => raw.serialize_message_with_dialect(from.into(), &dialect, &message),
    };
    if encoded.is_err() {
        return Vec::new();
    }
    if let Some(signing) = signing {
        signing.sign(&mut raw);
    }
    raw.raw_bytes().to_vec()
}
