//! A drone's computer in lock-step: the rows of [`DroneRows`], stepped once per tick in a fixed order. The
//! far ends of their edges (radio, autopilot wire, cameras, sensors) are simulated.

mod steps;

use core::cell::Cell;
use std::{collections::BTreeMap, rc::Rc};

use super::{
    bus::{LockStep, LockStepSender},
    cameras::SimulatedCameras,
    failing::{Failing, Spoiled, spoil_sensors},
    foresight::Foresight,
    link::{Checkpoints, LinkedAutopilot},
    mutant::Mutant,
    observer::WorldObserver,
    physics::{DRONE_ID, Physics},
    scenario::{NodeConfigs, Scenario},
};
use crate::{
    autopilots::simulated::SimulatedAutopilot,
    baselines::own::{OwnReport, Predict},
    radio::{ChannelCounts, Session},
    sensors::{bytes::boat::RECEIVER, delay::DelayLine, noise::Noise},
};
use alight_bridge::{BridgeConfig, Packet};
use alight_shared::{
    bus::{Reader as _, Row, Wired, Writer as _, readers},
    checkpoint::{CheckpointStore, Republisher},
    msg::{
        AutopilotState, CameraLight, Command, CommandKind, DeckForecast, DroneState, EstimateUpdate, Header,
        MissionState, Plan, SetPoint, TagPose, UvdarFix, still_armed_s,
    },
    process::ProcessKind,
    radio::RadioTopic,
    time::{DroneClock, DroneTime, Span, Stamped, Time, VesselClock, WorldTime},
    wire,
};
use alight_uav::{
    autopilot::{AutopilotLink, receiver::ReceiverDecoder},
    computer::{DroneNodes, DroneRows, Installed, PROCESSES},
    mission::MissionConfig,
};

const MAX_PLANS: usize = 64;
/// Maximum number of packets that wait for a frozen bridge.
const MAX_WAITING: usize = 4096;
/// First boot id of a second vessel with the same identity.
const TWIN_BOOT: u32 = 1000;

/// Senders outside the rows: operators' orders, plans after their solve time, detections of measurement models.
struct Outside {
    commands: LockStepSender<Command>,
    plans: LockStepSender<Plan>,
    tags: LockStepSender<TagPose>,
    uvdar: LockStepSender<UvdarFix>,
    light: LockStepSender<CameraLight>,
}

impl Outside {
    fn join(bus: &LockStep) -> Outside {
        // Measurement models replace the cameras.
        let camera = bus.of(ProcessKind::Camera);
        Outside {
            commands: bus.sender(),
            // Through the planner's wrapper, if any.
            plans: bus.of(ProcessKind::Planner).sender(),
            tags: camera.sender(),
            uvdar: bus.of(ProcessKind::Uvdar).sender(),
            light: camera.sender(),
        }
    }
}

readers! {
    struct Observer {
        odometry: DroneState,
        autopilot: AutopilotState,
        forecast: DeckForecast,
        mission: MissionState,
        set_point: SetPoint,
    }
}

