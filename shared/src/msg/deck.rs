//! The deck as observed by the drone: detections, link and forecast.

use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Header, MAX_ACCELERATION_MPS2, MAX_ANGLE_RAD, MAX_POSITION_M, MAX_RATE_RPS, MAX_SPEED_MPS, Reason,
    ReasonCode, RelativeState, SLOPE_WINDOWS, Seq, VesselLevel, deviations, drone::is_unit, positive, within,
};
use crate::{
    surroundings::Surroundings,
    time::{DroneClock, DroneTime, Span},
};

/// Number of stages of a deck forecast.
pub const FORECAST_STAGES: usize = 41;

/// Number of stages of [`DeckForecast::predicted_slopes`].
pub const PREDICTED_SLOPES: usize = 48;
/// Interval between stages of [`DeckForecast::predicted_slopes`], s; they cover 12 s.
pub const PREDICTED_SLOPE_STEP_S: f64 = 0.25;

/// 6-DOF detection of the deck from the fiducial tags in one image.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct TagPose {
    /// Identity; `at` is the time of exposure.
    pub header: Header<DroneClock>,
    /// Deck's centre in the camera frame, m.
    pub position: [f64; 3],
    /// Rotation of the deck relative to the camera, unit quaternion (w, x, y, z).
    pub attitude: [f64; 4],
    /// Variances: position x, y, z (m²) and rotation about the camera's x, y, z (rad²).
    pub variance: [f64; 6],
}

/// Detection of the deck's blinking UV markers: less accurate than tags, at longer range.
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

/// Brightness of the belly camera's newest image.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct CameraLight {
    /// Identity; `at` is the time of exposure.
    pub header: Header<DroneClock>,
    /// Mean grey level of the image, 0 to 255.
    pub mean: f64,
    /// Exposure, s; None: not set by the drone.
    pub exposure_s: Option<f64>,
    /// The image is too dark to decode a tag. Exposure and gain are at their limits if the drone sets them.
    pub dark: bool,
    /// Saturated fraction of the image, 0 to 1, if above [`MIN_GLARE`] without a decoded tag; otherwise None.
    pub glare: Option<f64>,
}

/// Saturated fraction of the image, 0 to 1, above which a light blinds the camera. In rendered daylight,
/// glints on water or a wet deck saturate 0.1 %.
pub const MIN_GLARE: f64 = 0.003;

impl CameraLight {
    /// Reason why lighting hides the tags, if it does.
    pub fn hides_tags(&self) -> Option<Reason> {
        let dark = Reason::new(ReasonCode::TooDark, self.mean, self.exposure_s.unwrap_or(0.0));
        let glare = |part: f64| Reason::new(ReasonCode::Glare, 100.0 * part, 100.0 * MIN_GLARE);
        self.dark.then_some(dark).or(self.glare.map(glare))
    }
}

/// Measurement of the belly rangefinder.
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

/// State of the link and of the clocks, as measured by the bridge.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct LinkState {
    /// Identity.
    pub header: Header<DroneClock>,
    /// Drone clock minus vessel clock, s.
    pub clock_offset_s: f64,
    /// Standard deviation of the offset including path asymmetry, s; infinite until known.
    pub clock_offset_sd_s: f64,
    /// Age of the newest admitted vessel estimate, s.
    pub age_s: f64,
    /// Fraction of vessel estimates lost during the last seconds.
    pub loss: f64,
    /// Fraction of vessel estimates that arrived after a newer one and were discarded.
    pub out_of_order: f64,
    /// Median latency of vessel estimates, s.
    pub latency_p50_s: f64,
    /// 99th percentile of the latency, s.
    pub latency_p99_s: f64,
    /// Vessel messages rejected since the start.
    pub rejected: u32,
    /// Boot of a second computer with the vessel's identity, received in addition to the one in use.
    pub second_sender: Option<u32>,
}

/// Information source of the forecast.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum Source {
    /// No information yet.
    #[default]
    None,
    /// Vessel messages only.
    Radio,
    /// The drone's own vision only.
    Vision,
    /// Vessel messages and vision.
    Both,
}

