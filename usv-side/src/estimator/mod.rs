//! The vessel's state estimator: a Kalman filter on the wave-augmented model of [`alight_shared::vessel_model`], linear
//! in the vessel-parallel frame at a reference heading that follows the mean heading.
//!
//! The filter runs at 50 Hz on the mean of each step's inertial samples. Surge is estimated with pitch and
//! sway with roll, because an accelerometer does not distinguish horizontal acceleration from tilt: on a hull
//! that follows the water it measures almost none, and the gyroscope determines the tilt. Late measurements
//! (GNSS, heading) are compared with the state at their time.

mod adaptive_noise;
mod attitude;
mod consistency;
mod gnss;
mod history;
mod inertial;
mod output;
mod speed_gain;
mod tilt;
mod velocity_lag;

use alight_shared::{
    estimation::AidSource,
    frames::wrap_angle,
    geodesy::Datum,
    motion_model::{MeasuredErrors, MotionModel},
    msg::{AttitudeFix, GnssFix, HeadingFix, ImuSample, MAX_SOURCES},
    time::{Span, VesselClock, VesselTime},
    vessel_model::{
        Belief, BeliefSpec, BeliefStep, DISTURBANCE, ETA, Extra, HEAD, HEAVE, NU, PITCH, ROLL, SLOW, SURGE,
        SWAY, Term, VesselModel, YAW,
    },
};
use nalgebra::{Rotation2, Vector2, Vector3};

use crate::VesselNodeConfig;
pub use consistency::{Consistency, InnovationChannel, InnovationStatistics};
pub use tilt::Tilt;

/// Length of a filter step, s.
pub(crate) const STEP_S: f64 = 0.02;
/// Longest gap bridged by prediction, s.
const MAX_GAP_S: f64 = 2.0;
/// Deviation from the mean heading that counts as a turn, rad (6 deg).
const TURN_RAD: f64 = 0.1;

/// Index in the heave block of GNSS height minus heave: mean water level plus the receiver's slow bias. The vessel's
/// NED plane moves with this height.
pub(crate) const GNSS_BIAS: usize = HEAD + 1;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OutlierCounts {
    pub imu: u64,
    pub gnss: u64,
    pub heading: u64,
    pub attitude: u64,
    /// Restarts from scratch, after a non-finite state or a long gap.
    pub restarts: u64,
}

#[derive(Clone, Debug)]
pub struct Estimator {
    config: VesselNodeConfig,
    outliers: OutlierCounts,
    /// First measurements, used to initialise the filter.
    start: Start,
    filter: Option<VesselFilter>,
    /// Innovation statistics up to the last restart.
    consistency: Consistency,
    /// Motion model of the previous filter, passed on at a restart.
    motion: MotionModel<VesselClock>,
}

#[derive(Clone, Debug, Default)]
struct Start {
    fix: Option<GnssFix>,
    heading: Option<HeadingFix>,
}

#[derive(Clone, Debug)]
pub(crate) struct VesselFilter {
    pub(crate) at: VesselTime,
    pub(crate) belief: Belief,
    pub(crate) model: VesselModel,
    pub(crate) reference: f64,
    pub(crate) datum: Datum,
    height_reference: gnss::HeightReference,
    /// Mean velocity north, east (m/s), mean heading (rad) and its rate (rad/s).
    pub(crate) mean_velocity: Vector2<f64>,
    pub(crate) mean_heading: f64,
    pub(crate) mean_heading_rate: f64,
    /// Acceleration of the mean motion by the engines.
    pub(crate) gain: speed_gain::SpeedGain,
    pub(crate) adaptive_noise: adaptive_noise::AdaptiveNoise,
    pub(crate) motion: MotionModel<VesselClock>,
    /// Prediction errors of position (north, east, m) and heading (rad).
    course_errors: MeasuredErrors<3, VesselClock>,
    /// Slow motion, relative to which waves are measured.
    pub(crate) slow: SlowMotion,
    step: BeliefStep,
    window: inertial::ImuWindow,
    history: history::History,
    velocity_lags: velocity_lag::VelocityLags,
    /// Position of the inertial sensor in the vessel's body frame, m.
    imu_lever_arm: Vector3<f64>,
    started: VesselTime,
    imu: AidSource<VesselClock>,
    attitude: AidSource<VesselClock>,
    fixes: AidSource<VesselClock>,
    /// Position and velocity, per axis.
    rows: [[AidSource<VesselClock>; 3]; 2],
    headings: [AidSource<VesselClock>; MAX_SOURCES],
    consistency: Consistency,
    row: Vec<Term>,
}

