//! NMEA 2000 as text of a gateway or a logger ([`line`]): heading, rate of turn, attitude, heave, position and velocity.
//!
//! The bus has no clock that all share: a message's time is that of its line, else of its arrival. Where several devices send
//! one group, the first that gives something is kept to until it is silent, and what belongs together is of one device. Positions come ten times a second without a height, and once a second
//! with one: the height goes with the next quick position, which is the newer one.

mod line;
mod pgn;

use alight_shared::geodesy::Datum;
use alight_shared::geoid::LocalGeoid;
use alight_shared::msg::{AttitudeFix, GnssFix, HeadingFix, NOT_MEASURED_SD};
use alight_shared::time::{Time, VesselClock};

use super::clock::Rollover;
use super::nmea::account::{Account, Why};
use super::nmea::sentences::{MAGNETIC_SD, VELOCITY_SD, accuracy};
use super::{Decoded, Decoder, Measurement, Mounting, Remark, SourceMeasurement};
use line::{Line, MAX_MESSAGE, Stamp};
use pgn::{COUNT, Content, Gnss};

const DAY_NS: i64 = 86_400_000_000_000;
/// Longest line, bytes: a message in canboat's plain format.
const MAX_LINE: usize = 800;
/// A device that is silent for so long gives its group to another, ns.
const SILENT_NS: i64 = 2_000_000_000;
/// What belongs to a measurement is at most so old, ns: three periods at 10 Hz.
const BESIDE_NS: i64 = 300_000_000;
/// A fix's quality and height are used so long, ns: its period is a second.
const FIX_NS: i64 = 2_500_000_000;
/// Messages of several frames that are open at a time.
const OPEN: usize = 8;
/// Heights of an antenna above the mean sea, m: between a low water (and a geoid that is off by some metres) and a mast at
/// high water.
const ANTENNA_M: core::ops::Range<f64> = -10.0..45.0;

/// Something of the newest message of a group, and when it was sent, ns.
type Newest<T> = Option<(T, i64)>;

/// A message of several frames that is not whole yet.
#[derive(Clone, Debug)]
struct Open {
    source: u8,
    pgn: u32,
    sequence: u8,
    next: u8,
    length: usize,
    data: Vec<u8>,
}

/// Decodes NMEA 2000.
#[derive(Clone, Debug)]
pub struct N2kDecoder {
    mounting: Mounting,
    line: Vec<u8>,
    overlong: bool,
    decoded: Decoded,
    account: Account,
    day: Rollover<DAY_NS>,
    /// When the bytes that are pushed arrive, ns; None in a recording.
    now_ns: Option<i64>,
    open: Vec<Open>,
    /// Which device each group is taken of.
    devices: [Newest<u8>; COUNT],
    variation: Option<f64>,
    rate: Newest<f64>,
    heave: Newest<f64>,
    /// With their device.
    velocity: Newest<([f64; 2], u8)>,
    fix: Newest<(Gnss, u8)>,
    /// That fix's height has not gone with a position yet.
    height_due: bool,
    /// When the last position without a height came, ns, and from which device.
    quick_ns: Option<(i64, u8)>,
    geoid: LocalGeoid,
    /// Heights that can only be above the sea, and all.
    above_sea: u64,
    heights: u64,
    timeless: Vec<Measurement>,
}

impl N2kDecoder {
    /// For a source with this mounting.
    pub fn new(mounting: &Mounting) -> Self {
        N2kDecoder {
            mounting: mounting.clone(),
            line: Vec::with_capacity(MAX_LINE),
            overlong: false,
            decoded: Decoded::default(),
            account: Account::default(),
            day: Rollover::default(),
            now_ns: None,
            open: Vec::with_capacity(OPEN),
            devices: [None; COUNT],
            variation: None,
            rate: None,
            heave: None,
            velocity: None,
            fix: None,
            height_due: false,
            quick_ns: None,
            geoid: LocalGeoid::default(),
            above_sea: 0,
            heights: 0,
            timeless: Vec::new(),
        }
    }

