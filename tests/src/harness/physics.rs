//! The simulated world without Alight's nodes: sea, vessel and drones with their sensors. It is shared by
//! [`super::world::World`] and the process that simulates vehicles in live flights.
//!
//! Drones make contact only with the nearest deck and the water. Overlapping drones count
//! as a collision, and entries into keep-out volumes are judged; neither stops a flight.

mod neighbour;

use core::f64::consts::TAU;

use alight_shared::{
    config::{Check, Keys},
    frames::{Deck, DroneBody, TrueNed, Vector, VesselBody, wrap_angle},
    geodesy::Datum,
    msg::{Header, MissionState, Seq, State},
    surroundings::{KeepOut, MAX_KEEP_OUT},
    time::{DroneClock, DroneTime, Span, Time, VesselTime, WorldTime},
};
use alight_usv::sensors::Readings;
use nalgebra::Vector3;

use self::neighbour::Neighbour;
use super::{
    outcome::{ContactEvent, TrialObservation},
    scenario::{Scenario, SetupError},
    trace::TracePoint,
};
use crate::{
    autopilots::simulated::SimulatedAutopilot,
    physics::{
        body::RigidState,
        deck_motion::DeckCarrier,
        drone::{AutopilotConfig, DroneStart, MAX_ROTORS, Part, PlantState, SimulatedDrone, wind_to_deg},
        sea::Sea,
        streams::Streams,
        vessel::response::{HullFiles, ResponseVessel},
    },
    sensors::{
        DroneReadings, DroneSensors, VesselSensors,
        clocks::{ClockModel, Clocks},
        moving_base::MovingBaseFaults,
        noise::Noise,
        outlet::SenderIdentity,
    },
};

pub const TICK: Span = Span::from_millis(10);
pub const VESSEL_ID: u32 = 1;
/// Identity of the first drone; further drones have consecutive numbers.
pub const DRONE_ID: u32 = 1;
pub const BOOT: u32 = 1;
/// Depth below the deck's surface from which a contact is with the deck's side, m.
const BELOW_SURFACE_M: f64 = 0.05;

/// One drone; it has no body before it appears.
struct Plant {
    identity: SenderIdentity,
    streams: Streams,
    sensors: DroneSensors,
    drone: Option<SimulatedDrone>,
    /// Origin of the autopilot's NED.
    origin: Datum,
    sequence: u32,
    contacts: Vec<ContactEvent>,
    in_water: bool,
    motors_on: bool,
    /// Whether the drone overlaps another, and the number of overlaps so far.
    touches_drone: bool,
    collisions: u32,
}

impl Plant {
    fn new(k: usize, scenario: &Scenario, place: Option<Datum>, streams: &Streams) -> Plant {
        let streams = streams.of_drone(k);
        let identity = SenderIdentity {
            vessel: VESSEL_ID,
            drone: DRONE_ID + k as u32,
            boot: BOOT,
            clock: Clocks::new(&scenario.sensors.clocks, &streams).drone,
        };
        let drone = &scenario.airframe;
        let deck = &scenario.deck;
        Plant {
            identity,
            sensors: DroneSensors::new(&scenario.sensors, drone, deck, place, identity, &streams),
            streams,
            drone: None,
            origin: Datum::default(),
            sequence: 0,
            contacts: Vec::new(),
            in_water: false,
            motors_on: true,
            touches_drone: false,
            collisions: 0,
        }
    }
    fn header(&mut self, t: WorldTime) -> Header<DroneClock> {
        self.sequence += 1;
        self.identity.header(self.sequence, t)
    }
    /// Advances by a tick from `t`. The vessel's deck moves from `own[0]` to `own[1]`, a neighbouring boat's
    /// deck likewise; contact is with the nearer of the two.
    fn advance(
        &mut self,
        t: WorldTime,
        exchanges: u32,
        own: &[RigidState<Deck>; 2],
        other: Option<&[RigidState<Deck>; 2]>,
        water: impl Fn(f64, f64) -> f64,
        motors: impl FnMut(&PlantState) -> Option<[f64; MAX_ROTORS]>,
    ) {
        self.contacts.clear();
        let Some(drone) = &mut self.drone else { return };
        let at = drone.truth().position.0;
        let apart = |d: &[RigidState<Deck>; 2]| (at - d[0].position.0).xy().norm();
        let other = other.filter(|other| apart(other) < apart(own));
        let deck = other.unwrap_or(own);
        let water_z = water(at.x, at.y);
        let reports = drone.step(t, TICK, deck, water_z, exchanges.max(1), motors);
        for report in reports {
            self.in_water |= report.in_water;
            self.motors_on = report.armed;
            self.contacts.extend(report.impacts.iter().map(|i| ContactEvent {
                foot: matches!(i.part, Part::Foot(_)),
                on_deck: other.is_none() && i.position.0.z < BELOW_SURFACE_M,
                normal_mps: i.normal_mps,
                tangential_mps: i.tangential_mps,
            }));
        }
    }
    fn truth(&self) -> Option<RigidState<DroneBody>> {
        self.drone.as_ref().map(SimulatedDrone::truth)
    }
}

