//! The deck arbiter: of several drones one at a time may descend.
//!
//! Every drone reports the state of its mission ([`DroneStatus`], 2 Hz); the arbiter publishes who owns the
//! deck ([`DeckGrant`], 2 Hz and at each change). A drone requests the deck by tracking it stably. It owns the
//! deck until it goes elsewhere, its status times out, or it has taken off again. A drone on the deck owns it
//! without a timeout: it may have been switched off there.

use alight_shared::admission::check_message;
use alight_shared::config;
use alight_shared::msg::{DeckGrant, DroneStatus, Header, LandedState, State};
use alight_shared::node::Node;
use alight_shared::time::{DroneClock, Span, Time, VesselClock};
use serde::{Deserialize, Serialize};

use super::MAX_DRONES;

/// Time between two grants without a change.
const PERIOD: Span = Span::from_millis(500);

config! {
    /// When the deck changes its owner.
    #[derive(Copy)]
    pub struct DeckConfig {
        /// An airborne drone whose status is older than this loses the deck, s.
        /// Source: above the longest descent and flare together (30 and 8 s), which a drone may
        /// finish without a radio.
        pub status_timeout_s: f64 = 60.0, in 40.0..=3600.0;
        /// A drone that does not begin to descend for this long gives way to another that requests the deck, s.
        /// Source: two calms between groups of swell.
        pub idle_timeout_s: f64 = 30.0, in 1.0..=3600.0;
        /// After a start nobody is given the deck for this long, s: its owner before the restart reports first.
        /// Source: six periods of a drone's status.
        pub startup_hold_s: f64 = 3.0, in 1.0..=60.0;
    }
}

/// What a drone has to do with the deck.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Claim {
    /// Nothing.
    Away,
    /// Above it, not stably: keeps it, does not request it.
    Above,
    /// Stably above it.
    Requesting,
    /// In descent or flare.
    Landing,
    /// Stands on it.
    OnDeck,
}

#[derive(Clone, Copy, Debug)]
struct Drone {
    /// Of its newest status.
    header: Header<DroneClock>,
    received: Time<VesselClock>,
    claim: Claim,
    /// Since when it has requested the deck without owning it, or has owned it without descending.
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

/// Statuses that arrived since the last step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ArbiterIn {
    /// In their order of arrival.
    pub statuses: Vec<DroneStatus>,
}

/// What the arbiter publishes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ArbiterOut {
    /// The owner of the deck, when due.
    pub grant: Option<DeckGrant<VesselClock>>,
}

