//! State of the drone relative to the deck below it.

use alight_shared::{
    geometry::{DeckGeometry, DroneGeometry, GRAVITY},
    landing::FRICTION,
    msg::{DeckForecast, DeckStage, DroneState},
    surroundings::Surroundings,
    time::DroneTime,
};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::climb::BELOW_M;
use crate::surroundings::ring_m;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Body {
    /// Position in the drone's NED, m.
    pub(crate) position: Vector3<f64>,
    /// m/s.
    pub(crate) velocity: Vector3<f64>,
    /// Rotation from body to NED.
    pub(crate) attitude: UnitQuaternion<f64>,
}

impl Body {
    /// Extrapolates odometry that is `age_s` old.
    pub(crate) fn of(drone: &DroneState, age_s: f64) -> Body {
        Body {
            position: drone.position() + drone.velocity() * age_s,
            velocity: drone.velocity(),
            attitude: drone.attitude(),
        }
    }
    pub(crate) fn yaw(&self) -> f64 {
        self.attitude.euler_angles().2
    }
}

/// Height above the deck below which the deck can reach a climbing drone, whatever height is requested, m.
pub(crate) const NEAR_DECK_M: f64 = 3.0;
/// Clearance of a holding drone above the highest predicted deck, m.
const KEEPS_CLEAR_M: f64 = 1.0;

/// Distance of the feet's centre outside the area where all feet stand, m, beyond which a drone does not stay on the
/// deck.
/// Source: half of the feet's span, with half of the feet off the deck.
pub(crate) const LOST_OUTSIDE_M: f64 = 0.0;
/// Time from a contact to the stop of the motors, s, and friction on a wet deck that tilts.
const STOPS_S: f64 = 0.3;
/// Tilt above which full thrust throws a drone sideways by more than 4 m/s², rad; time to level, s; deceleration towards
/// the deck meanwhile, m/s².
const LEVEL_RAD: f64 = 0.2;
const LEVELS_S: f64 = 0.3;
const LEVELLING_MPS2: f64 = 5.0;
const WET_FRICTION: f64 = 0.5 * FRICTION;

/// Distance of the feet's centre (in the deck's plane, along and across, m) outside the area on which all feet stand,
/// m; negative inside.
pub(crate) fn outside_m(feet: &Vector2<f64>, deck: &DeckGeometry, drone: &DroneGeometry) -> f64 {
    let along = feet.x.abs() - 0.5 * (deck.length_m - drone.feet_span_m[0]);
    let across = feet.y.abs() - 0.5 * (deck.width_m - drone.feet_span_m[1]);
    along.max(across)
}

/// Slide of feet that touch the deck with the speed `v` along it, m: `v (T + |v| / (2 mu g))`.
pub(crate) fn slide(v: &Vector2<f64>) -> Vector2<f64> {
    v * (STOPS_S + v.norm() / (2.0 * WET_FRICTION * GRAVITY))
}

