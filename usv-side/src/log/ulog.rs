//! ULog of PX4: `sensor_combined`, `vehicle_attitude` and the receivers' `sensor_gps` (or `vehicle_gps_position`),
//! by the formats that the file itself declares (docs.px4.io, "ULog File Format"). Own code: the reader `yule_log`
//! 0.4 panics on a declared array of 2^64 elements, stops without an error at the first damaged message and
//! depends on 35 packages.

use std::collections::BTreeMap;

use alight_shared::geodesy::Datum;
use alight_shared::msg::{Decoded, GnssFix, HeadingFix, NOT_MEASURED_SD};

use super::{Gather, LogError, Recording};
use crate::sensors::{Measurement, Mount, Mounting, SourceMeasurement, euler};

/// The first bytes.
pub(super) const MAGIC: &[u8] = b"ULog\x01\x12\x35";
const HEADER_BYTES: usize = 16;
/// The bytes of a sync message (specification, "Synchronization Message").
const SYNC: [u8; 11] = [8, 0, b'S', 0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12];
/// Kinds of messages in the specification.
const KINDS: &[u8] = b"BFIMPQADLCSOR";
/// Time between two attitudes that are used, us: those in between come from the same filter.
const ATTITUDE_STEP_US: u64 = 40_000;
/// Headings of the autopilot's own filter, us.
const HEADING_STEP_US: u64 = 200_000;
/// Longest declared format and most fields that are read.
const MAX_FORMAT: usize = 8192;
const MAX_FIELDS: usize = 256;

/// Heights above the ellipsoid, with their units in m: since 2023, and before.
const ELLIPSOID: [(&str, f64); 2] = [("altitude_ellipsoid_m", 1.0), ("alt_ellipsoid", 1e-3)];

/// Topics that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Topic {
    Imu,
    Attitude,
    Gps,
}

fn topic(name: &str) -> Option<Topic> {
    match name {
        "sensor_combined" => Some(Topic::Imu),
        "vehicle_attitude" => Some(Topic::Attitude),
        "sensor_gps" | "vehicle_gps_position" => Some(Topic::Gps),
        _ => None,
    }
}

/// Primitive types of the format: bytes, and how to read them.
#[derive(Clone, Copy, Debug)]
enum Primitive {
    Unsigned(usize),
    Signed(usize),
    Float,
    Double,
}

impl Primitive {
    fn of(name: &str) -> Option<Primitive> {
        Some(match name {
            "uint8_t" | "bool" | "char" => Primitive::Unsigned(1),
            "uint16_t" => Primitive::Unsigned(2),
            "uint32_t" => Primitive::Unsigned(4),
            "uint64_t" => Primitive::Unsigned(8),
            "int8_t" => Primitive::Signed(1),
            "int16_t" => Primitive::Signed(2),
            "int32_t" => Primitive::Signed(4),
            "int64_t" => Primitive::Signed(8),
            "float" => Primitive::Float,
            "double" => Primitive::Double,
            _ => return None,
        })
    }
    const fn bytes(self) -> usize {
        match self {
            Primitive::Unsigned(n) | Primitive::Signed(n) => n,
            Primitive::Float => 4,
            Primitive::Double => 8,
        }
    }
}

/// Fields of a topic by name: place in the message, type, how many.
type Format = BTreeMap<String, (usize, Primitive, usize)>;

/// `type name;type[n] name;...`, as far as its types are primitive.
fn format(fields: &str) -> Format {
    let (mut format, mut at) = (Format::new(), 0_usize);
    for field in fields.split(';').take(MAX_FIELDS) {
        let Some((kind, name)) = field.trim().split_once(' ') else {
            continue;
        };
        let (kind, count) = match kind.split_once('[') {
            Some((kind, n)) => (kind, n.trim_end_matches(']').parse().unwrap_or(0)),
            None => (kind, 1_usize),
        };
        // The size of a nested type is unknown here: none of our topics has one.
        let Some(primitive) = Primitive::of(kind) else {
            break;
        };
        let Some(end) = primitive
            .bytes()
            .checked_mul(count)
            .and_then(|n| at.checked_add(n))
        else {
            break;
        };
        format.insert(name.trim().to_owned(), (at, primitive, count));
        at = end;
    }
    format
}

