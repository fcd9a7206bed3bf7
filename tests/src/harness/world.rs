//! The simulated world in lock-step with the nodes. [`World::tick`] is the architecture diagram:
//! sensors, estimator, radio, bridge, predictor, mission, planner, pilot, autopilot, physics, in
//! the order data flow.
//!
//! Delays belong here (radio, clocks, solve time, attitude lag), not to the nodes.

use alight_bridge::{Bridge, BridgeIn, Packet, PacketKind};
use alight_shared::frames::{Deck, DroneBody, VesselBody};
use alight_shared::msg::{
    AutopilotState, Command, CommandKind, DeckForecast, DroneState, Header, MissionState, Plan, SetPoint,
    TimeRequest,
};
use alight_shared::node::Node;
use alight_shared::time::{DroneClock, Span, Stamped, Time, TrueTime, VesselClock};
use alight_shared::topics::TIME_REQUEST;
use alight_shared::wire;
use alight_uav::camera::node::CameraIdentity;
use alight_uav::mission::{Mission, MissionIn};
use alight_uav::odometry::Odometry;
use alight_uav::pilot::{Pilot, PilotIn};
use alight_uav::planner::{Planner, PlannerIn};
use alight_uav::predictor::{Predictor, PredictorIn};
use alight_usv::{VesselIn, VesselNode};
use serde::Serialize;

use crate::harness::cameras::SimulatedCameras;
use crate::harness::outcome::Observation;
use crate::harness::scenario::{NodeConfigs, Scenario, StateOutage};
use crate::harness::tap::{NoTap, Tap};
use crate::harness::trace::TracePoint;
use crate::harness::trial::SetupError;
pub use crate::physics::TICK;
use crate::physics::body::RigidState;
use crate::physics::drone::ROTORS;
pub use crate::physics::{BOOT, DRONE_ID, VESSEL_ID};
use crate::physics::{DroneMeasurements, EXCHANGES_PER_TICK, Physics, PlantState};
use crate::radio::{ChannelCounts, Session};
use crate::sensors::delay::DelayLine;

/// Plans under way at a time.
const MAX_PLANS: usize = 64;

/// A firmware and the link to it, in the place of the simulated autopilot.
pub trait FirmwareLink {
    /// Rotor outputs for what the drone feels, [`EXCHANGES_PER_TICK`] times a tick; None: all off.
    fn motors(&mut self, truth: &PlantState) -> Option<[f64; ROTORS]>;
    /// Once a tick: what came over the link until now, as the drone's computer has it.
    fn receive(&mut self, now: Time<DroneClock>) -> FirmwareOutputs;
    /// What the drone's nodes said in this tick.
    fn send(&mut self, now: Time<DroneClock>, outputs: &NodeOutputs);
}

/// What a link says to the drone's nodes.
#[derive(Clone, Debug, Default)]
pub struct FirmwareOutputs {
    /// Odometry, smooth; None: nothing new.
    pub odometry: Option<DroneState>,
    /// The autopilot's state, when due.
    pub state: Option<AutopilotState>,
}

/// What the drone's nodes say to a link.
#[derive(Clone, Copy, Debug, Default)]
pub struct NodeOutputs {
    /// The pilot's set-point.
    pub set_point: Option<SetPoint>,
    /// The mission's state.
    pub mission: Option<MissionState>,
    /// The deck's forecast.
    pub forecast: Option<DeckForecast>,
}

/// Truth, nodes and what connects them.
pub struct World {
    physics: Physics,
    firmware: Option<Box<dyn FirmwareLink>>,
    // The vessel's computer.
    vessel_node: VesselNode,
    // The radio.
    radio: Session<Packet, TimeRequest<DroneClock>>,
    // The drone's computer.
    bridge: Bridge,
    cameras: Option<SimulatedCameras>,
    odometry: Odometry,
    predictor: Predictor,
    mission: Mission,
    planner: Planner,
    pilot: Pilot,
    plans: DelayLine<Plan>,
    solve_delay: Span,
    command: Option<Command>,
    // What the judge and a plot look at.
    mission_state: MissionState,
    forecast: Option<DeckForecast>,
    last_set_point: Option<SetPoint>,
    /// When the pilot stands still.
    pilot_outage_window: Option<[Time<TrueTime>; 2]>,
}

