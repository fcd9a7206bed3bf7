//! Tables (CSV): one row per instant, one column per quantity; an empty cell was not measured.
//!
//! | column | what |
//! |---|---|
//! | `t_s` | time of the row, s; must be there |
//! | `roll_deg`, `pitch_deg` | attitude, starboard down and bow up positive; both or none |
//! | `heading_deg` | heading, from north towards east |
//! | `heave_m` | heave of the vessel's reference point, up |
//! | `surge_m`, `sway_m` | place along and to starboard of the mean heading; both or none |
//! | `gyro_x_radps`, `_y_`, `_z_` | angular rate in forward, right, down; all or none |
//! | `accel_x_mps2`, `_y_`, `_z_` | specific force in forward, right, down; with the gyro |
//! | `latitude_deg`, `longitude_deg`, `altitude_m` | antenna, WGS-84; all or none |
//! | `north_mps`, `east_mps`, `down_mps` | its velocity; with the place |

use ::csv::{ReaderBuilder, StringRecord, Trim};
use alight_shared::frames::wrap_angle;
use alight_shared::geodesy::Datum;
use alight_shared::msg::{AttitudeFix, GnssFix, NOT_MEASURED_SD};

use super::{Gather, LogError, MAX_MEASUREMENTS, Recording};
use crate::sensors::{Decoded, Measurement, Mount, Mounting, SourceMeasurement};

/// Columns with the largest magnitude that a cell may have.
const COLUMNS: [(&str, f64); 19] = [
    ("t_s", 1e10),
    ("roll_deg", 75.0),
    ("pitch_deg", 75.0),
    ("heading_deg", 1e5),
    ("heave_m", 50.0),
    ("surge_m", 1e5),
    ("sway_m", 1e5),
    ("gyro_x_radps", 50.0),
    ("gyro_y_radps", 50.0),
    ("gyro_z_radps", 50.0),
    ("accel_x_mps2", 500.0),
    ("accel_y_mps2", 500.0),
    ("accel_z_mps2", 500.0),
    ("latitude_deg", 90.0),
    ("longitude_deg", 360.0),
    ("altitude_m", 1e4),
    ("north_mps", 100.0),
    ("east_mps", 100.0),
    ("down_mps", 100.0),
];
const TIME: usize = 0;
const ROLL: usize = 1;
const PITCH: usize = 2;
const HEADING: usize = 3;
const HEAVE: usize = 4;
const SURGE: usize = 5;
const SWAY: usize = 6;
const GYRO: usize = 7;
const ACCELEROMETER: usize = 10;
const PLACE: usize = 13;
const VELOCITY: usize = 16;

/// Columns of which a file has all or none.
const TOGETHER: [&[usize]; 5] = [
    &[ROLL, PITCH],
    &[SURGE, SWAY],
    &[
        GYRO,
        GYRO + 1,
        GYRO + 2,
        ACCELEROMETER,
        ACCELEROMETER + 1,
        ACCELEROMETER + 2,
    ],
    &[PLACE, PLACE + 1, PLACE + 2],
    &[VELOCITY, VELOCITY + 1, VELOCITY + 2],
];
/// Standard deviation of surge and sway, m (ours: motion capture, RTK).
const PLACE_SD_M: f64 = 0.02;
/// Standard deviation of a GNSS position and velocity, m, m/s (ours).
const GNSS_SD: [f64; 2] = [0.5, 0.1];

/// The cells of a row.
type Row = [Option<f64>; COLUMNS.len()];

/// Reads a table.
pub(super) fn read(bytes: &[u8], origin: &str, mount: &Mount) -> Result<Recording, LogError> {
    let (rows, decoded, first_bad) = rows(bytes, origin)?;
    if decoded.corrupted > decoded.good {
        let (line, message) = first_bad.unwrap_or_default();
        return Err(LogError::at_line(
            origin,
            line,
            format!("{message}; more than half of the rows cannot be used"),
        ));
    }
    let mounting = Mounting::new(mount);
    // Surge and sway are along the mean heading, which is north where it was not recorded.
    let (mut s, mut c) = (0.0, 0.0);
    for heading in rows.iter().filter_map(|r| r[HEADING]) {
        let (a, b) = heading.to_radians().sin_cos();
        (s, c) = (s + a, c + b);
    }
    let mean_heading = if s == 0.0 && c == 0.0 {
        0.0
    } else {
        f64::atan2(s, c)
    };
    let mut gather = Gather::default();
    for row in &rows {
        let Some(t) = row[TIME] else { continue };
        let at_ns = (t * 1e9).round() as i64;
        for measurement in measurements(row, &mounting, mean_heading) {
            gather.push(SourceMeasurement { at_ns, measurement }, 0);
        }
    }
    let mut notes = Vec::new();
    if let Some((line, message)) = first_bad {
        notes.push(format!(
            "line {line} and {} more rows left out: {message}",
            decoded.corrupted - 1
        ));
    }
    Ok(Recording {
        format: "CSV",
        measurements: gather.finish(origin)?,
        decoded,
        notes,
    })
}

