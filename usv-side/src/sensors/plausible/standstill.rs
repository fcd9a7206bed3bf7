//! Detection of channels that repeat a number while the boat moves: a driver repeats its last sentence, an
//! instrument is aligning, a field has no sensor.
//!
//! Evidence of motion is a swing of any channel of any sensor: a value that reverses twice by more than its
//! noise. Waves cause two swings per period, a manoeuvre none. Each swing implies a minimum movement of other
//! channels. A channel stands still if it does not change during several swings that imply clearly more than
//! its resolution: the smallest recent change. A channel that never changed is assumed coarse, but ten times finer if
//! its number has decimals, or is a heading of exactly zero, which is a placeholder. Roll has the resolution of pitch.

use core::f64::consts::PI;

use alight_shared::{
    frames::wrap_angle,
    geodesy::Datum,
    time::{Time, VesselClock},
};

use super::{
    RATE_ERROR_RADPS,
    antenna::{Antenna, Inverted},
    drift::{Drift, DriftAngle},
    has_height, has_place, has_velocity,
};
use crate::sensors::{Measurement, Remark, UNWITNESSED};

/// Channels that may stand still: roll and pitch together, or one of them while the other moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Channel {
    Tilt,
    Roll,
    Pitch,
    Heading,
    Heave,
    Height,
    Place,
    Rates,
    RateOfTurn,
}
const CHANNELS: usize = 9;

/// Minimum time, equal values and swings of a standstill; repetitions of a 1 Hz sensor are shorter.
const STILL_S: f64 = 4.0;
const STILL_VALUES: u32 = 5;
const STILL_SWINGS: u32 = 3;
/// Minimum movement implied by a swing, in resolutions of the channel.
const CLEARLY: f64 = 2.0;
const DEGREE: f64 = PI / 180.0;
/// Resolution of a channel that never changed: 1 deg of an angle, 0.1 m, 1 m, (unused), 1 deg/s, 0.2 deg/s; the
/// finest considered is a tenth.
const COARSE: [f64; CHANNELS] = [
    DEGREE,
    DEGREE,
    DEGREE,
    DEGREE,
    0.1,
    1.0,
    1.0,
    DEGREE,
    0.2 * DEGREE,
];
const FINE: f64 = 0.1;
/// Distance from a multiple of the coarse resolution, in it, that shows decimals; sentences have single precision.
const DECIMALS: f64 = 1e-3;
/// Maximum difference between numbers that count as equal (rad, m, deg of a position): rounding errors of rotations,
/// and of a height the geoid's slope along the way between two fixes.
const SAME: f64 = 1e-9;
const SAME_HEIGHT_M: f64 = 1e-3;
/// Factor on the smallest change at each later change, because old changes may be from another setting.
const FORGETTING: f64 = 1.005;
/// Minimum distance travelled according to the fix's velocity over which an unchanged position stands still,
/// m; its resolution is a thousandth of a minute or better.
const WAY_M: f64 = 10.0;
/// Minimum turn according to the rate over which an unchanged heading stands still, rad (20 deg), beyond the rate's error.
const TURN_RAD: f64 = 0.35;

