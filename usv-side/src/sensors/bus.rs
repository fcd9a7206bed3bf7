//! Measurements from the devices of a boat's network: heading, rate of turn, attitude, heave, position, velocity.
//!
//! Several devices may send one group. The first is used until another is selected by the configuration or
//! proves better ([`devices`]); another replaces it while it is silent. Related values come from one device:
//! positions and whole fixes are one group, and unless a device is selected for the velocity, it comes from
//! the receiver of the positions. Positions arrive ten times per second without a height, whole fixes once
//! per second; their height is attached to the next quick position.

mod devices;
mod network;

use alight_shared::{
    geodesy::Datum,
    geoid::LocalGeoid,
    msg::{AttitudeFix, GnssFix, HeadingFix, NOT_MEASURED_SD},
};

use super::{
    Measurement, Mounting, Remark,
    heights::{ANTENNA_M, DOUBTFUL_M},
    nmea::{
        account::{Account, Why},
        sentences::{MAGNETIC_SD, STILL_MPS, VELOCITY_SD, accuracy},
    },
};
pub(super) use devices::{DeviceSample, HEADINGS, PAIR_NS, PLACES, TILTS, TURNS, is_near};
use devices::{RATES, VELOCITIES};
pub(super) use network::{Devices, Variations};

/// Maximum age of a whole fix whose quality and height are used, ns; their period is one second.
const FIX_NS: i64 = 2_500_000_000;
/// Factor on the standard deviation of a fix that its receiver marks with caution. Chosen.
const CAUTION: f64 = 3.0;
/// Standard deviation of a variation from a model of the Earth's field, rad: 0.4 deg.
/// Source: WMM2020's error model, at a horizontal field of 20 000 nT.
const VARIATION_SD: f64 = 0.007;
/// Maximum heading, rad: a full turn and a resolution. Degrees exceed it.
const TURN: f64 = core::f64::consts::TAU + 1e-3;
/// Newest value from a device, and its time, ns.
pub(super) type LatestValue<T> = Option<(T, i64)>;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Content {
    /// Heading relative to true or magnetic north (rad), with the compass's own variation and deviation.
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
    Velocity {
        course: f64,
        speed: f64,
        magnetic: bool,
    },
    Gnss(GnssReport),
}

/// Whole fix of a receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GnssReport {
    /// Latitude and longitude, deg.
    pub(super) place: [f64; 2],
    /// Altitude as the receiver defines it, m.
    pub(super) altitude_m: Option<f64>,
    /// Height of the sea above the ellipsoid according to the receiver, m.
    pub(super) separation_m: Option<f64>,
    /// As in NMEA 0183's GGA: 0 none, 1 GNSS, 2 differential, 4 and 5 RTK, 6 dead reckoning, 7 by hand, 8 simulated.
    pub(super) quality: u8,
    pub(super) hdop: Option<f64>,
    /// The receiver's integrity check advises caution.
    pub(super) caution: bool,
}

impl GnssReport {
    /// Standard deviation of the horizontal position, m, or the reason why the report is not a fix.
    fn position_sd(&self) -> Result<f64, Why> {
        let dilution = self.hdop.unwrap_or(1.0).clamp(0.5, 50.0);
        let doubt = if self.caution { CAUTION } else { 1.0 };
        Ok(accuracy(self.quality)? * dilution * doubt)
    }
}

