//! The drone's computer: its nodes in the order in which data flow. Read this first: each row is a process, wired by the
//! `wiring!` in its node's file, over shared memory on a drone and in lock-step in the simulated world.

use alight_bridge::{Bridge, BridgeConfig};
use alight_shared::bus::computer;
use alight_shared::process::ProcessKind;

use crate::autopilot::{AutopilotLink, AutopilotLinkConfig};
use crate::camera::CameraNode;
use crate::camera::node::CameraIdentity;
use crate::camera::uvdar::UvdarNode;
use crate::mission::MissionNode;
use crate::pilot::{Output, Pilot};
use crate::planner::Planner;
use crate::predictor::Predictor;
use crate::settings::DroneSettings;

computer! {
    /// The rows of the drone's computer, in the order in which data flow. The link comes twice in a round: first with what the
    /// autopilot has sent, at last with the pilot's set-point. Where a node keeps a checkpoint, it begins as the successor of a
    /// crashed one.
    DroneRows of DroneNodes {
        /// The drone's end of the radio: the vessel's messages on the drone's clock.
        bridge: Bridge => ProcessKind::Bridge, |of, boot| {
            Bridge::new(&of.bridge, boot).disarmed_within(of.autopilot.disarm.longest_s())
        };
        /// The link to the autopilot.
        autopilot: AutopilotLink => ProcessKind::Autopilot, |of, boot| {
            let drone = &of.drone;
            let attitudes = drone.pilot.output == Output::Attitude;
            AutopilotLink::new(&of.autopilot, &drone.odometry, &drone.airframe, attitudes, of.id(), boot)
        };
        /// The belly camera: poses of the deck by its tags.
        camera: CameraNode => ProcessKind::Camera, |of, boot| {
            CameraNode::new(&of.drone.camera, &of.drone.tags(), of.camera(boot))
        };
        /// The ultraviolet camera: fixes of the deck by its blinking markers.
        uvdar: UvdarNode => ProcessKind::Uvdar, |of, boot| {
            UvdarNode::new(&of.drone.camera.uvdar, of.camera(boot))
        };
        /// The deck's forecast.
        predictor: Predictor => ProcessKind::Predictor, |of, boot| {
            Predictor::new(&of.drone.predictor(), boot).as_successor()
        };
        /// The state machine.
        mission: MissionNode => ProcessKind::Mission, |of, boot| of.mission(boot).as_successor();
        /// The trajectory.
        planner: Planner => ProcessKind::Planner, |of, boot| {
            let drone = &of.drone;
            Planner::new(&drone.planner, &drone.airframe, &drone.deck, boot)
        };
        /// The set-points.
        pilot: Pilot => ProcessKind::Pilot, |of, boot| {
            Pilot::new(&of.drone.pilot, &of.drone.airframe, of.id(), boot)
        };
    }
    /// The drone's processes: there is no other list of them.
    PROCESSES: Installed, RowVisitor
}

/// Configurations of the nodes of a drone's computer.
#[derive(Clone, Debug)]
pub struct DroneNodes {
    pub bridge: BridgeConfig,
    /// The link to the autopilot.
    pub autopilot: AutopilotLinkConfig,
    pub drone: DroneSettings,
}

impl DroneNodes {
    /// The mission, which no other was before.
    pub fn mission(&self, boot: u32) -> MissionNode {
        let drone = &self.drone;
        let id = self.id();
        MissionNode::new(&drone.mission(), &drone.airframe, &drone.deck, id, boot)
    }
    fn id(&self) -> u32 {
        self.bridge.drone_id
    }
    fn camera(&self, boot: u32) -> CameraIdentity {
        let (vessel, drone) = (self.bridge.vessel_id, self.id());
        CameraIdentity { vessel, drone, boot }
    }
}