/// Witnesses: name, and minimum peak-to-peak swing above noise, SI. Rates are integrated first, because their
/// own reversals are noise.
const WITNESSES: [(&str, f64); 8] = [
    ("roll", 0.005),
    ("pitch", 0.005),
    ("heading", 0.0175),
    ("heave", 0.1),
    ("height", 0.15),
    ("roll rate", 0.005),
    ("pitch rate", 0.005),
    ("rate of turn", 0.0175),
];
/// Index of the first rate in [`WITNESSES`].
const RATES: usize = 5;
/// Integration time of a rate, and maximum time between two of its values about the three axes, s.
const RATE_S: f64 = 3.0;
const MAX_STEP_S: [f64; 3] = [0.35, 0.35, 1.0];
/// Additional minimum swing of a height, in its standard deviations.
const HEIGHT_SDS: f64 = 6.0;
/// Maximum duration of a swing or a gap in it, s: longer motion is not a wave.
const MAX_SWING_S: f64 = 15.0;
/// Fractions of a movement that couple into another, conservatively small: a hull follows the slope, rolls
/// while it yaws, yaws while it rolls, and heaves with a wave that makes it roll.
const OF_SLOPE: f64 = 0.5;
const OF_TILT: f64 = 0.5;
const TILT_OF_YAW: f64 = 0.1;
const YAW_OF_TILT: f64 = 0.05;
const HEAVE_OF_TILT: f64 = 0.1;
const ROLL_OF_PITCH: f64 = 0.1;
/// Maximum wave slope, rad; a witness that implies more is noise.
const MAX_SLOPE: f64 = 0.4;
/// Maximum half period of roll, s; a slower one is heel in a turn.
const MAX_ROLL_S: f64 = 4.0;
const G: f64 = 9.81;

/// Channel that stands still: start, number (SI) and its axis if only that stands still, and the witness that moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Standstill {
    pub(super) since: Time<VesselClock>,
    pub(super) value: f64,
    pub(super) axis: &'static str,
    pub(super) by: &'static str,
    pub(super) is_new: bool,
}

/// Contradictions with the boat's other sensors: channels that stand still, a sign of the attitude, metres of heave
/// for each metre of height, and a heading across or against the course.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Contradicted {
    still: [Option<Standstill>; CHANNELS],
    pub(super) inverted: Option<Inverted>,
    pub(super) heave_per_height: Option<f64>,
    pub(super) drift: Option<Drift>,
    /// Time since which the heading repeats the course.
    pub(super) is_course: Option<Time<VesselClock>>,
}

impl Contradicted {
    pub(super) fn still(&self, channel: Channel) -> Option<Standstill> {
        let axis = if channel == Channel::Roll {
            " of roll"
        } else if channel == Channel::Pitch {
            " of pitch"
        } else {
            ""
        };
        let still = self.still.get(channel as usize).copied().flatten();
        still.map(|still| Standstill { axis, ..still })
    }
    /// A place that is repeated with a height that stands still is of the same old fix, and a height with a place.
    fn repeat_fix(&mut self, at: Time<VesselClock>, sensor: Option<&mut Sensor>) {
        let (standing, repeated) = match [Channel::Height, Channel::Place].map(|c| self.still(c)) {
            [Some(height), None] => (height, Channel::Place as usize),
            [None, Some(place)] => (place, Channel::Height as usize),
            [Some(_), Some(_)] | [None, None] => return,
        };
        let channel = sensor.and_then(|s| s.channels.get_mut(repeated)?.as_mut());
        let channel = channel.filter(|c| c.newest == at && c.lasts());
        if let Some((channel, still)) = channel.zip(self.still.get_mut(repeated)) {
            *still = Some(channel.standing(standing.by));
        }
    }
}

/// Newest value of a channel, and the movement of other channels while it remained unchanged.
#[derive(Clone, Copy, Debug)]
struct Repetition {
    numbers: [f64; 4],
    since: Time<VesselClock>,
    newest: Time<VesselClock>,
    count: u32,
    /// Smallest recent change; None before the first change.
    step: Option<f64>,
    swings: u32,
    /// Integral of the channel's rate, m or rad.
    way: f64,
    by: &'static str,
    is_named: bool,
}

