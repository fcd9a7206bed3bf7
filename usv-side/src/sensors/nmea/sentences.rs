//! Content of each kind of sentence.

use alight_shared::{
    geodesy::{Datum, KNOT_MPS},
    msg::NOT_MEASURED_SD,
};
use nmea_kit::nmea::sentences::{Gga, Gll, Gns, Hdg, Pashr, Prdid, Rmc, Rot, Vtg, Xdr};

use super::{
    HEADINGS, MAX_SPARE, NmeaDecoder, PLACES, Position, SourceMeasurement, TILTS, TURNS, Untimed,
    account::{UNSAFE_SD, Why},
};

/// Speed below which a velocity needs no course, m/s.
pub(in crate::sensors) const STILL_MPS: f64 = 0.3;
/// Standard deviation of a velocity with a resolution of 0.1 kn, m/s (ours).
pub(in crate::sensors) const VELOCITY_SD: f64 = 0.1;
/// Standard deviation of a position by GGA's quality, m at a dilution of 1 (our choice): the part that
/// changes within a minute; the rest is the filter's height bias. NovAtel sends 9 for SBAS instead of the
/// standard's 2.
const POSITION_SD: [(u8, f64); 6] = [(1, 0.5), (2, 0.3), (3, 0.5), (4, 0.01), (5, 0.1), (9, 0.3)];
/// Standard deviation of a position by dead reckoning, m.
const DEAD_RECKONING_SD: f64 = 5.0;
/// Qualities of GGA: dead reckoning, input by hand, simulated.
const DEAD_RECKONING: u8 = 6;
const MANUAL: u8 = 7;
const SIMULATED: u8 = 8;
/// Minute of arc of latitude, m.
const MINUTE_M: f64 = 1852.0;
/// Standard deviation of a magnetic compass, rad: deviation on a boat (2 deg, ours).
pub(in crate::sensors) const MAGNETIC_SD: f64 = 0.035;
/// Quality as in GGA from mode letters of GNS, RMC, GLL and VTG: the best, unless one is simulated.
fn quality_of(modes: &str) -> u8 {
    let has = |letter: char| modes.contains(letter);
    for (letter, quality) in [
        ('S', SIMULATED),
        ('M', MANUAL),
        ('R', 4),
        ('F', 5),
        ('P', 2),
        ('D', 2),
        ('A', 1),
        ('E', DEAD_RECKONING),
    ] {
        if has(letter) {
            return quality;
        }
    }
    0
}
/// Quality from a status and, since version 2.3 of the standard, a mode.
fn quality_with_status(status: Option<char>, mode: Option<char>) -> u8 {
    let by_mode = mode.map_or(1, |m| quality_of(m.encode_utf8(&mut [0; 4])));
    match status {
        Some('V') if !matches!(by_mode, MANUAL | SIMULATED) => 0,
        Some(_) | None => by_mode,
    }
}
/// Standard deviation at a dilution of 1, m, or why the position is not a fix.
pub(in crate::sensors) fn accuracy(quality: u8) -> Result<f64, Why> {
    match quality {
        0 => Err(Why::NoFix),
        MANUAL | SIMULATED => Err(Why::Simulated),
        DEAD_RECKONING => Ok(DEAD_RECKONING_SD),
        known => {
            let of = POSITION_SD.iter().find(|q| q.0 == known);
            of.map(|q| q.1).ok_or(Why::Quality(known))
        }
    }
}
/// Whether a THS heading is valid by its mode: autonomous or estimated, not manual, simulated or invalid.
pub(super) fn mode_of_ths(mode: Option<char>) -> Result<(), Why> {
    match mode {
        Some('A' | 'E') => Ok(()),
        Some('M' | 'S') => Err(Why::Simulated),
        Some(_) | None => Err(Why::Invalid),
    }
}
/// Standard deviation of half a step of a coordinate with this many decimals of a minute, m.
fn resolution(coordinate: Option<&&str>) -> f64 {
    let decimals = coordinate
        .and_then(|c| c.split_once('.'))
        .map_or(0, |(_, d)| d.len().min(9));
    MINUTE_M * 0.1_f64.powi(decimals as i32) / 12_f64.sqrt()
}
fn rad(degrees: Option<f32>) -> Option<f64> {
    degrees.map(|d| f64::from(d).to_radians())
}
/// Heading, rad, or why it is missing.
fn in_turn(degrees: Option<f32>) -> Result<f64, Why> {
    let degrees = degrees.ok_or(Why::Empty)?;
    match (0.0..=360.0).contains(&degrees) {
        true => Ok(f64::from(degrees).to_radians()),
        false => Err(Why::Range),
    }
}
fn number(fields: &[&str], at: usize) -> Option<f64> {
    fields.get(at)?.parse::<f64>().ok().filter(|v| v.is_finite())
}

