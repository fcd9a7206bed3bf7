//! RTCM 3 among the bytes of a source: frames for the drones' receivers, and what a moving base lacks.

use std::collections::{BTreeMap, VecDeque};

use alight_shared::msg::{RtcmFrames, Seq, SourceStatus};
use alight_shared::rtcm::{RtcmDecoder, RtcmNumber};
use alight_shared::time::{Span, Time, VesselClock};
use alight_shared::topics;

use super::{Decoded, Remark, SensorDecoder, SourceMeasurement};
use crate::rtcm_relay::BYTES_PER_S;

/// Frames of one step, at most: as many as their topic holds.
const MAX_STEP_FRAMES: usize = topics::VESSEL_RTCM.buffer;
/// Numbers of messages that are counted, at most.
const MAX_NUMBERS: usize = 16;
/// Newest arrivals of a number, by which its rate is known.
const MAX_ARRIVALS: usize = 16;
/// A number that was absent for so long does not come any more: no receiver repeats the base's place more seldom.
const ABSENT: Span = Span::from_millis(30_000);
/// Number of the biases of GLONASS's phases.
const GLONASS_BIASES: u16 = 1230;

/// The newest arrivals of a number, each with its bytes.
#[derive(Clone, Debug, Default)]
struct Arrivals(VecDeque<(Time<VesselClock>, f64)>);

impl Arrivals {
    fn take(&mut self, now: Time<VesselClock>, bytes: f64) {
        if self.0.len() == MAX_ARRIVALS {
            self.0.pop_front();
        }
        self.0.push_back((now, bytes));
    }
    /// Messages, Hz, and bytes, 1/s; zero after the first.
    fn rates(&self) -> [f64; 2] {
        let Some(((first, _), (newest, _))) = self.0.front().zip(self.0.back()) else {
            return [0.0; 2];
        };
        let span_s = (*newest - *first).secs();
        if span_s <= 0.0 {
            return [0.0; 2];
        }
        let bytes: f64 = self.0.iter().skip(1).map(|(_, bytes)| bytes).sum();
        [(self.0.len() - 1) as f64 / span_s, bytes / span_s]
    }
}

/// Frames of a source whose receiver is the drones' moving base.
#[derive(Clone, Debug)]
pub(super) struct RtcmTraffic {
    decoder: RtcmDecoder,
    antenna_m: [f64; 3],
    numbers: BTreeMap<RtcmNumber, Arrivals>,
    frames: u64,
    /// Newest frame, and newest bytes.
    newest: Option<Time<VesselClock>>,
    now: Time<VesselClock>,
}

