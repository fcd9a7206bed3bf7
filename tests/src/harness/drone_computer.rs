//! A drone's computer in lock-step: the rows of [`DroneRows`] over a bus in lock-step, each stepped once a tick in their order,
//! and the other ends of their edges: the radio, the wire to the autopilot, cameras and sensors.

mod steps;

use core::cell::Cell;
use std::collections::BTreeMap;
use std::rc::Rc;

use super::bus::{BusSide, LockStep, LockStepSender};
use super::cameras::SimulatedCameras;
use super::failing::{Failing, Spoiled, spoil_sensors};
use super::foresight::Foresight;
use super::link::{Checkpoints, LinkedAutopilot};
use super::mutant::Mutant;
use super::physics::{DRONE_ID, Physics};
use super::scenario::{NodeConfigs, Scenario};
use super::tap::Tap;
use crate::autopilots::simulated::SimulatedAutopilot;
use crate::radio::{ChannelCounts, Session};
use crate::sensors::bytes::boat::RECEIVER;
use crate::sensors::delay::DelayLine;
use crate::sensors::noise::Noise;
use alight_bridge::{BridgeConfig, Packet};
use alight_shared::bus::{Reader as _, Row, Wired, Writer as _, readers};
use alight_shared::checkpoint::{Keeper, Republisher};
use alight_shared::msg::{
    AutopilotState, CameraLight, Command, CommandKind, DeckForecast, DroneState, DroneStatus, EstimateUpdate,
    Header, MissionState, Plan, SetPoint, TagPose, TimeRequest, UvdarFix, still_armed_s,
};
use alight_shared::process::ProcessKind;
use alight_shared::radio::RadioTopic;
use alight_shared::time::{DroneClock, Span, Stamped, Time, TrueTime, VesselClock};
use alight_shared::wire;
use alight_uav::autopilot::AutopilotLink;
use alight_uav::autopilot::receiver::ReceiverDecoder;
use alight_uav::computer::{DroneNodes, DroneRows, Installed, PROCESSES};
use alight_uav::mission::MissionConfig;

/// Plans under way at a time.
const MAX_PLANS: usize = 64;
/// Packets that wait for a bridge that stands still, at most.
const MAX_WAITING: usize = 4096;
/// A vessel of the same identity counts its starts from here.
const TWIN_BOOT: u32 = 1000;

/// From a drone to the vessel.
#[derive(Clone, Debug)]
pub(super) enum Uplink {
    TimeRequest(TimeRequest<DroneClock>),
    Status(DroneStatus),
}

/// Senders on the bus from outside the rows: operators, plans whose solve time is over, detections where models stand for
/// cameras.
struct Outside {
    commands: LockStepSender<Command>,
    plans: LockStepSender<Plan>,
    tags: LockStepSender<TagPose>,
    uvdar: LockStepSender<UvdarFix>,
    light: LockStepSender<CameraLight>,
}

impl Outside {
    fn join(bus: &LockStep) -> Outside {
        // Models measure in the place of cameras.
        let camera = bus.of(ProcessKind::Camera);
        Outside {
            commands: bus.sender(),
            plans: bus.sender(),
            tags: camera.sender(),
            uvdar: bus.of(ProcessKind::Uvdar).sender(),
            light: camera.sender(),
        }
    }
}

readers! {
    /// Receivers on the bus from outside the rows.
    struct Observer {
        odometry: DroneState,
        autopilot: AutopilotState,
        forecast: DeckForecast,
        mission: MissionState,
        set_point: SetPoint,
    }
}

