//! Advice for the helm: heading and speed with the highest probability of a successful landing.
//!
//! The vessel's own motion gives the directional wave spectrum ([`waves`]). The vessel model, corrected at each
//! frequency by measurements on the present course, gives the deck's motion on any other course ([`hull`]). That motion
//! and the wind over the deck give the probability of a landing by the drone's own definition
//! ([`alight_shared::landing`]): speed and angle of the contact, four feet on the deck, and staying at rest.
//!
//! The slopes that move a landed drone are those of the last two minutes, as in the drone's own calculation,
//! scaled on another course by the ratio of the modelled deviations.
//!
//! A change of course costs the time until the new course is steady, valued like waiting in the drone's mission
//! ([`WAITING_COST_PER_MIN`]).
//!
//! One course is evaluated per step to keep steps short; a round begins every [`PERIOD_S`].

mod hull;
mod limits;
mod waves;

use core::f64::consts::TAU;

use alight_shared::{
    frames::wrap_angle,
    geometry::{DeckGeometry, DroneGeometry, GRAVITY},
    landing::{
        BLIND_S, CONTACT_MPS, Contact, FRICTION, Margins, REACTION_S, Slopes, Staying, SupportPolygon,
        WAITING_COST_PER_MIN, WindPush, alignment_mps, wind_during_alignment,
    },
    motion_model::{MotionModel, MotionSample},
    msg::{CourseAdvice, SLOPE_STEP, SLOPE_WINDOWS, Seq},
    time::{Span, VesselClock, VesselTime},
    vessel_model::{HEAVE, PITCH, ROLL, VesselModelConfig},
};
use nalgebra::{Rotation2, Vector2};
use serde::Serialize;

pub use limits::AdviceConfig;

use hull::{HullModel, LIFT, PUSH, Powers, SINK, SLOPE, TILT};
use waves::{EstimatedSea, WaveSpectrum};

/// Interval between rounds over all courses, s.
pub const PERIOD_S: f64 = 5.0;
/// Number of compared headings, 15 deg apart.
const HEADINGS: u32 = 24;
const HEADING_STEP_RAD: f64 = TAU / HEADINGS as f64;
/// Spacing of compared speeds, m/s, from the minimum steering speed.
const SPEED_STEP_MPS: f64 = 2.0;
/// Maximum number of speeds: the present one and slower ones.
const MAX_SPEEDS: usize = 6;
/// Turn rate without heeling, rad/s, and acceleration, m/s². Chosen: gentle for a small boat.
const TURN_RADPS: f64 = 0.1;
const SPEED_CHANGE_MPS2: f64 = 0.3;
const MAX_TURN_S: f64 = 30.0;
/// Turn rate above which the sea is not estimated, rad/s.
const TURNING_RADPS: f64 = 0.1;
/// Age after which the estimated sea is discarded, s.
const MAX_SEA_AGE_S: f64 = 600.0;
/// Typical standard deviation of the forecast position per axis, m.
const PLACE_SD_M: f64 = 0.05;
const NO_WIND: Vector2<f64> = Vector2::new(0.0, 0.0);

/// Deck motion and probability of a landing on one course.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct CourseOutlook {
    pub heading_rad: f64,
    pub speed_mps: f64,
    pub tilt_sd_rad: [f64; 2],
    /// Standard deviation of the deck's vertical speed, m/s.
    pub heave_rate_sd_mps: f64,
    /// Standard deviation of the apparent slope, averaged over one second.
    pub slope_sd: f64,
    /// Probability of success of a landing begun at a random moment.
    pub likelihood: f64,
}

