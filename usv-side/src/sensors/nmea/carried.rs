//! NMEA 2000 inside sentences, converted to measurements by [`N2kDecoder`]: PCDIN (SeaSmart; Yacht Devices), MXPGN
//! (ShipModul's MiniPlex; Yacht Devices) and `!PDGY` (Digital Yacht's iKonvert).
//!
//! ```text
//! $PCDIN,01F119,003A0605,0F,2AAF00D1067414FF*59     group, counter (ms), sender, bytes: all but the last in hexadecimal digits
//! $MXPGN,01F801,2801,C1308AC40C5DE343*19            group; priority, length and sender; bytes of a CAN frame
//! !PDGY,127257,3,17,255,0.563,AP9/UgAh/v8=          group, priority, sender, receiver, counter (s), bytes in base64
//! ```
//!
//! Live, the arrival is the time. In a recording, the messages of each group and sender are spread evenly
//! between two sentence times; without any, the gateway's counter is the clock.

use std::collections::BTreeMap;

use data_encoding::{BASE64_NOPAD, HEXUPPER, HEXUPPER_PERMISSIVE};

use crate::sensors::{Decoded, Mounting, N2kDecoder, Remark, SensorDecoder, SourceMeasurement};

/// Maximum message length, bytes, and the number of bytes in its first and in each further frame.
const MAX_MESSAGE: usize = 223;
const FIRST_PART: usize = 6;
const PART: usize = 7;
const FRAME: usize = 8;
/// Groups longer than a frame, which MXPGN sends frame by frame.
const LONG: [u32; 2] = [129_029, 130_842];
/// Single-frame groups that end, but do not start, with reserved bits (all ones).
const ENDED: [u32; 6] = [127_250, 127_251, 127_252, 127_257, 127_258, 129_026];
/// Minimum value of a byte with its upper six bits reserved.
const RESERVED: u8 = 0xfc;
/// Maximum number of votes on the byte order: this many frames overrule all earlier ones.
const VOTES: i8 = 5;
/// Maximum number of waiting messages in a recording, and maximum time of their spread, ns.
const MAX_WAITING: usize = 3000;
const MAX_SPREAD_NS: i64 = 2_000_000_000;
/// Number of carried measurements of a kind ignored after a sentence has provided that kind directly: 5 s at 10 Hz.
const MAX_SPARE: u8 = 50;
/// Base of the times for the bus decoder, ns since 1970 (2033), and their maximum distance from it.
const BASE_NS: i64 = 2_000_000_000_000_000_000;
const TIMES_NS: core::ops::Range<i64> = -900_000_000_000_000_000..6_000_000_000_000_000_000;

/// Message, or one frame of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CarriedMessage {
    pgn: u32,
    source: u8,
    /// Counter of the gateway, ns.
    counter_ns: Option<i64>,
    data: Vec<u8>,
}

impl CarriedMessage {
    /// Message from these parts; None if one is invalid.
    fn new(pgn: Option<u32>, source: Option<u8>, counter_ns: Option<i64>, data: Vec<u8>) -> Option<Self> {
        let is_one = (1..=MAX_MESSAGE).contains(&data.len());
        Some(CarriedMessage {
            pgn: pgn.filter(|p| is_one && *p < 1 << 18)?,
            source: source?,
            counter_ns,
            data,
        })
    }
    pub(super) fn of_pcdin(fields: &[&str]) -> Option<Self> {
        let [pgn, counter, source, data] = fields else {
            return None;
        };
        let counter_ns = u32::from_str_radix(counter, 16)
            .ok()
            .map(|ms| i64::from(ms) * 1_000_000);
        let source = u8::from_str_radix(source, 16).ok();
        Self::new(u32::from_str_radix(pgn, 16).ok(), source, counter_ns, hex(data)?)
    }
    /// Parses the fields of MXPGN; the bytes stay in order.
    fn of_mxpgn(fields: &[&str]) -> Option<Self> {
        let [pgn, attributes, data] = fields else {
            return None;
        };
        let (attributes, data) = (u16::from_str_radix(attributes, 16).ok()?, hex(data)?);
        let [head, source] = attributes.to_be_bytes();
        let is_whole = usize::from(head & 0xf) == data.len() && data.len() <= FRAME;
        let pgn = u32::from_str_radix(pgn, 16).ok().filter(|_| is_whole);
        Self::new(pgn, Some(source), None, data)
    }
    /// Parses the text after `!PDGY,`, which has no checksum.
    pub(super) fn of_pdgy(text: &str) -> Option<Self> {
        let fields: Vec<&str> = text.trim().split(',').collect();
        let [pgn, _priority, source, _receiver, counter, data] = fields[..] else {
            return None;
        };
        let seconds = counter.parse::<f64>().ok().filter(|s| (0.0..1e9).contains(s));
        let counter_ns = seconds.map(|s| (s * 1e3).round() as i64 * 1_000_000);
        Self::new(pgn.parse().ok(), source.parse().ok(), counter_ns, base64(data)?)
    }
    /// Whether this is a continuation frame of a longer message.
    fn is_rest(&self) -> bool {
        let continues = self.data.first().is_some_and(|head| head & 0x1f != 0);
        continues && self.data.len() <= FRAME && LONG.contains(&self.pgn)
    }
}

