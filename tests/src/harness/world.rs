//! The simulated world in lock-step with the nodes. [`World::tick`] is the architecture diagram:
//! the vessel's computer ([`VesselComputer`]), radio; then on each drone's computer ([`DroneComputer`]) bridge,
//! predictor, mission, planner, pilot, autopilot link; autopilots and physics at last, in the order data flow.
//!
//! Delays belong here (radio, clocks, solve time, the wire to the autopilot), not to the nodes.

use core::f64::consts::TAU;
use std::rc::Rc;

use alight_bridge::{Bridge, BridgeConfig, BridgeIn, BridgeOut, Packet, PacketKind};
use alight_shared::admission::{Arrival, Sender};
use alight_shared::checkpoint::Keeper;
use alight_shared::frames::body_from_camera;
use alight_shared::msg::{
    AutopilotMode, AutopilotState, Command, CommandKind, DeckForecast, DeckOrder, DroneStatus, Header,
    MissionState, OperatorCommand, Plan, SetPoint, TimeRequest, VesselEstimate,
};
use alight_shared::node::Node;
use alight_shared::time::{DroneClock, Span, Stamped, Time, TrueTime, VesselClock};
use alight_shared::topics::TIME_REQUEST;
use alight_shared::wire;
use alight_uav::autopilot::config::DisarmConfig;
use alight_uav::autopilot::{AutopilotIn, AutopilotLink, still_armed_s};
use alight_uav::camera::node::CameraIdentity;
use alight_uav::mission::{Mission, MissionConfig, MissionIn, MissionOut};
use alight_uav::pilot::{Output, Pilot, PilotIn};
use alight_uav::planner::{Planner, PlannerIn, PlannerOut};
use alight_uav::predictor::{Predictor, PredictorIn, PredictorOut};
use alight_usv::deck::DeckInputs;
use alight_usv::{ComputerIn, ComputerOut, VesselComputer};
use nalgebra::Vector3;
use serde::Serialize;

use super::cameras::SimulatedCameras;
use super::failing::{Failing, Held, shift};
use super::fault::Part;
use super::foresight::{Foresight, drift};
use super::inbox::Inbox;
pub use super::link::Checkpoints;
use super::link::{LinkedAutopilot, MakeLink};
use super::mutant::Mutated;
use super::outcome::Observation;
use super::physics::{BOOT, DRONE_ID, Physics, TICK, VESSEL_ID};
use super::scenario::{NodeConfigs, Scenario, SetupError, StateOutage};
use super::tap::{NoTap, Tap};
use crate::autopilots::simulated::{INNER_PER_OUTER, SimulatedAutopilot, mode_number};
use crate::physics::streams::Streams;
use crate::radio::{ChannelCounts, Session};
use crate::sensors::DroneReadings;
use crate::sensors::delay::DelayLine;
use crate::sensors::noise::Noise;

/// Plans under way at a time.
const MAX_PLANS: usize = 64;
/// Packets that wait for a bridge that stands still, at most.
const MAX_WAITING: usize = 4096;
/// A push rises with this time constant, s: as a person shifts his weight.
const PUSH_RISE_S: f64 = 0.4;
/// Period of the roll of another ship's wake, s.
const WAKE_S: f64 = 2.5;
/// A vessel of the same identity counts its starts from here.
const TWIN_BOOT: u32 = 1000;
/// Time between two of a drone's status messages (the bridge's process sends them so).
const STATUS_PERIOD: Span = Span::from_millis(500);

/// From a drone to the vessel.
#[derive(Clone, Debug)]
enum Uplink {
    TimeRequest(TimeRequest<DroneClock>),
    Status(DroneStatus),
}

/// Truth, nodes and what connects them.
pub struct World {
    physics: Physics,
    /// Where forecasts have the true motion.
    foresight: Option<Foresight>,
    // The vessel's computer.
    vessel_boot: u32,
    vessel: VesselComputer,
    /// What its crew, its operators and its former start have given it since the last tick.
    given: ComputerIn,
    operator_sequence: u32,
    /// Drones report to the vessel, and it grants its deck and passes commands on: the load that a drone which flies alone
    /// and needs no reservation does without.
    shares_deck: bool,
    // The drones' radios and computers.
    drones: Vec<DroneComputer>,
    /// What fails of the first drone and the vessel.
    failing: Failing,
    /// What stuck sensors of the vessel repeat.
    held: Held,
    /// What pushes the vessel now, N and Nm.
    push: [f64; 6],
    /// The vessel's steady clock is so far ahead of what it was drawn as.
    vessel_ahead: Span,
}