    fn take(&mut self, text: &[u8], out: &mut Vec<SourceMeasurement>) {
        let parsed = core::str::from_utf8(text).ok().and_then(Line::parse);
        let Some(line) = parsed else {
            self.decoded.corrupted += 1;
            return;
        };
        let Some((k, name, is_long)) = pgn::used(line.pgn) else {
            self.decoded.ignored += 1;
            self.account.leave_out(&line.pgn.to_string(), Why::NotRead);
            return;
        };
        let (at_ns, is_stamped) = match line.at {
            Stamp::OfDay(of_day) => (self.day.unwrap(of_day), true),
            Stamp::Unix(at) => (at, true),
            Stamp::None => (self.now_ns.unwrap_or_default(), false),
        };
        let (pgn, source) = (line.pgn, line.source);
        let data = if is_long && !line.whole {
            match self.assemble(line) {
                Some(whole) => whole,
                None => return,
            }
        } else {
            line.data
        };
        self.decoded.good += 1;
        if self.is_of_another(k, source, at_ns) {
            self.left_out(name, Why::Spare);
            return;
        }
        let Some(content) = pgn::read(pgn, &data) else {
            self.left_out(name, Why::Empty);
            return;
        };
        let given = self.measurement((name, source), at_ns, content);
        if given.is_ok()
            && let Some(device) = self.devices.get_mut(k)
        {
            *device = Some((source, at_ns));
        }
        match given {
            Ok(Some(m)) if is_stamped => out.push(SourceMeasurement::new(at_ns, m)),
            Ok(Some(m)) if self.now_ns.is_some() => {
                self.decoded.by_arrival += 1;
                self.timeless.push(m);
            }
            Ok(Some(_)) => self.decoded.undated += 1,
            Ok(None) => {}
            Err(why) => self.left_out(name, why),
        }
    }
    fn left_out(&mut self, name: &str, why: Why) {
        self.decoded.left_out += 1;
        self.account.leave_out(name, why);
    }
    /// Whether group `k` is another device's, which has given something of late.
    fn is_of_another(&self, k: usize, source: u8, at_ns: i64) -> bool {
        let device = self.devices.get(k).copied().flatten();
        device.is_some_and(|(known, newest)| known != source && is_beside(at_ns, newest, SILENT_NS))
    }

    /// The whole message that this frame completes. Frames of one message have one sequence and count from 0; the first has
    /// its length.
    fn assemble(&mut self, line: Line) -> Option<Vec<u8>> {
        let (head, data) = line.data.split_first()?;
        let (sequence, index) = (head >> 5, head & 0x1f);
        let is_it = |o: &Open| (o.source, o.pgn) == (line.source, line.pgn);
        if index == 0 {
            let (length, first) = data.split_first()?;
            self.open.retain(|o| !is_it(o));
            if self.open.len() >= OPEN {
                self.open.remove(0);
            }
            self.open.push(Open {
                source: line.source,
                pgn: line.pgn,
                sequence,
                next: 1,
                length: usize::from(*length).min(MAX_MESSAGE),
                data: first.to_vec(),
            });
        } else {
            let open = self.open.iter_mut().find(|o| is_it(o))?;
            if (open.sequence, open.next) != (sequence, index) {
                // A frame is missing.
                self.decoded.corrupted += 1;
                self.open.retain(|o| !is_it(o));
                return None;
            }
            open.next += 1;
            open.data.extend_from_slice(data);
        }
        let k = self
            .open
            .iter()
            .position(|o| is_it(o) && o.data.len() >= o.length)?;
        let mut whole = self.open.remove(k);
        whole.data.truncate(whole.length);
        Some(whole.data)
    }

    /// What a message gives, alone or with those before it.
    fn measurement(
        &mut self,
        (name, source): (&str, u8),
        at_ns: i64,
        content: Content,
    ) -> Result<Option<Measurement>, Why> {
        let beside = |newest: Newest<f64>| {
            newest
                .filter(|(_, at)| is_beside(at_ns, *at, BESIDE_NS))
                .map(|(x, _)| x)
        };
        match content {
            Content::Rate(rate) => self.rate = Some((rate, at_ns)),
            Content::Heave(heave) => self.heave = Some((heave, at_ns)),
            Content::Variation(variation) => self.variation = Some(variation),
            Content::Heading {
                heading,
                variation,
                deviation,
                magnetic,
            } => {
                let north = match magnetic {
                    true => {
                        variation.or(self.variation).ok_or(Why::Magnetic)? + deviation.unwrap_or_default()
                    }
                    false => 0.0,
                };
                let fix = self.mounting.heading_fix(self.mounting.heading(heading + north));
                let sd = if magnetic { MAGNETIC_SD } else { 0.0 };
                return Ok(Some(Measurement::Heading(HeadingFix {
                    heading_sd: fix.heading_sd.hypot(sd),
                    rate: beside(self.rate),
                    ..fix
                })));
            }
            Content::Attitude([roll, pitch]) => {
                let [roll, pitch, _] = self.mounting.attitude([roll, pitch, 0.0]);
                let heave = beside(self.heave).and_then(|h| self.mounting.heave(h));
                return Ok(Some(Measurement::Attitude(AttitudeFix {
                    heave,
                    heave_sd: self.mounting.mount.heave_sd_m,
                    ..self.mounting.tilt([roll, pitch])
                })));
            }
            Content::Velocity {
                course,
                speed,
                magnetic,
            } => {
                let north = match magnetic {
                    true => self.variation.ok_or(Why::Magnetic)?,
                    false => 0.0,
                };
                let (sin, cos) = (course + north).sin_cos();
                self.velocity = Some((([speed * cos, speed * sin], source), at_ns));
            }
            Content::Position(place) => {
                self.quick_ns = Some((at_ns, source));
                return self.position(at_ns, place, source).map(Some);
            }
            Content::Gnss(fix) => {
                (self.fix, self.height_due) = (Some(((fix, source), at_ns)), true);
                // Quick positions carry it on where there are any.
                if self
                    .quick_ns
                    .is_some_and(|(at, of)| of == source && is_beside(at_ns, at, BESIDE_NS))
                {
                    accuracy(fix.quality)?;
                    return Ok(None);
                }
                return self.position(at_ns, fix.place, source).map(Some);
            }
        }
        self.account.stamp(name, at_ns);
        Ok(None)
    }