/// The measurements of a row.
fn measurements(row: &Row, mounting: &Mounting, mean_heading: f64) -> Vec<Measurement> {
    let mut out = Vec::new();
    let three = |first: usize| -> Option<[f64; 3]> {
        let cell = |k: usize| row.get(first + k).copied().flatten();
        Some([cell(0)?, cell(1)?, cell(2)?])
    };
    if let (Some(gyro), Some(force)) = (three(GYRO), three(ACCELEROMETER)) {
        out.push(mounting.imu(gyro, force).into());
    }
    let heading = row[HEADING].map(|h| wrap_angle(h.to_radians()));
    if let (Some(roll), Some(pitch)) = (row[ROLL], row[PITCH]) {
        let shown = [roll.to_radians(), pitch.to_radians(), heading.unwrap_or_default()];
        let [roll, pitch, _] = mounting.attitude(shown);
        out.push(Measurement::Attitude(AttitudeFix {
            heave: row[HEAVE].and_then(|h| mounting.heave(h)),
            heave_sd: mounting.mount.heave_sd_m,
            ..mounting.tilt([roll, pitch])
        }));
    }
    if let (Some(surge), Some(sway)) = (row[SURGE], row[SWAY]) {
        let (s, c) = mean_heading.sin_cos();
        out.push(Measurement::Gnss(GnssFix {
            position: [c * surge - s * sway, s * surge + c * sway, 0.0],
            position_sd: mounting.position_sd([PLACE_SD_M, PLACE_SD_M, NOT_MEASURED_SD]),
            velocity_sd: [NOT_MEASURED_SD; 3],
            // The place of the reference point itself.
            lever_arm: Some([0.0; 3]),
            ..GnssFix::default()
        }));
    }
    if let Some([latitude_deg, longitude_deg, height_m]) = three(PLACE) {
        let velocity = three(VELOCITY);
        let [sd, velocity_sd] = GNSS_SD;
        let velocity_sd = velocity.map_or(NOT_MEASURED_SD, |_| velocity_sd);
        // The position is the origin of its own plane.
        let datum = Datum::new(latitude_deg, longitude_deg, height_m);
        let velocity = velocity.unwrap_or_default();
        let fix = mounting.fix(datum, velocity, [sd, sd, 2.0 * sd], [velocity_sd; 3]);
        out.push(fix.into());
    }
    if let Some(heading) = heading {
        out.push(mounting.heading_fix(mounting.heading(heading)).into());
    }
    out
}

type Rows = (Vec<Row>, Decoded, Option<(u64, String)>);

/// Header and rows; rows that cannot be used are counted, and the first is named.
fn rows(bytes: &[u8], origin: &str) -> Result<Rows, LogError> {
    let header = |message: String| {
        let columns = COLUMNS[1..].iter().map(|c| c.0).collect::<Vec<_>>().join(", ");
        LogError::at_line(
            origin,
            1,
            format!("{message}; the columns are t_s and any of {columns}"),
        )
    };
    let mut reader = ReaderBuilder::new()
        .trim(Trim::All)
        .flexible(true)
        .from_reader(bytes);
    let names = reader.headers().map_err(|e| header(e.to_string()))?.clone();
    let mut columns = Vec::with_capacity(names.len());
    let mut has = [false; COLUMNS.len()];
    for name in &names {
        let name = name.trim_start_matches('\u{feff}');
        let Some(k) = COLUMNS.iter().position(|c| c.0 == name) else {
            return Err(header(format!("unknown column `{name}`")));
        };
        if core::mem::replace(&mut has[k], true) {
            return Err(header(format!("column `{name}` appears twice")));
        }
        columns.push(k);
    }
    if !has[TIME] {
        return Err(header("column `t_s` is missing".into()));
    }
    for group in TOGETHER {
        if let (Some(there), Some(missing)) =
            (group.iter().find(|k| has[**k]), group.iter().find(|k| !has[**k]))
        {
            return Err(header(format!(
                "column `{}` is there without `{}`",
                COLUMNS[*there].0, COLUMNS[*missing].0
            )));
        }
    }
    if has[HEAVE] && !has[ROLL] {
        return Err(header("column `heave_m` is there without `roll_deg`".into()));
    }
    let (mut rows, mut decoded, mut first_bad) = (Vec::new(), Decoded::default(), None);
    let mut record = StringRecord::new();
    let mut line = 1_u64;
    loop {
        line += 1;
        let read = reader.read_record(&mut record);
        // The reader's own count, where it has one: it counts empty lines.
        let here = record.position().map_or(line, ::csv::Position::line);
        let row = match read {
            Ok(false) => break,
            Ok(true) => cells(&record, &columns),
            Err(e) => Err(e.to_string()),
        };
        match row {
            Ok(row) => {
                decoded.good += 1;
                if rows.len() >= MAX_MEASUREMENTS {
                    let message = format!("more than {MAX_MEASUREMENTS} rows; cut the table into parts");
                    return Err(LogError::new(origin, message));
                }
                rows.push(row);
            }
            Err(message) => {
                decoded.corrupted += 1;
                first_bad.get_or_insert((here, message));
            }
        }
    }
    Ok((rows, decoded, first_bad))
}

