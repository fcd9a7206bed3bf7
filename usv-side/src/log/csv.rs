//! Conversion of tables ([`super::table`]) to measurements: one row per time, one column per quantity. An
//! empty cell means that the quantity was not measured. A quantity may have separate rows.
//!
//! | column | what |
//! |---|---|
//! | `t_s` | time of the row, s; required |
//! | `roll_deg`, `pitch_deg` | attitude, starboard down and bow up positive; both or none |
//! | `heading_deg` | heading, from north towards east |
//! | `heave_m` | heave of the vessel's reference point, up; with an attitude |
//! | `surge_m`, `sway_m` | position along and to starboard of the mean heading; both or none |
//! | `gyro_x_radps`, `_y_`, `_z_` | angular rate in forward, right, down; all or none |
//! | `accel_x_mps2`, `_y_`, `_z_` | specific force in forward, right, down; with the gyro |
//! | `latitude_deg`, `longitude_deg` | antenna, WGS-84; both or none |
//! | `altitude_m` | its height, with the place |
//! | `north_mps`, `east_mps` | its velocity; both or none |
//! | `down_mps` | its velocity |
//!
//! Rates without accelerations are interpolated to the times of attitudes; heaves and rates on separate rows
//! are joined with interpolated attitudes and accelerations.

use alight_shared::{
    estimation::median,
    frames::wrap_angle,
    geodesy::Datum,
    msg::{AttitudeFix, Decoded, GnssFix, NOT_MEASURED_SD},
};

use super::{
    Gather, LogError, MAX_MEASUREMENTS, SensorRecording,
    table::{
        CsvRow, CsvTable, Quantity,
        Quantity::{
            Altitude, Down, East, ForceX, ForceY, ForceZ, GyroX, GyroY, GyroZ, Heading, Heave, Latitude,
            Longitude, North, Pitch, Roll, Surge, Sway,
        },
        TableError,
    },
};
use crate::sensors::{Measurement, Mount, Mounting, SourceMeasurement};

const TOGETHER: [&[Quantity]; 6] = [
    &[Roll, Pitch],
    &[Surge, Sway],
    &GYRO,
    &FORCE,
    &[Latitude, Longitude],
    &[North, East],
];
const GYRO: [Quantity; 3] = [GyroX, GyroY, GyroZ];
const FORCE: [Quantity; 3] = [ForceX, ForceY, ForceZ];
const COLUMNS: &str = "the columns are t_s and any of roll_deg, pitch_deg, heading_deg, heave_m, surge_m, sway_m, \
                       gyro_x_radps, gyro_y_radps, gyro_z_radps, accel_x_mps2, accel_y_mps2, accel_z_mps2, \
                       latitude_deg, longitude_deg, altitude_m, north_mps, east_mps, down_mps";
/// Standard deviation of surge and sway, m: motion capture or RTK.
const PLACE_SD_M: f64 = 0.02;
/// Standard deviation of GNSS position and velocity, m, m/s.
const GNSS_SD: [f64; 2] = [0.5, 0.1];
/// Maximum interpolation gap in median steps, and in s.
const APART: (f64, f64) = (3.0, 2.0);
/// Range of the mean specific force that includes gravity, m/s²; it is 9.8 on a boat.
const WITH_GRAVITY: core::ops::Range<f64> = 7.0..13.0;
/// Minimum number of samples for the gravity check.
const MIN_SAMPLES: usize = 20;
/// Attitude rate below which fast motion is missing, Hz.
const SLOW_HZ: f64 = 4.9;

type Timed<const N: usize> = Option<(f64, [f64; N])>;

struct Series<const N: usize> {
    t: Vec<f64>,
    y: Vec<[f64; N]>,
    /// Maximum interpolation gap, s.
    apart_s: f64,
}

