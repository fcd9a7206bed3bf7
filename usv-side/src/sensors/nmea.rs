//! NMEA 0183: GGA, RMC, VTG, HDT, THS, ROT, PASHR, PRDID and ZDA to measurements.
//!
//! A sentence with a time opens an epoch. Those without one (HDT, THS, ROT, VTG, PRDID) belong to the epoch in
//! which they arrive, each kind once: a second one in the same epoch has no time, and is counted and dropped.
//! Position and velocity of an epoch make one fix, heading and rate of turn one heading.

use alight_shared::geodesy::Datum;
use alight_shared::msg::{AttitudeFix, HeadingFix, NOT_MEASURED_SD};
use nmea_kit::nmea::NmeaSentence;
use nmea_kit::nmea::sentences::{Gga, Hdt, Pashr, Prdid, Rmc, Rot, Ths, Vtg, Zda};
use nmea_kit::parse_frame;

use super::clock::Rollover;
use super::{Decoded, Decoder, Mounting, SourceMeasurement};

/// Longest line, bytes: the standard allows 82, makers' own sentences are longer.
const MAX_LINE: usize = 512;
const DAY_NS: i64 = 86_400_000_000_000;
/// After this many epochs without the partner (velocity of a position, rate of a heading) it is not waited for.
const MAX_EPOCHS_WITHOUT: u8 = 3;
const KNOT_MPS: f64 = 1852.0 / 3600.0;
/// Below it a velocity needs no course, m/s.
const STILL_MPS: f64 = 0.3;
/// Standard deviation of a velocity in tenths of a knot, m/s (ours).
const VELOCITY_SD: f64 = 0.1;
/// Standard deviation of a position by the quality in GGA, m at a dilution of 1 (ours: the error that changes
/// within a minute; slow error is the filter's height bias).
const POSITION_SD: [(u8, f64); 5] = [(1, 0.5), (2, 0.3), (3, 0.5), (4, 0.01), (5, 0.1)];
/// The same for dead reckoning, manual input and simulation, m.
const POSITION_SD_OTHER: f64 = 5.0;

/// Decodes NMEA 0183.
#[derive(Clone, Debug)]
pub struct NmeaDecoder {
    mounting: Mounting,
    line: Vec<u8>,
    /// The line has grown too long: the rest of it is dropped.
    overlong: bool,
    decoded: Decoded,
    day: Rollover<DAY_NS>,
    epoch: Option<Epoch>,
    /// Sentences before their time, where those without one lead.
    waiting: Vec<Untimed>,
    /// Epochs since the last velocity with a position and the last rate with a heading.
    without_velocity: u8,
    without_rate: u8,
}

/// The content of one time.
#[derive(Clone, Debug, Default)]
struct Epoch {
    at_ns: i64,
    position: Option<(Datum, [f64; 3])>,
    velocity: Option<[f64; 2]>,
    heading: Option<(f64, f64)>,
    rate: Option<f64>,
    fixed: bool,
    headed: bool,
    tilted: bool,
}

/// The content of a sentence without a time.
#[derive(Clone, Copy, Debug)]
enum Untimed {
    Velocity([f64; 2]),
    /// And its standard deviation, rad.
    Heading(f64, f64),
    Rate(f64),
    /// Roll, pitch, heading, rad.
    Tilt([f64; 3]),
}

/// Most sentences that wait for a time.
const MAX_WAITING: usize = 8;

impl NmeaDecoder {
    /// For a source with this mounting.
    pub fn new(mounting: &Mounting) -> Self {
        NmeaDecoder {
            mounting: mounting.clone(),
            line: Vec::with_capacity(MAX_LINE),
            overlong: false,
            decoded: Decoded::default(),
            day: Rollover::default(),
            epoch: None,
            waiting: Vec::new(),
            without_velocity: MAX_EPOCHS_WITHOUT,
            without_rate: MAX_EPOCHS_WITHOUT,
        }
    }
    /// Ends the stream: the last epoch is complete.
    pub fn finish(&mut self, out: &mut Vec<SourceMeasurement>) {
        if !self.line.is_empty() {
            self.decoded.corrupted += 1;
            self.line.clear();
        }
        self.close(out);
    }

