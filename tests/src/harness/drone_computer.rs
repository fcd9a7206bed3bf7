//! A drone's computer in lock-step: the rows of [`DroneRows`] over a bus in lock-step, each stepped once a tick in their order,
//! and the other ends of their edges: the radio, the wire to the autopilot, cameras and sensors.

use super::bus::{LockStep, Receiver, Sender};
use super::cameras::SimulatedCameras;
use super::failing::Failing;
use super::fault::Part;
use super::foresight::{Foresight, OdometryError};
use super::link::{Checkpoints, LinkedAutopilot};
use super::mutant::Mutated;
use super::physics::{DRONE_ID, Physics};
use super::scenario::{NodeConfigs, Scenario};
use super::tap::Tap;
use crate::autopilots::simulated::{SimulatedAutopilot, mode_number};
use crate::radio::{ChannelCounts, Session};
use crate::sensors::delay::DelayLine;
use crate::sensors::noise::Noise;
use alight_bridge::{Bridge, BridgeConfig, Packet, PacketKind};
use alight_shared::bus::{Reader as _, Row, Wired, Writer as _};
use alight_shared::checkpoint::{Keeper, Republisher};
use alight_shared::frames::body_from_camera;
use alight_shared::msg::{
    AutopilotMode, AutopilotState, CameraLight, Command, CommandKind, DeckBeacon, DeckForecast, DroneState,
    DroneStatus, Header, MissionState, Plan, RangeSample, SetPoint, TagPose, TimeRequest, UvdarFix,
    VesselEstimate, still_armed_s,
};
use alight_shared::time::{DroneClock, Span, Stamped, Time, TrueTime, VesselClock};
use alight_shared::topics::TIME_REQUEST;
use alight_shared::wire;
use alight_uav::autopilot::AutopilotLink;
use alight_uav::autopilot::message::Frame;
use alight_uav::computer::{DroneNodes, DroneRows, Installed};
use alight_uav::mission::MissionConfig;
use nalgebra::Vector3;

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

/// What is sent on the bus from outside the rows: operators, plans whose solve time is over, measurements where models stand
/// for cameras, a rangefinder, a beacon, and what a defect makes up.
struct Outside {
    commands: Sender<Command>,
    plans: Sender<Plan>,
    tags: Sender<TagPose>,
    uvdar: Sender<UvdarFix>,
    ranges: Sender<RangeSample>,
    beacons: Sender<DeckBeacon>,
    light: Sender<CameraLight>,
    forecasts: Sender<DeckForecast>,
    missions: Sender<MissionState>,
}

impl Outside {
    fn join(bus: &LockStep) -> Outside {
        Outside {
            commands: bus.sender(),
            plans: bus.sender(),
            tags: bus.sender(),
            uvdar: bus.sender(),
            ranges: bus.sender(),
            beacons: bus.sender(),
            light: bus.sender(),
            forecasts: bus.sender(),
            missions: bus.sender(),
        }
    }
}

/// What is seen of the bus from outside.
struct Observer {
    odometry: Receiver<DroneState>,
    autopilot: Receiver<AutopilotState>,
    forecast: Receiver<DeckForecast>,
    mission: Receiver<MissionState>,
    set_point: Receiver<SetPoint>,
}

impl Observer {
    fn join(bus: &LockStep) -> Observer {
        Observer {
            odometry: bus.receiver(),
            autopilot: bus.receiver(),
            forecast: bus.receiver(),
            mission: bus.receiver(),
            set_point: bus.receiver(),
        }
    }
}

