//! Encoders for a vessel's sensors: measurements of [`super::VesselSensors`] as NMEA 0183, NMEA 2000, Signal
//! K, UBX or MAVLink bytes, which the installed program reads.
//!
//! They implement the manufacturers' layouts and checksums independently of the decoders in `alight_usv`,
//! because an error in shared code would remain hidden. A published test frame shows that the MAVLink frames
//! equal those of the MAVLink crate.

pub mod boat;
pub mod mavlink;
pub mod n2k;
pub mod nmea;
pub mod rtcm;
pub mod signalk;
pub mod ubx;

#[cfg(test)]
mod recordings;

use alight_shared::{
    frames::{TrueNed, Vector},
    geoid::LocalGeoid,
    msg::{GnssFix, HeadingFix, ImuSample},
};
use alight_usv::sensors::{Format, Mount, Readings, SourceConfig};
use nalgebra::{Rotation3, Vector3};

use super::gnss::VesselGnssConfig;

const HEARTBEAT_NS: i64 = 1_000_000_000;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Carries {
    pub imu: bool,
    pub gnss: bool,
    pub heading: bool,
}

impl Carries {
    /// Assigns each kind of measurement to the source whose format suits it best. None if no format carries
    /// inertial samples.
    pub fn assign(sources: &[SourceConfig]) -> Option<Vec<Carries>> {
        let first = |wanted: &[Format]| {
            wanted
                .iter()
                .find_map(|w| sources.iter().position(|s| s.format == *w))
        };
        let imu = first(&[Format::Mavlink])?;
        let gnss = first(&[
            Format::Ubx,
            Format::Nmea,
            Format::N2k,
            Format::SignalK,
            Format::Mavlink,
        ]);
        let heading = first(&[
            Format::Nmea,
            Format::N2k,
            Format::SignalK,
            Format::Ubx,
            Format::Mavlink,
        ]);
        let all = (0..sources.len()).map(|k| Carries {
            imu: k == imu,
            gnss: Some(k) == gnss,
            heading: Some(k) == heading,
        });
        Some(all.collect())
    }
}

/// Accuracies that a receiver reports, m and m/s: those of its white errors, as for quantities. A
/// `stated_factor` of 3.5 also covers the slow error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StatedErrors {
    pub position_m: f64,
    pub velocity_mps: f64,
}

impl StatedErrors {
    pub fn of(config: &VesselGnssConfig) -> StatedErrors {
        let (error, factor) = (&config.error, config.stated_factor);
        StatedErrors {
            position_m: factor * error.white_sd_m,
            velocity_mps: factor * error.velocity_sd_mps,
        }
    }
}

/// The sensor's end of a source's wire.
#[derive(Clone, Debug)]
pub struct BoatSensor {
    format: Format,
    carries: Carries,
    stated: StatedErrors,
    turn: Rotation3<f64>,
    heading_offset_rad: f64,
    sequence: u8,
    heartbeat_ns: Option<i64>,
    geoid: LocalGeoid,
}

impl BoatSensor {
    pub fn new(format: Format, mount: &Mount, carries: Carries, stated: StatedErrors) -> BoatSensor {
        let [roll, pitch, yaw] = mount.mounting_deg.map(f64::to_radians);
        BoatSensor {
            format,
            carries,
            stated,
            turn: Rotation3::from_euler_angles(roll, pitch, yaw).inverse(),
            heading_offset_rad: mount.heading_offset_deg.to_radians(),
            sequence: 0,
            heartbeat_ns: None,
            geoid: LocalGeoid::default(),
        }
    }
    /// Bytes of the source's measurements, stamped by its clock.
    pub fn bytes(&mut self, readings: &Readings) -> Vec<u8> {
        let mut bytes = Vec::new();
        if self.carries.imu {
            readings.imu.iter().for_each(|m| bytes.extend(self.imu(m)));
        }
        if self.carries.gnss {
            readings.gnss.iter().for_each(|m| bytes.extend(self.gnss(m)));
        }
        if self.carries.heading {
            readings
                .heading
                .iter()
                .for_each(|m| bytes.extend(self.heading(m)));
        }
        bytes
    }

