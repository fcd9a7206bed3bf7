//! Bytes: the one place that knows the MAVLink crate. [`encode`] and [`Decoder`] turn [`Message`]s into
//! MAVLink 2 frames and back, in both directions, so that a test or the simulated world can be the
//! other end. Neither ever panics on what arrives; a frame that is damaged, unknown or out of this
//! vocabulary is counted and passed over.
//!
//! MAVLink 2's extension fields are read and written here by their place in the payload, for the few
//! that matter: the crate's own feature for them would bring its code generator, and default features
//! of the regular expressions in it, into every program.

mod decode;
mod encode;
mod extension;

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read};

use mavlink::dialects::common as m;
use mavlink::error::MessageReadError;
use mavlink::types::CharArray;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkReader, Message as _};

use super::message::{Address, Frame, Message};
use extension::Extended;

/// Bytes that wait to be decoded, at most; what comes beyond is lost, as it is on a full wire.
const MAX_BUFFERED: usize = 1 << 16;

/// What is there to read; `WouldBlock` when nothing is.
#[derive(Debug, Default)]
struct ByteBuffer(VecDeque<u8>);

impl Read for ByteBuffer {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.0.read(buffer) {
            Ok(0) => Err(ErrorKind::WouldBlock.into()),
            other => other,
        }
    }
}

/// Frames from a stream of bytes, however it is cut.
pub struct Decoder {
    reader: MavlinkReader<ByteBuffer>,
    lost: u64,
    ignored: u64,
}

impl Default for Decoder {
    fn default() -> Self {
        Decoder {
            reader: MavlinkReader::new(ByteBuffer::default()),
            lost: 0,
            ignored: 0,
        }
    }
}

impl Decoder {
    /// Takes bytes in.
    pub fn push(&mut self, bytes: &[u8]) {
        let waiting = &mut self.reader.get_mut().0;
        let room = MAX_BUFFERED.saturating_sub(waiting.len());
        let taken = bytes.len().min(room);
        waiting.extend(bytes.iter().take(taken));
        self.lost += (bytes.len() - taken) as u64;
    }
    /// The next frame of this vocabulary; None until more bytes are there.
    pub fn next_frame(&mut self) -> Option<Frame> {
        loop {
            match self.reader.read_any_raw_message::<m::MavMessage>() {
                Ok(raw) => {
                    let from = u8::try_from(raw.system_id()).ok().map(|system| Address {
                        system,
                        component: raw.component_id(),
                    });
                    let (id, payload) = (raw.message_id(), raw.payload());
                    let message = extension::read(id, payload).or_else(|| {
                        let message = m::MavMessage::parse(raw.version(), id, payload).ok()?;
                        decode::decode(message, payload)
                    });
                    if let (Some(from), Some(message)) = (from, message) {
                        return Some(Frame { from, message });
                    }
                    self.ignored += 1;
                }
                Err(MessageReadError::Parse(_)) => self.ignored += 1,
                Err(MessageReadError::Io(_)) => return None,
            }
        }
    }
    /// Frames passed over: not of this vocabulary, or with a value that the dialect does not know.
    pub fn ignored(&self) -> u64 {
        self.ignored
    }
    /// Bytes lost because nobody read.
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

/// A frame's bytes; `sequence` counts frames of this sender. None for a message that only others say
/// and for a number that the dialect does not know.
pub fn encode(from: Address, sequence: u8, message: &Message) -> Option<Vec<u8>> {
    let header = MavHeader {
        system_id: from.system.into(),
        component_id: from.component,
        sequence,
    };
    let mut raw = MAVLinkV2MessageRaw::new();
    match message {
        Message::Odometry(o) => {
            raw.serialize_message_data(header, &Extended::<331, 91>(extension::odometry(o)))
        }
        Message::LandingTarget {
            time_us,
            position,
            attitude,
            size_m,
        } => {
            let payload = extension::landing_target(*time_us, position, attitude, *size_m);
            raw.serialize_message_data(header, &Extended::<149, 200>(payload));
        }
        Message::Deck { time_us, values } => {
            raw.serialize_message_data(header, &Extended::<350, 232>(extension::deck(*time_us, values)));
        }
        other => raw.serialize_message(header, &encode::encode(other)?),
    }
    Some(raw.raw_bytes().to_vec())
}

fn wide<const N: usize>(v: [f32; N]) -> [f64; N] {
    v.map(f64::from)
}
fn narrow<const N: usize>(v: [f64; N]) -> [f32; N] {
    v.map(|x| x as f32)
}
fn text<const N: usize>(t: &CharArray<N>) -> String {
    t.to_str().unwrap_or_default().to_owned()
}
/// As many bytes of `t` as fit.
fn chars<const N: usize>(t: &str) -> CharArray<N> {
    let mut bytes = [0; N];
    bytes.iter_mut().zip(t.bytes()).for_each(|(b, c)| *b = c);
    CharArray::new(bytes)
}