/// A drone's end of the radio, its computer and what it flies.
pub struct DroneComputer {
    pub(super) k: usize,
    pub(super) boot: u32,
    pub(super) radio: Session<Packet, Uplink>,
    bus: LockStep,
    /// Its processes; None: one is dead.
    pub(super) rows: DroneRows<LockStep>,
    nodes: DroneNodes,
    /// Processes that stand still.
    pub(super) frozen: Vec<Part>,
    /// Packets that wait for a bridge that stands still.
    pub(super) waiting: Vec<Packet>,
    cameras: Option<SimulatedCameras>,
    /// The autopilot and the wire to it; None before the drone has appeared.
    pub(super) linked: Option<LinkedAutopilot>,
    /// Its steady clock is so far ahead of what it was drawn as.
    pub(super) ahead: Span,
    /// A person has given it the mode once.
    pub(super) handed_over: bool,
    /// The supervisor's.
    kept: Republisher<LockStep>,
    /// All of its processes are dead.
    pub(super) is_dead: bool,
    /// The computer stood still until then.
    stood_still_until: Time<TrueTime>,
    plans: DelayLine<Plan>,
    solve_delay: Span,
    outside: Outside,
    observer: Observer,
    /// What a mutant remembers.
    mutated: Mutated,
    /// A test's set-point in place of the pilot's.
    pub(super) external: Option<SetPoint>,
    /// The range that a stuck rangefinder repeats, m.
    repeated_m: Option<f64>,
    /// Fault: images are stamped so late.
    pub(super) images_late: Span,
    /// Fault: the deck seen is so far from the vessel's, NED, m.
    pub(super) sees_beside: Vector3<f64>,
    /// When the pilot stands still.
    pub(super) pilot_outage_window: Option<[Time<TrueTime>; 2]>,
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
    if packet.value.kind != PacketKind::Estimate {
        return None;
    }
    let mut estimate: VesselEstimate<VesselClock> = wire::decode(&packet.value.bytes).ok()?;
    estimate.header.boot = estimate.header.boot.wrapping_add(TWIN_BOOT);
    estimate.eta[0] += north_m;
    let bytes = wire::encode(&estimate).ok()?;
    let value = Packet {
        bytes,
        ..packet.value.clone()
    };
    Some(Stamped::new(packet.at, value))
}

/// A forced descent begins within this time of being steady, s.
const BEGINS_WITHIN_S: f64 = 20.0;

/// What the nodes of drone `k` are made of in this scenario.
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
        autopilot: nodes.autopilot.clone(),
        drone,
    }
}

