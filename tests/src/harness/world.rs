//! The simulated world in lock-step with the nodes. [`World::tick`] follows the data flow of the architecture
//! diagram: the vessel's computer; the radio; on each drone's computer ([`SimulatedDroneComputer`]) bridge,
//! predictor, mission, planner, pilot and autopilot link; then autopilots and physics.
//!
//! Delays (radio, clocks, solve time, autopilot wire) belong to the world, not to the nodes.

use super::{
    ashore::Ashore,
    errors::{EstimateError, of_deck, of_vessel},
    failing::Failing,
    foresight::Foresight,
    link::LinkedAutopilot,
    observer::{NoObserver, WorldObserver},
    outcome::TrialObservation,
    physics::{BOOT, DRONE_ID, Physics, TICK, VESSEL_ID},
    scenario::{NodeConfigs, Scenario, SetupError},
    vessel_computer::VesselSide,
};
pub use super::{drone_computer::SimulatedDroneComputer, link::Checkpoints};
use crate::{autopilots::simulated::INNER_PER_OUTER, physics::streams::Streams};
use alight_bridge::Packet;
use alight_shared::{
    admission::{Arrival, Sender},
    msg::{CommandKind, DeckOrder, MissionState},
    process::ProcessKind,
    radio::{RadioEnd, RadioTopic},
    time::{Span, Time, VesselTime, WorldTime},
};
use alight_usv::{ComputerIn, ComputerOut, VesselCheckpoint, deck::DeckInputs};
use core::f64::consts::TAU;
use nalgebra::Vector3;

/// Time constant with which a load on the vessel builds up, s: a crew member shifts their weight.
const PUSH_RISE_S: f64 = 0.4;
/// Reading of the steady clock after a power loss, s.
const BOOT_S: f64 = 20.0;
/// Age up to which an estimate is compared with the truth.
const PRESENT: Span = Span::from_millis(500);
/// Roll period in another ship's wake, s.
const WAKE_S: f64 = 2.5;

pub struct World {
    physics: Physics,
    /// Kept for restarting computers.
    scenario: Scenario,
    nodes: NodeConfigs,
    /// True motion, for forecasts that use it.
    foresight: Option<Foresight>,
    vessel: VesselSide,
    /// State of the vessel's deck, and checkpoint of the previous start of its process.
    deck_inputs: DeckInputs,
    checkpoint: Option<VesselCheckpoint>,
    ashore: Ashore,
    /// Drones report to the vessel, which grants its deck and relays commands. Disabled for a single drone
    /// without reservation to save time.
    is_deck_shared: bool,
    /// Deck owner according to the vessel's newest grant; 0: no owner.
    deck_owner: u32,
    drones: Vec<SimulatedDroneComputer>,
    /// Rate errors of the steady clocks of vessel and first drone, s/s.
    clock_rates: [f64; 2],
    /// Current and commanded force and moment on the vessel, N and Nm.
    push: [f64; 6],
    wanted_push: [f64; 6],
    wake_nm: f64,
    /// Lead of the vessel's steady clock over its clock model.
    vessel_ahead: Span,
    /// Errors of the vessel's newest estimate, and its time.
    vessel_errors: (WorldTime, Vec<EstimateError>),
}

