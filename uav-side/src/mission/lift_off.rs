//! Probability that a take-off at a given time leaves the deck safely, from the forecast that landings use.
//!
//! A foot may touch the deck again, so both limits are those of a contact ([`MAX_MPS`]):
//!
//! | quantity | mean | standard deviations |
//! |---|---|---|
//! | speed along the deck, m/s | `t_l (T n + w - a)` | `t_l T sd(tilt)`, `t_l sd(a)`, gusts |
//! | gap over the deck, m | the climb's law over the forecast deck | `s sd(w)`, `s² sd(a) / 2` |
//!
//! `T` is the specific thrust of the jump along the deck's normal, whose horizontal part is `n`; `w` and `a` are the
//! horizontal accelerations due to the wind and of the deck; `t_l` is the time until the drone has levelled. The gap
//! must stay open at every time `s` of the forecast. Both probabilities are highest on a level deck at the top of its
//! rise, because it then falls away below the drone.

use alight_shared::{
    geometry::{DroneGeometry, GRAVITY},
    landing::{
        MAX_MPS, WindPush,
        normal::{below, inside, norm, smaller},
    },
    msg::{DeckForecast, DeckStage, Reason, ReasonCode},
    time::{DroneClock, Span, Time},
};
use nalgebra::Vector3;

use crate::{contingency::Climb, mission_config::MissionConfig};

/// Time from the decision until the rotors carry the drone, s: two periods, the link, rotor lag, and part of the ramp.
const LAG_S: f64 = 0.25;
/// Time from lift-off until level, s: 0.2 s until the feet are clear, and half of the attitude's 0.2 s.
const LEVELS_S: f64 = 0.3;
/// Times after lift-off at which the gap is checked, s: first, step and last.
const GAP_FROM_S: f64 = 0.3;
const STEP_S: f64 = 1.0 / 16.0;
const GAP_UNTIL_S: f64 = 1.5;
/// Standard deviations due to pilot and feet: of the gap, m, and of the speed along the deck, m/s.
const GAP_SD_M: f64 = 0.03;
const ALONG_SD_MPS: f64 = 0.1;
/// Spacing of the later lift-off times, and the latest, s.
const GRID_S: f64 = 0.25;
const AHEAD_S: f64 = 2.0;
/// Upper bound of the probability, for effects outside the model.
const MAX: f64 = 0.99;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LiftOff {
    pub along: f64,
    pub clear: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    pub now: LiftOff,
    /// Time until the best later lift-off, s, and its probabilities.
    pub later: Option<(f64, LiftOff)>,
}

impl LiftOff {
    pub fn whole(&self) -> f64 {
        let p = self.along * self.clear;
        if p.is_finite() { p.min(MAX) } else { 0.0 }
    }
    fn below(&self, needed: f64) -> Option<Reason> {
        let code = if self.clear < self.along {
            ReasonCode::TakeOffHit
        } else {
            ReasonCode::TakeOffTilted
        };
        let p = self.whole();
        (p < needed).then_some(Reason::new(code, p, needed))
    }
}

impl Moments {
    /// Reason against a take-off now: its probability is too low, or a later lift-off is worth waiting for.
    pub fn not_now(&self, c: &MissionConfig) -> Option<Reason> {
        let p = self.now.whole();
        self.now.below(c.min_probability).or_else(|| {
            let worth =
                |(wait_s, later): &(f64, LiftOff)| later.whole() - c.waiting_cost_per_s() * wait_s > p;
            let (_, later) = self.later.filter(worth)?;
            Some(Reason::new(ReasonCode::BetterMoment, p, later.whole()))
        })
    }
    /// Reason if no lift-off time in the forecast has a sufficient probability.
    pub fn none_soon(&self, c: &MissionConfig) -> Option<Reason> {
        let later = self.later.map(|(_, later)| later);
        let best = later.filter(|l| l.whole() > self.now.whole()).unwrap_or(self.now);
        best.below(c.min_probability)
    }
}

pub(super) struct LiftOffConditions<'a> {
    pub(super) forecast: &'a DeckForecast,
    /// Wind measured by an earlier flight.
    pub(super) wind: WindPush,
    pub(super) drone: &'a DroneGeometry,
}

