//! Forecast of the deck's motion over the horizon, from the current state of the filters.

use alight_shared::{
    geometry::GRAVITY,
    msg::{DeckStage, FORECAST_STAGES, PREDICTED_SLOPES, SLOPE_STEP, Seq},
    time::DroneTime,
    vessel_model::turn_tilt,
};
use nalgebra::{Rotation2, Rotation3, Vector2, Vector3};

use super::{
    axis::{Axis, AxisNoise, DRIFT, HEAD, Head, MAX_STATES, MEAN, OscillatorStep, RATE, VISION, compass},
    lever_arm_heave::lever_arm_heave,
    waves::{AXES, DeckMotion, Oscillator, TILT, Waves},
};

/// Stages at which the variance is computed; the others are interpolated.
const KNOTS: [usize; 9] = [0, 2, 5, 10, 15, 20, 26, 33, 40];
/// Minimum normal force per mass, m/s², below which nothing stays on the deck.
const MIN_NORMAL_MPS2: f64 = 0.5;
/// Half-width of the averaging window of the apparent slope, in steps; the window lasts a second.
const SLOPE_STEPS: usize = 2;
/// Minimum speed at which a turn bends the path, m/s.
pub(super) const STEERAGE_MPS: f64 = 0.3;

#[derive(Clone, Debug)]
pub struct Horizon {
    oscillators: Vec<Oscillator>,
    stage_s: f64,
    stage: OscillatorStep,
    knots: Vec<OscillatorStep>,
}

impl Horizon {
    pub fn new(oscillators: &[Oscillator], stage_s: f64) -> Self {
        Horizon {
            oscillators: oscillators.to_vec(),
            stage_s,
            stage: OscillatorStep::new(oscillators, stage_s),
            knots: KNOTS
                .iter()
                .map(|&k| OscillatorStep::new(oscillators, k as f64 * stage_s))
                .collect(),
        }
    }
    /// Recomputes the transitions if the oscillators have changed.
    pub fn refresh(&mut self, oscillators: &[Oscillator]) {
        let frequencies = |o: &Oscillator| (o.omega, o.damping);
        if !self
            .oscillators
            .iter()
            .map(frequencies)
            .eq(oscillators.iter().map(frequencies))
        {
            *self = Horizon::new(oscillators, self.stage_s);
        }
        self.oscillators.copy_from_slice(oscillators);
    }

    /// Stages of the forecast from the state `axes` at `now`. `common`: variances (value, rate) of constant errors by
    /// degree of freedom; `clock_var`: variance of the clock (s²), which shifts everything along its motion; `waves`:
    /// modes, and position of the deck on the vessel.
    pub fn stages(
        &self,
        axes: &[Axis; AXES],
        noise: &[AxisNoise; AXES],
        common: &[(f64, f64); AXES],
        clock_var: f64,
        (waves, now): (&Waves, DroneTime),
    ) -> Seq<DeckStage, FORECAST_STAGES> {
        let mut mean: [[f64; MAX_STATES]; AXES] = core::array::from_fn(|i| axes[i].x);
        let heads: [Head; AXES] = core::array::from_fn(|i| Head::new(&noise[i], self.stage_s));
        let knots: [[[f64; 3]; KNOTS.len()]; AXES] =
            core::array::from_fn(|i| core::array::from_fn(|k| self.variance(&axes[i], &noise[i], i, k)));
        let mut modes = waves.modes(now, self.stage_s);
        let variance = waves.variance(now);
        let mut out = Seq::new();
        let mut knot = 0;
        for k in 0..FORECAST_STAGES {
            if k > 0 {
                self.advance(&mut mean, &heads);
                modes.advance();
            }
            let predicted = variance(k as f64 * self.stage_s);
            let square = self.oscillators.first().map_or(0.0, |o| o.omega * o.omega);
            while knot + 2 < KNOTS.len() && KNOTS[knot + 1] < k {
                knot += 1;
            }
            let a = KNOTS[knot] as f64;
            let b = KNOTS[knot + 1] as f64;
            let f = ((k as f64 - a) / (b - a)).clamp(0.0, 1.0);
            let stage = self.stage(
                &mean,
                |i| {
                    let p = knots[i][knot];
                    let q = knots[i][knot + 1];
                    let of_modes = [1.0, square, square * square].map(|w| predicted[i] * w);
                    let common = [common[i].0, common[i].1, 0.0];
                    core::array::from_fn(|k| p[k] + f * (q[k] - p[k]) + common[k] + of_modes[k])
                },
                clock_var,
                waves.lever_arm(),
                &modes.motion(),
            );
            if out.push(stage).is_err() {
                break;
            }
        }
        out
    }

