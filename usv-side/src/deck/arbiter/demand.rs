//! Requests of the drones to the vessel's helm.

use alight_shared::msg::State;
use alight_shared::time::{Time, VesselClock};

use super::{Claim, DeckArbiter, Drone};
use crate::demand::Demand;

impl DeckArbiter {
    /// The most that a drone wants of the helm.
    pub fn demand(&self, now: Time<VesselClock>) -> Demand {
        let wants = self.drones.iter().map(|d| self.wants(now, d));
        wants.max_by_key(|d| *d as u8).unwrap_or_default()
    }
    /// The drone that comes or descends, where one does.
    pub fn comes(&self, now: Time<VesselClock>) -> Option<u32> {
        let wants = self.drones.iter().map(|d| (self.wants(now, d), d.header.drone));
        let comes = wants.filter(|(wants, _)| matches!(wants, Demand::Comes | Demand::Descends));
        comes
            .max_by_key(|(wants, _)| *wants as u8)
            .map(|(_, drone)| drone)
    }
    /// The request of a drone: the deck's owner, or one that comes while the deck is free. One on its way down wants it
    /// for as long as a descent lasts, silent or not, and so does an owner that falls silent above the deck, where it may
    /// begin one without being received.
    fn wants(&self, now: Time<VesselClock>, d: &Drone) -> Demand {
        let lasts = (now - d.received).secs() <= self.config.status_timeout_s;
        let owns = self.owner == Some(d.header.drone);
        let free = || self.owner.is_none() && !self.drones.iter().any(|d| d.claim == Claim::OnDeck);
        let fresh = d.is_fresh(now);
        match d.claim {
            Claim::Landing if lasts && is_on_its_way(d.state) => Demand::Descends,
            Claim::OnDeck if owns => Self::on_deck(d, fresh, lasts),
            Claim::Requesting | Claim::Above if fresh && d.flies && (owns || free()) => Demand::Comes,
            Claim::Requesting | Claim::Above if !fresh && lasts && d.flies && owns && may_begin(d.state) => {
                Demand::Descends
            }
            Claim::Away | Claim::Requesting | Claim::Above | Claim::Landing | Claim::OnDeck => {
                Demand::Nothing
            }
        }
    }
    /// Request of a drone on the deck: a better course while it prepares its take-off, and from the countdown on none but
    /// the one that is.
    fn on_deck(d: &Drone, fresh: bool, lasts: bool) -> Demand {
        let leaves = matches!(d.state, State::Countdown | State::SpinUp | State::TakeOff);
        if d.state == State::Preparing && fresh {
            Demand::Comes
        } else if leaves && lasts {
            Demand::Descends
        } else {
            Demand::Stands
        }
    }
    /// The helm states by order or switch that the vessel turns or may turn.
    pub fn is_turning(&self, now: Time<VesselClock>) -> bool {
        self.course.is_turning(now, &self.config)
    }
}

/// It goes down or takes off, as far as is known. One that broke off may keep its claim near the deck, and needs no course.
fn is_on_its_way(state: State) -> bool {
    let leaves = state.is_take_off() && state != State::Preparing;
    leaves || matches!(state, State::Descent | State::Flare)
}

/// A descent begins from this state.
fn may_begin(state: State) -> bool {
    matches!(state, State::Tracking | State::TrackingStable)
}