/// A message and its format.
struct Data<'a> {
    format: &'a Format,
    bytes: &'a [u8],
}

impl Data<'_> {
    /// Element `k` of a field.
    fn number(&self, name: &str, k: usize) -> Option<f64> {
        let (at, primitive, count) = *self.format.get(name)?;
        if k >= count {
            return None;
        }
        let n = primitive.bytes();
        let bytes = self.bytes.get(at + k * n..at + (k + 1) * n)?;
        let mut wide = [0_u8; 8];
        wide.iter_mut().zip(bytes).for_each(|(w, b)| *w = *b);
        let raw = u64::from_le_bytes(wide);
        Some(match primitive {
            Primitive::Unsigned(_) => raw as f64,
            Primitive::Signed(n) => {
                let unused = 64 - 8 * n as u32;
                ((raw << unused) as i64 >> unused) as f64
            }
            Primitive::Float => f32::from_bits(raw as u32).into(),
            Primitive::Double => f64::from_bits(raw),
        })
    }
    fn finite(&self, name: &str, k: usize) -> Option<f64> {
        self.number(name, k).filter(|v| v.is_finite())
    }
    /// The first elements of a field.
    fn numbers<const N: usize>(&self, name: &str) -> Option<[f64; N]> {
        let mut all = [0.0; N];
        for (k, to) in all.iter_mut().enumerate() {
            *to = self.finite(name, k)?;
        }
        Some(all)
    }
    /// When it was sampled, us of the autopilot's clock; else when it was published.
    fn time_us(&self) -> Option<u64> {
        let sampled = self.number("timestamp_sample", 0).filter(|t| *t > 0.0);
        sampled.or_else(|| self.number("timestamp", 0)).map(|t| t as u64)
    }
}

/// Reads a log.
pub(super) fn read(bytes: &[u8], origin: &str, mount: &Mount) -> Result<Recording, LogError> {
    let mut reader = Reader {
        mounting: Mounting::new(mount),
        ..Reader::default()
    };
    let mut at = HEADER_BYTES;
    while let Some(rest) = bytes.get(at..).filter(|r| !r.is_empty()) {
        let whole = rest.split_first_chunk::<3>().and_then(|([a, b, kind], rest)| {
            let size = usize::from(u16::from_le_bytes([*a, *b]));
            let payload = rest.get(..size).filter(|_| KINDS.contains(kind))?;
            Some((*kind, payload))
        });
        let Some((kind, payload)) = whole else {
            // Damaged or cut off: reading continues at the next sync message, if any.
            reader.decoded.corrupted += 1;
            let ahead = rest.get(1..).unwrap_or_default();
            match ahead.windows(SYNC.len()).position(|w| w == SYNC) {
                Some(k) => at += 1 + k,
                None => break,
            }
            continue;
        };
        at += 3 + payload.len();
        reader
            .take(kind, payload)
            .map_err(|message| LogError::new(origin, message))?;
    }
    let Reader {
        gather,
        decoded,
        mut notes,
        dropouts,
        mean_sea_level,
        ..
    } = reader;
    let found = format!(
        "{} messages of sensor_combined, vehicle_attitude and the receivers, {} of other topics",
        decoded.good, decoded.ignored
    );
    if mean_sea_level > 0 {
        notes.push(format!(
            "{mean_sea_level} fixes without a height above the ellipsoid: that above mean sea level is taken"
        ));
    }
    if dropouts > 0 {
        notes.push(format!(
            "the autopilot dropped data {dropouts} times while logging"
        ));
    }
    Ok(Recording {
        format: "ULog",
        measurements: gather.finish(origin, &found)?,
        decoded,
        notes,
    })
}

