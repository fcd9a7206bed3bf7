//! The vessel's computer: its rows, and [`VesselComputer`], the nodes of the second one in the order of their data. The simulated
//! world and the processes step these.

use alight_shared::admission::{Arrival, RejectionReason, Rejections, Sender};
use alight_shared::bus::{computer, wiring};
use alight_shared::frames::wrap_angle;
use alight_shared::mavlink::Signing;
use alight_shared::msg::{
    CommandReceipt, CrewOrder, DeckGrant, DeckOrder, DroneStatus, FollowsAnother, MAX_ORDERS, MAX_SOURCES,
    OperatorCommand, RtcmFrames, SensorReadings, Seq, TimeRequest,
};
use alight_shared::node::Node;
use alight_shared::process::ProcessKind;
use alight_shared::time::{DroneClock, Span, Time, VesselClock};
use serde::{Deserialize, Serialize};

mod crew;
mod event;

pub use event::VesselEvent;

use crate::VesselNodeConfig;
use crate::advice::{Advice, CourseOutlook, HEADING_STEP_RAD};
use crate::deck::{
    ArbiterIn, DeckArbiter, DeckCheckpoint, DeckConfig, DeckInputs, DroneMonitor, GivenCommand, OperatorIn,
    OperatorRelay,
};
use crate::followed::Followed;
use crate::helm::{BoatMotion, BoatPlace, Goal, HelmCheckpoint, HelmIn, HelmNode};
use crate::node::{IMU, VesselIn, VesselNode, VesselOut};
use crate::rtcm_relay::RtcmRelay;
use crate::sensors::{Readings, SensorNode};
use crew::CrewOrders;

/// Advice counts for so long: it comes with each wave model, the slowest of which are a third of this apart.
const ADVICE_FRESH: Span = Span::from_millis(30_000);

/// Input that arrived since the last step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ComputerIn {
    /// Measurements of the sensors' process.
    pub sensors: Vec<SensorReadings>,
    /// Orders of the crew.
    pub crew: Vec<CrewOrder>,
    /// Frames of the sensors' process, of a moving base.
    pub rtcm: Vec<RtcmFrames<VesselClock>>,
    /// Time requests.
    pub time_requests: Vec<Arrival<VesselClock, TimeRequest<DroneClock>>>,
    /// Statuses of drones.
    pub statuses: Vec<Arrival<VesselClock, DroneStatus>>,
    /// Commands of operators whose certificates were accepted.
    pub commands: Vec<Arrival<VesselClock, OperatorCommand<VesselClock>>>,
    /// Digital inputs.
    pub deck_inputs: DeckInputs,
    /// Bytes of the boat's autopilot; None: its link is not open.
    pub helm: Option<Vec<u8>>,
    /// At the first step, what the former start left.
    pub checkpoint: Option<VesselCheckpoint>,
    /// The process is asked to end.
    pub ends: bool,
}

impl ComputerIn {
    /// The estimator's part of the input.
    pub fn vessel(&self) -> VesselIn {
        VesselIn {
            readings: Readings::of(&self.sensors),
            time_requests: self.time_requests.clone(),
        }
    }
}

/// Output of the vessel's process, with the events for the crew.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ComputerOut {
    /// Estimate, models and time replies.
    pub vessel: VesselOut,
    /// The owner of the deck, when due.
    pub grant: Option<DeckGrant<VesselClock>>,
    /// Commands for the drones that their headers name.
    pub commands: Vec<OperatorCommand<VesselClock>>,
    /// Progress of operators' commands.
    pub receipts: Vec<CommandReceipt>,
    /// Statuses of drones, for operators.
    pub statuses: Vec<DroneStatus>,
    /// Frames of a moving base, for the drones' receivers.
    pub rtcm: Vec<RtcmFrames<VesselClock>>,
    /// Events of this step.
    pub events: Vec<VesselEvent>,
    /// The lamp at the helm.
    pub lamp: Lamp,
    /// Bytes for the boat's autopilot.
    pub helm: Vec<u8>,
}

/// The lamp at the helm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Lamp {
    /// Nothing is wanted of the helm.
    #[default]
    Out,
    /// A drone wants the vessel to keep course and speed.
    Lit,
    /// The skipper is asked whether the computer may steer.
    Blinks,
}

