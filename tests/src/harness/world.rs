//! The simulated world in lock-step with the nodes. [`World::tick`] is the architecture diagram:
//! the vessel's computer ([`VesselComputer`]), radio; then on each drone's computer ([`SimulatedDroneComputer`]) bridge,
//! predictor, mission, planner, pilot, autopilot link; autopilots and physics at last, in the order data flow.
//!
//! Delays belong here (radio, clocks, solve time, the wire to the autopilot), not to the nodes.

pub use super::drone_computer::SimulatedDroneComputer;
use super::drone_computer::Uplink;
use super::failing::Failing;
use super::foresight::Foresight;
pub use super::link::Checkpoints;
use super::link::LinkedAutopilot;
use super::outcome::TrialObservation;
use super::physics::{BOOT, DRONE_ID, Physics, TICK, VESSEL_ID};
use super::scenario::{NodeConfigs, Scenario, SetupError};
use super::tap::{NoTap, Tap};
use super::vessel_computer::VesselSide;
use crate::autopilots::simulated::INNER_PER_OUTER;
use crate::physics::streams::Streams;
use alight_bridge::Packet;
use alight_shared::admission::{Arrival, Sender};
use alight_shared::msg::{CommandKind, DeckOrder, Header, MissionState, OperatorCommand, SetPoint};
use alight_shared::process::ProcessKind;
use alight_shared::radio::{RadioEnd, RadioTopic};
use alight_shared::time::{Span, Time, TrueTime, VesselClock};
use alight_usv::deck::DeckInputs;
use alight_usv::{ComputerIn, ComputerOut};
use core::f64::consts::TAU;
use nalgebra::Vector3;

/// A push rises with this time constant, s: as a crew member shifts weight.
const PUSH_RISE_S: f64 = 0.4;
/// A steady clock reads this when the processes of a computer that was without power begin, s.
const BOOT_S: f64 = 20.0;
/// Period of the roll of another ship's wake, s.
const WAKE_S: f64 = 2.5;