impl LiftOffConditions<'_> {
    /// Probabilities of a take-off now and later; None if the forecast ends too early.
    pub(super) fn moments(&self, now: Time<DroneClock>) -> Option<Moments> {
        let start = now.max(self.forecast.header.at);
        let grid = 1..=(AHEAD_S / GRID_S) as usize;
        let later = grid.filter_map(|k| {
            let wait_s = GRID_S * k as f64;
            Some((wait_s, self.at(start + Span::from_secs(wait_s))?))
        });
        Some(Moments {
            now: self.at(start)?,
            later: later.reduce(|best, next| {
                if next.1.whole() > best.1.whole() {
                    next
                } else {
                    best
                }
            }),
        })
    }
    fn at(&self, t: Time<DroneClock>) -> Option<LiftOff> {
        let leaves = t + Span::from_secs(LAG_S);
        let deck = self.forecast.at(leaves)?;
        Some(LiftOff {
            along: self.along(&deck),
            clear: self.clear(leaves, &deck)?,
        })
    }
    /// Probability of a harmless speed along the deck at the time when the drone has levelled.
    fn along(&self, deck: &DeckStage) -> f64 {
        let surplus = self.drone.max_thrust_n / self.drone.mass_kg - GRAVITY;
        let thrust = GRAVITY + 0.5 * surplus.max(0.0);
        let parts = deck.normal().xy() * thrust - Vector3::from(deck.acceleration).xy() + self.wind.mean;
        let [ax, ay, _] = deck.acceleration_sd;
        let tilt_sd = (0.5 * (deck.euler_sd[0].powi(2) + deck.euler_sd[1].powi(2))).sqrt();
        let unknown = norm(&[
            thrust * tilt_sd,
            (0.5 * (ax * ax + ay * ay)).sqrt(),
            self.wind.gust_sd,
        ]);
        let sd = norm(&[ALONG_SD_MPS, LEVELS_S * unknown]);
        if !sd.is_finite() {
            return 0.0;
        }
        inside(LEVELS_S * parts.norm(), sd, MAX_MPS)
    }
    fn clear(&self, leaves: Time<DroneClock>, deck: &DeckStage) -> Option<f64> {
        let half_span_m = 0.5 * self.drone.feet_span_m[0].hypot(self.drone.feet_span_m[1]);
        let z = deck.position[2];
        let mut climb = Climb::new(z, deck.velocity[2], self.drone);
        let mut worst = f64::INFINITY;
        for k in 1..=(GAP_UNTIL_S / STEP_S) as usize {
            let s = STEP_S * k as f64;
            let stage = self.forecast.at(leaves + Span::from_secs(s))?;
            climb.advance(STEP_S, stage.velocity[2]);
            if s < GAP_FROM_S {
                continue;
            }
            let edge_m = half_span_m * stage.normal().xy().norm();
            let gap_m = stage.position[2] - climb.z - edge_m;
            let sd = norm(&[
                GAP_SD_M,
                s * stage.velocity_sd[2].min(stage.acceleration_sd[2] * s),
                0.5 * s * s * stage.acceleration_sd[2],
            ]);
            worst = smaller(worst, gap_m / sd);
        }
        Some(below(worst))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{forecast, header};

    fn known() -> DeckStage {
        DeckStage {
            position: [0.0, 0.0, -1.3],
            velocity_sd: [0.05; 3],
            acceleration_sd: [0.2; 3],
            euler_sd: [0.01; 3],
            ..DeckStage::default()
        }
    }
    fn moments(deck: impl Fn(f64) -> DeckStage) -> Moments {
        let f = forecast(header(0, Time::EPOCH), deck);
        let drone = DroneGeometry::default();
        let jump = LiftOffConditions {
            forecast: &f,
            wind: WindPush::default(),
            drone: &drone,
        };
        jump.moments(Time::EPOCH).unwrap()
    }

    #[test]
    fn take_off_from_decks_at_rest() {
        let c = MissionConfig::default();
        assert_eq!(moments(|_| known()).not_now(&c), None);
        let tilted = moments(|_| DeckStage {
            euler: [0.25, 0.0, 0.0],
            ..known()
        });
        assert_eq!(
            tilted.not_now(&c).map(|r| r.code),
            Some(ReasonCode::TakeOffTilted)
        );
        assert_eq!(
            tilted.none_soon(&c).map(|r| r.code),
            Some(ReasonCode::TakeOffTilted)
        );
        let unknown = moments(|_| DeckStage {
            euler_sd: [f64::NAN; 3],
            ..known()
        });
        assert!(unknown.now.whole() < 1e-9);
    }

    #[test]
    fn take_off_from_a_deck_that_rises_into_it() {
        let c = MissionConfig::default();
        // The deck accelerates upwards by 12 m/s² once the feet leave it.
        let hit = moments(|t| {
            let s = (t - LAG_S).max(0.0);
            DeckStage {
                position: [0.0, 0.0, -1.3 - 6.0 * s * s],
                velocity: [0.0, 0.0, -12.0 * s],
                ..known()
            }
        });
        assert_eq!(hit.not_now(&c).map(|r| r.code), Some(ReasonCode::TakeOffHit));
    }

    #[test]
    fn moment_of_a_level_deck() {
        let c = MissionConfig::default();
        let rolls = |t: f64| DeckStage {
            euler: [0.17 * (1.5 * (t - 1.25)).sin(), 0.0, 0.0],
            ..known()
        };
        let m = moments(rolls);
        assert!(m.not_now(&c).is_some());
        let (wait_s, best) = m.later.unwrap();
        assert!(
            (0.3..1.1).contains(&wait_s) && best.whole() > 0.95,
            "{wait_s} s: {best:?}"
        );
        assert_eq!(m.none_soon(&c), None);
    }
}
