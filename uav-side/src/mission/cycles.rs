//! Unattended cycles from deck to deck: take-off, the autopilot's own mission, landing, and the next sortie.
//!
//! An order to take off starts them if `sorties_max` allows. After the climb-out the autopilot's own mission takes
//! over, from its beginning. When that is complete, when the battery requires it or on an order, the drone returns,
//! lands, and stands disarmed until it is ready: by `alight order ready`, or once a charger has raised its charge to
//! the limit. Each take-off needs the crew's clearance. A sortie must end disarmed on the deck without a finding.
//! Otherwise the cycles end, the mission keeps reporting the reason, and only another order to take off starts them
//! again.
//!
//! This module holds the cycles' state; `turnaround` holds the transitions.

use alight_shared::{
    msg::{
        Reason,
        ReasonCode::{ArmedAgain, Disarmed, HardContact, NoMoment, NotOnDeck, SortiesDone},
        State,
    },
    time::{DroneClock, Time},
};

use super::situation::{ControlState, Situation};
use crate::mission_config::MissionConfig;

/// Maximum number of consecutive take-offs without a suitable lift-off time.
const MOMENTS: u32 = 3;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cycles {
    pub(super) on: bool,
    /// Number of sorties under all orders since the process started.
    pub(super) sorties: u32,
    pub(super) ended: Option<Reason>,
    /// Whether an operator has confirmed the next sortie.
    pub(super) ready: bool,
    pub(super) charged: Option<Time<DroneClock>>,
    pub(super) tries: u32,
}

impl Cycles {
    pub(super) fn begun(self, c: &MissionConfig) -> Cycles {
        let on = self.sorties < c.sorties_max;
        Cycles {
            on,
            // The order also confirms that the drone is ready.
            ready: on,
            sorties: self.sorties,
            ..Cycles::default()
        }
    }
    /// Numbers of sorties begun and planned; the latter is 0 without cycles.
    pub(super) fn count(&self, c: &MissionConfig) -> [u32; 2] {
        [self.sorties, if self.on { c.sorties_max } else { 0 }]
    }
    pub(super) fn rejects_ready(&self, s: &Situation, c: &MissionConfig) -> Option<Reason> {
        let none = || Reason::new(SortiesDone, self.sorties.into(), c.sorties_max.into());
        if !self.on {
            return Some(none());
        }
        (s.flight != ControlState::Disarmed).then(|| NotOnDeck.into())
    }
    pub(super) fn end(&mut self, why: Reason) {
        if self.on {
            (self.on, self.ended) = (false, Some(why));
        }
    }
    pub(super) fn leave(&mut self) {
        self.sorties = self.sorties.saturating_add(1);
        (self.ready, self.charged, self.tries) = (false, None, 0);
    }
    pub(super) fn follow(&mut self, before: State, after: State, why: Reason) {
        let is_anothers = before == State::StandDown && why.code != Disarmed;
        let ends = after == State::GaveUp
            || after == State::Landed && why.code == HardContact
            || after == State::Idle && (why.code == ArmedAgain || is_anothers);
        let stops = matches!(after, State::Idle | State::StandDown) && before.is_take_off();
        self.tries = self.tries.saturating_add(u32::from(stops && !ends));
        if ends || stops && (why.code != NoMoment || self.tries > MOMENTS) {
            self.end(why);
        }
    }
}
