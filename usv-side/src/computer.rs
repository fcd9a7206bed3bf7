//! The vessel's computer: its nodes, and [`VesselComputer`], which steps those of the vessel's process in the
//! order of their data, in the simulated world and in the real process.

use alight_shared::{
    admission::{Arrival, RejectionReason, Rejections, Sender},
    bus::{computer, wiring},
    msg::{
        CommandReceipt, CrewOrder, DeckGrant, DroneStatus, FollowsAnother, MAX_ORDERS, MAX_SOURCES,
        OperatorCommand, RtcmFrames, SensorReadings, Seq, TimeRequest, WaveUpdate,
    },
    node::Node,
    process::ProcessKind,
    radio::RadioTopic,
    time::{DroneClock, VesselClock, VesselTime},
    wire::WireError,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

mod crew;
mod event;

pub use event::VesselEvent;

use crate::{
    VesselNodeConfig,
    deck::{
        ArbiterIn, DeckArbiter, DeckCheckpoint, DeckConfig, DeckInputs, DroneMonitor, GivenCommand,
        OperatorIn, OperatorRelay,
    },
    followed::Followed,
    node::{IMU, VesselIn, VesselNode, VesselOut},
    rtcm_relay::RtcmRelay,
    sensors::{Readings, SensorNode, SourcesConfig},
};
use crew::CrewOrders;

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ComputerIn {
    pub sensors: Vec<SensorReadings>,
    pub crew: Vec<CrewOrder>,
    /// RTCM frames of a moving base from the sensor process.
    pub rtcm: Vec<RtcmFrames<VesselClock>>,
    pub time_requests: Vec<Arrival<VesselClock, TimeRequest<DroneClock>>>,
    pub statuses: Vec<Arrival<VesselClock, DroneStatus>>,
    /// Commands of operators with valid certificates.
    pub commands: Vec<Arrival<VesselClock, OperatorCommand<VesselClock>>>,
    pub deck_inputs: DeckInputs,
    /// Checkpoint of the previous start, at the first step.
    pub checkpoint: Option<VesselCheckpoint>,
}

impl ComputerIn {
    pub fn vessel(&self) -> VesselIn {
        VesselIn {
            readings: Readings::of(&self.sensors),
            time_requests: self.time_requests.clone(),
        }
    }
    /// Adds a message of a drone or an operator that arrived by radio.
    pub fn receive(
        &mut self,
        topic: RadioTopic,
        arrival: &Arrival<VesselClock, Vec<u8>>,
    ) -> Result<(), WireError> {
        match topic {
            RadioTopic::TimeRequest => self.time_requests.push(arrival.decoded()?),
            RadioTopic::Status => self.statuses.push(arrival.decoded()?),
            RadioTopic::Order => self.commands.push(arrival.decoded()?),
            // Not for vessels.
            _ => {}
        }
        Ok(())
    }
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ComputerOut {
    /// Estimate, models and time replies.
    pub vessel: VesselOut,
    pub grant: Option<DeckGrant<VesselClock>>,
    /// Commands for the drones named in their headers.
    pub commands: Vec<OperatorCommand<VesselClock>>,
    pub receipts: Vec<CommandReceipt>,
    pub statuses: Vec<DroneStatus>,
    /// RTCM frames of a moving base for the drones' receivers.
    pub rtcm: Vec<RtcmFrames<VesselClock>>,
    pub events: Vec<VesselEvent>,
    /// Light of the lamp at the helm: a drone asks the vessel to keep course and speed.
    pub lamp: bool,
}

impl ComputerOut {
    /// Passes each encoded radio message to `send`; the flag marks those held for drones that connect later.
    pub fn broadcast(&self, mut send: impl FnMut(RadioTopic, Vec<u8>, bool)) {
        // A drone that connects later cannot use a continued wave model.
        let whole = self.vessel.wave_update.as_ref().is_some_and(WaveUpdate::is_whole);
        let mut send = |topic: RadioTopic, bytes| {
            let held = topic.row().held && (topic != RadioTopic::Wave || whole);
            send(topic, bytes, held);
        };
        let vessel = &self.vessel;
        RadioTopic::Estimate.encode_each(&vessel.estimate_update, &mut send);
        RadioTopic::Wave.encode_each(&vessel.wave_update, &mut send);
        RadioTopic::Prediction.encode_each(&vessel.prediction, &mut send);
        RadioTopic::Surroundings.encode_each(&vessel.surroundings, &mut send);
        RadioTopic::Rtcm.encode_each(&self.rtcm, &mut send);
        RadioTopic::TimeReply.encode_each(&vessel.time_replies, &mut send);
        RadioTopic::Deck.encode_each(&self.grant, &mut send);
        RadioTopic::Command.encode_each(&self.commands, &mut send);
        RadioTopic::Drones.encode_each(&self.statuses, &mut send);
        RadioTopic::Receipts.encode_each(&self.receipts, &mut send);
    }
}

wiring! {
    VesselPorts of VesselComputer: ComputerIn => ComputerOut {
        reads { all sensors: SensorReadings, all crew: CrewOrder, all rtcm: RtcmFrames<VesselClock> }
        edge { time_requests, statuses, commands, deck_inputs, checkpoint }
        writes {}
        wakes { SensorReadings }
    }
}

computer! {
    /// Processes of the vessel's computer.
    VesselRows of VesselNodes {
        /// Sensors: converts bytes to measurements with time stamps.
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
    /// The vessel's processes, listed here only.
    PROCESSES: Installed, RowVisitor
}

#[derive(Clone, Debug)]
pub struct VesselNodes {
    pub id: u32,
    pub sensors: SourcesConfig,
    pub vessel: VesselNodeConfig,
    pub deck: DeckConfig,
    pub drones: Vec<u32>,
}

/// State that must survive a restart of the process or the computer.
#[derive(Clone, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
pub struct VesselCheckpoint {
    /// Owner of the deck, and drones that have asked for it.
    pub deck: DeckCheckpoint,
    /// Commands of operators, kept longer than their terminals repeat them.
    pub commands: Vec<GivenCommand>,
}

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
    /// Last drone reported as following another computer.
    follows_another: Option<FollowsAnother>,
    /// Last reported pair of silent owner and waiting drone.
    starved: Option<[u32; 2]>,
    stuck: [bool; MAX_SOURCES],
    rejected: Rejections,
    crew: CrewOrders,
}

impl VesselComputer {
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
    pub fn orders_taken(&self) -> Seq<u32, MAX_ORDERS> {
        self.crew.taken()
    }
    pub fn node(&self) -> &VesselNode {
        &self.node
    }
    pub fn arbiter(&self) -> &DeckArbiter {
        &self.arbiter
    }
    pub fn admit(&mut self, drones: impl IntoIterator<Item = u32>) {
        self.relay.admit(drones);
    }
    pub fn relay(&self) -> &OperatorRelay {
        &self.relay
    }
    pub fn rtcm(&self) -> &RtcmRelay {
        &self.rtcm
    }
    pub fn drones(&self) -> &DroneMonitor {
        &self.drones
    }
    /// Drone that follows another computer with this vessel's identity.
    pub fn follows_another(&self, now: VesselTime) -> Option<FollowsAnother> {
        self.followed.another(now, self.boot)
    }
    /// Number of messages whose author is not the owner of their key.
    pub fn on_other_keys(&self) -> u32 {
        let reason = RejectionReason::Sender;
        self.rejected.of(reason) + self.node.rejected().of(reason)
    }
    pub fn checkpoint(&self) -> VesselCheckpoint {
        VesselCheckpoint {
            deck: self.arbiter.checkpoint(),
            commands: self.relay.given(),
        }
    }

    /// Messages whose author matches the owner of their key.
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

    /// Events for changes of the deck's owner and of drone numbers that are used twice.
    fn deck_events(&mut self, now: VesselTime, former_owner: Option<u32>, events: &mut Vec<VesselEvent>) {
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

    fn step(&mut self, now: VesselTime, input: &ComputerIn) -> ComputerOut {
        let mut events = Vec::new();
        let orders = self.crew.take(now, &input.crew, &mut events);
        let of_drone = |sender, status: &DroneStatus| sender == Sender::Drone(status.header.drone);
        let statuses = self.authentic(&input.statuses, of_drone);
        // Commands do not name their operator.
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

        // Deck arbiter and operator relay treat a drone with a silent mission as silent: its earlier state
        // shows neither that it left the deck nor that it received a command.
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