wiring! {
    /// Topics that the vessel's process reads; its output goes by radio and to people.
    VesselPorts of VesselComputer: ComputerIn => ComputerOut {
        reads { all sensors: SensorReadings, all crew: CrewOrder, all rtcm: RtcmFrames<VesselClock> }
        edge { time_requests, statuses, commands, deck_inputs, helm, checkpoint, ends }
        writes {}
        wakes { SensorReadings }
    }
}

computer! {
    /// The rows of the vessel's computer.
    VesselRows {
        /// The vessel's sensors: bytes to dated measurements.
        sensors: SensorNode => ProcessKind::Sensors,
        /// Estimator, deck arbiter, helm and broadcast.
        vessel: VesselComputer => ProcessKind::Vessel,
    }
    /// The vessel's processes: there is no other list of them.
    PROCESSES: Process
}

/// State that has to survive a restart of the process or the computer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct VesselCheckpoint {
    /// Who has to do with the deck.
    pub deck: DeckCheckpoint,
    /// The commands that operators gave, for longer than their terminals repeat them.
    pub commands: Vec<GivenCommand>,
    /// State before the vessel was steered, while it is.
    pub helm: Option<HelmCheckpoint>,
}

/// The vessel's computer.
#[derive(Debug)]
pub struct VesselComputer {
    node: VesselNode,
    arbiter: DeckArbiter,
    helm: HelmNode,
    /// For the helm: the newest motion, its place, and the best course.
    motion: Option<(Time<VesselClock>, BoatMotion)>,
    place: Option<BoatPlace>,
    advice: Option<(Time<VesselClock>, Goal)>,
    relay: OperatorRelay,
    rtcm: RtcmRelay,
    drones: DroneMonitor,
    doubles: Vec<(u32, [u32; 2])>,
    vessel: u32,
    boot: u32,
    followed: Followed,
    /// Reported of the drones that listen to another computer.
    follows_another: Option<FollowsAnother>,
    /// Owner and waiting drone that were reported.
    starved: Option<[u32; 2]>,
    /// Inertial sensors that are stuck.
    stuck: [bool; MAX_SOURCES],
    rejected: Rejections,
    crew: CrewOrders,
}

impl VesselComputer {
    /// The computer of vessel `vessel`, which started with this boot id.
    pub fn new(node: &VesselNodeConfig, deck: &DeckConfig, vessel: u32, boot: u32) -> VesselComputer {
        VesselComputer {
            node: VesselNode::new(node, vessel, boot),
            arbiter: DeckArbiter::new(deck, vessel, boot),
            helm: HelmNode::new(&node.helm),
            motion: None,
            place: None,
            advice: None,
            relay: OperatorRelay::new(vessel, boot),
            rtcm: RtcmRelay::new(vessel, boot),
            drones: DroneMonitor::new(vessel),
            doubles: Vec::new(),
            vessel,
            boot,
            followed: Followed::default(),
            follows_another: None,
            starved: None,
            stuck: [false; MAX_SOURCES],
            rejected: Rejections::default(),
            crew: CrewOrders::default(),
        }
    }
    /// The crew's orders that were taken last.
    pub fn orders_taken(&self) -> Seq<u32, MAX_ORDERS> {
        self.crew.taken()
    }
    /// Estimator and broadcast.
    pub fn node(&self) -> &VesselNode {
        &self.node
    }
    /// The deck arbiter.
    pub fn arbiter(&self) -> &DeckArbiter {
        &self.arbiter
    }
    /// The helm.
    pub fn helm(&self) -> &HelmNode {
        &self.helm
    }
    /// MAVLink frames of the helm are signed with this key.
    pub fn sign_helm(&mut self, key: Signing) {
        self.helm.sign(key);
    }
    /// The operator relay.
    pub fn relay(&self) -> &OperatorRelay {
        &self.relay
    }
    /// The relay of a moving base's frames.
    pub fn rtcm(&self) -> &RtcmRelay {
        &self.rtcm
    }
    /// The drones that were received.
    pub fn drones(&self) -> &DroneMonitor {
        &self.drones
    }
    /// A drone that listens to another computer with this vessel's identity.
    pub fn follows_another(&self, now: Time<VesselClock>) -> Option<FollowsAnother> {
        self.followed.another(now, self.boot)
    }
    /// Messages that name another author than the key that they were published on.
    pub fn on_other_keys(&self) -> u32 {
        let reason = RejectionReason::Sender;
        self.rejected.of(reason) + self.node.rejected().of(reason)
    }
    /// State that has to survive a restart.
    pub fn checkpoint(&self) -> VesselCheckpoint {
        VesselCheckpoint {
            deck: self.arbiter.checkpoint(),
            commands: self.relay.given(),
            helm: self.helm.checkpoint(),
        }
    }

