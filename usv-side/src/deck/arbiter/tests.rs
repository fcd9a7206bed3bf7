use super::*;
use alight_shared::{msg::Station, time::DroneTime};

mod course;
mod departure;
mod evidence;
mod inputs;
mod restart;

#[derive(Clone)]
struct Rig {
    arbiter: DeckArbiter,
    t_s: f64,
    sequence: u32,
    inputs: DeckInputs,
}

impl Rig {
    fn new() -> Rig {
        Rig::of(&DeckConfig::default(), DeckInputs::default())
    }
    fn of(config: &DeckConfig, inputs: DeckInputs) -> Rig {
        let mut rig = Rig {
            arbiter: DeckArbiter::new(config, 1, 1),
            t_s: 100.0,
            sequence: 0,
            inputs,
        };
        rig.run(&[], 4.0);
        rig
    }
    /// Owner after `secs` seconds of these states, reported at 2 Hz.
    fn run(&mut self, states: &[(u32, State)], secs: f64) -> u32 {
        for _ in 0..(secs / 0.5).ceil() as u32 {
            self.t_s += 0.5;
            self.sequence += 1;
            let statuses = states.iter().map(|s| self.status(*s)).collect();
            self.step(statuses);
        }
        self.arbiter.owner().unwrap_or(0)
    }
    /// Performs a step and returns its grant, if one is due.
    fn step(&mut self, statuses: Vec<DroneStatus>) -> Option<DeckGrant<VesselClock>> {
        let input = ArbiterIn {
            statuses,
            inputs: self.inputs,
            ..ArbiterIn::default()
        };
        self.arbiter.step(Time::from_secs(self.t_s), &input).grant
    }
    /// Applies a crew order and returns the next grant.
    fn order(&mut self, order: DeckOrder) -> DeckGrant<VesselClock> {
        self.t_s += 0.5;
        let input = ArbiterIn {
            orders: vec![order],
            inputs: self.inputs,
            ..ArbiterIn::default()
        };
        let out = self.arbiter.step(Time::from_secs(self.t_s), &input);
        out.grant.unwrap()
    }
    /// Reason why the deck is closed; checks that the grants then name no drone.
    fn closed(&self) -> Option<Closure> {
        let closed = self.arbiter.closed(Time::from_secs(self.t_s));
        assert_eq!(closed.is_some(), self.arbiter.published == DECK_CLOSED);
        closed
    }
    fn restart(&mut self, checkpoint: Option<DeckCheckpoint>) {
        self.t_s += 0.5;
        self.arbiter = DeckArbiter::new(&DeckConfig::default(), 1, 2);
        let input = ArbiterIn {
            checkpoint,
            ..ArbiterIn::default()
        };
        self.arbiter.step(Time::from_secs(self.t_s), &input);
    }
    fn status(&self, (id, state): (u32, State)) -> DroneStatus {
        let at = DroneTime::from_secs(self.t_s);
        DroneStatus {
            header: Header::new(1, id, 7, self.sequence, at),
            state,
            battery: Some(0.8),
            landed: match state {
                State::Idle => LandedState::Unknown,
                State::Landed => LandedState::OnGround,
                _ => LandedState::InAir,
            },
            deck_distance_m: match state {
                State::Idle => None,
                State::GetAltitude | State::Approach | State::Hold | State::GaveUp => Some(25.0),
                _ => Some(1.0),
            },
            armed: !matches!(state, State::Idle | State::Landed),
            ..DroneStatus::default()
        }
    }
    /// Owner after a drone in this state has reported once at this distance from the deck, while another waits.
    fn run_at(&mut self, (id, state): (u32, State), distance_m: f32) -> u32 {
        self.run_as(self.flying_as((id, state), distance_m), 1)
    }
    /// Owner after `times` repetitions of this status at 2 Hz, while another drone waits.
    fn run_as(&mut self, status: DroneStatus, times: u32) -> u32 {
        for _ in 0..times {
            self.t_s += 0.5;
            self.sequence += 1;
            let mut status = status;
            status.header.sequence = self.sequence;
            self.step(vec![status, self.status((2, State::Approach))]);
        }
        self.arbiter.owner().unwrap_or(0)
    }
    /// Rig after the first drone has been in each of these states for the given time, s.
    fn after(states: &[(State, f64)]) -> Rig {
        let mut rig = Rig::new();
        for &(state, secs) in states {
            rig.run(&[(1, state)], secs);
        }
        rig
    }
    fn with_a_landed_drone() -> Rig {
        Rig::after(&[(State::TrackingStable, 0.5), (State::Landed, 5.0)])
    }
    /// Status of the first drone in the air at this distance.
    fn flying(&self, distance_m: f32) -> DroneStatus {
        self.flying_as((1, State::Idle), distance_m)
    }
    fn flying_as(&self, drone: (u32, State), distance_m: f32) -> DroneStatus {
        DroneStatus {
            landed: LandedState::InAir,
            armed: true,
            deck_distance_m: Some(distance_m),
            ..self.status(drone)
        }
    }
}