/// The numbers of a row.
fn cells(record: &StringRecord, columns: &[usize]) -> Result<Row, String> {
    if record.len() != columns.len() {
        return Err(format!("{} values for {} columns", record.len(), columns.len()));
    }
    let mut row: Row = [None; COLUMNS.len()];
    for (text, k) in record.iter().zip(columns) {
        let (name, limit) = COLUMNS[*k];
        if text.is_empty() && *k != TIME {
            continue;
        }
        let value: f64 = text
            .parse()
            .map_err(|_| format!("{name} is `{text}`, not a number"))?;
        // A NaN is not within.
        if !(value.abs() <= limit) {
            return Err(format!("{name} is {text}, allowed is -{limit} to {limit}"));
        }
        row[*k] = Some(value);
    }
    Ok(row)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(rows: usize) -> String {
        let mut text = String::from("t_s,roll_deg,pitch_deg,heading_deg,heave_m,surge_m,sway_m\n");
        for k in 0..rows {
            text += &format!("{:.1},1,2,90,0.5,3,4\n", 0.1 * k as f64);
        }
        text
    }

    #[test]
    fn csv_column_groups() {
        let r = read(table(60).as_bytes(), "t", &Mount::default()).unwrap();
        let [
            Measurement::Attitude(a),
            Measurement::Gnss(g),
            Measurement::Heading(h),
        ] = r.measurements[..3]
        else {
            panic!("{:?}", &r.measurements[..3]);
        };
        assert!(
            (a.tilt[0] - 1_f64.to_radians()).abs() < 1e-12 && (a.tilt[1] - 2_f64.to_radians()).abs() < 1e-12
        );
        assert_eq!(a.heave, Some(-0.5), "down");
        assert!((h.heading - 90_f64.to_radians()).abs() < 1e-12);
        // Forward is east.
        assert!(
            (g.position[1] - 3.0).abs() < 1e-9 && (g.position[0] + 4.0).abs() < 1e-9,
            "{g:?}"
        );
        assert_eq!((r.measurements.len(), r.decoded.good), (180, 60));
    }

    #[test]
    fn csv_bad_rows_and_headers() {
        let mut text = table(60);
        text += "6.0,x,2,90,0,3,4\n\n6.1,1,2\n6.2,1,NaN,90,0,3,4\n";
        let r = read(text.as_bytes(), "t", &Mount::default()).unwrap();
        assert_eq!((r.decoded.good, r.decoded.corrupted), (60, 3));
        assert!(
            r.notes[0].contains("line 62") && r.notes[0].contains("roll_deg"),
            "{:?}",
            r.notes
        );
        for (bad, message) in [
            ("t_s,roll_deg\n0,1\n", "pitch_deg"),
            ("t_s,roll\n0,1\n", "unknown column `roll`"),
            ("roll_deg,pitch_deg\n0,1\n", "t_s"),
            ("t_s,t_s\n0,1\n", "twice"),
            ("t_s,roll_deg,pitch_deg\n0,a,1\n", "line 2"),
            ("t_s,roll_deg,pitch_deg\n0,1,1\n", "too few"),
        ] {
            let e = read(bad.as_bytes(), "t", &Mount::default())
                .unwrap_err()
                .to_string();
            assert!(e.contains(message), "{bad}: {e}");
        }
    }
}