pub struct SimulatedDroneComputer {
    pub(super) k: usize,
    pub(super) boot: u32,
    /// Boot ids: of the first processes, and of the last start of each process.
    first_boot: u32,
    boots: BTreeMap<ProcessKind, u32>,
    pub(super) radio: Session<Packet>,
    /// Bus of the drone's processes, where tests may change messages.
    pub bus: LockStep,
    /// Rows; None if the process is dead.
    pub(super) rows: DroneRows<LockStep>,
    nodes: DroneNodes,
    frozen: Vec<ProcessKind>,
    /// Packets that wait for a frozen bridge.
    pub(super) waiting: Vec<Packet>,
    cameras: Option<SimulatedCameras>,
    /// None before the drone appears.
    pub(super) linked: Option<LinkedAutopilot>,
    /// Decoder of the drone's own GNSS receiver, and bytes for that receiver.
    receiver: ReceiverDecoder,
    corrections: Vec<u8>,
    repeated_range_m: Option<f64>,
    /// Lead of the computer's steady clock over its simulated clock model.
    pub(super) ahead: Span,
    /// The pilot has switched to OFFBOARD (GUIDED) once.
    pub(super) handed_over: bool,
    kept: Republisher<LockStep>,
    pub(super) is_dead: bool,
    stood_still_until: WorldTime,
    plans: DelayLine<Plan>,
    law: OwnReport,
    /// Predictor supplied by the caller, and its report.
    own_predictor: Option<Box<Predict>>,
    predicted: OwnReport,
    solve_delay: Span,
    pub(super) slower: Span,
    outside: Outside,
    observer: Observer<LockStep>,
    mutant: Option<Mutant>,
    /// Change of the vessel's clock relative to this computer's since the start.
    pub(super) apart: Rc<Cell<Span>>,
    spoiled: Option<Spoiled>,
    /// Position of a second vessel with the same identity, m north of the first; 0: no second vessel.
    twin_m: f64,
    stands_still: bool,
    /// Newest odometry that the bridge's process has read.
    pub odometry: Option<DroneState>,
    pub mission_state: MissionState,
    pub forecast: Option<DeckForecast>,
    autopilot_state: AutopilotState,
    pub last_set_point: Option<SetPoint>,
}

/// Packet of another vessel with the same identity; None if the packet is not an estimate.
fn twin(packet: &Stamped<DroneClock, Packet>, north_m: f64) -> Option<Stamped<DroneClock, Packet>> {
    if packet.value.kind != RadioTopic::Estimate {
        return None;
    }
    let mut estimate: EstimateUpdate<VesselClock> = wire::decode(&packet.value.bytes).ok()?;
    estimate.header.boot = estimate.header.boot.wrapping_add(TWIN_BOOT);
    estimate.position[0] += north_m as f32;
    let bytes = wire::encode(&estimate).ok()?;
    let value = Packet {
        bytes,
        ..packet.value.clone()
    };
    Some(Stamped::new(packet.at, value))
}

/// Time within which a forced descent begins once the drone is steady above the deck, s.
const BEGINS_WITHIN_S: f64 = 20.0;

fn drone_nodes(k: usize, scenario: &Scenario, nodes: &NodeConfigs) -> DroneNodes {
    let mut drone = nodes.settings();
    let reserved = drone.mission.reservation_required || scenario.drones > 1;
    drone.mission = MissionConfig {
        reservation_required: reserved,
        ..drone.mission
    };
    DroneNodes {
        bridge: BridgeConfig {
            drone_id: DRONE_ID + k as u32,
            ..nodes.bridge.clone()
        },
        autopilot: scenario.sensors.wired(&nodes.autopilot, RECEIVER),
        drone,
    }
}

fn row<N: Installed>(bus: &LockStep, node: N) -> Option<Box<Row<N, LockStep>>> {
    Row::join(&bus.of(N::KIND), node).ok().map(Box::new)
}

fn start(
    rows: &mut DroneRows<LockStep>,
    process: ProcessKind,
    (bus, nodes): (&LockStep, &NodeConfigs),
    installed: (&DroneNodes, u32),
    report: &OwnReport,
) {
    let Ok(()) = rows.start(process, &bus.of(process), installed);
    if process == ProcessKind::Planner {
        rows.planner = row(bus, nodes.planner(installed.1, report));
    }
}

/// Returns the row if its process is alive, in `runs`, and due for a step.
fn due<N: Wired>(
    row: &mut Option<Box<Row<N, LockStep>>>,
    runs: bool,
    now: Time<N::Clock>,
) -> Option<&mut Box<Row<N, LockStep>>> {
    row.as_mut().filter(|_| runs)?.is_due(now).then_some(())?;
    row.as_mut()
}

