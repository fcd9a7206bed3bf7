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

/// Nearer to the deck than this a drone is within its reach, whatever height was asked for, m.
const NEAR_DECK_M: f64 = 3.0;

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
        let up = stage.normal();
        let r = body.position - Vector3::from(stage.position);
        Some(DeckBelow {
            stage,
            around: forecast.surroundings,
            clearance: up.dot(&r) - drone.feet_below_m,
            normal_speed: up.dot(&(body.velocity - Vector3::from(stage.velocity))),
        })
    }

    /// Whether a drone without mission or plan has to climb with the deck: near enough to be reached by it or what stands on
    /// the vessel, and not yet as high over the deck as the mission has asked for (`height_m`).
    pub(crate) fn is_near(&self, body: &Body, height_m: f64, drone: &DroneGeometry) -> bool {
        let aside = (body.position - Vector3::from(self.stage.position)).xy().norm();
        let clear = (height_m - BELOW_M - drone.feet_below_m).max(NEAR_DECK_M);
        aside < ring_m(&self.around, drone) && self.clearance < clear
    }
}