impl NmeaDecoder {
    pub(super) fn gga(&mut self, address: &str, s: &Gga, fields: &[&str], out: &mut Vec<SourceMeasurement>) {
        let place = position(s.lat, s.ns, s.lon, s.ew);
        let height = (s.altitude, s.geoid_sep);
        let quality = s.quality.unwrap_or_default();
        let sd = accuracy(quality).map(|sd| sd_at(quality, sd, s.hdop, fields.get(1)));
        if self.open(address, s.time.as_deref(), out).is_some() {
            self.with_height(address, place, sd, height, out);
        }
    }
    pub(super) fn gns(&mut self, address: &str, s: &Gns, fields: &[&str], out: &mut Vec<SourceMeasurement>) {
        let place = position(s.lat, s.ns, s.lon, s.ew);
        let height = (s.altitude, s.geoid_sep);
        let quality = quality_of(s.mode.as_deref().unwrap_or_default());
        let sd = accuracy(quality).map(|sd| sd_at(quality, sd, s.hdop, fields.get(1)));
        let sd = self.by_status(sd, s.nav_status);
        if self.open(address, s.time.as_deref(), out).is_some() {
            self.with_height(address, place, sd, height, out);
        }
    }
    /// Standard deviation for the navigational status, m: only status U marks an unsafe position.
    fn by_status(&mut self, sd: Result<f64, Why>, status: Option<char>) -> Result<f64, Why> {
        let is_unsafe = status == Some('U');
        self.account.unsafe_positions += u64::from(is_unsafe && sd.is_ok());
        sd.map(|sd| if is_unsafe { sd.max(UNSAFE_SD) } else { sd })
    }
    /// Adds a position with a height above the sea and, if stated, the sea's height above the ellipsoid.
    fn with_height(
        &mut self,
        address: &str,
        place: Option<Datum>,
        sd: Result<f64, Why>,
        (altitude, separation): (Option<f32>, Option<f32>),
        out: &mut Vec<SourceMeasurement>,
    ) {
        // Without a valid height, do not wait for one any longer.
        if let Some(e) = self.epoch.as_mut() {
            e.levelled = true;
        }
        let sd = match self.usable(address, place, sd) {
            Ok((place, sd)) => {
                let position = self.position(place, sd, altitude, separation);
                if let Some(e) = self.epoch.as_mut() {
                    // RMC's position in the same epoch has no height.
                    if !e.position.is_some_and(|p| p.has_height()) {
                        e.position = Some(position);
                    }
                }
                None
            }
            Err(why) => Some(why),
        };
        if let Some(why) = sd {
            self.left_out(address, why);
            if let Some(e) = self.epoch.as_mut().filter(|e| !e.fixed && why != Why::Empty) {
                (e.rejected, e.position, e.velocity) = (true, None, None);
            }
        }
        self.emit(false, out);
    }
    /// Position of a sentence with its standard deviation, m; an error if another device is selected.
    fn usable(
        &mut self,
        address: &str,
        place: Option<Datum>,
        sd: Result<f64, Why>,
    ) -> Result<(Datum, f64), Why> {
        let (sd, place) = (sd?, place.ok_or(Why::Empty)?);
        if place.is_nowhere() {
            return Err(Why::Nowhere);
        }
        let value = [place.latitude_deg, place.longitude_deg];
        match self.is_used(PLACES, address, (value, sd), false) {
            true => Ok((place, sd)),
            false => Err(Why::Spare),
        }
    }
    fn position(
        &mut self,
        place: Datum,
        sd: f64,
        altitude: Option<f32>,
        separation: Option<f32>,
    ) -> Position {
        let Some(altitude) = altitude else {
            return without_height(place, sd);
        };
        let (separation, height_spread) =
            self.heights
                .separation(&place, altitude.into(), separation.map(f64::from));
        Position {
            datum: Datum {
                height_m: f64::from(altitude) + separation,
                ..place
            },
            sd: [sd, sd, 2.0 * sd],
            height_spread,
        }
    }