impl<const N: usize> Series<N> {
    /// Series of the rows that have all of these quantities.
    fn of(rows: &[CsvRow], quantities: [Quantity; N]) -> Self {
        let mut all: Vec<(f64, [f64; N])> = rows
            .iter()
            .filter_map(|row| Some((row.t, row.all(quantities)?)))
            .collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (t, y): (Vec<f64>, Vec<[f64; N]>) = all.into_iter().unzip();
        let steps = t.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 0.0);
        let usual = median(steps).unwrap_or_default();
        Series {
            t,
            y,
            apart_s: (APART.0 * usual).min(APART.1),
        }
    }
    /// Median rate, Hz; 0 with fewer than two values.
    fn hz(&self) -> f64 {
        let usual = self.apart_s / APART.0;
        if usual > 0.0 { 1.0 / usual } else { 0.0 }
    }
    /// Values before and after a time, possibly the same one.
    fn around(&self, t: f64) -> (Timed<N>, Timed<N>) {
        let k = self.t.partition_point(|x| *x < t);
        let at = |k: usize| Some((*self.t.get(k)?, *self.y.get(k)?));
        (k.checked_sub(1).and_then(at), at(k))
    }
    /// Interpolated value at a time, if there are close values before and after it.
    fn at(&self, t: f64) -> Option<[f64; N]> {
        match self.around(t) {
            (_, Some((b, y))) if b == t => Some(y),
            (Some((a, ya)), Some((b, yb))) if b - a <= self.apart_s => {
                let s = (t - a) / (b - a);
                Some(core::array::from_fn(|k| ya[k] + s * (yb[k] - ya[k])))
            }
            (_, _) => None,
        }
    }
    fn nearest(&self, t: f64) -> Option<[f64; N]> {
        match self.around(t) {
            (Some((a, ya)), Some((b, yb))) => Some(if t - a < b - t { ya } else { yb }),
            (one, other) => one.or(other).map(|(_, y)| y),
        }
    }
}

pub(super) fn read(bytes: &[u8], origin: &str, mount: &Mount) -> Result<SensorRecording, LogError> {
    let error = |e: TableError| match e {
        TableError::Header { line, message } => {
            LogError::at_line(origin, line, format!("{message}; {COLUMNS}"))
        }
        TableError::Row { line, message } => LogError::at_line(origin, line, message),
    };
    let mut table = CsvTable::read(bytes).map_err(error)?;
    table.require_together(&TOGETHER).map_err(error)?;
    let decoded = Decoded {
        good: table.read,
        corrupted: table.bad.count,
        ..Decoded::default()
    };
    if decoded.corrupted > decoded.good {
        let (line, message) = table.bad.first.clone().unwrap_or_default();
        return Err(LogError::at_line(
            origin,
            line,
            format!("{message}; more than half of the rows cannot be used"),
        ));
    }
    let alone = |q: Quantity, needs: &str| {
        table.header_error(format!("column `{}` is present without {needs}", q.name()))
    };
    if table.has(Heave) && !table.has(Roll) {
        return Err(error(alone(Heave, "`roll_deg`")));
    }
    if table.has(GyroX) && !table.has(ForceX) && !table.has(Roll) {
        return Err(error(alone(
            GyroX,
            "`accel_x_mps2` or `roll_deg`: rates alone give no attitude",
        )));
    }
    if table.has(ForceX) && !table.has(GyroX) && !table.has(Roll) {
        return Err(error(alone(ForceX, "`gyro_x_radps`")));
    }
    if table.has(Altitude) && !table.has(Latitude) {
        return Err(error(alone(Altitude, "`latitude_deg`")));
    }
    let mut reading = Reading::of(&table, mount);
    reading.check_gravity(&table, origin)?;
    let mut gather = Gather::default();
    // Relative to the first row, because nanoseconds since 1970 are coarse in floating point.
    let begin = table.rows.first().map_or(0.0, |r| r.t);
    for row in &table.rows {
        let at_ns = ((row.t - begin) * 1e9).round() as i64;
        for measurement in reading.measurements(row) {
            gather.push(SourceMeasurement { at_ns, measurement }, 0);
        }
    }
    let mut notes = Vec::new();
    if let Some((line, message)) = &table.bad.first {
        notes.push(format!(
            "line {line} and {} more rows left out: {message}",
            decoded.corrupted - 1
        ));
    }
    if let Some((line, _)) = table.backwards {
        notes.push(format!("the time decreases in line {line}"));
    }
    notes.extend(reading.notes(&table));
    if table.rows.len() > MAX_MEASUREMENTS {
        let message = format!("more than {MAX_MEASUREMENTS} rows; cut the table into parts");
        return Err(LogError::new(origin, message));
    }
    let columns: Vec<&str> = table.unused(&[]).into_iter().map(Quantity::name).collect();
    let found = format!("{} rows of {}", decoded.good, columns.join(", "));
    Ok(SensorRecording {
        format: "CSV",
        measurements: gather.finish(origin, &found)?,
        decoded,
        notes,
    })
}

struct Reading {
    mounting: Mounting,
    mean_heading: f64,
    inertial: bool,
    gyro: Series<3>,
    tilt: Series<2>,
    place: Series<2>,
    altitude: Series<1>,
    /// Attitudes with rates, and rates on separate rows.
    rated: u64,
    own_rates: u64,
    /// Heaves on separate rows, and how many of these lack an attitude.
    own_heaves: u64,
    lost_heaves: u64,
    lost_forces: u64,
    own_velocities: u64,
    /// Rows at 0 N 0 E.
    nowhere: u64,
}

