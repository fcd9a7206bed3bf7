//! Measurements of what the devices of a boat's network send: heading, rate of turn, attitude, heave, position, velocity.
//!
//! Several devices may send a group: the first that gives something is kept to; another stands in while it is silent. What
//! belongs together is of one device: positions and whole fixes are one group, and a velocity is of the receiver that gives
//! them. Positions come ten times a second without a height, and once a second with one: the
//! height goes with the next quick position, which is the newer one.

use alight_shared::geodesy::Datum;
use alight_shared::geoid::LocalGeoid;
use alight_shared::msg::{AttitudeFix, GnssFix, HeadingFix, NOT_MEASURED_SD};

use super::heights::DOUBTFUL_M;
use super::nmea::account::{Account, Why};
use super::nmea::sentences::{MAGNETIC_SD, STILL_MPS, VELOCITY_SD, accuracy};
use super::{Measurement, Mounting, Remark};

/// A device that is silent for so long gives its group to another, ns.
const SILENT_NS: i64 = 2_000_000_000;
/// What belongs to a measurement is at most so old, ns: three periods at 10 Hz.
pub(super) const PAIR_NS: i64 = 300_000_000;
/// A fix's quality and height are used so long, ns: its period is a second.
const FIX_NS: i64 = 2_500_000_000;
/// Heights of an antenna above the mean sea, m: between a low water (and a geoid that is off by some metres) and a mast at
/// high water.
const ANTENNA_M: core::ops::Range<f64> = -10.0..45.0;

/// Something that a device sent, and when, ns.
pub(super) type Newest<T> = Option<(T, i64)>;

/// Content of a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Content {
    /// From the north or magnetic (rad), and the compass's own variation and deviation.
    Heading {
        heading: f64,
        variation: Option<f64>,
        deviation: Option<f64>,
        magnetic: bool,
    },
    /// Rate of turn, rad/s, to starboard positive.
    Rate(f64),
    /// Angular rates of the sensor's axes: roll, pitch, yaw, rad/s.
    Rates([f64; 3]),
    /// Roll, starboard down, and pitch, bow up, rad.
    Attitude([f64; 2]),
    /// Heave, m.
    Heave(f64),
    /// Magnetic variation, east positive, rad.
    Variation(f64),
    /// Latitude and longitude, deg.
    Position([f64; 2]),
    /// Course over ground (rad) and speed (m/s).
    Velocity { course: f64, speed: f64, magnetic: bool },
    /// The whole fix.
    Gnss(Gnss),
}

/// The whole fix of a receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gnss {
    /// Latitude and longitude, deg.
    pub(super) place: [f64; 2],
    /// As the receiver counts it, m.
    pub(super) altitude_m: Option<f64>,
    /// Height of the sea above the ellipsoid, by the receiver, m.
    pub(super) separation_m: Option<f64>,
    /// As in NMEA 0183's GGA: 0 none, 1 GNSS, 2 differential, 4 and 5 RTK, 6 dead reckoning, 7 by hand, 8 simulated.
    pub(super) quality: u8,
    pub(super) hdop: Option<f64>,
}

/// How many groups there are.
const GROUPS: usize = 8;
/// The group of positions.
const PLACES: usize = 6;

impl Content {
    /// Number of its group.
    pub(super) const fn group(&self) -> usize {
        match self {
            Content::Heading { .. } => 0,
            Content::Rate(_) => 1,
            Content::Rates(_) => 2,
            Content::Attitude(_) => 3,
            Content::Heave(_) => 4,
            Content::Variation(_) => 5,
            Content::Position(_) | Content::Gnss(_) => PLACES,
            Content::Velocity { .. } => 7,
        }
    }
    /// A velocity of a speed (m/s) with or without a course (rad, and whether it is magnetic): at rest there is none.
    pub(super) fn velocity(speed: f64, course: Option<(f64, bool)>) -> Option<Content> {
        match course {
            Some((course, magnetic)) => Some(Content::Velocity {
                course,
                speed,
                magnetic,
            }),
            None => (speed < STILL_MPS).then_some(Content::Velocity {
                course: 0.0,
                speed: 0.0,
                magnetic: false,
            }),
        }
    }
}

/// Devices of a group.
#[derive(Clone, Copy, Debug)]
struct Devices {
    /// The device that is kept to, and when it gave something last, ns.
    kept: (u32, i64),
    /// The same of the one that stands in.
    stand_in: Newest<u32>,
}