    pub(super) fn rmc(&mut self, address: &str, s: &Rmc, fields: &[&str], out: &mut Vec<SourceMeasurement>) {
        let quality = quality_with_status(s.status, s.pos_mode);
        let sd = accuracy(quality).map(|sd| sd_at(quality, sd, None, fields.get(2)));
        let sd = self.by_status(sd, s.nav_status);
        let place = position(s.lat, s.ns, s.lon, s.ew);
        self.state_variation(address, variation(s.mag_var, s.mag_var_ew));
        let velocity = velocity(s.sog, s.cog);
        if self.open(address, s.time.as_deref(), out).is_none() {
            return;
        }
        if let (Ok(_), Some(v), Some(e)) = (sd, velocity, self.epoch.as_mut().filter(|e| !e.rejected)) {
            e.velocity.get_or_insert(v);
        }
        self.flat(address, place, sd, out);
    }
    pub(super) fn gll(&mut self, address: &str, s: &Gll, fields: &[&str], out: &mut Vec<SourceMeasurement>) {
        let quality = quality_with_status(s.status, s.mode);
        let sd = accuracy(quality).map(|sd| sd_at(quality, sd, None, fields.first()));
        let place = position(s.lat, s.ns, s.lon, s.ew);
        if self.open(address, s.time.as_deref(), out).is_some() {
            self.flat(address, place, sd, out);
        }
    }
    /// Adds a position without a height, for epochs without a better sentence.
    fn flat(
        &mut self,
        address: &str,
        place: Option<Datum>,
        sd: Result<f64, Why>,
        out: &mut Vec<SourceMeasurement>,
    ) {
        match self.usable(address, place, sd) {
            Ok((place, sd)) => {
                if let Some(e) = self.epoch.as_mut().filter(|e| !e.rejected) {
                    e.position.get_or_insert_with(|| without_height(place, sd));
                }
            }
            Err(why) => self.left_out(address, why),
        }
        self.emit(false, out);
    }

