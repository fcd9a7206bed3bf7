//! Start of a predictor whose predecessor may have led the drone onto the deck.
//!
//! By the radio alone the deck's position has the error of two GNSS receivers, metres, and a filter that has just seen
//! its first tag does not know the velocity of a vessel under way. A drone low above the deck would follow such a
//! forecast off the deck. A successor therefore publishes nothing until its forecast agrees with the end of the last
//! plan, for at most [`INHERITS_S`]. Without a plan it is a first start.

use alight_shared::{
    checkpoint::Recovery,
    msg::{DeckForecast, MissionState, Plan, PredictorCheckpoint},
    time::DroneTime,
};
use nalgebra::Vector3;

use super::config::PredictorConfig;

/// Maximum age of a plan that a successor inherits, s: the deck's motion is predictable for about as long.
const INHERITS_S: f64 = 2.0;
/// Maximum distance between the plan's end and the forecast deck, m: half of the feet's span, with which a drone that
/// aims at the centre keeps its feet on the smallest deck.
const AGREES_M: f64 = 0.2;
/// Maximum difference of their horizontal velocities, m/s: [`AGREES_M`] within the last half second.
const AGREES_MPS: f64 = 0.4;

#[derive(Clone, Debug, Default)]
pub(super) struct PredictorSuccession {
    pub(super) recovery: Recovery<PredictorCheckpoint>,
    /// Whether the predecessor's checkpoint has been applied or is missing.
    pub(super) is_read: bool,
    /// Newest plan whose stages reach the touchdown.
    plan: Option<Plan>,
    /// Target of the feet relative to the deck's centre, NED, m.
    meets: [f64; 2],
}

impl PredictorSuccession {
    pub(super) fn receive(&mut self, plan: Option<&Plan>, mission: Option<&MissionState>) {
        // Only a plan that reaches the deck shows where it is.
        if let Some(plan) = plan
            && let Some(touchdown) = plan.touchdown_at
            && touchdown - plan.header.at <= plan.step * plan.stages.len() as i64
        {
            self.plan = Some(*plan);
        }
        self.meets = mission.map_or(self.meets, |m| m.meets);
    }

    /// Whether `forecast` may lead the drone.
    pub(super) fn agrees(&self, now: DroneTime, forecast: &DeckForecast, c: &PredictorConfig) -> bool {
        let inherited = self.plan.filter(|p| (now - p.header.at).secs() <= INHERITS_S);
        let Some((plan, touchdown)) = inherited.and_then(|p| Some((p, p.touchdown_at?))) else {
            return true;
        };
        let at = touchdown.max(forecast.header.at);
        let (Some(end), Some(deck)) = (plan.sample(at), forecast.at(at)) else {
            return false;
        };
        let [north, east] = self.meets;
        let aside =
            Vector3::from(end.position) - Vector3::from(deck.position) - Vector3::new(north, east, 0.0);
        let apart = Vector3::from(end.velocity) - Vector3::from(deck.velocity);
        let above_m = deck.height_of(&Vector3::from(end.position)) - c.drone.feet_below_m;
        aside.xy().norm() <= AGREES_M && above_m.abs() <= AGREES_M && apart.xy().norm() <= AGREES_MPS
    }
}
