//! Broadcast of the vessel: estimate, wave model, prediction.
//!
//! # Byte layout on the wire
//!
//! bincode 2, little endian, fixed-width integers, no padding (`alight_shared::wire`).
//!
//! | bytes | header (26 B, first in every message) |
//! |---|---|
//! | 0..8 | `at`: time of validity, i64 nanoseconds of the sender's clock |
//! | 8..12 | `boot` u32 |
//! | 12..16 | `sequence` u32 |
//! | 16..20 | `vessel` u32 |
//! | 20..24 | `drone` u32, 0 for any |
//! | 24..26 | `version` u16 |
//!
//! Floating-point numbers are IEEE 754, with 16 bits (11 bits of precision) where three digits suffice.
//!
//! Estimate and wave model travel in the forms of [`super::EstimateUpdate`] and [`super::WaveUpdate`].
//!
//! | bytes | prediction (62 + 54 n B, n <= 16 stages, 1 Hz, bound 1200 B) |
//! |---|---|
//! | 26..30 | time between stages, s (f32) |
//! | 30..54 | origin in the vessel's NED, m (3 x f64) |
//! | 54..62 | n (u64) |
//! | + 0..24 | `eta`, position relative to the origin (6 x f32) |
//! | + 24..36 | `eta_dot` (6 x f16) |
//! | + 36..48 | standard deviation added by propagating the modes (6 x f16) |
//! | + 48..54 | standard deviation of the whole course: position, heading (3 x f16) |

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Header, MAX_ANGLE_RAD, MAX_POSITION_M, MAX_RATE_RPS, MAX_SPEED_MPS, MAX_TILT_RAD, Seq, f16, within,
};
use crate::{
    frames::wrap_angle,
    geodesy::Datum,
    schema::F16,
    surroundings::Surroundings,
    time::{Clock, Time, VesselTime},
    vessel_model::{SURGE, SWAY, YAW},
};

/// Maximum number of modes in a wave model.
pub const MAX_MODES: usize = 24;
/// Number of time windows in [`WaveModel::slopes`].
pub const SLOPE_WINDOWS: usize = 60;
/// Length of each window, s; together two minutes.
pub const SLOPE_WINDOW_S: f64 = 2.0;
/// Resolution of a slope; the largest value also stands for steeper ones.
pub const SLOPE_STEP: f64 = 0.01;
/// Number of stages of the vessel's prediction.
pub const PREDICTION_STAGES: usize = 16;

/// The vessel's 6-DOF state. Order of the degrees of freedom: surge/north, sway/east, heave/down, roll, pitch, yaw.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct VesselEstimate<C: Clock> {
    /// Identity and time of validity.
    pub header: Header<C>,
    /// Origin of the vessel's NED plane.
    pub datum: Datum,
    /// `eta`: position of the reference point in the vessel's NED (m), then roll, pitch, yaw (rad).
    pub eta: [f64; 6],
    /// `eta_dot`: velocity in NED (m/s), then Euler-angle rates (rad/s).
    pub eta_dot: [f32; 6],
    /// `eta_ddot`: acceleration in NED (m/s²), then Euler-angle accelerations (rad/s²).
    #[schemars(with = "[F16; 6]")]
    pub eta_ddot: [f16; 6],
    /// Per degree of freedom: standard deviation of eta, standard deviation of eta_dot, their correlation.
    #[schemars(with = "[[F16; 3]; 6]")]
    pub uncertainty: [[f16; 3]; 6],
    /// Centre of the landing deck's surface in the vessel's body frame, m.
    pub deck_centre: [f32; 3],
    /// Mean velocity over ground without the waves' orbital motion: north, east, m/s.
    pub mean_velocity: [f32; 2],
    /// Mean heading without wave motion, rad, and its rate, rad/s.
    pub mean_heading: [f32; 2],
}

/// Mode of the vessel's motion (`alight_shared::vessel_model`): a damped oscillator common to all degrees of
/// freedom (Fossen 2011, section 8.2.6; Procházka 2024, eq. 3).
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct WaveMode {
    /// Real part (not positive) and imaginary part of the pole, 1/s.
    pub pole: [f32; 2],
    /// Real and imaginary part of the shape: velocity north and east (m/s), heave (m down), tilt about north
    /// and east (rad), heading (rad).
    #[schemars(with = "[[F16; 2]; 6]")]
    pub shape: [[f16; 2]; 6],
}

/// Advice for the helm: the course with the highest probability of a landing. Each pair holds the value for
/// the present and for the advised course; both are equal if no other course is worth its cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct CourseAdvice {
    /// Headings, rad.
    pub heading: [f32; 2],
    /// Speeds, m/s.
    pub speed: [f32; 2],
    /// Probabilities of success of a landing begun at a random moment.
    pub likelihood: [f32; 2],
    /// Standard deviations of the deck's tilt, rad.
    pub tilt: [f32; 2],
    /// Time to reach the advised course, s.
    pub turn_s: f32,
    /// Distance that the advised course loses per minute, m.
    pub way_lost_m: f32,
    /// Direction in which the waves propagate, rad.
    pub waves_to: f32,
}

