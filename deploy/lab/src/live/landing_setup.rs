//! Configurations of the computers and of the simulated world for one live landing.

use std::path::PathBuf;

use alight_computer::{
    config::{
        DroneComputerConfig, VesselComputerConfig,
        camera::{CameraSource, UltravioletSource},
        recorder::RecorderConfig,
        supervision::Supervision,
    },
    exit::CliError,
    process::{instance::OwnedInstance, supervisor::arguments},
};
use alight_shared::{config, process::ProcessKind};
use alight_sim::{
    autopilots::FirmwareConfig,
    physics::streams::Streams,
    sensors::clocks::{ClockModel, Clocks},
};
use alight_transport::{
    clock::{ProcessClock, steady_ns},
    radio::RadioConfig,
};
use alight_uav::{autopilot::AutopilotLinkConfig, computer};
use alight_usv::{DeckConfig, sensors::SourcesConfig};

use crate::{
    args::PlannerChoice,
    live::{
        air::RadioPath,
        args::LandArgs,
        config::{Attachments, AutopilotKind, SimulatedWorld, attached, free_port, sources, write},
    },
    scene::Scene,
};

/// Delay from the start of the processes to the world's time zero, ns.
const START_DELAY_NS: i64 = 1_500_000_000;

pub struct LandingSetup {
    pub air: RadioPath,
    pub vessel: VesselComputerConfig,
    pub drone: DroneComputerConfig,
    vessel_file: PathBuf,
    pub drone_file: PathBuf,
    world: PathBuf,
    attachments: Attachments,
    attachments_file: PathBuf,
    /// Directory in which processes record; None without a recording.
    pub flight: Option<PathBuf>,
    pub clock: ProcessClock,
    pub warm_up_s: f64,
    pub ids: (u32, u32),
}

impl LandingSetup {
    pub fn of(scene: &Scene, args: &LandArgs, owned: &OwnedInstance) -> Result<LandingSetup, CliError> {
        let epoch_ns = steady_ns() + START_DELAY_NS;
        let streams = Streams::new(args.seed);
        let clocks = Clocks::new(&scene.scenario.sensors.clocks, &streams);
        let clock = |c: &ClockModel| ProcessClock {
            epoch_ns,
            offset_s: c.offset().secs(),
            drift_ppm: c.drift() * 1e6,
        };
        let air = RadioPath::of(scene, args, owned, epoch_ns)?;
        let mavlink = format!("127.0.0.1:{}", free_port()?);
        let attachments = Attachments {
            impairment: air.impairment.clone(),
            baseline: scene.nodes.baseline,
            exec: match &args.scene.planner {
                Some(PlannerChoice::Exec(command)) => Some(command.clone()),
                Some(PlannerChoice::Included(_)) | None => None,
            },
        };
        let line = |name: &str| format!("serial://{}:115200", owned.file(name).display());
        let sensors = sources(&scene.scenario, |k| line(&format!("tty-sensor-{k}")));
        let receiver = owned.file("tty-receiver");
        let vessel = VesselComputerConfig {
            sensor: SourcesConfig {
                sources: sensors.clone(),
            },
            ..vessel_computer(scene, args, &air, clock(&clocks.vessel))
        };
        let mut drone = drone_computer(scene, args, &air, clock(&clocks.drone), &mavlink);
        drone.autopilot = scene
            .scenario
            .sensors
            .wired(&drone.autopilot, &line("tty-receiver"));
        let world = SimulatedWorld {
            epoch_ns,
            mavlink,
            sensors,
            receiver: scene.scenario.sensors.moving_base.map(|_| receiver),
            ..simulated_world(scene, args)?
        };
        Ok(LandingSetup {
            air,
            vessel_file: write(owned, "vessel.toml", &vessel)?,
            drone_file: write(owned, "drone.toml", &drone)?,
            world: write(owned, "world.toml", &world)?,
            attachments_file: write(owned, "attachments.toml", &attachments)?,
            attachments,
            clock: drone.clock,
            warm_up_s: scene.scenario.start.warm_up_s,
            ids: (drone.bridge.vessel_id, drone.bridge.drone_id),
            // A recording is made from the processes' own files, which without --log are removed with the instance.
            flight: match (&args.log, &args.record) {
                (Some(flight), _) => Some(flight.clone()),
                (None, Some(_)) => Some(owned.file("flight")),
                (None, None) => None,
            },
            vessel,
            drone,
        })
    }
    pub fn arguments(&self, kind: ProcessKind) -> Vec<String> {
        let config = if computer::PROCESSES.contains(&kind) || kind == ProcessKind::View {
            &self.drone_file
        } else if alight_usv::computer::PROCESSES.contains(&kind) {
            &self.vessel_file
        } else {
            &self.world
        };
        let attachable = [ProcessKind::Vessel, ProcessKind::Bridge, ProcessKind::Planner].contains(&kind);
        if attachable && self.attachments != Attachments::default() {
            attached(kind.name(), &self.attachments_file, config)
        } else {
            arguments(kind, config)
        }
    }
}

fn vessel_computer(
    scene: &Scene,
    args: &LandArgs,
    air: &RadioPath,
    clock: ProcessClock,
) -> VesselComputerConfig {
    let [tls, _] = air.tls.clone();
    VesselComputerConfig {
        vessel_id: scene.nodes.bridge.vessel_id,
        instance: args.instance.clone(),
        clock,
        radio: RadioConfig::listening(&air.listen, tls),
        deck: DeckConfig::default(),
        vessel: scene.nodes.vessel.clone(),
        ..VesselComputerConfig::default()
    }
}

/// Configuration of the drone's computer in a scene whose simulated autopilot sends to `mavlink`.
fn drone_computer(
    scene: &Scene,
    args: &LandArgs,
    air: &RadioPath,
    clock: ProcessClock,
    mavlink: &str,
) -> DroneComputerConfig {
    let [_, tls] = air.tls.clone();
    DroneComputerConfig {
        instance: args.instance.clone(),
        clock,
        radio: RadioConfig::dialling(&air.dial, tls),
        autopilot: AutopilotLinkConfig {
            connect: args.connect.clone().unwrap_or(match args.flown_by() {
                AutopilotKind::Internal => format!("udpin://{mavlink}"),
                kind @ (AutopilotKind::Px4 | AutopilotKind::Ardupilot) => kind.connect().into(),
            }),
            // In a simulation, orders need no signature.
            unsigned_orders: true,
            ..scene.nodes.autopilot.clone()
        },
        bridge: scene.nodes.bridge.clone(),
        camera: CameraSource::of_simulation(scene.scenario.sensors.render.on),
        uvdar: UltravioletSource::default(),
        supervision: Supervision::default(),
        recorder: RecorderConfig::default(),
        view: scene.view(),
        drone: scene.nodes.settings(),
    }
}

/// Simulated vehicles of a scene, without links and without a time zero.
fn simulated_world(scene: &Scene, args: &LandArgs) -> Result<SimulatedWorld, CliError> {
    Ok(SimulatedWorld {
        instance: args.instance.clone(),
        seed: args.seed,
        sea: scene.sea.clone(),
        planner: scene.nodes.planner_name().into(),
        truth: args.record.is_some(),
        goes_on_s: args.goes_on_s(),
        plot: args.plot.clone(),
        autopilot: args.flown_by(),
        firmware: match &args.firmware {
            Some(path) => config::load(path)?,
            None => FirmwareConfig::default(),
        },
        ground_station: args.ground_station.map(|a| a.to_string()),
        scenario: scene.scenario.drawn(args.seed),
        ..SimulatedWorld::default()
    })
}