impl World {
    /// The world of `seed` before the warm-up.
    pub fn new(
        scenario: &Scenario,
        nodes: &NodeConfigs,
        seed: impl Into<Streams>,
    ) -> Result<World, SetupError> {
        let streams = seed.into();
        let scenario = &scenario.drawn(streams);
        let physics = Physics::new(scenario, streams)?;
        let foresight = scenario
            .true_prediction
            .then(|| Foresight::new(scenario, streams));
        Ok(World {
            foresight: foresight.transpose()?,
            vessel: VesselComputer::new(&nodes.vessel, &nodes.deck, VESSEL_ID, BOOT),
            vessel_boot: BOOT,
            given: ComputerIn::default(),
            operator_sequence: 0,
            shares_deck: scenario.drones > 1 || nodes.drone.mission.reservation_required,
            drones: (0..scenario.drones as usize)
                .map(|k| DroneComputer::new(k, scenario, nodes, &physics, BOOT))
                .collect(),
            physics,
            failing: Failing::default(),
            held: Held::default(),
            push: [0.0; 6],
            vessel_ahead: Span::ZERO,
        })
    }
    /// So much fails from now on, of the first drone and the vessel.
    pub fn fail(&mut self, failing: Failing) {
        for part in [Part::Predictor, Part::Mission, Part::Pilot, Part::Link] {
            self.freeze(0, part, failing.frozen.parts.contains(&part));
        }
        if let Some(drone) = self.drones.first_mut() {
            drone.radio.fail(failing.radio);
        }
        if let Some(linked) = self.drones.first_mut().and_then(|d| d.linked.as_mut()) {
            let faults = &failing.autopilot;
            let autopilot = &mut linked.autopilot;
            linked.cut = faults.cut;
            (autopilot.silent, autopilot.answer) = (faults.silent, faults.answer);
            autopilot.muted.clone_from(&faults.muted);
            autopilot.battery_reported = !faults.no_battery;
            let charge = autopilot.battery_report.unwrap_or(autopilot.battery);
            autopilot.battery_report = faults.battery_stuck.then_some(charge);
            autopilot.battery = (autopilot.battery - faults.drain_per_s * TICK.secs()).max(0.0);
            autopilot.landed_report = faults.landed_report;
            if faults.drift_mps != 0.0 {
                autopilot.reset_position(&(Vector3::x() * faults.drift_mps * TICK.secs()), false);
            }
            autopilot.remote_control_lost = faults.remote_control_lost;
            autopilot.data_link_lost = faults.data_link_lost;
        }
        self.failing = failing;
    }
    /// Runs the vessel's side until the start; the drones appear in the air a little before.
    pub fn warm_up(&mut self, tap: &mut impl Tap) {
        while self.warm_up_tick(tap) {}
    }
    /// One tick of the warm-up; false once it is over.
    pub fn warm_up_tick(&mut self, tap: &mut impl Tap) -> bool {
        let now = self.physics.now();
        if now >= self.physics.hover_from() && self.physics.drone(0).is_none() {
            for drone in &mut self.drones {
                drone.appear(&mut self.physics);
            }
        }
        let warms_up = now < self.physics.started();
        if warms_up {
            self.tick(tap);
        }
        warms_up
    }

    /// Gives every mission a command.
    pub fn command(&mut self, kind: CommandKind) {
        for drone in &mut self.drones {
            let header = drone.header(&mut self.physics);
            drone.commands.push(Command { header, kind });
        }
    }
    /// The vessel's operator gives a drone a command.
    pub fn operator_command(&mut self, k: usize, kind: CommandKind) {
        let now = self.vessel_now();
        self.operator_sequence += 1;
        let header = Header::new(VESSEL_ID, DRONE_ID + k as u32, BOOT, self.operator_sequence, now);
        self.given.commands.push(Arrival {
            at: now,
            sender: Sender::Operator(1),
            message: OperatorCommand { header, kind },
        });
    }
    /// An order of the vessel's crew for the deck.
    pub fn deck_order(&mut self, order: DeckOrder) {
        self.given.deck_orders.push(order);
    }
    /// The deck's digital inputs have these levels from now on.
    pub fn deck_inputs(&mut self, inputs: DeckInputs) {
        self.given.deck_inputs = inputs;
    }
    /// A person takes a drone away and starts it anew, its computer too: it appears in the air where it began.
    pub fn restart_drone(&mut self, k: usize, scenario: &Scenario, nodes: &NodeConfigs) {
        let before = &self.drones[k];
        let radio = before.radio.clone();
        let boot = before.boot + 1;
        self.drones[k] = DroneComputer {
            radio,
            ..DroneComputer::new(k, scenario, nodes, &self.physics, boot)
        };
        self.drones[k].appear(&mut self.physics);
    }
    /// A drone's autopilot with the link to it; None before it has appeared.
    pub fn linked(&mut self, k: usize) -> Option<&mut LinkedAutopilot> {
        self.drones[k].linked.as_mut()
    }

