//! The configuration of the drone's nodes in one place.

use alight_shared::config;
use alight_shared::geometry::{DeckGeometry, DroneGeometry};

use crate::camera::CameraSettings;
use crate::mission::MissionConfig;
use crate::odometry::OdometryConfig;
use crate::pilot::PilotConfig;
use crate::planner::PlannerConfig;
use crate::predictor::PredictorConfig;

config! {
    /// Everything that the drone's camera, predictor, mission, planner and pilot need to know.
    pub struct DroneSettings {
        /// The drone, as measured by its owner.
        pub airframe: DroneGeometry;
        /// The deck to land on.
        pub deck: DeckGeometry;
        /// Odometry.
        pub odometry: OdometryConfig;
        /// Camera.
        pub camera: CameraSettings;
        /// Predictor.
        pub predictor: PredictorConfig;
        /// Mission.
        pub mission: MissionConfig;
        /// Planner.
        pub planner: PlannerConfig;
        /// Pilot.
        pub pilot: PilotConfig;
    }
}

impl DroneSettings {
    /// The predictor's configuration, with this drone and this deck, as the chosen planner has it.
    pub fn predictor(&self) -> PredictorConfig {
        self.planner.kind.predictor(PredictorConfig {
            deck: self.deck,
            drone: self.airframe,
            ..self.predictor.clone()
        })
    }
    /// The mission's configuration, as the chosen planner has it.
    pub fn mission(&self) -> MissionConfig {
        self.planner.kind.mission(self.mission.clone())
    }
}