impl Repetition {
    fn new(at: Time<VesselClock>, numbers: [f64; 4], step: Option<f64>) -> Self {
        Repetition {
            numbers,
            since: at,
            newest: at,
            count: 1,
            step,
            swings: 0,
            way: 0.0,
            by: "",
            is_named: false,
        }
    }
    fn take(&mut self, at: Time<VesselClock>, numbers: [f64; 4], rate: f64, same: f64) {
        let changes = self.numbers.iter().zip(numbers).map(|(a, b)| (a - b).abs());
        let change = changes.fold(0.0, f64::max);
        if change <= same && at >= self.newest {
            self.way += rate * (at - self.newest).secs().min(1.0);
            (self.newest, self.count) = (at, self.count.saturating_add(1));
            self.numbers = numbers;
            return;
        }
        let step = self.step.map_or(change, |step| change.min(FORGETTING * step));
        *self = Repetition::new(at, numbers, Some(step));
    }
    /// Resolution, with the smallest change of a related channel if this one never changed.
    fn resolution(&self, channel: usize, related: Option<f64>) -> f64 {
        let coarse = COARSE.get(channel).copied().unwrap_or(f64::INFINITY);
        let steps = self.numbers[0] / coarse;
        let has_decimals = (steps - steps.round()).abs() > DECIMALS;
        let is_read = [Channel::Heading as usize, Channel::Height as usize].contains(&channel);
        let is_zero = channel == Channel::Heading as usize && self.numbers.iter().all(|x| *x == 0.0);
        match self.step.or(related) {
            Some(step) => step.max(FINE * coarse),
            None if is_zero || is_read && has_decimals => FINE * coarse,
            None => coarse,
        }
    }
    fn still(&mut self, channel: usize) -> Option<Standstill> {
        let (least, rate) = if channel == Channel::Heading as usize {
            let error = RATE_ERROR_RADPS * (self.newest - self.since).secs();
            (TURN_RAD + error, "rate of turn")
        } else {
            (WAY_M, "velocity")
        };
        let by = match self.way.abs() >= least {
            true => rate,
            false if self.swings >= STILL_SWINGS => self.by,
            false => return None,
        };
        self.lasts().then(|| self.standing(by))
    }
    fn lasts(&self) -> bool {
        self.count >= STILL_VALUES && (self.newest - self.since).secs() >= STILL_S
    }
    fn standing(&mut self, by: &'static str) -> Standstill {
        Standstill {
            since: self.since,
            value: self.numbers[0],
            axis: "",
            by,
            is_new: !core::mem::replace(&mut self.is_named, true),
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Turns {
    newest: Option<(Time<VesselClock>, f64)>,
    /// Last reversal, extreme since then, and whether the value rises.
    turn: Option<(Time<VesselClock>, f64)>,
    extreme: Option<(Time<VesselClock>, f64)>,
    rises: Option<bool>,
}

/// Swing between two reversals: start, half its range, and duration, s.
#[derive(Clone, Copy, Debug)]
struct Swing {
    begun: Time<VesselClock>,
    amplitude: f64,
    half_s: f64,
}

impl Turns {
    /// Adds a value. When it has moved back by `noise`, returns the swing that ended at the last extreme.
    fn take(&mut self, at: Time<VesselClock>, x: f64, noise: f64) -> Option<Swing> {
        let gap_s = self.newest.map_or(0.0, |(then, _)| (at - then).secs());
        if !(0.0..MAX_SWING_S).contains(&gap_s) || !x.is_finite() {
            *self = Turns::default();
            return None;
        }
        self.newest = Some((at, x));
        let (then, extreme) = *self.extreme.get_or_insert((at, x));
        let Some(rises) = self.rises else {
            // The first value may lie between two reversals.
            if (x - extreme).abs() > 0.5 * noise {
                (self.rises, self.turn, self.extreme) = (Some(x > extreme), self.extreme, self.newest);
            }
            return None;
        };
        let further = if rises { x - extreme } else { extreme - x };
        if further >= 0.0 {
            self.extreme = self.newest;
        }
        if further >= -noise {
            return None;
        }
        let (begun, from) = self.turn.replace((then, extreme))?;
        (self.extreme, self.rises) = (self.newest, Some(!rises));
        let half_s = (then - begun).secs();
        (half_s > 0.0 && half_s < MAX_SWING_S).then_some(Swing {
            begun,
            amplitude: 0.5 * (extreme - from).abs(),
            half_s,
        })
    }
}

impl Swing {
    /// Minimum movement of each channel implied by a swing of `witness`, SI.
    fn implied(&self, witness: usize) -> [f64; CHANNELS] {
        let (a, w) = (self.amplitude, PI / self.half_s);
        let slope = a * w * w / G;
        let heave = if self.half_s < MAX_ROLL_S {
            HEAVE_OF_TILT * a * G / (w * w)
        } else {
            0.0
        };
        let [tilt, vertical, yaw] = match witness {
            2 => [TILT_OF_YAW * a, 0.0, OF_TILT * a],
            // A compass may be coarse although its number has decimals.
            7 => [0.0, 0.0, if a > CLEARLY * DEGREE { a } else { 0.0 }],
            3 | 4 if slope > MAX_SLOPE => [0.0; 3],
            3 | 4 => [OF_SLOPE * slope, a, YAW_OF_TILT * OF_SLOPE * slope],
            _ => [OF_TILT * a, heave, YAW_OF_TILT * a],
        };
        let [of_roll, of_pitch] = match witness {
            0 => [0.0, ROLL_OF_PITCH * a],
            1 => [ROLL_OF_PITCH * a, 0.0],
            _ => [0.0; 2],
        };
        let rates = [tilt * w, yaw * w];
        [
            tilt, of_roll, of_pitch, yaw, vertical, vertical, 0.0, rates[0], rates[1],
        ]
    }
}

#[derive(Clone, Debug, Default)]
struct Sensor {
    channels: [Option<Repetition>; CHANNELS],
    turns: [Turns; WITNESSES.len()],
    /// Heading without wrapping, rad.
    course: Option<f64>,
    /// Newest time and integral of the rates about the three axes, rad, and newest yaw rate, rad/s.
    integrals: [(Option<Time<VesselClock>>, f64); 3],
    yaw_rate: f64,
    has_force: bool,
    /// Antenna's motion compared with the attitudes of this sensor.
    antenna: Antenna,
    /// Heading of this sensor compared with the course.
    drift: DriftAngle,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Movement {
    sensors: Vec<Sensor>,
}

impl Movement {
    /// Remark on the quantities that `is_own` sensors measure and nothing confirms or contradicts.
    pub(crate) fn remark(&self, is_own: impl Fn(usize) -> bool) -> Option<Remark> {
        let own = self.unwitnessed().filter(|(sensor, _)| is_own(*sensor));
        let names: Vec<&str> = own.map(|(_, name)| name).collect();
        if names.is_empty() {
            return None;
        }
        let names = names.join(", ");
        let text = format!("{names} {UNWITNESSED}: nothing else on board confirms or contradicts it");
        Some(Remark::fine(text))
    }

    /// Sensors whose value of a quantity is neither confirmed nor contradicted, with the name of the quantity.
    fn unwitnessed(&self) -> impl Iterator<Item = (usize, &'static str)> {
        let of_row = |(name, channel, is_witness): &Quantity| {
            let mut with = self.sensors.iter().enumerate().filter(|(_, s)| s.has(*channel));
            let first = with.next().filter(|_| !self.sensors.iter().any(is_witness))?;
            with.next().is_none().then_some((first.0, *name))
        };
        QUANTITIES.iter().filter_map(of_row)
    }
    /// Adds a measurement of this sensor. Returns its contradictions with the others.
    pub(crate) fn take(&mut self, number: u8, m: &Measurement) -> Contradicted {
        let k = usize::from(number);
        if self.sensors.len() <= k {
            self.sensors.resize_with(k + 1, Sensor::default);
        }
        let Some(sensor) = self.sensors.get_mut(k) else {
            return Contradicted::default();
        };
        let swings = sensor.take(m);
        match m {
            Measurement::Attitude(attitude) => sensor.antenna.attitude(attitude),
            Measurement::Imu(_) => {}
            Measurement::Heading(heading) => {
                sensor.drift.heading(heading);
                let all = self.sensors.iter_mut();
                all.for_each(|s| s.antenna.heading(number, heading));
            }
            Measurement::Gnss(fix) => {
                for s in &mut self.sensors {
                    s.drift.fix(fix);
                    if has_place(fix) {
                        s.antenna.fix(number, fix);
                    }
                }
            }
        }
        for (witness, mut swing) in swings.into_iter().flatten() {
            // A quantised value that barely crosses a step changes by the whole step.
            let step = self.sensors.get(k).map_or(0.0, |s| s.step(witness));
            swing.amplitude = (swing.amplitude - 0.5 * step).max(0.0);
            let (implied, name) = (swing.implied(witness), WITNESSES.get(witness).map_or("", |w| w.0));
            for s in &mut self.sensors {
                let [roll, pitch] =
                    [Channel::Roll, Channel::Pitch].map(|c| s.channels.get(c as usize)?.as_ref()?.step);
                for (k, (channel, smallest)) in s.channels.iter_mut().zip(implied).enumerate() {
                    let Some(channel) = channel else { continue };
                    let related = match k {
                        _ if k == Channel::Roll as usize => pitch,
                        _ if k == Channel::Pitch as usize => roll,
                        _ => None,
                    };
                    let shows = smallest > CLEARLY * channel.resolution(k, related);
                    if shows && swing.begun >= channel.since {
                        (channel.swings, channel.by) = (channel.swings.saturating_add(1), name);
                    }
                }
            }
        }
        let own = self.sensors.get(k);
        let mut contradicted = Contradicted {
            inverted: own.and_then(|s| s.antenna.inverted()),
            heave_per_height: own.and_then(|s| s.antenna.heave_per_height()),
            drift: own.and_then(|s| s.drift.found()),
            is_course: own.and_then(|s| s.drift.is_copy()),
            ..Contradicted::default()
        };
        let channels = self.sensors.get_mut(k).map(|s| s.channels.iter_mut());
        let each = contradicted.still.iter_mut().zip(channels.into_iter().flatten());
        for (k, (to, channel)) in each.enumerate() {
            let own = channel.as_mut().filter(|c| c.newest == m.at());
            *to = own.and_then(|c| c.still(k));
        }
        contradicted.repeat_fix(m.at(), self.sensors.get_mut(k));
        contradicted
    }
}

/// Quantity, its channel, and whether a sensor has another quantity that is related to it.
type Quantity = (&'static str, Channel, fn(&Sensor) -> bool);
const QUANTITIES: [Quantity; 4] = [
    ("position", Channel::Place, |s| s.drift.has_velocity()),
    ("height", Channel::Height, |s| {
        s.has(Channel::Heave) || s.has_force
    }),
    ("roll and pitch", Channel::Tilt, |s| s.integrals[0].0.is_some()),
    ("heading", Channel::Heading, |s| {
        s.integrals[2].0.is_some() || s.drift.has_course()
    }),
];

impl Sensor {
    fn has(&self, channel: Channel) -> bool {
        let is_copy = channel == Channel::Heading && self.drift.is_copy().is_some();
        !is_copy && matches!(self.channels.get(channel as usize), Some(Some(_)))
    }
    /// Smallest recent change of a witness, SI; 0 for an integral.
    fn step(&self, witness: usize) -> f64 {
        use Channel::{Heading, Heave, Height, Tilt};
        let of = [Tilt, Tilt, Heading, Heave, Height].get(witness);
        of.and_then(|c| self.channels.get(*c as usize)?.as_ref()?.step)
            .unwrap_or_default()
    }
    fn channel(&mut self, channel: Channel, at: Time<VesselClock>, numbers: [f64; 4], rate: f64) {
        let same = if channel == Channel::Height {
            SAME_HEIGHT_M
        } else {
            SAME
        };
        if let Some(slot) = self.channels.get_mut(channel as usize) {
            match slot {
                Some(known) => known.take(at, numbers, rate, same),
                None => *slot = Some(Repetition::new(at, numbers, None)),
            }
        }
    }
    /// Integral of the rate about an axis over the newest seconds, rad, with its witness.
    fn integrate(&mut self, axis: usize, at: Time<VesselClock>, rate: f64) -> Option<(usize, f64)> {
        let witness = RATES + axis;
        let (newest, integral) = self.integrals.get_mut(axis)?;
        let dt = newest.replace(at).map_or(0.0, |then| (at - then).secs());
        let is_next = (0.0..*MAX_STEP_S.get(axis)?).contains(&dt);
        let next = (1.0 - dt / RATE_S) * (*integral + rate * dt);
        *integral = if is_next && next.is_finite() { next } else { 0.0 };
        if !is_next {
            *self.turns.get_mut(witness)? = Turns::default();
        }
        Some((witness, *integral))
    }
    /// Adds a measurement. Returns the completed swings by witness.
    fn take(&mut self, m: &Measurement) -> [Option<(usize, Swing)>; 6] {
        let at = m.at();
        let mut found = [None; 6];
        match m {
            Measurement::Imu(m) => {
                self.has_force = true;
                self.yaw_rate = m.gyro[2];
                for (axis, rate) in m.gyro.into_iter().enumerate() {
                    found[axis] = self.integrate(axis, at, rate);
                }
            }
            Measurement::Attitude(m) => {
                let [roll, pitch] = m.tilt;
                self.channel(Channel::Tilt, at, [roll, pitch, 0.0, 0.0], 0.0);
                self.channel(Channel::Roll, at, [roll, 0.0, 0.0, 0.0], 0.0);
                self.channel(Channel::Pitch, at, [pitch, 0.0, 0.0, 0.0], 0.0);
                (found[0], found[1]) = (Some((0, roll)), Some((1, pitch)));
                if let Some(heave) = m.heave {
                    self.channel(Channel::Heave, at, [heave, 0.0, 0.0, 0.0], 0.0);
                    found[2] = Some((3, heave));
                }
                if let Some([p, q, r]) = m.rates {
                    self.channel(Channel::Rates, at, [p, q, r, 0.0], 0.0);
                    self.yaw_rate = r;
                    for (axis, rate) in [p, q, r].into_iter().enumerate() {
                        found[3 + axis] = self.integrate(axis, at, rate);
                    }
                }
            }
            Measurement::Heading(m) => {
                if let Some(rate) = m.rate {
                    self.yaw_rate = rate;
                    found[1] = self.integrate(2, at, rate);
                }
                let turn = core::mem::take(&mut self.yaw_rate);
                self.channel(Channel::Heading, at, [m.heading, 0.0, 0.0, 0.0], turn);
                let last = self.course.unwrap_or(m.heading);
                let course = last + wrap_angle(m.heading - last);
                (self.course, found[0]) = (Some(course).filter(|c| c.is_finite()), Some((2, course)));
                if let Some(rate) = m.rate {
                    self.channel(Channel::RateOfTurn, at, [rate, 0.0, 0.0, 0.0], 0.0);
                }
            }
            Measurement::Gnss(m) => {
                let Datum {
                    latitude_deg,
                    longitude_deg,
                    height_m,
                } = m.datum;
                let [x, y, z] = m.position;
                let [north, east, _] = m.velocity;
                if has_place(m) {
                    let speed = if has_velocity(m) { north.hypot(east) } else { 0.0 };
                    self.channel(Channel::Place, at, [latitude_deg, longitude_deg, x, y], speed);
                }
                if has_height(m) {
                    self.channel(Channel::Height, at, [height_m - z, 0.0, 0.0, 0.0], 0.0);
                    let is_fine = HEIGHT_SDS * m.position_sd[2] <= WAY_M;
                    found[0] = is_fine.then_some((4, height_m - z));
                }
            }
        }
        let sd = m.gnss().map_or(0.0, |m| HEIGHT_SDS * m.position_sd[2]);
        found.map(|found| {
            let (witness, x) = found?;
            let (_, noise) = WITNESSES.get(witness)?;
            let swing = self.turns.get_mut(witness)?.take(at, x, noise.max(sd))?;
            Some((witness, swing))
        })
    }
}

#[cfg(test)]
mod tests;
