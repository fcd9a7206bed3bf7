//! MAVLink frames: bytes to payloads and back. The one user of the MAVLink crate's reader and writer, whose
//! releases break often; vessel and drone map payloads to their own messages.
//!
//! MAVLink 2's extension fields are read and written by their place in the payload ([`Fields`],
//! [`Outgoing`]): the crate's own feature for them would bring its code generator, and default
//! features of the regular expressions in it, into every program.

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

/// Bytes that wait to be decoded, at most; what comes beyond is lost, as it is on a full wire.
pub const MAX_WAITING: usize = 1 << 16;

/// Bytes that are there to read; `WouldBlock` when nothing is.
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
    /// Payload; MAVLink 2 leaves out zeros at the end.
    pub payload: Vec<u8>,
    version: MavlinkVersion,
}

impl RawFrame {
    /// The frame as a message of the dialect; None when a value is not of the dialect.
    pub fn message(&self) -> Option<dialect::MavMessage> {
        dialect::MavMessage::parse(self.version, self.id, &self.payload).ok()
    }
    /// Fields by their place.
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
    /// Messages that count whenever they were signed, by number and payload.
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
    /// A reader of frames that are signed, where a key is set.
    pub fn signed(signing: Option<Signing>) -> FrameReader {
        FrameReader {
            signing,
            ..FrameReader::default()
        }
    }
    /// A reader of which those messages are taken whenever they were signed: no clock stops them, nor does it that they
    /// may be sent again by somebody else.
    #[must_use]
    pub fn whenever(self, message: fn(u32, Fields<'_>) -> bool) -> FrameReader {
        FrameReader {
            whenever: Some(message),
            ..self
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
    /// Bytes that wait.
    pub fn waiting(&self) -> usize {
        self.reader.get_ref().0.len()
    }
    /// Number of bytes lost because they were not read in time.
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
pub struct MavlinkSender {
    /// System.
    pub system: u8,
    /// Component.
    pub component: u8,
    /// Number of the frame.
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
