use core::fmt;

use alight_shared::msg::{
    Charge, CommandKind, DeckOrder, DroneStatus, FollowsAnother, Reason, Starved, State, still_armed,
};
use serde::{Deserialize, Serialize};

use crate::{deck::ClearanceEnd, sensors::MAX_REPEATED};

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum VesselEvent {
    /// A drone reports a new mission state, or reports for the first time.
    DroneState {
        drone: u32,
        state: State,
        entered: Reason,
        /// Battery of the drone, 0 to 1; None: not reported.
        battery: Option<f64>,
    },
    Command {
        drone: u32,
        kind: CommandKind,
    },
    DeckOrder(DeckOrder),
    /// A crew order arrived too late and was rejected.
    LateOrder(DeckOrder),
    /// A take-off clearance ended without being used or withdrawn.
    ClearanceEnded {
        drone: u32,
        why: ClearanceEnd,
    },
    DeckOwner(Option<u32>),
    /// A landed drone is still armed after its disarm should have finished.
    StillArmed {
        drone: u32,
        /// Time since its landing, s.
        for_s: f32,
    },
    /// An inertial sensor repeats one sample, or delivers new samples again.
    StuckImu {
        source: usize,
        stuck: bool,
    },
    /// A drone with a low battery waits for the deck, whose owner is silent.
    DeckStarved(Starved),
    /// A drone follows another computer with this vessel's identity.
    SecondComputer(FollowsAnother),
    DoubleNumber {
        drone: u32,
        boots: [u32; 2],
    },
}

impl VesselEvent {
    pub(super) fn of(status: &DroneStatus) -> VesselEvent {
        VesselEvent::DroneState {
            drone: status.header.drone,
            state: status.state,
            entered: status.entered,
            battery: status.battery,
        }
    }
    /// Whether the crew must act on it.
    pub fn is_warning(&self) -> bool {
        match self {
            VesselEvent::DoubleNumber { .. }
            | VesselEvent::SecondComputer(_)
            | VesselEvent::StillArmed { .. }
            | VesselEvent::LateOrder(_)
            | VesselEvent::DeckStarved(_) => true,
            VesselEvent::StuckImu { stuck, .. } => *stuck,
            VesselEvent::DroneState { .. }
            | VesselEvent::Command { .. }
            | VesselEvent::DeckOrder(_)
            | VesselEvent::ClearanceEnded { .. }
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
            VesselEvent::DeckOrder(DeckOrder::TakeOffStanding(drone)) => {
                write!(
                    f,
                    "crew order: deck cleared for take-offs of drone {drone} until someone approaches it"
                )
            }
            VesselEvent::DeckOrder(DeckOrder::Closed) => write!(f, "crew order: deck closed"),
            VesselEvent::DeckOrder(DeckOrder::Open) => write!(f, "crew order: deck open"),
            VesselEvent::DeckOrder(DeckOrder::Clear(drone)) => {
                write!(
                    f,
                    "crew order: deck open, drone {drone} is neither on it nor above it"
                )
            }
            VesselEvent::DeckOrder(DeckOrder::Steady(0)) => {
                write!(f, "crew order: course statement withdrawn")
            }
            VesselEvent::DeckOrder(DeckOrder::Steady(for_s)) => {
                write!(f, "crew order: course and speed are kept for {for_s} s")
            }
            VesselEvent::DeckOrder(DeckOrder::Turning) => write!(f, "crew order: the vessel turns"),
            VesselEvent::LateOrder(order) => {
                let order = VesselEvent::DeckOrder(*order);
                write!(f, "{order}: too late and rejected: give it again")
            }
            VesselEvent::ClearanceEnded { drone, why } => write!(
                f,
                "drone {drone} is no longer cleared for a take-off: {why}; make sure that no one is near it, then clear the deck again"
            ),
            VesselEvent::DeckOwner(Some(drone)) => write!(f, "the deck is reserved for drone {drone}"),
            VesselEvent::DeckOwner(None) => write!(f, "the deck is free"),
            VesselEvent::StillArmed { drone, for_s } => write!(f, "drone {drone}: {}", still_armed(*for_s)),
            VesselEvent::StuckImu { source, stuck: true } => write!(
                f,
                "inertial sensor {source} is STUCK: {MAX_REPEATED} samples in a row have the same numbers, and no \
                 more are used: power it off and on, check its cable and driver"
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
