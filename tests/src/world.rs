//! The simulated world. [`World::tick`] is the architecture diagram: sensors, estimator, radio,
//! bridge, predictor, mission, planner, pilot, autopilot, physics, in the order data flow.
//!
//! Delays belong here (radio, clocks, solve time, attitude lag), not to the nodes.

use alight_bridge::{Bridge, BridgeIn, Packet, PacketKind};
use alight_shared::frames::{Deck, DroneBody, VesselBody, wrap_angle};
use alight_shared::msg::{
    AutopilotState, Command, CommandKind, DeckForecast, Header, MissionState, Plan, SetPoint, State,
    TimeRequest,
};
use alight_shared::node::Node;
use alight_shared::time::{DroneClock, Span, Stamped, Time, TrueTime, VesselClock};
use alight_shared::wire;
use alight_uav::mission::{Mission, MissionIn};
use alight_uav::pilot::{Pilot, PilotIn};
use alight_uav::planner::{Planner, PlannerIn};
use alight_uav::predictor::{Predictor, PredictorIn};
use alight_usv::{VesselIn, VesselNode};
use nalgebra::Vector3;
use serde::Serialize;

use crate::body::RigidState;
use crate::deck_motion::DeckCarrier;
use crate::drone::{DroneStart, DroneWorld, Part};
use crate::outcome::{Observation, Touch};
use crate::radio::{Direction, Radio};
use crate::scenario::{NodeConfigs, Scenario};
use crate::sea::Sea;
use crate::sensors::delay::DelayLine;
use crate::sensors::noise::Noise;
use crate::sensors::{DroneReadings, Sensors};
use crate::streams::Streams;
use crate::tap::{NoTap, Tap};
use crate::trace::TracePoint;
use crate::trial::SetupError;

/// The world's tick.
pub const TICK: Span = Span::from_millis(10);
/// The autopilot tells its state every so many ticks.
const AUTOPILOT_TICKS: u64 = 10;
/// Identity of the simulated vessel.
pub const VESSEL_ID: u32 = 1;
/// Identity of the drone.
pub const DRONE_ID: u32 = 1;
/// Boot id of all processes.
pub const BOOT: u32 = 1;
/// A contact further below the deck's surface than this is with its side, m.
const BELOW_SURFACE_M: f64 = 0.05;
/// Plans under way at a time.
const PLANS: usize = 64;

/// Truth, nodes and what connects them.
pub struct World {
    // Truth.
    t: Time<TrueTime>,
    ticks: u64,
    started: Time<TrueTime>,
    sea: Sea,
    carrier: DeckCarrier,
    drone: Option<DroneWorld>,
    sensors: Sensors,
    // The vessel's computer.
    vessel_node: VesselNode,
    // The radio.
    to_drone: Radio<Packet>,
    to_vessel: Radio<TimeRequest<DroneClock>>,
    // The drone's computer.
    bridge: Bridge,
    predictor: Predictor,
    mission: Mission,
    planner: Planner,
    pilot: Pilot,
    plans: DelayLine<Plan>,
    command: Option<Command>,
    sequence: u32,
    // What the judge and a plot look at.
    scenario: Scenario,
    streams: Streams,
    mission_state: MissionState,
    forecast: Option<DeckForecast>,
    last_set_point: Option<SetPoint>,
    touches: Vec<Touch>,
    in_water: bool,
    motors_on: bool,
    digest: u64,
}

