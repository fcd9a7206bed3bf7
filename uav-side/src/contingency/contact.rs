//! Compares the contact of a completed landing with the contact during a climb.
//!
//! Both use one prediction with the newest forecast. In NED along the vertical, over a deck that moves down at `d(t)`
//! and has the normal `n(t)`, the drone changes from its vertical speed to the reference (that of the climb, or `d +
//! sink`) with at most the acceleration of [`Climb`], and moves along with the deck. The gap is `n . (p(t) - c(t)) -
//! feet - half_span |sin(tilt)|`, where a climb is level and a landing ends aligned (`tilt = 0`). The forecast's error,
//! which makes both contacts harder, is neglected.

use alight_shared::{
    geometry::DroneGeometry,
    landing::{MAX_MPS, MAX_TILT_RAD},
    msg::{DeckForecast, DeckStage},
    time::{DroneTime, Span},
};
use nalgebra::Vector3;

use super::{climb::Climb, completion::SINK_MPS};

/// Speed of a hard contact along the deck's normal, m/s: the limit of a good contact plus the speed's error.
pub(crate) const HARD_MPS: f64 = 1.5;
/// Distance from the deck below which the feet rest on it, m: the forecast's error.
const AT_REST_M: f64 = 0.15;
/// Time from the decision to climb until the drone accelerates, s: one planner period, one link period, the thrust's
/// lag of 0.05 s, and half of the rotors' slew of 0.23 s. A landing is already braking.
const REACTION_S: f64 = 0.2;
/// Difference between two contact speeds below which they count as equal and the drone climbs, m/s.
const ALIKE_MPS: f64 = 0.01;
/// Time after which a climb no longer touches the deck, s: the drone has gained three metres.
const HORIZON_S: f64 = 1.5;
/// Step of the prediction, s: a power of two, so that distances at constant speed add without rounding.
const STEP_S: f64 = 1.0 / 64.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PredictedContact {
    /// Closing speed along the deck's normal, m/s.
    pub speed_mps: f64,
    /// Angle between the normals of drone and deck, rad.
    pub tilt_rad: f64,
}

