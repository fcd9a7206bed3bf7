//! Claims of drones to the deck, by their statuses. A claim to it begins with one status; a remembered one ends by
//! sustained and consistent evidence, or by the crew.

use alight_shared::msg::{DroneStatus, LandedState, OWNER_ONLY_M, State};
use alight_shared::time::{Span, Time, VesselClock};

use super::FRESH;
use crate::deck::checkpoint::Claim;

/// A drone on the ground within this distance of the deck's centre stands on it, m: two GNSS receivers and half a deck.
const ON_DECK_M: f32 = 5.0;
/// One beyond this distance does not, and has left the owner's surroundings, m.
const FAR_M: f32 = OWNER_ONLY_M as f32;
/// Statuses in a row that have to agree before what is remembered of a drone ends: at 2 Hz two of seven may be lost.
const MIN_STATUSES: u32 = 5;
/// They have to agree for so long: one wrong position, or the jump of an estimator that it takes back, is shorter.
const MIN_TIME: Span = Span::from_millis(3000);

/// Statuses of one drone that agree, in a row.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClaimEvidence {
    since: Time<VesselClock>,
    newest: Time<VesselClock>,
    statuses: u32,
}

impl ClaimEvidence {
    /// With a status that shows it, or does not: then all of it is void, as it is after a silence.
    pub(super) fn with(before: Option<Self>, now: Time<VesselClock>, shows: bool) -> Option<Self> {
        if !shows {
            return None;
        }
        let goes_on = before.filter(|e| now - e.newest <= FRESH);
        let (since, statuses) = goes_on.map_or((now, 0), |e| (e.since, e.statuses));
        Some(ClaimEvidence {
            since,
            newest: now,
            statuses: statuses.saturating_add(1),
        })
    }
    pub(super) fn is_sustained(&self) -> bool {
        self.statuses >= MIN_STATUSES && self.newest - self.since >= MIN_TIME
    }
}

/// Beyond the owner's surroundings.
pub(super) fn is_far(status: &DroneStatus) -> bool {
    status.deck_distance_m.is_some_and(|d| d > FAR_M)
}

/// In the air by its autopilot, armed. A land detector that misses a heaving deck reports this of a landed drone as
/// well.
pub(super) fn flies(status: &DroneStatus) -> bool {
    status.armed && status.landed == LandedState::InAir
}

/// Shows that a drone which may have been on the deck has left it: armed, in the air, elsewhere, and not by its mission
/// on a deck.
pub(super) fn shows_departure(status: &DroneStatus) -> bool {
    flies(status) && is_far(status) && status.state != State::Landed
}

/// Shows that a drone which was switched on without a position stands elsewhere, or nowhere.
pub(super) fn shows_place(status: &DroneStatus) -> bool {
    flies(status) || status.deck_distance_m.is_some_and(|d| d > ON_DECK_M)
}

impl Claim {
    /// Claim by one status alone.
    pub(super) fn reported(status: &DroneStatus) -> Claim {
        let near = status.deck_distance_m.is_some_and(|d| d <= ON_DECK_M);
        match (status.state, status.landed) {
            (State::Landed, _) if !is_far(status) => Claim::OnDeck,
            (State::Descent | State::Flare | State::TakeOff | State::ClimbOut, _) => Claim::Landing,
            // For a drone that is to take off, by its place; and for one started there, while none reports otherwise.
            (State::Preparing | State::Countdown, _) if near => Claim::OnDeck,
            (State::SpinUp | State::StandDown, _) if !is_far(status) => Claim::OnDeck,
            (State::GetAltitude | State::Approach | State::Search | State::TrackingStable, _) => {
                Claim::Requesting
            }
            (State::Tracking, _) => Claim::Above,
            // Parked.
            (State::Idle | State::Hold | State::GaveUp, LandedState::OnGround) if near => Claim::OnDeck,
            (
                State::Idle
                | State::Landed
                | State::Hold
                | State::GaveUp
                | State::Preparing
                | State::Countdown
                | State::SpinUp
                | State::StandDown,
                LandedState::Unknown | LandedState::OnGround | LandedState::InAir,
            ) => Claim::Away,
        }
    }
    /// Claim after a status of a drone with this claim before; `departed`: by sustained evidence it has left.
    pub(super) fn of(status: &DroneStatus, before: Claim, departed: bool) -> Claim {
        let reported = Claim::reported(status);
        if before < Claim::Landing || reported >= Claim::Landing {
            return reported;
        }
        let on_ground = status.landed == LandedState::OnGround;
        // Switched on again, or its landing was given up when it stood already.
        if on_ground && !is_far(status) {
            return Claim::OnDeck;
        }
        // A mission that broke off flies and goes on; any other status is no proof that the drone is away.
        let goes_on = reported > Claim::Away && status.armed && !on_ground;
        if goes_on || departed { reported } else { before }
    }
    /// The newest status itself has the drone at the deck, whatever was before.
    pub(super) fn is_at_deck(status: &DroneStatus) -> bool {
        let within = status.deck_distance_m.is_some_and(|d| d <= FAR_M);
        within || Claim::reported(status) >= Claim::Landing
    }
}