#[test]
fn low_battery_behind_a_silent_owner() {
    let mut rig = Rig::after(&[(State::TrackingStable, 2.0)]);
    let waits = |rig: &mut Rig, secs: u32, battery| {
        for _ in 0..2 * secs {
            rig.t_s += 0.5;
            rig.sequence += 1;
            let low = DroneStatus {
                battery,
                ..rig.status((2, State::Approach))
            };
            rig.step(vec![low, rig.status((3, State::Approach))]);
        }
        rig.arbiter.starved(Time::from_secs(rig.t_s))
    };
    assert_eq!(waits(&mut rig, 59, Some(0.22)), None, "it may be landing");
    let starved = waits(&mut rig, 16, Some(0.22)).unwrap();
    assert_eq!((starved.owner, starved.waiting), (1, 2));
    assert!((starved.silent_s - 75.0).abs() < 1.0 && (starved.battery - 0.22).abs() < 1e-9);
    for battery in [Some(0.8), None] {
        assert_eq!(waits(&mut rig, 1, battery), None, "{battery:?}");
    }
    assert!(waits(&mut rig, 1, Some(0.0)).is_some(), "an empty one");
    assert!(waits(&mut rig, 600, Some(0.22)).is_some() && rig.arbiter.owner() == Some(1));
    rig.run(&[(1, State::Descent)], 0.5);
    assert_eq!(waits(&mut rig, 1, Some(0.22)), None);
    rig.run(&[(3, State::Approach)], 600.0);
    assert_eq!(
        rig.arbiter.starved(Time::from_secs(rig.t_s)),
        None,
        "no drone with a low battery waits"
    );
}

/// The owner gives way before its descent to a drone with a low battery that has less charge, and climbs clear first.
#[test]
fn owner_and_a_drone_with_less_charge() {
    for (state, own, other, owner) in [
        (State::TrackingStable, Some(0.8), Some(0.18), None),
        (State::Approach, Some(0.25), Some(0.18), None),
        (State::TrackingStable, Some(0.2), Some(0.18), Some(1)),
        (State::TrackingStable, Some(0.8), Some(0.5), Some(1)),
        (State::TrackingStable, None, Some(0.18), Some(1)),
        (State::TrackingStable, Some(0.8), None, Some(1)),
        (State::Descent, Some(0.8), Some(0.18), Some(1)),
        (State::Landed, Some(0.8), Some(0.18), Some(1)),
    ] {
        let mut rig = Rig::after(&[(state, 0.5)]);
        let wait = |rig: &mut Rig, owner: State, secs: u32| {
            for _ in 0..2 * secs {
                rig.t_s += 0.5;
                rig.sequence += 1;
                let both = [(1, owner, own), (2, State::Approach, other)];
                let statuses = both.map(|(id, state, battery)| DroneStatus {
                    battery,
                    ..rig.status((id, state))
                });
                rig.step(statuses.into());
            }
            rig.arbiter.owner()
        };
        assert_eq!(wait(&mut rig, state, 5), owner, "{state:?} {own:?} {other:?}");
        let starved = rig.arbiter.starved(Time::from_secs(rig.t_s));
        assert_eq!(starved.is_some(), state == State::Landed);
        if owner != Some(1) {
            assert_eq!(wait(&mut rig, State::GetAltitude, 5), Some(2));
        }
    }
}

#[test]
fn grant_of_the_first_request() {
    let mut rig = Rig::new();
    assert_eq!(rig.run(&[(1, State::TrackingStable)], 0.5), 1);
    for state in [State::Descent, State::Flare, State::Landed, State::Idle] {
        let both = [(1, state), (2, State::Approach)];
        assert_eq!(rig.run(&both, 5.0), 1, "{state:?}");
    }
    // A drone that is switched off on the deck owns the deck for any length of time.
    assert_eq!(rig.run(&[(2, State::Approach)], 600.0), 1);
    for (distance_m, owner) in [(1.0, 1), (14.0, 1), (16.0, 1)] {
        assert_eq!(
            rig.run_at((1, State::GaveUp), distance_m),
            owner,
            "{distance_m} m"
        );
    }
    assert_eq!(rig.run_as(rig.flying(25.0), 6), 2);
}

