//! Climb away from the deck: one law for the planner that flies it and the mission that predicts its contact.
//!
//! In NED, with the deck's velocity down `d(t)` by its forecast and the drone's `v`: wanted is
//! `v*(t) = max(min(d, 0) - climb, -greatest)`, with the deck and up from it, but not down after a deck that sinks,
//! because that one comes back; and `|dv/dt|` is at most half of what the rotors give beyond hover, so that the other half
//! is left for the attitude.

use alight_shared::geometry::{DroneGeometry, GRAVITY};
use alight_shared::msg::DeckForecast;
use alight_shared::time::{DroneClock, Span, Time};
use nalgebra::Vector3;

/// A drone no further than this from above the deck's centre is over the vessel or beside it, m: the deck and what
/// stands on the vessel can reach it.
pub(crate) const WITH_DECK_M: f64 = 10.0;
/// So far below the height that it is to have the drone is clear of the vessel, and no longer on its way up, m.
pub(crate) const BELOW_M: f64 = 1.0;
/// Climb relative to a deck that rises or rests, m/s: the planner's for any climb.
const CLIMB_MPS: f64 = 3.0;
/// Greatest climb, m/s: the planner's limit on vertical speed.
const GREATEST_MPS: f64 = 4.0;
/// Greatest acceleration of any drone, m/s²: the planner's slew of the rotors builds it up within [`REACTION_S`].
const ACCELERATION_MPS2: f64 = 9.0;
/// From the decision to the acceleration, s: a period of the planner and one of the link, the thrust's lag of 0.05 s, and
/// half of the 0.23 s in which the rotors' slew builds it up.
const REACTION_S: f64 = 0.2;
/// A climb that has not touched the deck for so long does not any more, s: it has gained three metres.
const HORIZON_S: f64 = 1.5;
/// Step of the prediction, s.
const STEP_S: f64 = 0.05;

/// Height and vertical speed on the way up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Climb {
    /// NED z, m.
    pub(crate) z: f64,
    /// NED, m/s.
    pub(crate) velocity: f64,
    /// Bound of its change, m/s².
    acceleration: f64,
}

impl Climb {
    /// A climb of this drone that begins at the height `z` with this velocity.
    pub(crate) fn new(z: f64, velocity: f64, drone: &DroneGeometry) -> Climb {
        let surplus = drone.max_thrust_n / drone.mass_kg - GRAVITY;
        Climb {
            z,
            velocity,
            acceleration: (0.5 * surplus).clamp(0.0, ACCELERATION_MPS2),
        }
    }

    /// `dt` later (s) over a deck that moves down at `deck` (m/s).
    pub(crate) fn advance(&mut self, dt: f64, deck: f64) {
        self.towards((deck.min(0.0) - CLIMB_MPS).max(-GREATEST_MPS), dt);
    }

    /// `dt` later (s) on its way to a rest; at once from a standstill.
    pub(crate) fn rest(&mut self, dt: f64) {
        self.towards(0.0, dt);
    }

    fn towards(&mut self, wanted: f64, dt: f64) {
        let most = self.acceleration * dt;
        let before = self.velocity;
        self.velocity += (wanted - before).clamp(-most, most);
        self.z += 0.5 * (before + self.velocity) * dt;
    }

    /// The constant deceleration (m/s²) by which a drone that sinks at `sinking` relative to the deck, `clearance` above it,
    /// meets it at `least`: `a = (v0² - v²) / 2 h`, within its bound; 0 when it is slower.
    pub(crate) fn braking(&self, sinking: f64, clearance: f64, least: f64) -> f64 {
        let spare = sinking.max(0.0).powi(2) - least.powi(2);
        (spare.max(0.0) / (2.0 * clearance.max(0.01))).min(self.acceleration)
    }

    /// The speed (m/s) at which a drone that sinks at `sinking` relative to the deck, `clearance` above it, meets it when it
    /// brakes from now on, no slower than `least`: `v² = v0² - 2 a h`.
    pub(crate) fn braked(&self, sinking: f64, clearance: f64, least: f64) -> f64 {
        let left = sinking.max(0.0).powi(2) - 2.0 * self.acceleration * clearance.max(0.0);
        left.max(0.0).sqrt().max(least)
    }
}