    /// A drone's mission process dies; the others live on.
    pub fn kill_mission(&mut self, k: usize) {
        (self.drones[k].mission, self.drones[k].mission_inbox) = (None, Inbox::default());
    }
    /// It starts anew, with or without the checkpoint of the one before it.
    pub fn start_mission(
        &mut self,
        k: usize,
        scenario: &Scenario,
        nodes: &NodeConfigs,
        checkpoints: Checkpoints,
    ) {
        let (id, config) = (DRONE_ID + k as u32, mission_config(scenario, nodes));
        let drone = &mut self.drones[k];
        let boot = drone.next_boot(checkpoints);
        let (airframe, deck) = (&nodes.drone.airframe, &nodes.drone.deck);
        drone.mission = Some(Mission::new(&config, airframe, deck, id, boot).as_successor());
    }
    /// A drone's predictor process dies.
    pub fn kill_predictor(&mut self, k: usize) {
        (self.drones[k].predictor, self.drones[k].predictor_inbox) = (None, Inbox::default());
    }
    /// It starts anew, with or without the checkpoint of the one before it.
    pub fn start_predictor(&mut self, k: usize, nodes: &NodeConfigs, checkpoints: Checkpoints) {
        let drone = &mut self.drones[k];
        let boot = drone.next_boot(checkpoints);
        drone.predictor = Some(Predictor::new(&nodes.settings().predictor(), boot).as_successor());
    }
    /// All processes of a drone's computer die, as with their supervisor.
    pub fn kill_computer(&mut self, k: usize) {
        self.drones[k].is_dead = true;
        self.kill_link(k);
    }
    /// They start anew, with or without the checkpoints of the ones before them.
    pub fn start_computer(
        &mut self,
        k: usize,
        scenario: &Scenario,
        nodes: &NodeConfigs,
        checkpoints: Checkpoints,
    ) {
        let before = &mut self.drones[k];
        let boot = before.next_boot(checkpoints);
        let new = DroneComputer::new(k, scenario, nodes, &self.physics, boot);
        let before = core::mem::replace(before, new);
        let drone = &mut self.drones[k];
        (drone.radio, drone.linked, drone.keeper) = (before.radio, before.linked, before.keeper);
        drone.handed_over = before.handed_over;
        (drone.images_late, drone.sees_beside) = (before.images_late, before.sees_beside);
        drone.ahead = before.ahead;
        drone.linked.iter_mut().for_each(|l| l.start(checkpoints));
        drone.predictor = drone.predictor.take().map(Predictor::as_successor);
        drone.mission = drone.mission.take().map(Mission::as_successor);
    }
    /// A drone's pilot process dies.
    pub fn kill_pilot(&mut self, k: usize) {
        (self.drones[k].pilot, self.drones[k].pilot_inbox) = (None, Inbox::default());
    }
    /// It starts anew.
    pub fn start_pilot(&mut self, k: usize, nodes: &NodeConfigs) {
        let drone = &mut self.drones[k];
        let (settings, boot) = (nodes.settings(), drone.next_boot(Checkpoints::Kept));
        let pilot = Pilot::new(&settings.pilot, &settings.airframe, DRONE_ID + k as u32, boot);
        drone.pilot = Some(pilot);
    }
    /// A drone's link to its autopilot dies.
    pub fn kill_link(&mut self, k: usize) {
        self.drones[k].linked.iter_mut().for_each(LinkedAutopilot::kill);
    }
    /// It starts anew, with or without the checkpoint of the one before it.
    pub fn start_link(&mut self, k: usize, checkpoints: Checkpoints) {
        if self.drones[k].is_dead {
            // Its supervisor starts it.
            return;
        }
        self.drones[k]
            .linked
            .iter_mut()
            .for_each(|l| l.start(checkpoints));
    }
    /// A drone's process stands still, or goes on. A cable does not stand still, and a supervisor that does stops no other.
    pub fn freeze(&mut self, k: usize, part: Part, frozen: bool) {
        let drone = &mut self.drones[k];
        match part {
            Part::Predictor => drone.predictor_inbox.frozen = frozen,
            Part::Mission => drone.mission_inbox.frozen = frozen,
            Part::Pilot => drone.pilot_inbox.frozen = frozen,
            Part::Link => drone.linked.iter_mut().for_each(|l| l.frozen = frozen),
            Part::Cable | Part::Supervisor => {}
        }
    }
    /// A drone's bridge process dies.
    pub fn kill_bridge(&mut self, k: usize) {
        (self.drones[k].bridge, self.drones[k].waiting) = (None, Vec::new());
    }
    /// It starts anew.
    pub fn start_bridge(&mut self, k: usize) {
        let drone = &mut self.drones[k];
        let boot = drone.next_boot(Checkpoints::Kept);
        drone.bridge = Some(Bridge::new(&drone.bridge_config, boot));
    }
    /// A steady clock goes ahead by this, as after a pause of the machine: the vessel's (None) or a drone's.
    pub fn step_clock(&mut self, drone: Option<usize>, by: Span) {
        match drone {
            None => self.vessel_ahead = self.vessel_ahead + by,
            Some(k) => self.drones[k].ahead = self.drones[k].ahead + by,
        }
    }
    /// A drone's planner process dies.
    pub fn kill_planner(&mut self, k: usize) {
        self.drones[k].planner = None;
    }
    /// The planner's process starts again.
    pub fn start_planner(&mut self, k: usize, nodes: &NodeConfigs) {
        let drone = &mut self.drones[k];
        let boot = drone.next_boot(Checkpoints::Kept);
        drone.planner = Some(nodes.planner(boot));
    }