impl SimulatedDroneComputer {
    pub(super) fn new(
        k: usize,
        scenario: &Scenario,
        nodes: &NodeConfigs,
        physics: &Physics,
        boot: u32,
    ) -> Self {
        SimulatedDroneComputer::on(LockStep::default(), k, (scenario, nodes, physics), boot)
    }
    fn on(
        bus: LockStep,
        k: usize,
        (scenario, nodes, physics): (&Scenario, &NodeConfigs, &Physics),
        boot: u32,
    ) -> Self {
        let streams = physics.streams().of_drone(k);
        let made = drone_nodes(k, scenario, nodes);
        let moment = || Span::from_secs(BEGINS_WITHIN_S * Noise::new(&streams, "begin_anyway").uniform());
        let forced = scenario.begin_anyway.then(moment);
        let render = &scenario.sensors.render;
        let Ok(kept) = Republisher::join(&bus, CheckpointStore::default());
        let Ok(observer) = Observer::join(&bus);
        let law = OwnReport::default();
        let predicted = OwnReport::default();
        let own_predictor = nodes.predictor.as_ref();
        let own_predictor = own_predictor.map(|own| own.start(&made.drone, &predicted));
        let mut rows = DroneRows {
            // The mission's process has been running since before this flight.
            mission: row(&bus, made.mission(boot).forced_descent(forced)),
            ..DroneRows::default()
        };
        let others = [
            (ProcessKind::Mission, false),
            (ProcessKind::Autopilot, false),
            (ProcessKind::Camera, render.on),
            (ProcessKind::Uvdar, render.markers),
        ];
        for process in PROCESSES.iter().filter(|p| !others.contains(&(**p, false))) {
            start(&mut rows, *process, (&bus, nodes), (&made, boot), &law);
        }
        SimulatedDroneComputer {
            k,
            boot,
            first_boot: boot,
            boots: BTreeMap::new(),
            radio: Session::new(&scenario.radio, &streams),
            rows,
            frozen: Vec::new(),
            waiting: Vec::new(),
            cameras: SimulatedCameras::new(scenario, &made.drone.camera, &streams),
            nodes: made,
            linked: None,
            receiver: ReceiverDecoder::default(),
            corrections: Vec::new(),
            repeated_range_m: None,
            ahead: Span::ZERO,
            handed_over: false,
            kept,
            is_dead: false,
            stood_still_until: Time::EPOCH,
            plans: DelayLine::new(MAX_PLANS),
            law,
            own_predictor,
            predicted,
            solve_delay: Span::from_secs(scenario.solve_delay_s),
            slower: Span::ZERO,
            outside: Outside::join(&bus),
            observer,
            bus,
            mutant: None,
            apart: Rc::default(),
            spoiled: None,
            twin_m: 0.0,
            stands_still: false,
            odometry: None,
            mission_state: MissionState::default(),
            forecast: None,
            autopilot_state: AutopilotState::default(),
            last_set_point: None,
        }
    }

    pub(super) fn fail(&mut self, failing: &Failing) {
        self.frozen.clone_from(&failing.frozen.processes);
        self.stands_still = failing.frozen.computer;
        self.radio.fail(failing.radio);
        self.slower = Span::from_secs(failing.solve_s);
        self.twin_m = failing.twin_m;
        let bus = &self.bus;
        let spoiled = self.spoiled.get_or_insert_with(|| {
            let spoiled = Spoiled::default();
            spoil_sensors(bus, &spoiled);
            spoiled
        });
        *spoiled.borrow_mut() = failing.drone;
        if let Some(linked) = &mut self.linked {
            linked.fail(failing);
        }
    }
    pub(super) fn mutate(&mut self, mutant: Option<Mutant>) {
        if let Some(new) = mutant.filter(|_| self.mutant != mutant) {
            self.mutant = mutant;
            new.stand(&self.bus, self.nodes.bridge.drone_id, &self.apart);
        }
    }

