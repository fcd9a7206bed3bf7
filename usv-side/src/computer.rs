//! The vessel's computer: its rows, and [`VesselComputer`], the nodes of the second one in the order of their data. The simulated
//! world and the processes step these.

use alight_shared::admission::{Arrival, RejectionReason, Rejections, Sender};
use alight_shared::bus::{computer, wiring};
use alight_shared::msg::{
    CommandReceipt, CrewOrder, DeckGrant, DroneStatus, FollowsAnother, MAX_ORDERS, MAX_SOURCES,
    OperatorCommand, RtcmFrames, SensorReadings, Seq, TimeRequest, WaveUpdate,
};
use alight_shared::node::Node;
use alight_shared::process::ProcessKind;
use alight_shared::radio::RadioTopic;
use alight_shared::time::{DroneClock, Time, VesselClock};
use alight_shared::wire::{self, WireError};
use serde::{Deserialize, Serialize};

mod crew;
mod event;

pub use event::VesselEvent;

use crate::VesselNodeConfig;
use crate::deck::{
    ArbiterIn, DeckArbiter, DeckCheckpoint, DeckConfig, DeckInputs, DroneMonitor, GivenCommand, OperatorIn,
    OperatorRelay,
};
use crate::followed::Followed;
use crate::node::{IMU, VesselIn, VesselNode, VesselOut};
use crate::rtcm_relay::RtcmRelay;
use crate::sensors::{Readings, SensorNode, SourcesConfig};
use crew::CrewOrders;

/// Input that arrived since the last step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ComputerIn {
    /// Measurements of the sensors' process.
    pub sensors: Vec<SensorReadings>,
    /// Orders of the crew.
    pub crew: Vec<CrewOrder>,
    /// Frames of the sensors' process, of a moving base.
    pub rtcm: Vec<RtcmFrames<VesselClock>>,
    pub time_requests: Vec<Arrival<VesselClock, TimeRequest<DroneClock>>>,
    /// Statuses of drones.
    pub statuses: Vec<Arrival<VesselClock, DroneStatus>>,
    /// Commands of operators whose certificates were accepted.
    pub commands: Vec<Arrival<VesselClock, OperatorCommand<VesselClock>>>,
    /// Digital inputs.
    pub deck_inputs: DeckInputs,
    /// At the first step, what the former start left.
    pub checkpoint: Option<VesselCheckpoint>,
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
    /// The lamp at the helm is lit: a drone wants the vessel to keep course and speed.
    pub lamp: bool,
}

impl ComputerOut {
    /// Shows what goes by radio, encoded, and whether it is held for who comes later.
    pub fn broadcast(&self, mut send: impl FnMut(RadioTopic, Vec<u8>, bool)) {
        // A joiner can use no wave model that continues another.
        let whole = self.vessel.wave_update.as_ref().is_some_and(WaveUpdate::is_whole);
        let mut each = |topic: RadioTopic, messages: &mut dyn Iterator<Item = Result<Vec<u8>, WireError>>| {
            let held = topic.row().held && (topic != RadioTopic::Wave || whole);
            // A message that does not encode is a message that is not sent: the receiver sees the gap.
            messages.flatten().for_each(|bytes| send(topic, bytes, held));
        };
        let vessel = &self.vessel;
        each(
            RadioTopic::Estimate,
            &mut vessel.estimate_update.iter().map(wire::encode),
        );
        each(RadioTopic::Wave, &mut vessel.wave_update.iter().map(wire::encode));
        each(
            RadioTopic::Prediction,
            &mut vessel.prediction.iter().map(wire::encode),
        );
        each(
            RadioTopic::Surroundings,
            &mut vessel.surroundings.iter().map(wire::encode),
        );
        each(RadioTopic::Rtcm, &mut self.rtcm.iter().map(wire::encode));
        each(
            RadioTopic::TimeReply,
            &mut vessel.time_replies.iter().map(wire::encode),
        );
        each(RadioTopic::Deck, &mut self.grant.iter().map(wire::encode));
        each(RadioTopic::Command, &mut self.commands.iter().map(wire::encode));
        each(RadioTopic::Drones, &mut self.statuses.iter().map(wire::encode));
        each(RadioTopic::Receipts, &mut self.receipts.iter().map(wire::encode));
    }
}

wiring! {
    /// Topics that the vessel's process reads; its output goes by radio and to people.
    VesselPorts of VesselComputer: ComputerIn => ComputerOut {
        reads { all sensors: SensorReadings, all crew: CrewOrder, all rtcm: RtcmFrames<VesselClock> }
        edge { time_requests, statuses, commands, deck_inputs, checkpoint }
        writes {}
        wakes { SensorReadings }
    }
}

computer! {
    /// The rows of the vessel's computer.
    VesselRows of VesselNodes {
        /// The vessel's sensors: bytes to dated measurements.
        sensors: SensorNode => ProcessKind::Sensors, |of, boot| {
            SensorNode::new(&of.sensors, of.id, boot).with_deck(of.vessel.deck.centre_m)
        };
        /// Estimator, deck arbiter and broadcast.
        vessel: VesselComputer => ProcessKind::Vessel, |of, boot| {
            let mut node = VesselComputer::new(&of.vessel, &of.deck, of.id, boot);
            node.admit(of.drones.iter().copied());
            node
        };
    }
    /// The vessel's processes: there is no other list of them.
    PROCESSES: Installed, RowVisitor
}

/// Configurations of the nodes of a vessel's computer.
#[derive(Clone, Debug)]
pub struct VesselNodes {
    /// Number of the vessel.
    pub id: u32,
    /// The sensors.
    pub sensors: SourcesConfig,
    /// Estimator and broadcast.
    pub vessel: VesselNodeConfig,
    /// The deck arbiter.
    pub deck: DeckConfig,
    /// Operators' commands are passed on to these drones.
    pub drones: Vec<u32>,
}

/// State that has to survive a restart of the process or the computer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct VesselCheckpoint {
    /// Who has to do with the deck.
    pub deck: DeckCheckpoint,
    /// The commands that operators gave, for longer than their terminals repeat them.
    pub commands: Vec<GivenCommand>,
}

/// The vessel's computer.
#[derive(Debug)]
pub struct VesselComputer {
    node: VesselNode,
    arbiter: DeckArbiter,
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
    /// Operators' commands are passed on to these drones.
    pub fn admit(&mut self, drones: impl IntoIterator<Item = u32>) {
        self.relay.admit(drones);
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
        let granted = self.arbiter.step(
            now,
            &ArbiterIn {
                statuses: current.clone(),
                orders,
                inputs: input.deck_inputs,
                dimensions: Some(self.node.dimensions()),
                checkpoint: left.map(|c| c.deck.clone()),
            },
        );
        self.deck_events(now, former_owner, &mut events);
        let relayed = self.relay.step(
            now,
            &OperatorIn {
                commands: commands.into_iter().copied().collect(),
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
            lamp: self.arbiter.wants_steady(now),
        }
    }
}

#[cfg(test)]
mod tests;