/// Truth and sensors. Drones are numbered from 0; methods return None for an unknown drone.
pub struct Physics {
    t: WorldTime,
    started: WorldTime,
    sea: Sea,
    carrier: DeckCarrier,
    neighbour: Option<Neighbour>,
    /// Origin of the true NED; None: it coincides with the origins of vessel and drones.
    place: Option<Datum>,
    vessel_clock: ClockModel,
    vessel_sensors: VesselSensors,
    drones: Vec<Plant>,
    keep_out: Seq<KeepOut, MAX_KEEP_OUT>,
    scenario: Scenario,
    streams: Streams,
    digest: u64,
}

impl Physics {
    /// The true state before the warm-up.
    pub fn new(scenario: &Scenario, seed: impl Into<Streams>) -> Result<Physics, SetupError> {
        Physics::from_streams(scenario, seed.into())
    }
    fn from_streams(scenario: &Scenario, streams: Streams) -> Result<Physics, SetupError> {
        scenario.check(&Keys::ROOT)?;
        let scenario = &scenario.drawn(streams);
        let (sea, carrier) = match &scenario.hull {
            Some(hull) => {
                let sea = Sea::linear(&scenario.sea, &streams);
                let files = HullFiles::load(&hull.table)?;
                let vessel = ResponseVessel::new(&files, hull, &scenario.vessel, &sea, &streams);
                (sea, DeckCarrier::Responding(Box::new(vessel)))
            }
            None => {
                let sea = Sea::new(&scenario.sea, &streams);
                let motion = scenario.deck_motion.as_ref();
                let carrier = DeckCarrier::new(&scenario.vessel, motion, &scenario.deck, &sea, &streams)?;
                (sea, carrier)
            }
        };
        let neighbour = Neighbour::new(scenario, &sea, &streams)?;
        let place = scenario.place.drawn(&streams);
        let vessel_clock = Clocks::new(&scenario.sensors.clocks, &streams).vessel;
        let identity = SenderIdentity {
            vessel: VESSEL_ID,
            drone: 0,
            boot: BOOT,
            clock: vessel_clock,
        };
        Ok(Physics {
            t: Time::EPOCH,
            started: Time::EPOCH + Span::from_secs(scenario.start.warm_up_s),
            sea,
            carrier,
            neighbour,
            place,
            vessel_clock,
            vessel_sensors: VesselSensors::new(&scenario.sensors, place, identity, &streams),
            drones: (0..scenario.drones as usize)
                .map(|k| Plant::new(k, scenario, place, &streams))
                .collect(),
            keep_out: KeepOut::all(&scenario.keep_out_m, &scenario.deck),
            scenario: scenario.clone(),
            streams,
            digest: 0xcbf2_9ce4_8422_2325,
        })
    }

