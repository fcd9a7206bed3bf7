//! Dead time of the link to the autopilot: prediction of the drone's state to the arrival of a
//! command.
//!
//! Odometry is `d` old when it arrives, and a command takes about as long on its way, so the answer to a
//! command is observed `2 d` after it. A loop that takes the old state for the present one loses `2 d w` of its
//! phase at the frequency `w`. So the state is led to the instant at which the command acts by a model of the
//! drone under the commands that are under way, and the plan is sampled there (Smith 1957, "Closer control
//! of loops with dead time"; the model starts from each odometry, it does not run in parallel).
//!
//! Simulated over MAVLink at Moderate (`tests/tests/autopilot/landings.rs`), 40 ms each way: without it none of 3 flights
//! landed well (23 contacts that were too hard), with it 32 of 32, 0.033 m off on average. At 80 ms 94 of 100: thrust
//! removed on the deck is measured 160 ms later, and the contact is in doubt meanwhile. Over an autopilot in
//! the same computer the dead time is below [`DelayConfig::min_s`] and nothing changes.

use std::collections::VecDeque;

use alight_shared::geometry::GRAVITY;
use alight_shared::msg::DroneState;
use alight_shared::time::{DroneClock, Span, Time};
use nalgebra::{UnitQuaternion, Vector3};

use super::Pilot;
use super::config::DelayConfig;
use super::estimate::FlightEstimator;
use crate::contingency::Body;

/// Commands kept: those of 0.6 s at 100 Hz.
const KEPT: usize = 60;
/// Step of the model, s.
const STEP_S: f64 = 0.01;

/// Attitude (NED from body) and collective thrust (0 to 1) that were commanded; None: the autopilot closed the
/// loop.
pub(crate) type Commanded = Option<(UnitQuaternion<f64>, f64)>;

/// The lags of the drone under a command.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lags {
    /// Of the attitude loop, s.
    pub(crate) attitude_s: f64,
    /// Of the rate loop below it, s.
    pub(crate) rate_s: f64,
    /// Of the thrust, s.
    pub(crate) thrust_s: f64,
}

/// The dead time, learnt from the age of odometry at its arrival, and the commands under way.
#[derive(Clone, Debug, Default)]
pub(crate) struct Delay {
    age_s: Option<f64>,
    sent: VecDeque<(Time<DroneClock>, Commanded)>,
}

