//! Predicts the drone's state at the time at which a command takes effect.
//!
//! Odometry is `d` old when it arrives. A command takes effect one dead time `tau` after it is sent: the link takes
//! about `d` again, and the autopilot adds its own delay. At the frequency `w` a loop that uses the old state loses
//! `(d + tau) w` of phase. A model driven by the commands in transit therefore predicts the state at the time at which a
//! new command takes effect, and the plan is sampled there (Smith 1957, "Closer control of loops with dead time"; here
//! the model restarts from each odometry sample). The dead time and time constants of the attitude are identified in
//! [`super::response`], the dead time of the thrust by [`ThrustDelay`].

use std::collections::VecDeque;

use alight_shared::{
    estimation::{low_pass, low_pass_gain},
    geometry::GRAVITY,
    msg::{AttitudeResponse, DroneState, Plan, PlanStage},
    time::{DroneTime, Span},
};
use nalgebra::{UnitQuaternion, Vector3};

use super::{Pilot, config::DelayConfig};
use crate::{
    contingency::{Body, DeckBelow, NEAR_DECK_M},
    tracking::FlightEstimator,
};

/// Number of stored commands: 0.8 s at 100 Hz, more than the maximum dead time plus the oldest odometry.
const KEPT: usize = 80;
const STEP_S: f64 = 0.01;
/// Number of candidate dead times of the thrust, and their spacing, s.
const CANDIDATES: usize = 16;
const CANDIDATE_STEP_S: f64 = 0.02;
/// Averaging time for changes of thrust and force, s, and forgetting time of the regression, s.
const CHANGES_S: f64 = 1.0;
const MEMORY_S: f64 = 10.0;
/// Residual of a correct dead time, due to vibration in a second of samples, (m/s²)².
const RESIDUAL: f64 = 1.0;
/// Prior standard deviation of the dead time about the odometry's age, s.
const DEAD_TIME_SD_S: f64 = 0.03;
/// Error of the forecast deck height below a drone that stands on the deck, m.
const ERRS_M: f64 = 0.3;

/// Commanded attitude (NED from body) and collective thrust (0 to 1); None while the autopilot closes the loop.
pub(crate) type Commanded = Option<(UnitQuaternion<f64>, f64)>;

/// Recent commands, with the time at which each was sent.
#[derive(Clone, Debug, Default)]
pub(crate) struct SentCommands(VecDeque<(DroneTime, Commanded)>);

impl SentCommands {
    pub(crate) fn push(&mut self, now: DroneTime, command: Commanded) {
        if self.0.len() >= KEPT {
            self.0.pop_front();
        }
        self.0.push_back((now, command));
    }
    /// Thrust at `at` from the commands sent by then, after the rotors' lag. The lag state restarts after a period in
    /// the autopilot's loop.
    fn lagged_thrust(&self, at: DroneTime, lag_s: f64) -> Option<f64> {
        let count = self.0.partition_point(|(sent, _)| *sent <= at);
        let ends = self.0.iter().map(|(sent, _)| *sent).skip(1);
        let held = self.0.iter().zip(ends.map(Some).chain([None])).take(count);
        held.fold(None, |applied, ((from, command), until)| {
            let (_, u) = (*command)?;
            let dt = (until.unwrap_or(at).min(at) - *from).secs();
            Some(low_pass(applied, u, dt, lag_s))
        })
    }
    pub(crate) fn by(&self, at: DroneTime) -> Commanded {
        let newer = self.0.partition_point(|(sent, _)| *sent <= at);
        self.0
            .get(newer.checked_sub(1)?)
            .and_then(|(_, command)| *command)
    }
}

/// Estimates the thrust's dead time by regression with forgetting: with the selected candidate, the changes of the
/// commanded thrust, after its lag, best explain those of the specific force.
#[derive(Clone, Debug, Default)]
pub(crate) struct ThrustDelay {
    candidates: [ThrustCandidate; CANDIDATES],
    last: Option<DroneTime>,
    force: Option<f64>,
    ff: f64,
    found_s: Option<f64>,
}

