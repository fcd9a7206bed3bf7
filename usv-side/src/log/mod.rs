//! Offline reading of sensor recordings: bytes to measurements in recorded order, with the sensors' own time.

mod buses;
mod csv;
mod sentences;
pub mod table;
mod wrapping;

use alight_shared::msg::{Decoded, Header, NOT_MEASURED_SD};
use alight_shared::time::{Time, VesselClock};
use thiserror::Error;

use crate::sensors::{Measurement, Mount, Remark, SourceMeasurement, plausible};

/// Text about the supported formats, for errors.
const FORMATS: &str = "NMEA 0183 text, NMEA 2000 as a gateway's text, deltas of Signal K (a line each), UBX, MAVLink, Alight's own CSV \
                       (a first line of columns with t_s) and Alight's own MCAP are read, and other recordings after conversion by \
                       `python -m alight.convert FILE`";
/// Signatures of recordings that must be converted before reading, with their formats.
const FOREIGN: [(&[u8], &str); 4] = [
    (b"ULog\x01\x12\x35", "a ULog of PX4"),
    (b"\xa3\x95\x80", "a DataFlash log of ArduPilot"),
    (b"#ROSBAG V", "a bag of ROS 1"),
    (b"SQLite format 3\0", "a bag of ROS 2"),
];
/// Start of a VectorNav sentence with its solution.
const VNINS: &[u8] = b"$VNINS,";
/// Number of bytes at the beginning for detecting the format.
const HEAD_BYTES: usize = 16 << 10;
pub const MAX_MEASUREMENTS: usize = 2_000_000;

#[derive(Debug, Error)]
#[error("{origin}{}: {message}", .line.map(|n| format!(", line {n}")).unwrap_or_default())]
pub struct LogError {
    pub origin: String,
    /// Line with the fault, counted from 1.
    pub line: Option<u64>,
    pub message: String,
}

impl LogError {
    pub fn new(origin: &str, message: impl Into<String>) -> Self {
        LogError {
            origin: origin.into(),
            line: None,
            message: message.into(),
        }
    }
    fn at_line(origin: &str, line: u64, message: impl Into<String>) -> Self {
        LogError {
            line: Some(line),
            ..LogError::new(origin, message)
        }
    }
}

#[derive(Clone, Debug, Default)]
pub struct SensorRecording {
    pub format: &'static str,
    /// Measurements in recorded order, on a clock that begins near zero.
    pub measurements: Vec<Measurement>,
    pub decoded: Decoded,
    /// Assumptions and omissions.
    pub notes: Vec<String>,
}

#[derive(Debug, Default)]
struct Gather {
    first_ns: Option<i64>,
    measurements: Vec<Measurement>,
    overflowed: bool,
}

impl Gather {
    /// Adds a measurement of `source`.
    fn push(&mut self, SourceMeasurement { at_ns, measurement }: SourceMeasurement, source: u8) {
        let first = *self.first_ns.get_or_insert(at_ns);
        if self.measurements.len() >= MAX_MEASUREMENTS {
            self.overflowed = true;
            return;
        }
        let at: Time<VesselClock> = Time::from_nanos(at_ns.saturating_sub(first));
        self.measurements.push(measurement.of(source, at));
    }
    /// Text about missing kinds of measurements; empty if there are none.
    fn missing(&self) -> String {
        let is_place =
            |m: &Measurement| matches!(m, Measurement::Gnss(g) if g.position_sd[0] < NOT_MEASURED_SD);
        let is_heading = |m: &Measurement| matches!(m, Measurement::Heading(_));
        let is_tilt = |m: &Measurement| matches!(m, Measurement::Attitude(_) | Measurement::Imu(_));
        let any = |is: &dyn Fn(&Measurement) -> bool| self.measurements.iter().any(is);
        let kinds = [
            (any(&is_tilt), "no roll and pitch"),
            (any(&is_place), "no position"),
            (any(&is_heading), "no heading"),
        ];
        let missing: Vec<&str> = kinds.iter().filter(|k| !k.0).map(|k| k.1).collect();
        missing.join(", ")
    }
    /// Completes the recording of a decoder with the counts `decoded`; `found` describes the file's content.
    fn recording(
        self,
        origin: &str,
        format: &'static str,
        found: &str,
        decoded: Decoded,
        remarks: Vec<Remark>,
    ) -> Result<SensorRecording, LogError> {
        let missing = self.missing();
        let mut notes = vec![match missing.is_empty() {
            true => found.to_owned(),
            false => format!("{found}; there is {missing}"),
        }];
        notes.extend(remarks.into_iter().map(|r| r.text));
        Ok(SensorRecording {
            format,
            measurements: self.finish(origin, found)?,
            decoded,
            notes,
        })
    }
    /// All measurements, or the reason why they are unusable; `found` describes the file's content.
    fn finish(mut self, origin: &str, found: &str) -> Result<Vec<Measurement>, LogError> {
        let whole = |message: String| LogError::new(origin, message);
        if self.overflowed {
            return Err(whole(format!(
                "more than {MAX_MEASUREMENTS} measurements; cut the recording into parts"
            )));
        }
        let times = || self.measurements.iter().map(Measurement::at);
        let span = times()
            .max()
            .zip(times().min())
            .map_or(0.0, |(b, a)| (b - a).secs());
        if self.measurements.len() < 10 || span < 5.0 {
            let missing = match self.missing() {
                missing if missing.is_empty() => missing,
                missing => format!("; there is {missing}"),
            };
            return Err(whole(format!(
                "{} measurements over {span:.1} s are too few; give at least a minute; it holds {found}{missing}",
                self.measurements.len()
            )));
        }
        for (k, m) in self.measurements.iter_mut().enumerate() {
            let header = Header::new(1, 0, 1, k as u32, m.at());
            *m = m.headed(m.source(), header);
        }
        Ok(self.measurements)
    }
}