#[test]
fn grant_of_an_idle_and_of_a_silent_owner() {
    for last in [
        State::Descent,
        State::Flare,
        State::TrackingStable,
        State::Tracking,
    ] {
        let mut rig = Rig::after(&[(State::TrackingStable, 0.5), (last, 2.0)]);
        let waiting = [(2, State::Approach)];
        assert_eq!(rig.run(&waiting, 3600.0), 1, "{last:?}: it may have landed");
        let occupied = rig.arbiter.occupied(Time::from_secs(rig.t_s));
        assert_eq!(
            occupied,
            matches!(last, State::Descent | State::Flare),
            "{last:?}"
        );
        rig.order(DeckOrder::Open);
        assert_eq!(rig.run(&waiting, 0.5), 2, "{last:?}");
    }
    let mut rig = Rig::new();
    rig.run(&[(2, State::Approach)], 0.5);
    let both = [(1, State::Approach), (2, State::Tracking)];
    assert_eq!(rig.run(&both, 20.0), 2);
    assert_eq!(
        rig.run(&both, 20.0),
        0,
        "the idle timeout has passed, but it is still above the deck"
    );
    let waiting = [(1, State::Approach), (2, State::Approach)];
    assert_eq!(rig.run(&waiting, 3.0), 1);
    assert_eq!(rig.run(&[(1, State::Tracking), (2, State::Approach)], 20.0), 1);
    assert_eq!(rig.run(&waiting, 20.0), 2, "in turns");
}

#[test]
fn deck_opened_under_a_silent_descent() {
    let waiting = [(2, State::Approach)];
    for last in [
        State::TrackingStable,
        State::Tracking,
        State::Descent,
        State::Flare,
    ] {
        let mut rig = Rig::after(&[(State::TrackingStable, 0.5), (last, 2.0)]);
        // A drone may descend silently for as long as a landing takes, however often the crew opens the deck.
        for silent_s in [2.5, 10.0, 58.0] {
            let now_s = 106.5 + silent_s;
            rig.run(&waiting, now_s - 0.5 - rig.t_s);
            rig.order(DeckOrder::Open);
            assert_eq!(rig.run(&waiting, 0.5), 1, "{last:?} {silent_s}");
            let silent_drones: Vec<_> = rig.arbiter.silent_drones(Time::from_secs(rig.t_s)).collect();
            assert_eq!(silent_drones.len(), 1, "{last:?} {silent_s}");
            assert_eq!(silent_drones[0].drone, 1);
            assert!((silent_drones[0].silent_s + silent_drones[0].remaining_s - 60.0).abs() < 1e-9);
        }
        // An order for another drone has no effect.
        let mut informed = rig.clone();
        informed.order(DeckOrder::Clear(3));
        assert_eq!(informed.run(&waiting, 0.5), 1, "{last:?}");
        informed.order(DeckOrder::Clear(1));
        assert_eq!(informed.run(&waiting, 4.0), 2, "{last:?}");
        // Without an order for this drone, the deck is released once its manoeuvre must have ended.
        rig.run(&waiting, 3.0);
        assert_eq!(rig.arbiter.silent_drones(Time::from_secs(rig.t_s)).count(), 0);
        rig.order(DeckOrder::Open);
        assert_eq!(rig.run(&waiting, 4.0), 2, "{last:?}");
    }
    // An order does not override a drone that reports from the deck.
    let mut rig = Rig::with_a_landed_drone();
    rig.order(DeckOrder::Clear(1));
    assert_eq!(rig.run(&[(1, State::Landed), waiting[0]], 4.0), 1);
}

#[test]
fn silent_owner_that_gives_way() {
    for last_s in [0.5, 1.5, 2.5] {
        let mut rig = Rig::after(&[(State::Approach, 0.5)]);
        // The owner waits for too long without descending.
        let both = [(1, State::Approach), (2, State::Approach)];
        let waited = (0..80).find(|_| rig.run(&both, 0.5) == 0);
        assert!(waited.is_some());
        rig.run(&both, last_s);
        let after = rig.run(&[(2, State::Approach)], 600.0);
        if last_s > topics::DECK.stale_after.secs() {
            assert_eq!(after, 2, "{last_s} s: it knows that it gave way");
        } else {
            assert_eq!(after, 0, "{last_s} s");
            assert_eq!(rig.run(&both, 1.0), 2, "it reports from beyond");
        }
    }
}