    pub(super) fn kill(&mut self, process: ProcessKind) {
        self.rows.kill(process);
        if process == ProcessKind::Bridge {
            self.waiting.clear();
        }
        self.frozen.retain(|p| *p != process);
    }
    /// Restarts the process with or without its checkpoint, unless the supervisor is dead.
    pub(super) fn start(
        &mut self,
        process: ProcessKind,
        checkpoints: Checkpoints,
        (physics, nodes): (&Physics, &NodeConfigs),
    ) {
        if self.is_dead {
            return;
        }
        self.begin_boot(checkpoints, physics);
        self.boots.insert(process, self.boot);
        self.start_row(process, nodes);
    }
    fn start_row(&mut self, process: ProcessKind, nodes: &NodeConfigs) {
        start(
            &mut self.rows,
            process,
            (&self.bus, nodes),
            (&self.nodes, self.boot),
            &self.law,
        );
    }
    pub(super) fn kill_all(&mut self) {
        self.is_dead = true;
        self.rows = DroneRows::default();
        self.frozen.clear();
    }
    pub(super) fn start_all(
        &mut self,
        checkpoints: Checkpoints,
        (scenario, nodes, physics): (&Scenario, &NodeConfigs, &Physics),
    ) {
        self.begin_boot(Checkpoints::Kept, physics);
        let new = SimulatedDroneComputer::on(self.bus.clone(), self.k, (scenario, nodes, physics), self.boot);
        self.succeed(new);
        if checkpoints == Checkpoints::Lost {
            *self.kept.store_mut() = CheckpointStore::default();
        }
        self.start_row(ProcessKind::Mission, nodes);
        self.start_row(ProcessKind::Autopilot, nodes);
    }
    /// Draws the boot id of the next starts, and publishes or discards the checkpoints.
    fn begin_boot(&mut self, checkpoints: Checkpoints, physics: &Physics) {
        self.kept.take(physics.drone_now(self.k) + self.ahead);
        self.boot += 1;
        if checkpoints == Checkpoints::Lost {
            *self.kept.store_mut() = CheckpointStore::default();
        }
    }
    /// Replaces the computer of the same drone.
    fn succeed(&mut self, new: SimulatedDroneComputer) {
        let before = core::mem::replace(self, new);
        *self.kept.store_mut() = before.kept.store().clone();
        self.radio = before.radio;
        self.linked = before.linked;
        self.handed_over = before.handed_over;
        self.ahead = before.ahead;
        self.apart = before.apart;
        self.mutant = before.mutant;
        self.spoiled = before.spoiled;
    }
    /// Restarts the steady clock; checkpoints on disk are kept.
    pub(super) fn restart_clock(&mut self, now: DroneTime, ahead: Span) {
        self.kept.take(now);
        self.ahead = ahead;
        *self.kept.store_mut() = self.kept.store().lasting();
    }
    pub(super) fn command(&mut self, kind: CommandKind, physics: &mut Physics) {
        let header = self.header(physics);
        self.outside.commands.send(&Command { header, kind });
    }

    pub(super) fn appear(&mut self, physics: &mut Physics) {
        physics.place_drone(self.k);
        let streams = physics.streams().of_drone(self.k);
        self.linked = physics
            .autopilot(self.k)
            .map(|(config, autopilot)| LinkedAutopilot::new(config, &streams, autopilot));
        self.boots.insert(ProcessKind::Autopilot, self.boot);
        self.rows.autopilot = row(&self.bus, AutopilotLink::installed(&self.nodes, self.boot));
        if physics.starts_on_deck() {
            if let Some(l) = &mut self.linked {
                l.autopilot.arm(false);
            }
            // Prevents a second switch by the pilot.
            self.handed_over = true;
        }
    }

    pub fn autopilot(&self) -> Option<&SimulatedAutopilot> {
        self.linked.as_ref().map(|l| &l.autopilot)
    }
    pub fn autopilot_is_aligned(&self) -> bool {
        self.linked.as_ref().is_some_and(|l| l.autopilot.is_aligned())
    }
    /// Packets that the radio carried and lost: to the drone, to the vessel.
    pub fn radio_counts(&self) -> [ChannelCounts; 2] {
        self.radio.counts()
    }
    /// Whether the process is alive, and its boot id.
    fn process(&self, process: ProcessKind) -> (bool, u32) {
        let boot = self.boots.get(&process).copied().unwrap_or(self.first_boot);
        (self.runs(process), boot)
    }
    fn runs(&self, process: ProcessKind) -> bool {
        !self.frozen.contains(&process)
    }

