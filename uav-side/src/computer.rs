//! The drone's computer: its nodes in the order in which data flow. Read this first: each row is a process, wired by the
//! `wiring!` in its node's file, over shared memory on a drone and in lock-step in the simulated world.

use alight_bridge::{Bridge, BridgeConfig};
use alight_shared::bus::computer;
use alight_shared::node::Node;
use alight_shared::process::ProcessKind;
use alight_shared::time::DroneClock;

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
    /// autopilot has sent, at last with the pilot's set-point.
    DroneRows {
        /// The drone's end of the radio: the vessel's messages on the drone's clock.
        bridge: Bridge => ProcessKind::Bridge,
        /// The link to the autopilot.
        autopilot: AutopilotLink => ProcessKind::Autopilot,
        /// The belly camera: poses of the deck by its tags.
        camera: CameraNode => ProcessKind::Camera,
        /// The ultraviolet camera: fixes of the deck by its blinking markers.
        uvdar: UvdarNode => ProcessKind::Uvdar,
        /// The deck's forecast.
        predictor: Predictor => ProcessKind::Predictor,
        /// The state machine.
        mission: MissionNode => ProcessKind::Mission,
        /// The trajectory.
        planner: Planner => ProcessKind::Planner,
        /// The set-points.
        pilot: Pilot => ProcessKind::Pilot,
    }
    /// The drone's processes: there is no other list of them.
    PROCESSES: Process
}

/// Configurations of the nodes of a drone's computer.
#[derive(Clone, Debug)]
pub struct DroneNodes {
    /// The bridge.
    pub bridge: BridgeConfig,
    /// The link to the autopilot.
    pub autopilot: AutopilotLinkConfig,
    /// All others.
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

/// A node of the drone's computer as it starts.
pub trait Installed: Process + Node<Clock = DroneClock> {
    /// For a start with this boot id. Where a node keeps a checkpoint, it begins as the successor of a crashed one.
    fn installed(computer: &DroneNodes, boot: u32) -> Self;
}

impl Installed for Bridge {
    fn installed(computer: &DroneNodes, boot: u32) -> Bridge {
        let disarm_s = computer.autopilot.disarm.longest_s();
        Bridge::new(&computer.bridge, boot).disarmed_within(disarm_s)
    }
}
impl Installed for AutopilotLink {
    fn installed(computer: &DroneNodes, boot: u32) -> AutopilotLink {
        let drone = &computer.drone;
        let attitudes = drone.pilot.output == Output::Attitude;
        let (config, id) = (&computer.autopilot, computer.id());
        AutopilotLink::new(config, &drone.odometry, &drone.airframe, attitudes, id, boot)
    }
}
impl Installed for CameraNode {
    fn installed(computer: &DroneNodes, boot: u32) -> CameraNode {
        let drone = &computer.drone;
        CameraNode::new(&drone.camera, &drone.tags(), computer.camera(boot))
    }
}
impl Installed for UvdarNode {
    fn installed(computer: &DroneNodes, boot: u32) -> UvdarNode {
        UvdarNode::new(&computer.drone.camera.uvdar, computer.camera(boot))
    }
}
impl Installed for Predictor {
    fn installed(computer: &DroneNodes, boot: u32) -> Predictor {
        Predictor::new(&computer.drone.predictor(), boot).as_successor()
    }
}
impl Installed for MissionNode {
    fn installed(computer: &DroneNodes, boot: u32) -> MissionNode {
        computer.mission(boot).as_successor()
    }
}
impl Installed for Planner {
    fn installed(computer: &DroneNodes, boot: u32) -> Planner {
        let drone = &computer.drone;
        Planner::new(&drone.planner, &drone.airframe, &drone.deck, boot)
    }
}
impl Installed for Pilot {
    fn installed(computer: &DroneNodes, boot: u32) -> Pilot {
        let drone = &computer.drone;
        Pilot::new(&drone.pilot, &drone.airframe, computer.id(), boot)
    }
}