impl World {
    /// Creates the world before the warm-up.
    pub fn new(
        scenario: &Scenario,
        nodes: &NodeConfigs,
        seed: impl Into<Streams>,
    ) -> Result<World, SetupError> {
        World::from_streams(scenario, nodes, seed.into())
    }
    fn from_streams(scenario: &Scenario, nodes: &NodeConfigs, streams: Streams) -> Result<World, SetupError> {
        let scenario = &scenario.drawn(streams);
        let physics = Physics::new(scenario, streams)?;
        let foresight = scenario
            .foresight
            .as_ref()
            .map(|part| Foresight::new(scenario, part, streams));
        Ok(World {
            foresight: foresight.transpose()?,
            vessel: VesselSide::new(scenario, nodes, physics.vessel_clock(), BOOT),
            deck_inputs: DeckInputs::default(),
            checkpoint: None,
            ashore: Ashore::new(scenario, &streams),
            is_deck_shared: scenario.drones > 1
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
            vessel_errors: (Time::EPOCH, Vec::new()),
        })
    }
    pub fn fail(&mut self, failing: &Failing) {
        for (k, drone) in self.drones.iter_mut().enumerate() {
            if k == 0 {
                drone.fail(failing);
            }
            drone.mutate(failing.mutant);
        }
        self.vessel.fail(failing);
        self.physics.fail_moving_base(failing.moving_base);
        self.clock_rates = failing.clock_rates;
        self.wanted_push = failing.push;
        self.wake_nm = failing.wake_nm;
    }
    /// Runs the vessel until the start; the drones appear shortly before it.
    pub fn warm_up(&mut self, observer: &mut dyn WorldObserver) {
        while self.warm_up_tick(observer) {}
    }
    /// Runs one tick; returns false once the warm-up is over.
    pub fn warm_up_tick(&mut self, observer: &mut dyn WorldObserver) -> bool {
        let now = self.physics.now();
        if now >= self.physics.hover_from() && self.physics.drone(0).is_none() {
            for drone in &mut self.drones {
                drone.appear(&mut self.physics);
            }
        }
        let warms_up = now < self.physics.started();
        if warms_up {
            self.tick(observer);
        }
        warms_up
    }

    pub fn command(&mut self, kind: CommandKind) {
        for k in 0..self.drones.len() {
            self.command_to(k, kind);
        }
    }
    pub fn command_to(&mut self, k: usize, kind: CommandKind) {
        self.drones[k].command(kind, &mut self.physics);
    }
    /// Removes a fraction of the first drone's weight.
    pub fn lighten(&mut self, fraction: f64) {
        if let Some(l) = self.linked(0) {
            l.lighten(fraction);
        }
    }
    /// Enables reports, grants and relayed commands for a single drone, too.
    pub fn set_deck_shared(&mut self) {
        self.is_deck_shared = true;
    }
    pub fn operator_command(&mut self, k: usize, kind: CommandKind) {
        self.ashore.command(self.physics.now(), k, kind);
    }
    pub fn deck_order(&mut self, order: DeckOrder) {
        self.vessel.order(self.vessel_now(), order);
    }
    pub fn deck_inputs(&mut self, inputs: DeckInputs) {
        self.deck_inputs = inputs;
    }
    /// Simulates a crew that removes a drone and restarts it with its computer; it appears in the air at its
    /// start position.
    pub fn restart_drone(&mut self, k: usize) {
        let before = &self.drones[k];
        let radio = before.radio.clone();
        let boot = before.boot + 1;
        self.drones[k] = SimulatedDroneComputer::new(k, &self.scenario, &self.nodes, &self.physics, boot);
        self.drones[k].radio = radio;
        self.drones[k].appear(&mut self.physics);
    }
    pub fn snag(&mut self, k: usize, foot: usize, newton: f64) {
        self.physics.snag(k, foot, newton);
    }
    /// Places a drone on a pad at its current position, as landed and disarmed by a pilot.
    pub fn stand_on_pad(&mut self, k: usize) {
        self.physics.stand_on_pad(k);
        if let Some(l) = self.linked(k) {
            l.autopilot.arm(false);
        }
    }
    pub fn linked(&mut self, k: usize) -> Option<&mut LinkedAutopilot> {
        self.drones[k].linked.as_mut()
    }

