//! The deck as the drone knows it: detections, link, forecast.

use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::drone::is_unit;
use super::{
    Header, MAX_ACCELERATION_MPS2, MAX_ANGLE_RAD, MAX_POSITION_M, MAX_RATE_RPS, MAX_SPEED_MPS, Reason,
    ReasonCode, RelativeState, SLOPE_WINDOWS, Seq, VesselLevel, deviations, positive, within,
};
use crate::surroundings::Surroundings;
use crate::time::{DroneClock, Span};

/// Stages of a deck forecast.
pub const FORECAST_STAGES: usize = 41;

/// Stages of [`DeckForecast::predicted_slopes`].
pub const PREDICTED_SLOPES: usize = 48;
/// Time between two of them, s; together twelve seconds.
pub const PREDICTED_SLOPE_STEP_S: f64 = 0.25;

/// A 6-DOF detection of the deck by those of its fiducial tags that an image shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct TagPose {
    /// Identity; `at` is the time of exposure.
    pub header: Header<DroneClock>,
    /// Deck's centre in the camera frame, m.
    pub position: [f64; 3],
    /// Rotation camera from deck, unit quaternion (w, x, y, z).
    pub attitude: [f64; 4],
    /// Variances: position x, y, z (m²) and rotation about the camera's x, y, z (rad²).
    pub variance: [f64; 6],
}

/// A detection of the deck's blinking UV markers: coarser, from further away.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct UvdarFix {
    /// Identity; `at` is the time of exposure.
    pub header: Header<DroneClock>,
    /// Deck's centre in the camera frame, m.
    pub position: [f64; 3],
    /// Variances of the position in the camera frame, m².
    pub variance: [f64; 3],
}

/// The light in the belly camera's newest image.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct CameraLight {
    /// Identity; `at` is the time of exposure.
    pub header: Header<DroneClock>,
    /// Mean of the image, grey levels of 255.
    pub mean: f64,
    /// Exposure, s; None where the drone does not set it.
    pub exposure_s: Option<f64>,
    /// No tag can be decoded in it: nothing is bright enough, and exposure and gain, where they are the drone's, are at their
    /// limits.
    pub dark: bool,
    /// A light blinds the camera: the part of the image that is at its brightest, 0 to 1, where no tag is decoded and it is more
    /// than [`MIN_GLARE`]; else None.
    pub glare: Option<f64>,
}

/// A part of the image, 0 to 1, that glints on water or a wet deck do not bring to the limit: 0.1 % by day in rendered images.
pub const MIN_GLARE: f64 = 0.003;

impl CameraLight {
    /// Why a camera in this light detects no tag, where it is the light.
    pub fn hides_tags(&self) -> Option<Reason> {
        let dark = Reason::new(ReasonCode::TooDark, self.mean, self.exposure_s.unwrap_or(0.0));
        let glare = |part: f64| Reason::new(ReasonCode::Glare, 100.0 * part, 100.0 * MIN_GLARE);
        self.dark.then_some(dark).or(self.glare.map(glare))
    }
}

/// A reading of the belly rangefinder.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct RangeSample {
    /// Identity; `at` is the time of measurement.
    pub header: Header<DroneClock>,
    /// Distance along the body's down axis, m.
    pub range_m: f64,
    /// Variance, m².
    pub variance: f64,
}

/// State of the link and of the clocks, as the bridge has it.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct LinkState {
    /// Identity.
    pub header: Header<DroneClock>,
    /// Drone clock minus vessel clock, s.
    pub clock_offset_s: f64,
    /// Standard deviation of the offset, path asymmetry included, s; infinite until known.
    pub clock_offset_sd_s: f64,
    /// Age of the newest admitted vessel estimate, s.
    pub age_s: f64,
    /// Fraction of vessel estimates lost over the last seconds.
    pub loss: f64,
    /// Fraction of them that came after a newer one, and were not used.
    pub out_of_order: f64,
    /// Median latency of vessel estimates, s.
    pub latency_p50_s: f64,
    /// 99th percentile of the latency, s.
    pub latency_p99_s: f64,
    /// Vessel messages rejected since start.
    pub rejected: u32,
    /// Boot of a second computer with the vessel's identity that is received in addition to the one in use.
    pub second_sender: Option<u32>,
}

/// Source of the forecast's knowledge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum Source {
    /// Nothing yet.
    #[default]
    None,
    /// The vessel's messages only.
    Radio,
    /// The drone's own vision only.
    Vision,
    /// Both.
    Both,
}