impl PredictedContact {
    pub fn is_harmful(&self) -> bool {
        self.speed_mps > MAX_MPS || self.tilt_rad > MAX_TILT_RAD
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactOutcomes {
    pub rests: bool,
    pub landing: PredictedContact,
    /// Contact of a climb; None if the climb clears the deck.
    pub climb: Option<PredictedContact>,
}

impl ContactOutcomes {
    /// Outcomes from `now` for a drone at `position` with `velocity` (NED); None beyond the forecast's horizon.
    pub(crate) fn predict(
        now: DroneTime,
        forecast: &DeckForecast,
        position: &Vector3<f64>,
        velocity: &Vector3<f64>,
        drone: &DroneGeometry,
    ) -> Option<ContactOutcomes> {
        let start = now.max(forecast.header.at);
        let here = forecast.at(start)?;
        let aside = position - Vector3::from(here.position);
        let prediction = Prediction {
            start,
            forecast,
            aside,
            climb: Climb::new(position.z, velocity.z, drone),
            feet_m: drone.feet_below_m,
            half_span_m: 0.5 * drone.feet_span_m[0].hypot(drone.feet_span_m[1]),
        };
        let soft = PredictedContact {
            speed_mps: SINK_MPS,
            tilt_rad: 0.0,
        };
        let landing = prediction
            .contact(ContactOutcome::Landing)
            .map_or(soft, |c| PredictedContact {
                speed_mps: c.speed_mps.max(SINK_MPS),
                tilt_rad: 0.0,
            });
        Some(ContactOutcomes {
            rests: (here.height_of(position) - drone.feet_below_m).abs() < AT_REST_M,
            landing,
            climb: prediction.contact(ContactOutcome::Climb),
        })
    }

    /// Whether the feet are on the deck, or a climb would hit the deck harder than completing the landing.
    pub fn landing_is_softer(&self) -> bool {
        let limit = self.landing.speed_mps + ALIKE_MPS;
        self.rests || self.climb.is_some_and(|c| c.speed_mps > limit)
    }
    /// Whether a climb would end in a harmful contact. This decides on a deck where a landed drone would not stay:
    /// there a harder contact is acceptable, but not a harmful one.
    pub fn climb_is_harmful(&self) -> bool {
        self.rests || self.landing_is_softer() && self.climb.is_some_and(|c| c.is_harmful())
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum ContactOutcome {
    Landing,
    Climb,
}

struct Prediction<'a> {
    start: DroneTime,
    forecast: &'a DeckForecast,
    /// Position relative to the deck's centre, NED, m.
    aside: Vector3<f64>,
    climb: Climb,
    feet_m: f64,
    half_span_m: f64,
}

impl Prediction<'_> {
    fn contact(&self, end: ContactOutcome) -> Option<PredictedContact> {
        let mut climb = self.climb;
        let mut deck = self.forecast.at(self.start)?;
        let mut before = self.gap(end, &climb, &deck);
        for k in 1..=(HORIZON_S / STEP_S) as u32 {
            let t = STEP_S * f64::from(k);
            match end {
                ContactOutcome::Landing => climb.sink(STEP_S, deck.velocity[2], SINK_MPS),
                ContactOutcome::Climb if t <= REACTION_S => climb.z += climb.velocity * STEP_S,
                ContactOutcome::Climb => climb.advance(STEP_S, deck.velocity[2]),
            }
            deck = self.forecast.at(self.start + Span::from_secs(t))?;
            let left = self.gap(end, &climb, &deck);
            let closing = (before - left) / STEP_S;
            if left <= 0.0 && closing > 0.0 && closing.is_finite() {
                return Some(PredictedContact {
                    speed_mps: closing,
                    tilt_rad: deck.normal().xy().norm().min(1.0).asin(),
                });
            }
            before = left;
        }
        None
    }

    fn gap(&self, end: ContactOutcome, climb: &Climb, deck: &DeckStage) -> f64 {
        let n = deck.normal();
        let r = Vector3::new(self.aside.x, self.aside.y, climb.z - deck.position[2]);
        let spread = match end {
            ContactOutcome::Landing => 0.0,
            ContactOutcome::Climb => self.half_span_m * n.xy().norm(),
        };
        n.dot(&r) - self.feet_m - spread
    }
}

#[cfg(test)]
impl ContactOutcomes {
    pub(crate) fn of_speeds(landing_mps: f64, climb_mps: Option<f64>) -> ContactOutcomes {
        let at = |speed_mps| PredictedContact {
            speed_mps,
            tilt_rad: 0.0,
        };
        ContactOutcomes {
            rests: false,
            landing: at(landing_mps),
            climb: climb_mps.map(at),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{forecast, header, level};
    use alight_shared::time::Time;
    use proptest::prelude::*;

    /// Outcomes from `clearance` above a deck at `deck(t)` = (z, velocity), while sinking at `sink`.
    fn ends(clearance: f64, sink: f64, deck: impl Fn(f64) -> (f64, f64)) -> ContactOutcomes {
        let now = Time::from_secs(10.0);
        let f = forecast(header(1, now), |t| DeckStage {
            velocity: [0.0, 0.0, deck(t).1],
            ..level([0.0, 0.0, deck(t).0])
        });
        let drone = DroneGeometry::default();
        let p = Vector3::new(0.0, 0.0, deck(0.0).0 - drone.feet_below_m - clearance);
        ContactOutcomes::predict(now, &f, &p, &Vector3::new(0.0, 0.0, sink), &drone).unwrap()
    }
    fn climb_mps(clearance: f64, sink: f64, deck: impl Fn(f64) -> (f64, f64)) -> Option<f64> {
        ends(clearance, sink, deck).climb.map(|c| c.speed_mps)
    }

    #[test]
    fn climb_from_a_resting_deck() {
        // The drone sinks for 0.2 s at 0.5 m/s, then by v² / 2a: 0.11 m in total.
        assert_eq!(climb_mps(0.14, 0.5, |_| (-1.3, 0.0)), None);
        let touch = climb_mps(0.08, 0.5, |_| (-1.3, 0.0));
        assert!(touch.is_some_and(|v| (0.05..=0.5).contains(&v)), "{touch:?}");
        // A drone that climbs from a deck that supports it has no impact.
        assert_eq!(climb_mps(0.0, 0.0, |_| (-1.3, 0.0)), None);
    }

    #[test]
    fn climb_from_a_rising_deck() {
        // The deck accelerates upwards at 4 m/s² from now on, to 2 m/s.
        let rising = |t: f64| {
            let v = (4.0 * t).min(2.0);
            let way = 0.5 * v * v / 4.0 + 2.0 * (t - 0.5).max(0.0);
            (-1.3 - way, -v)
        };
        assert_eq!(climb_mps(0.6, 0.5, rising), None);
        let touch = climb_mps(0.2, 0.5, rising);
        assert!(touch.is_some_and(|v| v > 0.5), "{touch:?}");
        assert!(ends(0.2, 0.5, rising).landing_is_softer());
    }

    #[test]
    fn landing_with_height_for_a_soft_contact() {
        let landing = |clearance, sink| ends(clearance, sink, |_| (-1.3, 0.0)).landing.speed_mps;
        for sink in [0.4, 2.0] {
            assert!((landing(0.5, sink) - SINK_MPS).abs() < 1e-9, "{sink}");
        }
        // v² = 2² - 2 a 0.1, at half of the rotors' acceleration beyond hover.
        let hard = landing(0.1, 2.0);
        assert!((1.3..1.7).contains(&hard), "{hard}");
    }

    fn sea(amplitude: f64, period: f64, phase: f64, pitch: f64) -> DeckForecast {
        let w = core::f64::consts::TAU / period;
        forecast(header(1, Time::from_secs(10.0)), |t| {
            let (sin, cos) = (w * t + phase).sin_cos();
            DeckStage {
                velocity: [2.0, 0.0, -amplitude * w * cos],
                euler: [0.0, pitch * cos, 0.0],
                ..level([2.0 * t, 0.0, -1.3 - amplitude * sin])
            }
        })
    }

    proptest! {
        #[test]
        fn climb_that_meets_the_deck_harder(
            amplitude in 0.0..2.0_f64, period in 3.0..10.0_f64, phase in 0.0..6.3_f64, pitch in 0.0..0.3_f64,
            clearance in -0.2..1.5_f64, sink in -2.0..3.0_f64,
        ) {
            let f = sea(amplitude, period, phase, pitch);
            let drone = DroneGeometry::default();
            let deck = f.stages[0];
            let p = Vector3::from(deck.position) + deck.normal() * (drone.feet_below_m + clearance);
            let v = Vector3::new(2.0, 0.0, deck.velocity[2] + sink);
            let ends = ContactOutcomes::predict(f.header.at, &f, &p, &v, &drone).unwrap();
            prop_assert!(ends.landing.speed_mps >= SINK_MPS);
            prop_assert!(ends.landing.speed_mps <= sink.max(SINK_MPS) + 1.6 * amplitude * 3.0 + 0.5, "{ends:?}");
            if !ends.landing_is_softer() {
                prop_assert!(ends.climb.is_none_or(|c| c.speed_mps <= ends.landing.speed_mps + ALIKE_MPS));
            }
        }

        #[test]
        fn ends_of_finite_input_are_finite(
            p in prop::array::uniform3(-1e300..1e300_f64), v in prop::array::uniform3(-1e300..1e300_f64),
            deck in prop::array::uniform6(-1e300..1e300_f64), mass_kg in 1e-3..1e6_f64, near in any::<bool>(),
        ) {
            let scale = if near { 1e-299 } else { 1.0 };
            let of = |x: f64| x * scale;
            let f = forecast(header(1, Time::from_secs(10.0)), |t| DeckStage {
                velocity: [of(deck[0]), of(deck[1]), of(deck[2])],
                euler: [of(deck[3]), of(deck[4]), 0.0],
                ..level([of(deck[5]), of(deck[4]), of(deck[2]) * t])
            });
            let drone = DroneGeometry { mass_kg, ..DroneGeometry::default() };
            let ends = ContactOutcomes::predict(f.header.at, &f, &Vector3::from(p.map(of)), &Vector3::from(v.map(of)), &drone);
            let ends = ends.unwrap();
            for c in [Some(ends.landing), ends.climb].into_iter().flatten() {
                prop_assert!(c.speed_mps.is_finite() && c.tilt_rad.is_finite(), "{ends:?}");
            }
        }
    }
}