impl CourseAdvice {
    /// Whether a course other than the present one is advised.
    pub fn is_change(&self) -> bool {
        self.heading[0] != self.heading[1] || self.speed[0] != self.speed[1]
    }
    /// Whether all values are within their bounds.
    pub(super) fn is_sane(&self) -> bool {
        within(&self.heading, MAX_ANGLE_RAD)
            && within(&self.speed, MAX_SPEED_MPS)
            && self.likelihood.iter().all(|p| (0.0..=1.0).contains(p))
            && within(&self.tilt, 10.0)
            && (0.0..=3600.0).contains(&self.turn_s)
            && within([&self.way_lost_m], 1e5)
            && within([&self.waves_to], MAX_ANGLE_RAD)
    }
}

/// The vessel's wave model, which propagates its estimate.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct WaveModel<C: Clock> {
    /// Identity and time of validity of the oscillator states.
    pub header: Header<C>,
    /// Significant wave height from the vessel's heave, m.
    pub significant_height_m: f32,
    /// Fraction of the motion's variance that the modes predict one second ahead, 0 to 1; 0 in calm water.
    pub confidence: f32,
    /// Modes, strongest first, whose real parts add up to the motion about its mean; empty until identified.
    pub modes: Seq<WaveMode, MAX_MODES>,
    /// Steepest apparent slope of the deck in each window of [`SLOPE_WINDOW_S`], newest first, in steps of
    /// [`SLOPE_STEP`]: `|f_xy| / |f_z|` of the specific force in the deck's axes, averaged over one second. A
    /// landed drone slides when it exceeds the coefficient of friction. Events beyond a sum of waves, such as
    /// a hull that leaves the water over a steep crest, recur.
    pub slopes: Seq<u8, SLOPE_WINDOWS>,
    /// Advice for the helm; None if no other course is worth its cost, or the wave directions are unknown.
    pub advice: Option<CourseAdvice>,
}

/// One stage of the vessel's prediction.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct PredictedStage {
    /// Position relative to `origin` in the vessel's NED (m), then roll, pitch, yaw (rad).
    pub eta: [f32; 6],
    /// Velocity in NED (m/s), then Euler-angle rates (rad/s).
    #[schemars(with = "[F16; 6]")]
    pub eta_dot: [f16; 6],
    /// Standard deviation added by propagating the modes to this stage, measured on past predictions:
    /// velocity north and east (m/s), heave (m), tilt about north and east (rad), heading (rad).
    #[schemars(with = "[F16; 6]")]
    pub sd: [f16; 6],
    /// Standard deviation of the whole course, mean and waves: position north and east (m), heading (rad).
    #[schemars(with = "[F16; 3]")]
    pub course_sd: [f16; 3],
}

/// The vessel's predicted trajectory.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct VesselPrediction<C: Clock> {
    /// Identity; `at` is the time of the first stage.
    pub header: Header<C>,
    /// Time between stages, s.
    pub step_s: f32,
    /// Origin of the stages' positions in the vessel's NED, m.
    pub origin: [f64; 3],
    /// Stages at intervals of `step_s`.
    pub stages: Seq<PredictedStage, PREDICTION_STAGES>,
}

/// Obstacles around the vessel's deck.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct VesselSurroundings<C: Clock> {
    /// Identity.
    pub header: Header<C>,
    /// Volumes and directions relative to the deck's centre.
    pub surroundings: Surroundings,
}

/// Time request of a drone to the vessel.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct TimeRequest<C: Clock> {
    /// Identity; `at` is the drone's time of sending (t1).
    pub header: Header<C>,
    /// Time of validity of the newest estimate admitted by the drone; it shows the vessel the state of the link.
    pub newest_at: VesselTime,
    /// Boot of that estimate's sender; 0 before the first.
    pub newest_boot: u32,
}

/// Time reply of the vessel with the time stamps of Mills' on-wire protocol (RFC 5905, section 8).
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct TimeReply<V: Clock, D: Clock> {
    /// Identity; `at` is the vessel's time of sending (t3).
    pub header: Header<V>,
    /// Time of sending of the request on the drone's clock (t1).
    pub requested_at: Time<D>,
    /// Time of arrival of the request on the vessel's clock (t2).
    pub received_at: Time<V>,
}

restamped!(VesselEstimate {
    datum,
    eta,
    eta_dot,
    eta_ddot,
    uncertainty,
    deck_centre,
    mean_velocity,
    mean_heading
});
restamped!(WaveModel {
    significant_height_m,
    confidence,
    modes,
    slopes,
    advice
});
restamped!(VesselPrediction {
    step_s,
    origin,
    stages
});

