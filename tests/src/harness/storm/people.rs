//! People in a storm's flight (operator, crew, skipper, pilot) and their orders. Each order follows when the
//! previous one has ended as intended. An operation that somebody else stopped is not resumed, except a
//! take-off that ended on the deck.

use alight_shared::msg::{CommandKind, DeckOrder, ReasonCode, State, Station};
use alight_uav::autopilot::message::{Address, CommandLong, MavCmd};
use nalgebra::Vector3;

use super::{FaultKind, FlightKind};
use crate::{
    autopilots::simulated::{SimulatedAutopilot, own_mission_mode},
    harness::{outcome::FALSE_STOP_M, rig::Rig},
};

/// Time from the crew's clearance of the deck to the order to take off, s.
const CLEARED_S: f64 = 1.0;
/// Time from the start to the order to go to a station, s; the link finds the autopilot earlier.
const FOUND_S: f64 = 5.0;
/// Time from an order to a check of its result, s.
const LOOKS_S: f64 = 5.0;
/// Time that a drone stands on the deck, disarmed, before the next order, s.
const STANDS_S: f64 = 3.0;
/// Distance from the deck's centre within which a drone counts as on the deck, m.
const ON_DECK_M: f64 = 2.0;
/// Maximum number of orders for a take-off that ends on the deck, and for a rejected station.
const TRIES: u32 = 3;
const REPEATS_S: f64 = 1.0;
/// Size of the autopilot's own mission, and its height above the first position, m.
const FAR_M: f64 = 40.0;
const HIGH_M: f64 = 20.0;
const GROUND_STATION: Address = Address::new(255, 190);
/// Faults that are orders, with the corresponding MAVLink command of a ground station.
const BY_MAVLINK: [(FaultKind, MavCmd); 3] = [
    (FaultKind::Abort, MavCmd::MAV_CMD_USER_2),
    (FaultKind::Hold, MavCmd::MAV_CMD_USER_3),
    (FaultKind::OrderedAgain, MavCmd::MAV_CMD_USER_1),
];

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Step {
    #[default]
    Begins,
    Cleared,
    TakesOff,
    Away,
    Stays,
    /// A ground station repeats the order to land until it is accepted.
    Calls,
    /// A landing is ordered, or continues without an order.
    Lands,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct People {
    flight: FlightKind,
    step: Step,
    since_s: f64,
    /// Time of the last order, s after the start.
    ordered_s: f64,
    take_offs: u32,
    stations: u32,
    landings: u32,
    calls_s: f64,
}

impl People {
    pub(super) fn new(flight: FlightKind) -> People {
        People {
            flight,
            ..People::default()
        }
    }
    /// Time of the last action, or of the awaited event, s.
    pub(super) const fn since_s(&self) -> f64 {
        self.since_s
    }
    pub(super) const fn ordered_s(&self) -> f64 {
        self.ordered_s
    }
    fn waited_s(&self, rig: &Rig) -> f64 {
        rig.t_s() - self.since_s
    }

    pub(super) fn act(&mut self, rig: &mut Rig) {
        let next = match self.step {
            Step::Begins => self.begin(rig),
            Step::Cleared => (self.waited_s(rig) >= CLEARED_S).then(|| {
                rig.world.command(CommandKind::TakeOff);
                Step::TakesOff
            }),
            Step::TakesOff => self.after_take_off(rig),
            Step::Away => comes_back(rig).then_some(Step::Lands),
            Step::Stays => self.after_station(rig),
            Step::Calls => self.call(rig),
            Step::Lands => self.after_landing(rig),
        };
        if let Some(step) = next {
            self.step = step;
            self.since_s = rig.t_s();
        }
    }
    fn begin(&mut self, rig: &mut Rig) -> Option<Step> {
        match self.flight {
            FlightKind::Landing | FlightKind::Beacon | FlightKind::TagAlone | FlightKind::Cycles => {
                Some(self.land(rig))
            }
            FlightKind::TakeOff | FlightKind::Sortie => Some(self.clear(rig)),
            FlightKind::Station => (rig.t_s() >= FOUND_S).then(|| self.keep_station(rig)),
            FlightKind::Mavlink => Some(Step::Calls),
        }
    }
    fn land(&mut self, rig: &mut Rig) -> Step {
        rig.world.command(CommandKind::Land);
        self.ordered_s = rig.t_s();
        self.landings += 1;
        Step::Lands
    }
    fn clear(&mut self, rig: &mut Rig) -> Step {
        rig.world.deck_order(DeckOrder::TakeOff(1));
        self.ordered_s = rig.t_s();
        self.take_offs += 1;
        Step::Cleared
    }
    fn keep_station(&mut self, rig: &mut Rig) -> Step {
        let a_minute = Station {
            for_min: 1,
            ..Station::USUAL
        };
        rig.world.command(CommandKind::Station(a_minute));
        self.ordered_s = rig.t_s();
        self.stations += 1;
        Step::Stays
    }
    fn call(&mut self, rig: &mut Rig) -> Option<Step> {
        let waits = |k: &usize| rig.mission(*k).order.is_none();
        let waiting: Vec<usize> = (0..rig.world.drones().len()).filter(waits).collect();
        let t_s = rig.t_s();
        if t_s >= self.calls_s {
            self.calls_s = t_s + REPEATS_S;
            for k in &waiting {
                send(rig, *k, MavCmd::MAV_CMD_USER_1);
            }
        }
        waiting.is_empty().then_some(Step::Lands)
    }

    /// Continues after a take-off that reached its final hold; repeats the order if the take-off ended on the deck.
    fn after_take_off(&mut self, rig: &mut Rig) -> Option<Step> {
        if holds(rig) && rig.is_due(State::Hold, LOOKS_S) {
            return match self.flight {
                FlightKind::Sortie => Some(leave(rig)),
                FlightKind::Cycles => Some(self.land(rig)),
                FlightKind::TakeOff
                | FlightKind::Landing
                | FlightKind::Station
                | FlightKind::Beacon
                | FlightKind::TagAlone
                | FlightKind::Mavlink => None,
            };
        }
        let stopped = self.waited_s(rig) > LOOKS_S && stands(rig);
        (stopped && self.take_offs < TRIES).then(|| self.clear(rig))
    }
    fn after_station(&mut self, rig: &mut Rig) -> Option<Step> {
        if holds(rig) && rig.mission(0).entered.code == ReasonCode::StationOver {
            return Some(self.land(rig));
        }
        let rejected = self.waited_s(rig) > LOOKS_S && rig.first_entered_s(0, State::Hold).is_none();
        (rejected && self.stations < TRIES).then(|| self.keep_station(rig))
    }
    fn after_landing(&mut self, rig: &mut Rig) -> Option<Step> {
        let goes_again = self.flight == FlightKind::Cycles && self.landings == 1 && stands(rig);
        goes_again.then(|| self.clear(rig))
    }

    /// Gives a fault's order over MAVLink; returns false if the flight's orders use another path.
    pub(super) fn give(&self, rig: &mut Rig, kind: FaultKind) -> bool {
        let order = BY_MAVLINK.iter().find(|(k, _)| *k == kind);
        let order = order.filter(|_| self.flight == FlightKind::Mavlink);
        if let Some((_, number)) = order {
            send(rig, 0, *number);
        }
        order.is_some()
    }
    pub(super) fn is_over(&self, rig: &Rig) -> bool {
        match self.step {
            Step::Begins | Step::Cleared => false,
            Step::TakesOff => {
                self.take_offs >= TRIES && self.waited_s(rig) > LOOKS_S && !rig.state(0).stands_for_take_off()
            }
            Step::Lands => self.flight != FlightKind::Cycles || self.landings > 1,
            Step::Away | Step::Stays | Step::Calls => true,
        }
    }
    /// Whether a take-off has reached its final hold and no order follows.
    pub(super) fn is_up(&self, rig: &Rig) -> bool {
        let waits = matches!(
            rig.mission(0).waiting.code,
            ReasonCode::NotCommanded | ReasonCode::Operator
        );
        self.flight == FlightKind::TakeOff && rig.state(0) == State::Hold && waits
    }
}

fn holds(rig: &Rig) -> bool {
    rig.state(0) == State::Hold && rig.mission(0).waiting.code == ReasonCode::NotCommanded
}
fn stands(rig: &Rig) -> bool {
    let autopilot = rig.world.drones().first().and_then(|d| d.autopilot());
    let armed = autopilot.is_some_and(SimulatedAutopilot::armed);
    let o = rig.world.observation();
    let on_deck = o.feet_height_m().abs() < FALSE_STOP_M && o.horizontal_m < ON_DECK_M;
    let waits = matches!(rig.state(0), State::Idle | State::Landed);
    waits && on_deck && !armed && rig.t_s() > rig.entered_s(0) + STANDS_S
}
fn comes_back(rig: &Rig) -> bool {
    let state = rig.state(0);
    state.is_landing() && state != State::Hold
}
/// The pilot starts a mission with three waypoints in the autopilot.
fn leave(rig: &mut Rig) -> Step {
    if let Some(linked) = rig.world.linked(0) {
        let autopilot = &mut linked.autopilot;
        let here = autopilot.position();
        let places = [[-0.5, 0.0], [-1.0, 0.3], [-1.0, -0.1]];
        let at = |[north, east]: [f64; 2]| here + Vector3::new(north * FAR_M, east * FAR_M, -HIGH_M);
        autopilot.upload(places.map(at).to_vec());
        autopilot.choose(own_mission_mode(autopilot.firmware()));
    }
    Step::Away
}
fn send(rig: &mut Rig, k: usize, number: MavCmd) {
    let t = rig.world.physics().now();
    let component = rig.nodes.autopilot.component;
    if let Some(linked) = rig.world.linked(k) {
        let to = Address::new(linked.autopilot.address.system, component);
        let order = CommandLong::new(to, number, []).into();
        linked.up.send(t, GROUND_STATION, &order);
    }
}
