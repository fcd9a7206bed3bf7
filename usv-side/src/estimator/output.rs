//! Messages from the filter's state.

use alight_shared::frames::wrap_angle;
use alight_shared::msg::Seq;
use alight_shared::msg::{
    Header, PREDICTION_STAGES, PredictedStage, SLOPE_WINDOWS, VesselEstimate, VesselPrediction, WaveModel,
};
use alight_shared::time::{Span, Time, VesselClock};
use alight_shared::vessel_model::{
    ETA, HEAVE, Modes, NU, PITCH, ROLL, SURGE, SWAY, YAW, is_wave, motion, turn_tilt,
};
use nalgebra::{Rotation2, Vector2};

use super::prediction_scale::{self, AHEAD_S, COMPARED, Predicted};
use super::{Filter, GNSS_BIAS, STEP_S, Tilt};
use crate::VesselNodeConfig;
use crate::motion_model::{MotionSample, SPREAD_AT_S};

impl Filter {
    /// NED from the reference-parallel frame.
    fn ned(&self, x: f64, y: f64) -> Vector2<f64> {
        Rotation2::new(self.reference) * Vector2::new(x, y)
    }

    /// The estimate at `now`, at most a few steps after the state's time: rolled on by a
    /// second-order series.
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
        let (p, v, w) = (
            self.ned(eta[SURGE], eta[SWAY]),
            self.ned(nu[SURGE], nu[SWAY]),
            self.ned(a[SURGE], a[SWAY]),
        );
        // Rolling back by h: var(eta) grows by 2 h cov + h² var(nu).
        let cov = |d: usize| {
            let [e, c, n] = b.motion_covariance(d);
            [e + 2.0 * h * c + h * h * n, c + h * n, n]
        };
        let (s2, c2) = (self.reference.sin().powi(2), self.reference.cos().powi(2));
        let (cs, cw) = (cov(SURGE), cov(SWAY));
        let mix = |p: f64, q: f64| core::array::from_fn(|i| p * cs[i] + q * cw[i]);
        let blocks: [[f64; 3]; 6] = [
            mix(c2, s2),
            mix(s2, c2),
            {
                let [e, c, n] = cov(HEAVE);
                let (with_eta, with_nu, own) = self.level_covariance();
                [e + 2.0 * with_eta + own, c + with_nu, n]
            },
            cov(ROLL),
            cov(PITCH),
            cov(YAW),
        ];
        VesselEstimate {
            header,
            datum: self.datum,
            eta: [p.x, p.y, eta[HEAVE] + level, roll, pitch, wrap_angle(eta[YAW])],
            eta_dot: [v.x, v.y, nu[HEAVE], rates[0], rates[1], rates[2]].map(|x| x as f32),
            eta_ddot: [w.x, w.y, a[HEAVE], a[ROLL], a[PITCH], a[YAW]].map(|x| x as f32),
            covariance: blocks.map(|b| b.map(|x| x as f32)),
            deck_centre: config.deck.centre_m.map(|x| x as f32),
            mean_velocity: [self.mean_velocity.x as f32, self.mean_velocity.y as f32],
            mean_heading: [self.mean_heading as f32, self.mean_heading_rate as f32],
        }
    }

    /// Covariance of the height's reference with heave and its rate, and its variance.
    fn level_covariance(&self) -> (f64, f64, f64) {
        let b = &self.belief;
        (
            b.covariance((HEAVE, ETA), (HEAVE, GNSS_BIAS)),
            b.covariance((HEAVE, NU), (HEAVE, GNSS_BIAS)),
            b.variance(HEAVE, GNSS_BIAS),
        )
    }

    /// The wave model, valid at the state's own time, with the apparent slopes of the deck.
    pub(crate) fn wave_model(
        &self,
        header: Header<VesselClock>,
        slopes: Seq<u8, SLOPE_WINDOWS>,
    ) -> WaveModel<VesselClock> {
        WaveModel {
            header: Header {
                at: self.at,
                ..header
            },
            significant_height_m: self.sea.significant_height_m.clamp(0.0, 50.0) as f32,
            confidence: self.sea.confidence.clamp(0.0, 1.0) as f32,
            wave_following_deficit: self.bound_waves.wave_following_deficit() as f32,
            crest_steepening: self.bound_waves.nonlinearity().crest_steepening as f32,
            components: self.belief.wave_message(self.reference),
            slopes,
        }
    }

    /// The prediction from the state's own time on.
    pub(crate) fn prediction(
        &self,
        config: &VesselNodeConfig,
        header: Header<VesselClock>,
    ) -> VesselPrediction<VesselClock> {
        let b = &self.belief;
        let start = self.ned(b.get(SURGE, ETA), b.get(SWAY, ETA));
        let heave = b.get(HEAVE, ETA);
        let origin = [start.x, start.y, heave + b.get(HEAVE, GNSS_BIAS)];
        let (with_eta, _, own) = self.level_covariance();
        let (s2, c2) = (self.reference.sin().powi(2), self.reference.cos().powi(2));
        let ahead: [[f64; PREDICTION_STAGES]; 6] = core::array::from_fn(|d| self.variances_ahead(d));
        let without_bound_waves = self.without_bound_waves();
        let modes = self.motion.modes().filter(|_| self.motion.is_better());
        let stages = Seq::filled((0..PREDICTION_STAGES).map(|k| {
            let mut m = self.predicted(&without_bound_waves, k);
            let mut var: [f64; 6] = core::array::from_fn(|d| ahead[d][k]);
            if let Some(modes) = &modes {
                let t = k as f64 * config.broadcast.prediction_step_s;
                let sd = self.modal_sd(t);
                for (d, motion) in self.modal_motion(modes, t) {
                    m[d] = motion;
                    var[d] = sd[d] * sd[d];
                }
            }
            let tilt = Tilt {
                angles: [m[ROLL][0], m[PITCH][0]],
                rates: [m[ROLL][1], m[PITCH][1]],
                heading: wrap_angle(m[YAW][0] - self.reference),
                heading_rate: m[YAW][1],
            };
            let [roll, pitch, _] = tilt.euler();
            let rates = tilt.euler_rates();
            let (p, v) = (
                self.ned(m[SURGE][0], m[SWAY][0]),
                self.ned(m[SURGE][1], m[SWAY][1]),
            );
            let sd = [
                c2 * var[SURGE] + s2 * var[SWAY],
                s2 * var[SURGE] + c2 * var[SWAY],
                // The correlation of today's level with heave fades with the hull's own motion.
                var[HEAVE] + own + if k == 0 { 2.0 * with_eta } else { 0.0 },
                var[ROLL],
                var[PITCH],
                var[YAW],
            ];
            PredictedStage {
                eta: [
                    p.x - origin[0],
                    p.y - origin[1],
                    m[HEAVE][0] - heave,
                    roll,
                    pitch,
                    wrap_angle(m[YAW][0]),
                ]
                .map(|x| x as f32),
                eta_dot: [v.x, v.y, m[HEAVE][1], rates[0], rates[1], rates[2]].map(|x| x as f32),
                sd: sd.map(|x| x.max(0.0).sqrt() as f32),
            }
        }));
        VesselPrediction {
            header: Header {
                at: self.at,
                ..header
            },
            step_s: config.broadcast.prediction_step_s as f32,
            origin,
            stages,
        }
    }

    /// Gives the identification the motion of this instant, and the waves' prediction to be compared with.
    pub(super) fn observe_motion(&mut self) {
        if !self.motion.is_due(self.at) {
            return;
        }
        let b = &self.belief;
        let v = self.ned(b.get(SURGE, NU), b.get(SWAY, NU)) - self.mean_velocity;
        let [north, east] = self.tilt_ned([b.get(ROLL, ETA), b.get(PITCH, ETA)]);
        let rates = Rotation2::new(self.reference) * Vector2::new(b.get(ROLL, NU), b.get(PITCH, NU));
        let heading = wrap_angle(b.get(YAW, ETA) - self.mean_heading);
        self.motion.push(MotionSample {
            at: self.at,
            value: [v.x, v.y, b.get(HEAVE, ETA), north, east, heading],
            rate: [b.get(HEAVE, NU), rates.x, rates.y],
        });
        if self.motion.compares() {
            let without_bound_waves = self.without_bound_waves();
            let step_s = self.horizon.step_s();
            let predicted = SPREAD_AT_S.map(|ahead| {
                let m = self.predicted(&without_bound_waves, (ahead / step_s).round() as usize);
                let [north, east] = self.tilt_ned([m[ROLL][0], m[PITCH][0]]);
                [0.0, 0.0, m[HEAVE][0], north, east, 0.0]
            });
            self.motion.compare_with(predicted);
        }
    }
    /// Roll and pitch as of a vessel that heads north, from those at the reference heading.
    fn tilt_ned(&self, [roll, pitch]: [f64; 2]) -> [f64; 2] {
        let (north, east) = turn_tilt(roll, pitch, -self.reference);
        [north, east]
    }

    /// Heave, roll and pitch at the reference heading by the modes, `ahead` seconds from the state's time.
    fn modal_motion(&self, modes: &Modes<VesselClock>, ahead: f64) -> [(usize, [f64; 3]); 3] {
        let t = (self.at - modes.at).secs() + ahead;
        let all = modes.motion(t);
        // A slow mode of heave is an error of its level.
        let waves = motion(modes.modes.iter().filter(|m| is_wave(m)), t);
        let (roll, pitch) = turn_tilt(all[ROLL][0], all[PITCH][0], self.reference);
        let turned = |k: usize| Rotation2::new(-self.reference) * Vector2::new(all[ROLL][k], all[PITCH][k]);
        let (rate, acceleration) = (turned(1), turned(2));
        [
            (HEAVE, waves[HEAVE]),
            (ROLL, [roll, rate.x, acceleration.x]),
            (PITCH, [pitch, rate.y, acceleration.y]),
        ]
    }
    /// Standard deviation of what the modes predict `ahead` seconds from now.
    fn modal_sd(&self, ahead: f64) -> [f64; 6] {
        let now = core::array::from_fn(|d| self.belief.variance(d, ETA).max(0.0).sqrt());
        self.motion.spread(now, ahead)
    }

    /// Mean water level in the GNSS frame, m down, and standard deviation of heave about it at stage `k` of the
    /// prediction, m.
    pub(crate) fn level_and_heave_sd(&self, k: usize) -> (f64, f64) {
        let b = &self.belief;
        let variance = if self.motion.modes().is_some() && self.motion.is_better() {
            self.modal_sd(k as f64 * self.horizon.step_s())[HEAVE].powi(2)
        } else {
            self.variances_ahead(HEAVE).get(k).copied().unwrap_or(0.0)
        };
        (b.get(HEAVE, GNSS_BIAS), variance.max(0.0).sqrt())
    }

    /// The stage of a prediction that is [`AHEAD_S`] ahead, where there is one.
    fn compared_stage(&self) -> Option<usize> {
        let step = self.horizon.step_s();
        let k = (AHEAD_S / step).round();
        ((k * step - AHEAD_S).abs() < 1e-9 && k as usize <= self.horizon.stages()).then_some(k as usize)
    }

    /// Growth of the variance of a degree of freedom until stage `k`: the waves' part and the disturbance's.
    fn variance_growth(&self, dof: usize, k: usize) -> (f64, f64) {
        let variance = |k| self.horizon.covariance(&self.belief, dof, k)[0];
        let all = variance(k) - variance(0);
        let t = k as f64 * self.horizon.step_s();
        let own = prediction_scale::disturbance(self.model.config(), dof, t).min(all.max(0.0));
        (all - own, own)
    }

    /// Variance of a degree of freedom at each stage of a prediction: the present one, the disturbance's growth,
    /// and the waves' growth scaled by the errors of the last predictions.
    fn variances_ahead(&self, dof: usize) -> [f64; PREDICTION_STAGES] {
        let factor = match self.compared_stage() {
            Some(k) => self.prediction_scale.factor(dof, self.variance_growth(dof, k).0),
            None => 1.0,
        };
        let now = self.horizon.covariance(&self.belief, dof, 0)[0];
        // A horizon of another model has infinite variances, whose differences are NaN.
        if !now.is_finite() {
            return [f64::INFINITY; PREDICTION_STAGES];
        }
        core::array::from_fn(|k| {
            let (waves, own) = self.variance_growth(dof, k);
            // A variance that shrinks for a while (a phase that becomes better known) is not scaled.
            now + own + if waves > 0.0 { factor * waves } else { waves }
        })
    }

    /// Compares the predictions that are due with the state, and makes new ones.
    pub(super) fn check_predictions(&mut self) {
        let now = COMPARED.map(|d| self.belief.get(d, ETA));
        self.prediction_scale
            .compare(self.at, self.reference, now, Span::from_secs(0.5 * STEP_S));
        let Some(k) = self.compared_stage() else { return };
        if self.prediction_scale.is_due(self.at) {
            let mean = self.predicted(&self.without_bound_waves(), k);
            let predicted = COMPARED.map(|d| {
                let (waves, disturbance) = self.variance_growth(d, k);
                Predicted {
                    mean: mean[d][0],
                    waves: waves.max(0.0),
                    disturbance,
                }
            });
            self.prediction_scale.push(self.at, self.reference, predicted);
        }
    }

    /// The state is recent and finite.
    pub(crate) fn can_publish(&self, config: &VesselNodeConfig, now: Time<VesselClock>) -> bool {
        self.motion_age(now) <= config.imu.timeout_s
            && self.belief.variance(YAW, NU).is_finite()
            && self.belief.is_finite()
    }
}
