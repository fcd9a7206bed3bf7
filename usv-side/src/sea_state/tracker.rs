//! The identifier: refine what is known, drop what explains nothing, try one more.

use core::f64::consts::{PI, TAU};
use core::fmt;

use alight_shared::frames::wrap_angle;
use alight_shared::geometry::GRAVITY;
use alight_shared::msg::MAX_COMPONENTS;
use alight_shared::msg::Seq;
use alight_shared::time::{Time, VesselClock};
use alight_shared::vessel_model::WaveNonlinearity;
use nalgebra::Complex;

use super::direction::{direction_of, from_encounter};
use super::fit::{DirectionPrior, Fitter, Solution, Wave};
use super::record::{CHANNELS, Record};
use super::spectrum::{Peak, Spectrum};
use super::{SeaComponent, SeaState, SeaStateConfig, Verdict};

/// Passes over the record to follow known components.
const TRACK_PASSES: usize = 2;
/// Passes over the record to refine a new hypothesis.
const TRIAL_PASSES: usize = 6;
/// New hypotheses per update: one at the residual's peak, one split.
const TRIALS: u64 = 2;
/// Memory of the prediction error that sets the length of the record, s.
const SHORT_MEMORY_S: f64 = 4.0;
/// Memory of the prediction error by which two trackers are compared, s.
const MEMORY_S: f64 = 10.0;
/// Unexplained fraction of the motion above which all components are searched again.
const STUCK: f64 = 0.25;
/// Half the way in the record from which a vessel is under way, m.
const UNDER_WAY_M: f64 = 15.0;
/// A state older than this is not given out any more, s.
const STALE_S: f64 = 5.0;

/// The components that describe one part of the record, the newest.
#[derive(Clone)]
pub(super) struct Tracker {
    pub(super) config: SeaStateConfig,
    pub(super) fitter: Fitter,
    spectrum: Spectrum,
    residuals: [Vec<f64>; CHANNELS],
    pub(super) waves: Vec<Wave>,
    /// The components where they are known instead of identified, for studies.
    known_waves: Option<Vec<Wave>>,
    rounds: u64,
    state: Option<SeaState>,
    window_s: f64,
    /// Mean squared prediction error of the last states, relative to the motion.
    prediction_error: f64,
    /// The same over [`MEMORY_S`].
    long_prediction_error: f64,
    /// Residual variances not worth a component, per channel.
    negligible: [f64; CHANNELS],
    drift: [f64; 2],
    /// Variance of each channel about its trend.
    variance: [f64; CHANNELS],
    /// Share of the water's orbital motion that passes under the hull.
    pub(super) nonlinearity: WaveNonlinearity,
}

impl fmt::Debug for Tracker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tracker")
            .field("config", &self.config)
            .field("window_s", &self.window_s)
            .field("waves", &self.waves)
            .field("state", &self.state)
            .finish_non_exhaustive()
    }
}

impl Tracker {
    /// A tracker without a record.
    pub fn new(config: &SeaStateConfig) -> Self {
        let bins = (config.window_s / config.bin_s).ceil().clamp(16.0, 2048.0) as usize;
        Tracker {
            config: config.clone(),
            fitter: Fitter::default(),
            spectrum: Spectrum::new(bins + 1, config.bin_s),
            residuals: Default::default(),
            waves: Vec::with_capacity(MAX_COMPONENTS + 1),
            known_waves: None,
            rounds: 0,
            state: None,
            window_s: config.window_s,
            prediction_error: 0.0,
            long_prediction_error: 1.0,
            negligible: [0.0; CHANNELS],
            drift: [0.0; 2],
            variance: [0.0; CHANNELS],
            nonlinearity: WaveNonlinearity::default(),
        }
    }

