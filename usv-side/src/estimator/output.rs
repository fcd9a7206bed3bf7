//! Messages from the filter's state.

use alight_shared::{
    frames::wrap_angle,
    motion_model::{FADE_S, MotionSample},
    msg::{
        Header, PREDICTION_STAGES, PredictedStage, SLOPE_WINDOWS, Seq, VesselEstimate, VesselPrediction,
        WaveMode, WaveModel, f16,
    },
    time::{VesselClock, VesselTime},
    vessel_model::{ETA, HEAVE, Modes, NU, PITCH, ROLL, SURGE, SWAY, YAW, turn_tilt},
};
use nalgebra::{Rotation2, Vector2};

use super::{GNSS_BIAS, Tilt, VesselFilter};
use crate::{VesselNodeConfig, advice::Underway};

/// Standard deviation of the unknown part of a receiver's latency, s. Our choice: positions at 10 Hz arrive
/// 20 to 100 ms late according to the receivers' data sheets, and the minimum delay cannot be observed. The
/// error is common to all fixes, so it does not average out.
const LATENCY_SD_S: f64 = 0.03;

/// Course of the vessel: mean velocity (turning with the mean heading), modes, and the residual of both.
struct Course<'a> {
    modes: &'a Modes<VesselClock>,
    /// Time since the modes' validity, s, and displacement by the waves during it, north and east, m.
    since: f64,
    moved: Vector2<f64>,
    /// Present values, NED: m, m/s, rad, rad/s.
    place: Vector2<f64>,
    mean_velocity: Vector2<f64>,
    mean_heading: f64,
    rate: f64,
    /// Present residual of velocity and heading after mean and modes.
    left: Vector2<f64>,
    left_yaw: f64,
}

struct CoursePoint {
    /// North and east: m, m/s.
    place: Vector2<f64>,
    velocity: Vector2<f64>,
    /// Heading: rad, rad/s.
    mean_heading: f64,
    heading: f64,
    heading_rate: f64,
}

/// Displacement of a vessel by the waves over `t` seconds, north and east, m.
fn path(modes: &Modes<VesselClock>, t: f64) -> Vector2<f64> {
    Vector2::new(modes.path(SURGE, t), modes.path(SWAY, t))
}

impl Course<'_> {
    /// Displacement and velocity of the mean motion, `t` seconds from now.
    fn mean(&self, t: f64) -> (Vector2<f64>, Vector2<f64>) {
        let half = Rotation2::new(0.5 * self.rate * t) * self.mean_velocity;
        let chord = if self.rate == 0.0 {
            t
        } else {
            (0.5 * self.rate * t).sin() / (0.5 * self.rate)
        };
        (half * chord, Rotation2::new(self.rate * t) * self.mean_velocity)
    }
    /// Point of the course `ahead` seconds after the modes' time of validity.
    fn at(&self, ahead: f64) -> CoursePoint {
        let t = ahead - self.since;
        let waves = self.modes.motion(ahead);
        let (way, mean) = self.mean(t);
        // Past residuals are unknown; the present one is assumed.
        let fades = (-t.max(0.0) / FADE_S).exp();
        let gone = t.min(0.0) + FADE_S * (1.0 - fades);
        let yaw = self.left_yaw * fades;
        let mean_heading = self.mean_heading + self.rate * t;
        CoursePoint {
            place: self.place + way + path(self.modes, ahead) - self.moved + self.left * gone,
            velocity: mean + Vector2::new(waves[SURGE][0], waves[SWAY][0]) + self.left * fades,
            mean_heading,
            heading: mean_heading + waves[YAW][0] + yaw,
            heading_rate: self.rate + waves[YAW][1] - if t > 0.0 { yaw / FADE_S } else { 0.0 },
        }
    }
}

impl VesselFilter {
    /// Rotates from the reference-parallel frame to NED.
    pub(super) fn ned(&self, x: f64, y: f64) -> Vector2<f64> {
        Rotation2::new(self.reference) * Vector2::new(x, y)
    }