impl Devices {
    /// Whether another device gives this group.
    fn spare(&self, device: u32, at_ns: i64) -> bool {
        let gives = |(of, newest): (u32, i64)| of != device && is_near(at_ns, newest, SILENT_NS);
        self.kept.0 != device && (gives(self.kept) || self.stand_in.is_some_and(gives))
    }
    /// The device that gives it at that time.
    fn giving(&self, at_ns: i64) -> Option<u32> {
        let (device, newest) = self.stand_in.unwrap_or(self.kept);
        is_near(at_ns, newest, SILENT_NS).then_some(device)
    }
    fn gave(&mut self, device: u32, at_ns: i64) {
        if self.kept.0 == device {
            (self.kept, self.stand_in) = ((device, at_ns), None);
        } else {
            self.stand_in = Some((device, at_ns));
        }
    }
}

/// What was received by now.
#[derive(Clone, Debug, Default)]
pub(super) struct Bus {
    mounting: Mounting,
    devices: [Option<Devices>; GROUPS],
    variation: Option<f64>,
    rate: Newest<f64>,
    rates: Newest<[f64; 3]>,
    heave: Newest<f64>,
    /// With their device.
    velocity: Newest<([f64; 2], u32)>,
    fix: Newest<(Gnss, u32)>,
    /// That fix's height has not gone with a position yet.
    height_due: bool,
    /// The device and time of the last position without a height.
    quick: Newest<u32>,
    geoid: LocalGeoid,
    /// Heights that can only be above the sea, and all.
    above_sea: u64,
    heights: u64,
}

