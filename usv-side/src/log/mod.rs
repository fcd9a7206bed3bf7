//! Offline reading of sensor recordings: bytes to measurements in recorded order, with the sensors' own time.

mod buses;
mod csv;
mod sentences;
pub mod table;
mod wrapping;

use alight_shared::{
    msg::{Decoded, Header, NOT_MEASURED_SD},
    time::{Span, Time, VesselTime},
};
use thiserror::Error;

use crate::sensors::{ACTISENSE, Format, Measurement, Mount, Remark, SourceMeasurement, plausible};

/// Supported formats, for errors.
const FORMATS: &str = "NMEA 0183 text, NMEA 2000 as a gateway's text, deltas of Signal K (a line each), UBX, MAVLink, Alight's own CSV \
                       (a first line of columns with t_s) and Alight's own MCAP are read, and other recordings after conversion by \
                       `python -m alight.convert FILE`";
/// Signatures of recordings that are not read, and what to do: captures of packets (pcap in both byte orders and
/// resolutions, pcapng), recordings that are converted first, and other loggers of NMEA 2000.
const FOREIGN: [(&[u8], &str); 12] = [
    (&[0xd4, 0xc3, 0xb2, 0xa1], CAPTURE),
    (&[0xa1, 0xb2, 0xc3, 0xd4], CAPTURE),
    (&[0x4d, 0x3c, 0xb2, 0xa1], CAPTURE),
    (&[0xa1, 0xb2, 0x3c, 0x4d], CAPTURE),
    (&[0x0a, 0x0d, 0x0d, 0x0a], CAPTURE),
    (
        b"ULog\x01\x12\x35",
        "a ULog of PX4: `python -m alight.convert FILE` converts it",
    ),
    (
        b"\xa3\x95\x80",
        "a DataFlash log of ArduPilot: `python -m alight.convert FILE` converts it",
    ),
    (
        b"#ROSBAG V",
        "a bag of ROS 1: `python -m alight.convert FILE` converts it",
    ),
    (
        b"SQLite format 3\0",
        "a bag of ROS 2: `python -m alight.convert FILE` converts it",
    ),
    (
        &ACTISENSE,
        "binary frames of an Actisense gateway (NMEA 2000): record RAW or N2K ASCII, or convert them by canboat's actisense-serial -r",
    ),
    (
        b";$FILEVERSION=",
        "a trace of PCAN-View: record by candump -L, or convert it to that format",
    ),
    (
        b"Sequence #,",
        "a table of NMEA 2000 messages by N2KAnalyzer (Maretron): record by candump -L, or convert it to canboat's plain format",
    ),
];
const CAPTURE: &str = "a packet capture: extract the payload into a file (tshark, tcpflow)";
/// Start of VectorNav's sentence with the solution.
const VNINS: &[u8] = b"$VNINS,";
/// Start of a UBX message.
const UBX: [u8; 2] = [0xb5, 0x62];
/// Time difference between a fix or heading and the newest attitude before it in the file above which the two
/// have different clocks, s. A decoder outputs up to two seconds of attitudes after the fix that begins them,
/// and an estimator accepts fixes 0.6 s old.
const BEHIND_S: f64 = 0.6;
const BEFORE_S: f64 = 2.5;
const SPREAD_S: f64 = 1.0;
/// Bytes at the beginning that distinguish the formats.
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
    fn push(&mut self, SourceMeasurement { at_ns, measurement }: SourceMeasurement, source: u8) {
        let first = *self.first_ns.get_or_insert(at_ns);
        if self.measurements.len() >= MAX_MEASUREMENTS {
            self.overflowed = true;
            return;
        }
        let at: VesselTime = Time::from_nanos(at_ns.saturating_sub(first));
        self.measurements.push(measurement.of(source, at));
    }
    /// Text about missing kinds of measurements; empty if there are none.
    fn missing(&self) -> String {
        let is_place =
            |m: &Measurement| matches!(m, Measurement::Gnss(g) if g.position_sd[0] < NOT_MEASURED_SD);
        let is_heading = |m: &Measurement| m.heading().is_some();
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
    /// Dates fixes and headings of another clock by their order in the file; returns notes on them.
    fn align(&mut self) -> Vec<String> {
        let mut notes = Vec::new();
        for (kind, name) in [(1, "positions"), (2, "headings")] {
            let mut newest = None;
            let mut apart = Vec::new();
            for m in &self.measurements {
                match m {
                    Measurement::Imu(_) | Measurement::Attitude(_) => newest = newest.max(Some(m.at())),
                    _ if m.kind() == kind => apart.extend(newest.map(|t: VesselTime| (t - m.at()).secs())),
                    Measurement::Gnss(_) | Measurement::Heading(_) => {}
                }
            }
            apart.sort_by(f64::total_cmp);
            let quantile = |tenths: usize| apart.get(apart.len() * tenths / 10).copied();
            let (Some(low), Some(middle), Some(high)) = (quantile(1), quantile(5), quantile(9)) else {
                continue;
            };
            if high - low > SPREAD_S || (-BEFORE_S..=BEHIND_S).contains(&middle) {
                continue;
            }
            for m in self.measurements.iter_mut().filter(|m| m.kind() == kind) {
                *m = m.of(m.source(), m.at() + Span::from_secs(middle));
            }
            let side = if middle > 0.0 { "before" } else { "after" };
            notes.push(format!(
                "{name} are dated {:.1} s {side} the attitudes next to them: two clocks; their order in the file dates them",
                middle.abs()
            ));
        }
        notes
    }
    /// Recording of a decoder that counted `decoded`; `found` describes the file's content.
    fn recording(
        mut self,
        origin: &str,
        format: &'static str,
        found: &str,
        decoded: Decoded,
        remarks: Vec<Remark>,
    ) -> Result<SensorRecording, LogError> {
        let missing = self.missing();
        let mut notes = vec![if missing.is_empty() {
            found.to_owned()
        } else {
            format!("{found}; there is {missing}")
        }];
        let remarks: Vec<String> = remarks.into_iter().map(|r| r.text).collect();
        notes.extend(remarks.iter().cloned());
        notes.extend(self.align());
        Ok(SensorRecording {
            format,
            measurements: self.finish(origin, &[&[found.to_owned()], &remarks[..]].concat().join("; "))?,
            decoded,
            notes,
        })
    }
    /// All measurements, or why they are unusable; `found` describes the file's content.
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

/// Reads a recording from `origin` with sensors at `mount`, and drops implausible channels with a note.
pub fn read(bytes: &[u8], origin: &str, mount: &Mount) -> Result<SensorRecording, LogError> {
    let recorded = read_format(bytes, origin, mount)?;
    let (measurements, mut remarks) = plausible::sift(recorded.measurements);
    remarks.extend(plausible::unwitnessed(&measurements));
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
    if let Some((_, what)) = FOREIGN.iter().find(|(begin, _)| bytes.starts_with(begin)) {
        return Err(LogError::new(origin, format!("the file is {what}")));
    }
    if let Some(format) = buses::format(&buses::LINES, head) {
        return buses::read(format, bytes, origin, mount);
    }
    if table::is_table(head) {
        return csv::read(bytes, origin, mount);
    }
    if sentences::is_nmea(head) {
        // VectorNav's sentence looks like NMEA 0183, but is not supported live.
        let is_vectornav = head.windows(VNINS.len()).any(|w| w == VNINS);
        let error = |e: LogError| {
            if is_vectornav {
                LogError {
                    message: format!("{}; {}", e.message, table::CONVERT),
                    ..e
                }
            } else {
                e
            }
        };
        let sentences = sentences::read(bytes, origin, mount).map_err(error);
        // A port may send both; the format with more measurements is used.
        let is_mixed = bytes.windows(2).any(|w| w == UBX);
        let ubx = is_mixed.then(|| buses::read(Format::Ubx, bytes, origin, mount));
        return match (sentences, ubx) {
            (Ok(sentences), Some(Ok(ubx))) if sentences.measurements.len() > ubx.measurements.len() => {
                Ok(sentences)
            }
            (Err(_), Some(Err(ubx))) if buses::format(&[Format::Ubx], head).is_some() => Err(ubx),
            (_, Some(Ok(mut ubx))) => {
                ubx.notes
                    .push("its NMEA 0183 sentences add nothing to its UBX, and are ignored".into());
                Ok(ubx)
            }
            (sentences, _) => sentences,
        };
    }
    if let Some(format) = buses::format(&buses::STREAMS, head) {
        return buses::read(format, bytes, origin, mount);
    }
    match table::has_columns(head) {
        _ if has_json(head) => Err(kind(
            "the file is canboat's JSON: record its plain format, or the frames by candump -L",
        )),
        true => Err(kind("column `t_s` is missing in the first line")),
        false => Err(kind("no known recording format begins like this")),
    }
}

/// Lines of canboat's analyzer.
fn has_json(head: &[u8]) -> bool {
    let pgn = b"\"pgn\":";
    head.starts_with(b"{") && head.windows(pgn.len()).any(|w| w == pgn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        fixtures::{damage, damaged, nav_pvt, sentence},
        sensors::HeaveSign,
    };
    use proptest::prelude::*;

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
        let heaves = r.measurements.iter().map(|m| Some(m.attitude()?.heave));
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
        const CONVERT: &str = "`python -m alight.convert FILE`";
        let begins: [(&[u8], &str, &str); 9] = [
            (b"$VNINS,1,2,0,1,2,3*00\n", "too few", CONVERT),
            (b"ULog\x01\x12\x35\x01rest", "ULog", CONVERT),
            (b"\xa3\x95\x80rest", "DataFlash", CONVERT),
            (b"#ROSBAG V2.0\nrest", "ROS 1", CONVERT),
            (b"SQLite format 3\0rest", "ROS 2", CONVERT),
            (b"#INSPVAA,COM1,0,73.5;1264,1\n", "`t_s` is missing", CONVERT),
            (&ACTISENSE, "Actisense", "actisense-serial -r"),
            (b";$FILEVERSION=1.1", "PCAN-View", "candump -L"),
            (b"Sequence #,Timestamp,PGN\n", "N2KAnalyzer", "candump -L"),
        ];
        for (bytes, name, remedy) in begins {
            let e = read(bytes, "boat.log", &Mount::default())
                .unwrap_err()
                .to_string();
            assert!(e.contains(name) && e.contains(remedy), "{e}");
        }
    }

    #[test]
    fn ubx_between_sentences() {
        // A port with both, as recorded by u-center: a TXT sentence, NAV-PVT at 5 Hz, TXT each second.
        let mut bytes = sentence("GNTXT,01,01,02,u-blox AG").into_bytes();
        for k in 0..100_u32 {
            bytes.extend(nav_pvt(k));
            if k % 5 == 0 {
                bytes.extend(sentence("GNTXT,01,01,02,ANTSTATUS=OK").bytes());
            }
        }
        let r = read(&bytes, "boat.ubx", &Mount::default()).unwrap();
        assert_eq!((r.format, r.measurements.len()), ("UBX", 100));
        // Positions from the sentences are used if there are more of them.
        for k in 0..200 {
            let body = format!(
                "PASHR,1200{:02}.{}0,90.0,T,1.5,-2.0,0.25,0.1,0.1,0.2,2,1",
                k / 10,
                k % 10
            );
            bytes.extend(sentence(&body).bytes());
        }
        let r = read(&bytes, "boat.ubx", &Mount::default()).unwrap();
        assert_eq!((r.format, r.decoded.corrupted), ("NMEA 0183", 0));
        let notes = r.notes.join("\n");
        assert!(notes.contains("200 read"), "{notes}");
    }

    #[test]
    fn candump_with_other_times_and_without() {
        let frame = "can0  09F11923   [8]  FF FF 7F 52 00 21 FE FF";
        let of = |stamp: &dyn Fn(f64) -> String, rest: &str| {
            let lines = (0..300).map(|k| format!("{}{rest}\n", stamp(0.1 * f64::from(k))));
            read(lines.collect::<String>().as_bytes(), "can.txt", &Mount::default())
        };
        let dated = |t: f64| format!(" (2026-05-20 12:00:{t:09.6})  ");
        let from_zero = |t: f64| format!(" ({t:010.6})  ");
        let flagged = frame.replace("can0", "can0  RX - -");
        for (stamp, rest) in [
            (&dated as &dyn Fn(f64) -> String, frame),
            (&from_zero, frame),
            (&|t| format!(" ({:.6})  ", 1_779_278_400.0 + t), &flagged),
        ] {
            let r = of(stamp, rest).unwrap();
            let last = r.measurements.last().map(|m| m.at().secs()).unwrap_or_default();
            assert!(
                r.measurements.len() == 300 && (last - 29.9).abs() < 1e-3,
                "{}",
                stamp(0.0)
            );
        }
        for stamp in [&|_| String::new() as String, &|t: f64| {
            format!(" (000.{:06})  ", 50_000 + (t * 1e6) as u64 % 300)
        }] as [&dyn Fn(f64) -> String; 2]
        {
            let e = of(stamp, frame).unwrap_err().to_string();
            assert!(e.contains("have no time: record with candump -L"), "{e}");
        }
        let json = "{\"timestamp\":\"2026-01-01T12:00:00Z\",\"prio\":3,\"src\":35,\"dst\":255,\"pgn\":127257,\"fields\":{}}\n";
        let e = read(json.repeat(60).as_bytes(), "boat.json", &Mount::default()).unwrap_err();
        assert!(e.to_string().contains("canboat's JSON"), "{e}");
        let delta = "{\"updates\":[{\"$source\":\"n2k.35\",\"values\":[{\"path\":\"navigation.headingTrue\",\"value\":0.7}]}]}\n";
        let e = read(delta.repeat(60).as_bytes(), "boat.jsonl", &Mount::default()).unwrap_err();
        assert!(
            e.to_string().contains("60 have no time: record the server's"),
            "{e}"
        );
        let capture = [&[0xd4, 0xc3, 0xb2, 0xa1, 2, 0][..], b"$GPHDT,40.0,T*00\r\n"].concat();
        let e = read(&capture, "boat.pcap", &Mount::default()).unwrap_err();
        assert!(e.to_string().contains("a packet capture"), "{e}");
    }

    #[test]
    fn heave_of_sentences_by_its_sign() {
        let mut text = String::new();
        for k in 0..600 {
            let t = 0.2 * f64::from(k);
            let time = format!("12{:02}{:05.2}", k / 300, t % 60.0);
            let heave = 0.4 * (1.5 * t).sin();
            let roll = 6.0 * (1.6 * t).sin();
            text += &sentence(&format!(
                "GPGGA,{time},5918.00000,N,01806.00000,E,4,12,0.8,{:.2},M,23.1,M,,",
                2.0 + heave
            ));
            text += &sentence(&format!(
                "PASHR,{time},40.0,T,{roll:.2},{:.2},{heave:.2},0.05,0.05,0.2,2,1",
                0.3 * roll + (1.9 * t).sin()
            ));
        }
        for (sign, contradicts) in [(HeaveSign::Up, false), (HeaveSign::Down, true)] {
            let mount = Mount {
                heave: sign,
                ..Mount::default()
            };
            let notes = read(text.as_bytes(), "boat.nmea", &mount).unwrap().notes;
            let found = notes.iter().any(|n| n.starts_with("heave has the opposite sign"));
            assert_eq!(found, contradicts, "{notes:?}");
        }
    }

    #[test]
    fn positions_of_another_clock() {
        // Attitudes dated by the server; positions dated by a receiver that is behind, also by 1024 weeks.
        for (behind, text) in [
            ("11:59:{}", "positions are dated 60.0 s before"),
            ("12:00:{}", ""),
        ] {
            let mut lines = String::new();
            for k in 0..900 {
                let t = 0.1 * f64::from(k);
                let at = format!("12:{:02}:{:06.3}", (t / 60.0) as u32, t % 60.0);
                lines += &format!(
                    "{{\"updates\":[{{\"$source\":\"n2k.35\",\"timestamp\":\"2026-05-20T{at}Z\",\"values\":[{{\"path\":\
                     \"navigation.attitude\",\"value\":{{\"roll\":{},\"pitch\":0.01}}}}]}}]}}\n",
                    0.1 * t.sin()
                );
                if k % 10 == 0 {
                    let minute = if behind.starts_with("11") {
                        59 + (t / 60.0) as u32
                    } else {
                        (t / 60.0) as u32
                    };
                    let at = format!(
                        "{}:{:02}:{:06.3}",
                        if behind.starts_with("11") {
                            11 + minute / 60
                        } else {
                            12
                        },
                        minute % 60,
                        t % 60.0
                    );
                    lines += &format!(
                        "{{\"updates\":[{{\"$source\":\"gps.GP\",\"timestamp\":\"2026-05-20T{at}Z\",\"values\":[{{\"path\":\
                         \"navigation.position\",\"value\":{{\"latitude\":{},\"longitude\":10.6}}}}]}}]}}\n",
                        59.5 + 2e-5 * t
                    );
                }
            }
            let r = read(lines.as_bytes(), "boat.jsonl", &Mount::default()).unwrap();
            let notes = r.notes.join("\n");
            assert_eq!(notes.contains("two clocks"), !text.is_empty(), "{notes}");
            assert!(notes.contains(text), "{notes}");
            let fixes = r
                .measurements
                .iter()
                .filter(|m| m.kind() == 1)
                .map(|m| m.at().secs());
            for (k, at) in fixes.enumerate() {
                assert!((at - k as f64).abs() < 0.2, "{k}: {at}");
            }
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