#[derive(Clone, Debug)]
pub(super) struct Carried {
    decoder: N2kDecoder,
    /// Kind of sentence in use: a gateway may send each message in two kinds.
    kept: Option<String>,
    /// Messages of a recording since the newest time.
    waiting: Vec<CarriedMessage>,
    by_counter: bool,
    /// Byte order of MXPGN: positive if as written, negative if reversed.
    votes: i8,
    /// Sequence number of the next message that is split into frames.
    sequence: u8,
    /// Measurements to output after those of the sentence itself.
    given: Vec<SourceMeasurement>,
    /// Number of carried measurements of each kind since a sentence last provided that kind directly.
    without_own: [u8; 4],
    pub(super) sentences: u64,
    counts: Decoded,
}

impl Carried {
    pub(super) fn new(mounting: &Mounting) -> Self {
        Carried {
            decoder: N2kDecoder::new(mounting),
            kept: None,
            waiting: Vec::new(),
            by_counter: false,
            votes: 0,
            sequence: 0,
            given: Vec::new(),
            without_own: [MAX_SPARE; 4],
            sentences: 0,
            counts: Decoded::default(),
        }
    }
    pub(super) fn by_counter(&mut self) {
        self.by_counter = true;
    }
    /// Whether another kind of sentence already carries the messages.
    pub(super) fn is_spare(&mut self, address: &str) -> bool {
        self.kept.get_or_insert_with(|| address.into()) != address
    }
    /// Parses MXPGN. The last byte is first in ShipModul's manual, the first byte with Yacht Devices;
    /// reserved bytes at the end of a frame reveal the order. Inner None: not known yet.
    pub(super) fn of_mxpgn(&mut self, fields: &[&str]) -> Option<Option<CarriedMessage>> {
        let mut message = CarriedMessage::of_mxpgn(fields)?;
        if let [first, .., last] = message.data[..]
            && message.data.len() == FRAME
            && ENDED.contains(&message.pgn)
        {
            let vote = match (first >= RESERVED, last >= RESERVED) {
                (false, true) => 1,
                (true, false) => -1,
                (true, true) | (false, false) => 0,
            };
            self.votes = (self.votes + vote).clamp(-VOTES, VOTES);
        }
        if self.votes < 0 {
            message.data.reverse();
        }
        Some((self.votes != 0).then_some(message))
    }
    /// Processes a message that arrives at `now_ns`; None in a recording.
    pub(super) fn take(&mut self, message: CarriedMessage, now_ns: Option<i64>) {
        self.sentences += 1;
        match (now_ns, message.counter_ns) {
            (Some(now_ns), _) => self.decode(&message, now_ns),
            (None, Some(counter_ns)) if self.by_counter => self.decode(&message, counter_ns),
            (None, _) if self.by_counter || self.waiting.len() >= MAX_WAITING => self.counts.undated += 1,
            (None, _) => self.waiting.push(message),
        }
    }
    /// Dates the waiting messages between two times, ns; drops them if the times are far apart.
    pub(super) fn date(&mut self, between: Option<(i64, i64)>) {
        let all = core::mem::take(&mut self.waiting);
        let span = between.map(|(at_ns, next_ns)| (at_ns, next_ns.saturating_sub(at_ns)));
        let Some((at_ns, whole_ns)) = span.filter(|(_, whole)| (1..=MAX_SPREAD_NS).contains(whole)) else {
            self.counts.undated += all.len() as u64;
            return;
        };
        // Messages by group and sender, and those already dated.
        let mut groups: BTreeMap<(u32, u8), (i64, i64)> = BTreeMap::new();
        for message in all.iter().filter(|m| !m.is_rest()) {
            groups.entry((message.pgn, message.source)).or_default().0 += 1;
        }
        let mut dated = Vec::new();
        for message in all {
            let (count, before) = groups.entry((message.pgn, message.source)).or_default();
            let k = if message.is_rest() {
                (*before - 1).max(0)
            } else {
                *before += 1;
                *before - 1
            };
            dated.push((at_ns + whole_ns * k / (*count).max(1), message));
        }
        dated.sort_by_key(|(at_ns, _)| *at_ns);
        for (at_ns, message) in dated {
            let before = self.given.len();
            self.decode(&message, at_ns);
            self.counts.spread += (self.given.len() - before) as u64;
        }
    }
    /// Passes a message to the bus decoder, as lines of a CAN interface.
    fn decode(&mut self, message: &CarriedMessage, at_ns: i64) {
        if !TIMES_NS.contains(&at_ns) {
            self.counts.undated += 1;
            return;
        }
        let since_1970 = BASE_NS + at_ns;
        let (seconds, nanos) = (
            since_1970.div_euclid(1_000_000_000),
            since_1970.rem_euclid(1_000_000_000),
        );
        let id = message.pgn << 8 | u32::from(message.source);
        let before = self.given.len();
        for frame in self.frames(&message.data) {
            let digits = HEXUPPER.encode(&frame);
            let line = format!("({seconds}.{nanos:09}) can0 {id:08X}#{digits}\n");
            self.decoder.push(line.as_bytes(), &mut self.given);
        }
        for given in self.given.iter_mut().skip(before) {
            given.at_ns = given.at_ns.saturating_sub(BASE_NS);
        }
    }
    /// Splits a message into frames with sequence number and index; the first states the length.
    fn frames(&mut self, data: &[u8]) -> Vec<Vec<u8>> {
        if data.len() <= FRAME {
            return vec![data.to_vec()];
        }
        let head = self.sequence << 5;
        self.sequence = (self.sequence + 1) % 8;
        let (first, rest) = data.split_at(FIRST_PART);
        let mut all = vec![[&[head, data.len() as u8][..], first].concat()];
        let further = (1_u8..).zip(rest.chunks(PART));
        all.extend(further.map(|(k, part)| [&[head | k][..], part].concat()));
        all
    }
    /// Records a measurement of this kind that a sentence has provided directly.
    pub(super) fn own(&mut self, kind: usize) {
        if let Some(without) = self.without_own.get_mut(kind) {
            *without = 0;
        }
    }
    /// Measurements dated since the last call, and number of those ignored because sentences provide the kind directly.
    pub(super) fn measurements(&mut self, by_arrival: bool) -> (Vec<SourceMeasurement>, usize) {
        let mut all = core::mem::take(&mut self.given);
        let count = all.len();
        all.retain(|m| {
            let Some(without) = self.without_own.get_mut(m.measurement.kind()) else {
                return false;
            };
            let is_needed = *without >= MAX_SPARE;
            *without = without.saturating_add(1);
            is_needed
        });
        if by_arrival {
            self.counts.by_arrival += all.len() as u64;
        }
        let spare = count - all.len();
        self.counts.left_out += spare as u64;
        (all, spare)
    }
    /// Statistics of the sentences and of the carried messages.
    pub(super) fn decoded(&self, own: &Decoded) -> Decoded {
        let (n, c) = (self.decoder.decoded(), &self.counts);
        Decoded {
            good: own.good + n.good,
            corrupted: own.corrupted + n.corrupted,
            ignored: own.ignored + n.ignored,
            left_out: own.left_out + n.left_out + c.left_out,
            undated: own.undated + n.undated + c.undated,
            by_arrival: own.by_arrival + c.by_arrival,
            spread: own.spread + c.spread,
            ..*own
        }
    }
    pub(super) fn remarks(&self) -> Vec<Remark> {
        match self.sentences {
            0 => Vec::new(),
            _ => self.decoder.remarks(),
        }
    }
}