    /// A test flies a drone from now on: this set-point stands in place of the pilot's.
    pub fn fly_by_set_point(&mut self, k: usize, set_point: SetPoint) {
        self.drones[k].external = Some(set_point);
    }
    /// The estimator of a drone's autopilot begins its heading anew, wrong by this much more, rad.
    pub fn reset_heading(&mut self, k: usize, by_rad: f64) {
        if let Some(linked) = self.linked(k) {
            linked.autopilot.reset_heading(by_rad);
        }
    }
    /// Images of a drone's cameras are stamped so late from now on.
    pub fn stamp_images_late(&mut self, k: usize, late: Span) {
        self.drones[k].images_late = late;
    }
    /// What a drone's cameras see of the deck is another vessel's, moored so far from this one (NED, m).
    pub fn show_neighbour(&mut self, k: usize, beside: Vector3<f64>) {
        self.drones[k].sees_beside = beside;
    }
    /// The estimator of a drone's autopilot begins its position anew, this much further on (m); it counts that or not.
    pub fn reset_position(&mut self, k: usize, by: &Vector3<f64>, counted: bool) {
        if let Some(linked) = self.linked(k) {
            linked.autopilot.reset_position(by, counted);
        }
    }
    /// The vessel's computer starts anew, with what it kept.
    pub fn restart_vessel(&mut self, nodes: &NodeConfigs) {
        self.vessel_boot += 1;
        self.given = ComputerIn {
            checkpoint: Some(self.vessel.checkpoint()),
            deck_inputs: self.given.deck_inputs,
            ..ComputerIn::default()
        };
        self.vessel = VesselComputer::new(&nodes.vessel, &nodes.deck, VESSEL_ID, self.vessel_boot);
    }

    /// The turn or change of speed of the vessel's course that a first descent dates.
    pub fn ask_change(&mut self) {
        self.physics.ask_change();
    }
    /// The outage of a drone's radio that a mission's new state brings about.
    pub fn radio_outage(&mut self, k: usize, outage: &StateOutage) {
        let window = outage.window(self.physics.now());
        self.drones[k].radio.set_outage(window);
    }
    /// The standstill of the pilots that a mission's new state brings about; the first stays.
    pub fn pilot_outage(&mut self, outage: &StateOutage) {
        let window = outage.window(self.physics.now());
        self.drones.iter_mut().for_each(|d| {
            d.pilot_outage_window.get_or_insert(window);
        });
    }

    /// Ten milliseconds of everything, shown to a tap, which sees the first drone's nodes.
    pub fn tick(&mut self, tap: &mut impl Tap) {
        let t = self.physics.now();
        tap.truth(t, &self.physics.vessel(), self.physics.drone(0).as_ref());

        let [vessel_rate, drone_rate] = self.failing.clock_rates;
        let ahead = |rate: f64| Span::from_secs(rate * TICK.secs());
        self.vessel_ahead = self.vessel_ahead + ahead(vessel_rate);
        if let Some(drone) = self.drones.first_mut() {
            drone.ahead = drone.ahead + ahead(drone_rate);
            self.failing.apart = self.vessel_ahead - drone.ahead;
        }

        // The vessel: sensors, drones' statuses, orders -> estimator, deck arbiter, operator relay -> broadcast.
        let (now, mut readings) = (self.vessel_now(), self.physics.vessel_readings());
        shift(&mut readings, self.vessel_ahead);
        self.failing.vessel.spoil(&mut readings, &mut self.held);
        let given = ComputerIn {
            deck_inputs: self.given.deck_inputs,
            ..ComputerIn::default()
        };
        let mut input = ComputerIn {
            vessel: readings.input(),
            ..core::mem::replace(&mut self.given, given)
        };
        self.receive_at_vessel(t, &mut input);
        if self.failing.frozen.vessel {
            // Orders wait, what was measured is lost.
            (self.given.commands, self.given.deck_orders) = (input.commands, input.deck_orders);
            self.given.checkpoint = input.checkpoint;
        } else {
            let output = self.vessel.step(now, &input);
            tap.vessel(t, now, &input, &output);
            self.broadcast_all(t, &output);
        }

        // Each drone's computer: bridge -> predictor -> mission -> planner -> pilot -> link to the autopilot.
        self.foresight.iter_mut().for_each(|f| f.look(t));
        let foresight = self.foresight.as_ref();
        let sound = Failing {
            mutant: self.failing.mutant,
            ..Failing::default()
        };
        for (k, drone) in self.drones.iter_mut().enumerate() {
            match k {
                0 => drone.tick(&mut self.physics, self.shares_deck, foresight, &self.failing, tap),
                _ => drone.tick(&mut self.physics, self.shares_deck, foresight, &sound, &mut NoTap),
            }
        }

        // Sea, vessel, autopilots, drones, contact.
        let mut push = self.failing.push;
        push[3] += self.failing.wake_nm * (TAU / WAKE_S * t.secs()).sin();
        for (force, wanted) in self.push.iter_mut().zip(push) {
            *force += (wanted - *force) * TICK.secs() / PUSH_RISE_S;
        }
        self.physics.push(self.push);
        self.physics.advance_with(INNER_PER_OUTER, |k, truth| {
            let motors = self.drones[k].linked.as_mut().and_then(|l| l.turn(truth))?;
            Some(if k == 0 {
                self.failing.weaken(motors)
            } else {
                motors
            })
        });
    }
    /// What the vessel's computer has for the drones.
    fn broadcast_all(&mut self, t: Time<TrueTime>, output: &ComputerOut) {
        self.broadcast(t, PacketKind::Estimate, &output.vessel.estimate);
        self.broadcast(t, PacketKind::Wave, &output.vessel.wave);
        self.broadcast(t, PacketKind::Prediction, &output.vessel.prediction);
        self.broadcast(t, PacketKind::Surroundings, &output.vessel.surroundings);
        self.broadcast(t, PacketKind::TimeReply, &output.vessel.time_replies);
        if self.shares_deck {
            self.broadcast(t, PacketKind::Deck, &output.grant);
            self.broadcast(t, PacketKind::Command, &output.commands);
        }
    }

