//! The drone and the deck below it.

use alight_shared::geometry::DroneGeometry;
use alight_shared::msg::{DeckForecast, DeckStage, DroneState};
use alight_shared::surroundings::Surroundings;
use alight_shared::time::{DroneClock, Time};
use nalgebra::{UnitQuaternion, Vector3};

use super::climb::BELOW_M;
use crate::surroundings::ring_m;

/// The drone now.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Body {
    /// Drone's NED, m.
    pub(crate) position: Vector3<f64>,
    /// m/s.
    pub(crate) velocity: Vector3<f64>,
    /// Rotation NED from body.
    pub(crate) attitude: UnitQuaternion<f64>,
}

impl Body {
    /// By odometry that is `age_s` old.
    pub(crate) fn of(drone: &DroneState, age_s: f64) -> Body {
        Body {
            position: drone.position() + drone.velocity() * age_s,
            velocity: drone.velocity(),
            attitude: drone.attitude(),
        }
    }
    /// Heading, rad.
    pub(crate) fn yaw(&self) -> f64 {
        self.attitude.euler_angles().2
    }
}

/// Nearer to the deck than this a drone is within its reach, whatever height was asked for, m: more than a deck rises within
/// the time in which it gets there.
pub(crate) const NEAR_DECK_M: f64 = 3.0;
/// A drone that stays where it is keeps this clear of the highest deck that is predicted, m.
const KEEPS_CLEAR_M: f64 = 1.0;

/// The deck relative to the drone, now.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DeckBelow {
    /// The deck by its forecast.
    pub(crate) stage: DeckStage,
    /// What stands around it.
    pub(crate) around: Surroundings,
    /// Foot plane above the deck along its normal, m.
    pub(crate) clearance: f64,
    /// Speed away from the deck along its normal, m/s.
    pub(crate) normal_speed: f64,
    /// How far the deck will rise from here, as far as it is predicted, m.
    rises: f64,
}

impl DeckBelow {
    /// The deck at `now`; None where the forecast does not reach.
    pub(crate) fn of(
        now: Time<DroneClock>,
        forecast: &DeckForecast,
        body: &Body,
        drone: &DroneGeometry,
    ) -> Option<DeckBelow> {
        let stage = forecast.at(now.max(forecast.header.at))?;
        let rises = forecast.stages.iter().map(|s| stage.position[2] - s.position[2]);
        Some(DeckBelow {
            stage,
            around: forecast.surroundings,
            clearance: stage.height_of(&body.position) - drone.feet_below_m,
            normal_speed: stage.speed_away(&body.velocity),
            rises: rises.fold(0.0, f64::max),
        })
    }

    /// The same deck for a drone whose feet are so far above it by another witness, m.
    pub(crate) fn with_clearance(self, clearance: f64) -> DeckBelow {
        DeckBelow { clearance, ..self }
    }

    /// Whether a drone without mission or plan has to climb with the deck: near enough to be reached by it or what stands on
    /// the vessel, now or when the deck has risen, and not yet as high over the deck as the mission has asked for (`height_m`).
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
            let least = highest - drone.feet_below_m - body.position.z;
            prop_assert!(below.is_near(&body, height_m, &drone) || least > KEEPS_CLEAR_M - 1e-9, "{least}");
        }
    }
}
