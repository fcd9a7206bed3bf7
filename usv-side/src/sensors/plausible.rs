//! Plausibility of each channel of a measurement. An impossible channel is removed and reported; the others are used.
//!
//! A single value can violate a physical bound. A channel is also compared over a minute, which averages noise out,
//! with another channel of its sensor or with its own mean. A rejected channel is used again once it has passed a
//! window. Measurements of a working sensor remain unchanged, bit for bit.

mod agreement;
mod antenna;
mod drift;
mod heave;
mod part;
mod standstill;
mod verdict;

use alight_shared::{
    msg::{AttitudeFix, GnssFix, MAX_SOURCES, NOT_MEASURED_SD},
    time::{Span, Time, VesselClock},
};

pub(crate) use self::standstill::Movement;
use self::{
    agreement::{Agreement, DERIVATIVES, YAW_RATE_S},
    antenna::Inverted,
    drift::Drift,
    heave::Heave,
    part::{PARTS, Part, Texts},
    standstill::Contradicted,
    verdict::{ChannelState, Doubt, Taken, WINDOW_S},
};
use super::{Measurement, Remark};

/// Maximum roll and pitch of a deck that has not capsized, rad (75 deg).
const MAX_TILT_RAD: f64 = 1.31;
/// Time without an impossible tilt after which possible ones are used again, s: half a period of roll.
const PASSING_S: f64 = 3.0;
/// Maximum angular rate of a hull about an axis, rad/s: rolling by 45 deg with a period of 1 s peaks at 4.9
/// rad/s. Degrees mistaken for radians exceed it in most waves.
const MAX_TURN_RADPS: f64 = 5.0;
/// Maximum speed of a boat, m/s (97 kn).
const MAX_SPEED_MPS: f64 = 50.0;
/// Range of an antenna's height above the ellipsoid, m: Dead Sea's shore (-430) to Titicaca (3 812), with the
/// geoid (-107 to 86) and a mast.
const HEIGHTS_M: core::ops::RangeInclusive<f64> = -600.0..=4000.0;
/// Maximum jump of a height by a new solution of the receiver, m, and in its standard deviations; the
/// estimator's level absorbs smaller jumps.
const HEIGHT_JUMP_M: f64 = 20.0;
const HEIGHT_JUMP_SDS: f64 = 6.0;
/// Maximum climb rate of an antenna on a mast in waves, m/s.
const MAX_CLIMB_MPS: f64 = 20.0;

/// Averaging time of the specific force, s, and angle of its mean from the vertical above which another axis
/// points down: 60 deg, because a boat heeled by 30 deg may also roll by 30 deg.
const GRAVITY_S: f64 = 10.0;
const MAX_MEAN_TILT_RAD: f64 = 1.05;
/// [`Measurement::kind`] of headings and attitudes.
const HEADING: usize = 2;
const ATTITUDE: usize = 3;

/// Permitted error of a rate of turn, rad/s: gyroscope bias, 1 deg/s.
const RATE_ERROR_RADPS: f64 = 0.0175;

#[derive(Clone, Debug)]
pub(crate) struct Judged {
    /// Measurement without the removed parts; None if nothing is left.
    pub(crate) measurement: Option<Measurement>,
    /// Parts removed from now on, each since the first value that led to it.
    retracted: Vec<(Part, Time<VesselClock>)>,
}

/// Channels of the sensors of one source.
#[derive(Clone, Debug, Default)]
pub(crate) struct Plausibility {
    /// Verdict on each part, in the order of [`PARTS`].
    verdicts: [ChannelState; PARTS.len()],
    heave: Heave,
    /// Agreements in the order of [`DERIVATIVES`].
    derivatives: [Agreement; DERIVATIVES.len()],
    /// Newest yaw rate sent with an attitude, rad/s.
    newest_yaw_rate: Option<(Time<VesselClock>, f64)>,
    /// Newest height, m.
    newest_height: Option<(Time<VesselClock>, f64)>,
    /// Heading across or against the course, at present.
    drift: Option<Drift>,
    /// Mean specific force, m/s², with the times of start and newest sample.
    mean_force: Option<([f64; 3], Time<VesselClock>, Time<VesselClock>)>,
}

