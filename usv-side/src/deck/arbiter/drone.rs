//! A drone of the arbiter, by its statuses.

use alight_shared::msg::{DroneStatus, Header, ReasonCode, State, Station};
use alight_shared::time::{DroneClock, Span, Time, VesselClock};

use super::FRESH;
use super::claim::ClaimEvidence;
use super::clearance::StandingCharge;
use crate::deck::checkpoint::{Claim, DroneClaim};

/// A status with another boot id is that of a restarted drone once the former was silent for this long:
/// three periods.
const RESTART_SILENCE: Span = Span::from_millis(1500);
/// Alternations of two senders with one number until they count as two: late packets of a former start make one.
const MIN_ALTERNATIONS: u32 = 2;

/// A drone whose status was received.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Drone {
    /// Header of its newest status.
    pub(super) header: Header<DroneClock>,
    pub(super) received: Time<VesselClock>,
    pub(super) state: State,
    pub(super) claim: Claim,
    /// Since when it has requested the deck without owning it, or has owned it without descending.
    pub(super) since: Time<VesselClock>,
    /// Not known to be beyond [`alight_shared::msg::OWNER_ONLY_M`] since it was within.
    pub(super) inside: bool,
    pub(super) place: Option<usize>,
    pub(super) rival: Option<Rival>,
    /// In descent, not in flare, or in the air after one: it does not stand on the deck.
    pub(super) descends: bool,
    /// Was switched on without a position, and has not reported one since: may stand on the deck.
    pub(super) unplaced: bool,
    /// Evidence that ends its claim, or that it is unplaced.
    pub(super) evidence: Option<ClaimEvidence>,
    /// By its newest status alone it is at the deck.
    pub(super) at_deck: bool,
    /// By its newest status it is armed and in the air.
    pub(super) flies: bool,
    /// 0 to 1; None: not reported.
    pub(super) battery: Option<f64>,
    /// While it stands on the deck.
    pub(super) standing: Option<StandingCharge>,
    /// Is on its way down, or begins no descent because of the vessel's course.
    pub(super) wants_steady: bool,
    /// The station that it keeps, and since when.
    pub(super) station: Option<(Station, Time<VesselClock>)>,
}

/// Another sender with the same number: the drone itself after a restart, or a second drone.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rival {
    pub(super) header: Header<DroneClock>,
    pub(super) received: Time<VesselClock>,
    /// The first sender was received since.
    pub(super) answered: bool,
    /// Number of times that both were received in turn.
    pub(super) alternations: u32,
}

impl Drone {
    /// A drone of a checkpoint, of a vessel whose deck `owner` has.
    pub(super) fn restored(c: &DroneClaim, vessel: u32, owner: Option<u32>, now: Time<VesselClock>) -> Drone {
        Drone {
            // Whatever comes next follows it.
            header: Header::new(vessel, c.drone, c.boot, 0, Time::EPOCH),
            // It was not received since.
            received: now - FRESH - Span::from_millis(1),
            // Of one on its way down nothing else is known.
            state: match c.claim {
                Claim::Landing => State::Descent,
                Claim::Away | Claim::Requesting | Claim::Above | Claim::OnDeck => State::default(),
            },
            claim: c.claim,
            since: now,
            // The owner may have gone there meanwhile.
            inside: c.inside || owner == Some(c.drone),
            place: c.place,
            ..Drone::default()
        }
    }
    pub(super) fn is_fresh(&self, now: Time<VesselClock>) -> bool {
        now - self.received <= FRESH
    }
    /// The deck's sensor may have its weight.
    pub(super) fn may_stand(&self, now: Time<VesselClock>) -> bool {
        self.claim >= Claim::Landing && !(self.descends && self.is_fresh(now))
    }
    /// Whether a look at the deck shows that a silent drone has left. One that stood there is visible, or is gone.
    /// One that was in the air may still come down in silence, out of the sensor's view, for as long as a landing takes.
    pub(super) fn ends_by_a_look(&self, now: Time<VesselClock>, timeout_s: f64) -> bool {
        self.claim == Claim::OnDeck || (now - self.received).secs() > timeout_s
    }
    /// Two drones with this number.
    pub(super) fn is_double(&self) -> bool {
        self.rival.is_some_and(|r| r.alternations >= MIN_ALTERNATIONS)
    }
    /// Whether a status is of the sender that is known, in order, or of its next start.
    pub(super) fn admit(&mut self, now: Time<VesselClock>, h: &Header<DroneClock>) -> bool {
        if h.boot == self.header.boot {
            let new = h.follows(&self.header);
            if let Some(rival) = self.rival.as_mut().filter(|r| new && !r.answered) {
                rival.answered = true;
                rival.alternations = rival.alternations.saturating_add(1);
            }
            return new;
        }
        let known = self.rival.filter(|r| r.header.boot == h.boot);
        if known.is_some_and(|r| !h.follows(&r.header)) {
            return false;
        }
        let alternations = known.map_or(0, |r| r.alternations);
        let restarted = now - self.received > RESTART_SILENCE;
        let (header, received) = if restarted {
            (self.header, self.received)
        } else {
            (*h, now)
        };
        self.rival = Some(Rival {
            header,
            received,
            answered: restarted,
            alternations,
        });
        restarted
    }
    /// Whether a drone that reports this wants the vessel to keep course and speed.
    pub(super) fn asks_for_steady(status: &DroneStatus) -> bool {
        let waits = matches!(
            status.waiting.code,
            ReasonCode::VesselTurns | ReasonCode::CourseEnds | ReasonCode::TurnTooFast
        );
        let moves = matches!(
            status.state,
            State::Descent | State::Flare | State::Countdown | State::SpinUp | State::TakeOff
        );
        waits || moves
    }
}