    pub fn place_drone(&mut self, k: usize) {
        let Some(plant) = self.drones.get_mut(k) else {
            return;
        };
        let start = &self.scenario.start;
        let mut draw = Noise::new(&plant.streams, "drone.start");
        let mut between = |[low, high]: [f64; 2]| low + (high - low) * draw.uniform();
        let distance = between(start.distance_m);
        let height = between(start.height_m);
        let bearing = between([0.0, TAU]);
        let yaw = wrap_angle(between([0.0, TAU]));
        let vessel = self.carrier.state().position.0;
        let position = Vector3::new(
            vessel.x + distance * bearing.cos(),
            vessel.y + distance * bearing.sin(),
            -height,
        );
        if let Some(place) = &self.place {
            let c = &self.scenario.place;
            let mut draw = Noise::new(&plant.streams, "drone.origin");
            let mut between = |[low, high]: [f64; 2]| low + (high - low) * draw.uniform();
            let distance = between(c.origin_m);
            let height = between(c.origin_height_m);
            let (south, west) = between([0.0, TAU]).sin_cos();
            let from = Vector::<TrueNed>::new(
                position.x - distance * south,
                position.y - distance * west,
                -height,
            );
            plant.origin = place.at(&from);
        }
        let mut config = self.scenario.drone.clone();
        if config.wind.with_waves {
            config.wind.to_deg = Some(self.sea.mean_direction().to_degrees());
        }
        if k > 0 {
            // All drones have the same mean wind.
            let to_deg = wind_to_deg(&self.streams);
            config.wind.to_deg.get_or_insert(to_deg);
        }
        let drone = &self.scenario.airframe;
        let deck = &self.scenario.deck;
        let start = DroneStart { position, yaw };
        plant.drone = Some(SimulatedDrone::new(
            &config,
            drone,
            deck,
            self.keep_out,
            &plant.streams,
            start,
        ));
        plant.in_water = false;
        plant.motors_on = true;
        if self.scenario.start.on_deck {
            let deck = self.deck();
            if let Some(drone) = self.drones.get_mut(k).and_then(|p| p.drone.as_mut()) {
                drone.stand_on(&deck, yaw);
            }
        }
    }
    /// Holds a foot to the deck with this force, N, as a strap or net does.
    pub fn snag(&mut self, k: usize, foot: usize, newton: f64) {
        if let Some(drone) = self.drones.get_mut(k).and_then(|p| p.drone.as_mut()) {
            drone.snag(foot, newton);
        }
    }
    pub fn place_drone_on_pad(&mut self, k: usize) {
        self.place_drone(k);
        self.stand_on_pad(k);
    }
    pub fn stand_on_pad(&mut self, k: usize) {
        if let Some(drone) = self.drones.get_mut(k).and_then(|p| p.drone.as_mut()) {
            drone.stand();
        }
    }
    pub fn autopilot(&self, k: usize) -> Option<(&AutopilotConfig, SimulatedAutopilot)> {
        let plant = self.drones.get(k)?;
        let drone = plant.drone.as_ref()?;
        let c = &self.scenario.drone;
        let state = drone.plant_state(self.t);
        let hover = drone.hover_thrust();
        let geometry = &self.scenario.airframe;
        let mut autopilot = SimulatedAutopilot::new(
            &c.autopilot,
            &c.navigation,
            geometry,
            &plant.streams,
            &state,
            hover,
        );
        autopilot.set_frame(geometry, c.airframe.frame);
        let rangefinder = &self.scenario.sensors.rangefinder;
        autopilot.range_limits_m = [rangefinder.min_range_m, rangefinder.max_range_m];
        autopilot.start(&plant.streams);
        if let Some(place) = self.place {
            autopilot.begin_at(place, plant.origin, place.height_m);
        }
        Some((&c.autopilot, autopilot))
    }

    pub fn vessel_readings(&mut self) -> Readings {
        self.vessel_sensors.step(self.t, &self.carrier.state())
    }
    pub fn vessel_rtcm(&mut self) -> Vec<u8> {
        self.vessel_sensors.rtcm(self.t)
    }
    /// Passes complete frames from the moving base to the drone's receiver.
    pub fn receive_rtcm(&mut self, k: usize, bytes: &[u8]) {
        let t = self.t;
        let plant = self.drones.get_mut(k).into_iter();
        for p in plant {
            p.sensors.receive_rtcm(t, bytes);
        }
    }
    pub fn fail_moving_base(&mut self, faults: MovingBaseFaults) {
        let first = self.drones.first_mut().into_iter();
        for p in first {
            p.sensors.fail_moving_base(faults);
        }
    }
    pub fn drone_readings(&mut self, k: usize) -> Option<DroneReadings> {
        let t = self.t;
        let deck = self.deck();
        let sea = &self.sea;
        let lift = self.carrier.water_lift();
        let neighbour = self.neighbour_deck();
        let plant = self.drones.get_mut(k)?;
        let truth = plant.truth()?;
        plant.sensors.show(neighbour);
        Some(plant.sensors.step(t, &truth, &deck, |north, east| {
            sea.surface(t, north, east).surface_z() - lift
        }))
    }