    /// A tracker with known angular frequency (rad/s) and direction (rad) of every component: it fits amplitudes
    /// and phases only. For studies of what not knowing them costs: no
    /// configuration leads here.
    pub fn with_known_waves(config: &SeaStateConfig, components: &[(f64, f64)]) -> Self {
        let wave = |&(omega, direction): &(f64, f64)| Wave { omega, direction };
        Tracker {
            known_waves: Some(components.iter().take(MAX_COMPONENTS).map(wave).collect()),
            ..Self::new(config)
        }
    }

    /// The newest state.
    pub fn state(&self) -> Option<&SeaState> {
        self.state.as_ref()
    }
    /// Mean squared error of the predicted tilt over the last seconds, relative to the motion, 0 to 2.
    pub fn long_prediction_error(&self) -> f64 {
        self.long_prediction_error
    }
    /// It uses the longest record there may be.
    pub fn uses_all(&self) -> bool {
        self.window_s >= self.config.window_s
    }

    /// Identifies anew from the `whole` record or from as much of it as predicts well; no state
    /// before `min_window_s` of record and when the record has gone stale.
    pub fn work(
        &mut self,
        record: &Record,
        now: Time<VesselClock>,
        whole: bool,
        nonlinearity: WaveNonlinearity,
    ) {
        let Some(newest) = record.newest() else {
            self.state = None;
            return;
        };
        if record.span_s() < self.config.min_window_s || (record.elapsed(now) - newest).abs() > STALE_S {
            self.state = None;
            return;
        }
        self.nonlinearity = nonlinearity;
        self.adapt_window(record);
        if whole {
            self.window_s = self.config.window_s;
        }
        self.fitter.rows.load(record.bins(), self.window_s, &self.waves);
        self.state = self.identify(record);
        self.rounds += 1;
    }

    /// The used part of the record grows while the last state predicts the motion since, and shrinks when it does
    /// not: only the newest part describes a changed or a broad sea.
    fn adapt_window(&mut self, record: &Record) {
        let Some(state) = &self.state else {
            self.window_s = self.config.window_s;
            (self.prediction_error, self.long_prediction_error) = (0.0, 1.0);
            return;
        };
        let from = record.elapsed(state.at);
        let velocity = self.fitter.rows.velocity_at_end();
        let (mut error, mut signal, mut n) = (0.0, 0.0, 0);
        for bin in record.bins().filter(|b| b.t > from) {
            let mut tilt = self.drift;
            for c in state.components.iter() {
                let turn = Complex::from_polar(1.0, c.encounter(velocity) * (bin.t - from));
                tilt[0] += (c.normal[0] * turn).re;
                tilt[1] += (c.normal[1] * turn).re;
            }
            let [_, roll, pitch] = state.bound(self.nonlinearity, velocity, bin.t - from).value;
            tilt[0] -= pitch;
            tilt[1] += roll;
            for i in 0..2 {
                error += (bin.y[1 + i] - tilt[i]).powi(2);
            }
            n += 1;
        }
        for c in state.components.iter() {
            signal += 0.5 * c.amplitude_tilt_rad.powi(2);
        }
        let floor = self.config.tilt_noise_rad.powi(2);
        if n > 0 {
            let ratio = error / f64::from(n) / (signal + 10.0 * floor);
            let share = |memory_s: f64| (self.config.update_period_s / memory_s).min(1.0);
            self.prediction_error += share(SHORT_MEMORY_S) * (ratio.min(2.0) - self.prediction_error);
            self.long_prediction_error += share(MEMORY_S) * (ratio.min(2.0) - self.long_prediction_error);
        }
        let period = self.config.update_period_s;
        let span = record.span_s();
        self.window_s = if self.prediction_error > 0.15 {
            (self.window_s.min(span) - 4.0 * period).max(self.config.short_window_s)
        } else if self.prediction_error < 0.05 {
            (self.window_s + period).min(self.config.window_s)
        } else {
            self.window_s
        };
    }

    /// Smallest plausible noise variances, per channel.
    fn floors(&self) -> [f64; CHANNELS] {
        let tilt = self.config.tilt_noise_rad.powi(2);
        [self.config.acceleration_noise_mps2.powi(2), tilt, tilt]
    }