impl Reading {
    fn of(table: &CsvTable, mount: &Mount) -> Self {
        let rows = &table.rows;
        // Surge and sway are along the mean heading, or north before the first heading.
        let mut s = 0.0;
        let mut c = 0.0;
        for heading in rows.iter().filter_map(|r| r.get(Heading)) {
            let (a, b) = heading.to_radians().sin_cos();
            s += a;
            c += b;
        }
        let mean_heading = if s == 0.0 && c == 0.0 {
            0.0
        } else {
            f64::atan2(s, c)
        };
        let gyro = Series::of(rows, GYRO);
        let some = |q: [Quantity; 3]| rows.iter().any(|r| r.all(q).is_some());
        Reading {
            mounting: Mounting::new(mount),
            mean_heading,
            inertial: !gyro.t.is_empty() && some(FORCE),
            gyro,
            tilt: Series::of(rows, [Roll, Pitch]),
            place: Series::of(rows, [Latitude, Longitude]),
            altitude: Series::of(rows, [Altitude]),
            rated: 0,
            own_rates: 0,
            own_heaves: 0,
            lost_heaves: 0,
            lost_forces: 0,
            own_velocities: 0,
            nowhere: 0,
        }
    }

    /// Checks that accelerations are specific force (forward, right, down) with gravity upwards.
    fn check_gravity(&self, table: &CsvTable, origin: &str) -> Result<(), LogError> {
        let forces: Vec<[f64; 3]> = table.rows.iter().filter_map(|r| r.all(FORCE)).collect();
        if forces.len() < MIN_SAMPLES || !self.inertial {
            return Ok(());
        }
        let n = forces.len() as f64;
        let size = forces.iter().map(|[x, y, z]| x.hypot(*y).hypot(*z)).sum::<f64>() / n;
        if !WITH_GRAVITY.contains(&size) {
            return Err(LogError::new(
                origin,
                format!(
                    "the accelerations are {size:.2} m/s² in the mean, 9.8 on a boat: specific force, gravity in it, is \
                     read; correct their unit, or leave the columns out"
                ),
            ));
        }
        let down = forces.iter().map(|f| self.mounting.vector(*f)[2]).sum::<f64>() / n;
        if down > 0.5 * size {
            return Err(LogError::new(
                origin,
                format!(
                    "the accelerations' mean along down is {down:.2} m/s², -9.8 on a boat: the sensor's third axis is \
                     not down; name a configuration (--config) with its mounting, mounting_deg = [180, 0, 0] in \
                     [sensor.sources.mount] for one whose axes are forward, left, up"
                ),
            ));
        }
        Ok(())
    }

    fn measurements(&mut self, row: &CsvRow) -> Vec<Measurement> {
        let mut out = Vec::new();
        out.extend(self.imu(row));
        out.extend(self.attitude(row));
        out.extend(self.displacement(row));
        out.extend(self.fix(row));
        if let Some(heading) = row.get(Heading) {
            let heading = wrap_angle(heading.to_radians());
            out.push(self.mounting.heading_fix(self.mounting.heading(heading)).into());
        }
        out
    }

    fn imu(&mut self, row: &CsvRow) -> Option<Measurement> {
        let force = row.all(FORCE)?;
        let Some(gyro) = row.all(GYRO).or_else(|| self.gyro.at(row.t)) else {
            self.lost_forces += 1;
            return None;
        };
        Some(self.mounting.imu(gyro, force).into())
    }

    fn attitude(&mut self, row: &CsvRow) -> Option<Measurement> {
        let heave = row.get(Heave);
        let rates = row.all(GYRO);
        let tilt = row.all([Roll, Pitch]);
        self.own_rates += u64::from(rates.is_some() && tilt.is_none() && !self.inertial);
        let tilt = match tilt {
            Some(tilt) => tilt,
            None => {
                heave?;
                self.own_heaves += 1;
                let between = self.tilt.at(row.t);
                self.lost_heaves += u64::from(between.is_none());
                between?
            }
        };
        // An inertial sensor provides the rates itself.
        let rates = rates.or_else(|| self.gyro.at(row.t)).filter(|_| !self.inertial);
        self.rated += u64::from(rates.is_some());
        let [roll, pitch] = tilt.map(f64::to_radians);
        let heading = row.get(Heading).map_or(0.0, f64::to_radians);
        let [roll, pitch, _] = self.mounting.attitude([roll, pitch, heading]);
        Some(Measurement::Attitude(AttitudeFix {
            rates: rates.map(|r| self.mounting.vector(r)),
            heave: heave.and_then(|h| self.mounting.heave(h)),
            heave_sd: self.mounting.mount.heave_sd_m,
            ..self.mounting.tilt([roll, pitch])
        }))
    }

