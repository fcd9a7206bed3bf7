//! Errors of the estimates on which a drone lands, with their stated standard deviations.

use alight_shared::{
    frames::{Deck, DroneBody, VesselBody, wrap_angle},
    msg::{DeckForecast, DroneState, VesselEstimate},
    time::{DroneTime, VesselClock},
};

use super::foresight::{OdometryError, stage_of};
use crate::physics::body::RigidState;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateError {
    pub quantity: &'static str,
    /// Estimate minus truth, and its stated standard deviation, m, m/s or rad.
    pub error: f64,
    pub sd: f64,
}

impl EstimateError {
    pub fn in_deviations(&self) -> f64 {
        self.error.abs() / self.sd.max(f64::MIN_POSITIVE)
    }
}

/// Errors of the vessel's estimate at its own time: velocity, roll, pitch, heading. Its position has no truth: the
/// vessel's plane moves with the receiver's bias.
pub(super) fn of_vessel(
    estimate: &VesselEstimate<VesselClock>,
    truth: &RigidState<VesselBody>,
) -> Vec<EstimateError> {
    let sd = |dof: usize, k: usize| f64::from(estimate.uncertainty[dof][k]);
    let velocity = truth.velocity.0;
    let angles = truth.euler();
    let of_velocity = ["vessel north", "vessel east", "vessel down"]
        .into_iter()
        .enumerate()
        .map(|(k, quantity)| EstimateError {
            quantity,
            error: f64::from(estimate.eta_dot[k]) - velocity[k],
            sd: sd(k, 1),
        });
    let of_angles = ["vessel roll", "vessel pitch", "vessel heading"]
        .into_iter()
        .enumerate()
        .map(|(k, quantity)| EstimateError {
            quantity,
            error: wrap_angle(estimate.eta[3 + k] - angles[k]),
            sd: sd(3 + k, 0),
        });
    of_velocity.chain(of_angles).collect()
}

/// Errors of a forecast's present deck: velocity, roll and pitch. None without a stage of the present. Its heading
/// turns with the autopilot's, and its position with the camera's mount (in landings without a fault 3 to 6 deviations
/// for 5 s, 10 m above the deck); the rules on contacts judge both.
pub(super) fn of_deck(
    forecast: &DeckForecast,
    drone: &DroneState,
    now: DroneTime,
    (own, deck): (&RigidState<DroneBody>, &RigidState<Deck>),
) -> Option<Vec<EstimateError>> {
    let stage = forecast.at(now)?;
    let odometry = OdometryError::of(drone, now, own);
    let truth = stage_of(deck, &odometry.position, &odometry.velocity);
    let of_velocity = ["deck velocity north", "deck velocity east", "deck velocity down"]
        .into_iter()
        .enumerate()
        .map(|(k, quantity)| EstimateError {
            quantity,
            error: stage.velocity[k] - truth.velocity[k],
            sd: stage.velocity_sd[k],
        });
    let of_angles = ["deck roll", "deck pitch"]
        .into_iter()
        .enumerate()
        .map(|(k, quantity)| EstimateError {
            quantity,
            error: stage.euler[k] - truth.euler[k],
            sd: stage.euler_sd[k],
        });
    Some(of_velocity.chain(of_angles).collect())
}