impl Plausibility {
    /// Checks a measurement, including its contradictions with other sensors (`by_others`).
    pub(crate) fn take(&mut self, mut m: Measurement, by_others: &Contradicted) -> Judged {
        let (at, mut is_kept, mut retracted) = (m.at(), true, Vec::new());
        let mut parts = self.rates(&m);
        match &m {
            Measurement::Imu(sample) => parts.push((Part::Force, self.force(at, sample.accelerometer))),
            Measurement::Attitude(fix) => {
                parts.extend(
                    fix.heave
                        .map(|h| (Part::Heave, self.heave(fix, h, by_others.heave_per_height))),
                );
                let by_heading = !self.verdict(Part::YawRate).is_out();
                parts.extend(fix.rates.map(|_| (Part::YawRate, Taken::now(by_heading))));
                parts.push((Part::Tilt, self.tilt(fix, by_others.inverted)));
            }
            Measurement::Heading(_) => {
                self.drift = by_others.drift;
                let is_course = by_others.is_course;
                let loses = self
                    .verdict(Part::Heading)
                    .take(at, is_course.map(|_| Doubt::Copy));
                let heading = Taken {
                    believed: is_course.is_none(),
                    since: if loses { is_course } else { None },
                };
                parts.push((Part::Heading, heading));
            }
            Measurement::Gnss(fix) => {
                if has_height(fix) {
                    parts.push((Part::Height, self.height(fix)));
                }
                self.verdict(Part::Place).judge(at, None);
                if has_place(fix) {
                    parts.push((Part::Place, Taken::now(true)));
                }
            }
        }
        for (part, mut taken) in parts {
            // A heading tells about the yaw rate of the attitudes.
            if matches!((part, &m), (Part::YawRate, Measurement::Heading(_))) {
                retracted.extend(taken.since.map(|since| (part, since)));
                continue;
            }
            let mut channels = part.channels().iter().filter(|_| taken.believed);
            if let Some(standstill) = channels.find_map(|c| by_others.still(*c)) {
                self.verdict(part).reject(at, Doubt::Standstill(standstill, at));
                taken.believed = false;
                taken.since = standstill.is_new.then_some(standstill.since);
            }
            self.verdict(part).count(taken.believed);
            if !taken.believed {
                part.leave_out(&mut m);
                is_kept &= !part.is_whole();
            }
            retracted.extend(taken.since.map(|since| (part, since)));
        }
        Judged {
            measurement: is_kept.then_some(m),
            retracted,
        }
    }

    fn heave(&mut self, fix: &AttitudeFix, heave: f64, per_height: Option<f64>) -> Taken {
        let verdict = &mut self.verdicts[Part::Heave as usize];
        let taken = self.heave.take(verdict, fix.header.at, heave, fix.heave_sd);
        let doubt = per_height.filter(|_| taken.believed).map(Doubt::OfHeight);
        if let Some(doubt) = doubt {
            verdict.reject(fix.header.at, doubt);
        }
        Taken {
            believed: taken.believed && doubt.is_none(),
            ..taken
        }
    }

    /// Checks that the sensor's third axis points down: the mean specific force of many waves points up.
    fn force(&mut self, at: Time<VesselClock>, force: [f64; 3]) -> Taken {
        let (mean, newest, begun) = self.mean_force.unwrap_or((force, at, at));
        let gap_s = (at - newest).secs();
        let is_gap = !(-1.0..=1.0).contains(&gap_s) || !force.iter().all(|f| f.is_finite());
        let part = (gap_s.max(0.0) / GRAVITY_S).min(1.0);
        let mean: [f64; 3] = core::array::from_fn(|k| mean[k] + part * (force[k] - mean[k]));
        self.mean_force = (!is_gap).then_some((mean, at, begun));
        let [x, y, z] = mean;
        let (size, off) = (x.hypot(y).hypot(z), x.hypot(y).atan2(-z));
        let lasts = !is_gap && (at - begun).secs() > 2.0 * GRAVITY_S && size > 1.0;
        let doubt = (lasts && off > MAX_MEAN_TILT_RAD).then_some(Doubt::Axes(off));
        self.verdict(Part::Force).take(at, doubt);
        Taken::now(doubt.is_none())
    }

