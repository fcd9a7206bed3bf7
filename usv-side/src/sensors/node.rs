//! Node of all sources of a vessel: bytes to measurements on the vessel's clock, and source statistics.

use alight_shared::{
    bus::wiring,
    estimation::SourceClock,
    frames::{Vector, VesselNed},
    geodesy::Datum,
    mavlink::Signing,
    msg::{Header, NOT_MEASURED_SD, RtcmFrames, SensorReadings, SourceStatus},
    node::Node,
    time::{Span, Time, VesselClock},
};
use serde::{Deserialize, Serialize};

use super::{
    Format, Measurement, Mounting, Readings, Remark, SensorDecoder, SourceConfig, SourceMeasurement,
    SourcesConfig,
    age_counts::{AgeCounts, LineDelay},
    plausible::{Movement, Plausibility},
    rtcm::RtcmTraffic,
};
use crate::{VesselNodeConfig, node::KINDS};

/// Maximum number of bytes of a source per step; the rest is lost and counted.
pub const MAX_STEP_BYTES: usize = 1 << 16;
/// Number of sources of one kind within one byte stream (two receivers of an autopilot).
const WITHIN: u8 = 2;
/// Prefixes of remarks on the parts of one stream: the second receiver and the odometry of an autopilot.
const WHOSE: [&str; WITHIN as usize + 1] = ["", "second receiver: ", "odometry: "];
/// Threshold above which a time is since 1970, not since the source's start, ns.
const EPOCH_NS: i64 = 1_000_000_000_000_000_000;
const REQUEST_PERIOD: Span = Span::from_millis(1000);

/// Bytes of each source since the last step, in configured order.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SensorsIn {
    pub bytes: Vec<Vec<u8>>,
    /// Measurements from drivers that decode their sources themselves.
    pub samples: Vec<Vec<SourceMeasurement>>,
}

/// Measurements, RTCM frames, and requests to sources.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SensorsOut {
    /// Measurements for the vessel's process.
    pub readings: Vec<SensorReadings>,
    /// Frames of a moving base, for the vessel's process.
    pub rtcm: Vec<RtcmFrames<VesselClock>>,
    /// Bytes to send, with the index of the source.
    pub requests: Vec<(usize, Vec<u8>)>,
}

wiring! {
    SensorPorts of SensorNode: SensorsIn => SensorsOut {
        reads {}
        edge { bytes, samples }
        writes { readings: SensorReadings, rtcm: RtcmFrames<VesselClock> }
        wakes {}
    }
}

struct Source {
    format: Format,
    decoder: Box<dyn SensorDecoder>,
    /// RTCM frames, if the source is a moving base.
    rtcm: Option<RtcmTraffic>,
    latency: Span,
    /// Clocks for times since the source's start, and since 1970, shared by all kinds or separate.
    clocks: [[SourceClock<VesselClock>; 2]; KINDS.len()],
    /// Newest forwarded times by clock (the source's, or ours for arrivals), kind, and part of the stream.
    newest: [[[Option<i64>; WITHIN as usize + 1]; KINDS.len()]; 2],
    /// Ages of fixes and headings, which the estimator limits.
    ages: [AgeCounts; KINDS.len()],
    delay: LineDelay,
    /// Plausibility of each part of the stream.
    plausible: [Plausibility; WITHIN as usize + 1],
    status: SourceStatus,
    requested: Option<Time<VesselClock>>,
}

impl Source {
    fn new(config: &SourceConfig) -> Self {
        let antenna_m = config.mount.antenna_m.unwrap_or_default();
        Source {
            format: config.format,
            decoder: config
                .format
                .decoder(&Mounting::new(&config.mount), config.system),
            rtcm: config.is_base().then(|| RtcmTraffic::new(antenna_m)),
            latency: Span::from_secs(config.latency_s),
            clocks: Default::default(),
            newest: Default::default(),
            ages: ages(),
            delay: LineDelay::default(),
            plausible: Default::default(),
            status: SourceStatus::default(),
            requested: None,
        }
    }

    fn push(
        &mut self,
        now: Time<VesselClock>,
        bytes: &[u8],
        decoded: &mut Vec<SourceMeasurement>,
        frames: &mut Vec<RtcmFrames<VesselClock>>,
    ) {
        let taken = bytes.get(..bytes.len().min(MAX_STEP_BYTES)).unwrap_or_default();
        let lost_bytes = &mut self.status.lost_bytes;
        *lost_bytes += (bytes.len() - taken.len()) as u64;
        let rtcm = self.rtcm.as_mut();
        let others = rtcm.map(|rtcm| rtcm.push(now, taken, frames, lost_bytes));
        // Frames are removed first, as they would disturb the following line. UBX has its own framing.
        let read = others.as_deref().filter(|_| self.format == Format::Nmea);
        self.decoder.arrive(now);
        self.decoder.push(read.unwrap_or(taken), decoded);
        self.status.decoded = self.decoder.decoded();
        if let (Format::Rtcm, Some(rtcm)) = (self.format, &self.rtcm) {
            rtcm.count(&mut self.status);
        }
    }