#[derive(Clone, Copy, Debug, Default)]
struct ThrustCandidate {
    applied: Option<f64>,
    mean: f64,
    uu: f64,
    uf: f64,
}

impl ThrustDelay {
    /// Processes a specific force along the thrust (m/s²) in free flight, with the thrust's lag and the odometry's age.
    fn learn(&mut self, at: DroneTime, force: f64, sent: &SentCommands, lag_s: f64, one_way_s: f64) {
        let dt = self.last.replace(at).map_or(0.0, |last| (at - last).secs());
        if !(dt > 0.0 && dt < 0.2 && force.is_finite()) {
            return;
        }
        let keep = 1.0 - low_pass_gain(dt, MEMORY_S);
        let mean = low_pass(self.force, force, dt, CHANGES_S);
        self.force = Some(mean);
        let df = force - mean;
        self.ff = keep * self.ff + df * df;
        for (k, c) in self.candidates.iter_mut().enumerate() {
            let at = at - Span::from_secs(CANDIDATE_STEP_S * k as f64);
            let Some((_, u)) = sent.by(at) else {
                *c = ThrustCandidate::default();
                continue;
            };
            let applied = low_pass(c.applied, u, dt, lag_s.max(1e-3));
            let mean = c.applied.replace(applied).map_or(u, |_| c.mean);
            c.mean = low_pass(mean, applied, dt, CHANGES_S);
            let du = applied - c.mean;
            c.uu = keep * c.uu + du * du;
            c.uf = keep * c.uf + du * df;
        }
        self.choose(one_way_s);
    }

    fn choose(&mut self, one_way_s: f64) {
        let cost = |k: usize| {
            let c = self.candidates[k];
            let explained = if c.uf > 0.0 {
                c.uf * c.uf / c.uu.max(1e-9)
            } else {
                0.0
            };
            let deviation = (CANDIDATE_STEP_S * k as f64 - one_way_s) / DEAD_TIME_SD_S;
            self.ff - explained + RESIDUAL * deviation * deviation
        };
        let costs: [f64; CANDIDATES] = core::array::from_fn(cost);
        self.found_s = parabola_minimum(&costs).map(|k| CANDIDATE_STEP_S * k);
    }

    fn get(&self, one_way_s: f64) -> f64 {
        self.found_s.unwrap_or(one_way_s)
    }
}