impl World {
    /// The world of `seed` before the warm-up.
    pub fn new(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> Result<World, SetupError> {
        let physics = Physics::new(scenario, seed)?;
        let streams = physics.streams();
        let drone = &nodes.settings();
        let names = CameraIdentity {
            vessel: VESSEL_ID,
            drone: DRONE_ID,
            boot: BOOT,
        };
        Ok(World {
            vessel_node: VesselNode::new(&nodes.vessel, VESSEL_ID, BOOT),
            radio: Session::new(&scenario.radio, streams),
            bridge: Bridge::new(&nodes.bridge, BOOT),
            cameras: SimulatedCameras::new(scenario, &drone.camera, &drone.deck, names, streams),
            odometry: Odometry::new(&drone.odometry),
            predictor: Predictor::new(&drone.predictor(), BOOT),
            mission: Mission::new(&drone.mission(), &drone.airframe, &drone.deck, DRONE_ID, BOOT),
            planner: nodes.planner(BOOT),
            pilot: Pilot::new(&drone.pilot, &drone.airframe, DRONE_ID, BOOT),
            plans: DelayLine::new(MAX_PLANS),
            solve_delay: Span::from_secs(scenario.solve_delay_s),
            command: None,
            physics,
            firmware: None,
            mission_state: MissionState::default(),
            forecast: None,
            last_set_point: None,
            pilot_outage_window: None,
        })
    }

    /// The drone is flown by a firmware from now on.
    pub fn attach_firmware(&mut self, firmware: Box<dyn FirmwareLink>) {
        self.firmware = Some(firmware);
    }

    /// Runs the vessel's side until the start; the drone appears in the air a little before.
    pub fn warm_up(&mut self) {
        self.warm_up_with(&mut NoTap);
    }

    /// The same, shown to a tap.
    pub fn warm_up_with(&mut self, tap: &mut impl Tap) {
        while self.physics.now() < self.physics.hover_from() {
            self.tick_with(tap);
        }
        self.physics.place_drone();
        while self.physics.now() < self.physics.started() {
            self.tick_with(tap);
        }
    }

    /// Gives the mission a command.
    pub fn command(&mut self, kind: CommandKind) {
        let sequence = self.physics.next_sequence();
        let header = Header::new(VESSEL_ID, DRONE_ID, BOOT, sequence, self.physics.drone_now());
        self.command = Some(Command { header, kind });
    }

    /// The outage that the mission's new state brings about.
    pub fn radio_outage(&mut self, outage: &StateOutage) {
        let window = outage.window(self.physics.now());
        self.radio.set_outage(window);
    }

    /// The standstill of the pilot that the mission's new state brings about; the first stays.
    pub fn pilot_outage(&mut self, outage: &StateOutage) {
        let window = outage.window(self.physics.now());
        self.pilot_outage_window = Some(self.pilot_outage_window.unwrap_or(window));
    }

    /// What the radio carried and lost: to the drone, to the vessel.
    pub fn radio_counts(&mut self) -> [ChannelCounts; 2] {
        self.radio.counts()
    }

    /// Ten milliseconds of everything.
    pub fn tick(&mut self) {
        self.tick_with(&mut NoTap);
    }

    /// Ten milliseconds of everything, shown to a tap.
    pub fn tick_with(&mut self, tap: &mut impl Tap) {
        let t = self.physics.now();
        let clocks = *self.physics.clocks();
        tap.truth(t, &self.vessel(), self.drone().as_ref());
        let (vessel_now, drone_now) = (self.physics.vessel_now(), self.physics.drone_now());

        // The vessel: sensors -> estimator -> broadcast.
        let readings = self.physics.vessel_readings();
        let time_requests = self
            .radio
            .at_vessel(t)
            .into_iter()
            .map(|(arrival, request)| Stamped::<VesselClock, _>::new(clocks.vessel_time(arrival), request))
            .collect();
        let input = VesselIn {
            imu: readings.imu,
            gnss: readings.gnss,
            heading: readings.heading,
            attitude: Vec::new(),
            time_requests,
        };
        let output = self.vessel_node.step(vessel_now, &input);
        tap.vessel(t, vessel_now, &input, &output);
        self.broadcast(t, PacketKind::Estimate, output.estimate.as_ref());
        self.broadcast(t, PacketKind::Wave, output.wave.as_ref());
        self.broadcast(t, PacketKind::Prediction, output.prediction.as_ref());
        for reply in &output.time_replies {
            self.broadcast(t, PacketKind::TimeReply, Some(reply));
        }

        // The radio, then the drone's bridge.
        let packets = self
            .radio
            .at_drone(t)
            .into_iter()
            .map(|(arrival, packet)| Stamped::new(clocks.drone_time(arrival), packet))
            .collect();
        let input = BridgeIn { packets };
        let received = self.bridge.step(drone_now, &input);
        tap.bridge(t, drone_now, &input, &received);
        if let Some(request) = received.time_request {
            self.radio.send_to_vessel(t, TIME_REQUEST.bytes, request);
        }

        // The drone: odometry made smooth, camera, rangefinder -> predictor -> mission -> planner -> pilot.
        let Some(DroneMeasurements {
            odometry,
            autopilot,
            mut readings,
        }) = self.physics.drone_measurements()
        else {
            self.physics.advance();
            return;
        };
        let (odometry, autopilot) = match &mut self.firmware {
            None => (Some(self.odometry.step(&odometry)), autopilot),
            Some(firmware) => {
                let report = firmware.receive(drone_now);
                (report.odometry, report.state)
            }
        };
        if let Some(cameras) = &mut self.cameras {
            cameras.step(t, drone_now, &mut readings);
        }
        let input = PredictorIn {
            estimate: received.estimate,
            wave: received.wave,
            prediction: received.prediction,
            link: received.link,
            drone: odometry,
            tags: readings.tags,
            uvdar: readings.uvdar,
            ranges: readings.ranges.clone(),
        };
        let predicted = self.predictor.step(drone_now, &input);
        tap.predictor(t, drone_now, &input, &predicted);
        let forecast = predicted.forecast;
        self.forecast = forecast.or(self.forecast);

        let plan = self.plans.arrived(t).pop();
        let input = MissionIn {
            forecast,
            drone: odometry,
            autopilot,
            plan,
            set_point: self.last_set_point,
            command: self.command.take(),
            // One drone, whose mission asks for no reservation.
            deck: None,
        };
        let decided = self.mission.step(drone_now, &input);
        tap.mission(t, drone_now, &input, &decided);
        let mission = decided.state;
        self.mission_state = mission.unwrap_or(self.mission_state);

        let input = PlannerIn {
            forecast,
            mission,
            drone: odometry,
            autopilot,
        };
        let solved = self.planner.step(drone_now, &input);
        tap.planner(t, drone_now, &input, &solved);
        if let Some(plan) = solved.plan {
            // A full line means plans that nobody fetches: the oldest state is lost, no more.
            let _full = self.plans.push(t + self.solve_delay, plan);
        }

        if self
            .pilot_outage_window
            .is_some_and(|[from, until]| from <= t && t < until)
        {
            self.advance(drone_now, NodeOutputs::default());
            return;
        }
        let input = PilotIn {
            plan,
            mission,
            forecast,
            drone: odometry,
            autopilot,
            ranges: readings.ranges,
        };
        let flown = self.pilot.step(drone_now, &input);
        tap.pilot(t, drone_now, &input, &flown);
        let set_point = flown.set_point;
        self.last_set_point = set_point.or(self.last_set_point);
        let outputs = NodeOutputs {
            set_point,
            mission,
            forecast,
        };
        self.advance(drone_now, outputs);
    }

    /// The set-point to who flies, and a tick of the physics under it.
    fn advance(&mut self, drone_now: Time<DroneClock>, outputs: NodeOutputs) {
        if let Some(firmware) = &mut self.firmware {
            firmware.send(drone_now, &outputs);
            self.physics
                .advance_with_firmware(EXCHANGES_PER_TICK, |truth| firmware.motors(truth));
            return;
        }
        if let Some(set_point) = &outputs.set_point {
            self.physics.apply(&self.odometry.for_autopilot(set_point));
        }
        self.physics.advance();
    }

    fn broadcast<M: Serialize>(&mut self, t: Time<TrueTime>, kind: PacketKind, message: Option<&M>) {
        // A message that does not encode is a message that is not sent: the receiver sees the gap.
        if let Some(Ok(bytes)) = message.map(wire::encode) {
            self.radio.send_to_drone(t, bytes.len(), Packet { kind, bytes });
        }
    }

    /// The truth.
    pub fn physics(&self) -> &Physics {
        &self.physics
    }
    /// The deck, truth.
    pub fn deck(&self) -> RigidState<Deck> {
        self.physics.deck()
    }
    /// The vessel's reference point, truth.
    pub fn vessel(&self) -> RigidState<VesselBody> {
        self.physics.vessel()
    }
    /// The drone, truth; None before it appears.
    pub fn drone(&self) -> Option<RigidState<DroneBody>> {
        self.physics.drone()
    }
    /// Time since the landing was commanded.
    pub fn time_since_start(&self) -> Span {
        self.physics.time_since_start()
    }
    /// True time.
    pub fn now(&self) -> Time<TrueTime> {
        self.physics.now()
    }
    /// The mission's newest state.
    pub fn mission_state(&self) -> &MissionState {
        &self.mission_state
    }
    /// The newest forecast.
    pub fn forecast(&self) -> Option<&DeckForecast> {
        self.forecast.as_ref()
    }
    /// Hash of all true states and set-points so far.
    pub fn digest(&self) -> u64 {
        self.physics.digest()
    }
    /// What the judge looks at.
    pub fn observation(&self) -> Observation<'_> {
        self.physics.observation(&self.mission_state)
    }
    /// One point of a trace.
    pub fn trace_point(&self) -> TracePoint {
        self.physics.trace_point()
    }
}