    /// Steps each row in order; steps the link a second time, with the pilot's set-point.
    pub(super) fn tick(
        &mut self,
        physics: &mut Physics,
        reports_status: bool,
        foresight: Option<&Foresight>,
        observer: &mut dyn WorldObserver,
    ) {
        let t = physics.now();
        let now = physics.drone_clock(self.k).ahead(self.ahead).read(t);
        if self.stands_still {
            // Data from radio and wire wait, and are stamped when read.
            self.stood_still_until = t;
            let _lost = physics.drone_readings(self.k);
            return;
        }
        let packets = self.packets(physics);
        if self.is_dead {
            let _lost = physics.drone_readings(self.k);
            let _lost = self.linked.as_mut().map(|linked| linked.received(t));
            return;
        }
        self.kept.poll(now);
        self.step_bridge((t, now), packets, reports_status, observer);
        if self.linked.is_some() {
            self.receive_from_autopilot((t, now), physics, observer);
            self.sense((t, now), physics, observer);
            self.step_predictor((t, now), physics, foresight, observer);
            for plan in &self.plans.arrived(t) {
                self.outside.plans.send(plan);
            }
            self.step_mission((t, now), observer);
            self.step_planner((t, now), observer);
            self.step_pilot((t, now), observer);
            let runs = self.runs(ProcessKind::Autopilot);
            if due(&mut self.rows.autopilot, runs, now).is_some() {
                self.step_link((t, now), Vec::new(), observer);
            }
        }
        self.look(now);
    }

    /// Packets that have arrived, on the drone's clock.
    fn packets(&mut self, physics: &Physics) -> Vec<Stamped<DroneClock, Packet>> {
        let clock = physics.drone_clock(self.k).ahead(self.ahead);
        let read_from = self.stood_still_until;
        let stamped = |(arrival, packet)| Stamped::new(clock.read(read_from.max(arrival)), packet);
        let arrived = self.radio.at_drone(physics.now());
        let mut packets: Vec<_> = arrived.into_iter().map(stamped).collect();
        if self.twin_m != 0.0 {
            let twins: Vec<_> = packets.iter().filter_map(|p| twin(p, self.twin_m)).collect();
            packets.extend(twins);
        }
        packets
    }
    fn look(&mut self, now: DroneTime) {
        let t = now.nanos();
        let o = &mut self.observer;
        // Messages are large and therefore copied only if new.
        if let Some(m) = o.odometry.newest(t) {
            self.odometry = Some(m);
        }
        if let Some(m) = o.autopilot.newest(t) {
            self.autopilot_state = m;
        }
        if let Some(m) = o.forecast.newest(t) {
            self.forecast = Some(m);
        }
        if let Some(m) = o.mission.newest(t) {
            self.mission_state = m;
        }
        if let Some(m) = o.set_point.newest(t) {
            self.last_set_point = Some(m);
        }
    }

    pub(super) fn header(&self, physics: &mut Physics) -> Header<DroneClock> {
        let mut header = physics.header(self.k);
        header.at += self.ahead;
        header
    }
    /// Reasons why a planner or predictor supplied by the caller has no answer.
    pub fn own_failures(&self) -> impl Iterator<Item = String> {
        let of = |(part, report): (_, &OwnReport)| Some(format!("{part}: {}", report.failure()?));
        [("planner", &self.law), ("predictor", &self.predicted)]
            .into_iter()
            .filter_map(of)
    }
    /// Last reported time armed on the deck without an order, s.
    pub fn still_armed_s(&self) -> Option<f64> {
        let mission = &self.mission_state;
        let armed = self.autopilot_state.armed;
        let disarm_s = self.nodes.autopilot.disarm.longest_s();
        still_armed_s(mission.header.at, mission, armed, disarm_s)
    }
}

type Moment = (WorldTime, DroneTime);