    /// Estimate at `now`, at most a few steps after the state's time, by a second-order series.
    pub(crate) fn estimate(
        &self,
        config: &VesselNodeConfig,
        header: Header<VesselClock>,
    ) -> VesselEstimate<VesselClock> {
        let h = (header.at - self.at).secs().clamp(-0.05, 0.2);
        let a = self.accelerations();
        let b = &self.belief;
        let eta: [f64; 6] = core::array::from_fn(|d| b.get(d, ETA) + h * b.get(d, NU) + 0.5 * h * h * a[d]);
        let nu: [f64; 6] = core::array::from_fn(|d| b.get(d, NU) + h * a[d]);
        let level = b.get(HEAVE, GNSS_BIAS);
        let tilt = Tilt {
            angles: [eta[ROLL], eta[PITCH]],
            rates: [nu[ROLL], nu[PITCH]],
            heading: wrap_angle(eta[YAW] - self.reference),
            heading_rate: nu[YAW],
        };
        let [roll, pitch, _] = tilt.euler();
        let rates = tilt.euler_rates();
        let p = self.ned(eta[SURGE], eta[SWAY]);
        let v = self.ned(nu[SURGE], nu[SWAY]);
        let w = self.ned(a[SURGE], a[SWAY]);
        // Rolling back by h: var(eta) grows by 2 h cov + h² var(nu).
        let cov = |d: usize| {
            let [e, c, n] = b.motion_covariance(d);
            [e + 2.0 * h * c + h * h * n, c + h * n, n]
        };
        let s2 = self.reference.sin().powi(2);
        let c2 = self.reference.cos().powi(2);
        let cs = cov(SURGE);
        let cw = cov(SWAY);
        let mix = |p: f64, q: f64| core::array::from_fn(|i| p * cs[i] + q * cw[i]);
        let late =
            |[value, c, rate]: [f64; 3], velocity: f64| [value + (LATENCY_SD_S * velocity).powi(2), c, rate];
        let blocks: [[f64; 3]; 6] = [
            late(mix(c2, s2), self.mean_velocity.x),
            late(mix(s2, c2), self.mean_velocity.y),
            {
                let [e, c, n] = cov(HEAVE);
                let (with_eta, with_nu, own) = self.level_covariance();
                [e + 2.0 * with_eta + own, c + with_nu, n]
            },
            cov(ROLL),
            cov(PITCH),
            {
                let [value, c, rate] = cov(YAW);
                [value + self.heading_doubt(config).powi(2), c, rate]
            },
        ];
        VesselEstimate {
            header,
            datum: self.datum,
            eta: [p.x, p.y, eta[HEAVE] + level, roll, pitch, wrap_angle(eta[YAW])],
            eta_dot: [v.x, v.y, nu[HEAVE], rates[0], rates[1], rates[2]].map(|x| x as f32),
            eta_ddot: [w.x, w.y, a[HEAVE], a[ROLL], a[PITCH], a[YAW]].map(f16::from_f64),
            uncertainty: blocks.map(|[value, cov, rate]| {
                let value = value.max(0.0).sqrt();
                let rate = rate.max(0.0).sqrt();
                let correlation = (cov / (value * rate).max(1e-300)).clamp(-1.0, 1.0);
                [value, rate, correlation].map(f16::from_f64)
            }),
            deck_centre: config.deck.centre_m.map(|x| x as f32),
            mean_velocity: [self.mean_velocity.x as f32, self.mean_velocity.y as f32],
            mean_heading: [self.mean_heading as f32, self.mean_heading_rate as f32],
        }
    }

    /// Covariances of the height reference with heave and with the heave rate, and variance of the height reference.
    fn level_covariance(&self) -> (f64, f64, f64) {
        let b = &self.belief;
        (
            b.covariance((HEAVE, ETA), (HEAVE, GNSS_BIAS)),
            b.covariance((HEAVE, NU), (HEAVE, GNSS_BIAS)),
            self.level_variance(),
        )
    }
    /// Variance of the mean water level's height above the ellipsoid, m².
    fn level_variance(&self) -> f64 {
        self.belief.variance(HEAVE, GNSS_BIAS).max(0.0) + self.height_reference.sd.powi(2)
    }