    pub(super) fn vtg(&mut self, address: &str, s: &Vtg, out: &mut Vec<SourceMeasurement>) {
        // Version 2.3 added the mode.
        let verdict = s
            .mode
            .map_or(Ok(0.0), |m| accuracy(quality_of(m.encode_utf8(&mut [0; 4]))));
        let knots = s.speed_kts.or_else(|| s.speed_kmh.map(|v| v / 1.852));
        match (verdict, velocity(knots, s.course_true)) {
            (Err(why), _) => self.leave_out(address, why),
            (Ok(_), None) => self.leave_out(address, Why::Empty),
            // RMC has already given the epoch's velocity; a leading VTG belongs to the next epoch.
            (Ok(_), Some(_))
                if !self.attribution.leads(0)
                    && self.epoch.as_ref().is_some_and(|e| e.velocity.is_some()) =>
            {
                self.decoded.good += 1;
            }
            (Ok(_), Some(v)) => self.untimed(Untimed::Velocity(v), out),
        }
    }
    pub(super) fn heading(
        &mut self,
        address: &str,
        degrees: Option<f32>,
        verdict: Result<(), Why>,
        out: &mut Vec<SourceMeasurement>,
    ) {
        match (in_turn(degrees), verdict) {
            (Ok(heading), Ok(())) => match self.is_true_used(address, heading) {
                true => {
                    let sd = self.mounting.heading_sd();
                    self.untimed(Untimed::Heading(heading, sd), out);
                }
                false => self.leave_out(address, Why::Spare),
            },
            (Ok(_), Err(why)) | (Err(why), _) => self.leave_out(address, why),
        }
    }
    pub(super) fn hdg(&mut self, address: &str, s: &Hdg, out: &mut Vec<SourceMeasurement>) {
        self.state_variation(address, variation(s.variation, s.variation_ew));
        let deviation = variation(s.deviation, s.deviation_ew);
        self.magnetic(address, s.heading_mag, deviation, out);
    }
    /// `true = magnetic + deviation + variation`, east positive; used without a true heading.
    pub(super) fn magnetic(
        &mut self,
        address: &str,
        degrees: Option<f32>,
        deviation: Option<f64>,
        out: &mut Vec<SourceMeasurement>,
    ) {
        let shown = match in_turn(degrees) {
            Ok(shown) => shown,
            Err(why) => return self.leave_out(address, why),
        };
        let device = self.device(address);
        let variation = self.variation.of(Some(device), &self.devices);
        let sd = self.mounting.heading_sd().max(MAGNETIC_SD);
        let heading = variation.map(|v| shown + deviation.unwrap_or_default() + v);
        let is_spare = heading.is_some_and(|h| !self.is_used(HEADINGS, address, ([h, 0.0], sd), false));
        if self.without_true < MAX_SPARE && !self.devices.is_chosen(HEADINGS, device) {
            self.without_true += 1;
            return self.leave_out(address, Why::Spare);
        }
        let Some(heading) = heading else {
            return self.leave_out(address, Why::Magnetic);
        };
        if is_spare {
            return self.leave_out(address, Why::Spare);
        }
        variation.into_iter().for_each(|v| self.variation.used(v));
        self.untimed(Untimed::Heading(heading, sd), out);
    }
    pub(super) fn rot(&mut self, address: &str, s: &Rot, out: &mut Vec<SourceMeasurement>) {
        // Degrees per minute to starboard.
        match (rad(s.rate_of_turn), s.valid) {
            (Some(r), Some('A')) => match self.is_used(TURNS, address, ([r / 60.0, 0.0], 1.0), false) {
                true => self.untimed(Untimed::Rate(r / 60.0), out),
                false => self.leave_out(address, Why::Spare),
            },
            (Some(_), _) => self.leave_out(address, Why::Invalid),
            (None, _) => self.leave_out(address, Why::Empty),
        }
    }

