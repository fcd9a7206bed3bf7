//! The simulated world without any of Alight's nodes: sea, vessel, drone with its autopilot, the
//! sensors of both. The lock-step [`crate::harness::world::World`] and the process of the simulated
//! vehicles share it.

pub mod body;
pub mod deck_motion;
pub mod drone;
pub mod sea;
pub mod streams;
pub mod vessel;
use alight_shared::config::{Check, Keys};
use alight_shared::frames::{Deck, DroneBody, Point, Rotation, Vector, VesselBody, wrap_angle};
use alight_shared::msg::{AutopilotState, DroneState, Header, MissionState, SetPoint, State};
use alight_shared::time::{DroneClock, Span, Time, TrueTime, VesselClock};
use nalgebra::{UnitQuaternion, Vector3};

use crate::harness::outcome::{ContactEvent, Observation};
use crate::harness::scenario::Scenario;
use crate::harness::trace::TracePoint;
use crate::harness::trial::SetupError;
use crate::physics::body::RigidState;
use crate::physics::deck_motion::DeckCarrier;
use crate::physics::drone::{DroneStart, Part, ROTORS, SimulatedDrone, StepReport};
use crate::physics::sea::Sea;
use crate::physics::streams::Streams;
use crate::sensors::clocks::Clocks;
use crate::sensors::noise::Noise;
use crate::sensors::{DroneReadings, Sensors, VesselReadings};

/// The world's tick.
pub const TICK: Span = Span::from_millis(10);
/// The autopilot tells its state every so many ticks.
const AUTOPILOT_TICKS: u64 = 10;
/// A firmware and the drone under it exchange this often in a tick, if it wants no other rate: 400 Hz.
pub const EXCHANGES_PER_TICK: u32 = 4;
/// Identity of the simulated vessel.
pub const VESSEL_ID: u32 = 1;
/// Identity of the simulated drone.
pub const DRONE_ID: u32 = 1;
/// Boot id of the simulated vehicles' own computers.
pub const BOOT: u32 = 1;
/// A contact further below the deck's surface than this is with its side, m.
const BELOW_SURFACE_M: f64 = 0.05;

/// What autopilot, camera and rangefinder of the drone say in one tick.
#[derive(Clone, Debug)]
pub struct DroneMeasurements {
    /// The autopilot's odometry.
    pub odometry: DroneState,
    /// The autopilot's state, when due.
    pub autopilot: Option<AutopilotState>,
    /// Camera and rangefinder.
    pub readings: DroneReadings,
}

/// What the sensors of a firmware are moved by, truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlantState {
    /// When.
    pub at: Time<TrueTime>,
    /// Centre of mass, NED, m.
    pub position: Vector3<f64>,
    /// NED, m/s.
    pub velocity: Vector3<f64>,
    /// NED from body.
    pub attitude: UnitQuaternion<f64>,
    /// Body, rad/s.
    pub rates: Vector3<f64>,
    /// Body, m/s².
    pub specific_force: Vector3<f64>,
}

impl PlantState {
    fn of(drone: &SimulatedDrone, at: Time<TrueTime>) -> PlantState {
        let truth = drone.truth();
        PlantState {
            at,
            position: truth.position.0,
            velocity: truth.velocity.0,
            attitude: truth.attitude.0,
            rates: truth.rates.0,
            specific_force: drone.specific_force(),
        }
    }
}

/// The deck a share `s` of a tick after `a`: cubic in position, turned at a constant rate.
fn between(a: &RigidState<Deck>, b: &RigidState<Deck>, s: f64) -> RigidState<Deck> {
    let h = TICK.secs();
    let (p, q) = (a.position.0, b.position.0);
    let (v, w) = (a.velocity.0 * h, b.velocity.0 * h);
    let (c2, c3) = ((q - p) * 3.0 - v * 2.0 - w, (p - q) * 2.0 + v + w);
    RigidState {
        position: Point::from(p + (v + (c2 + c3 * s) * s) * s),
        velocity: Vector::from((v + (c2 * 2.0 + c3 * (3.0 * s)) * s) / h),
        attitude: Rotation::from(a.attitude.0.slerp(&b.attitude.0, s)),
        ..*a
    }
}

