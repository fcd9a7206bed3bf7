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
pub const DRONES: usize = 64;
/// Time between two words.
const PERIOD: Span = Span::from_millis(500);

config! {
    /// How the deck is given away.
    #[derive(Copy)]
    pub struct DeckConfig {
        /// A drone in the air that has been silent for this long has lost the deck, s.
        /// Source: Ours: above the longest descent and flare together (30 and 8 s), which a drone may finish
        /// without a radio.
        pub silent_s: f64 = 60.0, in 40.0..=3600.0;
        /// A drone that does not begin to descend for this long gives way to another that asks, s.
        /// Source: Ours: two swells' calm.
        pub patience_s: f64 = 30.0, in 1.0..=3600.0;
        /// After a start nobody is given the deck for this long, s: who has it already says so first.
        /// Source: Ours: six periods of a drone's status.
        pub settle_s: f64 = 3.0, in 1.0..=60.0;
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
    Asking,
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
    fn of(word: &DroneStatus, before: Claim) -> Claim {
        match word.state {
            State::Landed => Claim::OnDeck,
            // Switched on again, or not yet taken off.
            State::Idle if before == Claim::OnDeck && word.landed != LandedState::InAir => Claim::OnDeck,
            State::Descent | State::Flare => Claim::Landing,
            State::TrackingStable => Claim::Asking,
            State::Tracking => Claim::Above,
            State::Idle | State::GetAltitude | State::Approach | State::Hold | State::GaveUp => Claim::Away,
        }
    }
}

/// Who has the deck.
#[derive(Clone, Debug)]
pub struct DeckKeeper {
    config: DeckConfig,
    vessel: u32,
    boot: u32,
    sequence: u32,
    drones: Vec<Drone>,
    holder: Option<u32>,
    began: Option<Time<VesselClock>>,
    due: Time<VesselClock>,
    refused: u64,
}

impl DeckKeeper {
    /// Of vessel `vessel`, which started with this boot id; the deck is nobody's.
    pub fn new(config: &DeckConfig, vessel: u32, boot: u32) -> DeckKeeper {
        DeckKeeper {
            config: *config,
            vessel,
            boot,
            sequence: 0,
            drones: Vec::new(),
            holder: None,
            began: None,
            due: Time::from_nanos(i64::MIN),
            refused: 0,
        }
    }
    /// The drone that has the deck.
    pub fn holder(&self) -> Option<u32> {
        self.holder
    }
    /// Words that were of another vessel or version, out of order or of one drone too many.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    fn hear(&mut self, now: Time<VesselClock>, word: &DroneStatus) {
        let h = &word.header;
        let known = self.drones.iter().position(|d| d.id == h.drone);
        let old = known
            .and_then(|k| self.drones.get(k))
            .is_some_and(|d| d.boot == h.boot && h.sequence <= d.sequence);
        let sound = h.version == MESSAGE_VERSION && h.vessel == self.vessel && h.drone != 0;
        if !sound || old || word.check().is_err() || known.is_none() && self.drones.len() >= DRONES {
            self.refused = self.refused.saturating_add(1);
            return;
        }
        let before = known.and_then(|k| self.drones.get(k)).copied();
        let claim = Claim::of(word, before.map_or(Claim::Away, |d| d.claim));
        let same = before.filter(|d| d.claim == claim || d.claim.max(claim) <= Claim::Asking);
        let asks_anew = claim == Claim::Asking && before.is_none_or(|d| d.claim == Claim::Away);
        let drone = Drone {
            id: h.drone,
            boot: h.boot,
            sequence: h.sequence,
            heard: now,
            claim,
            since: same.filter(|_| !asks_anew).map_or(now, |d| d.since),
        };
        match known.and_then(|k| self.drones.get_mut(k)) {
            Some(slot) => *slot = drone,
            None => self.drones.push(drone),
        }
    }

    /// Who has the deck from now on.
    fn assign(&mut self, now: Time<VesselClock>) -> Option<u32> {
        let c = self.config;
        let young = |d: &Drone| d.claim == Claim::OnDeck || (now - d.heard).secs() <= c.silent_s;
        self.drones.retain(young);
        let of = |id: u32| self.drones.iter().find(|d| d.id == id);
        let held = self.holder.and_then(of).filter(|d| d.claim > Claim::Away);
        // Facts before permissions: who is on the deck or coming down has it, the holder before another.
        let fact = self
            .drones
            .iter()
            .filter(|d| d.claim >= Claim::Landing)
            .max_by_key(|d| (d.claim, self.holder == Some(d.id)));
        if let Some(d) = fact {
            return Some(d.id);
        }
        let next = self
            .drones
            .iter()
            .filter(|d| d.claim == Claim::Asking && self.holder != Some(d.id))
            .min_by_key(|d| d.since);
        match (held, next) {
            (Some(d), Some(other)) if (now - d.since).secs() > c.patience_s => Some(other.id),
            (Some(d), _) => Some(d.id),
            (None, Some(d)) if self.began.is_some_and(|t| (now - t).secs() >= c.settle_s) => Some(d.id),
            (None, _) => None,
        }
    }

    /// Takes in what drones say, and says whose the deck is: twice a second and at each change.
    pub fn step<'a>(
        &mut self,
        now: Time<VesselClock>,
        words: impl IntoIterator<Item = &'a DroneStatus>,
    ) -> Option<DeckGrant<VesselClock>> {
        self.began = self.began.or(Some(now));
        for word in words {
            self.hear(now, word);
        }
        let holder = self.assign(now);
        let changed = holder != self.holder;
        if changed {
            // Its patience begins; the one that gave way asks at the end of the queue.
            for d in &mut self.drones {
                if Some(d.id) == holder || Some(d.id) == self.holder {
                    d.since = now;
                }
            }
            self.holder = holder;
        }
        if now < self.due && !changed {
            return None;
        }
        self.due = now + PERIOD;
        self.sequence = self.sequence.wrapping_add(1);
        let occupied = self.drones.iter().any(|d| d.claim == Claim::OnDeck);
        Some(DeckGrant {
            header: Header::new(self.vessel, 0, self.boot, self.sequence, now),
            holder: holder.unwrap_or(0),
            occupied,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::DroneClock;

    struct Trial {
        keeper: DeckKeeper,
        t_s: f64,
        sequence: u32,
    }

    impl Trial {
        fn new() -> Trial {
            let mut trial = Trial {
                keeper: DeckKeeper::new(&DeckConfig::default(), 1, 1),
                t_s: 100.0,
                sequence: 0,
            };
            trial.hear(&[], 4.0);
            trial
        }
        /// The drones say this twice a second for so long; who has the deck then.
        fn hear(&mut self, words: &[(u32, State)], secs: f64) -> u32 {
            let mut holder = self.keeper.holder().unwrap_or(0);
            for _ in 0..(secs / 0.5).ceil() as u32 {
                self.t_s += 0.5;
                self.sequence += 1;
                let words: Vec<_> = words.iter().map(|(id, state)| self.word(*id, *state)).collect();
                if let Some(grant) = self.keeper.step(Time::from_secs(self.t_s), &words) {
                    holder = grant.holder;
                }
            }
            holder
        }
        fn word(&self, id: u32, state: State) -> DroneStatus {
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
    fn the_first_who_asks_has_the_deck_until_it_has_taken_off() {
        let mut t = Trial::new();
        assert_eq!(t.hear(&[(1, State::TrackingStable)], 0.5), 1);
        for state in [State::Descent, State::Flare, State::Landed, State::Idle] {
            let both = [(1, state), (2, State::TrackingStable)];
            assert_eq!(t.hear(&both, 5.0), 1, "{state:?}");
        }
        // Switched off on the deck: however long.
        assert_eq!(t.hear(&[(2, State::TrackingStable)], 600.0), 1);
        assert_eq!(
            t.hear(&[(1, State::GetAltitude), (2, State::TrackingStable)], 0.5),
            2
        );
    }

    #[test]
    fn a_drone_flown_off_the_deck_by_hand_gives_it_back() {
        let mut t = Trial::new();
        t.hear(&[(1, State::TrackingStable)], 0.5);
        t.hear(&[(1, State::Landed)], 5.0);
        assert_eq!(t.hear(&[(1, State::Idle)], 5.0), 1);
        t.sequence += 1;
        let word = DroneStatus {
            landed: LandedState::InAir,
            ..t.word(1, State::Idle)
        };
        let now = Time::from_secs(t.t_s + 0.5);
        assert_eq!(t.keeper.step(now, [&word]).unwrap().holder, 0);
    }

    #[test]
    fn silence_in_the_air_and_idling_above_lose_the_deck_to_another() {
        let mut t = Trial::new();
        t.hear(&[(1, State::TrackingStable)], 0.5);
        t.hear(&[(1, State::Descent)], 2.0);
        assert_eq!(
            t.hear(&[(2, State::TrackingStable)], 59.0),
            1,
            "it may finish without a radio"
        );
        assert_eq!(t.hear(&[(2, State::TrackingStable)], 4.0), 2);
        let both = [(1, State::TrackingStable), (2, State::Tracking)];
        assert_eq!(t.hear(&both, 20.0), 2);
        assert_eq!(t.hear(&both, 20.0), 1, "patience is at an end");
        let both = [(1, State::TrackingStable), (2, State::TrackingStable)];
        assert_eq!(t.hear(&both, 15.0), 1);
        assert_eq!(t.hear(&both, 10.0), 2, "in turns");
    }

    #[test]
    fn after_a_restart_who_is_coming_down_has_the_deck_and_nobody_else_gets_it_before() {
        let mut t = Trial::new();
        t.keeper = DeckKeeper::new(&DeckConfig::default(), 1, 2);
        assert_eq!(t.hear(&[(2, State::TrackingStable)], 2.0), 0);
        assert_eq!(t.hear(&[(2, State::TrackingStable), (1, State::Descent)], 0.5), 1);
        assert_eq!(t.hear(&[(2, State::TrackingStable), (1, State::Landed)], 60.0), 1);
    }

    #[test]
    fn what_is_not_for_us_or_one_too_many_changes_nothing() {
        let mut t = Trial::new();
        let stranger = DroneStatus {
            header: Header::new(9, 1, 7, 1, Time::EPOCH),
            state: State::TrackingStable,
            ..DroneStatus::default()
        };
        t.keeper.step(Time::from_secs(200.0), [&stranger]);
        assert_eq!((t.keeper.holder(), t.keeper.refused()), (None, 1));
        let crowd: Vec<_> = (1..=80).map(|id| (id, State::TrackingStable)).collect();
        assert_eq!(t.hear(&crowd, 0.5), 1);
        assert_eq!(t.keeper.refused(), 1 + 80 - DRONES as u64);
    }
}
