//! Sensors of a real vessel: their bytes to measurements of the vessel, with the time of measurement.
//!
//! A source's own clock is the only time of a measurement; the time of arrival serves for nothing but the
//! offset between the source's clock and the vessel's.

mod age_counts;
mod bus;
mod clock;
mod config;
mod heights;
mod mav;
mod n2k;
mod nmea;
mod node;
pub(crate) mod plausible;
mod rtcm;
mod signalk;
mod stuck;
mod ubx;

pub(crate) use config::euler;
pub use config::{Format, HeaveSign, Mount, Mounting, SourceConfig, SourcesConfig};
pub use mav::MavlinkDecoder;
pub use n2k::N2kDecoder;
pub use nmea::NmeaDecoder;
pub(crate) use nmea::account::ANGLES;
pub use node::{MAX_STEP_BYTES, SensorNode, SensorPorts, SensorsIn, SensorsOut};
pub use signalk::{MAX_MESSAGE as MAX_SIGNALK_MESSAGE, SignalKDecoder};
pub use stuck::{MAX_REPEATED, RepeatedSamples};
pub use ubx::UbxDecoder;

use alight_shared::mavlink::Signing;
use alight_shared::msg::{AttitudeFix, Decoded, GnssFix, Header, HeadingFix, ImuSample, SensorReadings, Seq};
use alight_shared::time::{Time, VesselClock};
use serde::{Deserialize, Serialize};

/// Measurements that arrived together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Readings {
    pub imu: Vec<ImuSample>,
    pub gnss: Vec<GnssFix>,
    pub heading: Vec<HeadingFix>,
    pub attitude: Vec<AttitudeFix>,
}

impl Readings {
    /// Adds one.
    pub fn push(&mut self, measurement: Measurement) {
        match measurement {
            Measurement::Imu(m) => self.imu.push(m),
            Measurement::Gnss(m) => self.gnss.push(m),
            Measurement::Heading(m) => self.heading.push(m),
            Measurement::Attitude(m) => self.attitude.push(m),
        }
    }
    /// All of these messages.
    pub fn of<'a>(messages: impl IntoIterator<Item = &'a SensorReadings>) -> Readings {
        let mut all = Readings::default();
        messages.into_iter().for_each(|m| all.append(m));
        all
    }
    /// Adds all of a message.
    pub fn append(&mut self, message: &SensorReadings) {
        self.imu.extend_from_slice(&message.imu);
        self.gnss.extend_from_slice(&message.gnss);
        self.heading.extend_from_slice(&message.heading);
        self.attitude.extend_from_slice(&message.attitude);
    }
    /// These measurements as messages, numbered on from `header`: as many as the kind of which there are most needs.
    pub fn messages(&self, header: &mut Header<VesselClock>) -> Vec<SensorReadings> {
        fn part<T: Copy + Default, const N: usize>(all: &[T], k: usize) -> Seq<T, N> {
            Seq::filled(all.iter().skip(k * N).take(N).copied())
        }
        let message = |k| SensorReadings {
            imu: part(&self.imu, k),
            gnss: part(&self.gnss, k),
            heading: part(&self.heading, k),
            attitude: part(&self.attitude, k),
            ..SensorReadings::default()
        };
        let holds_some = |m: &SensorReadings| {
            let [a, b, c, d] = [m.imu.len(), m.gnss.len(), m.heading.len(), m.attitude.len()];
            a + b + c + d > 0
        };
        let mut numbered = |m| {
            header.sequence = header.sequence.wrapping_add(1);
            SensorReadings { header: *header, ..m }
        };
        let all = (0..).map(message).take_while(holds_some);
        all.map(&mut numbered).collect()
    }
    pub fn is_empty(&self) -> bool {
        self.imu.is_empty() && self.gnss.is_empty() && self.heading.is_empty() && self.attitude.is_empty()
    }
}

/// A measurement of any kind.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Measurement {
    /// An inertial sample.
    Imu(ImuSample),
    /// A GNSS fix.
    Gnss(GnssFix),
    Heading(HeadingFix),
    Attitude(AttitudeFix),
}

/// Evaluates one expression for a measurement of any kind.
macro_rules! of_any_kind {
    ($measurement:expr, $m:ident => $result:expr) => {
        match $measurement {
            Measurement::Imu($m) => $result,
            Measurement::Gnss($m) => $result,
            Measurement::Heading($m) => $result,
            Measurement::Attitude($m) => $result,
        }
    };
}

