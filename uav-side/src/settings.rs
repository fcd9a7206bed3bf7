//! Configuration of the drone's nodes in one place.

use alight_shared::{
    config,
    geometry::{DeckGeometry, DroneGeometry},
    msg::VesselLevel,
    tags::{DeckTag, Tags},
};

use crate::{
    camera::{CameraSettings, layout},
    mission::MissionConfig,
    odometry::OdometryConfig,
    pilot::{Output, PilotConfig},
    planner::{PlannerConfig, PlannerKind},
    predictor::PredictorConfig,
};

/// Clearance at which the paper's planner flares, m. Not published; v_fa = 0.5 m/s for a second. Below 0.55 m the tag
/// is out of view, so a flare from 0.9 m adds 0.25 s of drift before contact. Seeds from 100, position errors with 0.9
/// m and 0.5 m: 0,0 0.048 and 0.037 m, 0.5,5 0.064 and 0.047, 0.4,4 0.071 and 0.058, 0.8,5 0.091 and 0.074; tilt p95 at
/// 0.5,5 1.37 and 1.03 deg; all land at the same speed.
const PAPER_FLARE_M: f64 = 0.5;

impl PlannerKind {
    /// Mission parameters for this planner: those that assume the other planner are replaced.
    pub fn mission(self, base: MissionConfig) -> MissionConfig {
        match self {
            PlannerKind::Alight => base,
            PlannerKind::MpcFaa => MissionConfig {
                flare_clearance_m: base.flare_clearance_m.min(PAPER_FLARE_M),
                commit_clearance_m: base.commit_clearance_m.min(PAPER_FLARE_M),
                ..base
            },
        }
    }
}

config! {
    /// Configuration of the drone's camera, predictor, mission, planner and pilot.
    pub struct DroneSettings {
        /// Geometry and mass of the drone, as measured by its owner.
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
    check |this, at| {
        at.require(
            !this.mission.takeoff || this.pilot.output == Output::Attitude,
            "mission.takeoff",
            this.mission.takeoff,
            "false with pilot.output = \"trajectory\": a take-off from a moving deck needs attitude and thrust set-points",
        )?;
    }
}

impl DroneSettings {
    /// Tags of the deck; a single tag has the number from the detector's settings.
    pub fn tags(&self) -> Tags {
        let id = self.deck.tag_side_m.map(|_| self.camera.tag.id);
        let numbered = |tag: &DeckTag| DeckTag {
            id: id.unwrap_or(tag.id),
            ..*tag
        };
        Tags::filled(self.deck.tags().iter().map(numbered))
    }
    pub fn predictor(&self) -> PredictorConfig {
        PredictorConfig {
            deck: self.deck,
            drone: self.airframe,
            beacons: self.mission.min_vessel <= VesselLevel::Beacon,
            ..self.predictor.clone()
        }
    }
    /// Mission configuration as the selected planner needs it.
    pub fn mission(&self) -> MissionConfig {
        let mission = MissionConfig {
            search_view_m: layout::search_view(&self.tags(), &self.camera),
            ..self.mission.clone()
        };
        self.planner.kind.mission(mission)
    }
}