    /// The messages that may come from the sender of their key.
    fn authentic<'a, M>(
        &mut self,
        arrivals: &'a [Arrival<VesselClock, M>],
        may_come: impl Fn(Sender, &M) -> bool,
    ) -> Vec<&'a Arrival<VesselClock, M>> {
        let own = arrivals.iter().filter(|a| may_come(a.sender, &a.message));
        let own: Vec<_> = own.collect();
        self.rejected
            .count_many(RejectionReason::Sender, arrivals.len() - own.len());
        own
    }

    /// The helm's step, by what arbiter and estimator knew at the step before: its bytes for the boat's autopilot.
    fn steer(
        &mut self,
        now: Time<VesselClock>,
        input: &ComputerIn,
        orders: &[DeckOrder],
        events: &mut Vec<VesselEvent>,
    ) -> Vec<u8> {
        let answer = |order: &DeckOrder| match order {
            DeckOrder::Helm(answer) => Some(*answer),
            DeckOrder::Closed
            | DeckOrder::Open
            | DeckOrder::Clear(_)
            | DeckOrder::TakeOff(_)
            | DeckOrder::TakeOffStanding(_)
            | DeckOrder::Steady(_)
            | DeckOrder::Turning => None,
        };
        let before = self.helm.status();
        let out = self.helm.step(
            now,
            &HelmIn {
                demand: self.arbiter.demand(now),
                drone: self.arbiter.comes(now),
                motion: self.motion,
                place: self.place,
                advice: self
                    .advice
                    .filter(|(at, _)| now - *at <= ADVICE_FRESH)
                    .map(|(_, goal)| goal),
                answers: orders.iter().filter_map(answer).collect(),
                consent: input.deck_inputs.consent,
                turning: self.arbiter.is_turning(now),
                bytes: input.helm.clone(),
                checkpoint: input.checkpoint.as_ref().and_then(|c| c.helm),
                ends: input.ends,
            },
        );
        let changed = (out.status.state, out.status.why) != (before.state, before.why);
        let turned = self
            .helm
            .kept()
            .filter(|_| changed)
            .and_then(|kept| kept.slope_sd);
        turned.into_iter().for_each(|sd| self.node.expect_slopes(sd));
        events.extend(changed.then_some(VesselEvent::Helm(out.status)));
        out.bytes
    }
    /// Keeps the part of a step's output that the helm uses.
    fn observe_motion(&mut self, now: Time<VesselClock>, out: &VesselOut) {
        if let Some(e) = &out.estimate {
            let [heading_rad, rate_radps] = e.mean_heading.map(f64::from);
            let [north, east] = e.mean_velocity.map(f64::from);
            let motion = BoatMotion {
                heading_rad,
                rate_radps,
                speed_mps: north * heading_rad.cos() + east * heading_rad.sin(),
            };
            self.motion = Some((e.header.at, motion));
            let [north_m, east_m, ..] = e.eta;
            self.place = Some(BoatPlace {
                datum: e.datum,
                position_m: [north_m, east_m],
            });
        }
        if let (Some(_), Some((_, motion))) = (&out.wave, &self.motion) {
            let goal = |c: &CourseOutlook| Goal {
                heading_rad: c.heading_rad,
                speed_mps: c.speed_mps,
                likelihood: Some(c.likelihood),
                slope_sd: Some(c.slope_sd),
            };
            let permitted = |c: &CourseOutlook| self.helm.permits(&goal(c), motion);
            let advice = self.node.advisor().advice_within(permitted);
            // It holds within one step of its headings of the course that it compares with.
            let stands = |a: &Advice| a.is_change() && turned(&a.here, motion) <= HEADING_STEP_RAD;
            self.advice = advice.filter(stands).map(|a| (now, goal(&a.best)));
        }
    }

    /// A question, which ends with a descent, before a steady course that is wanted anyway.
    fn lamp(&self, now: Time<VesselClock>) -> Lamp {
        if self.helm.asks_by_lamp(now) {
            Lamp::Blinks
        } else if self.arbiter.wants_steady(now) {
            Lamp::Lit
        } else {
            Lamp::Out
        }
    }

    /// Events on changes of the deck's owner and the drones' numbers.
    fn deck_events(
        &mut self,
        now: Time<VesselClock>,
        former_owner: Option<u32>,
        events: &mut Vec<VesselEvent>,
    ) {
        let doubles: Vec<_> = self.arbiter.doubles().collect();
        let new = doubles.iter().filter(|d| !self.doubles.contains(d));
        events.extend(new.map(|&(drone, boots)| VesselEvent::DoubleNumber { drone, boots }));
        self.doubles = doubles;
        let starved = self.arbiter.starved(now);
        let who = starved.map(|s| [s.owner, s.waiting]);
        let new = starved.filter(|_| who != self.starved);
        events.extend(new.map(VesselEvent::DeckStarved));
        self.starved = who;
        let ended = self.arbiter.ended_clearances();
        events.extend(
            ended
                .into_iter()
                .map(|(drone, why)| VesselEvent::ClearanceEnded { drone, why }),
        );
        let owner = self.arbiter.owner();
        events.extend((owner != former_owner).then_some(VesselEvent::DeckOwner(owner)));
    }
}