    /// What has come over the radios of the drones.
    fn receive_at_vessel(&mut self, t: Time<TrueTime>, input: &mut ComputerIn) {
        let clock = self.physics.vessel_clock().ahead(self.vessel_ahead);
        for drone in &mut self.drones {
            let sender = Sender::Drone(DRONE_ID + drone.k as u32);
            for (arrival, uplink) in drone.radio.at_vessel(t) {
                let at = clock.read(arrival);
                match uplink {
                    Uplink::TimeRequest(message) => {
                        input.vessel.time_requests.push(Arrival { at, sender, message });
                    }
                    Uplink::Status(message) => input.statuses.push(Arrival { at, sender, message }),
                }
            }
        }
    }

    fn broadcast<'a, M: Serialize + 'a>(
        &mut self,
        t: Time<TrueTime>,
        kind: PacketKind,
        messages: impl IntoIterator<Item = &'a M>,
    ) {
        let sender = Sender::Vessel(VESSEL_ID);
        // A message that does not encode is a message that is not sent: the receiver sees the gap.
        for bytes in messages.into_iter().filter_map(|m| wire::encode(m).ok()) {
            for drone in &mut self.drones {
                let bytes = bytes.clone();
                let length = bytes.len();
                drone
                    .radio
                    .send_to_drone(t, length, Packet { kind, sender, bytes });
            }
        }
    }

    /// What the vessel's clock reads.
    fn vessel_now(&self) -> Time<VesselClock> {
        self.physics.vessel_now() + self.vessel_ahead
    }
    /// The truth.
    pub fn physics(&self) -> &Physics {
        &self.physics
    }
    /// Whether a drone wants the vessel to keep course and speed now.
    pub fn wants_steady(&self) -> bool {
        self.vessel.arbiter().wants_steady(self.vessel_now())
    }
    /// The drones' computers.
    pub fn drones(&self) -> &[DroneComputer] {
        &self.drones
    }
    /// The first drone's mission, its newest state.
    pub fn mission_state(&self) -> &MissionState {
        &self.drones[0].mission_state
    }
    /// What the judge of the first drone looks at.
    pub fn observation(&self) -> Observation<'_> {
        self.observation_of(0)
    }
    /// The same of another.
    pub fn observation_of(&self, k: usize) -> Observation<'_> {
        self.physics.observation(k, &self.drones[k].mission_state)
    }
}