impl World {
    /// The world of `seed` before the warm-up.
    pub fn new(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> Result<World, SetupError> {
        use alight_shared::config::{Check, Keys};
        scenario.check(&Keys::ROOT)?;
        let streams = Streams::new(seed);
        let sea = Sea::new(&scenario.sea, &streams);
        let carrier = DeckCarrier::new(
            &scenario.vessel,
            scenario.deck_motion.as_ref(),
            &scenario.deck,
            &sea,
            &streams,
        )?;
        let drone = &nodes.drone;
        Ok(World {
            t: Time::EPOCH,
            ticks: 0,
            started: Time::EPOCH + Span::from_secs(scenario.start.warm_up_s),
            carrier,
            drone: None,
            sensors: Sensors::new(&scenario.sensors, &scenario.airframe, &scenario.deck, &streams),
            vessel_node: VesselNode::new(&nodes.vessel, VESSEL_ID, BOOT),
            to_drone: Radio::new(&scenario.radio, Direction::ToDrone, &streams),
            to_vessel: Radio::new(&scenario.radio, Direction::ToVessel, &streams),
            bridge: Bridge::new(&nodes.bridge, BOOT),
            predictor: Predictor::new(&drone.predictor(), BOOT),
            mission: Mission::new(&drone.mission, &drone.airframe, &drone.deck, DRONE_ID, BOOT),
            planner: Planner::new(&drone.planner, &drone.airframe, &drone.deck, BOOT),
            pilot: Pilot::new(&drone.pilot, &drone.airframe, DRONE_ID, BOOT),
            plans: DelayLine::new(PLANS),
            command: None,
            sequence: 0,
            scenario: scenario.clone(),
            streams,
            sea,
            mission_state: MissionState::default(),
            forecast: None,
            last_set_point: None,
            touches: Vec::new(),
            in_water: false,
            motors_on: true,
            digest: 0xcbf2_9ce4_8422_2325,
        })
    }

    /// Runs the vessel's side until the start; the drone appears in the air a little before.
    pub fn warm_up(&mut self) {
        self.warm_up_with(&mut NoTap);
    }

    /// The same, shown to a tap.
    pub fn warm_up_with(&mut self, tap: &mut impl Tap) {
        let hover = self.started - Span::from_secs(self.scenario.start.hover_s);
        while self.t < hover {
            self.tick_with(tap);
        }
        self.place_drone();
        while self.t < self.started {
            self.tick_with(tap);
        }
    }

    /// Gives the mission a command.
    pub fn command(&mut self, kind: CommandKind) {
        self.sequence += 1;
        let header = Header::new(VESSEL_ID, DRONE_ID, BOOT, self.sequence, self.drone_now());
        self.command = Some(Command { header, kind });
    }

    /// From now on nothing that the vessel sends arrives.
    pub fn cut_radio(&mut self) {
        self.to_drone.cut_after(self.t);
        self.to_vessel.cut_after(self.t);
    }

    fn place_drone(&mut self) {
        let start = &self.scenario.start;
        let mut draw = Noise::new(&self.streams, "drone.start");
        let mut between = |[low, high]: [f64; 2]| low + (high - low) * draw.uniform();
        let distance = between(start.distance_m);
        let height = between(start.height_m);
        let bearing = between([0.0, core::f64::consts::TAU]);
        let yaw = between([0.0, core::f64::consts::TAU]);
        let vessel = self.carrier.state().position.0;
        let position = Vector3::new(
            vessel.x + distance * bearing.cos(),
            vessel.y + distance * bearing.sin(),
            -height,
        );
        self.drone = Some(DroneWorld::new(
            &self.scenario.drone,
            &self.scenario.airframe,
            &self.scenario.deck,
            &self.streams,
            DroneStart {
                position,
                yaw: wrap_angle(yaw),
            },
        ));
    }

    /// Ten milliseconds of everything.
    pub fn tick(&mut self) {
        self.tick_with(&mut NoTap);
    }

    /// Ten milliseconds of everything, shown to a tap.
    pub fn tick_with(&mut self, tap: &mut impl Tap) {
        let t = self.t;
        tap.truth(t, &self.carrier.state(), self.drone().as_ref());
        let (vessel_now, drone_now) = (self.sensors.clocks.vessel_time(t), self.drone_now());

        // The vessel: sensors -> estimator -> broadcast.
        let readings = self.sensors.vessel(t, &self.carrier.state());
        let time_requests = self
            .to_vessel
            .receive(t)
            .into_iter()
            .map(|(arrival, request)| {
                Stamped::<VesselClock, _>::new(self.sensors.clocks.vessel_time(arrival), request)
            })
            .collect();
        let input = VesselIn {
            imu: readings.imu,
            gnss: readings.gnss,
            heading: readings.heading,
            time_requests,
        };
        let said = self.vessel_node.step(vessel_now, &input);
        tap.vessel(t, vessel_now, &input, &said);
        self.broadcast(t, PacketKind::Estimate, said.estimate.as_ref());
        self.broadcast(t, PacketKind::Wave, said.wave.as_ref());
        self.broadcast(t, PacketKind::Prediction, said.prediction.as_ref());
        for reply in &said.time_replies {
            self.broadcast(t, PacketKind::TimeReply, Some(reply));
        }

        // The radio, then the drone's bridge.
        let packets = self
            .to_drone
            .receive(t)
            .into_iter()
            .map(|(arrival, packet)| Stamped::new(self.sensors.clocks.drone_time(arrival), packet))
            .collect();
        let input = BridgeIn { packets };
        let heard = self.bridge.step(drone_now, &input);
        tap.bridge(t, drone_now, &input, &heard);
        if let Some(request) = heard.time_request {
            self.to_vessel.send(t, request);
        }

        // The drone: odometry, camera, rangefinder -> predictor -> mission -> planner -> pilot.
        let Some(mut drone) = self.drone.take() else {
            self.physics(None);
            return;
        };
        self.sequence += 1;
        let header = Header::new(VESSEL_ID, DRONE_ID, BOOT, self.sequence, drone_now);
        let odometry = Some(drone.odometry(header));
        let autopilot: Option<AutopilotState> =
            (self.ticks.is_multiple_of(AUTOPILOT_TICKS)).then(|| drone.autopilot_state(header));
        let deck = self.deck();
        let sea = &self.sea;
        let seen: DroneReadings = self.sensors.drone(t, &drone.truth(), &deck, |north, east| {
            sea.surface(t, north, east).surface_z()
        });

        let input = PredictorIn {
            estimate: heard.estimate,
            wave: heard.wave,
            prediction: heard.prediction,
            link: heard.link,
            drone: odometry,
            tags: seen.tags,
            uvdar: seen.uvdar,
            ranges: seen.ranges.clone(),
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
            let _full = self
                .plans
                .push(t + Span::from_secs(self.scenario.solve_delay_s), plan);
        }

        let input = PilotIn {
            plan,
            mission,
            forecast,
            drone: odometry,
            autopilot,
            ranges: seen.ranges,
        };
        let flown = self.pilot.step(drone_now, &input);
        tap.pilot(t, drone_now, &input, &flown);
        let set_point = flown.set_point;
        self.last_set_point = set_point.or(self.last_set_point);
        if let Some(set_point) = &set_point {
            drone.apply(set_point);
            self.hash(&set_point.attitude);
            self.hash(&[set_point.thrust, set_point.position[0], set_point.position[2]]);
        }
        self.physics(Some(drone));
    }

    /// Vessel, autopilot, drone and contact move on by one tick.
    fn physics(&mut self, drone: Option<DroneWorld>) {
        let t = self.t;
        let dt_s = TICK.secs();
        let before = self.deck();
        self.carrier.step(t, dt_s, &self.sea);
        self.touches.clear();
        if let Some(mut drone) = drone {
            let after = self.deck();
            let at = drone.truth().position.0;
            let water_z = self.sea.surface(t, at.x, at.y).surface_z();
            let report = drone.step(t.secs(), dt_s, &before, &after, water_z);
            self.in_water |= report.in_water;
            self.motors_on = report.armed;
            self.touches.extend(report.impacts.iter().map(|i| Touch {
                foot: matches!(i.part, Part::Foot(_)),
                on_deck: i.position.0.z < BELOW_SURFACE_M,
                normal_mps: i.normal_mps,
                tangential_mps: i.tangential_mps,
            }));
            let truth = drone.truth();
            self.hash(truth.position.0.as_slice());
            self.hash(truth.attitude.0.coords.as_slice());
            self.drone = Some(drone);
        }
        let carrier = self.carrier.state();
        self.hash(carrier.position.0.as_slice());
        self.t += TICK;
        self.ticks += 1;
    }

    fn broadcast<M: Serialize>(&mut self, t: Time<TrueTime>, kind: PacketKind, message: Option<&M>) {
        // A message that does not encode is a message that is not sent: the receiver sees the gap.
        if let Some(Ok(bytes)) = message.map(wire::encode) {
            self.to_drone.send(t, Packet { kind, bytes });
        }
    }

    fn hash(&mut self, values: &[f64]) {
        for v in values {
            self.digest = (self.digest ^ v.to_bits())
                .wrapping_mul(0x0000_0100_0000_01b3)
                .rotate_left(17);
        }
    }

    fn drone_now(&self) -> Time<DroneClock> {
        self.sensors.clocks.drone_time(self.t)
    }

    /// The deck, truth.
    pub fn deck(&self) -> RigidState<Deck> {
        self.carrier.state().at(self.scenario.deck.centre())
    }
    /// The vessel's reference point, truth.
    pub fn vessel(&self) -> RigidState<VesselBody> {
        self.carrier.state()
    }
    /// The drone, truth; None before it appears.
    pub fn drone(&self) -> Option<RigidState<DroneBody>> {
        self.drone.as_ref().map(DroneWorld::truth)
    }
    /// Time since the landing was commanded.
    pub fn time_since_start(&self) -> Span {
        self.t - self.started
    }
    /// True time.
    pub fn now(&self) -> Time<TrueTime> {
        self.t
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
        self.digest
    }

    fn feet(&self, drone: &RigidState<DroneBody>, deck: &RigidState<Deck>) -> [[f64; 3]; 4] {
        let g = &self.scenario.airframe;
        let (x, y) = (g.feet_span_m[0] / 2.0, g.feet_span_m[1] / 2.0);
        [[x, y], [x, -y], [-x, y], [-x, -y]].map(|[x, y]| {
            let foot = drone.at::<DroneBody>(Vector3::new(x, y, g.feet_below_m)).position;
            let d = deck.attitude.inverse() * (foot - deck.position);
            [d.0.x, d.0.y, -d.0.z]
        })
    }

    /// What the judge looks at.
    pub fn observation(&self) -> Observation<'_> {
        let deck = self.deck();
        let drone = self.drone().unwrap_or_default();
        let relative = deck.attitude.inverse() * drone.attitude;
        let (roll, pitch, yaw) = relative.euler();
        let offset = drone.position.0 - deck.position.0;
        let mission = &self.mission_state;
        Observation {
            t_s: self.time_since_start().secs(),
            touches: &self.touches,
            feet: self.feet(&drone, &deck),
            relative_euler: [roll, pitch, yaw],
            tilt_error: deck
                .attitude
                .down()
                .dot(&drone.attitude.down())
                .clamp(-1.0, 1.0)
                .acos(),
            horizontal_m: offset.xy().norm(),
            motors_on: self.motors_on,
            descending: matches!(mission.state, State::Descent | State::Flare),
            attempts: mission.attempts,
            gave_up: mission.state == State::GaveUp,
            in_water: self.in_water,
        }
    }

    /// One point of a trace.
    pub fn trace_point(&self) -> TracePoint {
        let deck = self.deck();
        let drone = self.drone().unwrap_or_default();
        let feet = self.feet(&drone, &deck);
        TracePoint {
            t_s: self.time_since_start().secs(),
            drone: drone.position.0.into(),
            deck: deck.position.0.into(),
            drone_velocity: drone.velocity.0.into(),
            deck_velocity: deck.velocity.0.into(),
            drone_euler: drone.euler().into(),
            deck_euler: deck.euler().into(),
            forecast: None,
            clearance_m: feet.iter().map(|f| f[2]).fold(f64::INFINITY, f64::min),
        }
    }
}