impl Bus {
    /// Of devices with this mounting.
    pub(super) fn new(mounting: &Mounting) -> Self {
        Bus {
            mounting: mounting.clone(),
            ..Bus::default()
        }
    }
    /// What a message of `device` gives, alone or with those before it.
    pub(super) fn take(
        &mut self,
        device: u32,
        at_ns: i64,
        content: Content,
    ) -> Result<Option<Measurement>, Why> {
        let k = content.group();
        if matches!(content, Content::Velocity { .. }) {
            let receiver = self.devices.get(PLACES).copied().flatten();
            let giving = receiver.and_then(|d| d.giving(at_ns));
            if giving.is_some_and(|of| of != device) {
                return Err(Why::Spare);
            }
            return self.measurement(device, at_ns, content);
        }
        let known = self.devices.get(k).copied().flatten();
        if known.is_some_and(|d| d.spare(device, at_ns)) {
            return Err(Why::Spare);
        }
        let given = self.measurement(device, at_ns, content)?;
        if let Some(slot) = self.devices.get_mut(k) {
            let first = Devices {
                kept: (device, at_ns),
                stand_in: None,
            };
            slot.get_or_insert(first).gave(device, at_ns);
        }
        Ok(given)
    }
    fn measurement(&mut self, device: u32, at_ns: i64, content: Content) -> Result<Option<Measurement>, Why> {
        match content {
            Content::Rate(rate) => self.rate = Some((rate, at_ns)),
            Content::Rates(rates) => self.rates = Some((rates, at_ns)),
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
                return Ok(Some(self.heading(at_ns, heading + north, magnetic)));
            }
            Content::Attitude(tilt) => return Ok(Some(self.attitude(at_ns, tilt))),
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
                self.velocity = Some((([speed * cos, speed * sin], device), at_ns));
            }
            Content::Position(place) => {
                self.quick = Some((device, at_ns));
                return self.position(at_ns, place, device).map(Some);
            }
            Content::Gnss(fix) => {
                (self.fix, self.height_due) = (Some(((fix, device), at_ns)), true);
                // Quick positions carry it on where there are any.
                if paired(self.quick, at_ns, PAIR_NS) != Some(device) {
                    return self.position(at_ns, fix.place, device).map(Some);
                }
                accuracy(fix.quality)?;
            }
        }
        Ok(None)
    }
    fn heading(&self, at_ns: i64, heading: f64, magnetic: bool) -> Measurement {
        let fix = self.mounting.heading_fix(self.mounting.heading(heading));
        let sd = if magnetic { MAGNETIC_SD } else { 0.0 };
        Measurement::Heading(HeadingFix {
            heading_sd: fix.heading_sd.hypot(sd),
            rate: paired(self.rate, at_ns, PAIR_NS),
            ..fix
        })
    }
    fn attitude(&self, at_ns: i64, [roll, pitch]: [f64; 2]) -> Measurement {
        let [roll, pitch, _] = self.mounting.attitude([roll, pitch, 0.0]);
        let heave = paired(self.heave, at_ns, PAIR_NS).and_then(|h| self.mounting.heave(h));
        Measurement::Attitude(AttitudeFix {
            rates: paired(self.rates, at_ns, PAIR_NS).map(|r| self.mounting.vector(r)),
            heave,
            heave_sd: self.mounting.mount.heave_sd_m,
            ..self.mounting.tilt([roll, pitch])
        })
    }
    /// A fix with the velocity, the quality and, once, the height that belong to it.
    fn position(
        &mut self,
        at_ns: i64,
        [latitude, longitude]: [f64; 2],
        device: u32,
    ) -> Result<Measurement, Why> {
        let fix = paired(self.fix, at_ns, FIX_NS).filter(|(_, of)| *of == device);
        let fix = fix.map(|(fix, _)| fix);
        let quality = fix.map_or(1, |f| f.quality);
        let dilution = fix.and_then(|f| f.hdop).unwrap_or(1.0).clamp(0.5, 50.0);
        let sd = accuracy(quality)? * dilution;
        let place = Datum::new(latitude, longitude, 0.0);
        let altitude = fix
            .and_then(|f| Some((f.altitude_m?, f.separation_m)))
            .filter(|_| core::mem::take(&mut self.height_due));
        let (height_m, height_sd, height_spread) = match altitude {
            Some((altitude, stated)) => {
                let (height, spread) = self.height(&place, altitude, stated);
                (height, 2.0 * sd, spread)
            }
            None => (0.0, NOT_MEASURED_SD, 0.0),
        };
        let velocity = paired(self.velocity, at_ns, PAIR_NS).filter(|(_, of)| *of == device);
        let [north, east] = velocity.map(|(v, _)| v).unwrap_or_default();
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
    /// mast by the one and not by the other. Where that decides nothing, the difference is the spread. The sea lies where
    /// the receiver states it, unless that cannot be the geoid (0 is a receiver that states none).
    fn height(&mut self, place: &Datum, altitude: f64, stated: Option<f64>) -> (f64, f64) {
        let geoid = self.geoid.at(place);
        let stated = stated.filter(|s| *s != 0.0 && (s - geoid.height_m).abs() <= DOUBTFUL_M);
        let (sea, sigma_m) = stated.map_or((geoid.height_m, geoid.sigma_m), |s| (s, 0.0));
        let by = [altitude - sea, altitude].map(|above| ANTENNA_M.contains(&above));
        self.heights += 1;
        match by {
            [false, true] => {
                self.above_sea += 1;
                (altitude + sea, sigma_m)
            }
            [true, false] => (altitude, 0.0),
            // On a lake nothing decides it.
            [true, true] | [false, false] => (altitude, sea.abs()),
        }
    }
    /// Remarks on its heights, and those of the account of its messages.
    pub(super) fn remarks(&self, account: &Account) -> Vec<Remark> {
        let heights = (self.above_sea > 0).then(|| {
            Remark::fine(format!(
                "height: {} of {} can only be above the sea, and are taken so",
                self.above_sea, self.heights
            ))
        });
        heights.into_iter().chain(account.remarks()).collect()
    }
}