/// A drone's end of the radio, its computer and what it flies.
pub struct DroneComputer {
    k: usize,
    boot: u32,
    radio: Session<Packet, Uplink>,
    /// None: its process is dead.
    bridge: Option<Bridge>,
    bridge_config: BridgeConfig,
    /// Packets that wait for a bridge that stands still.
    waiting: Vec<Packet>,
    cameras: Option<SimulatedCameras>,
    make_link: MakeLink,
    /// The autopilot and the link to it; None before the drone has appeared.
    linked: Option<LinkedAutopilot>,
    /// Its steady clock is so far ahead of what it was drawn as.
    ahead: Span,
    /// A person has given it the mode once.
    handed_over: bool,
    /// None: its process is dead.
    predictor: Option<Predictor>,
    predictor_inbox: Inbox<PredictorIn>,
    /// None: its process is dead.
    mission: Option<Mission>,
    mission_inbox: Inbox<MissionIn>,
    /// The supervisor's.
    keeper: Keeper,
    /// All of its processes are dead.
    is_dead: bool,
    /// The computer stood still until then.
    stood_still_until: Time<TrueTime>,
    /// None: its process is dead.
    planner: Option<Planner>,
    /// None: its process is dead.
    pilot: Option<Pilot>,
    pilot_inbox: Inbox<PilotIn>,
    plans: DelayLine<Plan>,
    solve_delay: Span,
    commands: Vec<Command>,
    /// What a mutant remembers.
    mutated: Mutated,
    /// A test's set-point in place of the pilot's.
    external: Option<SetPoint>,
    /// The range that a stuck rangefinder repeats, m.
    repeated_m: Option<f64>,
    /// Fault: images are stamped so late.
    images_late: Span,
    /// Fault: the deck seen is so far from the vessel's, NED, m.
    sees_beside: Vector3<f64>,
    /// When the next status is due.
    status_due: Time<TrueTime>,
    /// When the pilot stands still.
    pilot_outage_window: Option<[Time<TrueTime>; 2]>,
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

/// The mission's configuration in this scenario.
fn mission_config(scenario: &Scenario, nodes: &NodeConfigs) -> MissionConfig {
    let mission = nodes.settings().mission();
    MissionConfig {
        reservation_required: mission.reservation_required || scenario.drones > 1,
        ..mission
    }
}

/// Makes the link of a drone's computer.
fn make_link(nodes: &NodeConfigs, id: u32) -> MakeLink {
    let (config, drone) = (nodes.autopilot.clone(), nodes.drone.clone());
    let attitudes = drone.pilot.output == Output::Attitude;
    Rc::new(move |boot| AutopilotLink::new(&config, &drone.odometry, &drone.airframe, attitudes, id, boot))
}

impl DroneComputer {
    fn new(k: usize, scenario: &Scenario, nodes: &NodeConfigs, physics: &Physics, boot: u32) -> Self {
        let (drone, id) = (&nodes.settings(), DRONE_ID + k as u32);
        let streams = physics.streams().of_drone(k);
        let bridge = BridgeConfig {
            drone_id: id,
            ..nodes.bridge.clone()
        };
        let mission = mission_config(scenario, nodes);
        let moment = || Span::from_secs(BEGINS_WITHIN_S * Noise::new(&streams, "begin_anyway").uniform());
        let forced = scenario.begin_anyway.then(moment);
        let identity = CameraIdentity {
            vessel: VESSEL_ID,
            drone: id,
            boot,
        };
        DroneComputer {
            k,
            boot,
            radio: Session::new(&scenario.radio, &streams),
            bridge: Some(Bridge::new(&bridge, boot)),
            bridge_config: bridge,
            waiting: Vec::new(),
            cameras: SimulatedCameras::new(scenario, &drone.camera, &drone.tags(), identity, &streams),
            make_link: make_link(nodes, id),
            linked: None,
            ahead: Span::ZERO,
            handed_over: false,
            predictor: Some(Predictor::new(&drone.predictor(), boot)),
            predictor_inbox: Inbox::default(),
            mission: Some(
                Mission::new(&mission, &drone.airframe, &drone.deck, id, boot).forced_descent(forced),
            ),
            mission_inbox: Inbox::default(),
            keeper: Keeper::default(),
            is_dead: false,
            stood_still_until: Time::EPOCH,
            planner: Some(nodes.planner(boot)),
            pilot: Some(Pilot::new(&drone.pilot, &drone.airframe, id, boot)),
            pilot_inbox: Inbox::default(),
            plans: DelayLine::new(MAX_PLANS),
            solve_delay: Span::from_secs(scenario.solve_delay_s),
            commands: Vec::new(),
            mutated: Mutated::default(),
            external: None,
            repeated_m: None,
            images_late: Span::ZERO,
            sees_beside: Vector3::zeros(),
            status_due: Time::EPOCH,
            pilot_outage_window: None,
            mission_state: MissionState::default(),
            forecast: None,
            autopilot_state: AutopilotState::default(),
            last_set_point: None,
        }
    }

