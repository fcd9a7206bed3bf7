//! Kinds of flight in a storm: the drone's start, the nodes' permissions, and the states in which faults begin.

use alight_shared::msg::{State, VesselLevel};
use serde::{Deserialize, Serialize};

use crate::{
    harness::scenario::{NodeConfigs, Scenario},
    sensors::beacon::BeaconConfig,
};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FlightKind {
    /// Landing from a hover next to the vessel.
    #[default]
    Landing,
    /// Take-off from the deck to the final hold.
    TakeOff,
    /// Take-off, a flight in the autopilot's own mission, and a return to the deck without an order.
    Sortie,
    /// One minute at a station, then a landing.
    Station,
    /// Landing on a silent vessel with a beacon.
    Beacon,
    /// Landing on a silent vessel by the deck's tags alone.
    TagAlone,
    /// Landing, take-off, landing.
    Cycles,
    /// Landing ordered by a ground station over MAVLink.
    Mavlink,
}

/// State in which faults begin, its relative frequency, and the maximum delay after entry, s.
pub(super) type PlannedPhase = (State, u32, f64);

const LANDS: [PlannedPhase; 8] = [
    (State::GetAltitude, 1, 3.0),
    (State::Approach, 2, 8.0),
    (State::Tracking, 3, 4.0),
    (State::TrackingStable, 3, 2.0),
    (State::Descent, 7, 4.0),
    (State::Flare, 5, 1.2),
    (State::Landed, 3, 3.0),
    (State::Hold, 1, 3.0),
];
const TAKES_OFF: [PlannedPhase; 7] = [
    (State::Preparing, 2, 2.0),
    (State::Countdown, 3, 4.5),
    (State::SpinUp, 5, 4.0),
    (State::TakeOff, 6, 1.5),
    (State::ClimbOut, 4, 8.0),
    (State::StandDown, 1, 1.0),
    (State::Hold, 2, 5.0),
];
/// `Idle` is the autopilot's own mission.
const SORTIE: [PlannedPhase; 13] = [
    (State::Preparing, 1, 2.0),
    (State::Countdown, 1, 4.5),
    (State::SpinUp, 2, 4.0),
    (State::TakeOff, 2, 1.5),
    (State::ClimbOut, 2, 8.0),
    (State::Hold, 2, 5.0),
    (State::Idle, 5, 20.0),
    (State::GetAltitude, 1, 3.0),
    (State::Approach, 2, 8.0),
    (State::Tracking, 2, 4.0),
    (State::Descent, 4, 4.0),
    (State::Flare, 3, 1.2),
    (State::Landed, 2, 3.0),
];
const STATION: [PlannedPhase; 8] = [
    (State::Hold, 8, 60.0),
    (State::GetAltitude, 1, 3.0),
    (State::Approach, 2, 8.0),
    (State::Tracking, 2, 4.0),
    (State::TrackingStable, 2, 2.0),
    (State::Descent, 4, 4.0),
    (State::Flare, 3, 1.2),
    (State::Landed, 2, 3.0),
];
const BEACON: [PlannedPhase; 9] = [
    (State::GetAltitude, 1, 3.0),
    (State::Approach, 4, 12.0),
    (State::Search, 5, 10.0),
    (State::Tracking, 3, 4.0),
    (State::TrackingStable, 3, 2.0),
    (State::Descent, 6, 4.0),
    (State::Flare, 4, 1.2),
    (State::Landed, 2, 3.0),
    (State::Hold, 1, 3.0),
];
const TAG_ALONE: [PlannedPhase; 6] = [
    (State::Tracking, 4, 8.0),
    (State::TrackingStable, 3, 2.0),
    (State::Descent, 7, 4.0),
    (State::Flare, 5, 1.2),
    (State::Landed, 3, 3.0),
    (State::Hold, 2, 3.0),
];
const CYCLES: [PlannedPhase; 12] = [
    (State::Approach, 1, 8.0),
    (State::Tracking, 2, 4.0),
    (State::TrackingStable, 2, 2.0),
    (State::Descent, 4, 4.0),
    (State::Flare, 3, 1.2),
    (State::Landed, 4, 6.0),
    (State::Preparing, 2, 2.0),
    (State::Countdown, 2, 4.5),
    (State::SpinUp, 3, 4.0),
    (State::TakeOff, 3, 1.5),
    (State::ClimbOut, 2, 8.0),
    (State::Hold, 2, 5.0),
];