impl Delay {
    /// New odometry arrived, `age_s` old, `dt` after the last step.
    pub(crate) fn received(&mut self, age_s: f64, dt: f64, c: &DelayConfig) {
        let age_s = age_s.clamp(0.0, c.limit_s);
        self.age_s = Some(match self.age_s {
            None => age_s,
            Some(last) => last + (1.0 - (-dt / c.time_s).exp()) * (age_s - last),
        });
    }
    /// One way, s; zero when it is too short to matter.
    pub(crate) fn one_way_s(&self, c: &DelayConfig) -> f64 {
        self.age_s.filter(|a| *a >= c.min_s).unwrap_or(0.0)
    }
    /// What was commanded at `now`.
    pub(crate) fn sent(&mut self, now: Time<DroneClock>, command: Commanded) {
        if self.sent.len() >= KEPT {
            self.sent.pop_front();
        }
        self.sent.push_back((now, command));
    }
    /// The newest command sent by `at`.
    fn by(&self, at: Time<DroneClock>) -> Commanded {
        self.sent
            .iter()
            .rev()
            .find(|(sent, _)| *sent <= at)
            .and_then(|(_, command)| *command)
    }
    /// The command whose answer is received at `now`.
    pub(crate) fn answered(&self, now: Time<DroneClock>, c: &DelayConfig) -> Commanded {
        self.by(now - Span::from_secs(2.0 * self.one_way_s(c)))
    }
    /// The drone when a command of `now` acts, from its newest odometry; None when that is now.
    ///
    /// `w' = (e / T - w) / T_w` with the angle `e` to the command in force, `R' = R [w]`, and
    /// `v' = g + d - R e_z f(u)` with the thrust `u` after its lag.
    pub(crate) fn ahead(
        &self,
        now: Time<DroneClock>,
        drone: &DroneState,
        estimate: &FlightEstimator,
        lags: &Lags,
        c: &DelayConfig,
    ) -> Option<Body> {
        let one_way_s = self.one_way_s(c);
        if one_way_s <= 0.0 {
            return None;
        }
        let age_s = (now - drone.header.at).secs().clamp(0.0, 2.0 * c.limit_s);
        let horizon_s = age_s + one_way_s;
        let (mut position, mut velocity) = (drone.position(), drone.velocity());
        let (mut attitude, mut rates) = (drone.attitude(), Vector3::from(drone.rates));
        let measured_force = -drone.specific_force[2];
        let mut thrust = estimate.acting();
        let push = estimate.disturbance();
        let outside = Vector3::new(push.x, push.y, GRAVITY - estimate.lift());
        let steps = (horizon_s / STEP_S).ceil().max(1.0);
        let h = horizon_s / steps;
        let fraction = |lag_s: f64| {
            if lag_s > 0.0 {
                1.0 - (-h / lag_s).exp()
            } else {
                1.0
            }
        };
        for k in 0..steps as u32 {
            let at = drone.header.at + Span::from_secs(f64::from(k) * h - one_way_s);
            let wanted = match self.by(at) {
                Some((command, u)) => {
                    let last = thrust.unwrap_or(u);
                    thrust = Some(last + fraction(lags.thrust_s) * (u - last));
                    (attitude.inverse() * command).scaled_axis() / lags.attitude_s.max(0.02)
                }
                // Whoever flies keeps it as it is.
                None => Vector3::zeros(),
            };
            rates += (wanted - rates) * fraction(lags.rate_s);
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
    /// When a command of `now` acts.
    pub(super) fn acts_at(&self, now: Time<DroneClock>) -> Time<DroneClock> {
        now + Span::from_secs(self.delay.one_way_s(&self.config.delay))
    }

    /// The drone then; `body` is the drone now.
    pub(super) fn acted_on(&self, now: Time<DroneClock>, body: &Body) -> Body {
        let lags = Lags {
            attitude_s: self.lag.lag(&self.config.lag),
            rate_s: self.config.lag.rate_loop_s,
            thrust_s: self.config.tracking.thrust_lag_s,
        };
        let c = &self.config.delay;
        let received = self.drone.get();
        let Some(mut ahead) = received.and_then(|d| self.delay.ahead(now, d, &self.estimate, &lags, c))
        else {
            return *body;
        };
        // The model knows of no deck, which carries the drone from the contact on.
        if let Some(b) = self
            .below(self.acts_at(now), &ahead)
            .filter(|b| b.clearance < 0.0)
        {
            let up = b.stage.normal();
            ahead.position -= up * b.clearance;
            ahead.velocity -= up * b.normal_speed.min(0.0);
        }
        ahead
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAGS: Lags = Lags {
        attitude_s: 0.2,
        rate_s: 0.06,
        thrust_s: 0.05,
    };

    /// Flies the model's own drone under a rocking command, 40 ms each way, and compares what was led ahead
    /// with what came.
    #[test]
    fn delay_prediction_after_one_dead_time() {
        let (c, one_way, dt) = (DelayConfig::default(), 4_usize, 0.01);
        let mut delay = Delay::default();
        let mut estimate = FlightEstimator::new(0.4);
        let (mut p, mut v) = (Vector3::new(3.0, -2.0, -5.0), Vector3::new(1.0, 0.5, 0.2));
        let (mut q, mut w) = (UnitQuaternion::identity(), Vector3::zeros());
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
                attitude: [q.w, q.i, q.j, q.k],
                rates: w.into(),
                specific_force: force.into(),
                ..DroneState::default()
            };
            state.header.at = at(k);
            history.push((state, u));
            if k >= one_way {
                let received = history[k - one_way].0;
                delay.received(dt * one_way as f64, dt, &c);
                let body = delay.ahead(at(k), &received, &estimate, &LAGS, &c).unwrap();
                led.push(body);
            }
            let wanted =
                UnitQuaternion::from_euler_angles(0.2 * (4.0 * t).sin(), 0.15 * (3.0 * t).cos(), 0.1);
            let command = (wanted, 0.4 + 0.06 * (5.0 * t).sin());
            commands.push(command);
            delay.sent(at(k), Some(command));
            estimate.commanded(delay.answered(at(k), &c).map(|a| a.1), dt, LAGS.thrust_s);
            // The drone follows what was sent 40 ms ago.
            let Some((command, thrust)) = k.checked_sub(one_way).and_then(|i| commands.get(i)) else {
                continue;
            };
            u += (1.0 - (-dt / LAGS.thrust_s).exp()) * (thrust - u);
            let set = (q.inverse() * command).scaled_axis() / LAGS.attitude_s;
            w += (set - w) * (1.0 - (-dt / LAGS.rate_s).exp());
            q *= UnitQuaternion::from_scaled_axis(w * dt);
            let a = Vector3::z() * GRAVITY - q * Vector3::z() * estimate.specific(u);
            p += v * dt + a * (0.5 * dt * dt);
            v += a * dt;
        }
        let (mut worst, mut stale) = ([0.0_f64; 3], [0.0_f64; 3]);
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
    fn delay_prediction_without_dead_time() {
        let c = DelayConfig::default();
        let mut delay = Delay::default();
        delay.received(0.001, 0.01, &c);
        let now = Time::from_secs(1.0);
        let command = Some((UnitQuaternion::identity(), 0.3));
        delay.sent(now, command);
        assert_eq!(delay.answered(now, &c), command);
        let estimate = FlightEstimator::new(0.4);
        assert!(
            delay
                .ahead(now, &DroneState::default(), &estimate, &LAGS, &c)
                .is_none()
        );
    }
}
