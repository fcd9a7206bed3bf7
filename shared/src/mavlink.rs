//! MAVLink frames: bytes to payloads and back. No other module uses the MAVLink crate's reader and writer,
//! whose releases often break compatibility. Vessel and drone map payloads to their own messages.
//!
//! Extension fields of MAVLink 2 are read and written by offset ([`Fields`], [`Outgoing`]): the crate's
//! feature for them would add its code generator and more of its regular expressions to every program.

mod signing;

use core::convert::Infallible;
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read};

use ::mavlink::error::{MessageReadError, ParserError};
use ::mavlink::{
    Dialect, MAVLinkMessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkReader, MavlinkVersion, Message,
};

pub use ::mavlink::dialects::common as dialect;
pub use ::mavlink::types::CharArray;
pub use signing::{MAX_STREAMS, Signatures, Signing, SigningTimes, StreamTime};

/// `EKF_STATUS_REPORT`, the only message of ArduPilot's dialect that is read: number and CRC_EXTRA. Its whole
/// dialect is as large as the common one.
pub const EKF_STATUS_REPORT: (u32, u8) = (193, 71);

/// Common dialect and the ArduPilot messages that are read.
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
    pub fn message(&self) -> Option<dialect::MavMessage> {
        dialect::MavMessage::parse(self.version, self.id, &self.payload).ok()
    }
    /// Payload fields by offset.
    pub fn fields(&self) -> Fields<'_> {
        Fields(&self.payload)
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
    /// Selects messages, by number and payload, that are accepted with any signature time.
    whenever: Option<fn(u32, Fields<'_>) -> bool>,
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
    pub fn whenever(self, message: fn(u32, Fields<'_>) -> bool) -> FrameReader {
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
                    let whenever = self
                        .whenever
                        .is_some_and(|counts| counts(raw.message_id(), Fields(raw.payload())));
                    if !self.signatures.admit(&raw, self.signing.as_ref(), whenever) {
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

/// Payload fields by their offset in the message definition, little endian; omitted trailing zeros read as zero.
#[derive(Clone, Copy, Debug)]
pub struct Fields<'a>(pub &'a [u8]);

impl Fields<'_> {
    /// `N` bytes at offset `at`.
    pub fn bytes<const N: usize>(&self, at: usize) -> [u8; N] {
        core::array::from_fn(|k| self.0.get(at + k).copied().unwrap_or(0))
    }
    /// Unsigned 64-bit integer.
    pub fn u64(&self, at: usize) -> u64 {
        u64::from_le_bytes(self.bytes(at))
    }
    /// Unsigned 32-bit integer.
    pub fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.bytes(at))
    }
    /// Signed 32-bit integer.
    pub fn i32(&self, at: usize) -> f64 {
        i32::from_le_bytes(self.bytes(at)).into()
    }
    /// Unsigned 16-bit integer.
    pub fn u16(&self, at: usize) -> u16 {
        u16::from_le_bytes(self.bytes(at))
    }
    /// Signed 16-bit integer.
    pub fn i16(&self, at: usize) -> f64 {
        i16::from_le_bytes(self.bytes(at)).into()
    }
    /// Unsigned 8-bit integer.
    pub fn u8(&self, at: usize) -> u8 {
        let [b] = self.bytes(at);
        b
    }
    /// 32-bit float.
    pub fn float(&self, at: usize) -> f64 {
        f32::from_le_bytes(self.bytes(at)).into()
    }
    /// Consecutive 32-bit floats.
    pub fn floats<const N: usize>(&self, at: usize) -> [f64; N] {
        core::array::from_fn(|k| self.float(at + 4 * k))
    }
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
        payload
            .iter_mut()
            .zip(&message.payload)
            .for_each(|(to, b)| *to = *b);
        Ok(message.payload.len().min(payload.len()))
    }
}

/// Bytes of a frame, signed if a key is set; empty for a message number unknown to MAVLink.
pub fn encode(from: MavlinkSender, message: impl Into<Outgoing>, signing: Option<&Signing>) -> Vec<u8> {
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
        signing.sign(&mut raw);
    }
    raw.raw_bytes().to_vec()
}