/// Truth, nodes and what connects them.
pub struct World {
    physics: Physics,
    /// Scenario with which computers restart.
    scenario: Scenario,
    nodes: NodeConfigs,
    /// Foresight, where forecasts have the true motion.
    foresight: Option<Foresight>,
    // The vessel's computer.
    vessel: VesselSide,
    /// Input by its crew, its operators and its former start since the last tick.
    given: ComputerIn,
    operator_sequence: u32,
    /// Drones report to the vessel, and it grants its deck and passes commands on: the load that a drone which flies alone
    /// and needs no reservation does without.
    shares_deck: bool,
    /// Owner of the deck by the vessel's newest grant; 0: free.
    deck_owner: u32,
    // The drones' radios and computers.
    drones: Vec<SimulatedDroneComputer>,
    /// So much faster than true time the steady clocks run, the vessel's and the first drone's, s/s.
    clock_rates: [f64; 2],
    /// Present and coming force and moment on the vessel, N and Nm.
    push: [f64; 6],
    wanted_push: [f64; 6],
    /// Amplitude of the roll moment of another ship's wake, Nm.
    wake_nm: f64,
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
            .foresight
            .as_ref()
            .map(|part| Foresight::new(scenario, part, streams));
        Ok(World {
            foresight: foresight.transpose()?,
            vessel: VesselSide::new(scenario, nodes, physics.vessel_clock(), BOOT),
            given: ComputerIn::default(),
            operator_sequence: 0,
            shares_deck: scenario.drones > 1
                || nodes.drone.mission.reservation_required
                || nodes.drone.mission.takeoff,
            deck_owner: 0,
            drones: (0..scenario.drones as usize)
                .map(|k| SimulatedDroneComputer::new(k, scenario, nodes, &physics, BOOT))
                .collect(),
            physics,
            scenario: scenario.clone(),
            nodes: nodes.clone(),
            clock_rates: [0.0; 2],
            push: [0.0; 6],
            wanted_push: [0.0; 6],
            wake_nm: 0.0,
            vessel_ahead: Span::ZERO,
        })
    }
    /// So much fails from now on, of the first drone and the vessel.
    pub fn fail(&mut self, failing: &Failing) {
        for (k, drone) in self.drones.iter_mut().enumerate() {
            if k == 0 {
                drone.fail(failing);
            }
            drone.mutate(failing.mutant);
        }
        self.vessel.fail(failing);
        self.physics.fail_moving_base(failing.moving_base);
        (self.clock_rates, self.wanted_push, self.wake_nm) =
            (failing.clock_rates, failing.push, failing.wake_nm);
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
        (0..self.drones.len()).for_each(|k| self.command_to(k, kind));
    }
    /// Gives one drone's mission a command.
    pub fn command_to(&mut self, k: usize, kind: CommandKind) {
        self.drones[k].command(kind, &mut self.physics);
    }
    /// The first drone has lost this fraction of its weight.
    pub fn lighten(&mut self, fraction: f64) {
        self.linked(0).into_iter().for_each(|l| l.lighten(fraction));
    }
    /// Drones report to the vessel, and it grants its deck and passes commands on, however many there are.
    pub fn share_deck(&mut self) {
        self.shares_deck = true;
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
        self.vessel.order(self.vessel_now(), order);
    }
    /// The deck's digital inputs have these levels from now on.
    pub fn deck_inputs(&mut self, inputs: DeckInputs) {
        self.given.deck_inputs = inputs;
    }
    /// The crew takes a drone away and restarts it, its computer too: it appears in the air where it began.
    pub fn restart_drone(&mut self, k: usize) {
        let before = &self.drones[k];
        let radio = before.radio.clone();
        let boot = before.boot + 1;
        self.drones[k] = SimulatedDroneComputer::new(k, &self.scenario, &self.nodes, &self.physics, boot);
        self.drones[k].radio = radio;
        self.drones[k].appear(&mut self.physics);
    }
    /// Something holds a foot of a drone on the deck with so much, N.
    pub fn snag(&mut self, k: usize, foot: usize, newton: f64) {
        self.physics.snag(k, foot, newton);
    }
    /// A person has landed a drone on a pad where it is, and disarmed it.
    pub fn stand_on_pad(&mut self, k: usize) {
        self.physics.stand_on_pad(k);
        self.linked(k).into_iter().for_each(|l| l.autopilot.arm(false));
    }
    /// A drone's autopilot with the link to it; None before it has appeared.
    pub fn linked(&mut self, k: usize) -> Option<&mut LinkedAutopilot> {
        self.drones[k].linked.as_mut()
    }

    /// A process of a drone's computer dies; the others live on.
    pub fn kill(&mut self, k: usize, process: ProcessKind) {
        self.drones[k].kill(process);
    }
    /// Restarts the process, with or without its predecessor's checkpoint.
    pub fn start(&mut self, k: usize, process: ProcessKind, checkpoints: Checkpoints) {
        self.drones[k].start(process, checkpoints, (&self.physics, &self.nodes));
    }
    /// A drone's supervisor dies, and with it all of its computer's processes.
    pub fn kill_computer(&mut self, k: usize) {
        self.drones[k].kill_all();
    }
    /// Restarts the supervisor and all processes.
    pub fn start_computer(&mut self, k: usize, checkpoints: Checkpoints) {
        self.drones[k].start_all(checkpoints, (&self.scenario, &self.nodes, &self.physics));
    }
    /// A steady clock goes ahead by this, as after a pause of the machine: the vessel's (None) or a drone's.
    pub fn step_clock(&mut self, drone: Option<usize>, by: Span) {
        match drone {
            None => self.vessel_ahead = self.vessel_ahead + by,
            Some(k) => self.drones[k].ahead = self.drones[k].ahead + by,
        }
    }
    /// A drone's steady clock begins again, as where its computer starts, and of its checkpoints there is what lies on the disk.
    pub fn restart_clock(&mut self, k: usize) {
        let (now, drone) = (self.physics.drone_now(k), &mut self.drones[k]);
        let ahead = Time::EPOCH - now + Span::from_secs(BOOT_S);
        drone.restart_clock(now + drone.ahead, ahead);
    }

    /// A test flies a drone from now on: this set-point stands in place of the pilot's.
    pub fn fly_by_set_point(&mut self, k: usize, set_point: SetPoint) {
        self.drones[k].fly_by(set_point);
    }
    /// The estimator of a drone's autopilot resets its heading, wrong by this much more, rad.
    pub fn reset_heading(&mut self, k: usize, by_rad: f64) {
        if let Some(linked) = self.linked(k) {
            linked.autopilot.reset_heading(by_rad);
        }
    }
    /// The estimator of a drone's autopilot resets its position, this much further on (m); it counts that or not.
    pub fn reset_position(&mut self, k: usize, by: &Vector3<f64>, counted: bool) {
        if let Some(linked) = self.linked(k) {
            linked.autopilot.reset_position(by, counted);
        }
    }
    /// Restarts the vessel's computer, with what it kept.
    pub fn restart_vessel(&mut self) {
        self.given = ComputerIn {
            checkpoint: self.vessel.restart_vessel(),
            deck_inputs: self.given.deck_inputs,
            ..ComputerIn::default()
        };
    }

    /// The turn or change of speed of the vessel's course that a first descent dates.
    pub fn ask_change(&mut self) {
        self.physics.ask_change();
    }
    /// A drone's radio loses everything for so long from now on, s; infinite for good. The first such time stays.
    pub fn radio_outage(&mut self, k: usize, lasts_s: f64) {
        let from = self.physics.now();
        // Longer than any trial is for good.
        let until = from + Span::from_secs(lasts_s.min(1e6));
        self.drones[k].radio.set_outage([from, until]);
    }

    /// Ten milliseconds of everything, shown to a tap, which sees the first drone's nodes.
    pub fn tick(&mut self, tap: &mut impl Tap) {
        let t = self.physics.now();
        tap.truth(t, &self.physics.vessel(), self.physics.drone_in_wind(0).as_ref());

        self.advance_clocks();

        // The vessel: sensors, drones' statuses, orders -> estimator, deck arbiter, operator relay -> broadcast.
        let now = (t, self.vessel_now(), self.vessel_ahead);
        let measured = (self.physics.vessel_readings(), self.physics.vessel_rtcm());
        let given = ComputerIn {
            deck_inputs: self.given.deck_inputs,
            ..ComputerIn::default()
        };
        let mut input = core::mem::replace(&mut self.given, given);
        self.receive_at_vessel(t, &mut input);
        let output = self.vessel.tick(now, measured, input, |step| tap.step(t, step));
        self.broadcast(t, &output);

        // Each drone's computer: bridge -> predictor -> mission -> planner -> pilot -> link to the autopilot.
        self.foresight.iter_mut().for_each(|f| f.look(t));
        let foresight = self.foresight.as_ref();
        for (k, drone) in self.drones.iter_mut().enumerate() {
            match k {
                0 => drone.tick(&mut self.physics, self.shares_deck, foresight, tap),
                _ => drone.tick(&mut self.physics, self.shares_deck, foresight, &mut NoTap),
            }
        }

        // Sea, vessel, autopilots, drones, contact.
        self.push_vessel(t);
        self.physics.advance_with(INNER_PER_OUTER, |k, truth| {
            self.drones[k].linked.as_mut().and_then(|l| l.turn(truth))
        });
    }
    /// The steady clocks go as fast as they do.
    fn advance_clocks(&mut self) {
        let [vessel, drone] = self.clock_rates.map(|rate| Span::from_secs(rate * TICK.secs()));
        self.vessel_ahead = self.vessel_ahead + vessel;
        if let Some(first) = self.drones.first_mut() {
            first.ahead = first.ahead + drone;
            first.apart.set(self.vessel_ahead - first.ahead);
        }
    }
    /// Pushes the vessel, rising as the crew shifts its weight, and by another ship's wake.
    fn push_vessel(&mut self, t: Time<TrueTime>) {
        for (force, wanted) in self.push.iter_mut().zip(self.wanted_push) {
            *force += (wanted - *force) * TICK.secs() / PUSH_RISE_S;
        }
        let mut push = self.push;
        push[3] += self.wake_nm * (TAU / WAKE_S * t.secs()).sin();
        self.physics.push(push);
    }
    /// Broadcasts the output of the vessel's computer to the drones.
    fn broadcast(&mut self, t: Time<TrueTime>, output: &ComputerOut) {
        let with_deck = self.shares_deck;
        if let Some(grant) = output.grant.filter(|_| with_deck) {
            self.deck_owner = grant.owner;
        }
        let sender = Sender::Vessel(VESSEL_ID);
        output.broadcast(|kind, bytes, _held| {
            let of_deck = matches!(kind, RadioTopic::Deck | RadioTopic::Command);
            if kind.row().to != RadioEnd::Drone || of_deck && !with_deck {
                return;
            }
            for drone in &mut self.drones {
                let bytes = bytes.clone();
                let length = bytes.len();
                drone
                    .radio
                    .send_to_drone(t, length, Packet { kind, sender, bytes });
            }
        });
    }

    /// Receives what has come over the radios of the drones.
    fn receive_at_vessel(&mut self, t: Time<TrueTime>, input: &mut ComputerIn) {
        let clock = self.physics.vessel_clock().ahead(self.vessel_ahead);
        for drone in &mut self.drones {
            let sender = Sender::Drone(DRONE_ID + drone.k as u32);
            for (arrival, uplink) in drone.radio.at_vessel(t) {
                let at = clock.read(arrival);
                match uplink {
                    Uplink::TimeRequest(message) => {
                        input.time_requests.push(Arrival { at, sender, message });
                    }
                    Uplink::Status(message) => input.statuses.push(Arrival { at, sender, message }),
                }
            }
        }
    }

    /// Time of the vessel's clock.
    fn vessel_now(&self) -> Time<VesselClock> {
        self.physics.vessel_now() + self.vessel_ahead
    }
    /// The truth.
    pub fn physics(&self) -> &Physics {
        &self.physics
    }
    /// Whether a drone wants the vessel to keep course and speed now.
    pub fn wants_steady(&self) -> bool {
        let now = self.vessel_now();
        self.vessel
            .vessel()
            .is_some_and(|v| v.arbiter().wants_steady(now))
    }
    /// Whether the vessel keeps its deck for the drone `k`, or it is free.
    pub fn deck_is_free(&self, k: usize) -> bool {
        [0, DRONE_ID + k as u32].contains(&self.deck_owner)
    }
    /// The drones' computers.
    pub fn drones(&self) -> &[SimulatedDroneComputer] {
        &self.drones
    }
    /// The first drone's mission, its newest state.
    pub fn mission_state(&self) -> &MissionState {
        &self.drones[0].mission_state
    }
    /// Input of the judge of the first drone.
    pub fn observation(&self) -> TrialObservation<'_> {
        self.observation_of(0)
    }
    /// Input of the judge of another drone.
    pub fn observation_of(&self, k: usize) -> TrialObservation<'_> {
        self.physics.observation(k, &self.drones[k].mission_state)
    }
}