    pub(super) fn pashr(&mut self, address: &str, s: &Pashr, out: &mut Vec<SourceMeasurement>) {
        let heading = rad(s.heading);
        let angles = rad(s.roll).zip(rad(s.pitch));
        // Zero means unknown.
        let known = |a: Option<f32>| rad(a).filter(|a| *a > 0.0);
        let sd = known(s.roll_accuracy)
            .into_iter()
            .chain(known(s.pitch_accuracy))
            .reduce(f64::max)
            .unwrap_or(self.mounting.tilt_sd());
        let heading_sd = known(s.heading_accuracy).unwrap_or(self.mounting.heading_sd());
        let Some(e) = self.open(address, s.time.as_deref(), out) else {
            return;
        };
        let at_ns = e.at_ns;
        // A gyrocompass needs no fix, so its quality is ignored.
        if s.imu_alignment == Some(0) {
            return self.left_out(address, Why::Invalid);
        }
        self.true_heading(address, heading, heading_sd);
        match angles {
            Some((roll, pitch)) if !self.is_used(TILTS, address, ([roll, pitch], sd), false) => {
                self.left_out(address, Why::Spare);
            }
            // A second attitude with the same time is counted on admission.
            Some((roll, pitch)) => {
                let fix = self.tilt([roll, pitch], s.heave.map(f64::from), sd);
                out.push(SourceMeasurement::new(at_ns, fix));
            }
            None => self.left_out(address, Why::Empty),
        }
        self.emit(false, out);
    }
    pub(super) fn prdid(&mut self, address: &str, s: &Prdid, out: &mut Vec<SourceMeasurement>) {
        match (rad(s.roll), rad(s.pitch), rad(s.heading)) {
            (Some(roll), Some(pitch), heading) => self.own_tilt(address, [roll, pitch], heading, None, out),
            _ => self.leave_out(address, Why::Empty),
        }
    }
    /// Seatex: 20, quality of place, height, heading, roll and pitch: 0 normal, 1 reduced, 2 invalid.
    pub(super) fn psxn_quality(&mut self, fields: &[&str]) {
        self.decoded.good += 1;
        self.seatex_invalid = [3, 4].map(|k| fields.get(k) == Some(&"2"));
    }
    /// Seatex: 23, roll (port up), pitch (bow up), heading, deg; heave, m, down positive.
    pub(super) fn psxn(&mut self, address: &str, fields: &[&str], out: &mut Vec<SourceMeasurement>) {
        let [roll, pitch, heading, heave] = [1, 2, 3, 4].map(|k| number(fields, k));
        let [no_heading, no_tilt] = self.seatex_invalid;
        let heading = heading.filter(|_| !no_heading);
        match roll.zip(pitch) {
            Some(_) if no_tilt => self.leave_out(address, Why::Invalid),
            Some((roll, pitch)) => {
                if no_heading {
                    self.account
                        .leave_out(&format!("{address}-heading"), Why::Invalid);
                }
                let tilt = [roll, pitch].map(f64::to_radians);
                self.own_tilt(
                    address,
                    tilt,
                    heading.map(f64::to_radians),
                    heave.map(|h| -h),
                    out,
                );
            }
            None => self.leave_out(address, Why::Empty),
        }
    }
    /// True North Technologies: magnetic heading, pitch, roll, deg, each followed by its state (N: normal).
    pub(super) fn ptnthpr(&mut self, address: &str, fields: &[&str], out: &mut Vec<SourceMeasurement>) {
        let normal = |k: usize| fields.get(k) == Some(&"N");
        match number(fields, 4).zip(number(fields, 2)) {
            Some((roll, pitch)) if normal(3) && normal(5) => {
                self.own_tilt(address, [roll, pitch].map(f64::to_radians), None, None, out);
            }
            Some(_) => self.leave_out(address, Why::Invalid),
            None => self.leave_out(address, Why::Empty),
        }
    }
    /// Receiver with two antennas: time, heading, pitch, roll, deg, quality as in GGA. It measures pitch or
    /// roll and sends zero for the other.
    pub(super) fn hpr(&mut self, address: &str, fields: &[&str], out: &mut Vec<SourceMeasurement>) {
        let [heading, pitch, roll] = [1, 2, 3].map(|k| number(fields, k));
        let quality = number(fields, 4);
        let Some(at_ns) = self.open(address, fields.first().copied(), out).map(|e| e.at_ns) else {
            return;
        };
        let state = [quality.is_none_or(|q| q == 4.0), quality == Some(5.0)];
        let is_used = self.two_antennas(address, heading, state);
        if let Some((roll, pitch)) = roll.zip(pitch).filter(|(r, p)| is_used && *r != 0.0 && *p != 0.0) {
            let (tilt, sd) = ([roll, pitch].map(f64::to_radians), self.mounting.tilt_sd());
            if !self.is_used(TILTS, address, (tilt, sd), false) {
                return self.left_out(address, Why::Spare);
            }
            let fix = self.tilt(tilt, None, sd);
            out.push(SourceMeasurement::new(at_ns, fix));
        }
        self.emit(false, out);
    }
    /// Trimble: AVR, time, yaw, its name, tilt, its name, roll, its name, range, quality: 2 float, 3 fixed.
    /// The tilt is not used: the mounting decides whether it is pitch or roll.
    pub(super) fn avr(&mut self, address: &str, fields: &[&str], out: &mut Vec<SourceMeasurement>) {
        let (yaw, quality) = (number(fields, 2), number(fields, 9));
        if self.open(address, fields.get(1).copied(), out).is_none() {
            return;
        }
        self.two_antennas(address, yaw, [quality == Some(3.0), quality == Some(2.0)]);
        self.emit(false, out);
    }
    /// Adds a two-antenna heading, deg, of this solution. Returns whether it is used.
    fn two_antennas(&mut self, address: &str, degrees: Option<f64>, [is_fixed, is_float]: [bool; 2]) -> bool {
        match degrees.filter(|d| (0.0..=360.0).contains(d)) {
            Some(_) if is_float => {
                self.decoded.left_out += 1;
                self.account.antennas(true);
            }
            Some(d) if is_fixed => {
                self.account.antennas(false);
                let sd = self.mounting.heading_sd();
                self.true_heading(address, Some(d.to_radians()), sd);
                return true;
            }
            Some(_) => self.left_out(address, Why::Invalid),
            None => self.left_out(address, Why::Empty),
        }
        false
    }
    /// Angles by name, deg: PTCH, PITCH, TRIM (bow up), ROLL, HEEL (starboard down); 1 or 2 sentences.
    pub(super) fn xdr(&mut self, address: &str, s: &Xdr, out: &mut Vec<SourceMeasurement>) {
        let (mut any, mut other_unit) = (false, false);
        let device = Some(self.device(address));
        if core::mem::replace(&mut self.half_of, device) != device {
            self.half_tilt = [None; 2];
        }
        for group in s.groups.iter().filter(|g| g.sensor_type == Some('A')) {
            let name = group.name.as_deref().unwrap_or_default().to_ascii_uppercase();
            let has = |part: &str| name.contains(part) && !name.contains("RATE");
            let which = match (
                has("ROLL") || has("HEEL"),
                has("PTCH") || has("PITCH") || has("TRIM"),
            ) {
                (true, false) => 0,
                (false, true) => 1,
                (true, true) | (false, false) => continue,
            };
            if group.unit.is_some_and(|unit| unit != 'D') {
                other_unit = true;
            } else if let (Some(angle), Some(half)) = (rad(group.value), self.half_tilt.get_mut(which)) {
                (any, *half) = (true, Some(angle));
            }
        }
        if other_unit {
            return self.leave_out(address, Why::Unit);
        }
        match self.half_tilt {
            [Some(roll), Some(pitch)] if any => {
                self.half_tilt = [None; 2];
                self.own_tilt(address, [roll, pitch], None, None, out);
            }
            _ if any => self.decoded.good += 1,
            _ => self.pass_over(address),
        }
    }
}

