//! The vessel's newest grant: who has the deck, and the course that her helm states.

use alight_shared::msg::{Course, DECK_CLOSED, DeckGrant, Reason, ReasonCode};
use alight_shared::time::{DroneClock, Time};
use alight_shared::topics;

use crate::mission_config::MissionConfig;

/// Who has the deck by the vessel's newest grant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reservation {
    /// No reservation is made: one drone, one deck.
    NotNeeded,
    Ours,
    /// That drone's; 0: free; [`DECK_CLOSED`]: closed.
    Others(u32),
    /// The newest grant is this old, s.
    Unknown(f64),
}

impl Reservation {
    /// From the newest grant; `own` is our number.
    pub fn of(
        grant: Option<&DeckGrant<DroneClock>>,
        own: u32,
        now: Time<DroneClock>,
        config: &MissionConfig,
    ) -> Self {
        let age_s = grant.map_or(f64::INFINITY, |g| (now - g.header.at).secs());
        let fresh = age_s <= topics::DECK.stale_after.secs();
        // A deck that is closed is closed to everybody.
        let closed = grant.is_some_and(|g| fresh && g.owner == DECK_CLOSED);
        if !config.reservation_required && !closed {
            return Reservation::NotNeeded;
        }
        match grant {
            Some(g) if fresh => {
                if g.owner == own && !matches!(own, 0 | DECK_CLOSED) {
                    Reservation::Ours
                } else {
                    Reservation::Others(g.owner)
                }
            }
            Some(_) | None => Reservation::Unknown(age_s),
        }
    }
    /// Why no descent may begin.
    pub fn rejection(self) -> Option<Reason> {
        match self {
            Reservation::NotNeeded | Reservation::Ours => None,
            Reservation::Others(holder) => {
                Some(Reason::new(ReasonCode::DeckReserved, f64::from(holder), 0.0))
            }
            Reservation::Unknown(age_s) => Some(Reason::new(
                ReasonCode::DeckGrantStale,
                age_s,
                topics::DECK.stale_after.secs(),
            )),
        }
    }
    /// Why a descent that has begun is broken off. A silent radio is not a reason, since the vessel keeps
    /// the deck for us for longer than a descent takes.
    pub fn lost(self) -> Option<Reason> {
        match self {
            Reservation::Others(holder) if holder != 0 => self.rejection(),
            Reservation::Others(_) | Reservation::NotNeeded | Reservation::Ours | Reservation::Unknown(_) => {
                None
            }
        }
    }
}

/// Vessel's course as the helm states it at `now`. A promise lasts as long as it was given for, whether or not it is
/// repeated; a turn that is not repeated is not known any more.
pub fn stated_course(grant: Option<&DeckGrant<DroneClock>>, now: Time<DroneClock>) -> Course {
    let Some(grant) = grant else {
        return Course::Unknown;
    };
    let age = now - grant.header.at;
    match grant.course {
        Course::Turning if age > topics::DECK.stale_after => Course::Unknown,
        course @ (Course::Unknown | Course::Steady(_) | Course::Turning) => course.after(age.secs()),
    }
}