    /// Changes the vessel's course or speed after a random time, if the scenario has such a change. The
    /// helmsman does not know about the drone, so the nodes receive no notice.
    pub fn ask_change(&mut self) {
        self.carrier.ask_change(self.t);
    }
    /// Applies a force and moment to the vessel, N and Nm ([`DeckCarrier::push`]).
    pub fn push(&mut self, by_n_nm: [f64; 6]) {
        self.carrier.push(by_n_nm);
    }
    /// Advances one tick with the drones' motors off.
    pub fn advance(&mut self) {
        self.advance_with(1, |_, _| None);
    }
    /// Advances one tick. `motors` is called several times per tick with each drone's number and state, and
    /// returns rotor commands as fractions of the maximum thrust; None: motors off.
    pub fn advance_with(
        &mut self,
        exchanges: u32,
        mut motors: impl FnMut(usize, &PlantState) -> Option<[f64; MAX_ROTORS]>,
    ) {
        let t = self.t;
        let before = self.deck();
        let lift = self.carrier.water_lift();
        let other_before = self.neighbour_deck();
        self.carrier.step(t, TICK.secs(), &self.sea);
        if let Some(n) = &mut self.neighbour {
            n.step(t, TICK);
        }
        let deck = [before, self.deck()];
        let other = other_before.zip(self.neighbour_deck()).map(|(a, b)| [a, b]);
        for k in 0..self.drones.len() {
            let Some(plant) = self.drones.get_mut(k) else {
                continue;
            };
            let sea = &self.sea;
            let water = |north: f64, east: f64| sea.surface(t, north, east).surface_z() - lift;
            plant.advance(t, exchanges, &deck, other.as_ref(), water, |state| {
                motors(k, state)
            });
            if let Some(truth) = plant.truth() {
                self.hash(truth.position.0.as_slice());
                self.hash(truth.attitude.0.coords.as_slice());
            }
        }
        self.collide();
        self.hash(self.carrier.state().position.0.as_slice());
        self.t += TICK;
    }

    /// Counts new overlaps between drones, modelled as spheres that enclose rotors and arms.
    fn collide(&mut self) {
        let scenario = &self.scenario;
        let span_m = 2.0 * (scenario.airframe.arm_m + scenario.drone.airframe.rotor_radius_m);
        let places: Vec<_> = self
            .drones
            .iter()
            .map(|p| p.truth().map(|t| t.position.0))
            .collect();
        for (k, plant) in self.drones.iter_mut().enumerate() {
            let meets = |other: usize, at: &Vector3<f64>| {
                let own = places.get(k).copied().flatten();
                other != k && own.is_some_and(|own| (own - at).norm() < span_m)
            };
            let others = places.iter().enumerate();
            let touches = others
                .filter_map(|(i, at)| Some((i, at.as_ref()?)))
                .any(|(i, at)| meets(i, at));
            plant.collisions += u32::from(touches && !plant.touches_drone);
            plant.touches_drone = touches;
        }
    }

    fn hash(&mut self, values: &[f64]) {
        for v in values {
            self.digest = (self.digest ^ v.to_bits())
                .wrapping_mul(0x0000_0100_0000_01b3)
                .rotate_left(17);
        }
    }

    pub fn header(&mut self, k: usize) -> Header<DroneClock> {
        let t = self.t;
        self.drones.get_mut(k).map(|p| p.header(t)).unwrap_or_default()
    }
    /// Time at which the drones appear.
    pub fn hover_from(&self) -> WorldTime {
        self.started - Span::from_secs(self.scenario.start.hover_s)
    }
    pub fn started(&self) -> WorldTime {
        self.started
    }
    /// Time since the command to land.
    pub fn time_since_start(&self) -> Span {
        self.t - self.started
    }
    pub fn starts_on_deck(&self) -> bool {
        self.scenario.start.on_deck
    }
    pub fn now(&self) -> WorldTime {
        self.t
    }
    pub fn vessel_clock(&self) -> ClockModel {
        self.vessel_clock
    }
    pub fn vessel_now(&self) -> VesselTime {
        self.vessel_clock.read(self.t)
    }
    pub fn drone_clock(&self, k: usize) -> ClockModel {
        self.drones.get(k).map_or(self.vessel_clock, |p| p.identity.clock)
    }
    pub fn drone_now(&self, k: usize) -> DroneTime {
        self.drone_clock(k).read(self.t)
    }
    pub fn streams(&self) -> &Streams {
        &self.streams
    }
    pub fn sea(&self) -> &Sea {
        &self.sea
    }
    /// Current displacement of the vessel's NED plane by its GNSS error, m.
    pub fn vessel_gnss_bias(&self) -> Vector3<f64> {
        self.vessel_sensors.gnss_bias()
    }
    /// Origin of the true NED; None: it coincides with the origins of vessel and drones.
    pub fn place(&self) -> Option<Datum> {
        self.place
    }
    pub fn deck_distance_m(&self, k: usize) -> f64 {
        let apart = self.drone(k).map(|d| d.position - self.deck().position);
        apart.map_or(f64::INFINITY, |apart| apart.norm())
    }
    pub fn deck(&self) -> RigidState<Deck> {
        self.carrier.state().at(self.scenario.deck.centre())
    }
    /// Deck of a neighbouring boat with the same tags.
    pub fn neighbour_deck(&self) -> Option<RigidState<Deck>> {
        let n = self.neighbour.as_ref()?;
        Some(n.deck(&self.deck(), &self.scenario))
    }
    pub fn vessel(&self) -> RigidState<VesselBody> {
        self.carrier.state()
    }
    pub fn drone(&self, k: usize) -> Option<RigidState<DroneBody>> {
        self.drones.get(k).and_then(Plant::truth)
    }
    /// State of a drone, and wind on it (NED, direction towards which it blows, m/s); None before it appears.
    pub fn drone_in_wind(&self, k: usize) -> Option<(RigidState<DroneBody>, Vector3<f64>)> {
        let drone = self.drones.get(k)?.drone.as_ref()?;
        Some((drone.truth(), drone.wind()))
    }
    pub fn collisions(&self) -> u32 {
        self.drones.iter().map(|p| p.collisions).sum::<u32>().div_ceil(2)
    }
    /// Hash of all true states so far.
    pub fn digest(&self) -> u64 {
        self.digest
    }

