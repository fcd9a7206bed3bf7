//! Position of the deck on the vessel, measured by a drone that stands on it.
//!
//! While the drone rests on the deck, its odometry (`p_d`, `R_d`) and the vessel's estimate (`p_v`, `R_v`) determine
//! the point `r` in the vessel's body frame on which its feet stand:
//!
//! ```text
//! p_d + R_d [0, 0, feet_below] = p_v + R_v r + b
//! ```
//!
//! `b` is the difference between the two GNSS receivers: a metre without corrections, centimetres with RTK, slowly
//! varying. `b` can be separated from `r` because the vessel's rocking within [`SLOW_S`] changes both sides but not `b`
//! ([`regression::regress`]), while the mean over time contains all of `b`. Both estimates are weighted by their
//! information. A tag detected from the deck gives the drone's position and the camera's rotation relative to the feet.

pub mod regression;
#[cfg(test)]
mod tests;

pub use alight_shared::estimation::ValueWithSd;
use alight_shared::{
    estimation::quantile,
    frames::body_from_camera,
    msg::{DroneState, Message, TagPose, VesselEstimate},
    time::{DroneClock, DroneTime},
    vessel_model::{PITCH, ROLL, YAW},
};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use thiserror::Error;

use crate::predictor::{PredictorConfig, PredictorIn, placement::placed, track::DroneTrack};
use regression::{Information, mean, regress};

/// Period above which changes are attributed to the receivers, s. Chosen: two periods of a 5 s sea.
const SLOW_S: f64 = 10.0;
/// Correlation time of the vessel estimate's errors, s. Chosen: one wave period.
const SHARED_S: f64 = 5.0;
/// Minimum RMS rocking that carries information, rad. Chosen: 0.3 deg moves a deck at 1.3 m by 7 mm.
const MIN_ROCKING_RAD: f64 = 0.005;
/// Error of the estimated sway in phase with the rocking, m. Chosen: over a minute of slight sea (seeds 1 to 8) the
/// rocking alone is wrong by 0.06 to 0.09 m; with 0.006 the stated error is 0.1 to 0.3 m.
const RHYTHM_M: f64 = 0.006;
/// Error of the estimated sway as a fraction of the stated error. Chosen: receivers without corrections are wrong by
/// 0.3 m, and an estimate from the rocking alone is then wrong by 0.3 to 1 m.
const RHYTHM_FRACTION: f64 = 0.05;
/// Drift of odometry and vessel estimate that a recording does not reveal, each axis, m. Chosen: with receivers
/// accurate to 1 cm and the same seeds the mean alone is wrong by 0.11 to 0.16 m.
const WANDER_M: f64 = 0.13;
/// Minimum time on the deck, s, and number of vessel estimates. Chosen: four periods of a 5 s sea.
const MIN_DURATION_S: f64 = 20.0;
const MIN_ESTIMATES: usize = 200;
/// Maximum number of samples; more are thinned (an hour at 2 Hz).
const MAX_SAMPLES: usize = 8192;
const MIN_TAGS: usize = 30;
/// Limits met by 95 % of the samples of a drone at rest: rotation relative to the deck, rad, and displacement, m.
/// Chosen: both attitudes are accurate to 1 deg; without corrections the receivers drift by 0.3 m.
const STILL_RAD: f64 = 0.052;
const STILL_M: f64 = 0.5;
/// Limit of the displacement in the tag's frame, m.
const STILL_TAG_M: f64 = 0.05;
/// Error of the vessel's reference point relative to its sensors, m. Chosen: lever arms measured with a tape.
const LEVER_SD_M: f64 = 0.01;
/// Assumed height differences between the feet, m.
const FOOT_SD_M: f64 = 0.002;
/// Maximum error of a calibration that can still reveal a wrongly measured deck, m: a fifth of a deck's half width.
pub const USABLE_M: f64 = 0.2;
/// Number of standard errors within which a configured value agrees with the result.
const AGREEMENT_SDS: f64 = 2.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DronePlacement {
    pub at_m: [f64; 2],
    pub sd_m: f64,
    /// Standard deviations of the difference between the two GNSS receivers, horizontal and vertical, m.
    pub receivers_sd_m: [f64; 2],
}

