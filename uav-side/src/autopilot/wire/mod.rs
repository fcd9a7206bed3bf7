//! MAVLink 2 frames of the drone. [`Encoder`] and [`Decoder`] convert [`MavlinkMessage`]s in both directions, so a test
//! or the simulation can be the other end. Neither panics on any input; damaged, unknown and unused frames are counted
//! and skipped.

mod decode;
mod encode;
mod extension;

use alight_shared::mavlink::{
    self, CharArray, Fields, FrameReader, MavlinkSender, Outgoing, Signatures, Signing,
};

use super::message::{Address, MavlinkFrame, MavlinkMessage};

const MAX_SEVERITY: u8 = 7;

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
            let message = extension::read(raw.id, raw.fields())
                .or_else(|| decode::decode(raw.message()?, raw.fields()));
            if let (Some(from), Some(message)) = (from, message) {
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
            return Some(self.next(from, outgoing(message)?));
        };
        let number = u16::from(self.sequence) + 1;
        let texts = (*severity <= MAX_SEVERITY).then(|| extension::status_texts(*severity, text, number))?;
        let frames = texts
            .into_iter()
            .map(|text| self.next(from, Outgoing::new(253, 83, text)));
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

/// Whether this is a `COMMAND_LONG` or `COMMAND_INT` with an abort; both have the command at the same offset.
fn is_abort(id: u32, fields: Fields<'_>) -> bool {
    matches!(id, 75 | 76) && fields.u16(28) == super::message::command::USER_2
}

fn outgoing(message: &MavlinkMessage) -> Option<Outgoing> {
    Some(match message {
        MavlinkMessage::Odometry(o) => Outgoing::new(331, 91, extension::odometry(o)),
        MavlinkMessage::GnssHeights { sea_m, ellipsoid_m } => {
            Outgoing::new(24, 24, extension::gnss_heights(*sea_m, *ellipsoid_m))
        }
        MavlinkMessage::CommandAck { command, result, to } => {
            Outgoing::new(77, 143, extension::command_ack(*command, *result, *to))
        }
        MavlinkMessage::LandingTarget(t) => Outgoing::new(149, 200, extension::landing_target(t)),
        // MAVLink's development dialect.
        MavlinkMessage::TargetRelative(t) => Outgoing::new(511, 28, extension::target_relative(t)),
        MavlinkMessage::TargetAbsolute(t) => Outgoing::new(510, 245, extension::target_absolute(t)),
        MavlinkMessage::Deck { time_us, values } => {
            Outgoing::new(350, 232, extension::deck(*time_us, values))
        }
        MavlinkMessage::EstimatorStatus { flags } => {
            Outgoing::new(230, 163, extension::estimator_status(*flags))
        }
        MavlinkMessage::EkfStatus { flags } => {
            let (id, crc) = mavlink::EKF_STATUS_REPORT;
            Outgoing::new(id, crc, extension::ekf_status(*flags))
        }
        MavlinkMessage::MissionCurrent { total, state } => {
            Outgoing::new(42, 28, extension::mission_current(*total, *state))
        }
        MavlinkMessage::MissionItemReached { item } => Outgoing::new(46, 11, item.to_le_bytes().to_vec()),
        other => Outgoing::from(&encode::encode(other)?),
    })
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
fn chars<const N: usize>(t: &str) -> CharArray<N> {
    let mut bytes = [0; N];
    bytes.iter_mut().zip(t.bytes()).for_each(|(b, c)| *b = c);
    CharArray::new(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// DISTANCE_SENSOR that reports 1.5 m downwards with this quality.
    fn distance(quality: u8) -> Vec<u8> {
        let mut payload = 7_u32.to_le_bytes().to_vec();
        payload.extend([10_u16, 1000, 150].into_iter().flat_map(u16::to_le_bytes));
        payload.extend([0, 0, 25, 255]);
        payload.extend([0; 24]);
        payload.push(quality);
        let from = MavlinkSender {
            system: 1,
            component: 1,
            sequence: 0,
        };
        mavlink::encode(from, Outgoing::new(132, 85, payload), None)
    }

    /// A ground station's clock was ahead and is set back.
    #[test]
    fn abort_whatever_the_clock_shows() {
        use super::super::message::{CommandLong, command};
        let key = Signing::new([1; 32]);
        let order = |number, at| {
            let station = Signing::new([1; 32]);
            station.recall(&mavlink::SigningTimes {
                latest: at,
                ..Default::default()
            });
            let message = MavlinkMessage::Command(CommandLong::new(Address::new(1, 191), number, []));
            let station = &mut Encoder::signed(Some(station));
            station.frame(Address::new(255, 190), &message).unwrap()
        };
        let mut decoder = Decoder::signed(Some(key));
        for (number, at, taken) in [
            (command::USER_3, 1_000_000_000, true),
            (command::USER_3, 500, false),
            (command::USER_1, 500, false),
            (command::USER_2, 500, true),
        ] {
            decoder.push(&order(number, at));
            assert_eq!(decoder.next_frame().is_some(), taken, "{number} at {at}");
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
        let numbers = |text: &str| -> Vec<[u8; 3]> {
            let texts = extension::status_texts(4, text, 7);
            texts.iter().map(|t| [t[51], t[52], t[53]]).collect()
        };
        assert_eq!(numbers("short"), [[0; 3]]);
        assert_eq!(numbers(&"x".repeat(50)), [[0; 3]]);
        // An empty part ends the text.
        assert_eq!(numbers(&"x".repeat(100)), [[7, 0, 0], [7, 0, 1], [7, 0, 2]]);
    }

    #[test]
    fn range_of_invalid_quality() {
        for (quality, metres) in [(0, 1.5), (1, 0.0), (100, 1.5)] {
            let mut decoder = Decoder::default();
            decoder.push(&distance(quality));
            let Some(MavlinkMessage::Distance(d)) = decoder.next_frame().map(|f| f.message) else {
                panic!("{quality}");
            };
            // 0 m marks an invalid reading.
            assert!((d.range_m - metres).abs() < 1e-9, "{quality}: {}", d.range_m);
        }
    }
}
