//! Agreement of the integral of a rate over an interval with the change of its quantity, for each row of
//! [`DERIVATIVES`].
//!
//! Over a short step, noise exceeds the change of the quantity; an interval averages the noise. The rate is
//! rejected only if most intervals of a window disagree, so a jump of the quantity does not count against it.

use alight_shared::{
    frames::{VesselNed, wrap_angle},
    msg::AttitudeFix,
    time::{Time, VesselClock},
};

use super::{
    HEIGHT_JUMP_M, MAX_CLIMB_MPS, MAX_SPEED_MPS, MAX_TILT_RAD, MAX_TURN_RADPS, RATE_ERROR_RADPS, bounded,
    has_climb, has_height, has_place, has_velocity,
    part::Part,
    verdict::{ChannelState, Doubt, Taken},
};
use crate::sensors::Measurement;

/// Difference of two values that noise explains, in standard deviations: sqrt 2 times 3.
const NOISE: f64 = 3.0 * core::f64::consts::SQRT_2;
/// Minimum standard deviation assumed for a tilt (0.2 deg), a heading (1 deg), rad, and a position, m.
const MIN_TILT_SD: f64 = 0.0035;
const MIN_HEADING_SD: f64 = 0.017;
const MIN_POSITION_SD_M: f64 = 0.3;
/// Permitted error of a velocity, m/s, in addition to its noise: waves not resolved by the receiver's rate.
const VELOCITY_ERROR_MPS: f64 = 0.3;
/// Maximum distance between two equal places, m: rounding errors.
const SAME_PLACE_M: f64 = 1e-6;
/// Fraction of a change by which the integral of its rate may differ: half for a simultaneous rate; above one
/// for a smoothed rate (of turn, or a course), because smoothing removes at most the whole change.
const EXACT: f64 = 0.5;
const SMOOTHED: f64 = 1.5;
/// Maximum age of a yaw rate that is compared with a heading, s.
pub(super) const YAW_RATE_S: f64 = 0.35;

/// Fraction of disagreeing intervals above which the rate is rejected; with a lag of a tenth of the motion's
/// period, half of them disagree.
const MAX_DISAGREEING: f64 = 0.6;

/// Rate of a quantity, SI, or the reason why it is impossible.
type Rate = Result<[f64; 2], Doubt>;

/// Relation between a quantity and its rate: SI, two components, the second 0 for a scalar.
pub(super) struct Derivative {
    /// Part that is left out if they disagree.
    pub(super) part: Part,
    /// Rate, also by the newest yaw rate of an attitude, or the reason why it is impossible; None without one.
    pub(super) rate: fn(&Measurement, Option<f64>) -> Option<Rate>,
    /// Change of the quantity; None if it is repeated, which does not test the rate.
    change: fn(&Measurement, &Measurement) -> Option<[f64; 2]>,
    /// Difference that noise explains over an interval.
    noise: fn(&Measurement) -> Option<f64>,
    /// Fraction of the change by which the integral may differ, and by which its length may.
    fractions: [f64; 2],
    interval_s: f64,
    /// Maximum time between two values, s; after a longer gap the rate is unknown.
    step_s: f64,
    /// Number of intervals of a window.
    window: u32,
}

pub(super) const DERIVATIVES: [Derivative; 5] = [
    Derivative {
        part: Part::Rates,
        rate: |m, _| angle_rates(m.attitude()?),
        change: |from, to| {
            let [from, to] = [from.attitude()?.tilt, to.attitude()?.tilt];
            Some([wrap_angle(to[0] - from[0]), to[1] - from[1]])
        },
        noise: |m| Some(NOISE * m.attitude()?.tilt_sd.max(MIN_TILT_SD)),
        fractions: [EXACT; 2],
        interval_s: 1.0,
        step_s: 0.35,
        window: 30,
    },
    Derivative {
        part: Part::YawRate,
        rate: |m, yaw_rate| m.heading().and(Some(Ok([yaw_rate?, 0.0]))),
        ..RATE_OF_TURN
    },
    RATE_OF_TURN,
    Derivative {
        part: Part::Velocity,
        rate: |m, _| {
            let fix = m.gnss().filter(|fix| has_velocity(fix) && has_place(fix))?;
            let [north, east, _] = fix.velocity;
            Some(bounded(&[north.hypot(east)], MAX_SPEED_MPS).map(|()| [north, east]))
        },
        change: |from, to| {
            let [north, east, _] = moved(from, to)?;
            // A repeated place does not test the velocity, whatever its height.
            (north.hypot(east) > SAME_PLACE_M).then_some([north, east])
        },
        noise: |m| {
            let fix = m.gnss()?;
            let sd = fix.position_sd[0].max(fix.position_sd[1]);
            let rate_sd = fix.velocity_sd[0].max(fix.velocity_sd[1]);
            Some(NOISE * sd.max(MIN_POSITION_SD_M) + 5.0 * (3.0 * rate_sd + VELOCITY_ERROR_MPS))
        },
        // The direction has the tolerance of a smoothed course.
        fractions: [SMOOTHED, EXACT],
        interval_s: 5.0,
        step_s: 2.5,
        window: 12,
    },
    Derivative {
        part: Part::Climb,
        rate: |m, _| {
            let fix = m.gnss().filter(|fix| has_climb(fix) && has_height(fix))?;
            let down = fix.velocity[2];
            Some(bounded(&[down], MAX_CLIMB_MPS).map(|()| [down, 0.0]))
        },
        change: |from, to| {
            let down = moved(from, to)?[2];
            // A jump of the height is no fault of the velocity.
            (down.abs() < HEIGHT_JUMP_M).then_some([down, 0.0])
        },
        // The noise of several velocities averages out within the interval.
        noise: |m| {
            m.gnss()
                .map(|fix| NOISE * fix.position_sd[2] + fix.velocity_sd[2])
        },
        fractions: [EXACT; 2],
        interval_s: 1.0,
        step_s: 0.35,
        window: 30,
    },
];
const RATE_OF_TURN: Derivative = Derivative {
    part: Part::RateOfTurn,
    rate: |m, _| {
        let rate = m.heading()?.rate?;
        Some(bounded(&[rate], MAX_TURN_RADPS).map(|()| [rate, 0.0]))
    },
    change: |from, to| {
        let turned = wrap_angle(to.heading()?.heading - from.heading()?.heading);
        (turned != 0.0).then_some([turned, 0.0])
    },
    noise: |m| Some(NOISE * m.heading()?.heading_sd.max(MIN_HEADING_SD) + 5.0 * RATE_ERROR_RADPS),
    fractions: [SMOOTHED; 2],
    interval_s: 5.0,
    step_s: 0.6,
    window: 12,
};