/// Reads a recording and drops implausible channels with a note. `origin` names it in errors, and `mount` is the
/// mounting of its sensors.
pub fn read(bytes: &[u8], origin: &str, mount: &Mount) -> Result<SensorRecording, LogError> {
    let recorded = read_format(bytes, origin, mount)?;
    let (measurements, remarks) = plausible::sift(recorded.measurements);
    let mut notes = recorded.notes;
    notes.extend(remarks.into_iter().map(|r| match r.remedy {
        Some(remedy) => format!("{}: {remedy}", r.text),
        None => r.text,
    }));
    Ok(SensorRecording {
        measurements,
        notes,
        ..recorded
    })
}

fn read_format(bytes: &[u8], origin: &str, mount: &Mount) -> Result<SensorRecording, LogError> {
    let kind = |message: &str| LogError::new(origin, format!("{message}; {FORMATS}"));
    if bytes.is_empty() {
        return Err(kind("the file is empty"));
    }
    if let Some(message) = table::packed(bytes) {
        return Err(kind(&message));
    }
    let head = bytes.get(..bytes.len().min(HEAD_BYTES)).unwrap_or_default();
    if let Some((_, name)) = FOREIGN.iter().find(|(begin, _)| bytes.starts_with(begin)) {
        let message = format!("the file is {name}: {}", table::CONVERT);
        return Err(LogError::new(origin, message));
    }
    if let Some(format) = buses::format(&buses::LINES, head) {
        return buses::read(format, bytes, origin, mount);
    }
    if table::is_table(head) {
        return csv::read(bytes, origin, mount);
    }
    if sentences::is_nmea(head) {
        // VectorNav's sentence has the NMEA 0183 layout, but is not supported live.
        let is_vectornav = head.windows(VNINS.len()).any(|w| w == VNINS);
        let error = |e: LogError| match is_vectornav {
            true => LogError {
                message: format!("{}; {}", e.message, table::CONVERT),
                ..e
            },
            false => e,
        };
        return sentences::read(bytes, origin, mount).map_err(error);
    }
    if let Some(format) = buses::format(&buses::STREAMS, head) {
        return buses::read(format, bytes, origin, mount);
    }
    match table::has_columns(head) {
        true => Err(kind("column `t_s` is missing in the first line")),
        false => Err(kind("no known recording format begins like this")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{damage, damaged, sentence};
    use proptest::prelude::*;

    /// A table and a log of sentences, 20 s each.
    fn good() -> [Vec<u8>; 2] {
        let mut table =
            String::from("t_s,roll_deg,pitch_deg,heave_m,latitude_deg,longitude_deg,altitude_m\n");
        let mut sentences = String::new();
        for k in 0..200 {
            table += &format!("{:.1},1.5,-2,0.25,50.0,14.5,255\n", 0.1 * f64::from(k));
            let body = format!(
                "PASHR,1200{:02}.{}0,90.0,T,1.5,-2.0,0.25,0.1,0.1,0.2,2,1",
                k / 10,
                k % 10
            );
            sentences += &format!("2026-05-20 {}", sentence(&body));
        }
        [table.into_bytes(), sentences.into_bytes()]
    }

    #[test]
    fn nmea_log_with_logger_prefixes() {
        let [_, sentences] = good();
        let r = read(&sentences, "log", &Mount::default()).unwrap();
        assert_eq!(
            (r.format, r.decoded.good, r.decoded.corrupted),
            ("NMEA 0183", 200, 0)
        );
    }

    #[test]
    fn recorded_heave_that_cannot_be_true() {
        let [table, _] = good();
        let table = String::from_utf8(table).unwrap().replace(",0.25,", ",30,");
        let r = read(table.as_bytes(), "log", &Mount::default()).unwrap();
        let heaves = r.measurements.iter().map(|m| match m {
            Measurement::Attitude(a) => Some(a.heave),
            Measurement::Imu(_) | Measurement::Gnss(_) | Measurement::Heading(_) => None,
        });
        assert_eq!(heaves.flatten().collect::<Vec<_>>(), [None; 200]);
        let notes = r.notes.join("\n");
        for part in ["heave is beyond", "roll and pitch are used", "mount.heave"] {
            assert!(notes.contains(part), "{part}: {notes}");
        }
    }

    #[test]
    fn packed_log() {
        let packed: [(&[u8], &str); 3] = [
            (b"\x1f\x8b\x08\x00rest", "first gunzip"),
            (b"PK\x03\x04rest", "first unzip"),
            (b"\x28\xb5\x2f\xfdrest", "first unzstd"),
        ];
        for (bytes, advice) in packed {
            let e = read(bytes, "boat.csv.gz", &Mount::default()).unwrap_err();
            assert!(e.to_string().contains(advice), "{e}");
            let e = table::CsvTable::read(bytes).unwrap_err();
            assert!(e.to_string().contains(advice), "{e}");
        }
    }

    #[test]
    fn recordings_that_are_converted_first() {
        let begins: [(&[u8], &str); 6] = [
            (b"$VNINS,1,2,0,1,2,3*00\n", "too few"),
            (b"ULog\x01\x12\x35\x01rest", "ULog"),
            (b"\xa3\x95\x80rest", "DataFlash"),
            (b"#ROSBAG V2.0\nrest", "ROS 1"),
            (b"SQLite format 3\0rest", "ROS 2"),
            (b"#INSPVAA,COM1,0,73.5;1264,1\n", "`t_s` is missing"),
        ];
        for (bytes, name) in begins {
            let e = read(bytes, "boat.log", &Mount::default())
                .unwrap_err()
                .to_string();
            assert!(
                e.contains(name) && e.contains("`python -m alight.convert FILE`"),
                "{e}"
            );
        }
    }

    proptest! {
        #[test]
        fn log_of_arbitrary_bytes(bytes in prop::collection::vec(any::<u8>(), 0..3000)) {
            let _read = read(&bytes, "log", &Mount::default());
            let _table = read(&[b"t_s,roll_deg,pitch_deg\n", &bytes[..]].concat(), "log", &Mount::default());
        }

        #[test]
        fn log_of_arbitrary_cells(
            text in "(t_s|Time \\[s\\]|UTC|roll_deg|pitch_deg|Heave|;|,|\t| |\n|\"|[0-9.,:T-]|#|nan|é){0,80}",
            rows in "([0-9]{1,2}[;,.:]){0,60}",
        ) {
            let _read = read(text.as_bytes(), "log", &Mount::default());
            for head in ["t_s;roll_deg;pitch_deg\n", "time,roll_deg,pitch_deg\n"] {
                let _read = read((head.to_owned() + &rows.replace('.', "\n")).as_bytes(), "log", &Mount::default());
            }
        }

        #[test]
        fn damaged_logs(which in 0_usize..2, damage in damage(100)) {
            let bytes = damaged(good()[which].clone(), damage);
            if let Ok(r) = read(&bytes, "log", &Mount::default()) {
                prop_assert!(r.measurements.len() <= 2 * 3 * 200);
                for m in r.measurements {
                    prop_assert!(m.at().secs().abs() < 2e10);
                }
            }
        }
    }
}