/// Deck after `t` (s) at its present acceleration and angular rates.
pub(crate) fn propagated(stage: &DeckStage, t: f64) -> DeckStage {
    let p = stage.position;
    let v = stage.velocity;
    let a = stage.acceleration;
    DeckStage {
        position: core::array::from_fn(|i| p[i] + v[i] * t + 0.5 * a[i] * t * t),
        velocity: core::array::from_fn(|i| v[i] + a[i] * t),
        euler: core::array::from_fn(|i| stage.euler[i] + stage.euler_rates[i] * t),
        ..*stage
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct DeckBelow {
    pub(crate) stage: DeckStage,
    /// Deck from the forecast's first stage, its rates and acceleration, without the prediction.
    pub(crate) measured: DeckStage,
    pub(crate) around: Surroundings,
    /// Height of the foot plane above the deck, along the deck's normal, m.
    pub(crate) clearance: f64,
    /// Speed away from the deck along its normal, m/s.
    pub(crate) normal_speed: f64,
    /// Centre of the feet in the deck's plane after a contact now, m.
    pub(crate) rests_at: Vector2<f64>,
    /// Predicted rise of the deck up to the forecast's horizon, m.
    rises: f64,
}

impl DeckBelow {
    /// Deck at `now`; None beyond the forecast's horizon.
    pub(crate) fn of(
        now: DroneTime,
        forecast: &DeckForecast,
        body: &Body,
        drone: &DroneGeometry,
    ) -> Option<DeckBelow> {
        let now = now.max(forecast.header.at);
        let stage = forecast.at(now)?;
        let first = forecast.stages.first()?;
        let to_deck = stage.rotation().transpose();
        let feet = body.position + body.attitude * Vector3::z() * drone.feet_below_m;
        let along = to_deck * (body.velocity - Vector3::from(stage.velocity));
        let rises = forecast.stages.iter().map(|s| stage.position[2] - s.position[2]);
        Some(DeckBelow {
            stage,
            measured: propagated(first, (now - forecast.header.at).secs()),
            around: forecast.surroundings,
            clearance: stage.height_of(&body.position) - drone.feet_below_m,
            normal_speed: stage.speed_away(&body.velocity),
            rests_at: (to_deck * (feet - Vector3::from(stage.position))).xy() + slide(&along.xy()),
            rises: rises.fold(0.0, f64::max),
        })
    }

    /// Replaces the clearance (m) by that of another witness.
    pub(crate) fn with_clearance(self, clearance: f64) -> DeckBelow {
        DeckBelow { clearance, ..self }
    }

    /// Whether a drone without a plan turns level before it climbs: full thrust would throw it along its tilt into an
    /// obstacle, and the deck leaves time.
    pub(crate) fn levels_first(&self, body: &Body) -> bool {
        let tilt = (body.attitude * Vector3::z()).angle(&Vector3::z());
        let closing = (-self.normal_speed).max(0.0);
        let stops_m = closing * LEVELS_S + closing.powi(2) / (2.0 * LEVELLING_MPS2);
        !self.around.keep_out.is_empty() && tilt > LEVEL_RAD && self.clearance > stops_m
    }

    /// Whether a drone without mission or plan must climb with the deck: the deck or an obstacle can reach it, now or
    /// after the predicted rise, and it is below the mission's height above the deck (`height_m`).
    pub(crate) fn is_near(&self, body: &Body, height_m: f64, drone: &DroneGeometry) -> bool {
        let aside = (body.position - Vector3::from(self.stage.position)).xy().norm();
        let asked = height_m - BELOW_M - drone.feet_below_m;
        let clear = asked.max(NEAR_DECK_M).max(self.rises + KEEPS_CLEAR_M);
        aside < ring_m(&self.around, drone) && self.clearance < clear
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{forecast, header, level};
    use alight_shared::time::Time;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn hold_keeps_clear_of_the_predicted_deck(
            amplitude in 0.0..4.0_f64, period in 2.0..10.0_f64, phase in 0.0..6.3_f64, clearance in 0.0..12.0_f64,
            height_m in 0.0..8.0_f64, offset in -9.0..9.0_f64,
        ) {
            let w = core::f64::consts::TAU / period;
            let heave = |t: f64| -1.3 - amplitude * (w * t + phase).sin();
            let f = forecast(header(1, Time::from_secs(10.0)), |t| level([0.0, 0.0, heave(t)]));
            let drone = DroneGeometry::default();
            let body = Body {
                position: Vector3::new(offset, 0.0, heave(0.0) - drone.feet_below_m - clearance),
                velocity: Vector3::zeros(),
                attitude: UnitQuaternion::identity(),
            };
            let below = DeckBelow::of(f.header.at, &f, &body, &drone).unwrap();
            let highest = f.stages.iter().map(|s| s.position[2]).fold(f64::INFINITY, f64::min);
            let clearance = highest - drone.feet_below_m - body.position.z;
            prop_assert!(below.is_near(&body, height_m, &drone) || clearance > KEEPS_CLEAR_M - 1e-9, "{clearance}");
        }
    }
}