impl CourseOutlook {
    pub fn tilt_rad(&self) -> f64 {
        self.tilt_sd_rad[0].hypot(self.tilt_sd_rad[1])
    }
    pub fn time_from_s(&self, other: &CourseOutlook) -> f64 {
        let turn = wrap_angle(self.heading_rad - other.heading_rad).abs() / TURN_RADPS;
        turn.max((self.speed_mps - other.speed_mps).abs() / SPEED_CHANGE_MPS2)
    }
    /// Distance lost per minute along `other`'s heading, m.
    pub fn way_lost_m(&self, other: &CourseOutlook) -> f64 {
        let made = self.speed_mps * (self.heading_rad - other.heading_rad).cos();
        60.0 * (other.speed_mps - made)
    }
    /// Probability of this course minus the cost of the time to reach it from `other`.
    fn worth(&self, other: &CourseOutlook) -> f64 {
        self.likelihood - WAITING_COST_PER_MIN / 60.0 * self.time_from_s(other)
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Advice {
    pub here: CourseOutlook,
    /// Best course; the present one if none is better.
    pub best: CourseOutlook,
    /// Direction in which the waves propagate, rad.
    pub waves_to_rad: f64,
}

impl Advice {
    pub fn is_change(&self) -> bool {
        self.best != self.here
    }
    pub fn turn_s(&self) -> f64 {
        self.best.time_from_s(&self.here)
    }
    pub fn way_lost_m(&self) -> f64 {
        self.best.way_lost_m(&self.here)
    }
}

impl From<&Advice> for CourseAdvice {
    fn from(a: &Advice) -> CourseAdvice {
        let pair = |f: fn(&CourseOutlook) -> f64| [&a.here, &a.best].map(|c| f(c) as f32);
        CourseAdvice {
            heading: pair(|c| c.heading_rad),
            speed: pair(|c| c.speed_mps),
            likelihood: pair(|c| c.likelihood),
            tilt: pair(CourseOutlook::tilt_rad),
            turn_s: a.turn_s() as f32,
            way_lost_m: a.way_lost_m() as f32,
            waves_to: a.waves_to_rad as f32,
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
struct Conditions {
    /// Heading, rad, and speed along it, m/s.
    heading_rad: f64,
    speed_mps: f64,
    heel: [f64; 2],
    /// Fractions of the deck's heave and tilt that are not predicted one reaction time ahead.
    unforeseen: [f64; 2],
    /// True wind towards NED, m/s.
    wind: Vector2<f64>,
    /// Steepest apparent slope in each window of the last two minutes, newest first, as sent to the drone.
    steepest: Vec<f64>,
}

#[derive(Clone, Debug)]
struct Round {
    now: Conditions,
    courses: Vec<[f64; 2]>,
    outlooks: Vec<CourseOutlook>,
}

#[derive(Clone, Copy, Debug)]
pub struct Underway<'a> {
    pub motion: &'a MotionModel<VesselClock>,
    /// Mean velocity, NED, m/s.
    pub velocity: Vector2<f64>,
    /// Mean heading, rad.
    pub heading: f64,
    /// Rate of the mean heading, rad/s.
    pub heading_rate: f64,
    /// True wind reported by a drone, towards NED, m/s.
    pub wind: Option<Vector2<f64>>,
    /// Steepest apparent slopes, newest first, in steps of [`SLOPE_STEP`].
    pub slopes: Seq<u8, SLOPE_WINDOWS>,
}

/// Searches for the course with the highest probability of a landing.
#[derive(Clone, Debug)]
pub struct Advisor {
    hull: HullModel,
    deck: DeckGeometry,
    drone: DroneGeometry,
    limits: AdviceConfig,
    spectrum: WaveSpectrum,
    newest: Option<VesselTime>,
    stepped: Option<VesselTime>,
    sea: Option<(VesselTime, EstimatedSea)>,
    round: Option<Round>,
    begun: Option<VesselTime>,
    outlooks: Vec<CourseOutlook>,
}

impl Advisor {
    /// Advisor for the hull of this vessel model, with a drone of usual size on its deck, within the skipper's limits.
    pub fn new(model: &VesselModelConfig, deck: &DeckGeometry, limits: &AdviceConfig) -> Advisor {
        Advisor {
            hull: HullModel::of(model),
            deck: *deck,
            drone: DroneGeometry::default(),
            limits: limits.clone(),
            spectrum: WaveSpectrum::new(deck.centre()),
            newest: None,
            stepped: None,
            sea: None,
            round: None,
            begun: None,
            outlooks: Vec::new(),
        }
    }

    /// All courses of the last round, the present one first; empty before a sea is estimated.
    pub fn outlooks(&self) -> &[CourseOutlook] {
        &self.outlooks
    }
    /// Direction in which the waves propagate, rad; None while unknown.
    pub fn waves_to_rad(&self) -> Option<f64> {
        self.sea.as_ref().map(|(_, sea)| sea.towards)
    }
    /// Best course within the skipper's limits that is reached within half a minute; None while no sea is known.
    pub fn advice(&self) -> Option<Advice> {
        let here = *self.outlooks.first()?;
        let permitted = |c: &CourseOutlook| {
            self.limits
                .permits([c.heading_rad, c.speed_mps], here.heading_rad)
        };
        let in_reach = |c: &&CourseOutlook| c.time_from_s(&here) <= MAX_TURN_S && permitted(c);
        let worth_more = |best: CourseOutlook, c: &CourseOutlook| {
            if c.worth(&here) > best.worth(&here) {
                *c
            } else {
                best
            }
        };
        Some(Advice {
            here,
            best: self.outlooks.iter().filter(in_reach).fold(here, worth_more),
            waves_to_rad: self.waves_to_rad()?,
        })
    }

    /// Adds the newest motion sample, and evaluates one course of a pending round.
    pub fn step(&mut self, now: VesselTime, underway: &Underway<'_>) {
        self.resume(now);
        if let Some(sample) = underway.motion.newest() {
            self.observe(sample, underway.velocity);
        }
        let due = self.begun.is_none_or(|t| now - t >= Span::from_secs(PERIOD_S));
        match &mut self.round {
            Some(_) => self.evaluate(),
            None if due => self.begin(now, underway),
            None => {}
        }
    }

    /// Restarts after a gap in the samples, during which course and wind may have changed.
    fn resume(&mut self, now: VesselTime) {
        if self.stepped.is_some_and(|t| now - t > Span::from_secs(PERIOD_S)) {
            self.round = None;
            self.begun = None;
            self.outlooks.clear();
        }
        self.stepped = Some(now);
    }
    fn observe(&mut self, sample: &MotionSample<VesselClock>, velocity: Vector2<f64>) {
        if self.newest.is_some_and(|at| at >= sample.at) {
            return;
        }
        self.newest = Some(sample.at);
        if self.spectrum.push(*sample, velocity)
            && let Some(sea) = self.spectrum.sea(&self.hull)
        {
            self.sea = Some((sample.at, sea));
        }
    }

    fn begin(&mut self, now: VesselTime, underway: &Underway<'_>) {
        self.begun = Some(now);
        let old = |at: VesselTime| now - at > Span::from_secs(MAX_SEA_AGE_S);
        self.sea = self.sea.take().filter(|(at, _)| !old(*at));
        if self.sea.is_none() || underway.heading_rate.abs() > TURNING_RADPS {
            self.outlooks.clear();
            return;
        }
        let now = Conditions::of(underway);
        self.round = Some(Round {
            courses: courses(now.heading_rad, now.speed_mps),
            outlooks: Vec::new(),
            now,
        });
    }

    /// Evaluates the next course; the last one of a round publishes the results.
    fn evaluate(&mut self) {
        let (Some(mut round), Some((_, sea))) = (self.round.take(), &self.sea) else {
            return;
        };
        if let Some([heading, speed]) = round.courses.get(round.outlooks.len()).copied() {
            let powers = sea.powers(&self.hull, &self.deck.centre(), heading, speed);
            let here = round.outlooks.first().map(|c| c.slope_sd);
            let outlook = self.outlook(&round.now, here, [heading, speed], &powers);
            round.outlooks.push(outlook);
            self.round = Some(round);
        } else {
            self.outlooks = round.outlooks;
        }
    }

    /// Outlook for a course with these powers of the deck's signals. `here` is the modelled standard
    /// deviation of the apparent slope on the present course, by which the measured slopes are scaled.
    fn outlook(
        &self,
        now: &Conditions,
        here: Option<f64>,
        [heading_rad, speed_mps]: [f64; 2],
        powers: &Powers,
    ) -> CourseOutlook {
        let sd = |f: usize| powers[f].sqrt();
        let both = |[a, b]: [usize; 2]| sd(a).hypot(sd(b));
        let mut course = CourseOutlook {
            heading_rad,
            speed_mps,
            tilt_sd_rad: TILT.map(sd),
            heave_rate_sd_mps: sd(SINK),
            slope_sd: both(SLOPE),
            likelihood: 0.0,
        };
        let turn = Rotation2::new(heading_rad);
        let wind = WindPush::over(now.wind, turn * Vector2::new(speed_mps, 0.0));
        let [roll, pitch] = now.heel;
        // On a deck that lists to starboard the specific force points to port.
        let list = turn * Vector2::new(pitch, -roll);
        let ratio = here.filter(|s| *s > 0.0).map_or(1.0, |s| course.slope_sd / s);
        let steepest = now.steepest.iter().map(|s| s * ratio);
        let support = SupportPolygon::on(&self.deck, &self.drone, FRICTION);
        let [of_heave, of_tilt] = now.unforeseen;
        let one_axis = core::f64::consts::FRAC_1_SQRT_2;
        let blown = wind_during_alignment(&wind.mean).norm();
        let staying = Staying::of(&Slopes::in_sea(steepest, list, &wind), &support);
        let contact = Contact {
            speed_mps: CONTACT_MPS,
            turn_mps: 0.0,
            left_mps: 0.0,
            unforeseen_mps: [
                REACTION_S * of_tilt * one_axis * sd(PUSH),
                REACTION_S * of_heave * sd(LIFT),
            ],
            parted_mps: alignment_mps((GRAVITY * course.slope_sd).hypot(blown)),
            tilt_sd_rad: of_tilt * one_axis * course.tilt_rad(),
            offset_m: turn.inverse() * staying.meets,
            place_sd_m: PLACE_SD_M,
            blind_s: BLIND_S,
            wind,
            wind_at_contact: wind,
            stays: staying.probability,
        };
        // If the motion is not finite the probability is zero.
        if powers.iter().all(|p| p.is_finite()) {
            course.likelihood = contact.odds(&Margins::on(&self.deck, &self.drone)).whole();
        }
        course
    }
}

impl Conditions {
    fn of(underway: &Underway<'_>) -> Conditions {
        let motion = underway.motion;
        let spread = motion.spread(REACTION_S);
        let whole = motion.deviation();
        let part = |a: f64, b: f64| {
            let part = a / b;
            // Without motion there is nothing to predict.
            if part.is_finite() { part.min(1.0) } else { 1.0 }
        };
        let tilt = |d: &[f64; 6]| d[ROLL].hypot(d[PITCH]);
        let [about_north, about_east] = motion.heel(underway.heading);
        let body = Rotation2::new(-underway.heading) * Vector2::new(about_north, about_east);
        Conditions {
            heading_rad: underway.heading,
            speed_mps: waves::ahead(&underway.velocity, underway.heading).max(0.0),
            heel: body.into(),
            unforeseen: [
                part(spread[HEAVE], whole[HEAVE]),
                part(tilt(&spread), tilt(&whole)),
            ],
            wind: underway.wind.unwrap_or(NO_WIND),
            steepest: underway
                .slopes
                .iter()
                .map(|s| f64::from(*s) * SLOPE_STEP)
                .collect(),
        }
    }
}

/// Compared headings and speeds, present ones first: all headings at the present speed and at each slower one.
fn courses(heading: f64, speed_mps: f64) -> Vec<[f64; 2]> {
    let slower = (1..MAX_SPEEDS)
        .map(|k| SPEED_STEP_MPS * k as f64)
        .filter(|s| *s < speed_mps);
    let speeds = core::iter::once(speed_mps).chain(slower);
    let round = (0..HEADINGS).map(|k| wrap_angle(heading + HEADING_STEP_RAD * f64::from(k)));
    speeds
        .flat_map(|speed| round.clone().map(move |heading| [heading, speed]))
        .collect()
}

#[cfg(test)]
mod tests;
