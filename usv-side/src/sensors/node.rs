//! The node of all sources of a vessel: bytes as they arrive to measurements on the vessel's clock, with statistics
//! of each source.

use alight_shared::msg::Header;
use alight_shared::node::Node;
use alight_shared::time::{Span, Time, VesselClock};
use serde::{Deserialize, Serialize};

use super::{
    Average, Decoded, Decoder, Format, MavlinkDecoder, Measurement, Mounting, NmeaDecoder, Readings,
    SourceClock, SourceConfig, SourceMeasurement, SourcesConfig, UbxDecoder,
};
use crate::node::KINDS;

/// Most bytes of a source in one step; further ones are lost, and counted.
pub const MAX_STEP_BYTES: usize = 1 << 16;
/// Sources of one kind within one source of bytes (two receivers of an autopilot).
const WITHIN: u8 = 2;
/// Above this a time is counted from 1970 and not from the source's start, ns.
const EPOCH_NS: i64 = 1_000_000_000_000_000_000;
/// Time between two requests to a source that sends only what it is asked for.
const REQUEST_PERIOD: Span = Span::from_millis(1000);

/// Bytes of each source since the last step, in the order of the configuration.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SensorsIn {
    /// One for each source.
    pub bytes: Vec<Vec<u8>>,
}

/// Measurements, and requests to sources.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SensorsOut {
    /// For the vessel's process.
    pub readings: Readings,
    /// Number of a source and bytes for it.
    pub requests: Vec<(usize, Vec<u8>)>,
}

/// Statistics of a source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SourceStatus {
    /// Messages, as its decoder counts them.
    pub decoded: Decoded,
    /// Measurements passed on, in the order of [`KINDS`].
    pub given: [u64; KINDS.len()],
    /// Of the same time as the last of their kind.
    pub duplicated: u64,
    /// Older than the last of their kind.
    pub out_of_order: u64,
    /// Of an implausible time.
    pub implausible_time: u64,
    /// Restarts of its clock.
    pub restarts: u64,
    /// Bytes lost because too many came at once.
    pub lost_bytes: u64,
    /// Newest measurement, s of the vessel's clock.
    pub newest_s: Option<f64>,
}

struct Source {
    decoder: Box<dyn Decoder>,
    least: Span,
    /// Of times from the source's start, and of times from 1970.
    clocks: [SourceClock; 2],
    average: [Average; WITHIN as usize],
    /// Newest time passed on, per kind and source within, on the source's own clock.
    newest: [[Option<i64>; WITHIN as usize + 1]; KINDS.len()],
    status: SourceStatus,
    requested: Option<Time<VesselClock>>,
}

impl Source {
    fn new(config: &SourceConfig) -> Self {
        let mounting = Mounting::new(&config.mount);
        let decoder: Box<dyn Decoder> = match config.format {
            Format::Nmea => Box::new(NmeaDecoder::new(&mounting)),
            Format::Ubx => Box::new(UbxDecoder::new(&mounting)),
            Format::Mavlink => Box::new(MavlinkDecoder::new(&mounting)),
        };
        Source {
            decoder,
            least: Span::from_secs(config.latency_s),
            clocks: Default::default(),
            average: Default::default(),
            newest: Default::default(),
            status: SourceStatus::default(),
            requested: None,
        }
    }

    fn push(&mut self, bytes: &[u8], decoded: &mut Vec<SourceMeasurement>) {
        let taken = bytes.get(..bytes.len().min(MAX_STEP_BYTES)).unwrap_or_default();
        self.status.lost_bytes += (bytes.len() - taken.len()) as u64;
        self.decoder.push(taken, decoded);
        self.status.decoded = self.decoder.decoded();
    }

    /// An inertial sample at the filter's rate; other measurements as they are.
    fn average(&mut self, m: SourceMeasurement) -> Option<SourceMeasurement> {
        let Measurement::Imu(sample) = m.measurement else {
            return Some(m);
        };
        let average = self.average.get_mut(usize::from(sample.source).min(1))?;
        let (at_ns, mean) = average.push(m.at_ns, &sample)?;
        Some(SourceMeasurement::new(at_ns, mean))
    }

    /// The measurement on the vessel's clock; None, and counted, when it is not passed on.
    fn date(&mut self, now: Time<VesselClock>, decoded: &SourceMeasurement) -> Option<Measurement> {
        let (kind, within) = (decoded.measurement.kind(), decoded.measurement.source());
        let clock = usize::from(decoded.at_ns > EPOCH_NS);
        let status = &mut self.status;
        let before: u64 = self.clocks.iter().map(SourceClock::restarts).sum();
        let at = self
            .clocks
            .get_mut(clock)
            .and_then(|c| c.vessel_time(now, decoded.at_ns, self.least));
        status.restarts = self.clocks.iter().map(SourceClock::restarts).sum();
        if status.restarts > before {
            self.newest = Default::default();
        }
        let Some(at) = at else {
            status.implausible_time += 1;
            return None;
        };
        let newest = self.newest.get_mut(kind)?.get_mut(usize::from(within))?;
        match newest {
            Some(n) if *n == decoded.at_ns => {
                status.duplicated += 1;
                return None;
            }
            Some(n) if *n > decoded.at_ns => {
                status.out_of_order += 1;
                return None;
            }
            Some(_) | None => *newest = Some(decoded.at_ns),
        }
        if let Some(given) = status.given.get_mut(kind) {
            *given += 1;
        }
        status.newest_s = Some(at.secs());
        Some(decoded.measurement.of(within, at.min(now)))
    }
}

/// The node of the vessel's sensors.
pub struct SensorNode {
    sources: Vec<Source>,
    vessel: u32,
    boot: u32,
    sequence: u32,
}

impl SensorNode {
    /// For these sources. `boot` is drawn anew at each start.
    pub fn new(config: &SourcesConfig, vessel: u32, boot: u32) -> Self {
        SensorNode {
            sources: config.sources.iter().map(Source::new).collect(),
            vessel,
            boot,
            sequence: 0,
        }
    }
    /// Statistics of each source.
    pub fn status(&self) -> Vec<SourceStatus> {
        self.sources.iter().map(|s| s.status).collect()
    }
}

impl Node for SensorNode {
    type Clock = VesselClock;
    type In = SensorsIn;
    type Out = SensorsOut;

    fn step(&mut self, now: Time<VesselClock>, input: &SensorsIn) -> SensorsOut {
        let mut out = SensorsOut::default();
        let mut decoded = Vec::new();
        for (k, source) in self.sources.iter_mut().enumerate() {
            if let Some(bytes) = input.bytes.get(k).filter(|b| !b.is_empty()) {
                source.push(bytes, &mut decoded);
            }
            for m in decoded.drain(..) {
                let averaged = source.average(m);
                let Some(m) = averaged.and_then(|m| source.date(now, &m)) else {
                    continue;
                };
                // An autopilot's odometry is the filter of its own receivers: it counts as the second.
                let number = k as u8 * WITHIN + m.source().min(WITHIN - 1);
                let header = Header::new(self.vessel, 0, self.boot, self.sequence, m.at());
                self.sequence = self.sequence.wrapping_add(1);
                out.readings.push(m.headed(number, header));
            }
            if source.requested.is_none_or(|t| now - t >= REQUEST_PERIOD) {
                source.requested = Some(now);
                out.requests
                    .extend(source.decoder.request().map(|bytes| (k, bytes)));
            }
        }
        out
    }
}

#[cfg(test)]
mod tests;