/// State of the deck at one time of the forecast, in the drone's NED.
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
    /// Upward unit normal of the deck in NED; its third component is negative on a level deck.
    pub fn normal(&self) -> Vector3<f64> {
        let [r, p, y] = self.euler;
        let q = nalgebra::UnitQuaternion::from_euler_angles(r, p, y);
        q * -Vector3::z()
    }
    /// Height of `point` (NED, m) above the deck plane along its normal, m.
    pub fn height_of(&self, point: &Vector3<f64>) -> f64 {
        (point - Vector3::from(self.position)).dot(&self.normal())
    }
    /// Velocity (NED, m/s) away from the deck along its normal, m/s.
    pub fn speed_away(&self, velocity: &Vector3<f64>) -> f64 {
        (velocity - Vector3::from(self.velocity)).dot(&self.normal())
    }
    /// Rotation from the deck frame to NED.
    pub fn rotation(&self) -> Matrix3<f64> {
        let [r, p, y] = self.euler;
        nalgebra::Rotation3::from_euler_angles(r, p, y).into_inner()
    }
    /// Linear blend `(1 - s) self + s other`; angles take the shorter way.
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

/// Predicted motion of the deck, in the drone's NED and on the drone's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DeckForecast {
    /// Identity; `at` is the time of the first stage, close to the present.
    pub header: Header<DroneClock>,
    /// Time between stages.
    pub step: Span,
    /// Present information source.
    pub source: Source,
    /// Age of the newest vessel estimate used, s; infinite before the first.
    pub radio_age_s: f64,
    /// Age of the newest vision measurement (tag or UVDAR) used, s; infinite before the first.
    pub vision_age_s: f64,
    /// Age of the newest tag detection used, s; infinite before the first.
    pub tag_age_s: f64,
    /// Beacon in use: standard deviation of its predicted position on each horizontal axis, m, and its age, s.
    pub beacon: Option<[f64; 2]>,
    /// Relative position by moving base, if a receiver measures it.
    pub relative: Option<RelativeState>,
    /// Number of decks in view with these tags while the drone's own is not identified; otherwise 0.
    pub decks_in_sight: u32,
    /// Consistency of the deck's height by rangefinder and by camera: normalised innovation squared, averaged
    /// over 3 s, as a recent maximum. About 1 if both match their stated errors; None without both.
    pub height_nis: Option<f64>,
    /// Horizontal distance between the deck's positions by vision and by radio, and its bound, m; None if not detected.
    pub place_apart_m: Option<[f64; 2]>,
    /// Confidence in the wave model, 0 (broad default, or calm water) to 1.
    pub wave_confidence: f64,
    /// Mean heading of the deck without wave motion, rad.
    pub mean_heading: f64,
    /// Rate of the mean heading, rad/s.
    pub mean_heading_rate: f64,
    /// Mean level of the deck, drone's NED z, m: low-pass of the mean height; None before the first stage.
    pub mean_z: Option<f64>,
    /// Stages at intervals of `step`.
    pub stages: Seq<DeckStage, FORECAST_STAGES>,
    /// Apparent slopes of the deck over the last two minutes, from the vessel ([`super::WaveModel::slopes`]);
    /// empty without recent data.
    pub slopes: Seq<u8, SLOPE_WINDOWS>,
    /// Obstacles around the deck, in the vessel's newest report.
    pub surroundings: Surroundings,
    /// Predicted apparent slope for a drone on the deck, north and east, every [`PREDICTED_SLOPE_STEP_S`], in
    /// steps of [`super::SLOPE_STEP`], along the force of the deck on the drone. Empty until the vessel has
    /// identified its motion.
    pub predicted_slopes: Seq<[i8; 2], PREDICTED_SLOPES>,
}

/// Radio silence after which the vessel is located by its tags alone, s. Until then its modes are propagated.
pub const SILENT_S: f64 = 5.0;

impl DeckForecast {
    /// Source from which the vessel's position is known at present.
    pub fn vessel_level(&self) -> VesselLevel {
        match self.beacon {
            _ if self.radio_age_s <= SILENT_S => VesselLevel::Computer,
            // A recent vision measurement is more accurate than the beacon.
            Some(_) if self.vision_age_s > SILENT_S => VesselLevel::Beacon,
            Some(_) | None => VesselLevel::Tag,
        }
    }
    /// State of the deck at time `t`, interpolated linearly; None outside the stages.
    pub fn at(&self, t: DroneTime) -> Option<DeckStage> {
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
    // Offset spread and age are infinite before the first exchange.
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