restamped!(VesselSurroundings { surroundings });

impl<C: Clock> VesselEstimate<C> {
    /// Position of the reference point in the vessel's NED, m.
    pub fn position(&self) -> Vector3<f64> {
        Vector3::new(self.eta[0], self.eta[1], self.eta[2])
    }
    /// Covariance of (eta, eta_dot) of a degree of freedom: var eta, cov, var eta_dot.
    pub fn covariance(&self, dof: usize) -> [f64; 3] {
        let [value, rate, correlation] = self
            .uncertainty
            .get(dof)
            .copied()
            .unwrap_or_default()
            .map(f64::from);
        [value * value, correlation * value * rate, rate * rate]
    }
    /// Deck centre in the body frame, m.
    pub fn deck_centre(&self) -> Vector3<f64> {
        Vector3::from(self.deck_centre.map(f64::from))
    }
}
impl<C: Clock> VesselPrediction<C> {
    /// Predicted `eta` in the vessel's NED `ahead_s` after the first stage, and standard deviations of its
    /// error, by cubic interpolation of value and rate. None beyond the last stage.
    pub fn at(&self, ahead_s: f64) -> Option<([f64; 6], [f64; 6])> {
        let h = f64::from(self.step_s);
        let x = ahead_s / h;
        let i = x.floor() as usize;
        let f = x.fract();
        let a = self.stages.get(i)?;
        let b = self.stages.get(i + 1).unwrap_or(a);
        let f2 = f * f;
        let f3 = f * f * f;
        let eta = core::array::from_fn(|dof| {
            let pa = f64::from(a.eta[dof]);
            let pb = f64::from(b.eta[dof]);
            let va = f64::from(a.eta_dot[dof]);
            let vb = f64::from(b.eta_dot[dof]);
            let step = if dof < 3 { pb - pa } else { wrap_angle(pb - pa) };
            let origin = self.origin.get(dof).copied().unwrap_or(0.0);
            origin + pa + (3.0 * f2 - 2.0 * f3) * step + ((f3 - 2.0 * f2 + f) * va + (f3 - f2) * vb) * h
        });
        let sd_of = |s: &PredictedStage, d: usize| {
            let [north, east, heading] = s.course_sd;
            f64::from(match d {
                SURGE => north,
                SWAY => east,
                YAW => heading,
                _ => s.sd[d],
            })
        };
        let sd = core::array::from_fn(|d| sd_of(a, d) + f * (sd_of(b, d) - sd_of(a, d)));
        Some((eta, sd))
    }
}

pub(super) fn are_uncertainties(all: &[[f16; 3]]) -> bool {
    all.iter()
        .all(|[value, rate, correlation]| are_deviations(&[*value, *rate]) && within([correlation], 1.001))
}
pub(super) fn are_modes(modes: &[WaveMode]) -> bool {
    modes.iter().all(|c| {
        let [decay, turn] = &c.pole;
        (-1e3..=0.0).contains(decay) && (-40.0..=40.0).contains(turn) && within(c.shape.iter().flatten(), 1e4)
    })
}
fn are_deviations(values: &[f16]) -> bool {
    values.iter().all(|v| (0.0..=1e4).contains(&f32::from(*v)))
}

message!(@C VesselEstimate<C>, C, |m| {
    within(&m.eta[..3], MAX_POSITION_M)
        && within(&m.eta[3..5], MAX_TILT_RAD)
        && within(&m.eta[5..], MAX_ANGLE_RAD) => "eta",
    within(&m.eta_dot[..3], MAX_SPEED_MPS)
        && within(&m.eta_dot[3..], MAX_RATE_RPS) => "eta_dot",
    within(&m.eta_ddot, 200.0) => "eta_ddot",
    are_uncertainties(&m.uncertainty) => "uncertainty",
    within(&m.deck_centre, 100.0) => "deck_centre",
    within(&m.mean_velocity, MAX_SPEED_MPS) && within(&m.mean_heading, 50.0) => "mean motion",
    m.datum.is_on_earth() => "datum",
});
message!(@C WaveModel<C>, C, |m| {
    (0.0..=50.0).contains(&m.significant_height_m) => "significant_height_m",
    (0.0..=1.0).contains(&m.confidence) => "confidence",
    are_modes(&m.modes) => "modes",
    m.advice.is_none_or(|a| a.is_sane()) => "advice",
});
message!(@C VesselSurroundings<C>, C, |m| {
    m.surroundings.is_sound() => "surroundings",
});
message!(@C VesselPrediction<C>, C, |m| {
    (0.001..=10.0).contains(&m.step_s) => "step_s",
    within(&m.origin, MAX_POSITION_M) => "origin",
    m.stages.iter().all(|s| {
        within(&s.eta, 1e4)
            && within(&s.eta_dot, 1e3)
            && are_deviations(&s.sd)
    }) => "stages",
});
