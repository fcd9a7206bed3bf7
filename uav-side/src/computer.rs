//! The drone's computer: its nodes in the order of the data flow. Read this file first: each row is a process, wired by
//! the `wiring!` in its node's file. The rows run over shared memory on a drone and in lock-step in the simulated
//! world.

use alight_bridge::{Bridge, BridgeConfig};
use alight_shared::{bus::computer, process::ProcessKind};

use crate::{
    autopilot::{AutopilotLink, AutopilotLinkConfig},
    camera::{CameraNode, node::CameraIdentity, uvdar::UvdarNode},
    mission::MissionNode,
    pilot::{Output, Pilot},
    planner::Planner,
    predictor::Predictor,
    settings::DroneSettings,
};

computer! {
    /// Rows of the drone's computer in the order of the data flow. The autopilot link runs twice per round: first to
    /// read, last to send the pilot's set-point. Nodes with a checkpoint start as successors.
    DroneRows of DroneNodes {
        /// Drone end of the radio link: the vessel's messages, stamped with the drone's clock.
        bridge: Bridge => ProcessKind::Bridge, |nodes, boot| {
            Bridge::new(&nodes.bridge, boot).disarmed_within(nodes.autopilot.disarm.longest_s())
        };
        /// Autopilot link.
        autopilot: AutopilotLink => ProcessKind::Autopilot, |nodes, boot| {
            let drone = &nodes.drone;
            let attitudes = drone.pilot.output == Output::Attitude;
            AutopilotLink::new(&nodes.autopilot, &drone.odometry, &drone.airframe, attitudes, nodes.id(), boot)
        };
        /// Belly camera: deck poses from tags.
        camera: CameraNode => ProcessKind::Camera, |nodes, boot| {
            CameraNode::new(&nodes.drone.camera, &nodes.drone.tags(), nodes.camera(boot))
        };
        /// Ultraviolet camera: deck poses from blinking markers.
        uvdar: UvdarNode => ProcessKind::Uvdar, |nodes, boot| {
            UvdarNode::new(&nodes.drone.camera.uvdar, nodes.camera(boot))
        };
        /// Forecast of the deck's motion.
        predictor: Predictor => ProcessKind::Predictor, |nodes, boot| {
            Predictor::new(&nodes.drone.predictor(), boot).as_successor()
        };
        /// State machine of the landing.
        mission: MissionNode => ProcessKind::Mission, |nodes, boot| nodes.mission(boot).as_successor();
        /// Trajectory planner.
        planner: Planner => ProcessKind::Planner, |nodes, boot| {
            let drone = &nodes.drone;
            Planner::new(&drone.planner, &drone.airframe, &drone.deck, boot)
        };
        /// Set-point generator.
        pilot: Pilot => ProcessKind::Pilot, |nodes, boot| {
            let drone = &nodes.drone;
            Pilot::new(&drone.pilot, &drone.airframe, &drone.deck, nodes.id(), boot)
        };
    }
    /// The only list of the drone's processes.
    PROCESSES: Installed, RowVisitor
}

#[derive(Clone, Debug)]
pub struct DroneNodes {
    pub bridge: BridgeConfig,
    pub autopilot: AutopilotLinkConfig,
    pub drone: DroneSettings,
}

impl DroneNodes {
    /// A mission that starts without a predecessor.
    pub fn mission(&self, boot: u32) -> MissionNode {
        let drone = &self.drone;
        let id = self.id();
        MissionNode::new(&drone.mission(), &drone.airframe, &drone.deck, id, boot)
    }
    fn id(&self) -> u32 {
        self.bridge.drone_id
    }
    fn camera(&self, boot: u32) -> CameraIdentity {
        let vessel = self.bridge.vessel_id;
        let drone = self.id();
        CameraIdentity { vessel, drone, boot }
    }
}
