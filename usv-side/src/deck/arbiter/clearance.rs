//! The crew's clearances for take-offs, and their ends: a clearance is only as recent as the last look at the drone.
//!
//! Time ends each. So does anything that shows somebody at the deck since: the deck closed by order, switch or hatch, a weight that
//! came to it or was taken off it ([`crate::deck::DeckConfig::occupancy_sensor`]), a battery that was changed, a computer of the drone that was
//! restarted. Whoever ended it is asked again.

use core::fmt;

use alight_shared::msg::{DroneStatus, State, TAKE_OFF_CLEARANCE_S, TAKE_OFF_STANDING_S, TAKE_OFF_WATCH_S};
use alight_shared::time::{Span, Time, VesselClock};
use serde::{Deserialize, Serialize};

use super::{DeckArbiter, Drone, Reading};
use crate::deck::MAX_DRONES;
use crate::deck::checkpoint::Claim;

/// A gauge recovers by less than this after a flight, and a charger is no faster than this: 0 to 1, and 1/s. A battery whose
/// charge rises by more was changed.
const RECOVERS: f64 = 0.15;
const CHARGES_PER_S: f64 = 0.002;

/// Why a clearance has ended that was not used and not taken back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ClearanceEnd {
    /// It was given too long ago.
    Time,
    /// The drone's battery was changed.
    Battery,
    /// The drone's computer was restarted.
    Computer,
    /// The sensor shows that the drone was lifted.
    Lifted,
}

impl fmt::Display for ClearanceEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ClearanceEnd::Time => "it was given too long ago",
            ClearanceEnd::Battery => "its battery was changed",
            ClearanceEnd::Computer => "its computer was restarted",
            ClearanceEnd::Lifted => "the deck's sensor shows that it was lifted",
        })
    }
}

/// The crew's clearance that a drone may take off.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clearance {
    drone: u32,
    until: Time<VesselClock>,
    /// For each of its take-offs until then; None: for one.
    watch: Option<Time<VesselClock>>,
}

impl Clearance {
    /// For one take-off.
    pub(super) fn once(drone: u32, now: Time<VesselClock>) -> Clearance {
        Clearance {
            drone,
            until: now + Span::from_secs(TAKE_OFF_CLEARANCE_S),
            watch: None,
        }
    }
    /// For each, for as long as whoever gave it watches.
    pub(super) fn standing(drone: u32, now: Time<VesselClock>) -> Clearance {
        let watch = now + Span::from_secs(TAKE_OFF_WATCH_S);
        Clearance {
            drone,
            until: watch,
            watch: Some(watch),
        }
    }
    /// Between two states of its drone a take-off ended that uses it up.
    fn ends(&self, before: State, now: State) -> bool {
        match self.watch {
            None => ends_take_off(before, now),
            Some(_) => stops_take_off(before, now),
        }
    }
}

/// Between these two states of a drone its take-off ended: whoever goes to it then meets no second one by the clearance for the first.
/// One whose countdown is stopped by a check goes on.
fn ends_take_off(before: State, now: State) -> bool {
    before.is_take_off() && !now.is_take_off() || stops_take_off(before, now)
}
/// Between these two states of a drone its take-off was stopped on the deck: the crew may walk up to it, and a standing clearance
/// is to be given again.
fn stops_take_off(before: State, now: State) -> bool {
    let counted = matches!(before, State::Countdown | State::SpinUp) && !now.is_take_off();
    counted || now == State::StandDown && before != now
}

/// The most charge that a drone which stands on the deck has without the crew, since a status.
#[derive(Clone, Copy, Debug)]
pub(super) struct StandingCharge {
    at: Time<VesselClock>,
    charge: f64,
}

