use alight_shared::{
    msg::{DroneStatus, Header, ReasonCode, State, Station},
    time::{DroneClock, Span, Time, VesselTime},
};

use super::{FRESH, LOW_BATTERY, claim::ClaimEvidence, clearance::StandingCharge};
use crate::deck::checkpoint::{Claim, DroneClaim};

/// Silence of the former boot after which another boot id counts as a restart: three status periods.
const RESTART_SILENCE: Span = Span::from_millis(1500);
/// Alternations between two senders with one number after which they count as two drones; a late packet causes only one.
const MIN_ALTERNATIONS: u32 = 2;
/// Difference of two charges for which the owner of the deck gives way, percent: the drones' gauges differ by less.
const GIVES_WAY: u8 = 5;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Drone {
    pub(super) header: Header<DroneClock>,
    pub(super) received: VesselTime,
    pub(super) state: State,
    pub(super) claim: Claim,
    /// Start of the drone's request for the deck, or of an ownership without a descent.
    pub(super) since: VesselTime,
    /// The drone came within [`alight_shared::msg::OWNER_ONLY_M`] and has not reported a larger distance since.
    pub(super) inside: bool,
    pub(super) place: Option<usize>,
    pub(super) rival: Option<Rival>,
    /// The drone is in descent (not in flare), or in the air after one, so it does not stand on the deck.
    pub(super) descends: bool,
    /// The drone was switched on without a position and has not reported one since.
    pub(super) unplaced: bool,
    /// Evidence that ends the drone's claim, or shows its position.
    pub(super) evidence: Option<ClaimEvidence>,
    pub(super) at_deck: bool,
    pub(super) flies: bool,
    /// Battery, 0 to 1; None: not reported.
    pub(super) battery: Option<f64>,
    pub(super) standing: Option<StandingCharge>,
    /// The drone descends, or waits for a steady course before its descent.
    pub(super) wants_steady: bool,
    pub(super) station: Option<(Station, VesselTime)>,
}

/// Another sender with the same number: the restarted drone, or a second one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rival {
    pub(super) header: Header<DroneClock>,
    pub(super) received: VesselTime,
    /// The first sender has been received since this one appeared.
    pub(super) answered: bool,
    pub(super) alternations: u32,
}

impl Drone {
    /// Drone from a checkpoint of this vessel, whose deck has `owner`.
    pub(super) fn restored(c: &DroneClaim, vessel: u32, owner: Option<u32>, now: VesselTime) -> Drone {
        Drone {
            header: Header::new(vessel, c.drone, c.boot, 0, Time::EPOCH),
            received: now - FRESH - Span::from_millis(1),
            // Only the claim of a descending drone is known.
            state: match c.claim {
                Claim::Landing => State::Descent,
                Claim::Away | Claim::Requesting | Claim::Above | Claim::OnDeck => State::default(),
            },
            claim: c.claim,
            since: now,
            // The owner may have flown into its space in the meantime.
            inside: c.inside || owner == Some(c.drone),
            place: c.place,
            ..Drone::default()
        }
    }
    pub(super) fn is_fresh(&self, now: VesselTime) -> bool {
        now - self.received <= FRESH
    }
    /// Whether the drone may stand on the deck, where the deck sensor detects it.
    pub(super) fn may_stand(&self, now: VesselTime) -> bool {
        self.claim >= Claim::Landing && !(self.descends && self.is_fresh(now))
    }
    /// Whether a look at the deck shows that a silent drone has left. A drone that stood there is either
    /// visible or gone, but one that was in the air may descend in silence for as long as a landing takes.
    pub(super) fn ends_by_a_look(&self, now: VesselTime, timeout_s: f64) -> bool {
        self.claim == Claim::OnDeck || (now - self.received).secs() > timeout_s
    }
    pub(super) fn is_double(&self) -> bool {
        self.rival.is_some_and(|r| r.alternations >= MIN_ALTERNATIONS)
    }
    /// Whether a status is from the known sender in order, or from its next start.
    pub(super) fn admit(&mut self, now: VesselTime, h: &Header<DroneClock>) -> bool {
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
    /// Charge of a low battery, percent; 100: not low or unknown.
    pub(super) fn need(&self) -> u8 {
        let low = self.battery.filter(|b| *b < LOW_BATTERY);
        low.map_or(100, |b| (100.0 * b) as u8)
    }
    /// Whether the deck's `owner` gives way to this drone.
    pub(super) fn needs_deck_before(&self, owner: &Drone) -> bool {
        owner.battery.is_some() && self.need().saturating_add(GIVES_WAY) < owner.need()
    }
    /// Whether a drone with this status asks the vessel to keep course and speed.
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
