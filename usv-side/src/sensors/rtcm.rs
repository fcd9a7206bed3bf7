//! RTCM 3 in the bytes of a source: frames for the drones' receivers, and remarks on a moving base.

use std::collections::{BTreeMap, VecDeque};

use alight_shared::{
    geodesy::Datum,
    msg::{RtcmFrames, Seq, SourceStatus},
    rtcm::{self, RtcmDecoder, RtcmNumber},
    time::{Span, Time, VesselClock},
    topics,
};

use super::{Decoded, Remark, SensorDecoder, SourceMeasurement};
use crate::rtcm_relay::BYTES_PER_S;

/// Maximum number of frames per step: the size of their topic's buffer.
const MAX_STEP_FRAMES: usize = topics::VESSEL_RTCM.buffer;
const MAX_NUMBERS: usize = 16;
/// Number of arrivals that give the rate of a message number.
const MAX_ARRIVALS: usize = 16;
/// Absence after which a message number has ended; every receiver repeats the base's position more often.
const ABSENT: Span = Span::from_millis(30_000);
/// Message number of the GLONASS phase biases.
const GLONASS_BIASES: u16 = 1230;

/// Newest arrivals of a message number, each with its size in bytes.
#[derive(Clone, Debug, Default)]
struct Arrivals(VecDeque<(Time<VesselClock>, f64)>);