/// Velocity along and across the mean heading, and heading, averaged over some waves.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SlowMotion {
    velocity: Vector2<f64>,
    heading: f64,
    known_s: f64,
}

/// Averaging time of [`SlowMotion`], s: four waves.
const SLOW_S: f64 = 20.0;

impl SlowMotion {
    /// Updates the averages with the velocity (NED, m/s) and heading of a step; `mean_axes` turns into NED.
    fn update(&mut self, velocity: Vector2<f64>, heading: f64, mean_axes: &Rotation2<f64>) {
        self.known_s += STEP_S;
        // Plain average until the memory is full.
        let fraction = STEP_S / self.known_s.min(SLOW_S);
        self.velocity += (mean_axes.inverse() * velocity - self.velocity) * fraction;
        let off = wrap_angle(heading - self.heading);
        // Waves turn a vessel by no more than this angle; any excess is a turn and is followed at once.
        let turned = off - off.clamp(-TURN_RAD, TURN_RAD);
        self.heading = wrap_angle(self.heading + turned + (off - turned) * fraction);
    }
    /// Velocity in NED, m/s.
    pub(crate) fn velocity(&self, mean_heading: f64) -> Vector2<f64> {
        Rotation2::new(mean_heading) * self.velocity
    }
    /// Corrects a heading error of `by` (rad); the velocity in NED is unchanged.
    fn turn(&mut self, by: f64) {
        self.heading = wrap_angle(self.heading + by);
        self.velocity = Rotation2::new(-by) * self.velocity;
    }
    /// Deviation of a heading from the slow one, rad.
    pub(crate) fn off(&self, heading: f64) -> f64 {
        wrap_angle(heading - self.heading)
    }
}

/// Number of rejected values (of six) at which a fix counts as lost.
const LOST_ROWS: u64 = 4;
/// Consecutive rejected fixes (2 s) before a lost one after which the filter, not the receiver, is assumed to be
/// wrong and restarts.
const LOST_FIXES: u32 = 20;

impl Estimator {
    pub fn new(config: &VesselNodeConfig) -> Self {
        Estimator {
            config: config.clone(),
            outliers: OutlierCounts::default(),
            start: Start::default(),
            filter: None,
            consistency: Consistency::default(),
            motion: MotionModel::default(),
        }
    }
    pub fn outliers(&self) -> OutlierCounts {
        self.outliers
    }
    /// Mean water level in the GNSS frame, m down in the vessel's NED.
    pub fn level(&self) -> Option<f64> {
        self.filter.as_ref().map(VesselFilter::level)
    }
    /// Standard deviation of heave about the level (m), roll and pitch (rad) predicted `ahead_s` from now,
    /// for studies: the broadcast value includes the uncertainty of the level.
    pub fn deck_sd(&self, ahead_s: f64) -> Option<[f64; 3]> {
        self.filter.as_ref().map(|f| f.deck_sd(ahead_s))
    }
    pub(crate) fn filter(&self) -> Option<&VesselFilter> {
        self.filter.as_ref()
    }

    pub fn imu(&mut self, sample: &ImuSample) {
        let Some(f) = self.filter.as_mut() else {
            self.try_start(sample.header.at);
            return;
        };
        let last = f.imu.measured_at.replace(sample.header.at).unwrap_or(f.started);
        let period = (sample.header.at - last).secs().clamp(0.0, STEP_S);
        f.imu_lever_arm = Vector3::from(sample.lever_arm.unwrap_or(self.config.imu.lever_arm_m));
        let ahead = (sample.header.at - f.at).secs();
        f.window.push(sample, ahead, period);
        if ahead + 0.5 * period >= STEP_S {
            let window = core::mem::take(&mut f.window);
            let ahead = window.mean().ahead;
            if ahead > MAX_GAP_S {
                self.restart();
                return;
            }
            let from = f.at;
            f.step_before(ahead);
            let offset = ahead - (f.at - from).secs();
            self.outliers.imu += f.fuse_inertial(&self.config, &window, offset);
            f.end_step();
        }
        self.guard();
    }