/// Time on the deck before a take-off, s; long enough to align the heading.
const STANDS_S: f64 = 20.0;

impl FlightKind {
    pub const ALL: [FlightKind; 8] = [
        FlightKind::Landing,
        FlightKind::TakeOff,
        FlightKind::Sortie,
        FlightKind::Station,
        FlightKind::Beacon,
        FlightKind::TagAlone,
        FlightKind::Cycles,
        FlightKind::Mavlink,
    ];

    pub fn states(self) -> impl Iterator<Item = State> {
        self.rows().iter().map(|(state, ..)| *state)
    }
    pub(super) const fn rows(self) -> &'static [PlannedPhase] {
        match self {
            FlightKind::Landing | FlightKind::Mavlink => &LANDS,
            FlightKind::TakeOff => &TAKES_OFF,
            FlightKind::Sortie => &SORTIE,
            FlightKind::Station => &STATION,
            FlightKind::Beacon => &BEACON,
            FlightKind::TagAlone => &TAG_ALONE,
            FlightKind::Cycles => &CYCLES,
        }
    }
    /// Relative frequency; a third of the flights are landings.
    pub(super) fn parts(&self) -> u32 {
        if *self == FlightKind::Landing { 4 } else { 1 }
    }
    pub(super) const fn takes_off(self) -> bool {
        matches!(
            self,
            FlightKind::TakeOff | FlightKind::Sortie | FlightKind::Cycles
        )
    }
    pub(super) const fn is_silent(self) -> bool {
        matches!(self, FlightKind::Beacon | FlightKind::TagAlone)
    }
    /// Whether a drone with a low battery may not know the deck's position. It then lands at its next landing
    /// place, which is in the water here.
    pub(super) const fn may_land_elsewhere(self) -> bool {
        self.is_silent() || matches!(self, FlightKind::Sortie)
    }
    pub(super) const fn most_drones(self) -> u8 {
        match self {
            FlightKind::Landing | FlightKind::Mavlink => 2,
            FlightKind::TakeOff
            | FlightKind::Sortie
            | FlightKind::Station
            | FlightKind::Beacon
            | FlightKind::TagAlone
            | FlightKind::Cycles => 1,
        }
    }
    /// Time limits, s: from the last fault and order until the drone has landed or waits for a stated reason;
    /// from the first order until the flight ends.
    pub(super) const fn limits_s(self) -> [f64; 2] {
        match self {
            FlightKind::Landing | FlightKind::Station | FlightKind::TagAlone | FlightKind::Mavlink => {
                [120.0, 300.0]
            }
            FlightKind::TakeOff => [120.0, 420.0],
            FlightKind::Beacon => [180.0, 420.0],
            FlightKind::Sortie | FlightKind::Cycles => [150.0, 480.0],
        }
    }

    pub(super) fn set_up(self, scenario: &mut Scenario, nodes: &mut NodeConfigs) {
        match self {
            FlightKind::Landing | FlightKind::Station | FlightKind::Cycles => {}
            FlightKind::TakeOff | FlightKind::Sortie => {
                scenario.start.on_deck = true;
                scenario.start.hover_s = STANDS_S;
            }
            FlightKind::Beacon => {
                scenario.start.distance_m = [80.0, 120.0];
                scenario.start.height_m = [20.0, 30.0];
                scenario.sensors.beacon = Some(BeaconConfig::default());
                nodes.drone.mission.min_vessel = VesselLevel::Beacon;
            }
            FlightKind::TagAlone => {
                scenario.start.distance_m = [0.0, 4.0];
                scenario.start.height_m = [7.0, 10.0];
                nodes.drone.mission.min_vessel = VesselLevel::Tag;
            }
            FlightKind::Mavlink => nodes.autopilot.unsigned_orders = true,
        }
        if self.is_silent() {
            scenario.radio.loss = 1.0;
        }
        if self.takes_off() {
            nodes.drone.mission.takeoff = true;
            nodes.drone.mission.reservation_required = true;
        }
    }
}