/// Minimum of the parabola through the smallest of `costs` and its neighbours, in steps.
pub(super) fn parabola_minimum(costs: &[f64]) -> Option<f64> {
    let (best, lowest) = costs.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1))?;
    let neighbours = best
        .checked_sub(1)
        .and_then(|k| costs.get(k))
        .zip(costs.get(best + 1));
    let aside = neighbours.map_or(0.0, |(before, after)| {
        let curvature = before - 2.0 * lowest + after;
        if curvature > 0.0 {
            0.5 * (before - after) / curvature
        } else {
            0.0
        }
    });
    Some(best as f64 + aside.clamp(-0.5, 0.5))
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Delay {
    age_s: Option<f64>,
    pub(crate) sent: SentCommands,
    thrust: ThrustDelay,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Dynamics {
    pub(crate) response: AttitudeResponse,
    pub(crate) thrust_s: f64,
}

impl Delay {
    /// Processes new odometry that is `age_s` old, `dt` after the last step.
    pub(crate) fn received(&mut self, age_s: f64, dt: f64, c: &DelayConfig) {
        let age_s = age_s.clamp(0.0, c.limit_s);
        self.age_s = Some(low_pass(self.age_s, age_s, dt, c.time_s));
    }
    /// Age of the odometry at its arrival, s.
    pub(crate) fn one_way_s(&self) -> f64 {
        self.age_s.unwrap_or(0.0)
    }
    pub(crate) fn learn_thrust(&mut self, drone: &DroneState, lag_s: f64) {
        let one_way_s = self.one_way_s();
        let force = -drone.specific_force[2];
        self.thrust
            .learn(drone.header.at, force, &self.sent, lag_s, one_way_s);
    }
    pub(crate) fn thrust_s(&self) -> f64 {
        self.thrust.get(self.one_way_s())
    }
    /// Command whose thrust affects the odometry that arrives at `now`.
    pub(crate) fn answered(&self, now: DroneTime) -> Commanded {
        self.sent
            .by(now - Span::from_secs(self.one_way_s() + self.thrust_s()))
    }
    /// State of the drone `lead_s` after `now`, predicted from its newest odometry.
    ///
    /// `w' = (e / T - w) / T_r` with the angle `e` to the command in effect, `R' = R [w]`, and `v' = g + d - R e_z
    /// f(u)` with the thrust `u` after its lag. None if a value is not finite.
    pub(crate) fn ahead(
        &self,
        now: DroneTime,
        lead_s: f64,
        drone: &DroneState,
        estimate: &FlightEstimator,
        dynamics: &Dynamics,
        c: &DelayConfig,
    ) -> Option<Body> {
        let response = &dynamics.response;
        let age_s = (now - drone.header.at).secs().clamp(0.0, 2.0 * c.limit_s);
        let horizon_s = age_s + lead_s;
        let mut position = drone.position();
        let mut velocity = drone.velocity();
        let mut attitude = drone.attitude();
        let mut rates = Vector3::from(drone.rates);
        let measured_force = -drone.specific_force[2];
        let thrust_dead_s = self.thrust_s();
        let mut thrust = self.sent.lagged_thrust(
            drone.header.at - Span::from_secs(thrust_dead_s),
            dynamics.thrust_s,
        );
        let push = estimate.disturbance();
        let outside = Vector3::new(push.x, push.y, GRAVITY - estimate.lift());
        let steps = (horizon_s / STEP_S).ceil().max(1.0);
        let h = horizon_s / steps;
        let [roll, pitch] = response.lag_s;
        let lags = Vector3::new(roll, pitch, 0.5 * (roll + pitch)).map(|t| t.max(0.02));
        for k in 0..steps as u32 {
            let at = drone.header.at + Span::from_secs(f64::from(k) * h);
            let wanted = match self.sent.by(at - Span::from_secs(response.dead_time_s)) {
                Some((command, _)) => {
                    let angle = (attitude.inverse() * command).scaled_axis();
                    angle.component_div(&lags)
                }
                // While the autopilot or a pilot flies, the attitude is assumed to be constant.
                None => Vector3::zeros(),
            };
            if let Some((_, u)) = self.sent.by(at - Span::from_secs(thrust_dead_s)) {
                thrust = Some(low_pass(thrust, u, h, dynamics.thrust_s));
            }
            rates = low_pass(rates, wanted, h, response.rate_lag_s);
            attitude *= UnitQuaternion::from_scaled_axis(rates * h);
            let lift = thrust.map_or(measured_force, |u| estimate.specific(u));
            let acceleration = outside - attitude * Vector3::z() * lift;
            position += velocity * h + acceleration * (0.5 * h * h);
            velocity += acceleration * h;
        }
        let finite = position.iter().chain(velocity.iter()).all(|v| v.is_finite());
        finite.then_some(Body {
            position,
            velocity,
            attitude,
        })
    }
}

impl Pilot {
    /// Time at which an attitude commanded at `now` takes effect.
    pub(super) fn turns_at(&self, now: DroneTime) -> DroneTime {
        now + Span::from_secs(self.response.get().dead_time_s)
    }
    pub(super) fn thrusts_at(&self, now: DroneTime) -> DroneTime {
        now + Span::from_secs(self.delay.thrust_s())
    }

    /// Stage of the plan for a command sent at `now`: attitude and horizontal motion at the time when the attitude
    /// takes effect, vertical motion at the time when the thrust takes effect.
    pub(super) fn served(&self, now: DroneTime, plan: &Plan) -> Option<PlanStage> {
        let mut stage = plan.sample(self.turns_at(now))?;
        let vertical = plan.sample(self.thrusts_at(now))?;
        stage.position[2] = vertical.position[2];
        stage.velocity[2] = vertical.velocity[2];
        // The thrust after its lag must match the plan at that time.
        let lag = Span::from_secs(self.config.tracking.thrust_lag_s);
        let delayed = plan.sample(self.thrusts_at(now) + lag).unwrap_or(vertical);
        stage.acceleration[2] = delayed.acceleration[2];
        Some(stage)
    }

    /// State of the drone when a command sent at `now` takes effect, combined as in [`Self::served`].
    pub(super) fn acted_on(&self, now: DroneTime, body: &Body) -> Body {
        let at = |at| self.ahead_at(now, at).unwrap_or(*body);
        let turned = at(self.turns_at(now));
        let mut thrust = at(self.thrusts_at(now));
        // The model does not include the deck, which supports the drone after a contact unless it has slid over the
        // edge.
        let over = self.below(now, body).is_some_and(|b| is_over(&b, body));
        if let Some(b) = self
            .below(self.thrusts_at(now), &thrust)
            .filter(|b| over && b.clearance < 0.0)
        {
            let up = b.stage.normal();
            thrust.position -= up * b.clearance;
            thrust.velocity -= up * b.normal_speed.min(0.0);
        }
        Body {
            position: turned.position.xy().push(thrust.position.z),
            velocity: turned.velocity.xy().push(thrust.velocity.z),
            attitude: turned.attitude,
        }
    }

    fn ahead_at(&self, now: DroneTime, at: DroneTime) -> Option<Body> {
        let dynamics = Dynamics {
            response: self.response.get(),
            thrust_s: self.config.tracking.thrust_lag_s,
        };
        let lead_s = (at - now).secs();
        let c = &self.config.delay;
        let drone = self.drone.get()?;
        self.delay.ahead(now, lead_s, drone, &self.estimate, &dynamics, c)
    }
}

/// Whether the deck is within reach, and above the feet by no more than the forecast's error.
fn is_over(b: &DeckBelow, body: &Body) -> bool {
    let aside = (body.position - Vector3::from(b.stage.position)).xy().norm();
    aside < NEAR_DECK_M && b.clearance > -ERRS_M
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{frames::wxyz, time::Time};

    /// Dynamics of a drone whose set-points and odometry have the same delay.
    const DYNAMICS: Dynamics = Dynamics {
        response: AttitudeResponse {
            dead_time_s: 0.04,
            lag_s: [0.2; 2],
            rate_lag_s: 0.06,
            identified: true,
        },
        thrust_s: 0.05,
    };

    /// Compares the prediction with the later state under an oscillating command and 40 ms of delay each way.
    #[test]
    fn delay_prediction_after_one_dead_time() {
        let c = DelayConfig::default();
        let one_way = 4_usize;
        let dt = 0.01;
        let mut delay = Delay::default();
        let mut estimate = FlightEstimator::new(0.4);
        let mut p = Vector3::new(3.0, -2.0, -5.0);
        let mut v = Vector3::new(1.0, 0.5, 0.2);
        let mut q = UnitQuaternion::identity();
        let mut w = Vector3::zeros();
        let mut u = 0.4;
        let mut history: Vec<(DroneState, f64)> = Vec::new();
        let mut commands: Vec<(UnitQuaternion<f64>, f64)> = Vec::new();
        let mut led: Vec<Body> = Vec::new();
        let at = |k: usize| Time::from_secs(dt * k as f64);
        for k in 0..400 {
            let t = dt * k as f64;
            let force = Vector3::new(0.0, 0.0, -estimate.specific(u));
            let mut state = DroneState {
                position: p.into(),
                velocity: v.into(),
                attitude: wxyz(&q),
                rates: w.into(),
                specific_force: force.into(),
                ..DroneState::default()
            };
            state.header.at = at(k);
            history.push((state, u));
            if k >= one_way {
                let received = history[k - one_way].0;
                delay.received(dt * one_way as f64, dt, &c);
                let body = delay
                    .ahead(at(k), 0.04, &received, &estimate, &DYNAMICS, &c)
                    .unwrap();
                led.push(body);
            }
            let wanted =
                UnitQuaternion::from_euler_angles(0.2 * (4.0 * t).sin(), 0.15 * (3.0 * t).cos(), 0.1);
            let command = (wanted, 0.4 + 0.06 * (5.0 * t).sin());
            commands.push(command);
            delay.sent.push(at(k), Some(command));
            estimate.commanded(delay.answered(at(k)).map(|a| a.1), dt, DYNAMICS.thrust_s);
            // The drone follows the command that was sent 40 ms ago.
            let Some((command, thrust)) = k.checked_sub(one_way).and_then(|i| commands.get(i)) else {
                continue;
            };
            u = low_pass(u, *thrust, dt, DYNAMICS.thrust_s);
            let set = (q.inverse() * command).scaled_axis() / DYNAMICS.response.lag_s[0];
            w = low_pass(w, set, dt, DYNAMICS.response.rate_lag_s);
            q *= UnitQuaternion::from_scaled_axis(w * dt);
            let a = Vector3::z() * GRAVITY - q * Vector3::z() * estimate.specific(u);
            p += v * dt + a * (0.5 * dt * dt);
            v += a * dt;
        }
        let mut worst = [0.0_f64; 3];
        let mut stale = [0.0_f64; 3];
        for (i, body) in led.iter().enumerate().skip(100) {
            let k = i + one_way;
            let Some((then, _)) = history.get(k + one_way) else {
                break;
            };
            let old = history[k - one_way].0;
            let apart = |q: UnitQuaternion<f64>, x: Vector3<f64>, v: Vector3<f64>| {
                [
                    (x - then.position()).norm(),
                    (v - then.velocity()).norm(),
                    q.angle_to(&then.attitude()),
                ]
            };
            let moved = old.position() + old.velocity() * (2.0 * dt * one_way as f64);
            for (worst, e) in worst
                .iter_mut()
                .zip(apart(body.attitude, body.position, body.velocity))
            {
                *worst = worst.max(e);
            }
            for (stale, e) in stale.iter_mut().zip(apart(old.attitude(), moved, old.velocity())) {
                *stale = stale.max(e);
            }
        }
        for (led, stale) in worst.iter().zip(stale) {
            assert!(*led < 0.15 * stale, "{worst:?} against {stale:?}");
        }
    }

    #[test]
    fn thrust_delay_from_the_specific_force() {
        for (dead_s, one_way_s) in [(0.0, 0.004), (0.12, 0.004), (0.24, 0.02)] {
            let mut delay = Delay::default();
            delay.received(one_way_s, 1.0, &DelayConfig::default());
            let command = |t: f64| 0.4 + 0.08 * (3.0 * t).sin() + 0.04 * (7.0 * t).cos();
            let mut applied = 0.4;
            for k in 0..600 {
                let t = 0.01 * f64::from(k);
                applied = low_pass(applied, command(t - dead_s), 0.01, 0.05);
                let level = UnitQuaternion::identity();
                delay.sent.push(Time::from_secs(t), Some((level, command(t))));
                let mut state = DroneState {
                    specific_force: [0.0, 0.0, -applied * GRAVITY / 0.37],
                    ..DroneState::default()
                };
                state.header.at = Time::from_secs(t);
                delay.learn_thrust(&state, 0.05);
            }
            assert!(
                (delay.thrust_s() - dead_s).abs() < 0.015,
                "{dead_s}: {}",
                delay.thrust_s()
            );
        }
    }
}