#[derive(Default)]
struct Reader {
    mounting: Mounting,
    formats: BTreeMap<Topic, BTreeMap<String, Format>>,
    /// Topic, its name and instance by message id.
    subscribed: BTreeMap<u16, (Topic, String, u8)>,
    gather: Gather,
    decoded: Decoded,
    notes: Vec<String>,
    dropouts: u64,
    /// Fixes whose height is above mean sea level.
    mean_sea_level: u64,
    attitude_us: u64,
    heading_us: u64,
    /// A receiver measures the heading: the autopilot's own is not used.
    gps_heading: bool,
}

impl Reader {
    fn take(&mut self, kind: u8, payload: &[u8]) -> Result<(), String> {
        let text = |b: &[u8]| core::str::from_utf8(b).ok().map(str::to_owned);
        match kind {
            b'B' => {
                // Appended data comes last in the file and is read where it is; any other flag forbids an old
                // reader to continue.
                let incompatible = payload.get(8..16).unwrap_or_default();
                if incompatible
                    .iter()
                    .enumerate()
                    .any(|(k, b)| if k == 0 { b & !1 != 0 } else { *b != 0 })
                {
                    return Err("the log is of a later ULog version than is read".into());
                }
            }
            b'F' if payload.len() <= MAX_FORMAT => {
                let declared = text(payload);
                let declared = declared.as_deref().and_then(|t| t.split_once(':'));
                if let Some((name, fields)) = declared
                    && let Some(topic) = topic(name)
                {
                    let named = self.formats.entry(topic).or_default();
                    named.insert(name.to_owned(), format(fields));
                }
            }
            b'A' => {
                if let Some(([instance, a, b], name)) = payload.split_first_chunk::<3>()
                    && let Some(name) = text(name)
                    && let Some(topic) = topic(&name)
                {
                    let id = u16::from_le_bytes([*a, *b]);
                    self.subscribed.insert(id, (topic, name, *instance));
                }
            }
            b'D' => self.data(payload),
            b'O' => self.dropouts += 1,
            _ => {}
        }
        Ok(())
    }

    fn data(&mut self, payload: &[u8]) {
        let Some((id, bytes)) = payload.split_first_chunk::<2>() else {
            self.decoded.corrupted += 1;
            return;
        };
        let Some((topic, name, instance)) = self.subscribed.get(&u16::from_le_bytes(*id)) else {
            self.decoded.ignored += 1;
            return;
        };
        let Some(format) = self.formats.get(topic).and_then(|f| f.get(name)) else {
            self.decoded.corrupted += 1;
            return;
        };
        let data = Data { format, bytes };
        let (topic, instance) = (*topic, *instance);
        let Some(time_us) = data.time_us() else {
            self.decoded.corrupted += 1;
            return;
        };
        let at_ns = i64::try_from(time_us.saturating_mul(1000)).unwrap_or(i64::MAX);
        let mut out = Vec::new();
        let understood = match topic {
            Topic::Imu => imu(&data, &self.mounting).map(|m| out.push(m)),
            Topic::Attitude => data.numbers("q").and_then(euler).map(|shown| {
                let [roll, pitch, yaw] = self.mounting.attitude(shown);
                if time_us.abs_diff(self.attitude_us) >= ATTITUDE_STEP_US {
                    self.attitude_us = time_us;
                    out.push(self.mounting.tilt([roll, pitch]).into());
                }
                if !self.gps_heading && time_us.abs_diff(self.heading_us) >= HEADING_STEP_US {
                    self.heading_us = time_us;
                    out.push(self.mounting.heading_fix(yaw).into());
                }
            }),
            Topic::Gps => gps(&data, &self.mounting).map(|(fix, heading)| {
                let ellipsoid = ELLIPSOID.iter().any(|(name, _)| data.finite(name, 0).is_some());
                self.mean_sea_level += u64::from(fix.is_some() && !ellipsoid);
                out.extend(fix.map(Measurement::Gnss));
                self.gps_heading |= heading.is_some();
                out.extend(heading.map(Measurement::Heading));
            }),
        };
        match understood {
            Some(()) => self.decoded.good += 1,
            None => self.decoded.corrupted += 1,
        }
        for measurement in out {
            self.gather
                .push(SourceMeasurement { at_ns, measurement }, instance);
        }
    }
}