impl RtcmTraffic {
    /// A receiver whose antenna is here in the vessel's body frame, m.
    pub(super) fn new(antenna_m: [f64; 3]) -> Self {
        RtcmTraffic {
            decoder: RtcmDecoder::default(),
            antenna_m,
            numbers: BTreeMap::new(),
            frames: 0,
            newest: None,
            now: Time::EPOCH,
        }
    }
    /// The antenna's place counts from the deck's centre, which is here in the vessel's body frame, m.
    pub(super) fn place(&mut self, deck_centre_m: [f64; 3]) {
        let from_deck = self.antenna_m.iter_mut().zip(deck_centre_m);
        from_deck.for_each(|(antenna, centre)| *antenna -= centre);
    }
    /// Takes bytes and adds their frames, whose headers are not filled in yet; the bytes that are in none. Frames of which there
    /// is no room are counted in `lost_bytes`.
    pub(super) fn push(
        &mut self,
        now: Time<VesselClock>,
        bytes: &[u8],
        out: &mut Vec<RtcmFrames<VesselClock>>,
        lost_bytes: &mut u64,
    ) -> Vec<u8> {
        let (mut others, antenna_m) = (Vec::new(), self.antenna_m.map(|m| m as f32));
        let (numbers, frames, newest) = (&mut self.numbers, &mut self.frames, &mut self.newest);
        let found = |number: RtcmNumber, frame: &[u8]| {
            (*frames, *newest) = (*frames + 1, Some(now));
            if numbers.len() < MAX_NUMBERS || numbers.contains_key(&number) {
                let arrivals = numbers.entry(number).or_default();
                arrivals.take(now, frame.len() as f64);
            }
            if out.len() < MAX_STEP_FRAMES {
                out.push(RtcmFrames {
                    antenna_m,
                    bytes: Seq::filled(frame.iter().copied()),
                    ..RtcmFrames::default()
                });
            } else {
                *lost_bytes += frame.len() as u64;
            }
        };
        let other = |bytes: &[u8]| others.extend_from_slice(bytes);
        self.decoder.split(bytes, found, other);
        self.now = now;
        others
    }
    /// Counts the frames in the statistics of a source that has nothing else.
    pub(super) fn count(&self, status: &mut SourceStatus) {
        status.decoded.good = self.frames;
        status.decoded.corrupted = self.decoder.damaged();
        status.newest_s = self.newest.map(Time::secs);
    }
    /// Messages by their numbers, and what a moving base lacks.
    pub(super) fn remarks(&self) -> Vec<Remark> {
        let comes = |a: &Arrivals| a.0.back().is_some_and(|(at, _)| self.now - *at <= ABSENT);
        let coming: Vec<_> = self.numbers.iter().filter(|(_, a)| comes(a)).collect();
        let any = |is: &dyn Fn(RtcmNumber) -> bool| coming.iter().any(|(number, _)| is(**number));
        let missing = [
            (
                any(&RtcmNumber::is_observation),
                "observations (1074, 1084, 1094, 1124 or more)",
            ),
            (
                any(&RtcmNumber::is_base),
                "the base's place (4072.0, 1005 or 1006)",
            ),
        ];
        let missing: Vec<&str> = missing
            .iter()
            .filter(|(is, _)| !is)
            .map(|(_, what)| *what)
            .collect();
        let mut all = Vec::new();
        if !missing.is_empty() {
            all.push(Remark::fault(
                format!("RTCM lacks {}: it is no moving base", missing.join(" and ")),
                "switch them on at this port of the vessel's receiver, 1 Hz or more (docs/sensors.md, Moving base)",
            ));
        }
        let bytes_per_s: f64 = coming.iter().map(|(_, a)| a.rates()[1]).sum();
        if bytes_per_s > BYTES_PER_S {
            all.push(Remark::fault(
                format!(
                    "RTCM of {:.1} kB/s: {:.1} kB/s of it go by radio",
                    1e-3 * bytes_per_s,
                    1e-3 * BYTES_PER_S
                ),
                "set MSM4 in place of MSM7, fewer systems or a lower rate",
            ));
        }
        let is_glonass = |n: RtcmNumber| matches!(n.message, 1009..=1012 | 1081..=1087);
        if any(&is_glonass) && !any(&|n: RtcmNumber| n.message == GLONASS_BIASES) {
            all.push(Remark::fine(format!(
                "RTCM has GLONASS without its biases ({GLONASS_BIASES}): receivers of another maker may not use it"
            )));
        }
        let mut text: Vec<String> = coming.iter().map(|(n, a)| rate_text(**n, a)).collect();
        if text.is_empty() {
            text.push("no whole frame".into());
        }
        let damaged = match self.decoder.damaged() {
            0 => String::new(),
            n => format!("; {n} damaged"),
        };
        all.push(Remark::fine(format!("RTCM: {}{damaged}", text.join(", "))));
        all
    }
}

/// A number with its rate.
fn rate_text(number: RtcmNumber, arrivals: &Arrivals) -> String {
    let [rate_hz, _] = arrivals.rates();
    if rate_hz > 0.0 {
        format!("{number} {rate_hz:.1} Hz")
    } else {
        format!("{number} once")
    }
}

/// The decoder of a source that has RTCM alone: it gives no measurements.
pub(super) struct NoMeasurements;

impl SensorDecoder for NoMeasurements {
    fn push(&mut self, _bytes: &[u8], _out: &mut Vec<SourceMeasurement>) {}
    fn decoded(&self) -> Decoded {
        Decoded::default()
    }
}
