//! The drone's mapping of MAVLink 2 frames: [`encode`] and [`Decoder`] turn [`Message`]s into frames and back,
//! in both directions, so that a test or the simulated world can be the other end. Neither ever panics
//! on what arrives; a frame that is damaged, unknown or out of this vocabulary is counted and passed over.

mod decode;
mod encode;
mod extension;

use alight_shared::mavlink::{self, CharArray, FrameReader, Sender};

use super::message::{Address, Frame, Message};

/// Frames from a stream of bytes, however it is cut.
#[derive(Default)]
pub struct Decoder {
    frames: FrameReader,
    unknown: u64,
}

impl Decoder {
    /// Takes bytes in.
    pub fn push(&mut self, bytes: &[u8]) {
        self.frames.push(bytes);
    }
    /// The next frame of this vocabulary; None until more bytes are there.
    pub fn next_frame(&mut self) -> Option<Frame> {
        loop {
            let raw = self.frames.next_frame()?;
            let from = u8::try_from(raw.system).ok().map(|system| Address {
                system,
                component: raw.component,
            });
            let message = extension::read(raw.id, raw.fields())
                .or_else(|| decode::decode(raw.message()?, raw.fields()));
            if let (Some(from), Some(message)) = (from, message) {
                return Some(Frame { from, message });
            }
            self.unknown += 1;
        }
    }
    /// Frames passed over: not of this vocabulary, or with a value that the dialect does not know.
    pub fn ignored(&self) -> u64 {
        self.unknown + self.frames.unreadable()
    }
    /// Bytes lost because nobody read.
    pub fn lost(&self) -> u64 {
        self.frames.lost()
    }
}

/// A frame's bytes; `sequence` counts frames of this sender. None for a message that only others send
/// and for a number that the dialect does not know.
pub fn encode(from: Address, sequence: u8, message: &Message) -> Option<Vec<u8>> {
    let from = Sender {
        system: from.system,
        component: from.component,
        sequence,
    };
    Some(match message {
        Message::Odometry(o) => mavlink::encode_payload::<331, 91>(from, extension::odometry(o)),
        Message::GnssHeights { sea_m, ellipsoid_m } => {
            mavlink::encode_payload::<24, 24>(from, extension::gnss_heights(*sea_m, *ellipsoid_m))
        }
        Message::LandingTarget(t) => mavlink::encode_payload::<149, 200>(from, extension::landing_target(t)),
        Message::Deck { time_us, values } => {
            mavlink::encode_payload::<350, 232>(from, extension::deck(*time_us, values))
        }
        Message::EstimatorStatus { flags } => {
            mavlink::encode_payload::<230, 163>(from, extension::estimator_status(*flags))
        }
        Message::EkfStatus { flags } => {
            const ID: u32 = mavlink::EKF_STATUS_REPORT.0;
            const CRC: u8 = mavlink::EKF_STATUS_REPORT.1;
            mavlink::encode_payload::<ID, CRC>(from, extension::ekf_status(*flags))
        }
        other => mavlink::encode(from, &encode::encode(other)?),
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
/// As many bytes of `t` as fit.
fn chars<const N: usize>(t: &str) -> CharArray<N> {
    let mut bytes = [0; N];
    bytes.iter_mut().zip(t.bytes()).for_each(|(b, c)| *b = c);
    CharArray::new(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// DISTANCE_SENSOR with its extension, 1.5 m, downwards, of this quality.
    fn distance(quality: u8) -> Vec<u8> {
        let mut payload = 7_u32.to_le_bytes().to_vec();
        payload.extend([10_u16, 1000, 150].into_iter().flat_map(u16::to_le_bytes));
        payload.extend([0, 0, 25, 255]);
        payload.extend([0; 24]);
        payload.push(quality);
        let from = Sender {
            system: 1,
            component: 1,
            sequence: 0,
        };
        mavlink::encode_payload::<132, 85>(from, payload)
    }

    #[test]
    fn range_of_invalid_quality() {
        for (quality, metres) in [(0, 1.5), (1, 0.0), (100, 1.5)] {
            let mut decoder = Decoder::default();
            decoder.push(&distance(quality));
            let Some(Message::Distance(d)) = decoder.next_frame().map(|f| f.message) else {
                panic!("{quality}");
            };
            // 0 m is no reading.
            assert!((d.range_m - metres).abs() < 1e-9, "{quality}: {}", d.range_m);
        }
    }
}
