//! A drone's computer in lock-step: its end of the radio, its nodes in the order data flow, the wire to its autopilot.

use super::cameras::SimulatedCameras;
use super::failing::Failing;
use super::foresight::{Foresight, OdometryError};
use super::inbox::Inbox;
use super::link::Checkpoints;
use super::link::{LinkedAutopilot, MakeLink};
use super::mutant::Mutated;
use super::physics::{DRONE_ID, Physics, VESSEL_ID};
use super::scenario::{NodeConfigs, Scenario};
use super::tap::Tap;
use crate::autopilots::simulated::{SimulatedAutopilot, mode_number};
use crate::radio::{ChannelCounts, Session};
use crate::sensors::DroneReadings;
use crate::sensors::delay::DelayLine;
use crate::sensors::noise::Noise;
use alight_bridge::{Bridge, BridgeConfig, BridgeIn, BridgeOut, Packet, PacketKind};
use alight_shared::checkpoint::Keeper;
use alight_shared::frames::body_from_camera;
use alight_shared::msg::{
    AutopilotMode, AutopilotState, Command, DeckForecast, DroneState, DroneStatus, Header, MissionState,
    Plan, SetPoint, TimeRequest, VesselEstimate,
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
use nalgebra::Vector3;
use std::rc::Rc;

/// Plans under way at a time.
const MAX_PLANS: usize = 64;
/// Packets that wait for a bridge that stands still, at most.
const MAX_WAITING: usize = 4096;
/// A vessel of the same identity counts its starts from here.
const TWIN_BOOT: u32 = 1000;
/// Time between two of a drone's status messages (the bridge's process sends them so).
const STATUS_PERIOD: Span = Span::from_millis(500);

/// From a drone to the vessel.
#[derive(Clone, Debug)]
pub(super) enum Uplink {
    TimeRequest(TimeRequest<DroneClock>),
    Status(DroneStatus),
}

/// A drone's end of the radio, its computer and what it flies.
pub struct DroneComputer {
    pub(super) k: usize,
    pub(super) boot: u32,
    pub(super) radio: Session<Packet, Uplink>,
    /// None: its process is dead.
    pub(super) bridge: Option<Bridge>,
    pub(super) bridge_config: BridgeConfig,
    /// Packets that wait for a bridge that stands still.
    pub(super) waiting: Vec<Packet>,
    pub(super) cameras: Option<SimulatedCameras>,
    pub(super) make_link: MakeLink,
    /// The autopilot and the link to it; None before the drone has appeared.
    pub(super) linked: Option<LinkedAutopilot>,
    /// Its steady clock is so far ahead of what it was drawn as.
    pub(super) ahead: Span,
    /// A person has given it the mode once.
    pub(super) handed_over: bool,
    /// None: its process is dead.
    pub(super) predictor: Option<Predictor>,
    pub(super) predictor_inbox: Inbox<PredictorIn>,
    /// None: its process is dead.
    pub(super) mission: Option<Mission>,
    pub(super) mission_inbox: Inbox<MissionIn>,
    /// The supervisor's.
    pub(super) keeper: Keeper,
    /// All of its processes are dead.
    pub(super) is_dead: bool,
    /// The computer stood still until then.
    pub(super) stood_still_until: Time<TrueTime>,
    /// None: its process is dead.
    pub(super) planner: Option<Planner>,
    /// None: its process is dead.
    pub(super) pilot: Option<Pilot>,
    pub(super) pilot_inbox: Inbox<PilotIn>,
    pub(super) plans: DelayLine<Plan>,
    pub(super) solve_delay: Span,
    pub(super) commands: Vec<Command>,
    /// What a mutant remembers.
    pub(super) mutated: Mutated,
    /// A test's set-point in place of the pilot's.
    pub(super) external: Option<SetPoint>,
    /// The range that a stuck rangefinder repeats, m.
    pub(super) repeated_m: Option<f64>,
    /// Fault: images are stamped so late.
    pub(super) images_late: Span,
    /// Fault: the deck seen is so far from the vessel's, NED, m.
    pub(super) sees_beside: Vector3<f64>,
    /// When the next status is due.
    pub(super) status_due: Time<TrueTime>,
    /// When the pilot stands still.
    pub(super) pilot_outage_window: Option<[Time<TrueTime>; 2]>,
    /// The newest odometry, as the bridge's process reads it.
    pub odometry: Option<DroneState>,
    /// The mission's newest state.
    pub mission_state: MissionState,
    /// The newest forecast.
    pub forecast: Option<DeckForecast>,
    pub(super) autopilot_state: AutopilotState,
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
pub(super) fn mission_config(scenario: &Scenario, nodes: &NodeConfigs) -> MissionConfig {
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
    pub(super) fn new(
        k: usize,
        scenario: &Scenario,
        nodes: &NodeConfigs,
        physics: &Physics,
        boot: u32,
    ) -> Self {
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
            odometry: None,
            mission_state: MissionState::default(),
            forecast: None,
            autopilot_state: AutopilotState::default(),
            last_set_point: None,
        }
    }

    /// The boot of a process that starts anew, with or without the checkpoints of the ones before.
    pub(super) fn next_boot(&mut self, checkpoints: Checkpoints) -> u32 {
        if checkpoints == Checkpoints::Lost {
            self.keeper = Keeper::default();
        }
        self.boot += 1;
        self.boot
    }
    /// The drone appears in the air, flown by a person.
    pub(super) fn appear(&mut self, physics: &mut Physics) {
        physics.place_drone(self.k);
        let (streams, make) = (physics.streams().of_drone(self.k), Rc::clone(&self.make_link));
        self.linked = physics
            .autopilot(self.k)
            .map(|(config, autopilot)| LinkedAutopilot::new(config, &streams, autopilot, make, self.boot));
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

    /// The nodes in data-flow order; the set-point at last to who flies.
    pub(super) fn tick(
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
        self.odometry = odometry.or(self.odometry);
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
            autopilot,
            beacons: readings.beacons,
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
                .map(|(d, truth)| OdometryError::of(&d, now, &truth));
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
            settings: flown.settings,
            deck: received.deck,
            ranges: readings.ranges.clone(),
            light: readings.light,
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
        // The bridge's process sends it.
        let bridged = self.bridge.is_some() && !failing.frozen.bridge;
        if reports_status && bridged && t >= self.status_due {
            self.status_due = t + STATUS_PERIOD;
            let (own, forecast) = (self.odometry.as_ref(), self.forecast.as_ref());
            let distance = DroneStatus::deck_distance_m(now, own, forecast);
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
    pub(super) fn header(&self, physics: &mut Physics) -> Header<DroneClock> {
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
    /// For so long the drone is armed on the deck without an order, as its status has it at `now`, s.
    fn still_armed_at(&self, now: Time<DroneClock>) -> Option<f64> {
        let armed = self.autopilot_state.armed;
        still_armed_s(now, &self.mission_state, armed, &DisarmConfig::default())
    }
    /// The same when the mission last published.
    pub fn still_armed_s(&self) -> Option<f64> {
        self.still_armed_at(self.mission_state.header.at)
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
        DroneStatus {
            still_armed_s: self.still_armed_at(header.at).map(|s| s as f32),
            ..DroneStatus::of(header, mission, Some(autopilot), deck_distance_m)
        }
    }
}
