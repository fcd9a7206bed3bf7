//! The deck's reservation: of several drones one at a time may descend.
//!
//! The vessel hears from every drone how its mission stands ([`DroneStatus`], twice a second) and says
//! whose the deck is ([`DeckGrant`]). A drone asks by standing steady above the deck; it has the deck
//! until it goes elsewhere, is silent for too long, or has taken off again. A drone on the deck keeps it
//! however long it is silent: it may have been switched off there.

use alight_shared::config;
use alight_shared::msg::{DeckGrant, DroneStatus, Header, LandedState, MESSAGE_VERSION, Message, State};
use alight_shared::time::{Span, Time, VesselClock};

/// Drones at most; what comes on top gets no deck.
pub const MAX_DRONES: usize = 64;
/// Time between two words.
const PERIOD: Span = Span::from_millis(500);

config! {
    /// How the deck is given away.
    #[derive(Copy)]
    pub struct DeckConfig {
        /// A drone in the air that has been silent for this long has lost the deck, s.
        /// Source: Ours: above the longest descent and flare together (30 and 8 s), which a drone may finish
        /// without a radio.
        pub status_timeout_s: f64 = 60.0, in 40.0..=3600.0;
        /// A drone that does not begin to descend for this long gives way to another that asks, s.
        /// Source: Ours: two swells' calm.
        pub idle_timeout_s: f64 = 30.0, in 1.0..=3600.0;
        /// After a start nobody is given the deck for this long, s: who has it already says so first.
        /// Source: Ours: six periods of a drone's status.
        pub startup_hold_s: f64 = 3.0, in 1.0..=60.0;
    }
}

/// What a drone has to do with the deck.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Claim {
    /// Nothing.
    Away,
    /// Above it, not steady: keeps it, does not ask for it.
    Above,
    /// Steady above it.
    Requesting,
    /// On the way down.
    Landing,
    /// Stands on it.
    OnDeck,
}

#[derive(Clone, Copy, Debug)]
struct Drone {
    id: u32,
    boot: u32,
    sequence: u32,
    heard: Time<VesselClock>,
    claim: Claim,
    /// Since when it has been asking without having the deck, or has had it without descending.
    since: Time<VesselClock>,
}

impl Claim {
    fn of(status: &DroneStatus, before: Claim) -> Claim {
        match status.state {
            State::Landed => Claim::OnDeck,
            // Switched on again, or not yet taken off.
            State::Idle if before == Claim::OnDeck && status.landed != LandedState::InAir => Claim::OnDeck,
            State::Descent | State::Flare => Claim::Landing,
            State::TrackingStable => Claim::Requesting,
            State::Tracking => Claim::Above,
            State::Idle | State::GetAltitude | State::Approach | State::Hold | State::GaveUp => Claim::Away,
        }
    }
}

/// Who has the deck.
#[derive(Clone, Debug)]
pub struct DeckArbiter {
    config: DeckConfig,
    vessel: u32,
    boot: u32,
    sequence: u32,
    drones: Vec<Drone>,
    owner: Option<u32>,
    began: Option<Time<VesselClock>>,
    due: Time<VesselClock>,
    rejected: u64,
}

impl DeckArbiter {
    /// Of vessel `vessel`, which started with this boot id; the deck is nobody's.
    pub fn new(config: &DeckConfig, vessel: u32, boot: u32) -> DeckArbiter {
        DeckArbiter {
            config: *config,
            vessel,
            boot,
            sequence: 0,
            drones: Vec::new(),
            owner: None,
            began: None,
            due: Time::from_nanos(i64::MIN),
            rejected: 0,
        }
    }
    /// The drone that has the deck.
    pub fn owner(&self) -> Option<u32> {
        self.owner
    }
    /// Words that were of another vessel or version, out of order or of one drone too many.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }

    fn observe(&mut self, now: Time<VesselClock>, status: &DroneStatus) {
        let h = &status.header;
        let known = self.drones.iter().position(|d| d.id == h.drone);
        let old = known
            .and_then(|k| self.drones.get(k))
            .is_some_and(|d| d.boot == h.boot && h.sequence <= d.sequence);
        let sound = h.version == MESSAGE_VERSION && h.vessel == self.vessel && h.drone != 0;
        if !sound || old || status.check().is_err() || known.is_none() && self.drones.len() >= MAX_DRONES {
            self.rejected = self.rejected.saturating_add(1);
            return;
        }
        let before = known.and_then(|k| self.drones.get(k)).copied();
        let claim = Claim::of(status, before.map_or(Claim::Away, |d| d.claim));
        let same = before.filter(|d| d.claim == claim || d.claim.max(claim) <= Claim::Requesting);
        let requests_anew = claim == Claim::Requesting && before.is_none_or(|d| d.claim == Claim::Away);
        let drone = Drone {
            id: h.drone,
            boot: h.boot,
            sequence: h.sequence,
            heard: now,
            claim,
            since: same.filter(|_| !requests_anew).map_or(now, |d| d.since),
        };
        match known.and_then(|k| self.drones.get_mut(k)) {
            Some(slot) => *slot = drone,
            None => self.drones.push(drone),
        }
    }

    /// Who has the deck from now on.
    fn assign(&mut self, now: Time<VesselClock>) -> Option<u32> {
        let c = self.config;
        let fresh = |d: &Drone| d.claim == Claim::OnDeck || (now - d.heard).secs() <= c.status_timeout_s;
        self.drones.retain(fresh);
        let of = |id: u32| self.drones.iter().find(|d| d.id == id);
        let current = self.owner.and_then(of).filter(|d| d.claim > Claim::Away);
        // Facts before permissions: who is on the deck or coming down has it, the holder before another.
        let fact = self
            .drones
            .iter()
            .filter(|d| d.claim >= Claim::Landing)
            .max_by_key(|d| (d.claim, self.owner == Some(d.id)));
        if let Some(d) = fact {
            return Some(d.id);
        }
        let next = self
            .drones
            .iter()
            .filter(|d| d.claim == Claim::Requesting && self.owner != Some(d.id))
            .min_by_key(|d| d.since);
        match (current, next) {
            (Some(d), Some(other)) if (now - d.since).secs() > c.idle_timeout_s => Some(other.id),
            (Some(d), _) => Some(d.id),
            (None, Some(d)) if self.began.is_some_and(|t| (now - t).secs() >= c.startup_hold_s) => Some(d.id),
            (None, _) => None,
        }
    }