    fn take(&mut self, line: &[u8], out: &mut Vec<SourceMeasurement>) {
        let Some(text) = core::str::from_utf8(line).ok().filter(|t| t.is_ascii()) else {
            self.decoded.corrupted += 1;
            return;
        };
        if !text.contains('$') && !text.contains('*') {
            self.decoded.ignored += 1;
            return;
        }
        // A checksum is required: a sentence that is cut off before it would pass.
        let sound = text.starts_with('$') && text.contains('*');
        let Some(frame) = sound.then(|| parse_frame(text).ok()).flatten() else {
            self.decoded.corrupted += 1;
            return;
        };
        match NmeaSentence::parse(&frame) {
            NmeaSentence::Gga(s) => self.gga(&s, out),
            NmeaSentence::Rmc(s) => self.rmc(&s, out),
            NmeaSentence::Vtg(s) => self.vtg(&s, out),
            NmeaSentence::Hdt(s) => self.hdt(&s, out),
            NmeaSentence::Ths(s) => self.ths(&s, out),
            NmeaSentence::Rot(s) => self.rot(&s, out),
            NmeaSentence::Pashr(s) => self.pashr(&s, out),
            NmeaSentence::Prdid(s) => self.prdid(&s, out),
            NmeaSentence::Zda(s) => self.zda(&s, out),
            _ => self.decoded.ignored += 1,
        }
    }
    /// The epoch of a sentence's time; None, and counted, where that is no time.
    fn open(&mut self, time: Option<&str>, out: &mut Vec<SourceMeasurement>) -> Option<&mut Epoch> {
        let Some(of_day) = time.and_then(time_of_day_ns) else {
            self.decoded.corrupted += 1;
            return None;
        };
        self.decoded.good += 1;
        let at_ns = self.day.unwrap(of_day);
        if self.epoch.as_ref().is_none_or(|e| e.at_ns != at_ns) {
            self.close(out);
            self.epoch = Some(Epoch {
                at_ns,
                ..Epoch::default()
            });
            for untimed in core::mem::take(&mut self.waiting) {
                self.add(untimed, out);
            }
        }
        self.epoch.as_mut()
    }

    /// A sentence without a time goes to its epoch, or waits for it.
    fn untimed(&mut self, untimed: Untimed, out: &mut Vec<SourceMeasurement>) {
        self.decoded.good += 1;
        if self.mounting.mount.untimed_lead {
            if self.waiting.len() < MAX_WAITING {
                self.waiting.push(untimed);
            } else {
                self.decoded.undated += 1;
            }
        } else {
            self.add(untimed, out);
        }
    }
    fn add(&mut self, untimed: Untimed, out: &mut Vec<SourceMeasurement>) {
        let Some(e) = self.epoch.as_mut() else {
            self.decoded.undated += 1;
            return;
        };
        let taken = match untimed {
            Untimed::Velocity(v) => e.velocity.replace(v).is_none(),
            Untimed::Heading(h, sd) => e.heading.replace((h, sd)).is_none(),
            Untimed::Rate(r) => e.rate.replace(r).is_none(),
            Untimed::Tilt(angles) => {
                if core::mem::replace(&mut e.tilted, true) {
                    false
                } else {
                    let at_ns = e.at_ns;
                    let sd = self.mounting.tilt_sd();
                    self.tilt(at_ns, angles, None, sd, out);
                    if let Some(e) = self.epoch.as_mut() {
                        e.heading.get_or_insert((angles[2], self.mounting.heading_sd()));
                    }
                    true
                }
            }
        };
        self.decoded.undated += u64::from(!taken);
        self.emit(false, out);
    }