/// A process that runs `node`.
fn row<N: Wired>(bus: &LockStep, node: N) -> Option<Row<N, LockStep>> {
    Row::join(bus, node).ok()
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

impl DroneComputer {
    pub(super) fn new(
        k: usize,
        scenario: &Scenario,
        nodes: &NodeConfigs,
        physics: &Physics,
        boot: u32,
    ) -> Self {
        let (bus, streams) = (LockStep::default(), physics.streams().of_drone(k));
        let made = drone_nodes(k, scenario, nodes);
        let moment = || Span::from_secs(BEGINS_WITHIN_S * Noise::new(&streams, "begin_anyway").uniform());
        let forced = scenario.begin_anyway.then(moment);
        let render = &scenario.sensors.render;
        let Ok(kept) = Republisher::join(&bus, Keeper::default());
        let rows = DroneRows {
            bridge: row(&bus, Bridge::installed(&made, boot)),
            autopilot: None,
            camera: (render.on.then(|| Installed::installed(&made, boot))).and_then(|node| row(&bus, node)),
            uvdar: (render.markers.then(|| Installed::installed(&made, boot)))
                .and_then(|node| row(&bus, node)),
            predictor: row(&bus, Installed::installed(&made, boot)),
            // It has run since before this flight.
            mission: row(&bus, made.mission(boot).forced_descent(forced)),
            planner: row(&bus, nodes.planner(boot)),
            pilot: row(&bus, Installed::installed(&made, boot)),
        };
        DroneComputer {
            k,
            boot,
            radio: Session::new(&scenario.radio, &streams),
            rows,
            frozen: Vec::new(),
            waiting: Vec::new(),
            cameras: SimulatedCameras::new(scenario, &made.drone.camera, &streams),
            nodes: made,
            linked: None,
            ahead: Span::ZERO,
            handed_over: false,
            kept,
            is_dead: false,
            stood_still_until: Time::EPOCH,
            plans: DelayLine::new(MAX_PLANS),
            solve_delay: Span::from_secs(scenario.solve_delay_s),
            outside: Outside::join(&bus),
            observer: Observer::join(&bus),
            bus,
            mutated: Mutated::default(),
            external: None,
            repeated_m: None,
            images_late: Span::ZERO,
            sees_beside: Vector3::zeros(),
            pilot_outage_window: None,
            odometry: None,
            mission_state: MissionState::default(),
            forecast: None,
            autopilot_state: AutopilotState::default(),
            last_set_point: None,
        }
    }

    /// A process dies; the others live on.
    pub(super) fn kill(&mut self, part: Part) {
        match part {
            Part::Bridge => (self.rows.bridge, self.waiting) = (None, Vec::new()),
            Part::Predictor => self.rows.predictor = None,
            Part::Mission => self.rows.mission = None,
            Part::Planner => self.rows.planner = None,
            Part::Pilot => self.rows.pilot = None,
            Part::Link => self.rows.autopilot = None,
            Part::Cable => {}
            Part::Supervisor => (self.is_dead, self.rows) = (true, DroneRows::default()),
        }
        self.frozen.retain(|p| *p != part);
    }
    /// It starts anew, with or without the checkpoint of the one before it; a computer whose supervisor died as a whole.
    pub(super) fn start(
        &mut self,
        part: Part,
        checkpoints: Checkpoints,
        (scenario, nodes, physics): (&Scenario, &NodeConfigs, &Physics),
    ) {
        if self.is_dead && part != Part::Supervisor {
            // Its supervisor starts it.
            return;
        }
        self.kept.take(physics.drone_now(self.k) + self.ahead);
        self.boot += 1;
        if part == Part::Supervisor {
            let new = DroneComputer::new(self.k, scenario, nodes, physics, self.boot);
            self.succeed(new);
            self.rows.mission = row(&self.bus, Installed::installed(&self.nodes, self.boot));
        }
        if checkpoints == Checkpoints::Lost {
            *self.kept.keeper_mut() = Keeper::default();
        }
        let (bus, made, boot) = (&self.bus, &self.nodes, self.boot);
        match part {
            Part::Bridge => self.rows.bridge = row(bus, Installed::installed(made, boot)),
            Part::Predictor => self.rows.predictor = row(bus, Installed::installed(made, boot)),
            Part::Mission => self.rows.mission = row(bus, Installed::installed(made, boot)),
            Part::Planner => self.rows.planner = row(bus, nodes.planner(boot)),
            Part::Pilot => self.rows.pilot = row(bus, Installed::installed(made, boot)),
            Part::Link | Part::Supervisor => self.rows.autopilot = row(bus, Installed::installed(made, boot)),
            Part::Cable => {}
        }
    }
    /// A new computer in the place of this one, on the same drone.
    fn succeed(&mut self, new: DroneComputer) {
        let before = core::mem::replace(self, new);
        *self.kept.keeper_mut() = before.kept.keeper().clone();
        (self.radio, self.linked, self.handed_over) = (before.radio, before.linked, before.handed_over);
        (self.images_late, self.sees_beside) = (before.images_late, before.sees_beside);
        (self.ahead, self.repeated_m, self.mutated) = (before.ahead, before.repeated_m, before.mutated);
    }
    /// Its steady clock begins again, and of its checkpoints there is what lies on the disk.
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

    /// The drone appears in the air, flown by a person.
    pub(super) fn appear(&mut self, physics: &mut Physics) {
        physics.place_drone(self.k);
        let streams = physics.streams().of_drone(self.k);
        self.linked = physics
            .autopilot(self.k)
            .map(|(config, autopilot)| LinkedAutopilot::new(config, &streams, autopilot));
        self.rows.autopilot = row(&self.bus, AutopilotLink::installed(&self.nodes, self.boot));
        if physics.starts_on_deck() {
            self.linked.iter_mut().for_each(|l| l.autopilot.arm(false));
            // Nobody gives it the mode.
            self.handed_over = true;
        }
    }

    /// Its autopilot; None before it has appeared.
    pub fn autopilot(&self) -> Option<&SimulatedAutopilot> {
        self.linked.as_ref().map(|l| &l.autopilot)
    }
    /// Its autopilot has aligned its heading.
    pub fn autopilot_is_aligned(&self) -> bool {
        self.linked.as_ref().is_some_and(|l| l.autopilot.is_aligned())
    }
    /// What the radio carried and lost: to the drone, to the vessel.
    pub fn radio_counts(&self) -> [ChannelCounts; 2] {
        self.radio.counts()
    }
    /// A process runs.
    fn runs(&self, part: Part) -> bool {
        !self.frozen.contains(&part)
    }

    /// Its rows in their order, each one step; the link's a second one, with the pilot's set-point.
    pub(super) fn tick(
        &mut self,
        physics: &mut Physics,
        reports_status: bool,
        foresight: Option<&Foresight>,
        failing: &Failing,
        tap: &mut impl Tap,
    ) {
        let t = physics.now();
        let now = physics.drone_clock(self.k).ahead(self.ahead).read(t);
        if failing.frozen.computer {
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
        self.step_bridge((t, now), packets, reports_status, failing, tap);
        if self.linked.is_some() {
            self.receive_from_autopilot((t, now), physics, failing);
            self.sense((t, now), physics, failing);
            self.step_predictor((t, now), physics, foresight, failing, tap);
            self.plans
                .arrived(t)
                .iter()
                .for_each(|plan| self.outside.plans.send(plan));
            self.step_mission((t, now), failing, tap);
            self.step_planner((t, now), failing, tap);
            self.step_pilot((t, now), failing, tap);
            let runs = self.runs(Part::Link);
            if due(&mut self.rows.autopilot, runs, now).is_some() {
                self.step_link((t, now), Vec::new(), failing);
            }
        }
        self.look(now);
    }

    /// What has come by radio, on the drone's clock.
    fn packets(&mut self, physics: &Physics) -> Vec<Stamped<DroneClock, Packet>> {
        let clock = physics.drone_clock(self.k).ahead(self.ahead);
        let read_from = self.stood_still_until;
        let stamped = |(arrival, packet)| Stamped::new(clock.read(read_from.max(arrival)), packet);
        self.radio
            .at_drone(physics.now())
            .into_iter()
            .map(stamped)
            .collect()
    }
    fn step_bridge(
        &mut self,
        (t, now): Moment,
        mut packets: Vec<Stamped<DroneClock, Packet>>,
        reports_status: bool,
        failing: &Failing,
        tap: &mut impl Tap,
    ) {
        if failing.twin_m != 0.0 {
            let twins: Vec<_> = packets.iter().filter_map(|p| twin(p, failing.twin_m)).collect();
            packets.extend(twins);
        }
        let runs = self.runs(Part::Bridge);
        let Some(bridge) = &mut self.rows.bridge else {
            return;
        };
        if !runs {
            let room = MAX_WAITING.saturating_sub(self.waiting.len());
            let waiting = packets.into_iter().take(room).map(|p| p.value);
            self.waiting.extend(waiting);
            return;
        }
        // What has waited bears the time of its reading.
        let waited = self.waiting.drain(..).map(|p| Stamped::new(now, p));
        let packets = waited.chain(packets).collect();
        let (drone, mutated) = (self.nodes.bridge.drone_id, &mut self.mutated);
        let out = bridge.step(
            now,
            |input| input.packets = packets,
            |input, out| {
                tap.bridge(t, now, input, out);
                if let Some(mutant) = failing.mutant {
                    mutant.received(now, out, (drone, failing.apart), mutated);
                }
            },
        );
        if let Some(request) = out.time_request {
            let request = Uplink::TimeRequest(request);
            self.radio.send_to_vessel(t, TIME_REQUEST.bytes, request);
        }
        if let Some(status) = out.status.filter(|_| reports_status)
            && let Ok(bytes) = wire::encode(&status)
        {
            self.radio.send_to_vessel(t, bytes.len(), Uplink::Status(status));
        }
    }
    /// The link with what the autopilot has sent.
    fn receive_from_autopilot(&mut self, (t, now): Moment, physics: &Physics, failing: &Failing) {
        let runs = self.runs(Part::Link);
        let Some(linked) = &mut self.linked else { return };
        if !self.handed_over {
            // PX4 denies until set-points were streamed for long enough: the person tries again.
            let autopilot = &mut linked.autopilot;
            let offboard = mode_number(autopilot.firmware(), AutopilotMode::Offboard);
            self.handed_over = autopilot.choose(offboard);
        }
        linked.autopilot.steel_m = physics.deck_distance_m(self.k);
        // What a process that stands still does not read waits on the wire.
        let frames = if runs { linked.received(t) } else { Vec::new() };
        self.step_link((t, now), frames, failing);
    }
    fn step_link(&mut self, (t, now): Moment, frames: Vec<Frame>, failing: &Failing) {
        let runs = self.runs(Part::Link);
        let (Some(link), Some(linked)) = (self.rows.autopilot.as_mut().filter(|_| runs), &mut self.linked)
        else {
            return;
        };
        let out = link.step(
            now,
            |input| input.received = frames,
            |_, out| {
                if let Some(mutant) = failing.mutant {
                    out.odometry
                        .iter_mut()
                        .for_each(|state| *state = mutant.odometry(*state));
                    out.state = out.state.map(|state| mutant.autopilot(state));
                }
            },
        );
        linked.send(t, &out);
    }
    /// The cameras with what they have exposed, or what models measure in their place.
    fn sense(&mut self, (t, now): Moment, physics: &mut Physics, failing: &Failing) {
        let Some(mut readings) = physics.drone_readings(self.k) else {
            return;
        };
        readings.shift(self.ahead);
        let beside: Vector3<f64> = physics.drone(self.k).map_or_else(Vector3::zeros, |truth| {
            body_from_camera().transpose() * (truth.attitude.0.inverse() * self.sees_beside)
        });
        let (late, faults) = (self.images_late, &failing.drone);
        let shown = |p: &mut [f64; 3]| p.iter_mut().zip(beside.iter()).for_each(|(p, by)| *p += by);
        let tags = |tags: &mut Vec<TagPose>| {
            for m in tags.iter_mut() {
                m.header.at += late;
                shown(&mut m.position);
            }
            faults.spoil_tags(tags);
        };
        let fixes = |fixes: &mut Vec<UvdarFix>| {
            for m in fixes.iter_mut() {
                m.header.at += late;
                shown(&mut m.position);
            }
            faults.spoil_fixes(fixes);
        };
        if let (Some(cameras), Some(row)) = (&mut self.cameras, &mut self.rows.camera) {
            let input = cameras.belly(t, &readings.shots);
            let images = input.frames.len();
            row.step(now, |i| *i = input, |_, out| tags(&mut out.tags));
            cameras.metered(images, &row.node.light());
        }
        if let (Some(cameras), Some(row)) = (&mut self.cameras, &mut self.rows.uvdar) {
            let input = cameras.ultraviolet(t, &readings.uv_shots);
            row.step(now, |i| *i = input, |_, out| fixes(&mut out.fixes));
        }
        tags(&mut readings.tags);
        fixes(&mut readings.uvdar);
        faults.spoil_ranges(&mut readings.ranges, &mut self.repeated_m);
        self.outside.tags.send_each(&readings.tags);
        self.outside.uvdar.send_each(&readings.uvdar);
        self.outside.ranges.send_each(&readings.ranges);
        self.outside.beacons.send_each(&readings.beacons);
        self.outside.light.send_each(&readings.light);
    }
    fn step_predictor(
        &mut self,
        (t, now): Moment,
        physics: &Physics,
        foresight: Option<&Foresight>,
        failing: &Failing,
        tap: &mut impl Tap,
    ) {
        let (clock, truth) = (
            physics.drone_clock(self.k).ahead(self.ahead),
            physics.drone(self.k),
        );
        let (runs, mut forecast) = (self.runs(Part::Predictor), None);
        if let Some(predictor) = due(&mut self.rows.predictor, runs, now) {
            predictor.step(
                now,
                |_| {},
                |input, out| {
                    let believed = input
                        .drone
                        .zip(truth)
                        .map(|(d, truth)| OdometryError::of(&d, now, &truth));
                    if let (Some(foresight), Some(forecast)) = (foresight, &mut out.forecast) {
                        foresight.correct(forecast, &clock, &believed.unwrap_or_default());
                    }
                    tap.predictor(t, now, input, out);
                    if failing.mutant.is_some() {
                        forecast = out.forecast.take();
                    }
                },
            );
        }
        if let Some(mutant) = failing.mutant {
            let forecast = mutant.forecast(now, forecast, self.forecast);
            self.outside.forecasts.send_each(&forecast);
        }
        self.look(now);
    }
    fn step_mission(&mut self, (t, now): Moment, failing: &Failing, tap: &mut impl Tap) {
        let (runs, mut state) = (self.runs(Part::Mission), None);
        let (mutated, before) = (&mut self.mutated, self.mission_state.state);
        if let Some(mission) = due(&mut self.rows.mission, runs, now) {
            let out = mission.step(
                now,
                |input| {
                    if let Some(mutant) = failing.mutant {
                        mutant.commands(now, &mut input.commands, before, &mut mutated.ordered);
                        mutant.mission_in(now, input, mutated);
                    }
                },
                |input, out| {
                    tap.mission(t, now, input, out);
                    if failing.mutant.is_some() {
                        state = out.state.take();
                    }
                },
            );
            let landing = out.checkpoint.filter(|c| c.landing);
            self.mutated.checkpoint = self.mutated.checkpoint.or(landing);
        }
        if let Some(mutant) = failing.mutant {
            let state = mutant.mission(now, state, &self.mission_state);
            self.outside.missions.send_each(&state);
        }
        self.look(now);
    }
    fn step_planner(&mut self, (t, now): Moment, failing: &Failing, tap: &mut impl Tap) {
        let runs = self.runs(Part::Planner);
        let Some(planner) = due(&mut self.rows.planner, runs, now) else {
            return;
        };
        let delay = self.solve_delay + Span::from_secs(failing.solve_s);
        let plans = &mut self.plans;
        planner.step(
            now,
            |_| {},
            |input, out| {
                tap.planner(t, now, input, out);
                if let Some(plan) = out.plan.take() {
                    // A full line means plans that nobody fetches: the oldest state is lost, no more.
                    let _full = plans.push(t + delay, plan);
                }
            },
        );
    }
    fn step_pilot(&mut self, (t, now): Moment, failing: &Failing, tap: &mut impl Tap) {
        let away = |[from, until]: [Time<TrueTime>; 2]| from <= t && t < until;
        let runs = self.runs(Part::Pilot) && !self.pilot_outage_window.is_some_and(away);
        let (external, state) = (self.external, self.mission_state.state);
        if let Some(pilot) = due(&mut self.rows.pilot, runs, now) {
            pilot.step(
                now,
                |_| {},
                |input, out| {
                    tap.pilot(t, now, input, out);
                    out.set_point = external.or(out.set_point);
                    if let Some(mutant) = failing.mutant {
                        out.set_point = out.set_point.map(|s| mutant.set_point(s, &input.ranges, state));
                    }
                },
            );
        }
    }
    /// Takes note of the newest messages.
    fn look(&mut self, now: Time<DroneClock>) {
        let (t, o) = (now.nanos(), &mut self.observer);
        self.odometry = o.odometry.newest(t).or(self.odometry);
        self.autopilot_state = o.autopilot.newest(t).unwrap_or(self.autopilot_state);
        self.forecast = o.forecast.newest(t).or(self.forecast);
        self.mission_state = o.mission.newest(t).unwrap_or(self.mission_state);
        self.last_set_point = o.set_point.newest(t).or(self.last_set_point);
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