/// The speed (m/s) at which the deck would meet the feet of a drone that climbs away from now on, at `position` with
/// `velocity` (NED) and moving along with the deck; None when it does not.
///
/// Gap along the deck's normal `n` at the time `t`: `n . (p(t) - c(t)) - feet - span |sin(tilt)|`, of a drone that levels
/// itself over a deck with the centre `c`. The forecast's error is left out: it makes the contact of a landing harder just
/// as that of a climb, and the two are compared.
pub(crate) fn contact_speed(
    now: Time<DroneClock>,
    forecast: &DeckForecast,
    position: &Vector3<f64>,
    velocity: &Vector3<f64>,
    drone: &DroneGeometry,
) -> Option<f64> {
    let start = now.max(forecast.header.at);
    let here = forecast.at(start)?;
    let aside = position - Vector3::from(here.position);
    let half_span = 0.5 * drone.feet_span_m[0].hypot(drone.feet_span_m[1]);
    let gap = |climb: &Climb, t: f64| {
        let deck = forecast.at(start + Span::from_secs(t))?;
        let n = deck.normal();
        let r = Vector3::new(aside.x, aside.y, climb.z - deck.position[2]);
        let spread = half_span * n.xy().norm();
        Some((n.dot(&r) - drone.feet_below_m - spread, deck.velocity[2]))
    };
    let mut climb = Climb::new(position.z, velocity.z, drone);
    let (mut before, mut deck) = gap(&climb, 0.0)?;
    for k in 1..=(HORIZON_S / STEP_S) as u32 {
        let t = STEP_S * f64::from(k);
        if t <= REACTION_S {
            climb.z += climb.velocity * STEP_S;
        } else {
            climb.advance(STEP_S, deck);
        }
        let Some((left, moves)) = gap(&climb, t) else {
            break;
        };
        let closing = (before - left) / STEP_S;
        if left <= 0.0 && closing > 0.0 {
            return Some(closing);
        }
        (before, deck) = (left, moves);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{forecast, header, level};
    use alight_shared::msg::DeckStage;

    /// The contact of a climb from `clearance` above a deck at `deck(t)` = (z, velocity), sinking at `sink`.
    fn contact(clearance: f64, sink: f64, deck: impl Fn(f64) -> (f64, f64)) -> Option<f64> {
        let now = Time::from_secs(10.0);
        let f = forecast(header(1, now), |t| DeckStage {
            velocity: [0.0, 0.0, deck(t).1],
            ..level([0.0, 0.0, deck(t).0])
        });
        let drone = DroneGeometry::default();
        let p = Vector3::new(0.0, 0.0, deck(0.0).0 - drone.feet_below_m - clearance);
        contact_speed(now, &f, &p, &Vector3::new(0.0, 0.0, sink), &drone)
    }

    #[test]
    fn climb_from_a_resting_deck() {
        // 0.2 s at 0.5 m/s, then v² / 2a: 0.11 m.
        assert_eq!(contact(0.14, 0.5, |_| (-1.3, 0.0)), None);
        let touch = contact(0.08, 0.5, |_| (-1.3, 0.0));
        assert!(touch.is_some_and(|v| (0.05..=0.5).contains(&v)), "{touch:?}");
        // Away from a deck that it stands on: no impact.
        assert_eq!(contact(0.0, 0.0, |_| (-1.3, 0.0)), None);
    }

    #[test]
    fn braking_to_the_least_speed() {
        let drone = DroneGeometry::default();
        let climb = Climb::new(-2.0, 2.0, &drone);
        let (mut v, mut h) = (2.0_f64, 0.8_f64);
        while h > 0.0 {
            v -= climb.braking(v, h, 0.5) * 1e-3;
            h -= v * 1e-3;
        }
        assert!((v - 0.5).abs() < 0.03, "{v}");
        assert_eq!(climb.braking(0.4, 0.8, 0.5), 0.0);
        // No more than its bound, at whatever height.
        assert_eq!(climb.braking(9.0, -1.0, 0.5), climb.acceleration);
    }

    #[test]
    fn climb_from_a_rising_deck() {
        // Up at 4 m/s² from now on, to 2 m/s.
        let rising = |t: f64| {
            let v = (4.0 * t).min(2.0);
            let way = 0.5 * v * v / 4.0 + 2.0 * (t - 0.5).max(0.0);
            (-1.3 - way, -v)
        };
        assert_eq!(contact(0.6, 0.5, rising), None);
        let touch = contact(0.2, 0.5, rising);
        assert!(touch.is_some_and(|v| v > 0.5), "{touch:?}");
    }
}