    /// Compares each rate of a measurement with the quantity that it changes.
    fn rates(&mut self, m: &Measurement) -> Vec<(Part, Taken)> {
        let at = m.at();
        if let Some(rate) = m.attitude().and_then(agreement::yaw_rate) {
            self.newest_yaw_rate = Some((at, rate));
        }
        let is_fresh = |(then, _): &(Time<VesselClock>, f64)| (at - *then).abs().secs() <= YAW_RATE_S;
        let yaw_rate = self.newest_yaw_rate.filter(is_fresh).map(|(_, rate)| rate);
        let rows = DERIVATIVES.iter().zip(&mut self.derivatives);
        let compared = rows.filter_map(|(row, agreement)| {
            let rate = (row.rate)(m, yaw_rate)?;
            let verdict = self.verdicts.get_mut(row.part as usize)?;
            Some((row.part, agreement.take((verdict, row), m, rate)))
        });
        compared.collect()
    }

    fn height(&mut self, fix: &GnssFix) -> Taken {
        let (at, height) = (fix.header.at, fix.datum.height_m - fix.position[2]);
        let before = self.newest_height.take();
        let doubt = if HEIGHTS_M.contains(&height) {
            self.newest_height = Some((at, height));
            before.and_then(|(then, before)| {
                let most = HEIGHT_JUMP_M
                    + HEIGHT_JUMP_SDS * fix.position_sd[2]
                    + MAX_CLIMB_MPS * (at - then).abs().secs();
                let change = height - before;
                (change.abs() > most).then_some(Doubt::Jump(change))
            })
        } else {
            Some(Doubt::Beyond(height))
        };
        let verdict = self.verdict(Part::Height);
        let loses = verdict.take(at, doubt);
        Taken {
            believed: doubt.is_none() && !verdict.is_out(),
            since: loses.then_some(at),
        }
    }

    fn tilt(&mut self, fix: &AttitudeFix, inverted: Option<Inverted>) -> Taken {
        let at = fix.header.at;
        let doubt = bounded(&fix.tilt, MAX_TILT_RAD).err();
        let doubt = doubt.or(inverted.map(Doubt::Inverted));
        // Without attitude there is no estimate, so a good value is used soon; degrees pass for radians in between.
        let verdict = self.verdict(Part::Tilt);
        let passes = verdict.is_out() && verdict.was_impossible(at, PASSING_S);
        verdict.take(at, doubt);
        Taken::now(doubt.is_none() && !passes)
    }

    fn verdict(&mut self, part: Part) -> &mut ChannelState {
        &mut self.verdicts[part as usize]
    }
    /// Remark on each part with removed values; `whose` names the sensor ("" or "second receiver: ").
    pub(crate) fn remarks(&self, whose: &str) -> Vec<Remark> {
        let remark = |(part, verdict): (&Part, &ChannelState)| {
            let (doubt, left_out, taken) = verdict.account()?;
            let t = part.texts();
            let text = format!(
                "{whose}{} {}: left out {left_out} times of {taken}; {}",
                t.name,
                doubt_text(doubt, &t),
                t.used
            );
            Some(match verdict.is_out() {
                true => Remark::fault(text, t.remedy),
                false => Remark::fine(text),
            })
        };
        let drift = self.drift.map(|d| {
            Remark::fault(
                format!(
                    "{whose}heading differs from the course over ground by a steady {:.0} deg at {:.1} m/s",
                    d.angle.to_degrees().abs(),
                    d.speed_mps
                ),
                "unless the vessel goes astern or drifts, check sign and mounting of the compass",
            )
        });
        let all = PARTS.iter().zip(&self.verdicts).filter_map(remark);
        all.chain(drift).collect()
    }
}