    /// Apparent slope of the deck at each stage, in steps of [`SLOPE_STEP`]: `f_xy / |f_z|`, where the specific force
    /// `f = R^T (a - g)` in the deck's axes is rotated to north and east.
    pub fn slopes(
        &self,
        axes: &[Axis; AXES],
        noise: &[AxisNoise; AXES],
        (waves, now): (&Waves, DroneTime),
    ) -> Seq<[i8; 2], PREDICTED_SLOPES> {
        let mut mean: [[f64; MAX_STATES]; AXES] = core::array::from_fn(|i| axes[i].x);
        let heads: [Head; AXES] = core::array::from_fn(|i| Head::new(&noise[i], self.stage_s));
        let mut modes = waves.modes(now, self.stage_s);
        let mut forces = [Vector3::zeros(); PREDICTED_SLOPES + 2 * SLOPE_STEPS];
        for force in &mut forces {
            let s = self.mean(&mean, waves.lever_arm(), &modes.motion()).stage;
            let f = s.rotation().transpose() * (Vector3::from(s.acceleration) - Vector3::z() * GRAVITY);
            *force = Rotation3::from_axis_angle(&Vector3::z_axis(), s.euler[2]) * f;
            self.advance(&mut mean, &heads);
            modes.advance();
        }
        let mut out = Seq::new();
        for window in forces.windows(2 * SLOPE_STEPS + 1) {
            let f = window.iter().sum::<Vector3<f64>>() / window.len() as f64;
            let slope = f.xy() / (-f.z).max(MIN_NORMAL_MPS2) / SLOPE_STEP;
            // The cast saturates.
            if out.push([slope.x.round() as i8, slope.y.round() as i8]).is_err() {
                break;
            }
        }
        out
    }

    /// Propagates the means by one stage, including the turn of mean velocity, heel and trim.
    fn advance(&self, mean: &mut [[f64; MAX_STATES]; AXES], heads: &[Head; AXES]) {
        for (axis, (x, h)) in mean.iter_mut().zip(heads).enumerate() {
            x[MEAN] += h.reach * x[RATE];
            x[RATE] *= h.rate;
            x[VISION] += h.wander * x[DRIFT];
            x[DRIFT] *= h.drift;
            for (k, a) in self.stage.of(axis).a.iter().take(self.stage.count).enumerate() {
                let i = HEAD + 2 * k;
                let v = x[i];
                let r = x[i + 1];
                x[i] = a[0] * v + a[1] * r;
                x[i + 1] = a[2] * v + a[3] * r;
            }
        }
        let velocity = Vector2::new(mean[0][RATE], mean[1][RATE]);
        if velocity.norm() > STEERAGE_MPS {
            let turn = Rotation2::new(mean[5][RATE] * self.stage_s);
            let velocity = turn * velocity;
            (mean[0][RATE], mean[1][RATE]) = (velocity.x, velocity.y);
            let heel = turn * Vector2::new(mean[TILT[0]][MEAN], mean[TILT[1]][MEAN]);
            (mean[TILT[0]][MEAN], mean[TILT[1]][MEAN]) = (heel.x, heel.y);
        }
    }

