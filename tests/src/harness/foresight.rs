//! Forecasts with one part replaced by the truth, for an error budget: the remaining error comes from the other parts.
//!
//! Notation: `^` forecast, `*` truth; `d`, `e`: position and velocity error of the odometry, in whose frame
//! the drone flies:
//!
//! | part | deck position `t` ahead |
//! |---|---|
//! | [`TruePart::Motion`] | `p^(0) + p*(t) - p*(0) + e t`: estimated state, true motion |
//! | [`TruePart::State`] | `p^(t) + (p*(0) + d - p^(0))`, and the velocity error, which decays: true state, predicted motion |
//! | [`TruePart::Whole`] | `p*(t) + d + e t` |
//! | [`TruePart::Contact`] | true motion for half a second, blended into the forecast at one second |
//!
//! The attitude is treated likewise.

use std::collections::VecDeque;

use alight_shared::{
    frames::{Deck, DroneBody, body_rates, euler_rates, wrap_angle},
    motion_model::FADE_S,
    msg::{DeckForecast, DeckStage, DroneState, FORECAST_STAGES},
    time::{DroneTime, WorldTime},
};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::{
    physics::{Physics, TICK},
    scenario::{
        Scenario, SetupError,
        foresight::{Dof, ForesightConfig, TruePart},
    },
};
use crate::{
    physics::{body::RigidState, streams::Streams},
    sensors::clocks::ClockModel,
};

/// Horizon of the true motion of [`TruePart::Contact`], s.
const CONTACT_S: f64 = 0.5;
/// Ticks to the end of the longest forecast: 4 s, at most 0.1 s old.
const AHEAD: usize = (FORECAST_STAGES - 1) * 10 + 10;

/// The world's sea and vessel, simulated [`AHEAD`] ticks ahead. Excludes the drones' forces on the deck, and
/// course changes caused by a descent.
pub(super) struct Foresight {
    config: ForesightConfig,
    ahead: Physics,
    /// One state per tick, from `from` on.
    states: VecDeque<RigidState<Deck>>,
    from: WorldTime,
}

