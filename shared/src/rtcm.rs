//! Detection, checking and counting of RTCM 3 frames in a byte stream, without decoding.
//!
//! A frame: preamble 0xD3, six zero bits, ten bits with the payload length, payload, CRC-24Q. The payload
//! begins with the 12-bit message number; u-blox's 4072 continues with a 12-bit subtype.
//! Source: RTCM 10403.3, section 4; u-blox F9 interface description.

use crate::geodesy::Datum;
use rtcm_rs::{MessageFrame, rtcm_error::RtcmError};

/// Maximum frame length, bytes: a payload of 1023, three bytes before and three after it.
pub const MAX_FRAME_BYTES: usize = 1029;
const PREAMBLE: u8 = 0xD3;
/// Reserved zero bits after the preamble.
const RESERVED: u8 = 0xFC;
/// Number of u-blox's proprietary message.
pub const UBLOX: u16 = 4072;

/// Number of a message, with the subtype of a u-blox message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct RtcmNumber {
    /// Number.
    pub message: u16,
    /// Subtype of [`UBLOX`], otherwise 0.
    pub subtype: u16,
}

impl RtcmNumber {
    /// Whether it holds satellite observations (MSM 1 to 7, and legacy messages of GPS and GLONASS).
    pub fn is_observation(self) -> bool {
        let n = self.message;
        let msm = (1071..=1137).contains(&n) && (1..=7).contains(&(n % 10));
        msm || (1001..=1004).contains(&n) || (1009..=1012).contains(&n)
    }
    /// Whether it holds the position of a base: a station, or u-blox's moving base.
    pub fn is_base(self) -> bool {
        matches!(self.message, 1005 | 1006) || self.message == UBLOX && self.subtype == 0
    }
}

impl core::fmt::Display for RtcmNumber {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.message {
            UBLOX => write!(f, "{UBLOX}.{}", self.subtype),
            n => write!(f, "{n}"),
        }
    }
}

/// Number of the message in a complete frame; None if the bytes are not a frame.
pub fn number(frame: &[u8]) -> Option<RtcmNumber> {
    let whole = MessageFrame::new(frame).ok()?;
    let reserved = frame.get(1)? & RESERVED;
    if reserved != 0 || whole.frame_len() != frame.len() {
        return None;
    }
    let message = whole.message_number()?;
    let subtype = match (message, whole.data()) {
        (UBLOX, [_, high, low, ..]) => (u16::from(high & 0x0F) << 8) | u16::from(*low),
        _ => 0,
    };
    Some(RtcmNumber { message, subtype })
}

/// Station number in a frame, unless it is u-blox's proprietary message: the twelve bits after the message number.
pub fn station(frame: &[u8]) -> Option<u16> {
    let [_, _, _, _, high, low, ..] = *frame else {
        return None;
    };
    Some(u16::from(high & 0x0F) << 8 | u16::from(low))
}
/// Position of the antenna's reference point in a frame of 1005 or 1006.
pub fn base_place(frame: &[u8]) -> Option<Datum> {
    /// Bit offsets of the coordinates (0.1 mm) in the payload.
    const AT: [usize; 3] = [34, 74, 114];
    const BITS: usize = 38;
    let payload = frame.get(3..)?;
    let bit = |k: usize| Some(i64::from(payload.get(k / 8)? >> (7 - k % 8) & 1));
    let mut ecef = [0.0; 3];
    for (to, at) in ecef.iter_mut().zip(AT) {
        let value = (0..BITS).try_fold(0_i64, |v, k| Some(v << 1 | bit(at + k)?))?;
        let signed = if value >> (BITS - 1) == 0 {
            value
        } else {
            value - (1 << BITS)
        };
        *to = 1e-4 * signed as f64;
    }
    Some(Datum::from_ecef(ecef)).filter(Datum::is_on_earth)
}

/// Consecutive whole frames, each with its number; None if there are other bytes in between.
pub fn frames(bytes: &[u8]) -> Option<Vec<(RtcmNumber, &[u8])>> {
    let mut all = Vec::new();
    let mut rest = bytes;
    while !rest.is_empty() {
        let length = MessageFrame::new(rest).ok()?.frame_len();
        let (frame, after) = rest.split_at_checked(length)?;
        all.push((number(frame)?, frame));
        rest = after;
    }
    (!all.is_empty()).then_some(all)
}

/// Frame around a payload of at most 1023 bytes, which begins with the message number.
pub fn frame(payload: &[u8]) -> Vec<u8> {
    /// CRC-24Q: x^24 + x^23 + x^18 + x^17 + x^14 + x^11 + x^10 + x^7 + x^6 + x^5 + x^4 + x^3 + x + 1, from zero.
    const POLYNOMIAL: u32 = 0x186_4CFB;
    let mut bytes = vec![PREAMBLE];
    bytes.extend((payload.len() as u16).to_be_bytes());
    bytes.extend_from_slice(payload);
    let crc = bytes.iter().fold(0_u32, |crc, byte| {
        (0..8).fold(crc ^ (u32::from(*byte) << 16), |crc, _| {
            let shifted = crc << 1;
            if shifted & 0x100_0000 == 0 {
                shifted
            } else {
                shifted ^ POLYNOMIAL
            }
        })
    });
    let [_, check @ ..] = crc.to_be_bytes();
    bytes.extend(check);
    bytes
}