impl Content {
    pub(super) const fn group(&self) -> usize {
        match self {
            Content::Heading { .. } => 0,
            Content::Rate(_) => 1,
            Content::Rates(_) => RATES,
            Content::Attitude(_) => 3,
            Content::Heave(_) => 4,
            Content::Variation(_) => 5,
            Content::Position(_) | Content::Gnss(_) => PLACES,
            Content::Velocity { .. } => VELOCITIES,
        }
    }
    /// Velocity from a speed (m/s) and a course, if any (rad, and whether it is magnetic). At rest there is no course.
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

/// Values received so far.
#[derive(Clone, Debug, Default)]
pub(super) struct SensorBus {
    mounting: Mounting,
    devices: Devices,
    variation: Variations,
    rate: LatestValue<f64>,
    rates: LatestValue<[f64; 3]>,
    heave: LatestValue<f64>,
    velocity: LatestValue<([f64; 2], u32)>,
    fix: LatestValue<(GnssReport, u32)>,
    /// The newest height has not been attached to a position yet.
    height_due: bool,
    /// Device and time of the last position without a height.
    quick: LatestValue<u32>,
    geoid: LocalGeoid,
    /// Number of heights that are only plausible above the sea, and of all heights.
    above_sea: u64,
    heights: u64,
    /// Number of whole fixes marked with caution, and number of all whole fixes.
    cautions: u64,
    fixes: u64,
}

impl SensorBus {
    pub(super) fn new(mounting: &Mounting) -> Self {
        SensorBus {
            mounting: mounting.clone(),
            devices: Devices::new(mounting),
            ..SensorBus::default()
        }
    }
    /// Sets the name under which a device sends, and the name that it claimed, or empty. The caller limits their number.
    pub(super) fn name(&mut self, device: u32, names: [&str; 2]) {
        self.devices.names.insert(device, names);
    }
    /// Measurements from a message of `device`, combined with earlier messages.
    pub(super) fn take(
        &mut self,
        device: u32,
        at_ns: i64,
        content: Content,
    ) -> Result<Option<Measurement>, Why> {
        let k = content.group();
        if matches!(content, Content::Heading { heading, .. } if heading.abs() > TURN) {
            return Err(Why::Range);
        }
        self.devices.arrive(at_ns);
        self.observe(device, at_ns, &content);
        if self.devices.is_spare(k, device, at_ns) {
            return Err(Why::Spare);
        }
        let given = self.measurement(device, at_ns, content)?;
        let is_chosen = self.devices.is_chosen(k, device);
        // Unless its device is selected, a velocity comes from the receiver of the positions.
        if k != VELOCITIES || is_chosen {
            self.devices.gave(k, device, at_ns, false);
        }
        Ok(given)
    }
    fn observe(&mut self, device: u32, at_ns: i64, content: &Content) {
        let k = content.group();
        if let Content::Variation(variation)
        | Content::Heading {
            variation: Some(variation),
            ..
        } = content
        {
            self.variation.state(device, *variation);
        }
        let Some(sample) = self.sample(device, content) else {
            return;
        };
        self.devices.observe(k, (device, at_ns), &sample);
        let part = if k == VELOCITIES {
            0
        } else if matches!(content, Content::Gnss(fix) if fix.altitude_m.is_some()) {
            1
        } else {
            return;
        };
        if let Some(places) = self.devices.groups.get_mut(PLACES) {
            places.note_part(device, part, at_ns);
        }
    }
    /// Value and standard deviation of a message; None if magnetic without a known variation.
    fn sample(&self, device: u32, content: &Content) -> Option<DeviceSample> {
        let mounting = &self.mounting;
        let (value, sd, stated_sd) = match content {
            Content::Heading {
                heading,
                variation,
                deviation,
                magnetic,
            } => {
                let north = self.north(device, *magnetic, *variation, *deviation).ok()?;
                let sd = if *magnetic { MAGNETIC_SD } else { 0.0 };
                ([heading + north, 0.0], mounting.heading_sd().hypot(sd), None)
            }
            Content::Rate(rate) => ([*rate, 0.0], 1.0, None),
            Content::Rates([roll, pitch, _]) => ([*roll, *pitch], 1.0, None),
            Content::Attitude(tilt) => (*tilt, mounting.tilt_sd(), None),
            Content::Heave(heave) => ([*heave, 0.0], mounting.mount.heave_sd_m, None),
            Content::Variation(variation) => ([*variation, 0.0], VARIATION_SD, None),
            Content::Position(place) => (*place, accuracy(1).ok()?, None),
            Content::Gnss(fix) => {
                let sd = fix.position_sd().unwrap_or(f64::INFINITY);
                (fix.place, sd, Some(sd))
            }
            Content::Velocity {
                course,
                speed,
                magnetic,
            } => {
                let (sin, cos) = (course + self.north(device, *magnetic, None, None).ok()?).sin_cos();
                ([speed * cos, speed * sin], VELOCITY_SD, None)
            }
        };
        Some(DeviceSample { value, sd, stated_sd })
    }
    /// Angle to add to refer an angle to true north, rad: the device's variation, or the network's.
    fn north(
        &self,
        device: u32,
        magnetic: bool,
        variation: Option<f64>,
        deviation: Option<f64>,
    ) -> Result<f64, Why> {
        if !magnetic {
            return Ok(0.0);
        }
        let own = variation.map(|_| device);
        let variation = self.variation.of(own, &self.devices).ok_or(Why::Magnetic)?;
        Ok(variation + deviation.unwrap_or_default())
    }
    fn measurement(&mut self, device: u32, at_ns: i64, content: Content) -> Result<Option<Measurement>, Why> {
        match content {
            Content::Rate(rate) => self.rate = Some((rate, at_ns)),
            Content::Rates(rates) => self.rates = Some((rates, at_ns)),
            Content::Heave(heave) => self.heave = Some((heave, at_ns)),
            Content::Variation(_) => {}
            Content::Heading {
                heading,
                variation,
                deviation,
                magnetic,
            } => {
                let north = self.north(device, magnetic, variation, deviation)?;
                if magnetic {
                    self.variation.used(north - deviation.unwrap_or_default());
                }
                return Ok(Some(self.heading(at_ns, heading + north, magnetic)));
            }
            Content::Attitude(tilt) => return Ok(Some(self.attitude(at_ns, tilt))),
            Content::Velocity {
                course,
                speed,
                magnetic,
            } => {
                let (sin, cos) = (course + self.north(device, magnetic, None, None)?).sin_cos();
                self.velocity = Some((([speed * cos, speed * sin], device), at_ns));
            }
            Content::Position(place) => {
                self.quick = Some((device, at_ns));
                return self.position(at_ns, place, device).map(Some);
            }
            Content::Gnss(fix) => {
                (self.fix, self.height_due) = (Some(((fix, device), at_ns)), true);
                (self.fixes, self.cautions) = (self.fixes + 1, self.cautions + u64::from(fix.caution));
                // Quick positions, if any, carry the height.
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
    /// Fix with the matching velocity and quality, and with a height that has not been used yet.
    fn position(
        &mut self,
        at_ns: i64,
        [latitude, longitude]: [f64; 2],
        device: u32,
    ) -> Result<Measurement, Why> {
        let fix = paired(self.fix, at_ns, FIX_NS).filter(|(_, of)| *of == device);
        let fix = fix.map(|(fix, _)| fix);
        let sd = fix.map_or_else(|| accuracy(1), |f| f.position_sd())?;
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
        let velocity = paired(self.velocity, at_ns, PAIR_NS);
        let velocity = velocity.filter(|(_, of)| *of == device || self.devices.is_chosen(VELOCITIES, *of));
        let [north, east] = velocity.map(|(v, _)| v).unwrap_or_default();
        let velocity_sd = velocity.map_or(NOT_MEASURED_SD, |_| VELOCITY_SD);
        let datum = Datum { height_m, ..place };
        if !datum.is_on_earth() {
            return Err(Why::Invalid);
        }
        if datum.is_nowhere() {
            return Err(Why::Nowhere);
        }
        let fix = self.mounting.fix(
            datum,
            [north, east, 0.0],
            [sd, sd, height_sd],
            [velocity_sd, velocity_sd, NOT_MEASURED_SD],
        );
        Ok(Measurement::Gnss(GnssFix { height_spread, ..fix }))
    }
    /// Height above the ellipsoid from a receiver's altitude, and its spread, m. Some receivers send it above the sea. An
    /// antenna is between the water and the top of a mast, so usually only one interpretation is possible; otherwise their
    /// difference is the spread. The stated height of the sea is used unless it cannot be the geoid (0: none).
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
            // On a lake, neither interpretation can be excluded.
            [true, true] | [false, false] => (altitude, sea.abs()),
        }
    }
    /// Remarks on devices and heights, and those of the message account.
    pub(super) fn remarks(&self, account: &Account) -> Vec<Remark> {
        let mut all = self.devices.remarks();
        all.extend(self.variation.remarks(&self.devices));
        if self.cautions > 0 {
            all.push(Remark::fault(
                format!(
                    "{} of {} whole fixes are marked with caution by their receiver: taken as {CAUTION} times less accurate",
                    self.cautions, self.fixes
                ),
                "check the antenna's view of the sky, and look for interference",
            ));
        }
        if self.above_sea > 0 {
            all.push(Remark::fine(format!(
                "height: {} of {} are only plausible above the sea, and are used as such",
                self.above_sea, self.heights
            )));
        }
        all.extend(account.remarks());
        all
    }
}

/// Text of an NMEA 2000 NAME: `0x` and 16 hexadecimal digits.
pub(super) fn name_text(number: u64) -> String {
    format!("0x{number:016x}")
}

/// Newest value, if it was sent within `limit_ns` of a time.
fn paired<T>(newest: LatestValue<T>, at_ns: i64, limit_ns: i64) -> Option<T> {
    newest
        .filter(|(_, at)| is_near(at_ns, *at, limit_ns))
        .map(|(x, _)| x)
}

#[cfg(test)]
mod tests;