    /// Returns the number of rejected components.
    pub fn gnss(&mut self, fix: &GnssFix) -> u64 {
        let mut rejected = 0;
        match self.filter.as_mut() {
            None => self.start.fix = Some(*fix),
            Some(f) => {
                rejected = f.fuse_gnss(&self.config, fix);
                self.outliers.gnss += rejected;
                if rejected >= LOST_ROWS && f.fixes.rejections >= LOST_FIXES {
                    self.restart();
                }
            }
        }
        self.guard();
        rejected
    }

    /// Returns false if rejected.
    pub fn heading(&mut self, heading: &HeadingFix) -> bool {
        let mut fused = true;
        match self.filter.as_mut() {
            None => self.start.heading = Some(*heading),
            Some(f) => {
                fused = f.fuse_heading(heading);
                self.outliers.heading += u64::from(!fused);
            }
        }
        self.guard();
        fused
    }

    /// Fuses an admitted attitude, which drives the filter if there is no inertial sensor. Returns whether it
    /// was used, and the number of rejected components.
    pub fn attitude(&mut self, fix: &AttitudeFix) -> (bool, u64) {
        let at = fix.header.at;
        let Some(f) = self.filter.as_mut() else {
            self.try_start(at);
            return (true, 0);
        };
        if f.has_inertial(at) {
            return (false, 0);
        }
        if (at - f.at).secs() > MAX_GAP_S {
            self.restart();
            return (true, 0);
        }
        f.coast(at);
        let rejected = f.fuse_attitude(fix);
        self.outliers.attitude += rejected;
        self.guard();
        (true, rejected)
    }

    pub fn consistency(&self) -> Consistency {
        let running = self.filter.as_ref().map(|f| f.consistency);
        self.consistency.and(&running.unwrap_or_default())
    }

    /// Called once per tick after the measurements: bridges inertial gaps, adapts the process noise,
    /// identifies motion.
    pub fn tick(&mut self, now: VesselTime) {
        let Some(f) = self.filter.as_mut() else { return };
        f.adapt(&self.config);
        if !f.measures_gravity(&self.config) && f.motion.newest().is_some() {
            // The model was identified from wrong heave.
            f.motion = MotionModel::default();
        }
        f.motion.work();
        let behind = (now - f.at).secs();
        if behind > MAX_GAP_S {
            self.restart();
        } else if behind > 0.1 {
            f.coast(now);
        }
        self.guard();
    }

    fn restart(&mut self) {
        self.outliers.restarts += 1;
        self.consistency = self.consistency();
        // The motion model stays valid if only the filter's position was wrong.
        if let Some(filter) = self.filter.take() {
            self.motion = filter.motion;
        }
        self.start = Start::default();
    }
    fn guard(&mut self) {
        // A NaN anywhere in a block reaches the block's first state within one step.
        let broken = self.filter.as_ref().is_some_and(|f| {
            (0..6).any(|d| !(f.belief.get(d, ETA).is_finite() && f.belief.variance(d, ETA).is_finite()))
        });
        if broken {
            self.restart();
        }
    }

    fn try_start(&mut self, at: VesselTime) {
        let (Some(fix), Some(heading)) = (self.start.fix, self.start.heading) else {
            return;
        };
        let fresh = |t: VesselTime| (at - t).abs() < Span::from_secs(1.0);
        if !fresh(fix.header.at) || !fresh(heading.header.at) {
            return;
        }
        let mut filter = VesselFilter::new(&self.config, at, &fix, &heading);
        filter.motion = core::mem::take(&mut self.motion);
        self.filter = Some(filter);
    }
}