/// The deck at one instant of the forecast, in the drone's NED.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DeckStage {
    /// Deck centre, m.
    pub position: [f64; 3],
    /// Velocity of the deck, m/s.
    pub velocity: [f64; 3],
    /// Acceleration of the deck, m/s².
    pub acceleration: [f64; 3],
    /// Roll, pitch, yaw of the deck (ZYX), rad.
    pub euler: [f64; 3],
    /// Euler-angle rates, rad/s.
    pub euler_rates: [f64; 3],
    /// Standard deviations of `position`, m.
    pub position_sd: [f64; 3],
    /// Standard deviations of `velocity`, m/s.
    pub velocity_sd: [f64; 3],
    /// Standard deviations of `acceleration`, m/s².
    pub acceleration_sd: [f64; 3],
    /// Standard deviations of `euler`, rad.
    pub euler_sd: [f64; 3],
    /// Standard deviations of `euler_rates`, rad/s.
    pub euler_rates_sd: [f64; 3],
}

impl DeckStage {
    /// Upward unit normal of the deck in NED (its third component is negative on a level deck).
    pub fn normal(&self) -> Vector3<f64> {
        let [r, p, y] = self.euler;
        let q = nalgebra::UnitQuaternion::from_euler_angles(r, p, y);
        q * -Vector3::z()
    }
    /// Height of `point` (NED, m) over the deck's plane, along its normal, m.
    pub fn height_of(&self, point: &Vector3<f64>) -> f64 {
        (point - Vector3::from(self.position)).dot(&self.normal())
    }
    /// Speed of `velocity` (NED, m/s) away from the deck, along its normal, m/s.
    pub fn speed_away(&self, velocity: &Vector3<f64>) -> f64 {
        (velocity - Vector3::from(self.velocity)).dot(&self.normal())
    }
    /// Rotation matrix NED from deck.
    pub fn rotation(&self) -> Matrix3<f64> {
        let [r, p, y] = self.euler;
        nalgebra::Rotation3::from_euler_angles(r, p, y).into_inner()
    }
    /// Linear blend `(1 - s) self + s other`; angles along the shorter way.
    pub fn blend(&self, other: &DeckStage, s: f64) -> DeckStage {
        let mix = |a: [f64; 3], b: [f64; 3]| core::array::from_fn(|i| a[i] + s * (b[i] - a[i]));
        let turn = |a: [f64; 3], b: [f64; 3]| {
            core::array::from_fn(|i| a[i] + s * crate::frames::wrap_angle(b[i] - a[i]))
        };
        DeckStage {
            position: mix(self.position, other.position),
            velocity: mix(self.velocity, other.velocity),
            acceleration: mix(self.acceleration, other.acceleration),
            euler: turn(self.euler, other.euler),
            euler_rates: mix(self.euler_rates, other.euler_rates),
            position_sd: mix(self.position_sd, other.position_sd),
            velocity_sd: mix(self.velocity_sd, other.velocity_sd),
            acceleration_sd: mix(self.acceleration_sd, other.acceleration_sd),
            euler_sd: mix(self.euler_sd, other.euler_sd),
            euler_rates_sd: mix(self.euler_rates_sd, other.euler_rates_sd),
        }
    }
}

/// The deck's predicted motion, in the drone's NED and on the drone's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DeckForecast {
    /// Identity; `at` is the time of the first stage (about now).
    pub header: Header<DroneClock>,
    /// Time between stages.
    pub step: Span,
    /// Present source of the knowledge.
    pub source: Source,
    /// Age of the newest vessel estimate that was used, s; infinite when there was none.
    pub radio_age_s: f64,
    /// Age of the newest vision measurement (tag or UVDAR) that was used, s; infinite when there was none.
    pub vision_age_s: f64,
    /// Age of the newest tag detection that was used, s; infinite when there was none.
    pub tag_age_s: f64,
    /// The beacon that is known, if there is one: the standard deviation of its place now, each horizontal axis, m, and its age, s.
    pub beacon: Option<[f64; 2]>,
    /// The relative place by moving base, where a receiver measures it.
    pub relative: Option<RelativeState>,
    /// Decks with the tags of this one that are in sight while it is not known which is its own; 0: none, or it is known.
    pub decks_in_sight: u32,
    /// The deck's height by the rangefinder against the camera's: mean of the normalised innovation squared over 3 s, the largest
    /// of late, 1 where both err as they state; None while one of them is missing.
    pub height_nis: Option<f64>,
    /// The deck's place by vision less its place by radio, horizontal, and the most that it may be by the spread of both,
    /// m; None without a detection.
    pub place_apart_m: Option<[f64; 2]>,
    /// Confidence in the wave model, 0 (broad default, or a calm) to 1.
    pub wave_confidence: f64,
    /// The deck's mean heading without the waves' share, rad.
    pub mean_heading: f64,
    /// Rate of the mean heading, rad/s.
    pub mean_heading_rate: f64,
    /// The deck's mean level, drone's NED z, m: low-pass of its mean height over each forecast; None without a stage.
    pub mean_z: Option<f64>,
    /// The trajectory.
    pub stages: Seq<DeckStage, FORECAST_STAGES>,
    /// Apparent slope of the deck of late, as the vessel reported it ([`super::WaveModel::slopes`]); empty while
    /// nothing recent is known.
    pub slopes: Seq<u8, SLOPE_WINDOWS>,
    /// Obstacles around the deck, as the vessel reported it last.
    pub surroundings: Surroundings,
    /// The apparent slope that is predicted for a drone on the deck, towards north and east, every
    /// [`PREDICTED_SLOPE_STEP_S`] from now on, in steps of [`super::SLOPE_STEP`]: the direction in which the deck has to hold
    /// it. Empty while the vessel has not identified its motion.
    pub predicted_slopes: Seq<[i8; 2], PREDICTED_SLOPES>,
}

