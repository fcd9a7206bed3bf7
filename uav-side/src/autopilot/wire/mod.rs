//! MAVLink 2 frames of the drone. [`Encoder`] and [`Decoder`] convert [`MavlinkMessage`]s in both directions, so a test
//! or the simulation can be the other end. Neither panics on any input; damaged, unknown and unused frames are counted
//! and skipped.

mod typed;

use alight_shared::mavlink::{
    self, FrameReader, MavlinkSender, Outgoing, RawFrame, Signatures, Signing,
    dialect::{MavCmd, MavMessage, MavSeverity},
};
use num_traits::FromPrimitive;

use super::message::{Address, MavlinkFrame, MavlinkMessage};

/// Decodes a byte stream that arrives in arbitrary chunks.
#[derive(Default)]
pub struct Decoder {
    frames: FrameReader,
    unknown: u64,
}

impl Decoder {
    /// Checks signatures if a key is set. A ground station's abort is accepted at any clock time.
    pub fn signed(signing: Option<Signing>) -> Decoder {
        Decoder {
            frames: FrameReader::signed(signing).whenever(is_abort),
            unknown: 0,
        }
    }
    pub fn push(&mut self, bytes: &[u8]) {
        self.frames.push(bytes);
    }
    /// Next frame; None until more bytes arrive.
    pub fn next_frame(&mut self) -> Option<MavlinkFrame> {
        loop {
            let raw = self.frames.next_frame()?;
            let from = u8::try_from(raw.system).ok().map(|system| Address {
                system,
                component: raw.component,
            });
            if let (Some(from), Some(message)) = (from, decode(&raw)) {
                return Some(MavlinkFrame { from, message });
            }
            self.unknown += 1;
        }
    }
    /// Number of skipped frames: unused, or with an unknown value.
    pub fn ignored(&self) -> u64 {
        self.unknown + self.frames.unreadable()
    }
    pub fn signatures(&self) -> Signatures {
        self.frames.signatures()
    }
    pub fn lost(&self) -> u64 {
        self.frames.lost()
    }
}

/// Encodes frames with sequence numbers, signed if a key is set.
#[derive(Default)]
pub struct Encoder {
    sequence: u8,
    signing: Option<Signing>,
}

impl Encoder {
    pub fn signed(signing: Option<Signing>) -> Encoder {
        Encoder { sequence: 0, signing }
    }
    /// Bytes of the next frame, or of several for a long text. None for messages that are not sent.
    pub fn frame(&mut self, from: Address, message: &MavlinkMessage) -> Option<Vec<u8>> {
        let MavlinkMessage::Text { severity, text } = message else {
            return Some(self.next(from, typed::encode(message)?));
        };
        let number = u16::from(self.sequence) + 1;
        let texts = typed::status_texts(MavSeverity::from_u8(*severity)?, text, number);
        let frames = texts
            .into_iter()
            .map(|text| self.next(from, Outgoing::from(&MavMessage::STATUSTEXT(text))));
        Some(frames.flatten().collect())
    }
    fn next(&mut self, from: Address, outgoing: Outgoing) -> Vec<u8> {
        self.sequence = self.sequence.wrapping_add(1);
        let from = MavlinkSender {
            system: from.system,
            component: from.component,
            sequence: self.sequence,
        };
        mavlink::encode(from, outgoing, self.signing.as_ref())
    }
}

fn decode(raw: &RawFrame) -> Option<MavlinkMessage> {
    match raw.ekf_status() {
        Some(flags) => Some(MavlinkMessage::EkfStatus { flags: flags.bits() }),
        None => typed::decode(raw.message()?),
    }
}

/// Whether this is a `COMMAND_LONG` or `COMMAND_INT` with an abort.
fn is_abort(message: &MavMessage) -> bool {
    let command = match message {
        MavMessage::COMMAND_LONG(c) => c.command,
        MavMessage::COMMAND_INT(c) => c.command,
        _ => return false,
    };
    command == MavCmd::MAV_CMD_USER_2
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A ground station's clock was ahead and is set back.
    #[test]
    fn abort_whatever_the_clock_shows() {
        use super::super::message::CommandLong;
        let key = Signing::new([1; 32]);
        let order = |number, at| {
            let station = Signing::new([1; 32]);
            station.recall(&mavlink::SigningTimes {
                latest: at,
                ..Default::default()
            });
            let message = CommandLong::new(Address::new(1, 191), number, []).into();
            let station = &mut Encoder::signed(Some(station));
            station.frame(Address::new(255, 190), &message).unwrap()
        };
        let mut decoder = Decoder::signed(Some(key));
        for (number, at, taken) in [
            (MavCmd::MAV_CMD_USER_3, 1_000_000_000, true),
            (MavCmd::MAV_CMD_USER_3, 500, false),
            (MavCmd::MAV_CMD_USER_1, 500, false),
            (MavCmd::MAV_CMD_USER_2, 500, true),
        ] {
            decoder.push(&order(number, at));
            assert_eq!(decoder.next_frame().is_some(), taken, "{number:?} at {at}");
        }
    }

    proptest! {
        /// A long text arrives in parts with a common number; every part but the last is full.
        #[test]
        fn texts_in_parts(text in "[ -~]{0,220}") {
            let mut decoder = Decoder::default();
            let message = MavlinkMessage::Text { severity: 4, text: text.clone() };
            decoder.push(&Encoder::default().frame(Address::new(1, 191), &message).unwrap());
            let parts: Vec<String> = core::iter::from_fn(|| decoder.next_frame())
                .map(|f| match f.message {
                    MavlinkMessage::Text { severity: 4, text } => text,
                    other => panic!("{other:?}"),
                })
                .collect();
            prop_assert_eq!(parts.concat(), text.as_str());
            let full = if text.len() > 50 { text.len() / 50 } else { 0 };
            prop_assert_eq!(parts.len(), full + 1);
        }
    }

    #[test]
    fn numbers_of_parts() {
        let numbers = |text: &str| -> Vec<(u16, u8)> {
            let texts = typed::status_texts(MavSeverity::MAV_SEVERITY_WARNING, text, 7);
            texts.iter().map(|t| (t.id, t.chunk_seq)).collect()
        };
        assert_eq!(numbers("short"), [(0, 0)]);
        assert_eq!(numbers(&"x".repeat(50)), [(0, 0)]);
        // An empty part ends the text.
        assert_eq!(numbers(&"x".repeat(100)), [(7, 0), (7, 1), (7, 2)]);
    }
}