    /// The boot of a process that starts anew, with or without the checkpoints of the ones before.
    fn next_boot(&mut self, checkpoints: Checkpoints) -> u32 {
        if checkpoints == Checkpoints::Lost {
            self.keeper = Keeper::default();
        }
        self.boot += 1;
        self.boot
    }
    /// The drone appears in the air, flown by a person.
    fn appear(&mut self, physics: &mut Physics) {
        physics.place_drone(self.k);
        let (streams, make) = (physics.streams().of_drone(self.k), Rc::clone(&self.make_link));
        self.linked = physics
            .autopilot(self.k)
            .map(|(config, autopilot)| LinkedAutopilot::new(config, &streams, autopilot, make, self.boot));
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

    /// The nodes in data-flow order; the set-point at last to who flies.
    fn tick(
        &mut self,
        physics: &mut Physics,
        reports_status: bool,
        foresight: Option<&Foresight>,
        failing: &Failing,
        tap: &mut impl Tap,
    ) {
        let (k, t) = (self.k, physics.now());
        let clock = physics.drone_clock(k).ahead(self.ahead);
        let now = clock.read(t);
        if failing.frozen.computer {
            // What comes by radio and wire waits, and bears the time of its reading.
            self.stood_still_until = t;
            let _lost = physics.drone_readings(k);
            return;
        }

        // The radio, then the bridge.
        let read_from = self.stood_still_until;
        let stamped = |(arrival, packet)| Stamped::new(clock.read(read_from.max(arrival)), packet);
        let packets: Vec<_> = self.radio.at_drone(t).into_iter().map(stamped).collect();
        if self.is_dead {
            // What arrives is lost.
            let _lost = physics.drone_readings(k);
            let _lost = self.linked.as_mut().map(|linked| linked.receive(t, now));
            return;
        }
        let received = self.bridge(t, now, packets, failing, tap);
        if let Some(request) = received.time_request {
            self.radio
                .send_to_vessel(t, TIME_REQUEST.bytes, Uplink::TimeRequest(request));
        }

        // The autopilot over its link, cameras, rangefinder -> predictor.
        let (Some(mut readings), Some(linked)) = (physics.drone_readings(k), &mut self.linked) else {
            return;
        };
        readings.shift(self.ahead);
        if !self.handed_over {
            // PX4 denies until set-points were streamed for long enough: the person tries again.
            let autopilot = &mut linked.autopilot;
            let offboard = mode_number(autopilot.firmware(), AutopilotMode::Offboard);
            self.handed_over = autopilot.choose(offboard);
        }
        linked.autopilot.steel_m = physics.deck_distance_m(k);
        let flown = linked.receive(t, now);
        let (mut odometry, mut autopilot) = (flown.odometry.last().copied(), flown.state);
        if let Some(mutant) = failing.mutant {
            odometry = odometry.map(|state| mutant.odometry(state));
            autopilot = autopilot.map(|state| mutant.autopilot(state));
        }
        self.commands.extend(flown.command);
        readings.ranges.extend(flown.ranges);
        self.autopilot_state = autopilot.unwrap_or(self.autopilot_state);
        if let Some(cameras) = &mut self.cameras {
            cameras.step(t, now, &mut readings);
        }
        self.mislead(physics, &mut readings);
        failing.drone.spoil(&mut readings, &mut self.repeated_m);
        let input = PredictorIn {
            estimate: received.estimate,
            wave: received.wave,
            prediction: received.prediction,
            surroundings: received.surroundings,
            link: received.link,
            drone: odometry,
            tags: readings.tags,
            uvdar: readings.uvdar,
            ranges: readings.ranges.clone(),
            checkpoint: self.predictor.as_ref().and_then(|p| self.keeper.answer(p.boot())),
        };
        let mut predicted = PredictorOut::default();
        if let Some(predictor) = &mut self.predictor
            && let Some(input) = self.predictor_inbox.take(input)
        {
            predicted = predictor.step(now, &input);
            let believed = odometry
                .zip(physics.drone(k))
                .map(|(d, truth)| drift(&d, now, &truth));
            if let (Some(foresight), Some(forecast)) = (foresight, &mut predicted.forecast) {
                foresight.correct(forecast, &clock, &believed.unwrap_or_default());
            }
            tap.predictor(t, now, &input, &predicted);
        }
        self.keeper.take(now, predicted.checkpoint.as_ref());
        let mut forecast = predicted.forecast;
        if let Some(mutant) = failing.mutant {
            forecast = mutant.forecast(now, forecast, self.forecast);
        }
        self.forecast = forecast.or(self.forecast);

        // Mission -> planner.
        self.commands.extend(received.commands);
        if let Some(mutant) = failing.mutant {
            mutant.commands(
                now,
                &mut self.commands,
                self.mission_state.state,
                &mut self.mutated.ordered,
            );
        }
        let plan = self.plans.arrived(t).pop();
        let input = MissionIn {
            forecast,
            drone: odometry,
            autopilot,
            plan,
            set_point: self.last_set_point,
            commands: self.commands.drain(..).collect(),
            deck: received.deck,
            ranges: readings.ranges.clone(),
            checkpoint: self.mission.as_ref().and_then(|m| self.keeper.answer(m.boot())),
        };
        let input = match failing.mutant {
            Some(mutant) => mutant.mission_in(now, input, &self.mutated),
            None => input,
        };
        let mut decided = MissionOut::default();
        if let Some(mission) = &mut self.mission
            && let Some(input) = self.mission_inbox.take(input)
        {
            decided = mission.step(now, &input);
            tap.mission(t, now, &input, &decided);
        }
        self.keeper.take(now, decided.checkpoint.as_ref());
        let landing = decided.checkpoint.filter(|c| c.landing);
        self.mutated.checkpoint = self.mutated.checkpoint.or(landing);
        let mut mission = decided.state;
        if let Some(mutant) = failing.mutant {
            mission = mutant.mission(now, mission, &self.mission_state);
        }
        self.mission_state = mission.unwrap_or(self.mission_state);
        if reports_status && t >= self.status_due {
            self.status_due = t + STATUS_PERIOD;
            let distance = DroneStatus::deck_distance_m(now, odometry.as_ref(), self.forecast.as_ref());
            let status = self.status(self.header(physics), distance);
            if let Ok(bytes) = wire::encode(&status) {
                self.radio.send_to_vessel(t, bytes.len(), Uplink::Status(status));
            }
        }

        let input = PlannerIn {
            forecast,
            mission,
            drone: odometry,
        };
        let mut solved = PlannerOut::default();
        if let Some(planner) = self.planner.as_mut().filter(|_| !failing.frozen.planner) {
            solved = planner.step(now, &input);
            tap.planner(t, now, &input, &solved);
        }
        if let Some(plan) = solved.plan {
            // A full line means plans that nobody fetches: the oldest state is lost, no more.
            let delay = self.solve_delay + Span::from_secs(failing.solve_s);
            let _full = self.plans.push(t + delay, plan);
        }

        // Pilot -> link to the autopilot.
        let stands_still = self
            .pilot_outage_window
            .is_some_and(|[from, until]| from <= t && t < until);
        let mut set_point = None;
        let input = PilotIn {
            plan,
            mission,
            forecast,
            drone: odometry,
            autopilot,
            ranges: readings.ranges,
        };
        if let Some(pilot) = self.pilot.as_mut().filter(|_| !stands_still)
            && let Some(input) = self.pilot_inbox.take(input)
        {
            let flown = pilot.step(now, &input);
            tap.pilot(t, now, &input, &flown);
            set_point = self.external.or(flown.set_point);
            if let Some(mutant) = failing.mutant {
                set_point = set_point.map(|s| mutant.set_point(s, &input.ranges, self.mission_state.state));
            }
            self.last_set_point = set_point.or(self.last_set_point);
        }
        let input = AutopilotIn {
            set_point,
            mission,
            forecast,
            ..AutopilotIn::default()
        };
        if let Some(linked) = &mut self.linked {
            linked.send(t, now, input);
        }
    }

    /// The header of a message of this computer or its operator.
    fn header(&self, physics: &mut Physics) -> Header<DroneClock> {
        let mut header = physics.header(self.k);
        header.at += self.ahead;
        header
    }
    /// What has come by radio, through the bridge.
    fn bridge(
        &mut self,
        t: Time<TrueTime>,
        now: Time<DroneClock>,
        mut packets: Vec<Stamped<DroneClock, Packet>>,
        failing: &Failing,
        tap: &mut impl Tap,
    ) -> BridgeOut {
        if failing.twin_m != 0.0 {
            let twins: Vec<_> = packets.iter().filter_map(|p| twin(p, failing.twin_m)).collect();
            packets.extend(twins);
        }
        let Some(bridge) = &mut self.bridge else {
            return BridgeOut::default();
        };
        if failing.frozen.bridge {
            let room = MAX_WAITING.saturating_sub(self.waiting.len());
            self.waiting
                .extend(packets.into_iter().take(room).map(|p| p.value));
            return BridgeOut::default();
        }
        // What has waited bears the time of its reading.
        let waited = self.waiting.drain(..).map(|p| Stamped::new(now, p));
        let packets = waited.chain(packets).collect();
        let input = BridgeIn { packets };
        let mut received = bridge.step(now, &input);
        tap.bridge(t, now, &input, &received);
        if let Some(mutant) = failing.mutant {
            let id = self.bridge_config.drone_id;
            mutant.received(now, &mut received, (id, failing.apart), &mut self.mutated);
        }
        received
    }
    /// So long its drone is armed on the deck without anybody's doing, as its status says, s.
    pub fn still_armed_s(&self) -> Option<f64> {
        let now = self.mission_state.header.at;
        still_armed_s(
            now,
            &self.mission_state,
            self.autopilot_state.armed,
            &DisarmConfig::default(),
        )
    }

    /// What faults make of what the cameras saw.
    fn mislead(&self, physics: &Physics, readings: &mut DroneReadings) {
        let Some(truth) = physics.drone(self.k) else {
            return;
        };
        let beside: [f64; 3] =
            (body_from_camera().transpose() * (truth.attitude.0.inverse() * self.sees_beside)).into();
        let shown = |p: &mut [f64; 3]| p.iter_mut().zip(beside).for_each(|(p, by)| *p += by);
        for m in &mut readings.tags {
            m.header.at += self.images_late;
            shown(&mut m.position);
        }
        for m in &mut readings.uvdar {
            m.header.at += self.images_late;
            shown(&mut m.position);
        }
    }
    fn status(&self, header: Header<DroneClock>, deck_distance_m: Option<f32>) -> DroneStatus {
        let (mission, autopilot) = (&self.mission_state, &self.autopilot_state);
        let still_armed_s = still_armed_s(header.at, mission, autopilot.armed, &DisarmConfig::default());
        DroneStatus {
            still_armed_s: still_armed_s.map(|s| s as f32),
            ..DroneStatus::of(header, mission, Some(autopilot), deck_distance_m)
        }
    }
}