/// Text of a reason with its value, whose sign depends on the mounting and is shown for a bound only.
fn doubt_text(doubt: Doubt, t: &Texts) -> String {
    let size = |x: f64| format!("{:.1} {}", t.factor * x.abs(), t.unit);
    match doubt {
        Doubt::Beyond(x) => format!("is beyond what is possible ({:.1} {})", t.factor * x, t.unit),
        Doubt::Jump(x) => format!("jumps by {}", size(x)),
        Doubt::Drift(x) => format!("drifts by {} a minute", size(x)),
        Doubt::Mean(x) => format!("has a mean of {}, but must average zero in waves", size(x)),
        Doubt::Disagreement(x) => format!("differs by {} from the change of {}", size(x), t.compared),
        Doubt::Standstill(s, at) => format!(
            "stands still for {:.0} s at {:.1} {}{} while the {} moves",
            (at - s.since).secs(),
            t.factor * s.value,
            t.unit,
            s.axis,
            s.by
        ),
        Doubt::OfHeight(ratio) if ratio < 0.0 => {
            format!("has the opposite sign of the fixes' height ({ratio:.1} m per metre; see mount.heave)")
        }
        Doubt::OfHeight(ratio) => format!("is {ratio:.1} times the fixes' change of height: check its unit"),
        Doubt::Copy => format!(
            "repeats the {} over ground: this device has no compass",
            t.compared
        ),
        Doubt::Axes(off) => format!("shows gravity {} from down", size(off)),
        Doubt::Inverted(i) => format!(
            "has the wrong sign of {}, or gnss.antenna_m is wrong: by the fixes the antenna is at {:.1} m above the \
             vessel's origin, by gnss.antenna_m at {:.1} m",
            i.axis, i.measured_m, i.height_m
        ),
    }
}

/// Checks that magnitudes are within a bound, or returns the largest. NaN exceeds any bound.
fn bounded(values: &[f64], bound: f64) -> Result<(), Doubt> {
    let beyond = values.iter().filter(|v| !(-bound..=bound).contains(*v));
    match beyond.copied().max_by(|a, b| a.abs().total_cmp(&b.abs())) {
        Some(worst) => Err(Doubt::Beyond(worst)),
        None => Ok(()),
    }
}

fn has_velocity(fix: &GnssFix) -> bool {
    fix.velocity_sd[0].max(fix.velocity_sd[1]) < NOT_MEASURED_SD
}
fn has_climb(fix: &GnssFix) -> bool {
    fix.velocity_sd[2] < NOT_MEASURED_SD
}
fn has_place(fix: &GnssFix) -> bool {
    fix.position_sd[0].max(fix.position_sd[1]) < NOT_MEASURED_SD
}
fn has_height(fix: &GnssFix) -> bool {
    fix.position_sd[2] < NOT_MEASURED_SD
}

/// Removes implausible channels from a recording, with the values that led to a rejection. Returns the
/// measurements in order, and remarks.
pub(crate) fn sift(all: Vec<Measurement>) -> (Vec<Measurement>, Vec<Remark>) {
    let mut sources: [Plausibility; MAX_SOURCES] = Default::default();
    let mut movement = Movement::default();
    let mut kept = Vec::with_capacity(all.len());
    for m in all {
        let number = m.source();
        let Some(source) = sources.get_mut(usize::from(number)) else {
            kept.push(m);
            continue;
        };
        let judged = source.take(m, &movement.take(number, &m));
        kept.extend(judged.measurement);
        for (part, since) in judged.retracted {
            let count = retract(&mut kept, number, part, since);
            source.verdict(part).retract(count);
        }
    }
    let remarks = sources.iter().enumerate().flat_map(|(k, source)| {
        let whose = match k {
            0 => String::new(),
            k => format!("source {k}: "),
        };
        source.remarks(&whose)
    });
    (kept, remarks.collect())
}

/// Remark on the quantities of a recording that nothing confirms or contradicts.
pub(crate) fn unwitnessed(all: &[Measurement]) -> Option<Remark> {
    let mut movement = Movement::default();
    for m in all {
        movement.take(m.source(), m);
    }
    movement.remark(|_| true)
}

/// Removes a part from a source's measurements from `since` on. Returns the number of these measurements.
fn retract(kept: &mut Vec<Measurement>, number: u8, part: Part, since: Time<VesselClock>) -> u64 {
    if part.is_whole() {
        let count = kept.len();
        let kind = if matches!(part, Part::Heading) {
            HEADING
        } else {
            ATTITUDE
        };
        kept.retain(|m| m.source() != number || m.at() < since || m.kind() != kind);
        return (count - kept.len()) as u64;
    }
    // Other kinds and late measurements are in between.
    let begin = since - Span::from_secs(WINDOW_S);
    let recent = kept.iter_mut().rev().take_while(|m| m.at() >= begin);
    recent
        .filter(|m| m.source() == number && m.at() >= since)
        .map(|m| u64::from(part.leave_out(m)))
        .sum()
}

#[cfg(test)]
mod tests;
