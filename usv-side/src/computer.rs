//! The vessel's computer: its nodes in the order of their data. The simulated world and the process step this one.

use core::fmt;

use alight_shared::admission::{Arrival, RejectionReason, Rejections, Sender};
use alight_shared::msg::{
    Charge, CommandKind, CommandReceipt, DeckGrant, DeckOrder, DroneStatus, FollowsAnother, MAX_SOURCES,
    OperatorCommand, Reason, Starved, State, still_armed,
};
use alight_shared::node::Node;
use alight_shared::time::{Time, VesselClock};
use serde::{Deserialize, Serialize};

use crate::VesselNodeConfig;
use crate::deck::{
    ArbiterIn, DeckArbiter, DeckCheckpoint, DeckConfig, DeckInputs, DroneMonitor, GivenCommand, OperatorIn,
    OperatorRelay,
};
use crate::followed::Followed;
use crate::node::{IMU, VesselIn, VesselNode, VesselOut};
use crate::sensors::MAX_REPEATED;

/// What arrived since the last step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ComputerIn {
    /// Measurements and time requests.
    pub vessel: VesselIn,
    /// Statuses of drones.
    pub statuses: Vec<Arrival<VesselClock, DroneStatus>>,
    /// Commands of operators whose certificates were accepted.
    pub commands: Vec<Arrival<VesselClock, OperatorCommand<VesselClock>>>,
    /// Orders of the crew.
    pub deck_orders: Vec<DeckOrder>,
    /// Digital inputs.
    pub deck_inputs: DeckInputs,
    /// At the first step, what the former start left.
    pub checkpoint: Option<VesselCheckpoint>,
}

/// What the vessel publishes, and what people are to know.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ComputerOut {
    /// Estimate, models and time replies.
    pub vessel: VesselOut,
    /// The owner of the deck, when due.
    pub grant: Option<DeckGrant<VesselClock>>,
    /// Commands for the drones that their headers name.
    pub commands: Vec<OperatorCommand<VesselClock>>,
    /// What became of operators' commands.
    pub receipts: Vec<CommandReceipt>,
    /// Statuses of drones, for operators.
    pub statuses: Vec<DroneStatus>,
    /// What happened in this step.
    pub events: Vec<VesselEvent>,
    /// A drone wants the vessel to keep course and speed.
    pub wants_steady: bool,
}

/// What must not be forgotten when the process or the computer is started anew.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct VesselCheckpoint {
    /// Who has to do with the deck.
    pub deck: DeckCheckpoint,
    /// The commands that operators gave, for longer than their terminals repeat them.
    pub commands: Vec<GivenCommand>,
}

/// What people on board are to know.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum VesselEvent {
    /// A drone reports another state of its mission, or reports for the first time.
    DroneState {
        /// The drone.
        drone: u32,
        /// Its state.
        state: State,
        /// Why it was entered.
        entered: Reason,
        /// Its battery, 0 to 1; None: not reported.
        battery: Option<f64>,
    },
    /// An operator's command was accepted.
    Command {
        /// The drone.
        drone: u32,
        /// What it is to do.
        kind: CommandKind,
    },
    /// The crew's order was taken.
    DeckOrder(DeckOrder),
    /// The deck has another owner.
    DeckOwner(Option<u32>),
    /// A drone is landed and armed for longer than its disarm takes.
    StillArmed {
        /// The drone.
        drone: u32,
        /// Since its landing, s.
        for_s: f32,
    },
    /// An inertial sensor repeats one sample, or measures again.
    StuckImu {
        /// Its number.
        source: usize,
        /// It repeats one.
        stuck: bool,
    },
    /// A drone with a low battery waits for the deck, whose owner is silent.
    DeckStarved(Starved),
    /// A drone listens to another computer with this vessel's identity.
    SecondComputer(FollowsAnother),
    /// Two drones have one number.
    DoubleNumber {
        /// The number.
        drone: u32,
        /// The boot ids of both.
        boots: [u32; 2],
    },
}