    fn identify(&mut self, record: &Record) -> Option<SeaState> {
        let n = self.fitter.rows.len() as f64;
        let floors = self.floors();
        self.fitter.weights = floors.map(|v| 1.0 / v);
        self.fitter.ridge = 0.0;
        let still = self.fitter.solve(&[], &[])?;
        let variance = still.residual.map(|r| r / n);
        self.variance = variance;
        self.negligible = core::array::from_fn(|c| floors[c] + self.config.negligible * variance[c]);
        let gate = [
            self.config.calm_acceleration_mps2.powi(2),
            self.config.calm_tilt_rad.powi(2),
            self.config.calm_tilt_rad.powi(2),
        ];
        if (0..CHANNELS).all(|c| variance[c] < gate[c]) {
            self.waves.clear();
            self.drift = [still.level_at_end(1), still.level_at_end(2)];
            return Some(self.report(record, &still, &[], Verdict::Calm));
        }

        if let Some(known) = self.known_waves.clone() {
            let first = self.fitter.solve(&known, &[])?;
            self.reweigh(&first, variance);
            let best = self.fitter.solve(&known, &[])?;
            let priors = self.priors(&best);
            self.drift = [best.level_at_end(1), best.level_at_end(2)];
            self.waves = known;
            return Some(self.report(record, &best, &priors, Verdict::Identified));
        }

        // Start from what was known; the weights follow from what it leaves unexplained.
        let mut best = match self.fitter.solve(&self.waves.clone(), &[]) {
            Some(s) => s,
            None => still.clone(),
        };
        self.remove_bound_waves(&mut best);
        self.reweigh(&best, variance);
        let mut priors = self.priors(&best);
        self.fitter.rescore(&mut best, &priors);
        best = self.fitter.refine(best, &priors, self.limits(), TRACK_PASSES);
        self.prune(&mut best, &mut priors);
        for attempt in 0..TRIALS {
            self.explore(&mut best, &mut priors, self.rounds * TRIALS + attempt);
        }
        self.start_anew(&mut best, &mut priors);
        self.settle_directions(&mut best);
        self.drift = [best.level_at_end(1), best.level_at_end(2)];
        self.waves.clone_from(&best.waves);
        Some(self.report(record, &best, &priors, Verdict::Identified))
    }

    fn limits(&self) -> (f64, f64) {
        (self.config.omega_min_radps, self.config.omega_max_radps)
    }

    /// Weights from the residual of `s`, between the sensors' noise and the signal itself.
    fn reweigh(&mut self, s: &Solution, variance: [f64; CHANNELS]) {
        let n = self.fitter.rows.len() as f64;
        let floors = self.floors();
        let mut ridge: f64 = 0.0;
        for c in 0..CHANNELS {
            let noise = (s.residual[c] / n).max(floors[c]);
            self.fitter.weights[c] = 1.0 / noise;
            ridge = ridge.max((0.25 * noise / variance[c].max(floors[c])).min(0.25));
        }
        self.fitter.ridge = ridge;
    }

    /// Directions from the amplitudes: with elevation `zeta` and `n = i k d zeta`,
    /// `a_up = -omega_e^2 zeta`, the normal's part in quadrature with the heave points along `d`.
    fn priors(&self, s: &Solution) -> Vec<DirectionPrior> {
        (0..s.waves.len())
            .map(|j| {
                direction_of(
                    core::array::from_fn(|c| s.phasor(c, j)),
                    core::array::from_fn(|c| s.phasor_variance(j) / self.fitter.weights[c] * self.colour()),
                )
            })
            .collect()
    }

    /// Residuals are no white noise: so many bins count as one independent sample.
    fn colour(&self) -> f64 {
        let independent = 2.0 * self.config.residual_band_hz * self.fitter.rows.span_s;
        (self.fitter.rows.len() as f64 / independent.max(1.0)).max(1.0)
    }