/// A drone's end of the radio, its computer and what it flies.
pub struct SimulatedDroneComputer {
    pub(super) k: usize,
    pub(super) boot: u32,
    /// The boot id with which its processes began, and of each that was started since.
    first_boot: u32,
    boots: BTreeMap<ProcessKind, u32>,
    pub(super) radio: Session<Packet, Uplink>,
    bus: LockStep,
    /// Processes of the computer; None: one is dead.
    pub(super) rows: DroneRows<LockStep>,
    nodes: DroneNodes,
    /// Processes that stand still.
    frozen: Vec<ProcessKind>,
    /// Packets that wait for a bridge that stands still.
    pub(super) waiting: Vec<Packet>,
    cameras: Option<SimulatedCameras>,
    /// The autopilot and the wire to it; None before the drone has appeared.
    pub(super) linked: Option<LinkedAutopilot>,
    /// Decoder of its own GNSS receiver's bytes, and bytes for that.
    receiver: ReceiverDecoder,
    corrections: Vec<u8>,
    /// Reading that a stuck rangefinder repeats, m.
    repeated_range_m: Option<f64>,
    /// Lead of its steady clock over the drawn one.
    pub(super) ahead: Span,
    /// A person has given it the mode once.
    pub(super) handed_over: bool,
    kept: Republisher<LockStep>,
    /// All of its processes are dead.
    pub(super) is_dead: bool,
    /// The computer stood still until then.
    stood_still_until: Time<TrueTime>,
    plans: DelayLine<Plan>,
    solve_delay: Span,
    /// A plan takes so much longer than that.
    pub(super) slower: Span,
    outside: Outside,
    observer: Observer<LockStep>,
    /// The defect of its nodes.
    mutant: Option<Mutant>,
    /// The vessel's clock is so far ahead of this one's since the start.
    pub(super) apart: Rc<Cell<Span>>,
    /// Faults of its sensors; None: never any.
    spoiled: Option<Spoiled>,
    /// A second vessel of the same identity sends, so far north of the first, m; 0: none does.
    twin_m: f64,
    /// It stands still as a whole.
    stands_still: bool,
    /// The newest odometry, as the bridge's process reads it.
    pub odometry: Option<DroneState>,
    /// The mission's newest state.
    pub mission_state: MissionState,
    /// The newest forecast.
    pub forecast: Option<DeckForecast>,
    autopilot_state: AutopilotState,
    /// The newest set-point.
    pub last_set_point: Option<SetPoint>,
}

/// Another vessel's packet under this one's identity; none of what is no estimate.
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

/// A forced descent begins within this time of being steady, s.
const BEGINS_WITHIN_S: f64 = 20.0;

/// Configurations of the nodes of drone `k` in this scenario.
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

/// A process that runs `node`.
fn row<N: Installed>(bus: &LockStep, node: N) -> Option<Row<N, LockStep>> {
    Row::join(&bus.of(N::KIND), node).ok()
}

/// Starts a process as it is installed, the planner with the law that flies.
fn start(
    rows: &mut DroneRows<LockStep>,
    process: ProcessKind,
    (bus, nodes): (&LockStep, &NodeConfigs),
    installed: (&DroneNodes, u32),
) {
    let Ok(()) = rows.start(process, &bus.of(process), installed);
    if process == ProcessKind::Planner {
        rows.planner = row(bus, nodes.planner(installed.1));
    }
}

