//! Take-off clearances of the crew, and the conditions that end them.
//!
//! The crew clears a take-off after looking at the drone. The clearance ends after a time, and at any sign that
//! somebody has been at the deck since: the deck was closed by order, switch or hatch, a weight was put on or removed
//! ([`crate::deck::DeckConfig::occupancy_sensor`]), a battery was changed, or a drone's computer was restarted. A new
//! clearance is then needed.

use core::fmt;

use alight_shared::{
    msg::{DroneStatus, State, TAKE_OFF_CLEARANCE_S, TAKE_OFF_STANDING_S, TAKE_OFF_WATCH_S},
    time::{Span, VesselTime},
};
use serde::{Deserialize, Serialize};

use super::{DeckArbiter, Drone, Reading};
use crate::deck::{MAX_DRONES, checkpoint::Claim};

/// Maximum recovery of a gauge after a flight, 0 to 1, and maximum rate of a charger, 1/s: a larger increase
/// is a battery change.
const RECOVERS: f64 = 0.15;
const CHARGES_PER_S: f64 = 0.002;

/// Reason why a clearance ended without being used or withdrawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ClearanceEnd {
    Time,
    Battery,
    Computer,
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

#[derive(Clone, Copy, Debug)]
pub(super) struct Clearance {
    drone: u32,
    until: VesselTime,
    /// End of a standing clearance; None: the clearance is for one take-off.
    watch: Option<VesselTime>,
}

impl Clearance {
    pub(super) fn once(drone: u32, now: VesselTime) -> Clearance {
        Clearance {
            drone,
            until: now + Span::from_secs(TAKE_OFF_CLEARANCE_S),
            watch: None,
        }
    }
    pub(super) fn standing(drone: u32, now: VesselTime) -> Clearance {
        let watch = now + Span::from_secs(TAKE_OFF_WATCH_S);
        Clearance {
            drone,
            until: watch,
            watch: Some(watch),
        }
    }
    /// Whether this change of state uses the clearance up, because a take-off ended.
    fn ends(&self, before: State, now: State) -> bool {
        match self.watch {
            None => ends_take_off(before, now),
            Some(_) => stops_take_off(before, now),
        }
    }
}

/// Whether a take-off ended between these states: the clearance permits no second one, because somebody may
/// approach the drone. A countdown that a check interrupts does not count.
fn ends_take_off(before: State, now: State) -> bool {
    before.is_take_off() && !now.is_take_off() || stops_take_off(before, now)
}
/// Whether a take-off stopped on the deck between these states: the crew may approach the drone, so even a
/// standing clearance ends.
fn stops_take_off(before: State, now: State) -> bool {
    let counted = matches!(before, State::Countdown | State::SpinUp) && !now.is_take_off();
    counted || now == State::StandDown && before != now
}

/// Maximum charge that a drone left alone on the deck can have, since a status.
#[derive(Clone, Copy, Debug)]
pub(super) struct StandingCharge {
    at: VesselTime,
    charge: f64,
}

impl StandingCharge {
    /// Adds a status of a drone on the deck. Also returns whether the drone's battery was changed.
    pub(super) fn with(
        before: Option<StandingCharge>,
        now: VesselTime,
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
    leaves: Option<u32>,
    ended: Vec<(u32, ClearanceEnd)>,
}

impl Clearances {
    /// Adds a clearance in place of the drone's previous one.
    pub(super) fn give(&mut self, clearance: Clearance) {
        self.given.retain(|c| c.drone != clearance.drone);
        if self.given.len() < MAX_DRONES {
            self.given.push(clearance);
        }
    }
    pub(super) fn follow(&mut self, drone: u32, before: State, now: State) {
        self.given.retain(|c| c.drone != drone || !c.ends(before, now));
    }
    fn end(&mut self, why: ClearanceEnd, ends: impl Fn(&Clearance) -> bool) {
        let ended = self.given.iter().filter(|c| ends(c)).map(|c| (c.drone, why));
        self.ended.extend(ended);
        self.given.retain(|c| !ends(c));
    }
    /// Whether the drone `named`, which stands on the deck, may take off.
    fn clears(&mut self, now: VesselTime, named: Option<u32>) -> bool {
        self.end(ClearanceEnd::Time, |c| now > c.until);
        let clears = self.given.iter().find(|c| Some(c.drone) == named);
        let clears = clears.map(|c| c.drone);
        if let Some(left) = self.leaves.filter(|left| Some(*left) != clears) {
            // The drone has left the deck: a clearance for one take-off is used up.
            self.given.retain(|c| c.drone != left || c.watch.is_some());
        }
        self.leaves = clears;
        clears.is_some()
    }
    /// Limits each standing clearance to the duration `stands` per stay of its drone on the deck.
    fn bound(&mut self, now: VesselTime, stands: Span, on_deck: impl Fn(u32) -> bool) {
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
    /// Clearances that ended since the last call without being used or withdrawn, with reasons.
    pub(crate) fn ended_clearances(&mut self) -> Vec<(u32, ClearanceEnd)> {
        core::mem::take(&mut self.cleared.ended)
    }
    /// Whether the deck's owner stands on the deck and may take off with a clearance given since it arrived.
    pub(super) fn clears_take_off(&mut self, now: VesselTime) -> bool {
        if self.closed(now).is_some() {
            self.cleared.given.clear();
        }
        let stands = |d: &&Drone| d.claim == Claim::OnDeck && Some(d.header.drone) == self.owner;
        let owner = self.drones.iter().find(stands).filter(|d| !d.is_double());
        let named = owner.map(|d| d.header.drone);
        // Without a hatch switch or weight sensor, the clearance is the only evidence of a clear deck.
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
    /// Checks the status of a drone that remains on the deck for signs that somebody has been at the drone.
    pub(super) fn watch_standing(&mut self, status: &DroneStatus, restarted: bool, changed: bool) {
        let why = match (changed, restarted) {
            (true, _) => ClearanceEnd::Battery,
            (false, true) => ClearanceEnd::Computer,
            (false, false) => return,
        };
        self.cleared.end(why, |c| c.drone == status.header.drone);
    }
    /// Ends the clearance of a drone if a new sensor level shows that it was lifted other than by its own rotors.
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