    /// Emits complete measurements, and at the epoch's end incomplete ones too.
    fn emit(&mut self, last: bool, out: &mut Vec<SourceMeasurement>) {
        let Some(e) = self.epoch.as_mut() else { return };
        let at_ns = e.at_ns;
        if let Some((datum, sd)) = e.position.filter(|_| !e.fixed)
            && (e.velocity.is_some() || last || self.without_velocity >= MAX_EPOCHS_WITHOUT)
        {
            e.fixed = true;
            let [north, east] = e.velocity.unwrap_or_default();
            let velocity_sd = e.velocity.map_or(NOT_MEASURED_SD, |_| VELOCITY_SD);
            let velocity_sd = [velocity_sd, velocity_sd, NOT_MEASURED_SD];
            let fix = self.mounting.fix(datum, [north, east, 0.0], sd, velocity_sd);
            out.push(SourceMeasurement::new(at_ns, fix));
        }
        if let Some((heading, heading_sd)) = e.heading.filter(|_| !e.headed)
            && (e.rate.is_some() || last || self.without_rate >= MAX_EPOCHS_WITHOUT)
        {
            e.headed = true;
            let fix = HeadingFix {
                heading_sd,
                rate: e.rate,
                ..self.mounting.heading_fix(self.mounting.heading(heading))
            };
            out.push(SourceMeasurement::new(at_ns, fix));
        }
    }
    fn close(&mut self, out: &mut Vec<SourceMeasurement>) {
        self.emit(true, out);
        if let Some(e) = &self.epoch {
            let later = |seen: bool, since: u8| {
                if seen {
                    0
                } else {
                    (since + 1).min(MAX_EPOCHS_WITHOUT)
                }
            };
            if e.position.is_some() {
                self.without_velocity = later(e.velocity.is_some(), self.without_velocity);
            }
            if e.heading.is_some() {
                self.without_rate = later(e.rate.is_some(), self.without_rate);
            }
        }
    }

    fn tilt(
        &self,
        at_ns: i64,
        angles: [f64; 3],
        heave: Option<f64>,
        sd: f64,
        out: &mut Vec<SourceMeasurement>,
    ) {
        let [roll, pitch, _] = self.mounting.attitude(angles);
        let fix = AttitudeFix {
            tilt_sd: sd,
            heave,
            heave_sd: self.mounting.mount.heave_sd_m,
            ..self.mounting.tilt([roll, pitch])
        };
        out.push(SourceMeasurement::new(at_ns, fix));
    }

    fn gga(&mut self, s: &Gga, out: &mut Vec<SourceMeasurement>) {
        let height = s
            .altitude
            .map(|a| f64::from(a) + s.geoid_sep.map_or(0.0, f64::from));
        let datum = position(s.lat, s.ns, s.lon, s.ew);
        let quality = s.quality.unwrap_or_default();
        let Some(e) = self.open(s.time.as_deref(), out) else {
            return;
        };
        // Quality 0: no fix; 6 to 8: dead reckoning, manual, simulated.
        if let (Some(datum), 1..=8) = (datum, quality) {
            let sd = POSITION_SD
                .iter()
                .find(|q| q.0 == quality)
                .map_or(POSITION_SD_OTHER, |q| {
                    q.1 * s.hdop.map_or(1.0, f64::from).clamp(0.5, 50.0)
                });
            let down = height.map_or(NOT_MEASURED_SD, |_| 2.0 * sd);
            let datum = Datum {
                height_m: height.unwrap_or_default(),
                ..datum
            };
            // A position of RMC in the same epoch has no height.
            e.position = Some((datum, [sd, sd, down]));
        }
        self.emit(false, out);
    }
    fn rmc(&mut self, s: &Rmc, out: &mut Vec<SourceMeasurement>) {
        let velocity = velocity(s.sog, s.cog);
        let valid = s.status == Some('A');
        let Some(e) = self.open(s.time.as_deref(), out) else {
            return;
        };
        if valid && let Some(v) = velocity {
            e.velocity.get_or_insert(v);
        }
        self.emit(false, out);
    }
    fn vtg(&mut self, s: &Vtg, out: &mut Vec<SourceMeasurement>) {
        match velocity(s.speed_kts, s.course_true) {
            // RMC of this epoch has it as well.
            Some(_) if self.epoch.as_ref().is_some_and(|e| e.velocity.is_some()) => self.decoded.good += 1,
            Some(v) if s.mode != Some('N') => self.untimed(Untimed::Velocity(v), out),
            Some(_) | None => self.decoded.ignored += 1,
        }
    }
    fn hdt(&mut self, s: &Hdt, out: &mut Vec<SourceMeasurement>) {
        self.heading(s.heading_true, true, out);
    }
    fn ths(&mut self, s: &Ths, out: &mut Vec<SourceMeasurement>) {
        // Autonomous or estimated; manual, simulated and invalid headings are dropped.
        self.heading(s.heading_true, matches!(s.mode, Some('A' | 'E')), out);
    }
    fn heading(&mut self, degrees: Option<f32>, valid: bool, out: &mut Vec<SourceMeasurement>) {
        match degrees.filter(|d| valid && (0.0..=360.0).contains(d)) {
            Some(d) => {
                let sd = self.mounting.heading_sd();
                self.untimed(Untimed::Heading(f64::from(d).to_radians(), sd), out);
            }
            None => self.decoded.ignored += 1,
        }
    }
    fn rot(&mut self, s: &Rot, out: &mut Vec<SourceMeasurement>) {
        // Degrees a minute, to starboard positive.
        match s.rate_of_turn.filter(|_| s.valid == Some('A')) {
            Some(r) => self.untimed(Untimed::Rate(f64::from(r).to_radians() / 60.0), out),
            None => self.decoded.ignored += 1,
        }
    }
    fn pashr(&mut self, s: &Pashr, out: &mut Vec<SourceMeasurement>) {
        let rad = |d: Option<f32>| d.map(|d| f64::from(d).to_radians());
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
        let heave = s.heave.and_then(|h| self.mounting.heave(h.into()));
        let Some(e) = self.open(s.time.as_deref(), out) else {
            return;
        };
        let at_ns = e.at_ns;
        if let Some(h) = heading {
            e.heading.get_or_insert((h, heading_sd));
        }
        // A second attitude of the same time is counted where measurements are admitted.
        if let Some((roll, pitch)) = angles {
            self.tilt(at_ns, [roll, pitch, heading.unwrap_or_default()], heave, sd, out);
        }
        self.emit(false, out);
    }
    fn prdid(&mut self, s: &Prdid, out: &mut Vec<SourceMeasurement>) {
        let rad = |d: Option<f32>| d.map(|d| f64::from(d).to_radians());
        match (rad(s.roll), rad(s.pitch), rad(s.heading)) {
            (Some(roll), Some(pitch), Some(heading)) => {
                self.untimed(Untimed::Tilt([roll, pitch, heading]), out)
            }
            _ => self.decoded.ignored += 1,
        }
    }
    fn zda(&mut self, s: &Zda, out: &mut Vec<SourceMeasurement>) {
        // Its time opens an epoch; its date is not needed.
        let _epoch = self.open(s.time.as_deref(), out);
    }
}