/// The row where its process lives, `runs` and steps at `now`.
fn due<N: Wired>(
    row: &mut Option<Row<N, LockStep>>,
    runs: bool,
    now: Time<N::Clock>,
) -> Option<&mut Row<N, LockStep>> {
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
        let Ok(kept) = Republisher::join(&bus, Keeper::default());
        let Ok(observer) = Observer::join(&bus);
        let mut rows = DroneRows {
            // It has run since before this flight.
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
            start(&mut rows, *process, (&bus, nodes), (&made, boot));
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

    /// So much fails of it from now on.
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
    /// Gives its nodes a defect from now on.
    pub(super) fn mutate(&mut self, mutant: Option<Mutant>) {
        if let Some(new) = mutant.filter(|_| self.mutant != mutant) {
            self.mutant = mutant;
            new.stand(&self.bus, self.nodes.bridge.drone_id, &self.apart);
        }
    }
    /// A test flies it: this stands in place of the pilot's set-points.
    pub(super) fn fly_by(&mut self, set_point: SetPoint) {
        let instead = move |_, _: Vec<SetPoint>| vec![set_point];
        self.bus.wrap(ProcessKind::Pilot, BusSide::Written, instead);
    }

    /// A process dies; the others live on.
    pub(super) fn kill(&mut self, process: ProcessKind) {
        self.rows.kill(process);
        if process == ProcessKind::Bridge {
            self.waiting.clear();
        }
        self.frozen.retain(|p| *p != process);
    }
    /// Restarts the process, with or without its predecessor's checkpoint; not where its supervisor is dead.
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
        );
    }
    /// Kills its supervisor, and with it all processes.
    pub(super) fn kill_all(&mut self) {
        (self.is_dead, self.rows) = (true, DroneRows::default());
        self.frozen.clear();
    }
    /// Restarts the supervisor and all processes.
    pub(super) fn start_all(
        &mut self,
        checkpoints: Checkpoints,
        (scenario, nodes, physics): (&Scenario, &NodeConfigs, &Physics),
    ) {
        self.begin_boot(Checkpoints::Kept, physics);
        let new = SimulatedDroneComputer::on(self.bus.clone(), self.k, (scenario, nodes, physics), self.boot);
        self.succeed(new);
        if checkpoints == Checkpoints::Lost {
            *self.kept.keeper_mut() = Keeper::default();
        }
        self.start_row(ProcessKind::Mission, nodes);
        self.start_row(ProcessKind::Autopilot, nodes);
    }
    /// Gives what starts next a new boot id, and the published checkpoints, or none.
    fn begin_boot(&mut self, checkpoints: Checkpoints, physics: &Physics) {
        self.kept.take(physics.drone_now(self.k) + self.ahead);
        self.boot += 1;
        if checkpoints == Checkpoints::Lost {
            *self.kept.keeper_mut() = Keeper::default();
        }
    }
    /// A new computer in the place of this one, on the same drone.
    fn succeed(&mut self, new: SimulatedDroneComputer) {
        let before = core::mem::replace(self, new);
        *self.kept.keeper_mut() = before.kept.keeper().clone();
        (self.radio, self.linked, self.handed_over) = (before.radio, before.linked, before.handed_over);
        (self.ahead, self.apart) = (before.ahead, before.apart);
        (self.mutant, self.spoiled) = (before.mutant, before.spoiled);
    }
    /// Restarts its steady clock, and keeps the checkpoints that lie on the disk.
    pub(super) fn restart_clock(&mut self, now: Time<DroneClock>, ahead: Span) {
        self.kept.take(now);
        self.ahead = ahead;
        *self.kept.keeper_mut() = self.kept.keeper().lasting();
    }
    /// An operator gives its mission a command.
    pub(super) fn command(&mut self, kind: CommandKind, physics: &mut Physics) {
        let header = self.header(physics);
        self.outside.commands.send(&Command { header, kind });
    }

    /// The drone appears in the air, flown by a pilot.
    pub(super) fn appear(&mut self, physics: &mut Physics) {
        physics.place_drone(self.k);
        let streams = physics.streams().of_drone(self.k);
        self.linked = physics
            .autopilot(self.k)
            .map(|(config, autopilot)| LinkedAutopilot::new(config, &streams, autopilot));
        self.boots.insert(ProcessKind::Autopilot, self.boot);
        self.rows.autopilot = row(&self.bus, AutopilotLink::installed(&self.nodes, self.boot));
        if physics.starts_on_deck() {
            self.linked.iter_mut().for_each(|l| l.autopilot.arm(false));
            // The mode is not given to it again.
            self.handed_over = true;
        }
    }

    /// Autopilot of the drone; None before it has appeared.
    pub fn autopilot(&self) -> Option<&SimulatedAutopilot> {
        self.linked.as_ref().map(|l| &l.autopilot)
    }
    /// Whether its autopilot has aligned its heading.
    pub fn autopilot_is_aligned(&self) -> bool {
        self.linked.as_ref().is_some_and(|l| l.autopilot.is_aligned())
    }
    /// Counts of what the radio carried and lost: to the drone, to the vessel.
    pub fn radio_counts(&self) -> [ChannelCounts; 2] {
        self.radio.counts()
    }
    /// Whether a process runs, and the boot id of its start.
    fn process(&self, process: ProcessKind) -> (bool, u32) {
        let boot = self.boots.get(&process).copied().unwrap_or(self.first_boot);
        (self.runs(process), boot)
    }
    /// A process runs.
    fn runs(&self, process: ProcessKind) -> bool {
        !self.frozen.contains(&process)
    }

    /// One step of each row in their order; of the link's a second one, with the pilot's set-point.
    pub(super) fn tick(
        &mut self,
        physics: &mut Physics,
        reports_status: bool,
        foresight: Option<&Foresight>,
        tap: &mut impl Tap,
    ) {
        let t = physics.now();
        let now = physics.drone_clock(self.k).ahead(self.ahead).read(t);
        if self.stands_still {
            // What comes by radio and wire waits, and bears the time of its reading.
            self.stood_still_until = t;
            let _lost = physics.drone_readings(self.k);
            return;
        }
        let packets = self.packets(physics);
        if self.is_dead {
            // What arrives is lost.
            let _lost = physics.drone_readings(self.k);
            let _lost = self.linked.as_mut().map(|linked| linked.received(t));
            return;
        }
        self.kept.poll(now);
        self.step_bridge((t, now), packets, reports_status, tap);
        if self.linked.is_some() {
            self.receive_from_autopilot((t, now), physics, tap);
            self.sense((t, now), physics, tap);
            self.step_predictor((t, now), physics, foresight, tap);
            self.plans
                .arrived(t)
                .iter()
                .for_each(|plan| self.outside.plans.send(plan));
            self.step_mission((t, now), tap);
            self.step_planner((t, now), tap);
            self.step_pilot((t, now), tap);
            let runs = self.runs(ProcessKind::Autopilot);
            if due(&mut self.rows.autopilot, runs, now).is_some() {
                self.step_link((t, now), Vec::new(), tap);
            }
        }
        self.look(now);
    }

    /// Packets that have come by radio, on the drone's clock.
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
    /// Takes note of the newest messages.
    fn look(&mut self, now: Time<DroneClock>) {
        let (t, o) = (now.nanos(), &mut self.observer);
        // None of them is copied without a newer one: they are large.
        o.odometry
            .newest(t)
            .into_iter()
            .for_each(|m| self.odometry = Some(m));
        o.autopilot
            .newest(t)
            .into_iter()
            .for_each(|m| self.autopilot_state = m);
        o.forecast
            .newest(t)
            .into_iter()
            .for_each(|m| self.forecast = Some(m));
        o.mission
            .newest(t)
            .into_iter()
            .for_each(|m| self.mission_state = m);
        o.set_point
            .newest(t)
            .into_iter()
            .for_each(|m| self.last_set_point = Some(m));
    }

    /// The header of a message of this computer or its operator.
    pub(super) fn header(&self, physics: &mut Physics) -> Header<DroneClock> {
        let mut header = physics.header(self.k);
        header.at += self.ahead;
        header
    }
    /// For so long the drone was armed on the deck without an order when the mission last published, s.
    pub fn still_armed_s(&self) -> Option<f64> {
        let (mission, armed) = (&self.mission_state, self.autopilot_state.armed);
        let disarm_s = self.nodes.autopilot.disarm.longest_s();
        still_armed_s(mission.header.at, mission, armed, disarm_s)
    }
}

/// The world's time and the computer's.
type Moment = (Time<TrueTime>, Time<DroneClock>);