impl DronePlacement {
    /// Placement at the deck's centre to within 2 cm, with receiver errors from the predictor's configuration.
    pub fn centred(config: &PredictorConfig) -> DronePlacement {
        let [radio, vision] = [config.radio_bias_sd_m_rad, config.vision_bias_sd_m_rad];
        DronePlacement {
            at_m: [0.0; 2],
            sd_m: 0.02,
            receivers_sd_m: [radio[0].hypot(vision[0]), radio[2].hypot(vision[2])],
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum DeckCalibrationError {
    #[error(
        "{estimates} estimates of the vessel over {seconds:.0} s while the drone stood disarmed: \
         {MIN_ESTIMATES} over {MIN_DURATION_S} s are needed; leave the drone on the deck with \
         motors off while the vessel's radio is received"
    )]
    Few { estimates: usize, seconds: f64 },
    #[error("the drone turns by {deg:.1} deg relative to the vessel: it does not stand still on the deck")]
    Turns {
        /// 95th percentile of the angle to the mean attitude.
        deg: f64,
    },
    /// The drone moves on the deck, or a position is unusable.
    #[error(
        "the drone moves by {metres:.2} m relative to the vessel within {SLOW_S} s: it does not stand still on the \
         deck, or one of the two positions is too uncertain"
    )]
    Moves {
        /// 95th percentile of the displacement that the rocking does not explain.
        metres: f64,
    },
    #[error("no estimate from the samples: their spread is not finite")]
    Spread,
}

pub fn replaces(found: &ValueWithSd, configured: f64) -> bool {
    found.sd <= USABLE_M && (found.value - configured).abs() > AGREEMENT_SDS * found.sd
}

/// Camera mount, calibrated with a tag detected from the deck.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MountCalibration {
    pub tags: usize,
    /// Rotation of the camera relative to the feet about the forward and right axes, rad.
    pub tilt: [ValueWithSd; 2],
    /// Rotation of the camera about the down axis, rad; includes the errors of both compasses.
    pub turn: ValueWithSd,
    /// Height of the camera above the deck minus the configured height (`feet_below_m`, `camera_m`), m.
    pub height: ValueWithSd,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeckCalibrationResult {
    pub estimates: usize,
    pub seconds: f64,
    /// RMS of roll and pitch about their slow mean, rad.
    pub rocking_rad: f64,
    /// Centre of the deck in the vessel's body frame, m.
    pub centre: [ValueWithSd; 3],
    /// Position of the drone on the deck, forward and right of its centre, m.
    pub stood_at: [ValueWithSd; 2],
    /// Tilt of the deck relative to the vessel's inertial sensor, roll and pitch, rad.
    pub tilt: [ValueWithSd; 2],
    /// Heading of the drone on the deck, rad clockwise from the bow.
    pub heading: ValueWithSd,
    /// Camera mount; None if the tag is not detected from the deck.
    pub mount: Option<MountCalibration>,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    t_s: f64,
    /// Position of the feet minus the vessel's reference point, NED, m.
    apart: Vector3<f64>,
    /// Rotation from vessel to NED.
    vessel: Matrix3<f64>,
    /// Rotation from drone to vessel.
    relative: UnitQuaternion<f64>,
    /// Stated variances of both positions, m².
    stated: Vector3<f64>,
}

#[derive(Clone, Debug)]
pub struct DeckCalibration {
    config: PredictorConfig,
    stand: DronePlacement,
    track: DroneTrack,
    samples: Vec<Sample>,
    /// Decimation: one of `every` estimates is kept.
    every: usize,
    count: usize,
    newest: Option<DroneTime>,
    tags: Vec<(Matrix3<f64>, Vector3<f64>)>,
}