    /// Variance of value, rate and acceleration at knot `k`, from the current covariance and the process noise.
    fn variance(&self, a: &Axis, noise: &AxisNoise, axis: usize, k: usize) -> [f64; 3] {
        let Some(step) = self.knots.get(k) else {
            return [0.0; 3];
        };
        let n = a.n.min(HEAD + 2 * step.count);
        let head = Head::new(noise, step.dt);
        let mut h = [0.0; MAX_STATES];
        let mut g = [0.0; MAX_STATES];
        let mut f = [0.0; MAX_STATES];
        h[MEAN] = 1.0;
        h[RATE] = head.reach;
        g[RATE] = head.rate;
        // Position and heading are in the drone's frame, which moves with the current drift of the odometry. The
        // unknown future drift moves drone and plan alike until the next detection, so it is omitted.
        let q = head.noise(noise, step.dt);
        let mut value = q.mean;
        let mut rate = q.rate;
        let mut acceleration = 0.0;
        if in_vision_frame(axis) {
            h[VISION] = 1.0;
            h[DRIFT] = head.wander;
            g[DRIFT] = head.drift;
        }
        let blocks = step.of(axis);
        for (j, ((t, n), o)) in blocks
            .a
            .iter()
            .zip(&blocks.q)
            .zip(&self.oscillators)
            .take(step.count)
            .enumerate()
        {
            let i = HEAD + 2 * j;
            (h[i], h[i + 1], g[i], g[i + 1]) = (t[0], t[1], t[2], t[3]);
            // x'' = -omega² x - 2 lambda omega x'.
            let stiff = -o.omega * o.omega;
            let damped = -2.0 * o.damping[axis] * o.omega;
            (f[i], f[i + 1]) = (stiff * t[0] + damped * t[2], stiff * t[1] + damped * t[3]);
            let var = o.sd[axis].powi(2);
            value += var * n[0];
            rate += var * n[2];
            acceleration +=
                var * (stiff * stiff * n[0] + 2.0 * stiff * damped * n[1] + damped * damped * n[2]);
        }
        for i in 0..n {
            let mut ph = 0.0;
            let mut pg = 0.0;
            let mut pf = 0.0;
            for (((p, h), g), f) in a.p[i].iter().zip(&h).zip(&g).zip(&f).take(n) {
                ph += p * h;
                pg += p * g;
                pf += p * f;
            }
            value += h[i] * ph;
            rate += g[i] * pg;
            acceleration += f[i] * pf;
        }
        [value, rate, acceleration].map(|v: f64| v.max(0.0))
    }

    fn mean(&self, mean: &[[f64; MAX_STATES]; AXES], lever_arm: &Vector3<f64>, modes: &DeckMotion) -> Mean {
        let mut v = [0.0; AXES];
        let mut r = [0.0; AXES];
        let mut a = [0.0; AXES];
        for i in 0..AXES {
            let x = &mean[i];
            v[i] = x[MEAN] + if in_vision_frame(i) { x[VISION] } else { 0.0 };
            r[i] = x[RATE] + if in_vision_frame(i) { x[DRIFT] } else { 0.0 };
            for (k, o) in self.oscillators.iter().enumerate() {
                let j = HEAD + 2 * k;
                v[i] += x[j];
                r[i] += x[j + 1];
                a[i] -= o.omega * o.omega * x[j] + 2.0 * o.damping[i] * o.omega * x[j + 1];
            }
        }
        for i in 0..AXES {
            v[i] += modes.value[i];
            r[i] += modes.rate[i];
            a[i] += modes.acceleration[i];
        }
        let bent = mean[0][RATE].hypot(mean[1][RATE]) > STEERAGE_MPS;
        // The mean turn rate bends only the path of a vessel under way.
        let turn = if bent { mean[5][RATE] } else { 0.0 };
        let heel = TILT.map(|i| mean[i][MEAN]);
        r[TILT[0]] -= turn * heel[1];
        r[TILT[1]] += turn * heel[0];
        let yaw = alight_shared::frames::wrap_angle(v[5]);
        let by_compass = yaw + compass(&mean[5]);
        let (s, c) = by_compass.sin_cos();
        let (roll, pitch) = turn_tilt(v[3], v[4], by_compass);
        let dr = c * r[3] + s * r[4];
        let dp = -s * r[3] + c * r[4];
        // On a turning vessel the axes rotate under a constant tilt.
        let rates = [dr + turn * pitch, dp - turn * roll];
        let ddr = c * a[3] + s * a[4];
        let ddp = -s * a[3] + c * a[4];
        let [low, sinks, dives] = lever_arm_heave(lever_arm, [roll, pitch], rates, [ddr, ddp]);
        v[2] += low;
        r[2] += sinks;
        a[2] += dives;
        if bent {
            a[0] -= turn * mean[1][RATE];
            a[1] += turn * mean[0][RATE];
        }
        Mean {
            stage: DeckStage {
                position: [v[0], v[1], v[2]],
                velocity: [r[0], r[1], r[2]],
                acceleration: [a[0], a[1], a[2]],
                euler: [roll, pitch, yaw],
                euler_rates: [dr + r[5] * pitch, dp - r[5] * roll, r[5]],
                ..DeckStage::default()
            },
            rate: r,
            acceleration: a,
            turn: (s, c),
        }
    }

