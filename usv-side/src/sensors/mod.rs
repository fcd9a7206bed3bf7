//! A real vessel's sensors: from what they say, byte by byte, to dated measurements of the vessel.
//!
//! A source's own time is the only time of a measurement; its arrival is used for nothing but the
//! offset between the source's clock and the vessel's.

mod average;
mod clock;
mod config;
mod mav;
mod nmea;
mod node;
mod ubx;

pub use average::Average;
pub use clock::SourceClock;
pub use config::{Format, HeaveSign, Mount, Mounting, SourceConfig, SourcesConfig};
pub use mav::MavlinkDecoder;
pub use nmea::NmeaDecoder;
pub use node::{MAX_STEP_BYTES, SensorNode, SensorsIn, SensorsOut, SourceStatus};
pub use ubx::UbxDecoder;

use alight_shared::msg::{AttitudeFix, GnssFix, Header, HeadingFix, ImuSample};
use alight_shared::time::{Time, VesselClock};
use serde::{Deserialize, Serialize};

/// Measurements that arrived together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Readings {
    /// Inertial samples.
    pub imu: Vec<ImuSample>,
    /// GNSS fixes.
    pub gnss: Vec<GnssFix>,
    /// Headings.
    pub heading: Vec<HeadingFix>,
    /// Attitudes.
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
    /// Adds all of another.
    pub fn append(&mut self, other: Readings) {
        self.imu.extend(other.imu);
        self.gnss.extend(other.gnss);
        self.heading.extend(other.heading);
        self.attitude.extend(other.attitude);
    }
    /// The same in parts of at most `most` measurements of each kind.
    pub fn parts(&self, most: usize) -> Vec<Readings> {
        let counts = [
            self.imu.len(),
            self.gnss.len(),
            self.heading.len(),
            self.attitude.len(),
        ];
        let parts = counts.iter().map(|n| n.div_ceil(most.max(1))).max().unwrap_or(0);
        fn part<T: Copy>(all: &[T], k: usize, most: usize) -> Vec<T> {
            all.iter().skip(k * most).take(most).copied().collect()
        }
        (0..parts)
            .map(|k| Readings {
                imu: part(&self.imu, k, most),
                gnss: part(&self.gnss, k, most),
                heading: part(&self.heading, k, most),
                attitude: part(&self.attitude, k, most),
            })
            .collect()
    }
    /// Nothing arrived.
    pub fn is_empty(&self) -> bool {
        self.imu.is_empty() && self.gnss.is_empty() && self.heading.is_empty() && self.attitude.is_empty()
    }
}

/// A measurement of any kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measurement {
    /// An inertial sample.
    Imu(ImuSample),
    /// A GNSS fix.
    Gnss(GnssFix),
    /// A heading.
    Heading(HeadingFix),
    /// An attitude.
    Attitude(AttitudeFix),
}

impl Measurement {
    /// Its header.
    pub fn header(&self) -> &Header<VesselClock> {
        match self {
            Measurement::Imu(m) => &m.header,
            Measurement::Gnss(m) => &m.header,
            Measurement::Heading(m) => &m.header,
            Measurement::Attitude(m) => &m.header,
        }
    }
    /// Its time of validity.
    pub fn at(&self) -> Time<VesselClock> {
        self.header().at
    }
    /// Its place in [`crate::KINDS`].
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
        match self {
            Measurement::Imu(m) => m.source,
            Measurement::Gnss(m) => m.source,
            Measurement::Heading(m) => m.source,
            Measurement::Attitude(m) => m.source,
        }
    }
    /// The same of another source and time.
    pub fn of(self, source: u8, at: Time<VesselClock>) -> Self {
        let header = Header { at, ..*self.header() };
        self.headed(source, header)
    }
    /// The same of another source, with this header.
    pub fn headed(mut self, source: u8, header: Header<VesselClock>) -> Self {
        let (to, own) = match &mut self {
            Measurement::Imu(m) => (&mut m.source, &mut m.header),
            Measurement::Gnss(m) => (&mut m.source, &mut m.header),
            Measurement::Heading(m) => (&mut m.source, &mut m.header),
            Measurement::Attitude(m) => (&mut m.source, &mut m.header),
        };
        *to = source;
        *own = header;
        self
    }
}

/// A measurement as its source dates it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourceMeasurement {
    /// On the source's own clock, ns.
    pub at_ns: i64,
    /// The measurement, whose header is not filled in yet.
    pub measurement: Measurement,
}

/// What a decoder made of what it was given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Decoded {
    /// Whole messages of a kind that is used.
    pub good: u64,
    /// Damaged: a checksum, a length, a number that is none.
    pub corrupted: u64,
    /// Whole messages of other kinds.
    pub ignored: u64,
    /// Measurements that the source has given no time.
    pub undated: u64,
    /// Time pulses announced (UBX TIM-TP).
    pub pulses: u64,
    /// Of those, at a time that cannot be the next pulse's after the fix before: another time base.
    pub mismatched_pulses: u64,
}