impl VesselEvent {
    /// A drone's new state.
    fn of(status: &DroneStatus) -> VesselEvent {
        VesselEvent::DroneState {
            drone: status.header.drone,
            state: status.state,
            entered: status.entered,
            battery: status.battery,
        }
    }
    /// Somebody has to do something about it.
    pub fn is_warning(&self) -> bool {
        match self {
            VesselEvent::DoubleNumber { .. }
            | VesselEvent::SecondComputer(_)
            | VesselEvent::StillArmed { .. }
            | VesselEvent::DeckStarved(_) => true,
            VesselEvent::StuckImu { stuck, .. } => *stuck,
            VesselEvent::DroneState { .. }
            | VesselEvent::Command { .. }
            | VesselEvent::DeckOrder(_)
            | VesselEvent::DeckOwner(_) => false,
        }
    }
}

impl fmt::Display for VesselEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            VesselEvent::DroneState {
                drone,
                state,
                entered,
                battery,
            } => write!(
                f,
                "drone {drone}: {}: {entered} (battery {})",
                state.name(),
                Charge(*battery)
            ),
            VesselEvent::Command { drone, kind } => write!(f, "an operator commands drone {drone}: {kind:?}"),
            VesselEvent::DeckOrder(DeckOrder::TakeOff(drone)) => {
                write!(f, "crew order: deck cleared for the take-off of drone {drone}")
            }
            VesselEvent::DeckOrder(DeckOrder::Closed) => write!(f, "crew order: deck closed"),
            VesselEvent::DeckOrder(DeckOrder::Open) => write!(f, "crew order: deck open"),
            VesselEvent::DeckOrder(DeckOrder::Clear(drone)) => {
                write!(
                    f,
                    "crew order: deck open, drone {drone} is neither on it nor above it"
                )
            }
            VesselEvent::DeckOrder(DeckOrder::Steady(0)) => write!(f, "crew order: no course is stated"),
            VesselEvent::DeckOrder(DeckOrder::Steady(for_s)) => {
                write!(f, "crew order: course and speed are kept for {for_s} s")
            }
            VesselEvent::DeckOrder(DeckOrder::Turning) => write!(f, "crew order: the vessel turns"),
            VesselEvent::DeckOwner(Some(drone)) => write!(f, "the deck is reserved for drone {drone}"),
            VesselEvent::DeckOwner(None) => write!(f, "the deck is free"),
            VesselEvent::StillArmed { drone, for_s } => write!(f, "drone {drone}: {}", still_armed(*for_s)),
            VesselEvent::StuckImu { source, stuck: true } => write!(
                f,
                "inertial sensor {source} is STUCK: {MAX_REPEATED} samples in a row have the same numbers, and no \
                 more are used: power it off and on, see to its cable and driver"
            ),
            VesselEvent::StuckImu { source, stuck: false } => {
                write!(f, "inertial sensor {source} measures again")
            }
            VesselEvent::DeckStarved(s) => write!(f, "{s}"),
            VesselEvent::SecondComputer(FollowsAnother { drone, boot }) => write!(
                f,
                "drone {drone} listens to a SECOND COMPUTER with this vessel's certificate (boot id {boot:08x}): switch \
                 one of the two off"
            ),
            VesselEvent::DoubleNumber {
                drone,
                boots: [one, other],
            } => write!(
                f,
                "two drones have the number {drone} (boot ids {one:08x} and {other:08x}): neither is given the deck; \
                 change bridge.drone_id of one of them"
            ),
        }
    }
}

/// The vessel's computer.
#[derive(Clone, Debug)]
pub struct VesselComputer {
    node: VesselNode,
    arbiter: DeckArbiter,
    relay: OperatorRelay,
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
}