    /// `var`: variances of value, rate and acceleration by degree of freedom.
    fn stage(
        &self,
        mean: &[[f64; MAX_STATES]; AXES],
        var: impl Fn(usize) -> [f64; 3],
        clock_var: f64,
        lever_arm: &Vector3<f64>,
        modes: &DeckMotion,
    ) -> DeckStage {
        let Mean {
            stage,
            rate: r,
            acceleration: a,
            turn: (s, c),
        } = self.mean(mean, lever_arm, modes);
        let all: [[f64; 3]; AXES] = core::array::from_fn(var);
        let sd = |i: usize| (all[i][0] + r[i] * r[i] * clock_var).sqrt();
        let rate_sd = |i: usize| (all[i][1] + a[i] * a[i] * clock_var).sqrt();
        let acceleration_sd = |i: usize| all[i][2].sqrt();
        let turned = |n: f64, e: f64| ((c * n).hypot(s * e), (s * n).hypot(c * e));
        let tilt_sd = turned(sd(3), sd(4));
        let tilt_rate_sd = turned(rate_sd(3), rate_sd(4));
        DeckStage {
            position_sd: [sd(0), sd(1), sd(2)],
            velocity_sd: [rate_sd(0), rate_sd(1), rate_sd(2)],
            acceleration_sd: [0, 1, 2].map(acceleration_sd),
            euler_sd: [tilt_sd.0, tilt_sd.1, sd(5)],
            euler_rates_sd: [tilt_rate_sd.0, tilt_rate_sd.1, rate_sd(5)],
            ..stage
        }
    }
}

struct Mean {
    stage: DeckStage,
    rate: [f64; AXES],
    acceleration: [f64; AXES],
    /// Sine and cosine of the compass heading.
    turn: (f64, f64),
}

/// Whether an axis is forecast in the drone's frame: true for position and heading, false for tilt.
fn in_vision_frame(axis: usize) -> bool {
    !matches!(axis, 3 | 4)
}

#[cfg(test)]
mod tests {
    use super::{super::config::PredictorConfig, *};
    use alight_shared::time::Time;

    #[test]
    fn deck_of_a_heeled_vessel_that_turns() {
        let config = PredictorConfig::default();
        let noise = AxisNoise::all(&config);
        let mut axes: [Axis; AXES] = core::array::from_fn(|i| Axis::new(&noise[i], &[], i, 0.0, 0.1, 0.1));
        (axes[TILT[0]].x[MEAN], axes[TILT[1]].x[MEAN]) = (0.10, -0.05);
        (axes[5].x[MEAN], axes[5].x[RATE]) = (0.7, 0.1);
        axes[0].x[RATE] = 2.0;
        let mut waves = Waves::new(&config);
        waves.set_lever_arm(Vector3::new(-4.0, 0.5, -1.3), 0.7);
        let horizon = Horizon::new(&[], 0.1);
        let at = (&waves, Time::from_secs(1.0));
        let stages = horizon.stages(&axes, &noise, &[(0.0, 0.0); AXES], 0.0, at);
        let [first, .., last] = &stages[..] else {
            panic!("{} stages", stages.len());
        };
        // Heel, trim and height of the deck are constant in the vessel's axes.
        for s in [first, last] {
            assert!(s.velocity[2].abs() < 1e-3, "{:?}", s.velocity);
            assert!(
                s.euler_rates[0].hypot(s.euler_rates[1]) < 1e-4,
                "{:?}",
                s.euler_rates
            );
        }
        assert!(last.euler[2] > first.euler[2] + 0.1);
        assert!((last.position[2] - first.position[2]).abs() < 0.005);
    }
}
