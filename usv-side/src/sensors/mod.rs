//! Sensors of a real vessel: bytes to measurements of the vessel, with time of measurement.
//!
//! The source's clock dates a measurement; the arrival only determines the offset of that clock.

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
pub(crate) use n2k::ACTISENSE;
pub use n2k::N2kDecoder;
pub use nmea::NmeaDecoder;
pub(crate) use nmea::account::ANGLES;
pub use node::{MAX_STEP_BYTES, SensorNode, SensorPorts, SensorsIn, SensorsOut};
pub use signalk::{MAX_MESSAGE as MAX_SIGNALK_MESSAGE, SignalKDecoder};
pub use stuck::{MAX_REPEATED, RepeatedSamples};
pub use ubx::UbxDecoder;

use alight_shared::{
    mavlink::Signing,
    msg::{AttitudeFix, Decoded, GnssFix, Header, HeadingFix, ImuSample, SensorReadings, Seq},
    time::{Time, VesselClock},
};
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
    pub fn push(&mut self, measurement: Measurement) {
        match measurement {
            Measurement::Imu(m) => self.imu.push(m),
            Measurement::Gnss(m) => self.gnss.push(m),
            Measurement::Heading(m) => self.heading.push(m),
            Measurement::Attitude(m) => self.attitude.push(m),
        }
    }
    pub fn of<'a>(messages: impl IntoIterator<Item = &'a SensorReadings>) -> Readings {
        let mut all = Readings::default();
        messages.into_iter().for_each(|m| all.append(m));
        all
    }
    pub fn append(&mut self, message: &SensorReadings) {
        self.imu.extend_from_slice(&message.imu);
        self.gnss.extend_from_slice(&message.gnss);
        self.heading.extend_from_slice(&message.heading);
        self.attitude.extend_from_slice(&message.attitude);
    }
    /// Messages with the measurements, numbered from `header`: as many as the most frequent kind needs.
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

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Measurement {
    Imu(ImuSample),
    Gnss(GnssFix),
    Heading(HeadingFix),
    Attitude(AttitudeFix),
}

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
    ($($kind:ident $name:ident $message:ty),*) => {
        impl Measurement {$(
            /// The message, if it is of this kind.
            pub const fn $name(&self) -> Option<&$message> {
                if let Measurement::$kind(m) = self { Some(m) } else { None }
            }
        )*}
        $(impl From<$message> for Measurement {
            fn from(m: $message) -> Self {
                Measurement::$kind(m)
            }
        })*
    };
}
measurement_from!(Imu imu ImuSample, Gnss gnss GnssFix, Heading heading HeadingFix, Attitude attitude AttitudeFix);

impl Measurement {
    pub fn header(&self) -> &Header<VesselClock> {
        of_any_kind!(self, m => &m.header)
    }
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
    /// Index of the source among those of its kind.
    pub const fn source(&self) -> u8 {
        of_any_kind!(self, m => m.source)
    }
    /// Copy of the measurement with another source and time.
    pub fn of(self, source: u8, at: Time<VesselClock>) -> Self {
        let header = Header { at, ..*self.header() };
        self.headed(source, header)
    }
    /// Copy of the measurement with another source and this header.
    pub fn headed(mut self, source: u8, header: Header<VesselClock>) -> Self {
        of_any_kind!(&mut self, m => (m.source, m.header) = (source, header));
        self
    }
}

/// Measurement with the time given by its source.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SourceMeasurement {
    /// Time on the source's clock, ns.
    pub at_ns: i64,
    /// Measurement with an empty header.
    pub measurement: Measurement,
}

impl SourceMeasurement {
    pub fn new(at_ns: i64, measurement: impl Into<Measurement>) -> Self {
        SourceMeasurement {
            at_ns,
            measurement: measurement.into(),
        }
    }
}

/// Decodes the bytes of one source into measurements.
pub trait SensorDecoder {
    /// Sets the arrival time of the bytes pushed next. Not called for a recording.
    fn arrive(&mut self, _now: Time<VesselClock>) {}
    /// Processes bytes, split at any position, and appends the measurements that they complete.
    fn push(&mut self, bytes: &[u8], out: &mut Vec<SourceMeasurement>);
    /// Ends the stream and appends the measurements that this completes.
    fn finish(&mut self, _out: &mut Vec<SourceMeasurement>) {}
    fn decoded(&self) -> Decoded;
    /// Measurements from the last bytes without a source time; their arrival is their time.
    fn timeless(&mut self) -> Vec<Measurement> {
        Vec::new()
    }
    /// Whether kinds of measurements come from devices with separate clocks.
    fn has_clocks_by_kind(&self) -> bool {
        false
    }
    /// Remarks on the source's bytes, in addition to the statistics.
    fn remarks(&self) -> Vec<Remark> {
        Vec::new()
    }
    /// Signs requests with this key and accepts only messages signed with it, if the protocol has signatures.
    fn sign(&mut self, _key: Signing) {}
    /// Bytes to send to a polled source now, once per second.
    fn request(&mut self) -> Option<Vec<u8>> {
        None
    }
}

/// Quantity whose stated accuracy nothing confirms or contradicts.
pub const UNWITNESSED: &str = "unwitnessed";

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Remark {
    /// The finding, with its values.
    pub text: String,
    /// Remedy; None if nothing is wrong.
    pub remedy: Option<String>,
}

impl Remark {
    pub fn fine(text: String) -> Self {
        Remark { text, remedy: None }
    }
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