impl VesselComputer {
    /// The computer of vessel `vessel`, which started with this boot id.
    pub fn new(node: &VesselNodeConfig, deck: &DeckConfig, vessel: u32, boot: u32) -> VesselComputer {
        VesselComputer {
            node: VesselNode::new(node, vessel, boot),
            arbiter: DeckArbiter::new(deck, vessel, boot),
            relay: OperatorRelay::new(vessel, boot),
            drones: DroneMonitor::new(vessel),
            doubles: Vec::new(),
            vessel,
            boot,
            followed: Followed::default(),
            follows_another: None,
            starved: None,
            stuck: [false; MAX_SOURCES],
            rejected: Rejections::default(),
        }
    }
    /// Estimator and broadcast.
    pub fn node(&self) -> &VesselNode {
        &self.node
    }
    /// The deck arbiter.
    pub fn arbiter(&self) -> &DeckArbiter {
        &self.arbiter
    }
    /// The operator relay.
    pub fn relay(&self) -> &OperatorRelay {
        &self.relay
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
    /// What must not be forgotten.
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

    /// What has changed of the deck's owner and the drones' numbers.
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
        let owner = self.arbiter.owner();
        events.extend((owner != former_owner).then_some(VesselEvent::DeckOwner(owner)));
    }
}

impl Node for VesselComputer {
    type Clock = VesselClock;
    type In = ComputerIn;
    type Out = ComputerOut;