    /// Converts a time of the source's clock to the vessel's clock.
    fn source_time(
        &mut self,
        now: Time<VesselClock>,
        &SourceMeasurement { at_ns, measurement }: &SourceMeasurement,
    ) -> Option<Time<VesselClock>> {
        let kind = match self.decoder.has_clocks_by_kind() {
            true => measurement.kind(),
            false => 0,
        };
        let clock = self
            .clocks
            .get_mut(kind)?
            .get_mut(usize::from(at_ns > EPOCH_NS))?;
        let before = clock.restarts;
        let at = clock.local_time(now, at_ns, self.latency);
        if clock.restarts > before {
            self.status.step_s = clock.step_s;
            self.status.restarts += 1;
            self.newest = Default::default();
        }
        at
    }
    fn remarks(&self) -> Vec<Remark> {
        let within = self.plausible.iter().zip(WHOSE);
        let mut all: Vec<Remark> = self.rtcm.iter().flat_map(RtcmTraffic::remarks).collect();
        all.extend(within.flat_map(|(p, whose)| p.remarks(whose)));
        all.extend(self.delay.remark());
        all.extend(self.ages.iter().filter_map(AgeCounts::remark));
        all.extend(self.decoder.remarks());
        let s = &self.status;
        if s.restarts > 0 {
            all.push(Remark::fine(format!(
                "its clock changed {} times, most recently by {:+.2} s: measurements are re-dated",
                s.restarts, s.step_s
            )));
        }
        if s.implausible_time > 0 {
            all.push(Remark::fine(format!(
                "{} measurements whose time does not fit its clock: delayed, or before a change of the clock was known",
                s.implausible_time
            )));
        }
        if s.decoded.by_arrival > 0 {
            all.push(Remark::fine(format!(
                "{} measurements without a time of their own, dated by their arrival",
                s.decoded.by_arrival
            )));
        }
        all
    }

    /// Measurement of part `number` of the stream without implausible channels; None if no channel is left.
    fn plausible(&mut self, number: usize, boat: &mut Movement, m: Measurement) -> Option<Measurement> {
        let within = usize::from(m.source());
        let still = boat.take((number * self.plausible.len() + within) as u8, &m);
        match self.plausible.get_mut(within) {
            Some(of_sensor) => of_sensor.take(m, &still).measurement,
            None => Some(m),
        }
    }
    /// Measurement on the vessel's clock; None if it is not passed on, which is counted.
    fn date(&mut self, now: Time<VesselClock>, decoded: &SourceMeasurement) -> Option<Measurement> {
        let Some(at) = self.source_time(now, decoded) else {
            self.status.implausible_time += 1;
            return None;
        };
        self.delay.take(now, (now - at - self.latency).secs());
        self.status.delay_s = self.delay.delay_s();
        self.pass(now, at, (0, decoded.at_ns), decoded.measurement)
    }
    /// Dates a measurement without a time, which its line delays like the others.
    fn date_by_arrival(&mut self, now: Time<VesselClock>, measurement: Measurement) -> Option<Measurement> {
        let at = now - self.latency - Span::from_secs(self.delay.delay_s());
        self.pass(now, at, (1, now.nanos()), measurement)
    }
    /// Passes a measurement on if its time (ns; clock 0: the source's, 1: ours) is the newest of its kind.
    fn pass(
        &mut self,
        now: Time<VesselClock>,
        at: Time<VesselClock>,
        (clock, own_ns): (usize, i64),
        measurement: Measurement,
    ) -> Option<Measurement> {
        let (kind, within) = (measurement.kind(), measurement.source());
        let newest = self
            .newest
            .get_mut(clock)?
            .get_mut(kind)?
            .get_mut(usize::from(within))?;
        let status = &mut self.status;
        match newest {
            Some(n) if *n == own_ns => {
                status.duplicated += 1;
                return None;
            }
            Some(n) if *n > own_ns => {
                status.out_of_order += 1;
                return None;
            }
            Some(_) | None => *newest = Some(own_ns),
        }
        if let Some(given) = status.given.get_mut(kind) {
            *given += 1;
        }
        status.newest_s = Some(at.secs());
        if let Some(ages) = self.ages.get_mut(kind) {
            ages.take((now - at).secs());
        }
        Some(measurement.of(within, at.min(now)))
    }
}