/// The node that decides who owns the deck.
#[derive(Clone, Debug, Default)]
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
    /// The arbiter of vessel `vessel`, which started with this boot id; nobody owns the deck.
    pub fn new(config: &DeckConfig, vessel: u32, boot: u32) -> DeckArbiter {
        DeckArbiter {
            config: *config,
            vessel,
            boot,
            due: Time::from_nanos(i64::MIN),
            ..DeckArbiter::default()
        }
    }
    /// The drone that owns the deck.
    pub fn owner(&self) -> Option<u32> {
        self.owner
    }
    /// Statuses of another vessel or version, out of order, or of a drone beyond [`MAX_DRONES`].
    pub fn rejected(&self) -> u64 {
        self.rejected
    }

    fn observe(&mut self, now: Time<VesselClock>, status: &DroneStatus) {
        let h = &status.header;
        let index = self.drones.iter().position(|d| d.header.drone == h.drone);
        let before = index.and_then(|k| self.drones.get(k)).copied();
        let old = before.is_some_and(|d| !h.follows(&d.header));
        let valid = check_message(status).is_ok() && h.vessel == self.vessel && h.drone != 0;
        let full = before.is_none() && self.drones.len() >= MAX_DRONES;
        if !valid || old || full {
            self.rejected = self.rejected.saturating_add(1);
            return;
        }
        let claim = Claim::of(status, before.map_or(Claim::Away, |d| d.claim));
        let same = before.filter(|d| d.claim == claim || d.claim.max(claim) <= Claim::Requesting);
        let new_request = claim == Claim::Requesting && before.is_none_or(|d| d.claim == Claim::Away);
        let drone = Drone {
            header: *h,
            received: now,
            claim,
            since: same.filter(|_| !new_request).map_or(now, |d| d.since),
        };
        match index.and_then(|k| self.drones.get_mut(k)) {
            Some(slot) => *slot = drone,
            None => self.drones.push(drone),
        }
    }

    /// The owner from now on.
    fn assign(&mut self, now: Time<VesselClock>) -> Option<u32> {
        let c = self.config;
        let fresh = |d: &Drone| d.claim == Claim::OnDeck || (now - d.received).secs() <= c.status_timeout_s;
        self.drones.retain(fresh);
        let drones = || self.drones.iter();
        // Facts before permissions: who is on the deck or descends owns it, the owner before another.
        let fact = drones()
            .filter(|d| d.claim >= Claim::Landing)
            .max_by_key(|d| (d.claim, self.owner == Some(d.header.drone)));
        if let Some(d) = fact {
            return Some(d.header.drone);
        }
        let current = drones().find(|d| self.owner == Some(d.header.drone) && d.claim > Claim::Away);
        let next = drones()
            .filter(|d| d.claim == Claim::Requesting && self.owner != Some(d.header.drone))
            .min_by_key(|d| d.since);
        match (current, next) {
            (Some(d), Some(other)) if (now - d.since).secs() > c.idle_timeout_s => Some(other.header.drone),
            (Some(d), _) => Some(d.header.drone),
            (None, Some(d)) if self.began.is_some_and(|t| (now - t).secs() >= c.startup_hold_s) => {
                Some(d.header.drone)
            }
            (None, _) => None,
        }
    }
}

impl Node for DeckArbiter {
    type Clock = VesselClock;
    type In = ArbiterIn;
    type Out = ArbiterOut;

