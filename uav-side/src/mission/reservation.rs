//! The vessel's newest grant: owner of the deck, and course announced by the helm.

use alight_shared::{
    msg::{Course, DECK_CLOSED, DeckGrant, Reason, ReasonCode},
    time::{DroneClock, Time},
    topics,
};

use crate::mission_config::MissionConfig;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reservation {
    /// Reservations are not used, because there is one drone and one deck.
    NotNeeded,
    Ours,
    /// Number of the owner; 0 if free, [`DECK_CLOSED`] if closed.
    Others(u32),
    /// Age of the newest grant, which is stale, s.
    Unknown(f64),
}

impl Reservation {
    /// `own`: this drone's number.
    pub fn of(
        grant: Option<&DeckGrant<DroneClock>>,
        own: u32,
        now: Time<DroneClock>,
        config: &MissionConfig,
    ) -> Self {
        let age_s = grant.map_or(f64::INFINITY, |g| (now - g.header.at).secs());
        let fresh = age_s <= topics::DECK.stale_after.secs();
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
    /// Reason not to start a descent.
    pub fn rejection(self) -> Option<Reason> {
        match self {
            Reservation::NotNeeded | Reservation::Ours => None,
            Reservation::Others(owner) => Some(Reason::new(ReasonCode::DeckReserved, f64::from(owner), 0.0)),
            Reservation::Unknown(age_s) => Some(Reason::new(
                ReasonCode::DeckGrantStale,
                age_s,
                topics::DECK.stale_after.secs(),
            )),
        }
    }
    /// Reason to break off a descent. Radio silence is not a reason, because a reservation outlasts a descent.
    pub fn lost(self) -> Option<Reason> {
        match self {
            Reservation::Others(owner) if owner != 0 => self.rejection(),
            Reservation::Others(_) | Reservation::NotNeeded | Reservation::Ours | Reservation::Unknown(_) => {
                None
            }
        }
    }
}

/// Course announced by the helm. A steady course is valid for its stated duration; a turn must be repeated.
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