impl StandingCharge {
    /// With this status of a drone that stands there, and whether its battery was changed.
    pub(super) fn with(
        before: Option<StandingCharge>,
        now: Time<VesselClock>,
        battery: Option<f64>,
    ) -> (Option<StandingCharge>, bool) {
        let Some(charge) = battery else {
            return (before, false);
        };
        let charged = |b: StandingCharge| b.charge + CHARGES_PER_S * (now - b.at).secs();
        let most = before.map_or(charge, charged);
        let changed = charge > most + RECOVERS;
        let charge = if changed { charge } else { charge.min(most) };
        (Some(StandingCharge { at: now, charge }), changed)
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct Clearances {
    given: Vec<Clearance>,
    /// The drone that it is published for.
    leaves: Option<u32>,
    /// Clearances that have ended since the last call.
    ended: Vec<(u32, ClearanceEnd)>,
}

impl Clearances {
    /// A new one replaces the former for its drone.
    pub(super) fn give(&mut self, clearance: Clearance) {
        self.given.retain(|c| c.drone != clearance.drone);
        if self.given.len() < MAX_DRONES {
            self.given.push(clearance);
        }
    }
    /// The drone's state has changed.
    pub(super) fn follow(&mut self, drone: u32, before: State, now: State) {
        self.given.retain(|c| c.drone != drone || !c.ends(before, now));
    }
    fn end(&mut self, why: ClearanceEnd, ends: impl Fn(&Clearance) -> bool) {
        let ended = self.given.iter().filter(|c| ends(c)).map(|c| (c.drone, why));
        self.ended.extend(ended);
        self.given.retain(|c| !ends(c));
    }
    /// Whether the drone `named`, which stands on the deck, may take off.
    fn clears(&mut self, now: Time<VesselClock>, named: Option<u32>) -> bool {
        self.end(ClearanceEnd::Time, |c| now > c.until);
        let clears = self.given.iter().find(|c| Some(c.drone) == named);
        let clears = clears.map(|c| c.drone);
        if let Some(left) = self.leaves.filter(|left| Some(*left) != clears) {
            // It has left: a clearance that does not stand was for one take-off.
            self.given.retain(|c| c.drone != left || c.watch.is_some());
        }
        self.leaves = clears;
        clears.is_some()
    }
    /// A standing one lasts for `stands` of each stay of its drone on the deck.
    fn bound(&mut self, now: Time<VesselClock>, stands: Span, on_deck: impl Fn(u32) -> bool) {
        for c in &mut self.given {
            let Some(watch) = c.watch else { continue };
            let latest = watch.min(now + stands);
            c.until = if on_deck(c.drone) {
                c.until.min(latest)
            } else {
                latest
            };
        }
    }
}

impl DeckArbiter {
    /// The clearances that have ended since this was asked, and why: neither used nor taken back.
    pub(crate) fn ended_clearances(&mut self) -> Vec<(u32, ClearanceEnd)> {
        core::mem::take(&mut self.cleared.ended)
    }
    /// Whether the deck's owner may take off: it stands there, and the crew has cleared the deck for it since.
    pub(super) fn clears_take_off(&mut self, now: Time<VesselClock>) -> bool {
        if self.closed(now).is_some() {
            self.cleared.given.clear();
        }
        let stands = |d: &&Drone| d.claim == Claim::OnDeck && Some(d.header.drone) == self.owner;
        let owner = self.drones.iter().find(stands).filter(|d| !d.is_double());
        let named = owner.map(|d| d.header.drone);
        // A watched hatch or weight shows who comes; without either the clearance is the only evidence.
        let watched = !self.config.occupancy_sensor.is_empty() || !self.config.crew_switch.is_empty();
        let limit_s = if watched {
            TAKE_OFF_WATCH_S
        } else {
            TAKE_OFF_STANDING_S
        };
        let on_deck = |drone: u32| {
            let of_drone = self.drones.iter().find(|d| d.header.drone == drone);
            of_drone.is_some_and(|d| d.claim == Claim::OnDeck)
        };
        self.cleared.bound(now, Span::from_secs(limit_s), on_deck);
        self.cleared.clears(now, named)
    }
    /// A status of a drone that stood on the deck before, too: whether somebody has been at it meanwhile.
    pub(super) fn watch_standing(&mut self, status: &DroneStatus, restarted: bool, changed: bool) {
        let why = match (changed, restarted) {
            (true, _) => ClearanceEnd::Battery,
            (false, true) => ClearanceEnd::Computer,
            (false, false) => return,
        };
        self.cleared.end(why, |c| c.drone == status.header.drone);
    }
    /// A new level of the sensor: what stands there was lifted, unless its rotors may have done that.
    pub(super) fn watch_sensor(&mut self, before: Option<Reading>, occupied: Option<bool>) {
        let fell = before.is_some_and(|r| r.level) && occupied == Some(false);
        let stands = |d: &&Drone| d.claim == Claim::OnDeck && d.state != State::SpinUp;
        if fell {
            let stand: Vec<u32> = self
                .drones
                .iter()
                .filter(stands)
                .map(|d| d.header.drone)
                .collect();
            self.cleared
                .end(ClearanceEnd::Lifted, |c| stand.contains(&c.drone));
        }
    }
}