fn fixed(m: &Measurement) -> Option<Datum> {
    let fix = m.gnss().filter(|fix| fix.position_sd[0] < NOT_MEASURED_SD)?;
    let [x, y, z] = fix.position;
    Some(fix.datum.at::<VesselNed>(&Vector::new(x, y, z)))
}

/// Age counts by kind with the limits that a default estimator's configuration has.
fn ages() -> [AgeCounts; KINDS.len()] {
    let estimator = VesselNodeConfig::default();
    let limits_s = [
        f64::INFINITY,
        estimator.gnss.max_age_s,
        estimator.heading.max_age_s,
        f64::INFINITY,
    ];
    core::array::from_fn(|kind| AgeCounts::new(KINDS[kind], limits_s[kind]))
}

pub struct SensorNode {
    sources: Vec<Source>,
    movement: Movement,
    /// Headers of the newest measurement, the newest message, and the newest RTCM frame.
    headers: [Header<VesselClock>; 3],
}

impl SensorNode {
    /// Node for these sources; `boot` is random for each start.
    pub fn new(config: &SourcesConfig, vessel: u32, boot: u32) -> Self {
        SensorNode {
            sources: config.sources.iter().map(Source::new).collect(),
            movement: Movement::default(),
            headers: [Header::new(vessel, 0, boot, 0, Time::EPOCH); 3],
        }
    }
    /// Sets the position of the deck's centre in the vessel's body frame, m.
    #[must_use]
    pub fn with_deck(mut self, centre_m: [f64; 3]) -> Self {
        let bases = self.sources.iter_mut().filter_map(|s| s.rtcm.as_mut());
        bases.for_each(|rtcm| rtcm.place(centre_m));
        self
    }
    /// Sets the MAVLink signing key of source `number`.
    pub fn sign(&mut self, number: usize, key: Signing) {
        if let Some(source) = self.sources.get_mut(number) {
            source.decoder.sign(key);
        }
    }
    /// Remarks on each source, in addition to its statistics.
    pub fn remarks(&self) -> Vec<Vec<Remark>> {
        let mut all: Vec<Vec<Remark>> = self.sources.iter().map(Source::remarks).collect();
        for (source, remarks) in all.iter_mut().enumerate() {
            let is_own = |sensor: usize| sensor / WHOSE.len() == source;
            remarks.extend(self.movement.remark(is_own));
        }
        all
    }
    pub fn status(&self) -> Vec<SourceStatus> {
        self.sources.iter().map(|s| s.status).collect()
    }
}

impl Node for SensorNode {
    type Clock = VesselClock;
    type In = SensorsIn;
    type Out = SensorsOut;

    fn step(&mut self, now: Time<VesselClock>, input: &SensorsIn) -> SensorsOut {
        let (mut readings, mut requests) = (Readings::default(), Vec::new());
        let [measured, sent, framed] = &mut self.headers;
        let (mut decoded, mut rtcm, mut place) = (Vec::new(), Vec::new(), None);
        for (k, source) in self.sources.iter_mut().enumerate() {
            if let Some(bytes) = input.bytes.get(k).filter(|b| !b.is_empty()) {
                source.push(now, bytes, &mut decoded, &mut rtcm);
            }
            decoded.extend(input.samples.get(k).into_iter().flatten().copied());
            let mut dated: Vec<_> = decoded.drain(..).filter_map(|m| source.date(now, &m)).collect();
            for m in source.decoder.timeless() {
                dated.extend(source.date_by_arrival(now, m));
            }
            let boat = &mut self.movement;
            for m in dated.into_iter().filter_map(|m| source.plausible(k, boat, m)) {
                // An autopilot's odometry comes from its own receivers, so it counts as the second receiver.
                let number = k as u8 * WITHIN + m.source().min(WITHIN - 1);
                measured.at = m.at();
                place = fixed(&m).or(place);
                readings.push(m.headed(number, *measured));
                measured.sequence = measured.sequence.wrapping_add(1);
            }
            if source.requested.is_none_or(|t| now - t >= REQUEST_PERIOD) {
                source.requested = Some(now);
                requests.extend(source.decoder.request().map(|bytes| (k, bytes)));
            }
        }
        let bases = self.sources.iter_mut().filter_map(|s| s.rtcm.as_mut());
        bases.zip(place).for_each(|(rtcm, place)| rtcm.fix(place));
        sent.at = now;
        let readings = readings.messages(sent);
        framed.at = now;
        for frame in &mut rtcm {
            framed.sequence = framed.sequence.wrapping_add(1);
            frame.header = *framed;
        }
        SensorsOut {
            readings,
            rtcm,
            requests,
        }
    }
}

#[cfg(test)]
mod tests;