    /// Bayesian information criterion (Schwarz 1978) for a change of model: true when `after`, with
    /// `extra` more components than `before`, is the better one.
    fn better(&self, before: &Solution, after: &Solution, extra: f64) -> bool {
        let n = self.fitter.rows.len() as f64;
        let floors = self.negligible;
        let independent = n / self.colour();
        let log_ratio: [f64; CHANNELS] = core::array::from_fn(|c| {
            ((before.residual[c] / n + floors[c]) / (after.residual[c] / n + floors[c])).ln()
        });
        let pays = |log_ratio: f64, channels: usize| {
            let per_component = (2 * channels + 1) as f64;
            let penalty = extra * per_component * (channels as f64 * independent).ln();
            independent * log_ratio > penalty.max(0.02 * independent)
        };
        // A platform that rocks by itself heaves with waves that its tilt knows nothing of: such a
        // component has the parameters of one channel only, and may cost the others no likelihood.
        let others = independent * (log_ratio[1] + log_ratio[2]);
        pays(log_ratio.iter().sum(), CHANNELS) || !self.under_way() && pays(log_ratio[0], 1) && others > -1.0
    }

    /// On a course every turn shifts all encounters at once: more components fit that better than the
    /// sea (square path at 2 m/s in a slight sea, 40 landings: 0.161 m and 2 failures against 0.138 m
    /// and none), so nothing is taken for a wave there that tilt does not show.
    fn under_way(&self) -> bool {
        self.fitter.rows.reach_m > UNDER_WAY_M
    }

    /// Drops components that explain too little or that have run into each other.
    fn prune(&mut self, best: &mut Solution, priors: &mut Vec<DirectionPrior>) {
        for _ in 0..MAX_COMPONENTS {
            let cycles = if self.under_way() {
                self.config.min_separation_under_way
            } else {
                self.config.min_separation
            };
            let closest = TAU * cycles / self.fitter.rows.span_s.max(1.0);
            let mut worst: Option<(usize, Solution)> = None;
            for j in 0..best.waves.len() {
                let Some(s) = self.fitter.without(best, j, priors) else {
                    continue;
                };
                let crowded = (0..best.waves.len())
                    .any(|i| i != j && (best.waves[i].omega - best.waves[j].omega).abs() < closest);
                let droppable = crowded || !self.better(&s, best, 1.0);
                if droppable && worst.as_ref().is_none_or(|(_, w)| s.cost < w.cost) {
                    worst = Some((j, s));
                }
            }
            let Some((j, s)) = worst else { return };
            *best = s;
            priors.remove(j);
        }
    }

    /// Tries one more component: at the residual's strongest peak or by splitting one. True if the
    /// model changed.
    fn explore(&mut self, best: &mut Solution, priors: &mut Vec<DirectionPrior>, round: u64) -> bool {
        let n = self.fitter.rows.len() as f64;
        if (0..CHANNELS).all(|c| best.residual[c] / n < 1.2 * self.negligible[c]) {
            return false;
        }
        let k = best.waves.len();
        let split = k > 0 && round % 2 == 1;
        let mut waves = best.waves.clone();
        let mut trial_priors = priors.clone();
        if split {
            // Each in turn, and on a course each with both, then neither, order of directions.
            let j = (round / 2) as usize % k;
            let fan = [0.2, -0.2][(round / 2) as usize / k % 2];
            let apart = TAU * 0.3 / self.fitter.rows.span_s;
            let twin = Wave {
                omega: waves[j].omega + apart,
                direction: waves[j].direction - fan,
            };
            waves[j].omega -= apart;
            waves[j].direction += fan;
            waves.push(twin);
            trial_priors.push(DirectionPrior { sd: 1.0, ..priors[j] });
            trial_priors[j].sd = 1.0;
        } else {
            self.fitter.residuals(best, &mut self.residuals);
            // Every other time in the heave alone: there the tilt's harmonics do not hide it.
            let mut weights = self.fitter.weights;
            if (round / 2) % 2 == 1 && !self.under_way() {
                weights[1..].fill(0.0);
            }
            let limits = self.limits();
            let Some(peak) = self
                .spectrum
                .peak(&self.residuals, &self.fitter.rows.slot, &weights, limits)
            else {
                return false;
            };
            let wave = self.earth_frame(&peak);
            trial_priors.push(DirectionPrior {
                mean: wave.direction,
                sd: 1.0,
            });
            waves.push(wave);
        }
        let Some(start) = self.fitter.solve(&waves, &trial_priors) else {
            return false;
        };
        let mut trial = self
            .fitter
            .refine(start, &trial_priors, self.limits(), TRIAL_PASSES);
        let mut extra = 1.0;
        if k >= MAX_COMPONENTS {
            // No room: the weakest goes.
            let weakest = (0..trial.waves.len())
                .filter_map(|j| self.fitter.without(&trial, j, &trial_priors).map(|s| (j, s)))
                .min_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
            let Some((j, s)) = weakest else { return false };
            trial = s;
            trial_priors.remove(j);
            extra = 0.0;
        }
        if !self.better(best, &trial, extra) {
            return false;
        }
        *best = trial;
        *priors = trial_priors;
        self.prune(best, priors);
        true
    }