impl Arrivals {
    fn take(&mut self, now: Time<VesselClock>, bytes: f64) {
        if self.0.len() == MAX_ARRIVALS {
            self.0.pop_front();
        }
        self.0.push_back((now, bytes));
    }
    /// Rate of the messages, Hz, and of their bytes, 1/s; zero until the second message.
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

const MAX_STATIONS: usize = 4;
/// Maximum distance of a base on board from the vessel's fix, m, and maximum distance travelled with a constant base, m.
const ABOARD_M: f64 = 100.0;
const MOVED_M: f64 = 15.0;

/// Base position from message 1005 or 1006, the time since which it is constant, and the vessel's position then.
#[derive(Clone, Copy, Debug)]
struct Base {
    place: Datum,
    since: Time<VesselClock>,
    own: Option<Datum>,
}

/// Frames of a source whose receiver is the drones' moving base.
#[derive(Clone, Debug)]
pub(super) struct RtcmTraffic {
    decoder: RtcmDecoder,
    antenna_m: [f64; 3],
    numbers: BTreeMap<RtcmNumber, Arrivals>,
    /// Newest frame of each station, and its base position.
    stations: BTreeMap<u16, (Time<VesselClock>, Option<Base>)>,
    /// Position of the vessel by its own fixes.
    own: Option<Datum>,
    frames: u64,
    /// Times of the newest frame and of the newest bytes.
    newest: Option<Time<VesselClock>>,
    now: Time<VesselClock>,
}

impl RtcmTraffic {
    /// Receiver with its antenna at `antenna_m` (vessel's body frame).
    pub(super) fn new(antenna_m: [f64; 3]) -> Self {
        RtcmTraffic {
            decoder: RtcmDecoder::default(),
            antenna_m,
            numbers: BTreeMap::new(),
            stations: BTreeMap::new(),
            own: None,
            frames: 0,
            newest: None,
            now: Time::EPOCH,
        }
    }
    /// Makes the antenna's position relative to the deck's centre (vessel's body frame, m).
    pub(super) fn place(&mut self, deck_centre_m: [f64; 3]) {
        let from_deck = self.antenna_m.iter_mut().zip(deck_centre_m);
        from_deck.for_each(|(antenna, centre)| *antenna -= centre);
    }
    /// Appends the frames in these bytes, without headers, and returns the other bytes. Frames beyond the
    /// capacity count in `lost_bytes`.
    pub(super) fn push(
        &mut self,
        now: Time<VesselClock>,
        bytes: &[u8],
        out: &mut Vec<RtcmFrames<VesselClock>>,
        lost_bytes: &mut u64,
    ) -> Vec<u8> {
        let (mut others, antenna_m) = (Vec::new(), self.antenna_m.map(|m| m as f32));
        let (numbers, frames, newest) = (&mut self.numbers, &mut self.frames, &mut self.newest);
        let (stations, own) = (&mut self.stations, self.own);
        let found = |number: RtcmNumber, frame: &[u8]| {
            (*frames, *newest) = (*frames + 1, Some(now));
            if numbers.len() < MAX_NUMBERS || numbers.contains_key(&number) {
                let arrivals = numbers.entry(number).or_default();
                arrivals.take(now, frame.len() as f64);
            }
            let of = rtcm::station(frame).filter(|_| number.message != rtcm::UBLOX);
            if let Some(of) = of.filter(|of| stations.len() < MAX_STATIONS || stations.contains_key(of)) {
                let (at, base) = stations.entry(of).or_insert((now, None));
                *at = now;
                let place = rtcm::base_place(frame).filter(|_| matches!(number.message, 1005 | 1006));
                if let Some(place) = place.filter(|p| base.is_none_or(|b| b.place != *p)) {
                    *base = Some(Base {
                        place,
                        since: now,
                        own,
                    });
                }
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
    pub(super) fn fix(&mut self, place: Datum) {
        self.own = Some(place);
        let bases = self.stations.values_mut().filter_map(|(_, base)| base.as_mut());
        bases.for_each(|base| base.own = base.own.or(Some(place)));
    }
    /// Remarks on base positions and stations: a caster's corrections, a stationary base, two bases.
    fn contradictions(&self) -> Vec<Remark> {
        let comes = |at: Time<VesselClock>| self.now - at <= ABSENT;
        let (mut all, mut stations) = (Vec::new(), Vec::new());
        for (number, (_, base)) in self.stations.iter().filter(|(_, (at, _))| comes(*at)) {
            stations.push(number.to_string());
            let (Some(base), Some(own)) = (base, self.own) else {
                continue;
            };
            let apart_m = own.distance_m(&base.place);
            let moved_m = base.own.map_or(0.0, |then| then.distance_m(&own));
            let text = if apart_m > ABOARD_M {
                format!(
                    "RTCM's base (station {number}) is {:.1} km away: corrections from a caster",
                    1e-3 * apart_m
                )
            } else if moved_m > MOVED_M {
                format!(
                    "RTCM's base (station {number}) has not moved for {:.0} s, and the boat by {moved_m:.0} m: it \
                     was surveyed in",
                    (self.now - base.since).secs()
                )
            } else {
                continue;
            };
            let remedy = "set the vessel's receiver up as a moving base, without a survey, and pass no other corrections on";
            all.push(Remark::fault(text, remedy));
        }
        if stations.len() > 1 {
            all.push(Remark::fault(
                format!("RTCM of {} stations: {}", stations.len(), stations.join(" and ")),
                "pass on the vessel's own receiver alone: a drone's receiver has one base",
            ));
        }
        let rate = |is: &dyn Fn(RtcmNumber) -> bool| {
            let of = self
                .numbers
                .iter()
                .filter(|(n, a)| is(**n) && a.0.back().is_some_and(|(at, _)| comes(*at)));
            of.map(|(_, a)| a.rates()[0])
                .fold(None, |most: Option<f64>, r| Some(most.unwrap_or(0.0).max(r)))
        };
        let standing = rate(&|n| matches!(n.message, 1005 | 1006));
        if standing.is_some() && rate(&|n| n.is_base() && n.message == rtcm::UBLOX).is_some() {
            all.push(Remark::fault(
                "RTCM has 1005 or 1006 next to 4072.0: a u-blox rover then assumes a stationary base".into(),
                "switch 1005 and 1006 off at this port of the vessel's receiver",
            ));
        }
        let (base_hz, observed_hz) = (rate(&RtcmNumber::is_base), rate(&RtcmNumber::is_observation));
        if let Some((base_hz, observed_hz)) = base_hz
            .zip(observed_hz)
            .filter(|(b, o)| stations.len() < 2 && *b > 0.0 && *o > 2.0 * *b)
        {
            all.push(Remark::fault(
                format!(
                    "RTCM has the base position at {base_hz:.1} Hz, and observations at {observed_hz:.1} Hz"
                ),
                "let the vessel's receiver send its position with each observation",
            ));
        }
        all
    }
    /// Adds the frames to the status of a source that sends nothing else.
    pub(super) fn count(&self, status: &mut SourceStatus) {
        status.decoded.good = self.frames;
        status.decoded.corrupted = self.decoder.damaged();
        status.newest_s = self.newest.map(Time::secs);
    }
    /// Remarks on received message numbers, and on those that a moving base lacks.
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
                "the base position (4072.0, 1005 or 1006)",
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
                format!("RTCM lacks {}: it is not a moving base", missing.join(" and ")),
                "switch them on at this port of the vessel's receiver, 1 Hz or more (alight help sensors, Moving base)",
            ));
        }
        all.extend(self.contradictions());
        let bytes_per_s: f64 = coming.iter().map(|(_, a)| a.rates()[1]).sum();
        if bytes_per_s > BYTES_PER_S {
            all.push(Remark::fault(
                format!(
                    "RTCM of {:.1} kB/s, of which {:.1} kB/s go by radio",
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

fn rate_text(number: RtcmNumber, arrivals: &Arrivals) -> String {
    let [rate_hz, _] = arrivals.rates();
    if rate_hz > 0.0 {
        format!("{number} {rate_hz:.1} Hz")
    } else {
        format!("{number} once")
    }
}

/// Decoder of a source with RTCM only.
pub(super) struct NoMeasurements;

impl SensorDecoder for NoMeasurements {
    fn push(&mut self, _bytes: &[u8], _out: &mut Vec<SourceMeasurement>) {}
    fn decoded(&self) -> Decoded {
        Decoded::default()
    }
}