    /// A fix with the velocity, the quality and, once, the height that belong to it.
    fn position(
        &mut self,
        at_ns: i64,
        [latitude, longitude]: [f64; 2],
        source: u8,
    ) -> Result<Measurement, Why> {
        let own = |((_, of), at): &((Gnss, u8), i64)| *of == source && is_beside(at_ns, *at, FIX_NS);
        let fix = self.fix.filter(own).map(|((fix, _), _)| fix);
        let quality = fix.map_or(1, |f| f.quality);
        let dilution = fix.and_then(|f| f.hdop).unwrap_or(1.0).clamp(0.5, 50.0);
        let sd = accuracy(quality)? * dilution;
        let place = Datum::new(latitude, longitude, 0.0);
        let altitude = fix
            .and_then(|f| f.altitude_m)
            .filter(|_| core::mem::take(&mut self.height_due));
        let (height_m, height_sd, height_spread) = match altitude {
            Some(altitude) => {
                let (height, spread) = self.height(&place, altitude);
                (height, 2.0 * sd, spread)
            }
            None => (0.0, NOT_MEASURED_SD, 0.0),
        };
        let own = |((_, of), at): &(([f64; 2], u8), i64)| *of == source && is_beside(at_ns, *at, BESIDE_NS);
        let velocity = self.velocity.filter(own).map(|((v, _), _)| v);
        let [north, east] = velocity.unwrap_or_default();
        let velocity_sd = velocity.map_or(NOT_MEASURED_SD, |_| VELOCITY_SD);
        let datum = Datum { height_m, ..place };
        if !datum.is_on_earth() {
            return Err(Why::Invalid);
        }
        let fix = self.mounting.fix(
            datum,
            [north, east, 0.0],
            [sd, sd, height_sd],
            [velocity_sd, velocity_sd, NOT_MEASURED_SD],
        );
        Ok(Measurement::Gnss(GnssFix { height_spread, ..fix }))
    }
    /// Height above the ellipsoid of what a receiver gives as its altitude, and its spread, m. It is to be above the
    /// ellipsoid, and some receivers send that above the sea: at sea an antenna is above the water and below the top of a
    /// mast by the one and not by the other. Where that decides nothing, the difference is the spread.
    fn height(&mut self, place: &Datum, altitude: f64) -> (f64, f64) {
        let geoid = self.geoid.at(place);
        let by = [altitude - geoid.height_m, altitude].map(|above| ANTENNA_M.contains(&above));
        self.heights += 1;
        match by {
            [false, true] => {
                self.above_sea += 1;
                (altitude + geoid.height_m, geoid.sigma_m)
            }
            [true, false] => (altitude, 0.0),
            // On a lake nothing decides it.
            [true, true] | [false, false] => (altitude, geoid.height_m.abs()),
        }
    }
}

/// Whether two times lie within `limit_ns`, ns.
fn is_beside(a_ns: i64, b_ns: i64, limit_ns: i64) -> bool {
    a_ns.abs_diff(b_ns) <= limit_ns.unsigned_abs()
}

impl Decoder for N2kDecoder {
    fn arrive(&mut self, now: Time<VesselClock>) {
        self.now_ns = Some(now.nanos());
    }
    fn push(&mut self, bytes: &[u8], out: &mut Vec<SourceMeasurement>) {
        for byte in bytes {
            match byte {
                b'\n' | b'\r' => {
                    if core::mem::take(&mut self.overlong) {
                        self.decoded.corrupted += 1;
                    } else if !self.line.is_empty() {
                        let line = core::mem::take(&mut self.line);
                        self.take(&line, out);
                        self.line = line;
                    }
                    self.line.clear();
                }
                _ if self.line.len() >= MAX_LINE => self.overlong = true,
                _ => self.line.push(*byte),
            }
        }
    }
    fn decoded(&self) -> Decoded {
        self.decoded
    }
    fn timeless(&mut self) -> Vec<Measurement> {
        core::mem::take(&mut self.timeless)
    }
    fn remarks(&self) -> Vec<Remark> {
        let sea = (self.above_sea > 0).then(|| {
            Remark::fine(format!(
                "height: {} of {} can only be above the sea; by EGM96 they are taken so",
                self.above_sea, self.heights
            ))
        });
        sea.into_iter().chain(self.account.remarks()).collect()
    }
}

#[cfg(test)]
mod tests;