macro_rules! measurement_from {
    ($($kind:ident $message:ty),*) => {$(
        impl From<$message> for Measurement {
            fn from(m: $message) -> Self {
                Measurement::$kind(m)
            }
        }
    )*};
}
measurement_from!(Imu ImuSample, Gnss GnssFix, Heading HeadingFix, Attitude AttitudeFix);

impl Measurement {
    /// Header of the measurement.
    pub fn header(&self) -> &Header<VesselClock> {
        of_any_kind!(self, m => &m.header)
    }
    /// Time of validity.
    pub fn at(&self) -> Time<VesselClock> {
        self.header().at
    }
    /// Index in [`crate::KINDS`].
    pub const fn kind(&self) -> usize {
        match self {
            Measurement::Imu(_) => 0,
            Measurement::Gnss(_) => 1,
            Measurement::Heading(_) => 2,
            Measurement::Attitude(_) => 3,
        }
    }
    /// Which of the vessel's sources of its kind.
    pub const fn source(&self) -> u8 {
        of_any_kind!(self, m => m.source)
    }
    /// This measurement of another source and time.
    pub fn of(self, source: u8, at: Time<VesselClock>) -> Self {
        let header = Header { at, ..*self.header() };
        self.headed(source, header)
    }
    /// This measurement of another source, with this header.
    pub fn headed(mut self, source: u8, header: Header<VesselClock>) -> Self {
        of_any_kind!(&mut self, m => (m.source, m.header) = (source, header));
        self
    }
}

/// A measurement as its source dates it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SourceMeasurement {
    /// On the source's own clock, ns.
    pub at_ns: i64,
    /// The measurement, whose header is not filled in yet.
    pub measurement: Measurement,
}

impl SourceMeasurement {
    /// A measurement at this time of its source.
    pub fn new(at_ns: i64, measurement: impl Into<Measurement>) -> Self {
        SourceMeasurement {
            at_ns,
            measurement: measurement.into(),
        }
    }
}

/// Makes measurements of the bytes of one source.
pub trait SensorDecoder {
    /// The bytes that are pushed next arrive at `now`. A recording has no arrivals.
    fn arrive(&mut self, _now: Time<VesselClock>) {}
    /// Takes bytes, cut anywhere, and appends the measurements that they complete.
    fn push(&mut self, bytes: &[u8], out: &mut Vec<SourceMeasurement>);
    /// The stream ends: appends the measurements that this completes.
    fn finish(&mut self, _out: &mut Vec<SourceMeasurement>) {}
    /// Statistics of its bytes.
    fn decoded(&self) -> Decoded;
    /// The measurements of the bytes pushed last whose time is their arrival, because their source gives them none.
    fn timeless(&mut self) -> Vec<Measurement> {
        Vec::new()
    }
    /// Whether its kinds of measurements come from devices with clocks of their own.
    fn has_clocks_by_kind(&self) -> bool {
        false
    }
    /// Remarks on the source's bytes for the crew, in addition to the counts.
    fn remarks(&self) -> Vec<Remark> {
        Vec::new()
    }
    /// Signs requests with this key, and takes only what is signed with it; no effect on a protocol without signatures.
    fn sign(&mut self, _key: Signing) {}
    /// Bytes to be sent to the source now, once a second, where it sends only what it is asked for.
    fn request(&mut self) -> Option<Vec<u8>> {
        None
    }
}

/// Use that was made of a source's bytes, as text.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Remark {
    /// The finding, with its values.
    pub text: String,
    /// Remedy; None: the finding is as it should be.
    pub remedy: Option<String>,
}

impl Remark {
    /// Something that is as it should be.
    pub fn fine(text: String) -> Self {
        Remark { text, remedy: None }
    }
    /// A fault that the crew should repair.
    pub fn fault(text: String, remedy: impl Into<String>) -> Self {
        Remark {
            text,
            remedy: Some(remedy.into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_as_messages_and_back() {
        let imu = |sequence| ImuSample {
            header: Header::new(1, 0, 7, sequence, Time::EPOCH),
            ..ImuSample::default()
        };
        let readings = Readings {
            imu: (0..9).map(imu).collect(),
            gnss: vec![GnssFix::default()],
            ..Readings::default()
        };
        let messages = readings.messages(&mut Header::default());
        let mut back = Readings::default();
        messages.iter().for_each(|m| back.append(m));
        assert_eq!((messages.len(), back), (3, readings));
        assert!(Readings::default().messages(&mut Header::default()).is_empty());
    }
}
