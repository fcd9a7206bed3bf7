//! How hard the deck would meet a drone that climbs away from it.

use alight_shared::geometry::DroneGeometry;
use alight_shared::msg::DeckForecast;
use alight_shared::time::{DroneClock, Span, Time};
use nalgebra::Vector3;

use super::climb::Climb;

/// From the decision to the acceleration, s: a period of the planner and one of the link, the thrust's lag of 0.05 s, and
/// half of the 0.23 s in which the rotors' slew builds it up.
const REACTION_S: f64 = 0.2;
/// A climb that has not touched the deck for so long does not any more, s: it has gained three metres.
const HORIZON_S: f64 = 1.5;
/// Step of the prediction, s.
const STEP_S: f64 = 0.05;

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
    fn climb_from_a_resting_deck_touches_only_within_the_way_that_it_takes_to_brake() {
        // 0.2 s at 0.5 m/s, then v² / 2a: 0.11 m.
        assert_eq!(contact(0.14, 0.5, |_| (-1.3, 0.0)), None);
        let touch = contact(0.08, 0.5, |_| (-1.3, 0.0));
        assert!(touch.is_some_and(|v| (0.05..=0.5).contains(&v)), "{touch:?}");
        // Away from a deck that it stands on: no impact.
        assert_eq!(contact(0.0, 0.0, |_| (-1.3, 0.0)), None);
    }

    #[test]
    fn climb_from_a_deck_that_begins_to_rise_needs_more_height() {
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