/// Truth, and what measures it.
pub struct Physics {
    t: Time<TrueTime>,
    ticks: u64,
    started: Time<TrueTime>,
    sea: Sea,
    carrier: DeckCarrier,
    drone: Option<SimulatedDrone>,
    sensors: Sensors,
    sequence: u32,
    scenario: Scenario,
    streams: Streams,
    contacts: Vec<ContactEvent>,
    in_water: bool,
    motors_on: bool,
    digest: u64,
}

impl Physics {
    /// The truth of `seed` before the warm-up.
    pub fn new(scenario: &Scenario, seed: u64) -> Result<Physics, SetupError> {
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
        Ok(Physics {
            t: Time::EPOCH,
            ticks: 0,
            started: Time::EPOCH + Span::from_secs(scenario.start.warm_up_s),
            carrier,
            drone: None,
            sensors: Sensors::new(&scenario.sensors, &scenario.airframe, &scenario.deck, &streams),
            sequence: 0,
            scenario: scenario.clone(),
            streams,
            sea,
            contacts: Vec::new(),
            in_water: false,
            motors_on: true,
            digest: 0xcbf2_9ce4_8422_2325,
        })
    }

    /// The drone appears in the air, at the scenario's place.
    pub fn place_drone(&mut self) {
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
        self.drone = Some(SimulatedDrone::new(
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

    /// When the drone appears.
    pub fn hover_from(&self) -> Time<TrueTime> {
        self.started - Span::from_secs(self.scenario.start.hover_s)
    }
    /// When the landing is commanded.
    pub fn started(&self) -> Time<TrueTime> {
        self.started
    }

    /// The vessel's sensors, now.
    pub fn vessel_readings(&mut self) -> VesselReadings {
        self.sensors.vessel(self.t, &self.carrier.state())
    }

    /// What the drone's instruments say now; None before it is in the air.
    pub fn drone_measurements(&mut self) -> Option<DroneMeasurements> {
        self.drone.as_ref()?;
        let header = Header::new(VESSEL_ID, DRONE_ID, BOOT, self.next_sequence(), self.drone_now());
        let deck = self.deck();
        let t = self.t;
        let drone = self.drone.as_ref()?;
        let odometry = drone.odometry(header);
        let autopilot = self
            .ticks
            .is_multiple_of(AUTOPILOT_TICKS)
            .then(|| drone.autopilot_state(header));
        let sea = &self.sea;
        let readings = self.sensors.drone(t, &drone.truth(), &deck, |north, east| {
            sea.surface(t, north, east).surface_z()
        });
        Some(DroneMeasurements {
            odometry,
            autopilot,
            readings,
        })
    }

    /// The autopilot takes a set-point.
    pub fn apply(&mut self, set_point: &SetPoint) {
        let Some(drone) = self.drone.as_mut() else { return };
        drone.apply(set_point);
        self.hash(&set_point.attitude);
        self.hash(&[set_point.thrust, set_point.position[0], set_point.position[2]]);
    }

    /// The drone stands on a pad where the scenario places it, to be flown by a firmware.
    pub fn place_drone_on_pad(&mut self) {
        self.place_drone();
        if let Some(drone) = &mut self.drone {
            drone.stand();
        }
    }

    /// Vessel, autopilot, drone and contact move on by one tick.
    pub fn advance(&mut self) {
        let t = self.t;
        self.integrate(|drone, before, after, water_z| {
            vec![drone.step(t.secs(), TICK.secs(), before, after, water_z)]
        });
    }

    /// The same with the drone under a firmware, in so many slices ([`EXCHANGES_PER_TICK`]), one at least: `fly` tells
    /// it what the drone feels at the beginning of each and gives its motors, as shares of a rotor's
    /// greatest thrust; None with all off.
    pub fn advance_with_firmware(
        &mut self,
        exchanges: u32,
        mut fly: impl FnMut(&PlantState) -> Option<[f64; ROTORS]>,
    ) {
        let t = self.t;
        let exchanges = exchanges.max(1);
        self.integrate(|drone, before, after, water_z| {
            let length = TICK / i64::from(exchanges);
            (0..exchanges)
                .map(|k| {
                    let at = t + length * i64::from(k);
                    let motors = fly(&PlantState::of(drone, at));
                    let fraction = |k: u32| f64::from(k) / f64::from(exchanges);
                    let deck = [fraction(k), fraction(k + 1)].map(|s| between(before, after, s));
                    let motors = motors.as_ref();
                    drone.step_with_motors(at.secs(), length.secs(), [&deck[0], &deck[1]], water_z, motors)
                })
                .collect()
        });
    }

    fn integrate(
        &mut self,
        step: impl FnOnce(&mut SimulatedDrone, &RigidState<Deck>, &RigidState<Deck>, f64) -> Vec<StepReport>,
    ) {
        let t = self.t;
        let dt_s = TICK.secs();
        let before = self.deck();
        self.carrier.step(t, dt_s, &self.sea);
        self.contacts.clear();
        if let Some(mut drone) = self.drone.take() {
            let after = self.deck();
            let at = drone.truth().position.0;
            let water_z = self.sea.surface(t, at.x, at.y).surface_z();
            for report in step(&mut drone, &before, &after, water_z) {
                self.in_water |= report.in_water;
                self.motors_on = report.armed;
                self.contacts.extend(report.impacts.iter().map(|i| ContactEvent {
                    foot: matches!(i.part, Part::Foot(_)),
                    on_deck: i.position.0.z < BELOW_SURFACE_M,
                    normal_mps: i.normal_mps,
                    tangential_mps: i.tangential_mps,
                }));
            }
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

    fn hash(&mut self, values: &[f64]) {
        for v in values {
            self.digest = (self.digest ^ v.to_bits())
                .wrapping_mul(0x0000_0100_0000_01b3)
                .rotate_left(17);
        }
    }

    /// Counts the messages of the drone's own computer and of its operator.
    pub fn next_sequence(&mut self) -> u32 {
        self.sequence += 1;
        self.sequence
    }
    /// True time.
    pub fn now(&self) -> Time<TrueTime> {
        self.t
    }
    /// The two computers' clocks (truth).
    pub fn clocks(&self) -> &Clocks {
        &self.sensors.clocks
    }
    /// What the vessel's clock reads.
    pub fn vessel_now(&self) -> Time<VesselClock> {
        self.sensors.clocks.vessel_time(self.t)
    }
    /// What the drone's clock reads.
    pub fn drone_now(&self) -> Time<DroneClock> {
        self.sensors.clocks.drone_time(self.t)
    }
    /// The named random streams of this seed.
    pub fn streams(&self) -> &Streams {
        &self.streams
    }
    /// Time since the landing was commanded.
    pub fn time_since_start(&self) -> Span {
        self.t - self.started
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
        self.drone.as_ref().map(SimulatedDrone::truth)
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

    /// What the judge looks at, beside the mission's newest state.
    pub fn observation(&self, mission: &MissionState) -> Observation<'_> {
        let deck = self.deck();
        let drone = self.drone().unwrap_or_default();
        let relative = deck.attitude.inverse() * drone.attitude;
        let (roll, pitch, yaw) = relative.euler();
        let offset = drone.position.0 - deck.position.0;
        Observation {
            t_s: self.time_since_start().secs(),
            contacts: &self.contacts,
            feet: self.feet(&drone, &deck),
            relative_euler: [roll, pitch, yaw],
            tilt_error: deck
                .attitude
                .down()
                .dot(&drone.attitude.down())
                .clamp(-1.0, 1.0)
                .acos(),
            horizontal_m: offset.xy().norm(),
            // Motors that were never started were not stopped.
            motors_on: self.motors_on || self.drone.as_ref().is_some_and(SimulatedDrone::on_pad),
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