impl Decoder for NmeaDecoder {
    fn push(&mut self, bytes: &[u8], out: &mut Vec<SourceMeasurement>) {
        for byte in bytes {
            match byte {
                b'\n' | b'\r' => {
                    if self.overlong {
                        self.decoded.corrupted += 1;
                    } else if !self.line.is_empty() {
                        let line = core::mem::take(&mut self.line);
                        self.take(&line, out);
                        self.line = line;
                    }
                    self.overlong = false;
                    self.line.clear();
                }
                // A sentence begins in the middle of a line where bytes were lost.
                b'$' if !self.line.is_empty() => {
                    // The prefix that a logger writes before a sentence is no damage.
                    self.decoded.corrupted += u64::from(self.line.starts_with(b"$"));
                    self.overlong = false;
                    self.line.clear();
                    self.line.push(*byte);
                }
                _ if self.line.len() >= MAX_LINE => self.overlong = true,
                _ => self.line.push(*byte),
            }
        }
    }
    fn decoded(&self) -> Decoded {
        self.decoded
    }
}

/// `hhmmss` with a fraction, to nanoseconds of the day.
fn time_of_day_ns(text: &str) -> Option<i64> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let digits = |t: &str| t.bytes().all(|b| b.is_ascii_digit());
    if whole.len() != 6 || !digits(whole) || !digits(fraction) || fraction.len() > 9 {
        return None;
    }
    let two = |k: usize| whole.get(k..k + 2).and_then(|t| t.parse::<i64>().ok());
    let (h, m, s) = (two(0)?, two(2)?, two(4)?);
    // 60 is a leap second.
    if h > 23 || m > 59 || s > 60 {
        return None;
    }
    let fraction: i64 = format!("{fraction:0<9}").parse().ok()?;
    Some(((h * 60 + m) * 60 + s) * 1_000_000_000 + fraction)
}

/// Degrees from `ddmm.mmmm` and a letter.
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

/// North and east, m/s.
fn velocity(knots: Option<f32>, course: Option<f32>) -> Option<[f64; 2]> {
    let speed = f64::from(knots?) * KNOT_MPS;
    let course = match course {
        Some(c) => f64::from(c).to_radians(),
        None if speed < STILL_MPS => 0.0,
        None => return None,
    };
    Some([speed * course.cos(), speed * course.sin()])
}

#[cfg(test)]
mod tests;