impl DeckCalibration {
    pub fn new(config: &PredictorConfig, stand: DronePlacement) -> DeckCalibration {
        DeckCalibration {
            config: config.clone(),
            stand,
            track: DroneTrack::default(),
            samples: Vec::new(),
            every: 1,
            count: 0,
            newest: None,
            tags: Vec::new(),
        }
    }
    /// Discards all samples, because the motors may turn and the drone may stand elsewhere afterwards.
    pub fn armed(&mut self) {
        self.samples.clear();
        self.tags.clear();
        self.every = 1;
        self.count = 0;
        self.newest = None;
    }
    pub fn drone(&mut self, state: &DroneState) {
        let newer = self.track.newest().is_none_or(|s| state.header.at > s.header.at);
        // A jump of the autopilot's origin restarts the collection.
        if state.check().is_ok() && newer && self.track.push(state).is_some() {
            self.armed();
        }
    }
    pub fn estimate(&mut self, e: &VesselEstimate<DroneClock>) {
        if e.check().is_err() || self.newest.is_some_and(|t| e.header.at <= t) {
            return;
        }
        let Some(pose) = self.track.at(e.header.at) else {
            return;
        };
        let Some(e) = self
            .track
            .newest()
            .and_then(|d| placed(e, &d.datum, &d.datum_offset()))
        else {
            return;
        };
        self.newest = Some(e.header.at);
        self.count += 1;
        if !self.count.is_multiple_of(self.every) {
            return;
        }
        if self.samples.len() >= MAX_SAMPLES {
            let mut k = 0_usize;
            self.samples.retain(|_| {
                k += 1;
                k.is_multiple_of(2)
            });
            self.every *= 2;
        }
        let [roll, pitch, yaw] = [e.eta[ROLL], e.eta[PITCH], e.eta[YAW]];
        let vessel = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let feet = pose.position + pose.attitude * Vector3::z() * self.config.drone.feet_below_m;
        self.samples.push(Sample {
            t_s: e.header.at.secs(),
            apart: feet - e.position(),
            vessel: vessel.to_rotation_matrix().into_inner(),
            relative: vessel.inverse() * pose.attitude,
            stated: pose.variance + Vector3::from([0, 1, 2].map(|i| e.covariance(i)[0])),
        });
    }
    pub fn tag(&mut self, m: &TagPose) {
        if m.check().is_err() || self.tags.len() >= MAX_SAMPLES {
            return;
        }
        let [w, x, y, z] = m.attitude;
        let tag = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
        let camera = body_from_camera();
        self.tags.push((
            camera * tag.to_rotation_matrix().into_inner(),
            camera * Vector3::from(m.position) + Vector3::from(self.config.drone.camera_m),
        ));
    }
    /// Processes one step of predictor input. `stands`: whether the drone stands disarmed.
    pub fn take(&mut self, input: &PredictorIn, stands: bool) {
        if let Some(s) = &input.drone {
            self.drone(s);
        }
        if stands {
            if let Some(e) = &input.estimate {
                self.estimate(e);
            }
            for m in &input.tags {
                self.tag(m);
            }
        }
    }
    /// Number of collected estimates, and their time span in s.
    pub fn collected(&self) -> (usize, f64) {
        let [first, last] = [self.samples.first(), self.samples.last()].map(|p| p.map_or(0.0, |p| p.t_s));
        (self.samples.len(), last - first)
    }

    pub fn result(&self) -> Result<DeckCalibrationResult, DeckCalibrationError> {
        let (estimates, seconds) = self.collected();
        if estimates < MIN_ESTIMATES || seconds < MIN_DURATION_S {
            return Err(DeckCalibrationError::Few { estimates, seconds });
        }
        let lags = (SHARED_S * estimates as f64 / seconds).ceil() as usize;
        let relative = self.relative(lags)?;
        let (feet, rocking_rad) = self.feet(lags)?;
        let mount = self.mount(&relative)?;
        let stand = mount.map_or(
            self.stand
                .at_m
                .map(|value| ValueWithSd::new(value, self.stand.sd_m)),
            |(_, at)| at,
        );
        let (value, covariance) = feet.value().ok_or(DeckCalibrationError::Spread)?;
        let at = [stand[0].value, stand[1].value, 0.0];
        let at_sd = [stand[0].sd, stand[1].sd, 0.0];
        let centre = core::array::from_fn(|i| {
            ValueWithSd::new(
                value[i] - at[i],
                (covariance[(i, i)] + at_sd[i].powi(2) + LEVER_SD_M.powi(2)).sqrt(),
            )
        });
        if !centre.iter().all(|f| f.value.is_finite() && f.sd.is_finite()) {
            return Err(DeckCalibrationError::Spread);
        }
        Ok(DeckCalibrationResult {
            estimates,
            seconds,
            rocking_rad,
            centre,
            stood_at: stand,
            tilt: relative.tilt,
            heading: relative.heading,
            mount: mount.map(|(m, _)| m),
        })
    }