fn imu(data: &Data<'_>, mounting: &Mounting) -> Option<Measurement> {
    let (gyro, force) = (data.numbers("gyro_rad")?, data.numbers("accelerometer_m_s2")?);
    Some(mounting.imu(gyro, force).into())
}

/// A fix, if there is one, and a heading of two antennas, if there is one.
fn gps(data: &Data<'_>, mounting: &Mounting) -> Option<(Option<GnssFix>, Option<HeadingFix>)> {
    let kind = data.number("fix_type", 0)?;
    // Since 2023 in degrees and metres, before in 1e-7 degrees and millimetres.
    let first = |names: &[(&str, f64)]| {
        let mut values = names
            .iter()
            .map(|(name, unit)| Some(data.finite(name, 0)? * unit));
        values.find_map(|v| v)
    };
    let datum = Datum::new(
        first(&[("latitude_deg", 1.0), ("lat", 1e-7)])?,
        first(&[("longitude_deg", 1.0), ("lon", 1e-7)])?,
        first(&ELLIPSOID).or_else(|| first(&[("altitude_msl_m", 1.0), ("alt", 1e-3)]))?,
    );
    let stated = |name: &str, otherwise: f64| {
        let sd = data.finite(name, 0).filter(|v| *v > 0.0);
        sd.unwrap_or(otherwise).clamp(1e-3, 1e3)
    };
    // PX4's `eph` is the receiver's whole error; what changes within a minute is less (ours).
    let (across, down) = (0.3 * stated("eph", 2.0), 0.3 * stated("epv", 4.0));
    let down = if kind >= 3.0 { down } else { NOT_MEASURED_SD };
    let component = |name| data.finite(name, 0);
    let velocity = (
        component("vel_n_m_s"),
        component("vel_e_m_s"),
        component("vel_d_m_s"),
    );
    let (velocity, velocity_sd) = match velocity {
        (Some(n), Some(e), Some(d)) => ([n, e, d], stated("s_variance_m_s", 0.3)),
        _ => ([0.0; 3], NOT_MEASURED_SD),
    };
    let fix = || mounting.fix(datum, velocity, [across, across, down], [velocity_sd; 3]);
    let heading = data.finite("heading", 0).map(|heading| HeadingFix {
        heading_sd: stated("heading_accuracy", mounting.heading_sd()).min(1.0),
        ..mounting.heading_fix(mounting.heading(heading))
    });
    Some(((kind >= 2.0).then(fix), heading))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{damage, damaged};
    use proptest::prelude::*;

    fn message(kind: u8, payload: &[u8]) -> Vec<u8> {
        [&(payload.len() as u16).to_le_bytes()[..], &[kind], payload].concat()
    }
    /// A boat that rolls, for some seconds: inertial samples at 100 Hz, attitude at 50, GPS at 5.
    fn log(seconds: usize) -> Vec<u8> {
        let mut out = [MAGIC, &[1], &7_u64.to_le_bytes()].concat();
        out.extend(message(b'B', &[0; 40]));
        for f in [
            "sensor_combined:uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;\
             int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;uint8_t clip;",
            "vehicle_attitude:uint64_t timestamp;uint64_t timestamp_sample;float[4] q;uint8_t reset;",
            "sensor_gps:uint64_t timestamp;double latitude_deg;double longitude_deg;\
             double altitude_ellipsoid_m;float eph;float epv;float vel_n_m_s;float vel_e_m_s;\
             float vel_d_m_s;float heading;uint8_t fix_type;",
            "other:uint64_t timestamp;nested_type x;",
        ] {
            out.extend(message(b'F', f.as_bytes()));
        }
        for (id, name) in [
            (1_u16, "sensor_combined"),
            (2, "vehicle_attitude"),
            (3, "sensor_gps"),
            (4, "other"),
        ] {
            out.extend(message(
                b'A',
                &[&[0], &id.to_le_bytes()[..], name.as_bytes()].concat(),
            ));
        }
        let floats = |v: &[f64]| {
            v.iter()
                .flat_map(|x| (*x as f32).to_le_bytes())
                .collect::<Vec<u8>>()
        };
        for k in 0..100 * seconds {
            let t = 0.01 * k as f64;
            let us = (5_000_000 + 10_000 * k as u64).to_le_bytes();
            let (roll, rate) = (0.1 * t.sin(), 0.1 * t.cos());
            let imu = [
                floats(&[rate, 0.0, 0.0]),
                vec![0; 8],
                floats(&[0.0, -9.8 * roll, -9.8]),
                vec![0],
            ]
            .concat();
            out.extend(message(b'D', &[&1_u16.to_le_bytes()[..], &us, &imu].concat()));
            if k % 2 == 0 {
                let q = floats(&[(0.5 * roll).cos(), (0.5 * roll).sin(), 0.0, 0.0]);
                out.extend(message(
                    b'D',
                    &[&2_u16.to_le_bytes()[..], &us, &us, &q, &[0]].concat(),
                ));
            }
            if k % 20 == 0 {
                let place: Vec<u8> = [50.0_f64, 14.5, 255.0]
                    .iter()
                    .flat_map(|v| v.to_le_bytes())
                    .collect();
                let rest = floats(&[1.0, 2.0, 0.0, 1.0, 0.0, f64::NAN]);
                out.extend(message(
                    b'D',
                    &[&3_u16.to_le_bytes()[..], &us, &place, &rest, &[3]].concat(),
                ));
                out.extend(message(b'S', &SYNC[3..]));
            }
        }
        out
    }
    fn read_all(bytes: &[u8]) -> Result<Recording, LogError> {
        read(bytes, "log", &Mount::default())
    }

    #[test]
    fn ulog_declared_formats() {
        let r = read_all(&log(20)).unwrap();
        let count = |kind| r.measurements.iter().filter(|m| m.kind() == kind).count();
        assert_eq!((count(0), count(1), count(2), count(3)), (2000, 100, 100, 500));
        assert_eq!((r.decoded.good, r.decoded.corrupted), (2000 + 1000 + 100, 0));
        let Some(Measurement::Gnss(g)) = r.measurements.iter().find(|m| m.kind() == 1) else {
            panic!("no fix")
        };
        assert_eq!((g.datum.latitude_deg, g.velocity[1]), (50.0, 1.0));
        assert!((r.measurements.last().unwrap().at().secs() - 19.99).abs() < 0.02);
    }

    #[test]
    fn ulog_resumption_after_damage() {
        let whole = log(20);
        let mut damaged = whole.clone();
        // The kind of some message in the middle.
        let k = whole.len() / 2;
        damaged[k..k + 40].fill(0xff);
        let r = read_all(&damaged).unwrap();
        assert!(
            r.decoded.corrupted >= 1 && r.decoded.good > 3000,
            "{:?}",
            r.decoded
        );
        let r = read_all(&whole[..k]).unwrap();
        assert!(
            r.decoded.corrupted <= 1 && r.decoded.good > 1500,
            "{:?}",
            r.decoded
        );
        let mut later = whole.clone();
        later[HEADER_BYTES + 3 + 8] = 2;
        assert!(
            read_all(&later)
                .unwrap_err()
                .to_string()
                .contains("later ULog version")
        );
        assert!(read_all(&whole[..HEADER_BYTES]).is_err());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn ulog_arbitrary_damage(damage in damage(200)) {
            let _read = read_all(&damaged(log(6), damage));
        }
    }
}