    fn step(&mut self, now: Time<VesselClock>, input: &ArbiterIn) -> ArbiterOut {
        self.began = self.began.or(Some(now));
        for status in &input.statuses {
            self.observe(now, status);
        }
        let owner = self.assign(now);
        let changed = owner != self.owner;
        if changed {
            // The new owner's idle time begins; the former owner joins the end of the queue.
            for d in &mut self.drones {
                if Some(d.header.drone) == owner || Some(d.header.drone) == self.owner {
                    d.since = now;
                }
            }
            self.owner = owner;
        }
        if now < self.due && !changed {
            return ArbiterOut::default();
        }
        self.due = now + PERIOD;
        self.sequence = self.sequence.wrapping_add(1);
        ArbiterOut {
            grant: Some(DeckGrant {
                header: Header::new(self.vessel, 0, self.boot, self.sequence, now),
                owner: owner.unwrap_or(0),
                occupied: self.drones.iter().any(|d| d.claim == Claim::OnDeck),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Rig {
        arbiter: DeckArbiter,
        t_s: f64,
        sequence: u32,
    }

    impl Rig {
        /// Four seconds after the arbiter's start.
        fn new() -> Rig {
            let mut rig = Rig {
                arbiter: DeckArbiter::new(&DeckConfig::default(), 1, 1),
                t_s: 100.0,
                sequence: 0,
            };
            rig.run(&[], 4.0);
            rig
        }
        /// The owner after the drones have reported these states at 2 Hz for `secs`.
        fn run(&mut self, states: &[(u32, State)], secs: f64) -> u32 {
            for _ in 0..(secs / 0.5).ceil() as u32 {
                self.t_s += 0.5;
                self.sequence += 1;
                let statuses = states.iter().map(|s| self.status(*s)).collect();
                self.arbiter
                    .step(Time::from_secs(self.t_s), &ArbiterIn { statuses });
            }
            self.arbiter.owner().unwrap_or(0)
        }
        fn status(&self, (id, state): (u32, State)) -> DroneStatus {
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
        let mut rig = Rig::new();
        assert_eq!(rig.run(&[(1, State::TrackingStable)], 0.5), 1);
        for state in [State::Descent, State::Flare, State::Landed, State::Idle] {
            let both = [(1, state), (2, State::TrackingStable)];
            assert_eq!(rig.run(&both, 5.0), 1, "{state:?}");
        }
        // Switched off on the deck: however long.
        assert_eq!(rig.run(&[(2, State::TrackingStable)], 600.0), 1);
        let both = [(1, State::GetAltitude), (2, State::TrackingStable)];
        assert_eq!(rig.run(&both, 0.5), 2);
    }

    #[test]
    fn deck_arbiter_frees_the_deck_after_a_manual_take_off() {
        let mut rig = Rig::new();
        rig.run(&[(1, State::TrackingStable)], 0.5);
        rig.run(&[(1, State::Landed)], 5.0);
        assert_eq!(rig.run(&[(1, State::Idle)], 5.0), 1);
        rig.sequence += 1;
        let status = DroneStatus {
            landed: LandedState::InAir,
            ..rig.status((1, State::Idle))
        };
        let statuses = vec![status];
        let out = rig
            .arbiter
            .step(Time::from_secs(rig.t_s + 0.5), &ArbiterIn { statuses });
        assert_eq!(out.grant.unwrap().owner, 0);
    }

    #[test]
    fn deck_arbiter_withdraws_the_deck_after_silence_or_idling() {
        let mut rig = Rig::new();
        rig.run(&[(1, State::TrackingStable)], 0.5);
        rig.run(&[(1, State::Descent)], 2.0);
        assert_eq!(
            rig.run(&[(2, State::TrackingStable)], 59.0),
            1,
            "it may finish without a radio"
        );
        assert_eq!(rig.run(&[(2, State::TrackingStable)], 4.0), 2);
        let both = [(1, State::TrackingStable), (2, State::Tracking)];
        assert_eq!(rig.run(&both, 20.0), 2);
        assert_eq!(rig.run(&both, 20.0), 1, "the idle timeout has passed");
        let both = [(1, State::TrackingStable), (2, State::TrackingStable)];
        assert_eq!(rig.run(&both, 15.0), 1);
        assert_eq!(rig.run(&both, 10.0), 2, "in turns");
    }

    #[test]
    fn deck_arbiter_restart_respects_a_drone_in_descent() {
        let mut rig = Rig::new();
        rig.arbiter = DeckArbiter::new(&DeckConfig::default(), 1, 2);
        assert_eq!(rig.run(&[(2, State::TrackingStable)], 2.0), 0);
        assert_eq!(
            rig.run(&[(2, State::TrackingStable), (1, State::Descent)], 0.5),
            1
        );
        assert_eq!(
            rig.run(&[(2, State::TrackingStable), (1, State::Landed)], 60.0),
            1
        );
    }

    #[test]
    fn deck_arbiter_rejects_foreign_statuses_and_surplus_drones() {
        let mut rig = Rig::new();
        let foreign = DroneStatus {
            header: Header::new(9, 1, 7, 1, Time::EPOCH),
            state: State::TrackingStable,
            ..DroneStatus::default()
        };
        let statuses = vec![foreign];
        rig.arbiter.step(Time::from_secs(200.0), &ArbiterIn { statuses });
        assert_eq!((rig.arbiter.owner(), rig.arbiter.rejected()), (None, 1));
        let crowd: Vec<_> = (1..=80).map(|id| (id, State::TrackingStable)).collect();
        assert_eq!(rig.run(&crowd, 0.5), 1);
        assert_eq!(rig.arbiter.rejected(), 1 + 80 - MAX_DRONES as u64);
    }
}