#[test]
fn waiting_places() {
    let mut rig = Rig::new();
    let crowd: Vec<_> = (1..=PLACES as u32 + 2).map(|id| (id, State::Approach)).collect();
    rig.run(&crowd, 1.0);
    let places = |rig: &Rig| -> Vec<u32> {
        let occupant = |k| rig.arbiter.drones.iter().find(|d| d.place == Some(k));
        (0..PLACES)
            .map(|k| occupant(k).map_or(0, |d| d.header.drone))
            .collect()
    };
    let mut held: Vec<u32> = (1..=PLACES as u32).collect();
    assert_eq!(places(&rig), held, "no place is left for the last two");
    // Drones keep their places during silence and a restart of the vessel.
    rig.run(&crowd[3..], 600.0);
    rig.restart(Some(rig.arbiter.checkpoint()));
    rig.run(&crowd[3..], 600.0);
    assert_eq!(places(&rig), held);
    // One lands ashore: the next takes its place.
    rig.sequence += 1;
    let ashore = DroneStatus {
        landed: LandedState::OnGround,
        ..rig.status((5, State::Idle))
    };
    rig.step(vec![ashore]);
    rig.run(&crowd[8..], 0.5);
    held[4] = PLACES as u32 + 1;
    assert_eq!(places(&rig), held);
    // The crew clears the deck, but not the air around it, where the second drone waited.
    rig.run(&[(2, State::Landed)], 1.0);
    rig.run(&crowd[8..], 60.0);
    rig.order(DeckOrder::Open);
    rig.run(&crowd[8..], 0.5);
    held[1] = PLACES as u32 + 2;
    assert_eq!(places(&rig), held);
}

#[test]
fn deck_closed_until_the_crew_opens_it() {
    let mut rig = Rig::after(&[(State::TrackingStable, 2.0)]);
    assert_eq!(rig.order(DeckOrder::Closed).owner, DECK_CLOSED);
    let waiting = [(2, State::Approach)];
    rig.run(&waiting, 60.0);
    assert_eq!(rig.arbiter.published, DECK_CLOSED);
    rig.restart(Some(rig.arbiter.checkpoint()));
    rig.run(&waiting, 60.0);
    assert_eq!(rig.arbiter.published, DECK_CLOSED);
    rig.order(DeckOrder::Open);
    assert_eq!(rig.run(&waiting, 0.5), 2);
    // The report of a drone on the deck takes precedence over the crew's orders.
    rig.run(&[(2, State::Landed)], 5.0);
    assert_eq!(rig.order(DeckOrder::Open).owner, 2);
}

/// Two drones are ordered to one station; the first keeps it, even while silent, until its time is over.
#[test]
fn station_of_two_drones() {
    let mut rig = Rig::new();
    let keeps = |rig: &Rig, id, height_m| DroneStatus {
        station: Some(Station {
            right_m: 20,
            height_m,
            for_min: 1,
            ..Station::default()
        }),
        ..rig.flying_as((id, State::Hold), 20.0)
    };
    let step = |rig: &mut Rig, kept: &[(u32, u8)]| {
        rig.t_s += 0.5;
        rig.sequence += 1;
        let statuses = kept.iter().map(|(id, height_m)| keeps(rig, *id, *height_m));
        let statuses = statuses.collect();
        let grant = rig.step(statuses).unwrap();
        let station_of = |id| {
            grant
                .places
                .iter()
                .position(|d| *d == id)
                .map_or(0, |k| grant.stations[k])
        };
        [station_of(1), station_of(2)]
    };
    assert_eq!(step(&mut rig, &[(2, 30)]), [0, 30]);
    assert_eq!(step(&mut rig, &[(1, 31), (2, 30)]), [0, 30]);
    assert_eq!(step(&mut rig, &[(1, 35), (2, 30)]), [35, 30]);
    assert_eq!(step(&mut rig, &[(1, 30), (2, 30)]), [0, 30]);
    for _ in 0..100 {
        assert_eq!(step(&mut rig, &[(1, 30)]), [0, 30]);
    }
    for _ in 0..30 {
        step(&mut rig, &[(1, 30)]);
    }
    assert_eq!(step(&mut rig, &[(1, 30)]), [30, 0]);
}
