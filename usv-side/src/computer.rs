//! The vessel's computer: its nodes in the order of their data. The simulated world and the process step this one.

use core::fmt;

use alight_shared::msg::{CommandKind, DeckGrant, DroneStatus, OperatorCommand, Reason, State};
use alight_shared::node::Node;
use alight_shared::time::{Stamped, Time, VesselClock};
use serde::{Deserialize, Serialize};

use crate::VesselNodeConfig;
use crate::deck::{
    ArbiterIn, DeckArbiter, DeckConfig, DeckInputs, DeckMemory, DeckOrder, DroneMonitor, OperatorIn,
    OperatorRelay, PendingAbort, VoidCommand,
};
use crate::node::{VesselIn, VesselNode, VesselOut};

/// What arrived since the last step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ComputerIn {
    /// Measurements and time requests.
    pub vessel: VesselIn,
    /// Statuses of drones, stamped with their arrival.
    pub statuses: Vec<Stamped<VesselClock, DroneStatus>>,
    /// Commands of operators.
    pub commands: Vec<OperatorCommand<VesselClock>>,
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
    /// What happened in this step.
    pub events: Vec<VesselEvent>,
}

/// What must not be forgotten when the process or the computer is started anew.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct VesselCheckpoint {
    /// Who has to do with the deck.
    pub deck: DeckMemory,
    /// Aborts that no drone has acknowledged.
    pub aborts: Vec<PendingAbort>,
    /// Commands that aborts have made void.
    pub void: Vec<VoidCommand>,
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
        /// Its battery, 0 to 1.
        battery: f64,
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
    /// Two drones have one number.
    DoubleNumber {
        /// The number.
        drone: u32,
        /// The boot ids of both.
        boots: [u32; 2],
    },
}

impl VesselEvent {
    /// Somebody has to do something about it.
    pub fn is_warning(&self) -> bool {
        match self {
            VesselEvent::DoubleNumber { .. } => true,
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
                "drone {drone}: {}: {entered} (battery {:.0} %)",
                state.name(),
                100.0 * battery
            ),
            VesselEvent::Command { drone, kind } => write!(f, "an operator commands drone {drone}: {kind:?}"),
            VesselEvent::DeckOrder(DeckOrder::Closed) => write!(f, "crew order: deck closed"),
            VesselEvent::DeckOrder(DeckOrder::Open) => write!(f, "crew order: deck open"),
            VesselEvent::DeckOwner(Some(drone)) => write!(f, "the deck is reserved for drone {drone}"),
            VesselEvent::DeckOwner(None) => write!(f, "the deck is free"),
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
    /// What must not be forgotten.
    pub fn checkpoint(&self) -> VesselCheckpoint {
        VesselCheckpoint {
            deck: self.arbiter.memory(),
            aborts: self.relay.aborts(),
            void: self.relay.void(),
        }
    }

    /// What has changed of the deck's owner and the drones' numbers.
    fn deck_events(&mut self, former_owner: Option<u32>, events: &mut Vec<VesselEvent>) {
        let doubles: Vec<_> = self.arbiter.doubles().collect();
        let new = doubles.iter().filter(|d| !self.doubles.contains(d));
        events.extend(new.map(|&(drone, boots)| VesselEvent::DoubleNumber { drone, boots }));
        self.doubles = doubles;
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
        events.extend(input.statuses.iter().filter_map(|s| self.drones.observe(s)));
        let statuses: Vec<DroneStatus> = input.statuses.iter().map(|s| s.value).collect();
        let left = input.checkpoint.as_ref();

        // Status of the drones -> deck arbiter and operator relay.
        let former_owner = self.arbiter.owner();
        let granted = self.arbiter.step(
            now,
            &ArbiterIn {
                statuses: statuses.clone(),
                orders: input.deck_orders.clone(),
                inputs: input.deck_inputs,
                memory: left.map(|c| c.deck.clone()),
            },
        );
        self.deck_events(former_owner, &mut events);
        let relayed = self.relay.step(
            now,
            &OperatorIn {
                commands: input.commands.clone(),
                statuses,
                aborts: left.map(|c| c.aborts.clone()).unwrap_or_default(),
                void: left.map(|c| c.void.clone()).unwrap_or_default(),
            },
        );
        events.extend(relayed.accepted.iter().map(|c| VesselEvent::Command {
            drone: c.header.drone,
            kind: c.kind,
        }));

        // Sensors -> estimator -> broadcast, at the rates that the landing drone's link carries.
        self.node.prioritise(self.arbiter.landing(now));
        ComputerOut {
            vessel: self.node.step(now, &input.vessel),
            grant: granted.grant,
            commands: relayed.commands,
            events,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{Header, ReasonCode};

    fn status(boot: u32, sequence: u32, state: State) -> Stamped<VesselClock, DroneStatus> {
        let status = DroneStatus {
            header: Header::new(1, 3, boot, sequence, Time::EPOCH),
            state,
            entered: Reason::plain(ReasonCode::Operator),
            battery: 0.5,
            ..DroneStatus::default()
        };
        Stamped::new(Time::EPOCH, status)
    }

    /// The events of a step.
    fn events(computer: &mut VesselComputer, t_s: f64, input: ComputerIn) -> Vec<String> {
        let out = computer.step(Time::from_secs(t_s), &input);
        out.events.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn vessel_computer_reports_each_change_once() {
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
}