    fn displacement(&self, row: &CsvRow) -> Option<Measurement> {
        let [surge, sway] = row.all([Surge, Sway])?;
        let (s, c) = self.mean_heading.sin_cos();
        Some(Measurement::Gnss(GnssFix {
            position: [c * surge - s * sway, s * surge + c * sway, 0.0],
            position_sd: self
                .mounting
                .position_sd([PLACE_SD_M, PLACE_SD_M, NOT_MEASURED_SD]),
            velocity_sd: [NOT_MEASURED_SD; 3],
            // Position of the reference point itself.
            lever_arm: Some([0.0; 3]),
            ..GnssFix::default()
        }))
    }

    fn fix(&mut self, row: &CsvRow) -> Option<Measurement> {
        let place = row.all([Latitude, Longitude]);
        let altitude = row.get(Altitude);
        let velocity = row.all([North, East]);
        let down = row.get(Down);
        if place.is_none() && altitude.is_none() && velocity.is_none() && down.is_none() {
            return None;
        }
        if place == Some([0.0; 2]) {
            self.nowhere += 1;
            return None;
        }
        self.own_velocities += u64::from(place.is_none() && velocity.is_some());
        // A position is the origin of its own plane; a row without one uses the nearest.
        let near = self.place.at(row.t).or_else(|| self.place.nearest(row.t));
        let [latitude_deg, longitude_deg] = place.or(near).unwrap_or_default();
        let level = || self.altitude.nearest(row.t).map(|[a]| a);
        let datum = Datum::new(
            latitude_deg,
            longitude_deg,
            altitude.or_else(level).unwrap_or_default(),
        );
        let [sd, velocity_sd] = GNSS_SD;
        let measured = |is: bool, sd: f64| if is { sd } else { NOT_MEASURED_SD };
        let across = measured(place.is_some(), sd);
        let position_sd = [across, across, measured(altitude.is_some(), 2.0 * sd)];
        let across = measured(velocity.is_some(), velocity_sd);
        let velocity_sd = [across, across, measured(down.is_some(), velocity_sd)];
        let [north, east] = velocity.unwrap_or_default();
        let velocity = [north, east, down.unwrap_or_default()];
        Some(
            self.mounting
                .fix(datum, velocity, position_sd, velocity_sd)
                .into(),
        )
    }

    /// Notes on quantities that cannot be used without a missing one.
    fn notes(&self, table: &CsvTable) -> Vec<String> {
        let mut notes = Vec::new();
        if self.rated > 0 {
            let own = match self.own_rates {
                0 => "",
                _ => ", interpolated to their times",
            };
            notes.push(format!(
                "no accelerations: the rates are joined with {} attitudes{own}",
                self.rated
            ));
        }
        if table.has(GyroX) && !self.inertial && self.rated == 0 {
            notes.push(
                "the rates are not used: no attitude is near in time, and there are no accelerations".into(),
            );
        }
        if self.lost_forces > 0 {
            notes.push(format!(
                "{} accelerations without rates are left out",
                self.lost_forces
            ));
        }
        if self.own_heaves > 0 {
            notes.push(format!(
                "heave on {} rows of its own goes with the attitude interpolated at its time; {} without an attitude \
                 near are left out",
                self.own_heaves, self.lost_heaves
            ));
        }
        if self.nowhere > 0 {
            notes.push(format!(
                "{} fixes at 0 N 0 E (a receiver without a fix) are left out",
                self.nowhere
            ));
        }
        if self.own_velocities > 0 && !self.place.t.is_empty() {
            notes.push(format!(
                "{} velocities on rows without a position are used alone",
                self.own_velocities
            ));
        }
        if !self.place.t.is_empty() && self.altitude.t.is_empty() {
            notes.push("no altitude: the receiver does not measure heave".into());
        }
        let hz = self.tilt.hz();
        if !self.inertial && hz > 0.0 && hz < SLOW_HZ {
            notes.push(format!(
                "attitudes at {hz:.1} Hz, below 5 Hz: fast motion between them is missing from the estimate"
            ));
        }
        let empty = table.unused(&[]).into_iter().filter(|q| !table.any(*q));
        let empty: Vec<&str> = empty.map(Quantity::name).collect();
        if !empty.is_empty() {
            notes.push(format!("columns without a value: {}", empty.join(", ")));
        }
        notes
    }
}

#[cfg(test)]
mod tests;