/// States in addition to the vessel's motion, and their initial spread.
fn belief_spec(config: &VesselNodeConfig) -> BeliefSpec {
    let bias = |sd: f64, time_s: f64| Extra {
        sd,
        walk: sd * (2.0 / time_s).sqrt(),
        time_s,
    };
    let imu = &config.imu;
    let gnss = &config.gnss;
    let heading = &config.heading;
    let force = bias(imu.accelerometer_bias_sd_mps2, imu.bias_time_s);
    let gyro = bias(imu.gyro_bias_sd_radps, imu.bias_time_s);
    let compass = bias(heading.bias_sd_deg.to_radians(), heading.bias_time_s);
    let height = bias(gnss.height_bias_sd_m, gnss.height_bias_time_s);
    BeliefSpec {
        couplings: vec![(SURGE, PITCH), (SWAY, ROLL)],
        extras: [
            vec![force],
            vec![force],
            vec![force, height],
            vec![gyro],
            vec![gyro],
            vec![gyro, compass],
        ],
        // Accuracy of the first fix, orbital velocity of the waves, tilt of a rocking vessel.
        initial_sd: [
            [1.0, 1.0],
            [1.0, 1.0],
            [1.0, 1.0],
            [0.1, 0.2],
            [0.1, 0.2],
            [0.05, 0.1],
        ],
    }
}

impl VesselFilter {
    fn new(config: &VesselNodeConfig, at: VesselTime, fix: &GnssFix, heading: &HeadingFix) -> Self {
        let model = VesselModel::with_bank(&config.model);
        let reference = heading.heading;
        let mut belief = Belief::new(&model, &belief_spec(config));
        let antenna = fix.lever_arm.unwrap_or(config.gnss.antenna_m);
        let level = Tilt::default().rotation() * Vector3::from(antenna);
        let p = Rotation2::new(-reference) * Vector2::new(fix.position[0], fix.position[1]);
        let v = Rotation2::new(-reference) * Vector2::new(fix.velocity[0], fix.velocity[1]);
        belief.set(SURGE, ETA, p.x - level.x);
        belief.set(SWAY, ETA, p.y - level.y);
        // Heave is relative to the mean water level; the bias holds the level in the receiver's frame.
        belief.set(HEAVE, GNSS_BIAS, fix.position[2] - level.z);
        belief.set_variance(HEAVE, GNSS_BIAS, 4.0);
        belief.set_variance(HEAVE, SLOW, 1e-4);
        belief.set(SURGE, NU, v.x);
        belief.set(SWAY, NU, v.y);
        belief.set(SURGE, SLOW, v.x);
        belief.set(SWAY, SLOW, v.y);
        belief.set(YAW, ETA, heading.heading);
        let step = belief.step(&model, STEP_S);
        VesselFilter {
            at,
            belief,
            model,
            reference,
            datum: fix.datum,
            height_reference: gnss::HeightReference::of(fix),
            mean_velocity: Vector2::new(fix.velocity[0], fix.velocity[1]),
            mean_heading: reference,
            mean_heading_rate: 0.0,
            gain: speed_gain::SpeedGain::default(),
            adaptive_noise: adaptive_noise::AdaptiveNoise::new(at),
            motion: MotionModel::default(),
            course_errors: MeasuredErrors::default(),
            slow: SlowMotion::default(),
            step,
            window: Default::default(),
            history: history::History::default(),
            velocity_lags: velocity_lag::VelocityLags::default(),
            imu_lever_arm: Vector3::from(config.imu.lever_arm_m),
            started: at,
            imu: AidSource::default(),
            attitude: AidSource::default(),
            fixes: AidSource::default(),
            rows: Default::default(),
            headings: Default::default(),
            consistency: Consistency::default(),
            row: Vec::with_capacity(64),
        }
    }