/// What was sent within `limit_ns` of a time.
fn paired<T>(newest: Newest<T>, at_ns: i64, limit_ns: i64) -> Option<T> {
    newest
        .filter(|(_, at)| is_near(at_ns, *at, limit_ns))
        .map(|(x, _)| x)
}
/// Whether two times lie within `limit_ns`, ns.
pub(super) fn is_near(a_ns: i64, b_ns: i64, limit_ns: i64) -> bool {
    a_ns.abs_diff(b_ns) <= limit_ns.unsigned_abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_of_a_group_that_fall_silent_and_return() {
        let mut bus = Bus::default();
        let mut takes = |device: u32, at_s: f64| {
            let heading = Content::Heading {
                heading: 1.0,
                variation: None,
                deviation: None,
                magnetic: false,
            };
            bus.take(device, (at_s * 1e9) as i64, heading).is_ok()
        };
        assert!(takes(1, 0.0) && !takes(2, 0.1) && takes(1, 1.0));
        // The second stands in, alone, until the first returns.
        assert!(!takes(2, 2.9) && takes(2, 3.1) && !takes(3, 3.2));
        assert!(takes(1, 3.3) && !takes(2, 3.4) && takes(1, 4.0));
        // A third where both are silent.
        assert!(takes(2, 6.1) && takes(3, 8.2) && !takes(2, 8.3) && takes(1, 8.4));
    }

    /// Fixes of two receivers at 10 Hz with whole ones each second, of which `first` speaks first, and `other` perhaps of
    /// its velocity before. A receiver's number is its latitude.
    fn fixes_of_two([first, other]: [u32; 2], velocity_before: bool) -> Vec<GnssFix> {
        let mut bus = Bus::default();
        let place = |of: u32| [f64::from(of), 14.5];
        let velocity = |of: u32| Content::velocity(f64::from(of), Some((0.0, false))).unwrap();
        let whole = |of: u32| {
            Content::Gnss(Gnss {
                place: place(of),
                altitude_m: Some(100.0 + f64::from(of)),
                separation_m: None,
                quality: 2,
                hdop: None,
            })
        };
        let mut sent = Vec::new();
        if velocity_before {
            sent.push((other, 0, velocity(other)));
        }
        for k in 0..50_i64 {
            let at_ns = k * 100_000_000 + 1_000_000;
            if k % 10 == 3 {
                sent.extend([other, first].map(|of| (of, at_ns, whole(of))));
            }
            sent.extend([first, other].map(|of| (of, at_ns, Content::Position(place(of)))));
            sent.extend([other, first].map(|of| (of, at_ns, velocity(of))));
        }
        let taken = sent
            .into_iter()
            .filter_map(|(of, at_ns, c)| bus.take(of, at_ns, c).ok()?);
        taken
            .map(|m| match m {
                Measurement::Gnss(fix) => fix,
                m => panic!("{m:?}"),
            })
            .collect()
    }

    #[test]
    fn receivers_that_both_send_everything() {
        for (devices, velocity_before) in [([1, 2], false), ([1, 2], true), ([2, 1], false), ([2, 1], true)] {
            let fixes = fixes_of_two(devices, velocity_before);
            let of = f64::from(devices[0]);
            assert_eq!(fixes.len(), 50, "{devices:?}");
            assert!(
                fixes.iter().all(|f| (f.datum.latitude_deg - of).abs() < 1e-9),
                "{devices:?}"
            );
            let is_measured = |sd: f64| sd < NOT_MEASURED_SD;
            let heights = fixes.iter().filter(|f| is_measured(f.position_sd[2]));
            assert_eq!(heights.count(), 5, "{devices:?}");
            let with_velocity =
                |f: &&GnssFix| is_measured(f.velocity_sd[0]) && (f.velocity[0] - of).abs() < 1e-9;
            assert_eq!(fixes.iter().filter(with_velocity).count(), 49, "{devices:?}");
            let better = fixes
                .iter()
                .filter(|f| f.position_sd[0] < fixes[0].position_sd[0]);
            assert_eq!(better.count(), 47, "of whole fixes");
        }
    }

    #[test]
    fn receiver_that_stands_in_with_its_velocity() {
        let mut bus = Bus::default();
        let velocity = |of: u32| Content::velocity(f64::from(of), Some((0.0, false))).unwrap();
        let place = Content::Position([50.0, 14.5]);
        let mut takes = |of, at_s: f64, c| bus.take(of, (at_s * 1e9) as i64, c).is_ok();
        assert!(takes(1, 0.0, place) && !takes(2, 0.1, velocity(2)) && takes(1, 0.1, velocity(1)));
        // The first has no position any more, and still a velocity.
        assert!(takes(2, 2.5, place) && takes(2, 2.5, velocity(2)) && !takes(1, 2.6, velocity(1)));
        assert!(takes(1, 3.0, place) && takes(1, 3.0, velocity(1)) && !takes(2, 3.1, velocity(2)));
    }

    #[test]
    fn separation_of_a_receiver() {
        // The sea lies 45 m above the ellipsoid here.
        let mut bus = Bus::default();
        let place = Datum::new(50.0, 14.5, 0.0);
        assert_eq!(bus.height(&place, 2.5, Some(44.0)), (46.5, 0.0));
        for stated in [None, Some(0.0), Some(-30.0)] {
            let (height, spread) = bus.height(&place, 2.5, stated);
            assert!(
                (height - 47.6).abs() < 1.0 && spread > 0.0,
                "{stated:?}: {height}"
            );
        }
        assert_eq!(bus.height(&place, 48.0, Some(44.0)), (48.0, 0.0));
    }
}