impl Foresight {
    pub(super) fn new(
        scenario: &Scenario,
        config: &ForesightConfig,
        streams: Streams,
    ) -> Result<Self, SetupError> {
        let ahead = Physics::new(scenario, streams)?;
        Ok(Foresight {
            config: config.clone(),
            from: ahead.now(),
            states: VecDeque::from([ahead.deck()]),
            ahead,
        })
    }
    /// Extends the states so that they begin at `t`.
    pub(super) fn look(&mut self, t: WorldTime) {
        while self.from < t && self.states.pop_front().is_some() {
            self.from += TICK;
        }
        while self.states.len() <= AHEAD {
            self.ahead.advance();
            self.states.push_back(self.ahead.deck());
        }
    }
    /// `odometry` is the error of the drone's frame.
    pub(super) fn correct(&self, forecast: &mut DeckForecast, clock: &ClockModel, odometry: &OdometryError) {
        let state = |k: usize| {
            let t = clock.true_time(forecast.header.at + forecast.step * k as i64);
            let ticks = (t - self.from).secs() / TICK.secs();
            self.states.get(ticks.round().max(0.0) as usize)
        };
        let (Some(then), Some(first)) = (state(0).copied(), forecast.stages.first().copied()) else {
            return;
        };
        let truth: Vec<_> = (0..forecast.stages.len())
            .map_while(|k| state(k).copied())
            .collect();
        let now = Now {
            truth: stage_of(&then, &odometry.position, &odometry.velocity),
            own: first,
        };
        let step_s = forecast.step.secs();
        for (k, (stage, truth)) in forecast.stages.iter_mut().zip(&truth).enumerate() {
            let t = step_s * k as f64;
            let offset = odometry.position + odometry.velocity * t;
            let truth = stage_of(truth, &offset, &odometry.velocity);
            let wanted = now.corrected(self.config.part, stage, &truth, t);
            *stage = mixed(stage, &wanted, &self.config);
        }
        if let Some((z, stage)) = forecast.mean_z.as_mut().zip(forecast.stages.first()) {
            *z += stage.position[2] - first.position[2];
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct OdometryError {
    pub(crate) position: Vector3<f64>,
    pub(crate) velocity: Vector3<f64>,
}

impl OdometryError {
    /// `truth` is at `now`, `drone` at its time of measurement.
    pub(crate) fn of(drone: &DroneState, now: DroneTime, truth: &RigidState<DroneBody>) -> Self {
        let since = (now - drone.header.at).secs();
        let then = truth.velocity.0 - truth.acceleration.0 * since;
        let place = truth.position.0 - truth.velocity.0 * since;
        OdometryError {
            position: Vector3::from(drone.position) - place,
            velocity: drone.velocity() - then,
        }
    }
}

/// True state as a stage in a frame with this offset (m) and drift (m/s).
pub(crate) fn stage_of(truth: &RigidState<Deck>, offset: &Vector3<f64>, drift: &Vector3<f64>) -> DeckStage {
    let (roll, pitch, yaw) = truth.attitude.0.euler_angles();
    DeckStage {
        position: (truth.position.0 + offset).into(),
        velocity: (truth.velocity.0 + drift).into(),
        acceleration: truth.acceleration.0.into(),
        euler: [roll, pitch, yaw],
        euler_rates: euler_rates(roll, pitch, truth.rates.0).into(),
        ..DeckStage::default()
    }
}

struct Now {
    truth: DeckStage,
    own: DeckStage,
}

impl Now {
    /// Stage `own` of the forecast, `t` seconds ahead, with `part` replaced by the truth.
    fn corrected(&self, part: TruePart, own: &DeckStage, truth: &DeckStage, t: f64) -> DeckStage {
        match part {
            TruePart::Motion => self.moved(truth),
            TruePart::State => self.begun(own, t),
            TruePart::Whole => *truth,
            TruePart::Contact => {
                let part = ((2.0 * CONTACT_S - t) / CONTACT_S).clamp(0.0, 1.0);
                own.blend(&self.moved(truth), part)
            }
        }
    }
    /// True motion applied to the estimated initial state: `R(t) = R^(0) R*(0)^-1 R*(t)`.
    fn moved(&self, truth: &DeckStage) -> DeckStage {
        let attitude = |s: &DeckStage| {
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(s.rotation()))
        };
        let turned = attitude(&self.own) * attitude(&self.truth).inverse() * attitude(truth);
        let (roll, pitch, yaw) = turned.euler_angles();
        let place = Vector3::from(self.own.position) - Vector3::from(self.truth.position);
        let rates = body_rates(truth.euler[0], truth.euler[1], Vector3::from(truth.euler_rates));
        DeckStage {
            position: (Vector3::from(truth.position) + place).into(),
            euler: [roll, pitch, yaw],
            euler_rates: euler_rates(roll, pitch, rates).into(),
            ..*truth
        }
    }
    /// Predicted motion applied to the true initial state. Initial errors of position and angle persist;
    /// initial errors of the rates decay as in the prediction.
    fn begun(&self, own: &DeckStage, t: f64) -> DeckStage {
        let fades = (-t / FADE_S).exp();
        let gone = FADE_S * (1.0 - fades);
        let off = |now: f64, wrong: f64, rate: f64, wrong_rate: f64| now - wrong + (rate - wrong_rate) * gone;
        let truth = &self.truth;
        let first = &self.own;
        DeckStage {
            position: core::array::from_fn(|i| {
                own.position[i]
                    + off(
                        truth.position[i],
                        first.position[i],
                        truth.velocity[i],
                        first.velocity[i],
                    )
            }),
            velocity: core::array::from_fn(|i| {
                own.velocity[i] + (truth.velocity[i] - first.velocity[i]) * fades
            }),
            acceleration: core::array::from_fn(|i| {
                own.acceleration[i] - (truth.velocity[i] - first.velocity[i]) * fades / FADE_S
            }),
            euler: core::array::from_fn(|i| {
                let wrong = wrap_angle(truth.euler[i] - first.euler[i]);
                own.euler[i] + off(wrong, 0.0, truth.euler_rates[i], first.euler_rates[i])
            }),
            euler_rates: core::array::from_fn(|i| {
                own.euler_rates[i] + (truth.euler_rates[i] - first.euler_rates[i]) * fades
            }),
            ..*own
        }
    }
}

/// `own`, with the degrees of freedom of `config` replaced by those of `wanted`; surge and sway are relative
/// to the heading.
fn mixed(own: &DeckStage, wanted: &DeckStage, config: &ForesightConfig) -> DeckStage {
    let heading = Rotation3::from_axis_angle(&Vector3::z_axis(), own.euler[2]);
    let has = |dof: Dof| f64::from(u8::from(config.dofs.is_empty() || config.dofs.contains(&dof)));
    let along = Vector3::new(has(Dof::Surge), has(Dof::Sway), has(Dof::Heave));
    let place = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] {
        let a = Vector3::from(a);
        let b = Vector3::from(b);
        (a + heading * (heading.inverse() * (b - a)).component_mul(&along)).into()
    };
    let turns = [Dof::Roll, Dof::Pitch, Dof::Yaw].map(has);
    DeckStage {
        position: place(own.position, wanted.position),
        velocity: place(own.velocity, wanted.velocity),
        acceleration: place(own.acceleration, wanted.acceleration),
        euler: core::array::from_fn(|i| own.euler[i] + turns[i] * wrap_angle(wanted.euler[i] - own.euler[i])),
        euler_rates: core::array::from_fn(|i| {
            own.euler_rates[i] + turns[i] * (wanted.euler_rates[i] - own.euler_rates[i])
        }),
        ..*own
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stage(by: f64) -> DeckStage {
        DeckStage {
            position: [by, 2.0 * by, -by],
            velocity: [0.3 * by, 0.1 * by, by],
            euler: [0.1 * by, -0.1 * by, 0.5],
            euler_rates: [0.2 * by, 0.1 * by, 0.0],
            ..DeckStage::default()
        }
    }
    fn distance(a: &DeckStage, b: &DeckStage) -> f64 {
        let off = Vector3::from(a.position) - Vector3::from(b.position);
        let turn = Vector3::from(a.euler) - Vector3::from(b.euler);
        off.norm() + turn.norm()
    }

    #[test]
    fn true_parts_of_a_forecast() {
        let now = Now {
            truth: stage(1.0),
            own: stage(1.2),
        };
        let own = stage(2.0);
        let truth = stage(2.5);
        let corrected = |part, t| now.corrected(part, &own, &truth, t);
        assert!(distance(&corrected(TruePart::Whole, 1.0), &truth) < 1e-12);
        assert!(
            distance(
                &now.corrected(TruePart::State, &now.own, &now.truth, 0.0),
                &now.truth
            ) < 1e-12
        );
        assert!(
            distance(
                &now.corrected(TruePart::Motion, &now.own, &now.truth, 0.0),
                &now.own
            ) < 1e-12
        );
        assert!(
            distance(
                &corrected(TruePart::Contact, 0.4),
                &corrected(TruePart::Motion, 0.4)
            ) < 1e-12
        );
        assert!(distance(&corrected(TruePart::Contact, 1.1), &own) < 1e-12);
    }

    #[test]
    fn true_degrees_of_freedom() {
        let own = stage(2.0);
        let truth = stage(2.5);
        let with = |dofs: &[Dof]| {
            let config = ForesightConfig {
                dofs: dofs.to_vec(),
                ..ForesightConfig::default()
            };
            mixed(&own, &truth, &config)
        };
        assert!(distance(&with(&[]), &truth) < 1e-12);
        let heave = with(&[Dof::Heave]);
        assert_eq!(
            (heave.position[0], heave.position[2], heave.euler),
            (own.position[0], truth.position[2], own.euler)
        );
        let level = with(&[Dof::Surge, Dof::Sway]);
        assert!(
            (level.position[1] - truth.position[1]).abs() < 1e-12 && level.position[2] == own.position[2]
        );
        let pitch = with(&[Dof::Pitch]).euler;
        let expected = [own.euler[0], truth.euler[1], own.euler[2]];
        assert!(
            pitch.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12),
            "{pitch:?}"
        );
    }
}