    /// Wave model, valid at the newest sample of the identification, with the apparent slopes of the deck.
    pub(crate) fn wave_model(
        &self,
        header: Header<VesselClock>,
        slopes: Seq<u8, SLOPE_WINDOWS>,
    ) -> Option<WaveModel<VesselClock>> {
        let modes = self.motion.modes()?;
        let named = modes.modes.iter().filter(|_| self.motion.is_identified());
        let deviation = self.motion.deviation();
        Some(WaveModel {
            header: Header {
                at: modes.at,
                ..header
            },
            significant_height_m: (4.0 * deviation[HEAVE]).clamp(0.0, 50.0) as f32,
            confidence: self.motion.confidence() as f32,
            modes: Seq::filled(named.map(WaveMode::from)),
            slopes,
            advice: None,
        })
    }

    /// Motion for the advice, with the true wind (towards, NED, m/s) and the deck's steepest apparent slopes.
    pub(crate) fn underway(
        &self,
        wind: Option<Vector2<f64>>,
        slopes: Seq<u8, SLOPE_WINDOWS>,
    ) -> Underway<'_> {
        Underway {
            motion: &self.motion,
            velocity: self.mean_velocity,
            heading: self.mean_heading,
            heading_rate: self.mean_heading_rate,
            wind,
            slopes,
        }
    }

    pub(super) fn observe_motion(&mut self) {
        if !self.motion.is_due(self.at) {
            return;
        }
        let b = &self.belief;
        let tilt = self.tilt();
        let (north, east) = turn_tilt(tilt.angles[0], tilt.angles[1], -self.reference);
        let (s, c) = self.reference.sin_cos();
        let [dr, dp] = tilt.rates;
        let velocity = self.ned(b.get(SURGE, NU), b.get(SWAY, NU));
        let v = velocity - self.slow.velocity(self.mean_heading);
        let acceleration = self.accelerations();
        // Excludes turns of the course and acceleration by the engines.
        let a = self.ned(acceleration[SURGE], acceleration[SWAY])
            - self.mean_heading_rate * Vector2::new(-velocity.y, velocity.x)
            - self.gain.acceleration() * (Rotation2::new(self.mean_heading) * Vector2::x());
        self.motion.push(MotionSample {
            at: self.at,
            mean_heading: self.mean_heading,
            value: [
                v.x,
                v.y,
                b.get(HEAVE, ETA),
                north,
                east,
                self.slow.off(b.get(YAW, ETA)),
            ],
            rate: [b.get(HEAVE, NU), c * dr - s * dp, s * dr + c * dp, a.x, a.y],
            level_variance: b.variance(HEAVE, ETA).max(0.0),
        });
        self.measure_course();
    }

    /// Prediction from the identification's newest sample: modes about the mean, and a fading residual.
    pub(crate) fn prediction(
        &self,
        config: &VesselNodeConfig,
        header: Header<VesselClock>,
    ) -> Option<VesselPrediction<VesselClock>> {
        let course = self.course()?;
        let heave = self.motion.motion(0.0)[HEAVE][0];
        let begin = course.at(0.0).place;
        let origin = [begin.x, begin.y, heave + self.belief.get(HEAVE, GNSS_BIAS)];
        let stages = Seq::filled((0..PREDICTION_STAGES).map(|k| {
            let ahead = k as f64 * config.broadcast.prediction_step_s;
            let m = self.motion.motion(ahead);
            let point = course.at(ahead);
            let heel = self.motion.heel(point.mean_heading);
            let tilt = Tilt {
                angles: [m[ROLL][0] + heel[0], m[PITCH][0] + heel[1]],
                rates: [m[ROLL][1], m[PITCH][1]],
                heading: wrap_angle(point.heading),
                heading_rate: point.heading_rate,
            };
            let [roll, pitch, yaw] = tilt.euler();
            let rates = tilt.euler_rates();
            let [x, y] = (point.place - begin).into();
            let velocity = point.velocity;
            let eta = [x, y, m[HEAVE][0] - heave, roll, pitch, yaw];
            let eta_dot = [velocity.x, velocity.y, m[HEAVE][1], rates[0], rates[1], rates[2]];
            PredictedStage {
                eta: eta.map(|x| x as f32),
                eta_dot: eta_dot.map(f16::from_f64),
                sd: self.motion.spread(ahead).map(f16::from_f64),
                course_sd: self.course_deviation(ahead).map(f16::from_f64),
            }
        }));
        Some(VesselPrediction {
            header: Header {
                at: course.modes.at,
                ..header
            },
            step_s: config.broadcast.prediction_step_s as f32,
            origin,
            stages,
        })
    }

    /// Course ahead; None before the first sample.
    fn course(&self) -> Option<Course<'_>> {
        let b = &self.belief;
        let modes = self.motion.modes()?;
        let since = (self.at - modes.at).secs();
        let now = modes.motion(since);
        let velocity = self.ned(b.get(SURGE, NU), b.get(SWAY, NU));
        let yaw = wrap_angle(b.get(YAW, ETA) - self.mean_heading);
        Some(Course {
            modes,
            since,
            moved: path(modes, since),
            place: self.ned(b.get(SURGE, ETA), b.get(SWAY, ETA)),
            mean_velocity: self.mean_velocity,
            mean_heading: self.mean_heading,
            rate: self.mean_heading_rate,
            left: velocity - self.mean_velocity - Vector2::new(now[SURGE][0], now[SWAY][0]),
            left_yaw: wrap_angle(yaw - now[YAW][0]),
        })
    }

    /// Records the predicted course, and compares position and heading with earlier predictions.
    fn measure_course(&mut self) {
        let place = self.ned(self.belief.get(SURGE, ETA), self.belief.get(SWAY, ETA));
        let mut errors = core::mem::take(&mut self.course_errors);
        // The filter's heading does not wrap.
        let heading = self.belief.get(YAW, ETA);
        errors.compare(self.at, [place.x, place.y, heading]);
        if let Some(course) = self.course() {
            errors.push(self.at, |ahead| {
                let then = course.at(course.since + ahead);
                [
                    then.place.x,
                    then.place.y,
                    heading + wrap_angle(then.heading - heading),
                ]
            });
        }
        self.course_errors = errors;
    }
    /// Standard deviation that predicting position (north, east, m) and heading (rad) by `ahead` seconds adds
    /// to the estimate's own: as measured, or else derived from the uncertainty of the rates.
    fn course_deviation(&self, ahead: f64) -> [f64; 3] {
        let of_rate = |d| ahead * self.belief.variance(d, NU).max(0.0).sqrt();
        let measured = self.course_errors.deviation(ahead);
        measured.unwrap_or_else(|| [SURGE, SWAY, YAW].map(of_rate))
    }

    /// Mean water level in the GNSS frame, m down.
    pub(crate) fn level(&self) -> f64 {
        self.belief.get(HEAVE, GNSS_BIAS)
    }

    /// Standard deviation of heave about the mean water level (m), roll and pitch (rad) `ahead` seconds from
    /// now: estimate and prediction.
    pub(crate) fn deck_sd(&self, ahead: f64) -> [f64; 3] {
        let b = &self.belief;
        let propagated = self.motion.spread(ahead);
        let omega = self.motion.modes().and_then(|m| m.frequency());
        let [heave, roll, pitch] = [HEAVE, ROLL, PITCH].map(|d| {
            let now = b.variance(d, ETA).max(0.0);
            let Some(omega) = omega else {
                return propagated[d].hypot(now.sqrt());
            };
            // Rate errors accumulate over one radian of the waves.
            let within = |s: f64| (b.variance(d, NU).max(0.0) * s * s).min(now);
            if d == HEAVE {
                // A slow error of heave is an error of the level.
                return propagated[d].max(within(1.0 / omega).sqrt());
            }
            // Predictions are compared with later estimates, in which a slow error cancels, so it is added
            // here; a changing error is already part of the measured one.
            let changed = within(ahead.min(1.0 / omega));
            (propagated[d] * propagated[d])
                .max(changed)
                .sqrt()
                .hypot((now - changed).sqrt())
        });
        [heave.hypot(self.motion.slow_heave_variance().sqrt()), roll, pitch]
    }

    /// Whether the state is recent and finite, and the accelerometer works.
    pub(crate) fn can_publish(&self, config: &VesselNodeConfig, now: VesselTime) -> bool {
        self.motion_age(now) <= config.imu.timeout_s
            && self.measures_gravity(config)
            && self.belief.variance(YAW, NU).is_finite()
            && self.belief.is_finite()
    }
}