    fn propagate(&mut self) {
        self.belief.propagate(&self.step);
        self.at += Span::from_secs(STEP_S);
    }
    /// Ends a step with or without a measurement; a skipped step would discard the identification's record.
    fn end_step(&mut self) {
        self.remember();
        self.follow_heading();
        self.observe_motion();
    }
    /// Propagates to within half a step of `ahead` seconds, and leaves the last step to be ended by a measurement.
    fn step_before(&mut self, ahead: f64) {
        let steps = (ahead / STEP_S).round().clamp(1.0, MAX_GAP_S / STEP_S) as u32;
        for _ in 1..steps {
            self.propagate();
            self.end_step();
        }
        self.propagate();
    }
    /// Propagates to within half a step of `to`, by the model alone.
    fn coast(&mut self, to: VesselTime) {
        self.window = Default::default();
        let ahead = (to - self.at).secs();
        let steps = (ahead / STEP_S).round().clamp(0.0, MAX_GAP_S / STEP_S) as u32;
        for _ in 0..steps {
            self.propagate();
            self.end_step();
        }
    }

    /// Time since motion was last measured by the inertial sensor or its replacement, s.
    pub(crate) fn motion_age(&self, now: VesselTime) -> f64 {
        let measured = self.imu.measured_at.max(self.attitude.measured_at);
        (now - measured.unwrap_or(self.started)).secs()
    }

    pub(crate) fn tilt(&self) -> Tilt {
        let b = &self.belief;
        Tilt {
            angles: [b.get(ROLL, ETA), b.get(PITCH, ETA)],
            rates: [b.get(ROLL, NU), b.get(PITCH, NU)],
            heading: wrap_angle(b.get(YAW, ETA) - self.reference),
            heading_rate: b.get(YAW, NU),
        }
    }
    pub(crate) fn accelerations(&self) -> [f64; 6] {
        core::array::from_fn(|d| self.belief.acceleration(&self.model, d))
    }

    /// Updates the mean motion and, after a sufficient turn of the mean heading, the reference heading.
    fn follow_heading(&mut self) {
        // First-order low-pass (1 s) of the motion outside the modes; before they are known, slow velocity.
        let b = &self.belief;
        let velocity = self.ned(b.get(SURGE, NU), b.get(SWAY, NU));
        let heading = b.get(YAW, ETA);
        let waves = self.motion.waves(self.at);
        let mean_axes = Rotation2::new(self.mean_heading);
        self.slow.update(velocity, heading, &mean_axes);
        let mean = match waves {
            Some(w) => velocity - Vector2::new(w[SURGE], w[SWAY]),
            None => mean_axes * self.slow.velocity,
        };
        let ahead = mean_axes * Vector2::x();
        self.gain.update((mean - self.mean_velocity).dot(&ahead));
        self.mean_velocity += (mean - self.mean_velocity) * STEP_S;
        let heading = heading - waves.map_or(0.0, |w| w[YAW]);
        let rate = b.get(YAW, NU);
        self.mean_heading_rate += (rate - self.mean_heading_rate) * STEP_S;
        self.mean_heading += self.mean_heading_rate * STEP_S;
        self.mean_heading += wrap_angle(heading - self.mean_heading) * STEP_S;
        self.mean_heading = wrap_angle(self.mean_heading);
        let off = wrap_angle(self.mean_heading - self.reference);
        if off.abs() > TURN_RAD {
            self.belief.turn(off);
            self.history.clear();
            self.reference = self.mean_heading;
        }
    }

    fn adapt(&mut self, config: &VesselNodeConfig) {
        if self.adaptive_noise.is_rebuild_due(self.at) {
            let adapted = self.adaptive_noise.adapted(&config.model);
            self.model = VesselModel::with_bank(&adapted);
            self.step = self.belief.step(&self.model, STEP_S);
        }
    }

    /// Inflates the covariance of the fast states after too many rejections.
    fn open(&mut self) {
        for d in 0..6 {
            let sd = self.model.config().disturbance_sd_mps2_m_rad_radps2[d];
            self.belief.inflate(d, DISTURBANCE, 25.0 * sd * sd);
            self.belief.inflate(d, ETA, if d < 3 { 0.25 } else { 0.01 });
            self.belief.inflate(d, NU, if d < 3 { 0.25 } else { 0.04 });
        }
    }
}