/// Decoder that finds frames between other bytes.
#[derive(Clone, Debug, Default)]
pub struct RtcmDecoder {
    /// Bytes of an incomplete frame, starting with its preamble.
    waiting: Vec<u8>,
    damaged: u64,
}

impl RtcmDecoder {
    /// Processes bytes and passes on each complete frame.
    pub fn push(&mut self, bytes: &[u8], found: impl FnMut(RtcmNumber, &[u8])) {
        self.split(bytes, found, |_| {});
    }
    /// Processes bytes and passes on each complete frame, and the bytes outside frames.
    pub fn split(
        &mut self,
        bytes: &[u8],
        mut found: impl FnMut(RtcmNumber, &[u8]),
        mut other: impl FnMut(&[u8]),
    ) {
        self.waiting.extend_from_slice(bytes);
        let mut from = 0;
        while let Some(rest) = self.waiting.get(from..).filter(|rest| !rest.is_empty()) {
            let start = rest.iter().position(|b| *b == PREAMBLE).unwrap_or(rest.len());
            let (before, rest) = rest.split_at(start);
            other(before);
            from += start;
            let Some((first, after)) = rest.split_first() else {
                break;
            };
            if after.first().is_some_and(|b| b & RESERVED != 0) {
                other(&[*first]);
                from += 1;
                continue;
            }
            match MessageFrame::new(rest) {
                Ok(frame) => {
                    let bytes = frame.frame_data();
                    if let Some(number) = number(bytes) {
                        found(number, bytes);
                    }
                    from += frame.frame_len();
                }
                Err(RtcmError::Incomplete) => break,
                Err(_) => {
                    self.damaged += 1;
                    other(&[*first]);
                    from += 1;
                }
            }
        }
        self.waiting.drain(..from.min(self.waiting.len()));
    }
    /// Number of frames with a wrong checksum, including chance preambles in bytes of other protocols.
    pub fn damaged(&self) -> u64 {
        self.damaged
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn found(decoder: &mut RtcmDecoder, bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
        let mut all = Vec::new();
        decoder.push(bytes, |number, frame| {
            all.push((number.to_string(), frame.to_vec()))
        });
        all
    }

    proptest! {
        #[test]
        fn frames_between_other_bytes(
            payloads in prop::collection::vec(prop::collection::vec(any::<u8>(), 3..200), 1..6),
            between in prop::collection::vec(0_u8..0xD3, 0..40),
            part in 1_usize..64,
        ) {
            let frames: Vec<_> = payloads.iter().map(|p| frame(p)).collect();
            let stream: Vec<u8> = frames.iter().flat_map(|f| between.iter().chain(f)).copied().collect();
            let mut decoder = RtcmDecoder::default();
            let mut all = Vec::new();
            let mut others = Vec::new();
            for chunk in stream.chunks(part) {
                decoder.split(chunk, |_, f| all.push(f.to_vec()), |bytes| others.extend_from_slice(bytes));
            }
            prop_assert_eq!(&all, &frames);
            prop_assert_eq!(others, between.repeat(frames.len()));
            prop_assert_eq!(decoder.damaged(), 0);
        }
        #[test]
        fn any_bytes_stay_bounded(bytes in prop::collection::vec(any::<u8>(), 0..4000)) {
            let mut decoder = RtcmDecoder::default();
            for chunk in bytes.chunks(17) {
                decoder.push(chunk, |_, frame| assert!(frame.len() <= MAX_FRAME_BYTES));
                assert!(decoder.waiting.len() <= MAX_FRAME_BYTES);
            }
        }
    }

    #[test]
    fn damaged_frame_before_a_whole_one() {
        let payloads: [&[u8]; 3] = [&[0x43, 0x50, 1, 2], &[0xFE, 0x80, 0x01, 9], &[0x3E, 0xD0, 7]];
        let [gps, ublox, base] = payloads.map(frame);
        let mut damaged = gps.clone();
        damaged[4] ^= 1;
        let mut decoder = RtcmDecoder::default();
        let all = found(&mut decoder, &[damaged.clone(), gps, ublox, base].concat());
        let names: Vec<_> = all.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["1077", "4072.1", "1005"]);
        assert_eq!(decoder.damaged(), 1);
        assert_eq!(number(&damaged), None);
        let rtcm_number = |message, subtype| RtcmNumber { message, subtype };
        assert!(frames(&all[0].1).is_some_and(|f| f.len() == 1) && frames(&[]).is_none());
        let two = [&all[0].1[..], &all[2].1].concat();
        assert_eq!(frames(&two).unwrap()[1], (rtcm_number(1005, 0), &all[2].1[..]));
        assert!(frames(&two[..two.len() - 1]).is_none() && frames(&[&two[..], &damaged].concat()).is_none());
        assert!(
            rtcm_number(1077, 0).is_observation()
                && rtcm_number(1005, 0).is_base()
                && rtcm_number(UBLOX, 0).is_base()
        );
        assert!(
            !rtcm_number(UBLOX, 1).is_base()
                && !rtcm_number(1230, 0).is_observation()
                && !rtcm_number(1080, 0).is_observation()
        );
    }
}