    /// Standard deviation of the tilt between the feet's plane and the deck, rad.
    fn uneven_rad(&self) -> f64 {
        let [along, across] = self.config.drone.feet_span_m;
        FOOT_SD_M / along.min(across).max(1e-3)
    }

    fn relative(&self, lags: usize) -> Result<Relative, DeckCalibrationError> {
        let sum: Quaternion<f64> = self
            .samples
            .iter()
            .fold(Quaternion::new(0.0, 0.0, 0.0, 0.0), |s, p| {
                // Each rotation has two quaternions, so choose the same sign for all.
                let q = *p.relative.quaternion();
                if s.dot(&q) < 0.0 { s - q } else { s + q }
            });
        let middle = UnitQuaternion::try_new(sum, 1e-9).ok_or(DeckCalibrationError::Spread)?;
        let turns: Vec<Vector3<f64>> = self
            .samples
            .iter()
            .map(|p| (p.relative * middle.inverse()).scaled_axis())
            .collect();
        let widest = percentile_95(turns.iter().map(Vector3::norm));
        if widest > STILL_RAD {
            return Err(DeckCalibrationError::Turns {
                deg: widest.to_degrees(),
            });
        }
        let (_, covariance) = mean(&turns, lags).ok_or(DeckCalibrationError::Spread)?;
        let bias = |i: usize| {
            let [radio, vision] = [self.config.radio_bias_sd_m_rad, self.config.vision_bias_sd_m_rad];
            radio[i].hypot(vision[i])
        };
        // Tilt of the feet's plane, whatever the drone's heading.
        let down = middle * Vector3::z();
        let sd = |i: usize| (covariance[(i, i)] + bias(i + 3).powi(2) + self.uneven_rad().powi(2)).sqrt();
        Ok(Relative {
            tilt: [ValueWithSd::new(-down.y, sd(0)), ValueWithSd::new(down.x, sd(1))],
            heading: ValueWithSd::new(
                middle.euler_angles().2,
                (covariance[(2, 2)] + bias(5).powi(2)).sqrt(),
            ),
        })
    }

    fn feet(&self, lags: usize) -> Result<(Information, f64), DeckCalibrationError> {
        let fast = self.fast();
        let n = fast.len() as f64;
        let rocking_rad = (fast
            .iter()
            .map(|(a, _)| 0.5 * a.column(2).norm_squared())
            .sum::<f64>()
            / n)
            .sqrt();
        let own: Vec<Vector3<f64>> = self
            .samples
            .iter()
            .map(|p| p.vessel.transpose() * p.apart)
            .collect();
        let (value, covariance) = mean(&own, lags).ok_or(DeckCalibrationError::Spread)?;
        let [h, v] = self.stand.receivers_sd_m;
        // Filter errors are correlated, so the mean of many estimates is no better than one of them.
        let stated = self.samples.iter().map(|p| p.stated).sum::<Vector3<f64>>() / self.samples.len() as f64;
        let rhythm = RHYTHM_M.hypot(RHYTHM_FRACTION * stated.xy().max().sqrt());
        let from_rocking = regress(&fast, MIN_ROCKING_RAD, lags, rhythm);
        let level = (Vector3::new(h * h, h * h, v * v) + stated).add_scalar(WANDER_M * WANDER_M);
        // The receivers' errors are the same in the body frame of a level vessel.
        let receivers = Matrix3::from_diagonal(&Vector3::new(level.xy().max(), level.xy().max(), level.z));
        let from_mean =
            Information::of(&value, &(covariance + receivers)).ok_or(DeckCalibrationError::Spread)?;
        let feet = from_rocking.with(&from_mean);
        let (value, _) = feet.value().ok_or(DeckCalibrationError::Spread)?;
        let metres = percentile_95(fast.iter().map(|(a, y)| (y - a * value).norm()));
        if !(metres <= STILL_M) {
            return Err(DeckCalibrationError::Moves { metres });
        }
        Ok((feet, rocking_rad))
    }