    /// Components found one after the other in a short record may be none of the sea's, and no single step leads away
    /// from them. While much of the motion is unexplained, all are searched again, the strongest first, and accepted
    /// when they explain more.
    fn start_anew(&mut self, best: &mut Solution, priors: &mut Vec<DirectionPrior>) {
        if self.unexplained(best) < STUCK {
            return;
        }
        let Some(mut trial) = self.fitter.solve(&[], &[]) else {
            return;
        };
        let mut trial_priors: Vec<DirectionPrior> = Vec::with_capacity(MAX_COMPONENTS);
        for _ in 0..MAX_COMPONENTS {
            self.fitter.residuals(&trial, &mut self.residuals);
            let (slots, weights, limits) = (&self.fitter.rows.slot, &self.fitter.weights, self.limits());
            let Some(peak) = self.spectrum.peak(&self.residuals, slots, weights, limits) else {
                break;
            };
            let wave = self.earth_frame(&peak);
            let mut waves = trial.waves.clone();
            waves.push(wave);
            trial_priors.push(DirectionPrior {
                mean: wave.direction,
                sd: 1.0,
            });
            let Some(start) = self.fitter.solve(&waves, &trial_priors) else {
                break;
            };
            trial = self
                .fitter
                .refine(start, &trial_priors, self.limits(), TRIAL_PASSES);
        }
        trial_priors.truncate(trial.waves.len());
        let extra = trial.waves.len() as f64 - best.waves.len() as f64;
        if self.better(best, &trial, extra) {
            *best = trial;
            *priors = trial_priors;
            self.prune(best, priors);
        }
    }

    /// The earth-frame wave of a peak: direction from the phasors, frequency from
    /// `omega_e = omega - omega^2 u / g` solved for the branch that tends to `omega_e` at `u = 0`.
    fn earth_frame(&self, peak: &Peak) -> Wave {
        let direction = direction_of(peak.phasors, [0.0; CHANNELS]).mean;
        let rows = &self.fitter.rows;
        let slope = |x: &[f64]| match (x.first(), x.last()) {
            (Some(a), Some(b)) => (b - a) / rows.span_s.max(1.0),
            (Some(_), None) | (None, Some(_)) | (None, None) => 0.0,
        };
        let (sin, cos) = direction.sin_cos();
        let along = cos * slope(&rows.path[0]) + sin * slope(&rows.path[1]);
        Wave {
            omega: from_encounter(peak.omega, along),
            direction,
        }
    }