impl Node for VesselComputer {
    type Clock = VesselClock;
    type In = ComputerIn;
    type Out = ComputerOut;

    fn step(&mut self, now: Time<VesselClock>, input: &ComputerIn) -> ComputerOut {
        let mut events = Vec::new();
        let orders = self.crew.take(now, &input.crew, &mut events);
        let of_drone = |sender, status: &DroneStatus| sender == Sender::Drone(status.header.drone);
        let statuses = self.authentic(&input.statuses, of_drone);
        // A command names no operator.
        let commands = self.authentic(&input.commands, |sender, _| matches!(sender, Sender::Operator(_)));
        for status in &statuses {
            let news = self.drones.observe(status);
            let drone = status.message.header.drone;
            events.extend(news.state.then(|| VesselEvent::of(&status.message)));
            events.extend(
                news.still_armed
                    .map(|for_s| VesselEvent::StillArmed { drone, for_s }),
            );
        }
        self.followed.observe(self.vessel, &input.time_requests);
        let another = self.follows_another(now);
        let new = another.filter(|_| another != self.follows_another);
        events.extend(new.map(VesselEvent::SecondComputer));
        self.follows_another = another;
        let statuses: Vec<DroneStatus> = statuses.iter().map(|s| s.message).collect();
        let left = input.checkpoint.as_ref();

        // Status of the drones -> deck arbiter and operator relay. To both one whose mission is silent is a silent drone:
        // what it did before shows neither that it left the deck nor that it took a command.
        let current: Vec<_> = statuses.iter().copied().filter(DroneStatus::is_current).collect();
        let former_owner = self.arbiter.owner();
        let helm = self.steer(now, input, &orders, &mut events);
        let granted = self.arbiter.step(
            now,
            &ArbiterIn {
                statuses: current.clone(),
                orders,
                inputs: input.deck_inputs,
                helm: self.helm.status(),
                dimensions: Some(self.node.dimensions()),
                turns_back: self.helm.turns_back(),
                checkpoint: left.map(|c| c.deck.clone()),
            },
        );
        self.deck_events(now, former_owner, &mut events);
        let relayed = self.relay.step(
            now,
            &OperatorIn {
                commands: commands.iter().map(|c| c.message).collect(),
                statuses: current,
                given: left.map(|c| c.commands.clone()).unwrap_or_default(),
            },
        );
        events.extend(relayed.accepted.iter().map(|c| VesselEvent::Command {
            drone: c.header.drone,
            kind: c.kind,
        }));

        // Sensors -> estimator -> broadcast, at the rates that the landing drone's link carries.
        self.node.prioritise(self.arbiter.landing(now));
        self.node.blow(self.drones.wind(now));
        let vessel = self.node.step(now, &input.vessel());
        self.observe_motion(now, &vessel);
        for (source, before) in self.stuck.iter_mut().enumerate() {
            let stuck = self.node.source(IMU, source).is_stuck;
            let changed = std::mem::replace(before, stuck) != stuck;
            events.extend(changed.then_some(VesselEvent::StuckImu { source, stuck }));
        }
        ComputerOut {
            vessel,
            grant: granted.grant,
            commands: relayed.commands,
            receipts: relayed.receipts,
            statuses,
            rtcm: self.rtcm.pass(now, &input.rtcm),
            events,
            lamp: self.lamp(now),
            helm,
        }
    }
}

/// So far a vessel has turned from a course, rad.
fn turned(from: &CourseOutlook, now: &BoatMotion) -> f64 {
    wrap_angle(now.heading_rad - from.heading_rad).abs()
}

#[cfg(test)]
mod tests;