/// A vessel that was not received for so long is known by its tags alone, s: broadcast modes are rolled on until then.
pub const SILENT_S: f64 = 5.0;

impl DeckForecast {
    /// By what the vessel is known now.
    pub fn vessel_level(&self) -> VesselLevel {
        match self.beacon {
            _ if self.radio_age_s <= SILENT_S => VesselLevel::Computer,
            // Vision of a moment ago is the better measurement.
            Some(_) if self.vision_age_s > SILENT_S => VesselLevel::Beacon,
            Some(_) | None => VesselLevel::Tag,
        }
    }
    /// The deck at time `t`, by linear interpolation; None before the first or after the last
    /// stage, and while the forecast is empty.
    pub fn at(&self, t: crate::time::Time<DroneClock>) -> Option<DeckStage> {
        let step = self.step.secs();
        if !(step > 0.0) {
            return None;
        }
        let x = (t - self.header.at).secs() / step;
        let last = self.stages.len().checked_sub(1)? as f64;
        if !(-1e-6..=last + 1e-6).contains(&x) {
            return None;
        }
        let x = x.clamp(0.0, last);
        let i = (x.floor() as usize).min(self.stages.len().saturating_sub(2));
        let a = self.stages.get(i)?;
        match self.stages.get(i + 1) {
            Some(b) => Some(a.blend(b, x - i as f64)),
            None => Some(*a),
        }
    }
}

message!(TagPose, DroneClock, |m| {
    within(&m.position, 1e3) => "position",
    is_unit(&m.attitude) => "attitude",
    positive(&m.variance, 1e6) => "variance",
});
message!(UvdarFix, DroneClock, |m| {
    within(&m.position, 1e3) => "position",
    positive(&m.variance, 1e6) => "variance",
});
message!(CameraLight, DroneClock, |m| {
    (0.0..=255.0).contains(&m.mean) => "mean",
    m.exposure_s.is_none_or(|s| (0.0..=10.0).contains(&s)) => "exposure_s",
    m.glare.is_none_or(|part| (0.0..=1.0).contains(&part)) => "glare",
});
message!(RangeSample, DroneClock, |m| {
    (0.0..=1e3).contains(&m.range_m) => "range_m",
    positive([&m.variance], 1e6) => "variance",
});
message!(LinkState, DroneClock, |m| {
    // The offset's spread and the age are infinite before the first exchange.
    m.clock_offset_s.is_finite() && m.clock_offset_sd_s >= 0.0 => "clock_offset",
    m.age_s >= 0.0 && (0.0..=1.0).contains(&m.loss) => "statistics",
});
message!(DeckForecast, DroneClock, |m| {
    m.step > Span::ZERO => "step",
    m.surroundings.is_sound() => "surroundings",
    within([&m.mean_heading_rate], MAX_RATE_RPS) => "mean_heading_rate",
    m.mean_z.is_none_or(|z| within([&z], MAX_POSITION_M)) => "mean_z",
    m.height_nis.is_none_or(|n| n >= 0.0) => "height_nis",
    m.beacon.is_none_or(|b| b.iter().all(|v| (0.0..=MAX_POSITION_M).contains(v))) => "beacon",
    m.relative.is_none_or(|r| r.is_sound()) => "relative",
    m.place_apart_m.is_none_or(|a| within(&a, MAX_POSITION_M)) => "place_apart_m",
    m.stages.iter().all(|s| {
        within(&s.position, MAX_POSITION_M)
            && within(&s.velocity, MAX_SPEED_MPS)
            && within(&s.acceleration, MAX_ACCELERATION_MPS2)
            && within(&s.euler, MAX_ANGLE_RAD)
            && within(&s.euler_rates, MAX_RATE_RPS)
    }) => "stages",
    m.stages.iter().all(|s| {
        deviations([&s.position_sd, &s.velocity_sd, &s.acceleration_sd], f64::INFINITY)
            && deviations([&s.euler_sd, &s.euler_rates_sd], f64::INFINITY)
    }) => "standard deviations",
});
