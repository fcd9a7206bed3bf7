//! Unattended cycles from deck to deck: take-off, the autopilot's own mission, landing, and again once the drone is ready.
//!
//! A take-off that is ordered begins them, where `sorties_max` allows. After the climb out the drone is handed to the autopilot's
//! own mission, from its beginning. It comes back when that is done, when the battery calls or when it is ordered back, lands, and
//! stands disarmed until it is ready: by `alight command ready`, or by the charge that a charger has brought it to. The crew's
//! clearance is asked for each time. What ends a sortie otherwise than on the deck, disarmed and without a finding, ends the
//! cycles, and is what the mission waits for from then on. Nothing but another order to take off begins them again.
//!
//! Here is what is remembered of them; `turnaround` has what the states do about it.

use alight_shared::msg::ReasonCode::{ArmedAgain, Disarmed, HardContact, NoMoment, NotOnDeck, SortiesDone};
use alight_shared::msg::{Reason, State};
use alight_shared::time::{DroneClock, Time};

use super::situation::{ControlState, Situation};
use crate::mission_config::MissionConfig;

/// Take-offs that find no moment are begun again so often.
const MOMENTS: u32 = 3;

/// Progress of the cycles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cycles {
    /// They go on.
    pub(super) on: bool,
    /// Sorties begun since the process began, by whichever order.
    pub(super) sorties: u32,
    /// Why they have ended.
    pub(super) ended: Option<Reason>,
    /// The order that the drone is ready was given for the next sortie.
    pub(super) ready: bool,
    /// The charge has been high enough since.
    pub(super) charged: Option<Time<DroneClock>>,
    /// Take-offs that found no moment since the drone stands there.
    pub(super) tries: u32,
}

impl Cycles {
    /// With an order to take off.
    pub(super) fn begun(self, c: &MissionConfig) -> Cycles {
        let on = self.sorties < c.sorties_max;
        Cycles {
            on,
            // Who orders it means this drone as it is.
            ready: on,
            sorties: self.sorties,
            ..Cycles::default()
        }
    }
    /// Sorties begun, and how many there are to be; the latter 0 where no cycles go on.
    pub(super) fn count(&self, c: &MissionConfig) -> [u32; 2] {
        [self.sorties, if self.on { c.sorties_max } else { 0 }]
    }
    /// Why an order that the drone is ready is rejected.
    pub(super) fn rejects_ready(&self, s: &Situation, c: &MissionConfig) -> Option<Reason> {
        let none = || Reason::new(SortiesDone, self.sorties.into(), c.sorties_max.into());
        if !self.on {
            return Some(none());
        }
        (s.flight != ControlState::Disarmed).then(|| NotOnDeck.into())
    }
    /// They end, where they go on.
    pub(super) fn end(&mut self, why: Reason) {
        if self.on {
            (self.on, self.ended) = (false, Some(why));
        }
    }
    /// The drone has left the deck.
    pub(super) fn leave(&mut self) {
        self.sorties = self.sorties.saturating_add(1);
        (self.ready, self.charged, self.tries) = (false, None, 0);
    }
    /// Follows a change from one state to another, whose reason may end them.
    pub(super) fn follow(&mut self, before: State, after: State, why: Reason) {
        // Somebody else has it now.
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