    /// Without a path the phases hold no information on directions: the amplitudes alone decide.
    fn settle_directions(&self, s: &mut Solution) {
        let limits = self.limits();
        if !self.fitter.rows.moving {
            let priors = self.priors(s);
            let velocity = self.fitter.rows.velocity_at_end();
            for (w, p) in s.waves.iter_mut().zip(priors) {
                // The frequency of encounter is what was fitted.
                let along = |direction: f64| velocity[0] * direction.cos() + velocity[1] * direction.sin();
                let encounter = w.omega - w.omega * w.omega / GRAVITY * along(w.direction);
                w.direction = p.mean;
                w.omega = from_encounter(encounter, along(p.mean)).clamp(limits.0, limits.1);
            }
        }
        for w in &mut s.waves {
            w.direction = wrap_angle(w.direction);
        }
    }

    /// Share of the motion's variance that a fit leaves unexplained, 0 to 1; channels with signal only.
    fn unexplained(&self, s: &Solution) -> f64 {
        let (n, floors) = (self.fitter.rows.len() as f64, self.floors());
        let (mut left, mut all) = (0.0, 0.0);
        for c in 0..CHANNELS {
            all += self.variance[c] / floors[c];
            left += (s.residual[c] / n / floors[c] - 1.0).max(0.0);
        }
        if s.waves.is_empty() {
            return 1.0;
        }
        (left / all.max(1e-9)).clamp(0.0, 1.0)
    }

    fn report(&self, record: &Record, s: &Solution, priors: &[DirectionPrior], verdict: Verdict) -> SeaState {
        let newest = record.newest().unwrap_or(0.0);
        let at = record.instant(newest);
        let [north, east] = self.fitter.rows.end();
        let u = self.fitter.rows.velocity_at_end();
        let deviations = self.fitter.deviations(s, priors);
        let fresh = self.priors(s);
        let k = s.waves.len();
        let mut components: Vec<SeaComponent> = Vec::with_capacity(k);
        for (j, w) in s.waves.iter().enumerate() {
            let number = w.omega * w.omega / GRAVITY;
            let (sin, cos) = w.direction.sin_cos();
            let phase = w.omega * (newest - self.fitter.rows.middle) - number * (cos * north + sin * east);
            let turn = Complex::from_polar(1.0, phase);
            let mut component = SeaComponent {
                omega: w.omega,
                direction: w.direction,
                ..SeaComponent::default()
            };
            (component.heave, component.normal) = self.phasors(s, (j, w), turn, u);
            component.amplitude_heave_m = component.heave.norm();
            component.amplitude_tilt_rad = component.normal[0].norm().hypot(component.normal[1].norm());
            component.direction_sd = deviations
                .as_ref()
                .and_then(|d| d.get(k + j))
                .copied()
                .unwrap_or(fresh[j].sd)
                .min(PI);
            components.push(component);
        }
        components.sort_by(|a, b| {
            (b.amplitude_tilt_rad + 0.1 * b.amplitude_heave_m)
                .total_cmp(&(a.amplitude_tilt_rad + 0.1 * a.amplitude_heave_m))
        });
        let maturity = ((self.fitter.rows.span_s - 10.0) / 30.0).clamp(0.0, 1.0);
        // A slamming hull leaves half of its vertical acceleration unexplained while its tilt is predicted well: the
        // prediction error counts as much as the unexplained fraction.
        let doubt = self.unexplained(s).min(self.long_prediction_error);
        let confidence = maturity * (1.0 - doubt / 0.6).clamp(0.0, 1.0);
        let heave_variance: f64 = components.iter().map(|c| 0.5 * c.amplitude_heave_m.powi(2)).sum();
        SeaState {
            at,
            mean_velocity: u,
            adrift: self.fitter.rows.adrift,
            verdict: match verdict {
                Verdict::Identified if confidence < 0.15 => Verdict::Broad,
                v @ (Verdict::Calm | Verdict::Broad | Verdict::Identified) => v,
            },
            components: Seq::filled(components),
            significant_height_m: 4.0 * heave_variance.sqrt(),
            confidence: match verdict {
                Verdict::Calm => maturity,
                Verdict::Broad | Verdict::Identified => confidence,
            },
        }
    }
}