    /// Takes in what drones say, and says whose the deck is: twice a second and at each change.
    pub fn step<'a>(
        &mut self,
        now: Time<VesselClock>,
        statuses: impl IntoIterator<Item = &'a DroneStatus>,
    ) -> Option<DeckGrant<VesselClock>> {
        self.began = self.began.or(Some(now));
        for status in statuses {
            self.observe(now, status);
        }
        let owner = self.assign(now);
        let changed = owner != self.owner;
        if changed {
            // Its patience begins; the one that gave way asks at the end of the queue.
            for d in &mut self.drones {
                if Some(d.id) == owner || Some(d.id) == self.owner {
                    d.since = now;
                }
            }
            self.owner = owner;
        }
        if now < self.due && !changed {
            return None;
        }
        self.due = now + PERIOD;
        self.sequence = self.sequence.wrapping_add(1);
        let occupied = self.drones.iter().any(|d| d.claim == Claim::OnDeck);
        Some(DeckGrant {
            header: Header::new(self.vessel, 0, self.boot, self.sequence, now),
            owner: owner.unwrap_or(0),
            occupied,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::DroneClock;

    struct Trial {
        arbiter: DeckArbiter,
        t_s: f64,
        sequence: u32,
    }

    impl Trial {
        fn new() -> Trial {
            let mut trial = Trial {
                arbiter: DeckArbiter::new(&DeckConfig::default(), 1, 1),
                t_s: 100.0,
                sequence: 0,
            };
            trial.observe(&[], 4.0);
            trial
        }
        /// The drones say this twice a second for so long; who has the deck then.
        fn observe(&mut self, statuses: &[(u32, State)], secs: f64) -> u32 {
            let mut owner = self.arbiter.owner().unwrap_or(0);
            for _ in 0..(secs / 0.5).ceil() as u32 {
                self.t_s += 0.5;
                self.sequence += 1;
                let statuses: Vec<_> = statuses
                    .iter()
                    .map(|(id, state)| self.status(*id, *state))
                    .collect();
                if let Some(grant) = self.arbiter.step(Time::from_secs(self.t_s), &statuses) {
                    owner = grant.owner;
                }
            }
            owner
        }
        fn status(&self, id: u32, state: State) -> DroneStatus {
            let at = Time::<DroneClock>::from_secs(self.t_s);
            DroneStatus {
                header: Header::new(1, id, 7, self.sequence, at),
                state,
                battery: 0.8,
                ..DroneStatus::default()
            }
        }
    }

    #[test]
    fn deck_arbiter_grants_the_first_request_until_take_off() {
        let mut t = Trial::new();
        assert_eq!(t.observe(&[(1, State::TrackingStable)], 0.5), 1);
        for state in [State::Descent, State::Flare, State::Landed, State::Idle] {
            let both = [(1, state), (2, State::TrackingStable)];
            assert_eq!(t.observe(&both, 5.0), 1, "{state:?}");
        }
        // Switched off on the deck: however long.
        assert_eq!(t.observe(&[(2, State::TrackingStable)], 600.0), 1);
        assert_eq!(
            t.observe(&[(1, State::GetAltitude), (2, State::TrackingStable)], 0.5),
            2
        );
    }

    #[test]
    fn deck_arbiter_frees_the_deck_after_a_manual_take_off() {
        let mut t = Trial::new();
        t.observe(&[(1, State::TrackingStable)], 0.5);
        t.observe(&[(1, State::Landed)], 5.0);
        assert_eq!(t.observe(&[(1, State::Idle)], 5.0), 1);
        t.sequence += 1;
        let status = DroneStatus {
            landed: LandedState::InAir,
            ..t.status(1, State::Idle)
        };
        let now = Time::from_secs(t.t_s + 0.5);
        assert_eq!(t.arbiter.step(now, [&status]).unwrap().owner, 0);
    }

    #[test]
    fn deck_arbiter_withdraws_the_deck_after_silence_or_idling() {
        let mut t = Trial::new();
        t.observe(&[(1, State::TrackingStable)], 0.5);
        t.observe(&[(1, State::Descent)], 2.0);
        assert_eq!(
            t.observe(&[(2, State::TrackingStable)], 59.0),
            1,
            "it may finish without a radio"
        );
        assert_eq!(t.observe(&[(2, State::TrackingStable)], 4.0), 2);
        let both = [(1, State::TrackingStable), (2, State::Tracking)];
        assert_eq!(t.observe(&both, 20.0), 2);
        assert_eq!(t.observe(&both, 20.0), 1, "patience is at an end");
        let both = [(1, State::TrackingStable), (2, State::TrackingStable)];
        assert_eq!(t.observe(&both, 15.0), 1);
        assert_eq!(t.observe(&both, 10.0), 2, "in turns");
    }

    #[test]
    fn deck_arbiter_restart_respects_a_drone_in_descent() {
        let mut t = Trial::new();
        t.arbiter = DeckArbiter::new(&DeckConfig::default(), 1, 2);
        assert_eq!(t.observe(&[(2, State::TrackingStable)], 2.0), 0);
        assert_eq!(
            t.observe(&[(2, State::TrackingStable), (1, State::Descent)], 0.5),
            1
        );
        assert_eq!(
            t.observe(&[(2, State::TrackingStable), (1, State::Landed)], 60.0),
            1
        );
    }

    #[test]
    fn deck_arbiter_rejects_foreign_statuses_and_surplus_drones() {
        let mut t = Trial::new();
        let stranger = DroneStatus {
            header: Header::new(9, 1, 7, 1, Time::EPOCH),
            state: State::TrackingStable,
            ..DroneStatus::default()
        };
        t.arbiter.step(Time::from_secs(200.0), [&stranger]);
        assert_eq!((t.arbiter.owner(), t.arbiter.rejected()), (None, 1));
        let crowd: Vec<_> = (1..=80).map(|id| (id, State::TrackingStable)).collect();
        assert_eq!(t.observe(&crowd, 0.5), 1);
        assert_eq!(t.arbiter.rejected(), 1 + 80 - MAX_DRONES as u64);
    }
}