    /// Vessel attitude and foot position relative to their means over [`SLOW_S`].
    fn fast(&self) -> Vec<(Matrix3<f64>, Vector3<f64>)> {
        let mut first = 0;
        let mut last = 0;
        let mut a = Matrix3::zeros();
        let mut y = Vector3::zeros();
        self.samples
            .iter()
            .map(|p| {
                while let Some(q) = self.samples.get(last).filter(|q| q.t_s <= p.t_s + 0.5 * SLOW_S) {
                    a += q.vessel;
                    y += q.apart;
                    last += 1;
                }
                while let Some(q) = self.samples.get(first).filter(|q| q.t_s < p.t_s - 0.5 * SLOW_S) {
                    a -= q.vessel;
                    y -= q.apart;
                    first += 1;
                }
                let n = (last - first) as f64;
                (p.vessel - a / n, p.apart - y / n)
            })
            .collect()
    }

    fn mount(
        &self,
        relative: &Relative,
    ) -> Result<Option<(MountCalibration, [ValueWithSd; 2])>, DeckCalibrationError> {
        if self.tags.len() < MIN_TAGS {
            return Ok(None);
        }
        let c = &self.config;
        let feet = Vector3::z() * c.drone.feet_below_m;
        let places: Vec<Vector3<f64>> = self
            .tags
            .iter()
            .map(|(tag, at)| tag.transpose() * (feet - at))
            .collect();
        let rotations: Vec<Vector3<f64>> = self
            .tags
            .iter()
            .map(|(tag, _)| {
                let down = tag.column(2);
                let yaw = Rotation3::from_matrix_unchecked(*tag).euler_angles().2;
                // exp(-m) z = z - m x z, and the tag's heading relative to the drone.
                Vector3::new(down.y, -down.x, yaw)
            })
            .collect();
        // Number of images after which the tag's errors are independent.
        let lags = 30;
        let (Some((place, place_cov)), Some((rotation, rotation_cov))) =
            (mean(&places, lags), mean(&rotations, lags))
        else {
            return Err(DeckCalibrationError::Spread);
        };
        let metres = percentile_95(places.iter().map(|p| (p - place).xy().norm()));
        if !(metres <= STILL_TAG_M) {
            return Err(DeckCalibrationError::Moves { metres });
        }
        let tilt = core::array::from_fn(|i| {
            ValueWithSd::new(rotation[i], rotation_cov[(i, i)].sqrt().hypot(self.uneven_rad()))
        });
        // The tag's rotation relative to the drone is minus the drone's heading on the deck.
        let turn = alight_shared::frames::wrap_angle(-rotation[2] - relative.heading.value);
        // A rotated camera is aimed at another point below the feet.
        let lens = c
            .camera_mount_sd_m
            .hypot(c.drone.feet_below_m * rotation.xy().norm());
        let mount = MountCalibration {
            tags: self.tags.len(),
            tilt,
            turn: ValueWithSd::new(turn, rotation_cov[(2, 2)].sqrt().hypot(relative.heading.sd)),
            height: ValueWithSd::new(-place.z, place_cov[(2, 2)].sqrt().hypot(FOOT_SD_M)),
        };
        let at = core::array::from_fn(|i| ValueWithSd::new(place[i], place_cov[(i, i)].sqrt().hypot(lens)));
        Ok(Some((mount, at)))
    }
}

struct Relative {
    tilt: [ValueWithSd; 2],
    heading: ValueWithSd,
}

fn percentile_95(values: impl Iterator<Item = f64>) -> f64 {
    quantile(&mut values.collect::<Vec<f64>>(), 0.95).unwrap_or(f64::NAN)
}
