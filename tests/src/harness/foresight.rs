//! The forecast with the deck's true motion from now on, for an error budget: what is left of the errors is not the
//! prediction's. The deck is where the drone takes it to be now; how it moves from there is true, in a frame that drifts as
//! the drone's odometry does.
//!
//! `p(t) = p^(0) + p*(t) - p*(0) + e t`, `v(t) = v*(t) + e`, `R(t) = R^(0) R*(0)^-1 R*(t)` with the forecast `^`, the truth
//! `*`, and the error `e` of the odometry's velocity.

use std::collections::VecDeque;

use alight_shared::frames::{Deck, DroneBody, euler_rates};
use alight_shared::msg::{DeckForecast, DeckStage, DroneState, FORECAST_STAGES};
use alight_shared::time::{DroneClock, Time, TrueTime};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::physics::{Physics, TICK};
use super::scenario::{Scenario, SetupError};
use crate::physics::body::RigidState;
use crate::physics::streams::Streams;
use crate::sensors::clocks::ClockModel;

/// Ticks between the present and the furthest moment that is asked for: a forecast of 4 s that is up to 0.1 s old.
const AHEAD: usize = (FORECAST_STAGES - 1) * 10 + 10;

/// The same sea and vessel, so many ticks ahead of the world; drones move no deck. A course that a descent changes is not
/// known to it.
pub(super) struct Foresight {
    ahead: Physics,
    /// One state a tick, the oldest that of `from`.
    states: VecDeque<RigidState<Deck>>,
    from: Time<TrueTime>,
}

impl Foresight {
    /// From the world's beginning.
    pub(super) fn new(scenario: &Scenario, streams: Streams) -> Result<Self, SetupError> {
        let ahead = Physics::new(scenario, streams)?;
        Ok(Foresight {
            from: ahead.now(),
            states: VecDeque::from([ahead.deck()]),
            ahead,
        })
    }
    /// Looks on from `t`.
    pub(super) fn look(&mut self, t: Time<TrueTime>) {
        while self.from < t && self.states.pop_front().is_some() {
            self.from += TICK;
        }
        while self.states.len() <= AHEAD {
            self.ahead.advance();
            self.states.push_back(self.ahead.deck());
        }
    }
    /// Gives `forecast` the true motion from its first stage on, in a frame whose odometry is wrong by `drift`, m/s.
    pub(super) fn correct(&self, forecast: &mut DeckForecast, clock: &ClockModel, drift: &Vector3<f64>) {
        let state = |k: usize| {
            let t = clock.true_time(forecast.header.at + forecast.step * k as i64);
            let ticks = (t - self.from).secs() / TICK.secs();
            self.states.get(ticks.round().max(0.0) as usize)
        };
        let (Some(then), Some(stage)) = (state(0), forecast.stages.first()) else {
            return;
        };
        let offset = Vector3::from(stage.position) - then.position.0;
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(stage.rotation()))
            * then.attitude.0.inverse();
        let truth: Vec<_> = (0..forecast.stages.len())
            .map_while(|k| state(k).copied())
            .collect();
        let step_s = forecast.step.secs();
        for (k, (stage, truth)) in forecast.stages.iter_mut().zip(&truth).enumerate() {
            let (roll, pitch, yaw) = (turn * truth.attitude.0).euler_angles();
            *stage = DeckStage {
                position: (truth.position.0 + offset + drift * (step_s * k as f64)).into(),
                velocity: (truth.velocity.0 + drift).into(),
                acceleration: truth.acceleration.0.into(),
                euler: [roll, pitch, yaw],
                euler_rates: euler_rates(roll, pitch, truth.rates.0).into(),
                ..*stage
            };
        }
    }
}

/// By how much the odometry's velocity is wrong, m/s: the truth is of `now`, `drone` of when it was measured.
pub(super) fn drift(
    drone: &DroneState,
    now: Time<DroneClock>,
    truth: &RigidState<DroneBody>,
) -> Vector3<f64> {
    let then = truth.velocity.0 - truth.acceleration.0 * (now - drone.header.at).secs();
    drone.velocity() - then
}