    /// Distance from a drone's body to the nearest keep-out volume, m; negative inside, None without volumes.
    fn keep_out_gap_m(&self, drone: &RigidState<DroneBody>, deck: &RigidState<Deck>) -> Option<f64> {
        let place = (deck.attitude.inverse() * (drone.position - deck.position)).0;
        let body = self.scenario.airframe.body_radius_m();
        let gaps = self.keep_out.iter().map(|v| v.distance(&place) - body);
        gaps.min_by(f64::total_cmp)
    }

    fn feet(&self, drone: &RigidState<DroneBody>, deck: &RigidState<Deck>) -> [[f64; 3]; 4] {
        let g = &self.scenario.airframe;
        let x = g.feet_span_m[0] / 2.0;
        let y = g.feet_span_m[1] / 2.0;
        [[x, y], [x, -y], [-x, y], [-x, -y]].map(|[x, y]| {
            let foot = drone.at::<DroneBody>(Vector3::new(x, y, g.feet_below_m)).position;
            let d = deck.attitude.inverse() * (foot - deck.position);
            [d.0.x, d.0.y, -d.0.z]
        })
    }

    pub fn touches(&self, k: usize) -> bool {
        self.drones.get(k).is_some_and(|p| !p.contacts.is_empty())
    }
    /// Input of the judge; `mission` is the drone's newest mission state.
    pub fn observation(&self, k: usize, mission: &MissionState) -> TrialObservation<'_> {
        let deck = self.deck();
        let drone = self.drone(k).unwrap_or_default();
        let plant = self.drones.get(k);
        let (roll, pitch, yaw) = (deck.attitude.inverse() * drone.attitude).euler();
        let cos_tilt = deck.attitude.down().dot(&drone.attitude.down());
        TrialObservation {
            t_s: self.time_since_start().secs(),
            contacts: plant.map_or(&[], |p| &p.contacts),
            feet: self.feet(&drone, &deck),
            relative_euler: [roll, pitch, yaw],
            tilt_error: cos_tilt.clamp(-1.0, 1.0).acos(),
            horizontal_m: (drone.position.0 - deck.position.0).xy().norm(),
            // Motors that have never started do not count as stopped.
            motors_on: plant
                .is_none_or(|p| p.motors_on || p.drone.as_ref().is_some_and(SimulatedDrone::on_pad)),
            descending: matches!(mission.state, State::Descent | State::Flare),
            attempts: mission.attempts,
            gave_up: mission.state == State::GaveUp,
            waiting: mission.waiting,
            in_water: plant.is_some_and(|p| p.in_water),
            capsized: deck.attitude.down().0.z < 0.0,
            keep_out_gap_m: self.keep_out_gap_m(&drone, &deck),
            collisions: plant.map_or(0, |p| p.collisions),
        }
    }

    pub fn trace_point(&self, k: usize) -> TracePoint {
        let deck = self.deck();
        let drone = self.drone(k).unwrap_or_default();
        let feet = self.feet(&drone, &deck);
        let (roll, pitch, yaw) = (deck.attitude.inverse() * drone.attitude).euler();
        TracePoint {
            t_s: self.time_since_start().secs(),
            drone: drone.position.0.into(),
            deck: deck.position.0.into(),
            drone_velocity: drone.velocity.0.into(),
            deck_velocity: deck.velocity.0.into(),
            deck_yaw: deck.euler().z,
            displacement: core::array::from_fn(|axis| feet.iter().map(|f| f[axis]).sum::<f64>() / 4.0),
            relative_euler: [roll, pitch, yaw],
        }
    }
}