    fn step(&mut self, now: Time<VesselClock>, input: &ComputerIn) -> ComputerOut {
        let mut events: Vec<_> = input
            .deck_orders
            .iter()
            .copied()
            .map(VesselEvent::DeckOrder)
            .collect();
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
        self.followed.observe(self.vessel, &input.vessel.time_requests);
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
                orders: input.deck_orders.clone(),
                inputs: input.deck_inputs,
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
        let vessel = self.node.step(now, &input.vessel);
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
            events,
            wants_steady: self.arbiter.wants_steady(now),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{Header, ReasonCode, TimeRequest};

    fn status(boot: u32, sequence: u32, state: State) -> Arrival<VesselClock, DroneStatus> {
        let message = DroneStatus {
            header: Header::new(1, 3, boot, sequence, Time::EPOCH),
            state,
            entered: Reason::plain(ReasonCode::Operator),
            battery: Some(0.5),
            ..DroneStatus::default()
        };
        Arrival {
            at: Time::EPOCH,
            sender: Sender::Drone(3),
            message,
        }
    }

    /// The events of a step.
    fn events(computer: &mut VesselComputer, t_s: f64, input: ComputerIn) -> Vec<String> {
        let out = computer.step(Time::from_secs(t_s), &input);
        out.events.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn vessel_computer_changes() {
        let mut computer = VesselComputer::new(&VesselNodeConfig::default(), &DeckConfig::default(), 1, 9);
        let mut received = |t_s, statuses| {
            let input = ComputerIn {
                statuses,
                ..ComputerIn::default()
            };
            events(&mut computer, t_s, input)
        };
        let descends = received(5.0, vec![status(7, 1, State::Descent)]);
        assert_eq!(descends.len(), 2, "{descends:?}");
        assert!(descends[0].starts_with("drone 3: Descent") && descends[0].ends_with("(battery 50 %)"));
        assert_eq!(descends[1], "the deck is reserved for drone 3");
        assert!(received(5.5, vec![status(7, 2, State::Descent)]).is_empty());
        let double = (1..4).flat_map(|k| {
            let both = vec![status(8, k, State::Descent), status(7, 2 + k, State::Descent)];
            received(5.5 + 0.5 * f64::from(k), both)
        });
        let double: Vec<_> = double.filter(|e| e.starts_with("two drones")).collect();
        assert_eq!(double.len(), 1, "{double:?}");
        assert!(double[0].contains("00000007 and 00000008"), "{double:?}");
        let order = ComputerIn {
            deck_orders: vec![DeckOrder::Closed],
            ..ComputerIn::default()
        };
        assert_eq!(events(&mut computer, 8.0, order), ["crew order: deck closed"]);
    }

    #[test]
    fn status_with_an_old_mission_state() {
        let mut computer = VesselComputer::new(&VesselNodeConfig::default(), &DeckConfig::default(), 1, 9);
        let mut received = |t_s: f64, status: Arrival<VesselClock, DroneStatus>| {
            let input = ComputerIn {
                statuses: vec![status],
                ..ComputerIn::default()
            };
            computer.step(Time::from_secs(t_s), &input);
            let now = Time::from_secs(t_s);
            (
                computer.arbiter().owner(),
                computer.arbiter().unheard(now).count(),
                computer.drones().received(),
            )
        };
        assert_eq!(received(5.0, status(7, 1, State::Descent)), (Some(3), 0, 1));
        // The mission's process hangs, and the bridge goes on: nobody knows what the drone does.
        let mut last = None;
        for k in 2..30 {
            let mut old = status(7, k, State::Descent);
            old.message.mission_age_s = 0.5 * k as f32;
            last = Some(received(5.0 + 0.5 * f64::from(k), old));
        }
        assert_eq!(
            last,
            Some((Some(3), 1, 29)),
            "people see it, the arbiter takes it for silent"
        );
    }

    /// A drone with a sound certificate speaks for another, which lands.
    #[test]
    fn message_for_another_drone() {
        let config = VesselNodeConfig::default();
        let mut computer = VesselComputer::new(&config, &DeckConfig::default(), 1, 9);
        let abort = OperatorCommand {
            header: Header::new(1, 3, 5, 1, Time::EPOCH),
            kind: CommandKind::Abort,
        };
        let command = |sender, message| Arrival {
            at: Time::EPOCH,
            sender,
            message,
        };
        let landing = ComputerIn {
            statuses: vec![status(7, 1, State::Descent)],
            commands: vec![command(Sender::Operator(2), abort)],
            ..ComputerIn::default()
        };
        let out = computer.step(Time::from_secs(5.0), &landing);
        let [relayed] = out.commands[..] else {
            panic!("{out:?}")
        };

        let mut acknowledged = status(7, 2, State::GaveUp);
        acknowledged.message.abort = Some([relayed.header.boot, relayed.header.sequence]);
        let mut left = status(8, 1, State::Idle);
        left.message.deck_distance_m = Some(900.0);
        let land = OperatorCommand {
            kind: CommandKind::Land,
            ..abort
        };
        let mut request = TimeRequest {
            header: Header::new(1, 3, 7, 1, Time::EPOCH),
            newest_at: Time::from_secs(1.0),
            newest_boot: 9,
        };
        let mut requests = Vec::new();
        for k in 0..20_u32 {
            request.header.sequence = k;
            requests.push(Arrival {
                at: Time::from_secs(7.0),
                sender: Sender::Drone(4),
                message: request,
            });
        }
        let forged = ComputerIn {
            vessel: VesselIn {
                time_requests: requests,
                ..VesselIn::default()
            },
            statuses: [acknowledged, left]
                .map(|s| Arrival {
                    sender: Sender::Drone(4),
                    ..s
                })
                .into(),
            commands: vec![command(Sender::Drone(4), land)],
            ..ComputerIn::default()
        };
        let out = computer.step(Time::from_secs(7.0), &forged);
        assert!(
            out.events.is_empty() && out.vessel.time_replies.is_empty(),
            "{out:?}"
        );
        assert_eq!(computer.arbiter().owner(), Some(3));
        assert_eq!(computer.relay().unacknowledged().collect::<Vec<_>>(), [3]);
        assert_eq!(computer.node().rate_fraction(), 1.0);
        assert_eq!(computer.on_other_keys(), 23);
        // Itself it is believed.
        let own = ComputerIn {
            statuses: vec![acknowledged],
            ..ComputerIn::default()
        };
        computer.step(Time::from_secs(7.1), &own);
        assert_eq!(computer.relay().unacknowledged().count(), 0);
    }
}