    pub fn kill(&mut self, k: usize, process: ProcessKind) {
        self.drones[k].kill(process);
    }
    pub fn start(&mut self, k: usize, process: ProcessKind, checkpoints: Checkpoints) {
        self.drones[k].start(process, checkpoints, (&self.physics, &self.nodes));
    }
    pub fn kill_computer(&mut self, k: usize) {
        self.drones[k].kill_all();
    }
    pub fn start_computer(&mut self, k: usize, checkpoints: Checkpoints) {
        self.drones[k].start_all(checkpoints, (&self.scenario, &self.nodes, &self.physics));
    }
    /// Steps the steady clock of a drone, or of the vessel (None), as a suspend of the computer does.
    pub fn step_clock(&mut self, drone: Option<usize>, by: Span) {
        match drone {
            None => self.vessel_ahead = self.vessel_ahead + by,
            Some(k) => self.drones[k].ahead = self.drones[k].ahead + by,
        }
    }
    /// Restarts a drone's steady clock, as a reboot does; only checkpoints on disk remain.
    pub fn restart_clock(&mut self, k: usize) {
        let now = self.physics.drone_now(k);
        let drone = &mut self.drones[k];
        let ahead = Time::EPOCH - now + Span::from_secs(BOOT_S);
        drone.restart_clock(now + drone.ahead, ahead);
    }

    pub fn reset_heading(&mut self, k: usize, by_rad: f64) {
        if let Some(linked) = self.linked(k) {
            linked.autopilot.reset_heading(by_rad);
        }
    }
    /// Resets the position in a drone's autopilot by `by`, m; `counted` increments its reset counter.
    pub fn reset_position(&mut self, k: usize, by: &Vector3<f64>, counted: bool) {
        if let Some(linked) = self.linked(k) {
            linked.autopilot.reset_position(by, counted);
        }
    }
    pub fn restart_vessel(&mut self) {
        self.checkpoint = self.vessel.restart_vessel();
    }

    /// Changes the vessel's course or speed, as happens during a first descent.
    pub fn ask_change(&mut self) {
        self.physics.ask_change();
    }
    /// Interrupts a drone's radio for `lasts_s` (infinite: permanently). A second outage does not replace the first.
    pub fn radio_outage(&mut self, k: usize, lasts_s: f64) {
        let from = self.physics.now();
        // Longer than any trial.
        let until = from + Span::from_secs(lasts_s.min(1e6));
        self.drones[k].radio.set_outage([from, until]);
    }

    /// Advances by one tick of 10 ms; shows the first drone's rows to the observer.
    pub fn tick(&mut self, observer: &mut dyn WorldObserver) {
        let t = self.physics.now();
        observer.truth(t, &self.physics.vessel(), self.physics.drone_in_wind(0).as_ref());

        self.advance_clocks();

        // The vessel: sensors, drones' statuses, orders -> estimator, deck arbiter, operator relay -> broadcast.
        let now = (t, self.vessel_now(), self.vessel_ahead);
        let measured = (self.physics.vessel_readings(), self.physics.vessel_rtcm());
        let mut input = ComputerIn {
            deck_inputs: self.deck_inputs,
            checkpoint: self.checkpoint.take(),
            ..ComputerIn::default()
        };
        self.ashore.tick(t);
        self.receive_at_vessel(t, &mut input);
        let output = self
            .vessel
            .tick(now, measured, input, |step| observer.step(t, step));
        if let Some(estimate) = &output.vessel.estimate {
            self.vessel_errors = (t, of_vessel(estimate, &self.physics.vessel()));
        }
        self.broadcast(t, &output);

        // Each drone's computer: bridge -> predictor -> mission -> planner -> pilot -> link to the autopilot.
        if let Some(f) = &mut self.foresight {
            f.look(t);
        }
        let foresight = self.foresight.as_ref();
        for (k, drone) in self.drones.iter_mut().enumerate() {
            match k {
                0 => drone.tick(&mut self.physics, self.is_deck_shared, foresight, observer),
                _ => drone.tick(&mut self.physics, self.is_deck_shared, foresight, &mut NoObserver),
            }
        }

        // Sea, vessel, autopilots, drones, contact.
        self.push_vessel(t);
        self.physics.advance_with(INNER_PER_OUTER, |k, truth| {
            self.drones[k].linked.as_mut().and_then(|l| l.turn(truth))
        });
    }
    fn advance_clocks(&mut self) {
        let [vessel, drone] = self.clock_rates.map(|rate| Span::from_secs(rate * TICK.secs()));
        self.vessel_ahead = self.vessel_ahead + vessel;
        if let Some(first) = self.drones.first_mut() {
            first.ahead = first.ahead + drone;
            first.apart.set(self.vessel_ahead - first.ahead);
        }
    }
    /// Applies the load on the vessel, which builds up gradually, and the moment of another ship's wake.
    fn push_vessel(&mut self, t: WorldTime) {
        for (force, wanted) in self.push.iter_mut().zip(self.wanted_push) {
            *force += (wanted - *force) * TICK.secs() / PUSH_RISE_S;
        }
        let mut push = self.push;
        push[3] += self.wake_nm * (TAU / WAKE_S * t.secs()).sin();
        self.physics.push(push);
    }
    fn broadcast(&mut self, t: WorldTime, output: &ComputerOut) {
        let with_deck = self.is_deck_shared;
        if let Some(grant) = output.grant.filter(|_| with_deck) {
            self.deck_owner = grant.owner;
        }
        let sender = Sender::Vessel(VESSEL_ID);
        output.broadcast(|kind, bytes, _held| {
            let of_deck = matches!(kind, RadioTopic::Deck | RadioTopic::Command);
            if of_deck && !with_deck {
                return;
            }
            let packet = Packet { kind, sender, bytes };
            let length = packet.bytes.len();
            if kind.row().to == RadioEnd::Operator {
                return self.ashore.radio.send_to_drone(t, length, packet);
            }
            for drone in &mut self.drones {
                drone.radio.send_to_drone(t, length, packet.clone());
            }
        });
    }