    fn heartbeat(&mut self, at_ns: i64) -> Vec<u8> {
        if self.heartbeat_ns.is_some_and(|t| at_ns - t < HEARTBEAT_NS) {
            return Vec::new();
        }
        self.heartbeat_ns = Some(at_ns);
        self.frame(mavlink::HEARTBEAT, &mavlink::boat_heartbeat())
    }
    fn imu(&mut self, m: &ImuSample) -> Vec<u8> {
        let at_ns = m.header.at.nanos();
        let mut bytes = self.heartbeat(at_ns);
        let turned = |v: [f64; 3]| -> [f64; 3] { (self.turn * Vector3::from(v)).into() };
        let payload = mavlink::highres_imu(at_ns, turned(m.accelerometer), turned(m.gyro));
        bytes.extend(self.frame(mavlink::HIGHRES_IMU, &payload));
        bytes
    }
    fn gnss(&mut self, m: &GnssFix) -> Vec<u8> {
        let at_ns = m.header.at.nanos();
        // A fault moves the fix away from the antenna.
        let place = m.datum.at(&Vector::<TrueNed>::from(Vector3::from(m.position)));
        let geoid_m = self.geoid.at(&place).height_m;
        match self.format {
            Format::Nmea => {
                let gga = nmea::Gga {
                    utc_ns: at_ns,
                    place,
                    geoid_m,
                    // A dilution of 1 corresponds to 0.5 m at quality 1.
                    hdop: m.position_sd[0] / 0.5,
                    satellites: 12,
                };
                let velocity = [m.velocity[0], m.velocity[1]];
                [gga.sentence(nmea::FINE), nmea::vtg(velocity)].concat()
            }
            Format::N2k => {
                self.sequence = (self.sequence + 1) % 8;
                let velocity = n2k::velocity(at_ns, [m.velocity[0], m.velocity[1]]);
                let fix = n2k::gnss(at_ns, place, m.position_sd[0] / 0.5, self.sequence);
                [velocity, fix].concat()
            }
            Format::SignalK => {
                let velocity = signalk::velocity(at_ns, [m.velocity[0], m.velocity[1]]);
                let fix = signalk::gnss(at_ns, (place, geoid_m), m.position_sd[0] / 0.5);
                [velocity, fix].concat()
            }
            Format::Ubx => ubx::nav_pvt(at_ns, (place, geoid_m), m.velocity, &self.stated),
            Format::Rtcm => Vec::new(),
            Format::Mavlink => {
                let payload = mavlink::gps_raw_int(at_ns, (place, geoid_m), m.velocity, &self.stated, None);
                [self.heartbeat(at_ns), self.frame(mavlink::GPS_RAW_INT, &payload)].concat()
            }
        }
    }
    fn heading(&mut self, m: &HeadingFix) -> Vec<u8> {
        let (at_ns, shown) = (m.header.at.nanos(), m.heading + self.heading_offset_rad);
        match self.format {
            Format::Nmea => [nmea::zda(at_ns, None), nmea::hdt(shown)].concat(),
            Format::N2k => n2k::heading(at_ns, shown),
            Format::SignalK => signalk::heading(at_ns, shown),
            Format::Ubx => ubx::nav_relposned(at_ns, shown, m.heading_sd),
            Format::Rtcm => Vec::new(),
            Format::Mavlink => {
                // The heading from two antennas is sent in a message without a fix.
                let (nowhere, still) = (Default::default(), [0.0; 3]);
                let payload = mavlink::gps_raw_int(at_ns, (nowhere, 0.0), still, &self.stated, Some(shown));
                self.frame(mavlink::GPS_RAW_INT, &payload)
            }
        }
    }
    fn frame(&mut self, message: mavlink::MavlinkId, payload: &[u8]) -> Vec<u8> {
        let bytes = mavlink::frame(self.sequence, message, payload);
        self.sequence = self.sequence.wrapping_add(1);
        bytes
    }
}

fn put(payload: &mut [u8], at: usize, bytes: &[u8]) {
    for (place, byte) in payload.iter_mut().skip(at).zip(bytes) {
        *place = *byte;
    }
}

#[cfg(test)]
mod tests;
