//! All sources of a vessel: bytes as they arrive in, dated measurements on the vessel's clock out, and
//! what became of each source's bytes.

use alight_shared::msg::Header;
use alight_shared::node::Node;
use alight_shared::time::{Span, Time, VesselClock};
use serde::{Deserialize, Serialize};

use super::{
    Average, Decoded, Format, MavlinkDecoder, Measurement, Mounting, NmeaDecoder, Readings, SourceClock,
    SourceConfig, SourceMeasurement, SourcesConfig, UbxDecoder,
};
use crate::node::KINDS;

/// Most bytes of a source that one step takes; the rest is lost, and counted.
pub const MAX_STEP_BYTES: usize = 1 << 16;
/// Sources of one kind within one source of bytes (two receivers of an autopilot).
const WITHIN: u8 = 2;
/// Above this a time is counted from 1970 and not from a start, ns.
const EPOCH_NS: i64 = 1_000_000_000_000_000_000;
/// How often a source that wants to be asked is asked.
const ASK: Span = Span::from_millis(1000);

/// Bytes of each source since the last step, in the order of the configuration.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SensorsIn {
    /// One for each source.
    pub bytes: Vec<Vec<u8>>,
}

/// What is to be done with it.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SensorsOut {
    /// For the vessel's process.
    pub readings: Readings,
    /// Source and bytes that it is to be sent.
    pub ask: Vec<(usize, Vec<u8>)>,
}

/// What became of a source's bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SourceStatus {
    /// Messages, as its decoder counts them.
    pub decoded: Decoded,
    /// Measurements given on, in the order of [`KINDS`].
    pub given: [u64; KINDS.len()],
    /// Of the same time as the last of their kind.
    pub duplicated: u64,
    /// Older than the last of their kind.
    pub out_of_order: u64,
    /// Of a time that cannot be right.
    pub implausible_time: u64,
    /// Times that its clock began anew.
    pub restarts: u64,
    /// Bytes lost because too many came at once.
    pub lost_bytes: u64,
    /// Newest measurement, s of the vessel's clock.
    pub newest_s: Option<f64>,
}

enum Decoder {
    Nmea(Box<NmeaDecoder>),
    Ubx(Box<UbxDecoder>),
    Mavlink(Box<MavlinkDecoder>),
}

struct Source {
    decoder: Decoder,
    least: Span,
    /// Of times from a start, and of times from 1970.
    clocks: [SourceClock; 2],
    average: [Average; WITHIN as usize],
    /// Newest time given on, per kind and source within, on the source's own clock.
    newest: [[Option<i64>; WITHIN as usize + 1]; KINDS.len()],
    status: SourceStatus,
    asked: Option<Time<VesselClock>>,
}

impl Source {
    fn new(config: &SourceConfig) -> Self {
        let mounting = Mounting::new(&config.mount);
        let decoder = match config.format {
            Format::Nmea => Decoder::Nmea(Box::new(NmeaDecoder::new(&mounting))),
            Format::Ubx => Decoder::Ubx(Box::new(UbxDecoder::new(&mounting))),
            Format::Mavlink => Decoder::Mavlink(Box::new(MavlinkDecoder::new(&mounting))),
        };
        Source {
            decoder,
            least: Span::from_secs(config.latency_s),
            clocks: Default::default(),
            average: Default::default(),
            newest: Default::default(),
            status: SourceStatus::default(),
            asked: None,
        }
    }

    fn push(&mut self, bytes: &[u8], heard: &mut Vec<SourceMeasurement>) {
        let taken = bytes.get(..bytes.len().min(MAX_STEP_BYTES)).unwrap_or_default();
        self.status.lost_bytes += (bytes.len() - taken.len()) as u64;
        match &mut self.decoder {
            Decoder::Nmea(d) => d.push(taken, heard),
            Decoder::Ubx(d) => d.push(taken, heard),
            Decoder::Mavlink(d) => d.push(taken, heard),
        }
        self.status.decoded = match &self.decoder {
            Decoder::Nmea(d) => d.decoded(),
            Decoder::Ubx(d) => d.decoded(),
            Decoder::Mavlink(d) => d.decoded(),
        };
    }

    /// The measurement on the vessel's clock; None, and counted, when it is not to be given on.
    fn date(&mut self, now: Time<VesselClock>, heard: &SourceMeasurement) -> Option<Measurement> {
        let (kind, within) = (heard.measurement.kind(), heard.measurement.source());
        let clock = usize::from(heard.at_ns > EPOCH_NS);
        let status = &mut self.status;
        let before: u64 = self.clocks.iter().map(SourceClock::restarts).sum();
        let at = self
            .clocks
            .get_mut(clock)
            .and_then(|c| c.vessel_time(now, heard.at_ns, self.least));
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
            Some(n) if *n == heard.at_ns => {
                status.duplicated += 1;
                return None;
            }
            Some(n) if *n > heard.at_ns => {
                status.out_of_order += 1;
                return None;
            }
            Some(_) | None => *newest = Some(heard.at_ns),
        }
        if let Some(given) = status.given.get_mut(kind) {
            *given += 1;
        }
        status.newest_s = Some(at.secs());
        Some(heard.measurement.of(within, at.min(now)))
    }
}

/// The node.
pub struct SensorNode {
    sources: Vec<Source>,
    vessel: u32,
    boot: u32,
    sequence: u32,
}

impl SensorNode {
    /// Of these sources. `boot` is drawn anew at each start.
    pub fn new(config: &SourcesConfig, vessel: u32, boot: u32) -> Self {
        SensorNode {
            sources: config.sources.iter().map(Source::new).collect(),
            vessel,
            boot,
            sequence: 0,
        }
    }
    /// What became of each source's bytes.
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
        let mut heard = Vec::new();
        for (k, source) in self.sources.iter_mut().enumerate() {
            if let Some(bytes) = input.bytes.get(k).filter(|b| !b.is_empty()) {
                source.push(bytes, &mut heard);
            }
            for h in heard.drain(..) {
                let averaged = match h.measurement {
                    Measurement::Imu(m) => {
                        let average = source.average.get_mut(usize::from(m.source).min(1));
                        let mean = average.and_then(|a| a.push(h.at_ns, &m));
                        mean.map(|(at_ns, m)| SourceMeasurement {
                            at_ns,
                            measurement: Measurement::Imu(m),
                        })
                    }
                    Measurement::Gnss(_) | Measurement::Heading(_) | Measurement::Attitude(_) => Some(h),
                };
                let Some(m) = averaged.and_then(|h| source.date(now, &h)) else {
                    continue;
                };
                // An autopilot's odometry is the filter of its own receivers: it counts as the second.
                let number = k as u8 * WITHIN + m.source().min(WITHIN - 1);
                let header = Header::new(self.vessel, 0, self.boot, self.sequence, m.at());
                self.sequence = self.sequence.wrapping_add(1);
                out.readings.push(m.headed(number, header));
            }
            if let Decoder::Mavlink(d) = &mut source.decoder
                && source.asked.is_none_or(|t| now - t >= ASK)
            {
                source.asked = Some(now);
                out.ask.push((k, d.ask()));
            }
        }
        out
    }
}

#[cfg(test)]
mod tests;