fn hex(text: &str) -> Option<Vec<u8>> {
    HEXUPPER_PERMISSIVE.decode(text.as_bytes()).ok()
}
/// Decodes base64 (RFC 4648), with or without padding.
fn base64(text: &str) -> Option<Vec<u8>> {
    let digits = text.trim_end_matches('=');
    BASE64_NOPAD.decode(digits.as_bytes()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        fixtures::{count, sentence},
        sensors::{Measurement, nmea::NmeaDecoder},
    };
    use alight_shared::time::Time;

    const TILT: [u8; 8] = [0x2a, 0xff, 0x7f, 0xe8, 0x03, 0x18, 0xfc, 0xff];

    /// A message as PCDIN, and as MXPGN in both byte orders.
    fn carriers(ms: u32, pgn: u32, data: &[u8; 8]) -> [String; 3] {
        let reversed: Vec<u8> = data.iter().rev().copied().collect();
        [
            sentence(&format!("PCDIN,{pgn:06X},{ms:08X},23,{}", HEXUPPER.encode(data))),
            sentence(&format!("MXPGN,{pgn:06X},3823,{}", HEXUPPER.encode(data))),
            sentence(&format!("MXPGN,{pgn:06X},3823,{}", HEXUPPER.encode(&reversed))),
        ]
    }
    fn gga(second: u32) -> String {
        sentence(&format!(
            "GPGGA,1200{second:02}.00,5000.00000,N,01430.00000,E,1,12,0.8,3.0,M,45.0,M,,"
        ))
    }
    fn decoder() -> NmeaDecoder {
        NmeaDecoder::new(&Mounting::default())
    }

    #[test]
    fn carried_messages_of_published_examples() {
        let pcdin = CarriedMessage::of_pcdin(&["01F119", "003A0605", "0F", "2AAF00D1067414FF"]).unwrap();
        assert_eq!((pcdin.pgn, pcdin.source, pcdin.data.len()), (127_257, 15, 8));
        assert_eq!(pcdin.counter_ns, Some(0x003a_0605 * 1_000_000));
        let pdgy = CarriedMessage::of_pdgy("127257,3,17,255,0.563,AP9/UgAh/v8=").unwrap();
        assert_eq!(pdgy.data, [0x00, 0xff, 0x7f, 0x52, 0x00, 0x21, 0xfe, 0xff]);
        assert_eq!(
            (pdgy.pgn, pdgy.source, pdgy.counter_ns),
            (127_257, 17, Some(563_000_000))
        );
        let long = CarriedMessage::of_pdgy(
            "129029,3,2,255,483.236,UZ9FfR+bI/////////9//////////3//////////fwD8AIgTiBMAAAAAAQAAAAA",
        );
        assert_eq!(long.unwrap().data.len(), 47);
        let mxpgn = CarriedMessage::of_mxpgn(&["01F801", "2801", "C1308AC40C5DE343"]).unwrap();
        assert_eq!((mxpgn.pgn, mxpgn.source, mxpgn.data.len()), (129_025, 1, 8));
        for fields in [
            ["01F801", "2701", "C1308AC40C5DE343"],
            ["x", "2801", "C1308AC40C5DE343"],
        ] {
            assert_eq!(CarriedMessage::of_mxpgn(&fields), None);
        }
        assert_eq!(CarriedMessage::of_pdgy("126992,255,00F5"), None);
        assert_eq!(CarriedMessage::of_pdgy("127257,3,17,255,0.563,AP9!"), None);
        assert_eq!(CarriedMessage::of_pcdin(&["01F119", "0", "0F", "2AA"]), None);
    }

    #[test]
    fn carried_messages_of_a_recording_between_times() {
        for k in 0..3 {
            for tag in ["", "\\s:serial,c:1779278400*00\\"] {
                let mut text = String::new();
                for at in 0..100 {
                    if at % 10 == 0 {
                        text += &gga(at / 10);
                    }
                    text += &format!("{tag}{}", carriers(100 * at, 127_257, &TILT)[k]);
                }
                let (mut d, mut out) = (decoder(), Vec::new());
                d.push(text.as_bytes(), &mut out);
                d.finish(&mut out);
                // Messages after the last time have no time.
                assert_eq!(
                    (count(&out, 3), d.decoded().undated, count(&out, 1)),
                    (90, 10, 10),
                    "{k}"
                );
                assert!(out.is_sorted_by_key(|m| m.at_ns), "{k}");
                let tilts = out.iter().filter(|m| m.measurement.kind() == 3);
                for (at, m) in (0..).zip(tilts) {
                    assert_eq!(m.at_ns, 43_200_000_000_000 + 100_000_000 * at, "{k}");
                    let a = m.measurement.attitude().unwrap();
                    assert!(
                        (a.tilt[0] + 0.1).abs() < 1e-9 && (a.tilt[1] - 0.1).abs() < 1e-9,
                        "{k}: {a:?}"
                    );
                }
                assert_eq!(d.decoded().corrupted, 0);
            }
        }
    }

    #[test]
    fn carried_messages_live() {
        let mut d = decoder();
        let (mut out, mut timeless) = (Vec::new(), Vec::new());
        for at in 0..100 {
            d.arrive(Time::from_secs(0.1 * f64::from(at)));
            let [pcdin, mxpgn, _] = carriers(100 * at, 127_257, &TILT);
            d.push((pcdin + &mxpgn).as_bytes(), &mut out);
            if at % 10 == 0 {
                d.push(gga(at / 10).as_bytes(), &mut out);
            }
            timeless.extend(d.timeless());
        }
        let n = d.decoded();
        assert_eq!(
            (timeless.len(), n.by_arrival, count(&out, 1)),
            (100, 100, 10),
            "{n:?}"
        );
        let text: Vec<String> = d.remarks().into_iter().map(|r| r.text).collect();
        assert!(
            text.iter()
                .any(|t| t.contains("100 MXPGN (a better one is used)")),
            "{text:?}"
        );
    }

    #[test]
    fn carried_headings_while_sentences_have_their_own() {
        let mut d = decoder();
        let (mut out, mut timeless) = (Vec::new(), Vec::new());
        for at in 0..100 {
            d.arrive(Time::from_secs(0.1 * f64::from(at)));
            let heading = [0, 0x10, 0x27, 0xff, 0x7f, 0xff, 0x7f, 0xfc];
            let [pcdin, ..] = carriers(100 * at, 127_250, &heading);
            let hdt = if at < 50 {
                sentence("HEHDT,57.3,T")
            } else {
                String::new()
            };
            d.push((gga(at / 10) + &hdt + &pcdin).as_bytes(), &mut out);
            timeless.extend(d.timeless());
        }
        // The sentences' own headings are used, and the carried ones only some time after these have ended.
        let spare = d.decoded().left_out;
        assert!((98..=101).contains(&spare), "{spare}");
        assert!(
            d.remarks()
                .iter()
                .any(|r| r.text.contains("a better one is used"))
        );
    }

    #[test]
    fn carried_message_of_several_frames() {
        let mut data = [0xff_u8; 43];
        data[7..15].copy_from_slice(&500_000_000_000_000_000_i64.to_le_bytes());
        data[15..23].copy_from_slice(&145_000_000_000_000_000_i64.to_le_bytes());
        data[23..31].copy_from_slice(&48_000_000_i64.to_le_bytes());
        data[31] = 0x10;
        data[34..36].copy_from_slice(&80_i16.to_le_bytes());
        data[38..42].copy_from_slice(&4500_i32.to_le_bytes());
        let mut d = decoder();
        let mut out = Vec::new();
        let message = sentence(&format!("PCDIN,01F805,00000000,23,{}", HEXUPPER.encode(&data)));
        let time = |k| sentence(&format!("GPZDA,1200{k:02}.00,20,05,2026,00,00"));
        d.push((time(0) + &message + &message + &time(1)).as_bytes(), &mut out);
        let times: Vec<i64> = out.iter().map(|m| m.at_ns - 43_200_000_000_000).collect();
        assert_eq!(
            (times, d.decoded().good),
            (vec![0, 500_000_000], 4),
            "{:?}",
            d.remarks()
        );
        assert!(
            matches!(out[0].measurement, Measurement::Gnss(g) if (g.datum.latitude_deg - 50.0).abs() < 1e-9)
        );
    }
}
