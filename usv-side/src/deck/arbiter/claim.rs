//! Claims of drones to the deck. One status establishes a claim; lasting evidence or the crew ends it.

use alight_shared::{
    msg::{DroneStatus, LandedState, OWNER_ONLY_M, State},
    time::{Span, VesselTime},
};

use super::FRESH;
use crate::deck::checkpoint::Claim;

/// Distance from the deck's centre within which a drone on the ground stands on the deck, m: two GNSS errors
/// plus half a deck.
const ON_DECK_M: f32 = 5.0;
/// Distance from the deck's centre beyond which a drone has left the owner's space, m.
const FAR_M: f32 = OWNER_ONLY_M as f32;
/// Consecutive consistent statuses that end a claim; at 2 Hz two of seven may be lost.
const MIN_STATUSES: u32 = 5;
/// Duration of these statuses: longer than a wrong position lasts, or a jump that an estimator reverts.
const MIN_TIME: Span = Span::from_millis(3000);

#[derive(Clone, Copy, Debug)]
pub(super) struct ClaimEvidence {
    since: VesselTime,
    newest: VesselTime,
    statuses: u32,
}

impl ClaimEvidence {
    /// Adds a status that confirms the evidence if `shows`; otherwise, or after a silence, starts again.
    pub(super) fn with(before: Option<Self>, now: VesselTime, shows: bool) -> Option<Self> {
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

pub(super) fn is_far(status: &DroneStatus) -> bool {
    status.deck_distance_m.is_some_and(|d| d > FAR_M)
}

/// Whether the autopilot reports the drone armed and in the air, which its land detector on a heaving deck
/// may also report after a landing.
pub(super) fn flies(status: &DroneStatus) -> bool {
    status.armed && status.landed == LandedState::InAir
}

/// Whether the status shows a departure: armed, in the air, elsewhere, and not on a deck by its mission.
pub(super) fn shows_departure(status: &DroneStatus) -> bool {
    flies(status) && is_far(status) && status.state != State::Landed
}

/// Whether the status shows that a drone switched on without a position does not stand on the deck.
pub(super) fn shows_place(status: &DroneStatus) -> bool {
    flies(status) || status.deck_distance_m.is_some_and(|d| d > ON_DECK_M)
}

impl Claim {
    /// Claim shown by one status alone.
    pub(super) fn reported(status: &DroneStatus) -> Claim {
        let near = status.deck_distance_m.is_some_and(|d| d <= ON_DECK_M);
        match (status.state, status.landed) {
            (State::Landed, _) if !is_far(status) => Claim::OnDeck,
            (State::Descent | State::Flare | State::TakeOff | State::ClimbOut, _) => Claim::Landing,
            // Before a take-off the position decides, even if the drone was started on the deck.
            (State::Preparing | State::Countdown, _) if near => Claim::OnDeck,
            (State::SpinUp | State::StandDown, _) if !is_far(status) => Claim::OnDeck,
            (State::GetAltitude | State::Approach | State::Search | State::TrackingStable, _) => {
                Claim::Requesting
            }
            (State::Tracking, _) => Claim::Above,
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
    /// Claim after a status and the claim `before`; `departed`: lasting evidence that the drone has left.
    pub(super) fn of(status: &DroneStatus, before: Claim, departed: bool) -> Claim {
        let reported = Claim::reported(status);
        if before < Claim::Landing || reported >= Claim::Landing {
            return reported;
        }
        let on_ground = status.landed == LandedState::OnGround;
        // The drone was switched on again, or its landing was abandoned on the deck.
        if on_ground && !is_far(status) {
            return Claim::OnDeck;
        }
        // The drone flies on after an abandoned mission. No other status proves that it is away.
        let goes_on = reported > Claim::Away && status.armed && !on_ground;
        if goes_on || departed { reported } else { before }
    }
    /// Whether the newest status alone shows the drone at the deck.
    pub(super) fn is_at_deck(status: &DroneStatus) -> bool {
        let within = status.deck_distance_m.is_some_and(|d| d <= FAR_M);
        within || Claim::reported(status) >= Claim::Landing
    }
}