    fn receive_at_vessel(&mut self, t: WorldTime, input: &mut ComputerIn) {
        let clock = self.physics.vessel_clock().ahead(self.vessel_ahead);
        let drones = self.drones.iter_mut().map(|drone| &mut drone.radio);
        for radio in drones.chain([&mut self.ashore.radio]) {
            for (at, packet) in radio.at_vessel(t) {
                let arrival = Arrival {
                    at: clock.read(at),
                    sender: packet.sender,
                    message: packet.bytes,
                };
                // The vessel drops what it cannot decode.
                let _undecoded = input.receive(packet.kind, &arrival);
            }
        }
    }

    fn vessel_now(&self) -> VesselTime {
        self.physics.vessel_now() + self.vessel_ahead
    }
    pub fn physics(&self) -> &Physics {
        &self.physics
    }
    /// Errors of the vessel's estimate, unless it is old, and of a drone's forecast.
    pub fn errors(&self, k: usize) -> impl Iterator<Item = EstimateError> {
        let of_drone = || {
            let computer = self.drones.get(k)?;
            let now = self.physics.drone_now(k) + computer.ahead;
            let drone = computer.odometry.as_ref()?;
            let truth = (&self.physics.drone(k)?, &self.physics.deck());
            of_deck(computer.forecast.as_ref()?, drone, now, truth)
        };
        let (at, of_vessel) = &self.vessel_errors;
        let is_present = self.physics.now() - *at < PRESENT;
        let of_vessel = of_vessel.iter().copied().filter(move |_| is_present);
        of_vessel.chain(of_drone().unwrap_or_default())
    }
    /// Whether a finding on a device of the vessel asks for action.
    pub fn vessel_is_doubted(&self) -> bool {
        self.vessel.is_doubted()
    }
    pub fn wants_steady(&self) -> bool {
        let now = self.vessel_now();
        self.vessel
            .vessel()
            .is_some_and(|v| v.arbiter().wants_steady(now))
    }
    pub fn deck_is_free(&self, k: usize) -> bool {
        [0, DRONE_ID + k as u32].contains(&self.deck_owner)
    }
    pub fn drones(&self) -> &[SimulatedDroneComputer] {
        &self.drones
    }
    pub fn mission_state(&self) -> &MissionState {
        &self.drones[0].mission_state
    }
    /// Input of the judge for the first drone.
    pub fn observation(&self) -> TrialObservation<'_> {
        self.observation_of(0)
    }
    pub fn observation_of(&self, k: usize) -> TrialObservation<'_> {
        self.physics.observation(k, &self.drones[k].mission_state)
    }
}