/// Rates of roll and pitch, rad/s: `roll' = p + (q sin + r cos) tan pitch`, `pitch' = q cos - r sin`.
fn angle_rates(fix: &AttitudeFix) -> Option<Rate> {
    let [p, q, r] = fix.rates?;
    let (sin, cos) = fix.tilt[0].sin_cos();
    let of_angles = [p + (q * sin + r * cos) * fix.tilt[1].tan(), q * cos - r * sin];
    Some(bounded(&[p, q, r], MAX_TURN_RADPS).map(|()| of_angles))
}
/// Rate of the yaw angle by an attitude's angular rates, rad/s.
pub(super) fn yaw_rate(fix: &AttitudeFix) -> Option<f64> {
    let [roll, pitch] = fix.tilt;
    let [_, q, r] = fix.rates.filter(|rates| bounded(rates, MAX_TURN_RADPS).is_ok())?;
    let (sin, cos) = roll.sin_cos();
    (pitch.abs() < MAX_TILT_RAD).then(|| (q * sin + r * cos) / pitch.cos())
}
/// Way between two fixes, north, east and down, m.
fn moved(from: &Measurement, to: &Measurement) -> Option<[f64; 3]> {
    let (from, to) = (from.gnss()?, to.gnss()?);
    let apart = from.datum.to::<VesselNed>(&to.datum).0;
    Some(core::array::from_fn(|k| {
        apart[k] + to.position[k] - from.position[k]
    }))
}

/// Comparison of a rate and its quantity.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Agreement {
    /// Measurement at the start of the interval.
    begin: Option<Measurement>,
    last: Option<(Time<VesselClock>, [f64; 2])>,
    integral: [f64; 2],
    /// Intervals in the window, disagreeing ones, and sum of their squared differences.
    intervals: u32,
    disagreeing: u32,
    squares: f64,
    since: Option<Time<VesselClock>>,
}

impl Agreement {
    /// Adds a measurement with its rate, or the reason why the rate is impossible.
    pub(super) fn take(
        &mut self,
        (verdict, row): (&mut ChannelState, &Derivative),
        m: &Measurement,
        rate: Rate,
    ) -> Taken {
        let since = match rate {
            Ok(rate) => self.add((&mut *verdict, row), m, rate),
            Err(doubt) => {
                (self.begin, self.last) = (None, None);
                verdict
                    .reject(m.at(), doubt)
                    .then_some(self.since.unwrap_or(m.at()))
            }
        };
        Taken {
            believed: rate.is_ok() && !verdict.is_out(),
            since,
        }
    }
    fn add(
        &mut self,
        (verdict, row): (&mut ChannelState, &Derivative),
        m: &Measurement,
        rate: [f64; 2],
    ) -> Option<Time<VesselClock>> {
        let at = m.at();
        let step = self.last.map(|(then, before)| ((at - then).secs(), before));
        let Some((dt, before)) = step.filter(|(dt, _)| *dt > -1.0 && *dt <= row.step_s) else {
            (self.begin, self.last) = (Some(*m), Some((at, rate)));
            self.integral = [0.0; 2];
            return None;
        };
        if dt <= 0.0 {
            return None;
        }
        self.last = Some((at, rate));
        for (sum, (a, b)) in self.integral.iter_mut().zip(rate.into_iter().zip(before)) {
            *sum += 0.5 * (a + b) * dt;
        }
        let from = self.begin?;
        let begun = from.at();
        if (at - begun).secs() < row.interval_s {
            return None;
        }
        self.begin = Some(*m);
        let integral = core::mem::take(&mut self.integral);
        let change = (row.change)(&from, m)?;
        let size = f64::hypot(change[0], change[1]);
        let off = f64::hypot(change[0] - integral[0], change[1] - integral[1]);
        let further = (size - f64::hypot(integral[0], integral[1])).abs();
        let noise = (row.noise)(m)?;
        let [most, most_further] = row.fractions.map(|fraction| noise + fraction * size);
        self.since.get_or_insert(begun);
        self.intervals += 1;
        self.disagreeing += u32::from(off > most || further > most_further);
        self.squares += off * off;
        if self.intervals < row.window {
            return None;
        }
        let n = f64::from(self.intervals);
        let rms = (self.squares / n).sqrt() / row.interval_s;
        let doubt = (f64::from(self.disagreeing) > MAX_DISAGREEING * n).then_some(Doubt::Disagreement(rms));
        (self.intervals, self.disagreeing, self.squares) = (0, 0, 0.0);
        let since = self.since.take();
        since.filter(|_| verdict.judge(at, doubt))
    }
}