fn without_height(place: Datum, sd: f64) -> Position {
    Position {
        datum: place,
        sd: [sd, sd, NOT_MEASURED_SD],
        height_spread: 0.0,
    }
}

/// Standard deviation of a position, m, from quality, dilution and number of decimals.
fn sd_at(quality: u8, sd: f64, hdop: Option<f32>, latitude: Option<&&str>) -> f64 {
    let dilution = match quality {
        DEAD_RECKONING => 1.0,
        _ => hdop.map_or(1.0, f64::from).clamp(0.5, 50.0),
    };
    (sd * dilution).hypot(resolution(latitude))
}

/// Degrees from `ddmm.mmmm` and the letter of the hemisphere.
fn position(lat: Option<f64>, ns: Option<char>, lon: Option<f64>, ew: Option<char>) -> Option<Datum> {
    let degrees = |v: f64, limit: f64| {
        let whole = (v / 100.0).trunc();
        let minutes = v - 100.0 * whole;
        (v >= 0.0 && minutes < 60.0)
            .then_some(whole + minutes / 60.0)
            .filter(|d| *d <= limit)
    };
    let sign = |letter: char, plus: char, minus: char| match letter {
        l if l == plus => Some(1.0),
        l if l == minus => Some(-1.0),
        _ => None,
    };
    Some(Datum::new(
        degrees(lat?, 90.0)? * sign(ns?, 'N', 'S')?,
        degrees(lon?, 180.0)? * sign(ew?, 'E', 'W')?,
        0.0,
    ))
}

/// Velocity north and east, m/s.
fn velocity(knots: Option<f32>, course: Option<f32>) -> Option<[f64; 2]> {
    let speed = f64::from(knots?) * KNOT_MPS;
    let course = match course {
        Some(c) => f64::from(c).to_radians(),
        None if speed < STILL_MPS => 0.0,
        None => return None,
    };
    Some([speed * course.cos(), speed * course.sin()])
}

/// A magnetic variation or a compass's deviation, rad, east positive.
fn variation(degrees: Option<f32>, letter: Option<char>) -> Option<f64> {
    match letter {
        Some('E') => rad(degrees),
        Some('W') => rad(degrees).map(|v| -v),
        Some(_) | None => None,
    }
}
