//! Tests of the deck arbiter.

use super::*;
use crate::demand::Demand;

mod departure;

#[derive(Clone)]
struct Rig {
    arbiter: DeckArbiter,
    t_s: f64,
    sequence: u32,
    inputs: DeckInputs,
}

impl Rig {
    /// Four seconds after the arbiter's start.
    fn new() -> Rig {
        Rig::of(&DeckConfig::default(), DeckInputs::default())
    }
    /// The same, with these levels of the digital inputs.
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
    /// The owner after the drones have reported these states at 2 Hz for `secs`.
    fn run(&mut self, states: &[(u32, State)], secs: f64) -> u32 {
        for _ in 0..(secs / 0.5).ceil() as u32 {
            self.t_s += 0.5;
            self.sequence += 1;
            let statuses = states.iter().map(|s| self.status(*s)).collect();
            self.step(statuses);
        }
        self.arbiter.owner().unwrap_or(0)
    }
    /// One step with these statuses; the newest grant, if one is due.
    fn step(&mut self, statuses: Vec<DroneStatus>) -> Option<DeckGrant<VesselClock>> {
        let input = ArbiterIn {
            statuses,
            inputs: self.inputs,
            ..ArbiterIn::default()
        };
        self.arbiter.step(Time::from_secs(self.t_s), &input).grant
    }
    /// An order of the crew for the deck; the grant that follows.
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
    /// Why the deck is closed now; the grants then name nobody.
    fn closed(&self) -> Option<Closure> {
        let closed = self.arbiter.closed(Time::from_secs(self.t_s));
        assert_eq!(closed.is_some(), self.arbiter.published == DECK_CLOSED);
        closed
    }
    /// The vessel is started anew with this checkpoint.
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
        let at = Time::<DroneClock>::from_secs(self.t_s);
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
    /// The owner after a drone in this state has reported once from so far from the deck, beside one that waits.
    fn run_at(&mut self, (id, state): (u32, State), distance_m: f32) -> u32 {
        self.run_as(self.flying_as((id, state), distance_m), 1)
    }
    /// The owner after so many of these statuses, at 2 Hz, beside a drone that waits.
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
    /// The first drone has been in these states, each for so long, s.
    fn after(states: &[(State, f64)]) -> Rig {
        let mut rig = Rig::new();
        for &(state, secs) in states {
            rig.run(&[(1, state)], secs);
        }
        rig
    }
    /// The first drone has landed, and is silent or not.
    fn with_a_landed_drone() -> Rig {
        Rig::after(&[(State::TrackingStable, 0.5), (State::Landed, 5.0)])
    }
    /// A status of the first drone, in the air at this distance.
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
fn single_status_from_beyond_the_deck() {
    let far = |change: fn(&mut DroneStatus)| {
        let mut rig = Rig::with_a_landed_drone();
        let mut status = rig.flying(200.0);
        change(&mut status);
        let owners = [rig.run_as(status, 1), rig.run_as(status, 6)];
        (owners, rig.arbiter.occupied(Time::from_secs(rig.t_s)))
    };
    // Several over seconds, armed and in the air: it has left.
    assert_eq!(far(|_| {}), ([1, 2], false));
    let contrary: [fn(&mut DroneStatus); 6] = [
        |s| s.armed = false,
        |s| s.landed = LandedState::OnGround,
        |s| s.landed = LandedState::Unknown,
        |s| s.deck_distance_m = None,
        |s| s.deck_distance_m = Some(14.0),
        // Its own mission has it on the deck, whose position it has wrong.
        |s| s.state = State::Landed,
    ];
    for (k, change) in contrary.into_iter().enumerate() {
        assert_eq!(far(change), ([1, 1], true), "{k}");
    }
    // The same of one that was on its way down when it was received last.
    for (state, distance_m) in [
        (State::Hold, None),
        (State::GaveUp, None),
        (State::GaveUp, Some(16.0)),
    ] {
        let mut rig = Rig::after(&[(State::TrackingStable, 0.5), (State::Flare, 1.0)]);
        let status = DroneStatus {
            deck_distance_m: distance_m,
            ..rig.status((1, state))
        };
        assert_eq!(rig.run_as(status, 1), 1, "{state:?}");
        assert_eq!(rig.run(&[(2, State::Approach)], 600.0), 1, "{state:?}");
    }
}

#[test]
fn evidence_of_a_departure_between_contrary_statuses() {
    let mut rig = Rig::with_a_landed_drone();
    let (far, near) = (rig.flying(200.0), rig.flying(1.0));
    for _ in 0..20 {
        assert_eq!([rig.run_as(far, 5), rig.run_as(near, 1)], [1, 1]);
    }
    // A silence, or another start of the drone, ends it as well.
    for _ in 0..3 {
        assert_eq!(
            [rig.run_as(far, 5), rig.run(&[(2, State::Approach)], 3.0)],
            [1, 1]
        );
    }
    for boot in 8..12 {
        let mut anew = far;
        anew.header.boot = boot;
        rig.run(&[(2, State::Approach)], 1.5);
        assert_eq!(rig.run_as(anew, 5), 1);
    }
    // Many at once are no time.
    let mut rig = Rig::with_a_landed_drone();
    let burst = (1..20).map(|k| {
        let mut far = rig.flying(200.0);
        far.header.sequence = rig.sequence + k;
        far
    });
    rig.step(burst.collect());
    assert_eq!(rig.run(&[(2, State::Approach)], 600.0), 1);
}

#[test]
fn deck_of_a_drone_carried_off() {
    for distance_m in [Some(200.0), None] {
        let mut rig = Rig::with_a_landed_drone();
        let ashore = DroneStatus {
            landed: LandedState::OnGround,
            deck_distance_m: distance_m,
            state: State::Idle,
            ..rig.status((1, State::Landed))
        };
        assert_eq!(rig.run_as(ashore, 20), 1, "{distance_m:?}: no one looked");
        rig.order(DeckOrder::Open);
        assert_eq!(rig.run_as(ashore, 4), 2, "{distance_m:?}");
    }
    // In the air above the deck it is not freed by an order.
    let mut rig = Rig::after(&[(State::TrackingStable, 0.5), (State::Flare, 1.0)]);
    let mut blind = rig.flying(1.0);
    blind.deck_distance_m = None;
    rig.run_as(blind, 2);
    rig.order(DeckOrder::Open);
    assert_ne!(rig.run_as(blind, 20), 2);
}

#[test]
fn drone_switched_on_without_a_position() {
    let parked = |landed, distance_m| {
        let mut rig = Rig::new();
        let status = DroneStatus {
            landed,
            deck_distance_m: distance_m,
            ..rig.status((1, State::Idle))
        };
        (rig.run_as(status, 1), rig, status)
    };
    for landed in [LandedState::OnGround, LandedState::Unknown] {
        let (_, mut rig, status) = parked(landed, None);
        assert_eq!(rig.run_as(status, 60), 0, "{landed:?}");
        assert_eq!(rig.arbiter.unplaced().collect::<Vec<_>>(), [1]);
        // Also when it is switched off, and the vessel is started anew.
        assert_eq!(rig.run(&[(2, State::Approach)], 600.0), 0);
        rig.restart(Some(rig.arbiter.checkpoint()));
        assert_eq!(rig.run_as(status, 60), 0, "{landed:?}");
        // One position may be wrong; several locate it.
        let far = DroneStatus {
            deck_distance_m: Some(200.0),
            ..status
        };
        let mut other = Rig::new();
        other.run_as(status, 4);
        assert_eq!([other.run_as(far, 1), other.run_as(status, 4)], [0, 0]);
        assert_eq!(other.run_as(far, 8), 2, "{landed:?}");
        // Or the crew sees that nothing stands there.
        let (_, mut rig, status) = parked(landed, None);
        rig.run_as(status, 4);
        rig.order(DeckOrder::Open);
        assert_eq!(rig.run_as(status, 4), 2, "{landed:?}");
    }
    // It takes the deck from nobody who has it.
    let mut rig = Rig::new();
    rig.run(&[(2, State::TrackingStable)], 0.5);
    let status = DroneStatus {
        landed: LandedState::OnGround,
        ..rig.status((1, State::Idle))
    };
    assert_eq!(rig.run_as(status, 60), 2);
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
    // The owner is received again, and stays for a while.
    rig.run(&[(1, State::Descent)], 0.5);
    assert_eq!(waits(&mut rig, 1, Some(0.22)), None);
    rig.run(&[(3, State::Approach)], 600.0);
    assert_eq!(
        rig.arbiter.starved(Time::from_secs(rig.t_s)),
        None,
        "nobody low waits"
    );
}

#[test]
fn grant_of_the_first_request() {
    let mut rig = Rig::new();
    assert_eq!(rig.run(&[(1, State::TrackingStable)], 0.5), 1);
    for state in [State::Descent, State::Flare, State::Landed, State::Idle] {
        let both = [(1, state), (2, State::Approach)];
        assert_eq!(rig.run(&both, 5.0), 1, "{state:?}");
    }
    // Switched off on the deck: however long.
    assert_eq!(rig.run(&[(2, State::Approach)], 600.0), 1);
    // Until it has left, not before.
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
fn grant_after_a_manual_take_off() {
    let mut rig = Rig::after(&[(State::TrackingStable, 0.5), (State::Landed, 5.0)]);
    assert_eq!(rig.run(&[(1, State::Idle)], 5.0), 1);
    let at = |rig: &mut Rig, distance_m| rig.run_at((1, State::Idle), distance_m);
    assert_eq!([at(&mut rig, 1.0), at(&mut rig, 14.0)], [1, 1], "it climbs");
    assert_eq!(rig.run_as(rig.flying(25.0), 7), 2);
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
        // A person looks.
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
        // For as long as a landing takes it may come down unheard, however often the crew opens the deck.
        for silent_s in [2.5, 10.0, 58.0] {
            let now_s = 106.5 + silent_s;
            rig.run(&waiting, now_s - 0.5 - rig.t_s);
            rig.order(DeckOrder::Open);
            assert_eq!(rig.run(&waiting, 0.5), 1, "{last:?} {silent_s}");
            let unheard: Vec<_> = rig.arbiter.unheard(Time::from_secs(rig.t_s)).collect();
            assert_eq!(unheard.len(), 1, "{last:?} {silent_s}");
            assert_eq!(unheard[0].drone, 1);
            assert!((unheard[0].silent_s + unheard[0].remaining_s - 60.0).abs() < 1e-9);
        }
        // Somebody sees where it is. An order that names another says nothing of it.
        let mut seen = rig.clone();
        seen.order(DeckOrder::Clear(3));
        assert_eq!(seen.run(&waiting, 0.5), 1, "{last:?}");
        seen.order(DeckOrder::Clear(1));
        assert_eq!(seen.run(&waiting, 4.0), 2, "{last:?}");
        // Or whatever it had begun has ended.
        rig.run(&waiting, 3.0);
        assert_eq!(rig.arbiter.unheard(Time::from_secs(rig.t_s)).count(), 0);
        rig.order(DeckOrder::Open);
        assert_eq!(rig.run(&waiting, 4.0), 2, "{last:?}");
    }
    // One that reports from the deck is not argued away.
    let mut rig = Rig::with_a_landed_drone();
    rig.order(DeckOrder::Clear(1));
    assert_eq!(rig.run(&[(1, State::Landed), waiting[0]], 4.0), 1);
}

#[test]
fn unheard_owner_that_gives_way() {
    for last_s in [0.5, 1.5, 2.5] {
        let mut rig = Rig::after(&[(State::Approach, 0.5)]);
        // The deck was closed meanwhile: both wait, and the owner for too long.
        let both = [(1, State::Approach), (2, State::Approach)];
        let waited = (0..80).find(|_| rig.run(&both, 0.5) == 0);
        assert!(waited.is_some());
        rig.run(&both, last_s);
        let after = rig.run(&[(2, State::Approach)], 600.0);
        if last_s > topics::DECK.stale_after.secs() {
            assert_eq!(after, 2, "{last_s} s: it knows");
        } else {
            assert_eq!(after, 0, "{last_s} s");
            assert_eq!(rig.run(&both, 1.0), 2, "it reports from beyond");
        }
    }
}

#[test]
fn grant_after_a_broken_off_descent() {
    let mut rig = Rig::after(&[(State::TrackingStable, 0.5), (State::Descent, 5.0)]);
    let at = |rig: &mut Rig, distance_m| rig.run_at((1, State::GaveUp), distance_m);
    assert_eq!([at(&mut rig, 1.0), at(&mut rig, 14.0)], [1, 1], "it climbs");
    // It goes silent there: nobody knows where it is.
    assert_eq!(rig.run(&[(2, State::Approach)], 600.0), 1);
    assert_eq!(at(&mut rig, 16.0), 1);
    assert_eq!(rig.run_as(rig.flying(25.0), 6), 2);
}

#[test]
fn waiting_places() {
    let mut rig = Rig::new();
    let crowd: Vec<_> = (1..=PLACES as u32 + 2).map(|id| (id, State::Approach)).collect();
    rig.run(&crowd, 1.0);
    let places = |rig: &Rig| -> Vec<u32> {
        let holder = |k| rig.arbiter.drones.iter().find(|d| d.place == Some(k));
        (0..PLACES)
            .map(|k| holder(k).map_or(0, |d| d.header.drone))
            .collect()
    };
    let mut held: Vec<u32> = (1..=PLACES as u32).collect();
    assert_eq!(places(&rig), held, "the last two have none");
    // Through silence and a restart of the vessel.
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
    // The crew frees the deck, not the air beside it: the second lay there.
    rig.run(&[(2, State::Landed)], 1.0);
    rig.run(&crowd[8..], 60.0);
    rig.order(DeckOrder::Open);
    rig.run(&crowd[8..], 0.5);
    held[1] = PLACES as u32 + 2;
    assert_eq!(places(&rig), held);
}

#[test]
fn drone_reporting_from_the_deck() {
    let parked = |rig: &Rig, distance_m: Option<f32>, landed| DroneStatus {
        landed,
        deck_distance_m: distance_m,
        ..rig.status((1, State::Idle))
    };
    let cases = [
        (Some(1.0), LandedState::OnGround, 1),
        (Some(200.0), LandedState::OnGround, 2),
        // It may stand there.
        (None, LandedState::OnGround, 0),
        // Above it, whatever it means to do there.
        (Some(1.0), LandedState::InAir, 0),
    ];
    for (distance_m, landed, owner) in cases {
        let mut rig = Rig::new();
        for _ in 0..20 {
            rig.t_s += 0.5;
            rig.sequence += 1;
            let statuses = vec![parked(&rig, distance_m, landed), rig.status((2, State::Approach))];
            rig.step(statuses);
        }
        assert_eq!(
            rig.arbiter.owner().unwrap_or(0),
            owner,
            "{distance_m:?}, {landed:?}"
        );
    }
}

#[test]
fn deck_closed_until_the_crew_opens_it() {
    let mut rig = Rig::after(&[(State::TrackingStable, 2.0)]);
    assert_eq!(rig.order(DeckOrder::Closed).owner, DECK_CLOSED);
    let waiting = [(2, State::Approach)];
    rig.run(&waiting, 60.0);
    assert_eq!(rig.arbiter.published, DECK_CLOSED);
    // Also through a restart.
    rig.restart(Some(rig.arbiter.checkpoint()));
    rig.run(&waiting, 60.0);
    assert_eq!(rig.arbiter.published, DECK_CLOSED);
    rig.order(DeckOrder::Open);
    assert_eq!(rig.run(&waiting, 0.5), 2);
    // Whoever reports from the deck stands there, whatever the crew's order.
    rig.run(&[(2, State::Landed)], 5.0);
    assert_eq!(rig.order(DeckOrder::Open).owner, 2);
}

/// An order needs no disk: it opens also a deck whose checkpoint cannot be written.
#[test]
fn deck_order_with_a_full_disk() {
    let mut rig = Rig::after(&[(State::TrackingStable, 2.0)]);
    let kept = DeckCheckpoint {
        closed: Some(Closure::CheckpointUnwritable),
        ..DeckCheckpoint::default()
    };
    rig.restart(Some(kept));
    let waiting = [(2, State::Approach)];
    rig.run(&waiting, 60.0);
    assert_eq!(rig.arbiter.published, DECK_CLOSED);
    rig.order(DeckOrder::Open);
    assert_eq!(rig.run(&waiting, 0.5), 2);
}

#[test]
fn arbiter_restart_with_drones_on_and_near_the_deck() {
    for last in [State::Landed, State::Descent, State::TrackingStable] {
        let mut rig = Rig::after(&[(State::TrackingStable, 0.5), (last, 5.0)]);
        rig.restart(Some(rig.arbiter.checkpoint()));
        let waiting = [(2, State::Approach)];
        assert_eq!(rig.run(&waiting, 600.0), 1, "{last:?}");
        // The crew's word counts at once where it names the drone, or has looked for it where it stood. How long one that
        // was in the air had been silent before the restart is not known: its landing may have just begun.
        for order in [DeckOrder::Open, DeckOrder::Clear(1)] {
            let mut rig = rig.clone();
            rig.restart(Some(rig.arbiter.checkpoint()));
            rig.order(order);
            let freed = last == State::Landed || order == DeckOrder::Clear(1);
            assert_eq!(rig.run(&waiting, 4.0) == 2, freed, "{last:?} {order:?}");
            rig.run(&waiting, 60.0);
            rig.order(DeckOrder::Open);
            assert_eq!(rig.run(&waiting, 4.0), 2, "{last:?}");
        }
    }
    // Of a file that is missing or damaged nothing is known.
    for closure in [Closure::CheckpointMissing, Closure::CheckpointDamaged] {
        let mut rig = Rig::new();
        rig.restart(Some(DeckCheckpoint::unknown(closure)));
        assert_eq!(rig.run(&[(2, State::Approach)], 600.0), 0);
        assert_eq!(rig.arbiter.published, DECK_CLOSED);
        rig.order(DeckOrder::Open);
        assert_eq!(rig.run(&[(2, State::Approach)], 0.5), 2);
    }
}

#[test]
fn two_drones_with_one_number() {
    let mut rig = Rig::after(&[(State::TrackingStable, 0.5), (State::Descent, 2.0)]);
    let second = |rig: &Rig, state| {
        let at = Time::from_secs(rig.t_s);
        DroneStatus {
            header: Header::new(1, 1, 8, rig.sequence, at),
            ..rig.status((1, state))
        }
    };
    for k in 0..20 {
        rig.t_s += 0.5;
        rig.sequence += 1;
        let statuses = vec![rig.status((1, State::Descent)), second(&rig, State::Approach)];
        let grant = rig.step(statuses);
        if k >= 3 {
            assert!(grant.is_some_and(|g| g.place(1).is_none()), "nor one place");
            assert_eq!(
                rig.arbiter.published, DECK_CLOSED,
                "{k}: both would take it for theirs"
            );
        }
    }
    let doubles: Vec<_> = rig.arbiter.doubles().collect();
    assert_eq!(doubles, [(1, [7, 8])]);
    assert_eq!(rig.arbiter.owner(), Some(1), "the first is still on its way");
    // One of them is switched off.
    rig.run(&[(1, State::Descent)], 15.0);
    assert_eq!((rig.arbiter.published, rig.arbiter.doubles().count()), (1, 0));
}

#[test]
fn restarted_drone() {
    let mut rig = Rig::after(&[(State::TrackingStable, 0.5), (State::Landed, 5.0)]);
    for k in 1..20 {
        rig.t_s += 0.5;
        let status = DroneStatus {
            header: Header::new(1, 1, 8, k, Time::from_secs(rig.t_s)),
            ..rig.flying(2.0 * k as f32)
        };
        rig.step(vec![status]);
        assert_eq!(rig.arbiter.doubles().count(), 0);
    }
    assert!(rig.arbiter.rejected() <= 3, "{}", rig.arbiter.rejected());
    assert_eq!(rig.run(&[(2, State::Approach)], 6.0), 2);
}

#[test]
fn arbiter_restart_with_a_drone_in_descent() {
    let mut rig = Rig::new();
    rig.arbiter = DeckArbiter::new(&DeckConfig::default(), 1, 2);
    assert_eq!(rig.run(&[(2, State::Approach)], 2.0), 0);
    assert_eq!(rig.run(&[(2, State::Approach), (1, State::Descent)], 0.5), 1);
    assert_eq!(rig.run(&[(2, State::Approach), (1, State::Landed)], 60.0), 1);
}

#[test]
fn foreign_statuses_and_surplus_drones() {
    let mut rig = Rig::new();
    let foreign = DroneStatus {
        header: Header::new(9, 1, 7, 1, Time::EPOCH),
        state: State::TrackingStable,
        ..DroneStatus::default()
    };
    let statuses = vec![foreign];
    rig.t_s = 200.0;
    rig.step(statuses);
    assert_eq!((rig.arbiter.owner(), rig.arbiter.rejected()), (None, 1));
    let crowd: Vec<_> = (1..=80).map(|id| (id, State::Approach)).collect();
    assert_eq!(rig.run(&crowd, 0.5), 1);
    assert_eq!(rig.arbiter.rejected(), 1 + 80 - MAX_DRONES as u64);
}

/// With a switch of the crew, open, and a sensor of what lies on the deck, free.
fn with_inputs() -> Rig {
    let config = DeckConfig {
        crew_switch: "switch".into(),
        occupancy_sensor: "sensor".into(),
        ..DeckConfig::default()
    };
    let inputs = DeckInputs {
        closed: Some(false),
        occupied: Some(false),
        ..DeckInputs::default()
    };
    Rig::of(&config, inputs)
}

#[test]
fn deck_closed_by_switch_and_order() {
    let mut rig = with_inputs();
    let waiting = [(1, State::Approach)];
    rig.inputs.closed = Some(true);
    assert_eq!((rig.run(&waiting, 2.0), rig.closed()), (0, Some(Closure::Switch)));
    rig.order(DeckOrder::Open);
    assert_eq!(rig.closed(), Some(Closure::Switch), "the switch is closed still");
    assert_eq!(
        rig.arbiter.checkpoint().closed,
        None,
        "it is read again after a restart"
    );
    rig.order(DeckOrder::Closed);
    rig.inputs.closed = Some(false);
    assert_eq!((rig.run(&waiting, 2.0), rig.closed()), (0, Some(Closure::Crew)));
    rig.order(DeckOrder::Open);
    assert_eq!((rig.run(&waiting, 0.5), rig.closed()), (1, None));
    // Of a drone that has the deck already, as by an order.
    rig.inputs.closed = Some(true);
    rig.run(&[(1, State::Descent)], 0.5);
    assert_eq!(rig.closed(), Some(Closure::Switch));
}

#[test]
fn unread_deck_input() {
    let free = Some(false);
    for (closed, occupied, closure) in [(None, free, Closure::Switch), (free, None, Closure::Sensor)] {
        let unread = DeckInputs {
            closed,
            occupied,
            ..DeckInputs::default()
        };
        let mut rig = with_inputs();
        let read = rig.inputs;
        let waiting = [(1, State::Approach)];
        rig.inputs = unread;
        assert_eq!(
            (rig.run(&waiting, 2.0), rig.closed()),
            (1, None),
            "one reading is missed"
        );
        rig.run(&waiting, 0.5);
        assert_eq!(rig.closed(), Some(closure));
        rig.inputs = read;
        assert_eq!((rig.run(&waiting, 0.5), rig.closed()), (1, None));
        // Never read.
        rig.arbiter = DeckArbiter::new(&rig.arbiter.config, 1, 2);
        rig.inputs = unread;
        assert_eq!((rig.run(&waiting, 9.0), rig.closed()), (0, Some(closure)));
    }
}

#[test]
fn occupancy_sensor_under_a_drone() {
    let mut rig = with_inputs();
    let occupied = |rig: &Rig| rig.arbiter.occupied(Time::from_secs(rig.t_s));
    rig.inputs.occupied = Some(true);
    let first = |state| [(1, state), (2, State::Approach)];
    assert_eq!(rig.run(&first(State::TrackingStable), 9.0), 0);
    assert!(occupied(&rig) && rig.closed() == Some(Closure::Sensor));
    rig.inputs.occupied = Some(false);
    assert_eq!(rig.run(&first(State::TrackingStable), 0.5), 1);
    // Something comes to lie there while it descends, and is taken away.
    for (level, closed) in [(true, Some(Closure::Sensor)), (false, None)] {
        rig.inputs.occupied = Some(level);
        rig.run(&first(State::Descent), 2.0);
        assert_eq!(rig.closed(), closed);
    }
    for state in [State::Flare, State::Landed, State::Idle] {
        rig.inputs.occupied = Some(true);
        assert_eq!(
            (rig.run(&first(state), 9.0), rig.closed()),
            (1, None),
            "{state:?}"
        );
    }
    // A sensor that reports nothing frees the deck of nobody, silent or not.
    rig.inputs.occupied = Some(false);
    assert_eq!(rig.run(&first(State::Landed), 9.0), 1);
    assert_eq!(rig.run(&[(2, State::Approach)], 600.0), 1);
    assert!(occupied(&rig));
    // It landed without a radio.
    let mut rig = with_inputs();
    rig.run(&first(State::TrackingStable), 0.5);
    rig.run(&first(State::Descent), 0.5);
    rig.inputs.occupied = Some(true);
    assert_eq!((rig.run(&[(2, State::Approach)], 9.0), rig.closed()), (1, None));
}

/// The course that the grant of this time states.
fn stated(rig: &Rig) -> Course {
    rig.arbiter.course(Time::from_secs(rig.t_s))
}

#[test]
fn promise_of_a_steady_course_and_a_turn() {
    let mut rig = Rig::new();
    assert_eq!(stated(&rig), Course::Unknown);
    assert_eq!(rig.order(DeckOrder::Steady(60)).course, Course::Steady(60.0));
    rig.run(&[], 59.5);
    assert_eq!(stated(&rig), Course::Steady(0.5));
    rig.run(&[], 0.5);
    assert_eq!(stated(&rig), Course::Unknown);
    rig.order(DeckOrder::Steady(60));
    // Between two grants, too.
    rig.t_s += 0.01 - 0.5;
    assert_eq!(rig.order(DeckOrder::Turning).course, Course::Turning);
    rig.run(&[], 600.0);
    assert_eq!(stated(&rig), Course::Turning);
    rig.order(DeckOrder::Steady(0));
    assert_eq!(stated(&rig), Course::Unknown);
    // Given back by its helm, whatever was promised.
    rig.order(DeckOrder::Steady(60));
    let input = ArbiterIn {
        turns_back: true,
        ..ArbiterIn::default()
    };
    rig.arbiter.step(Time::from_secs(rig.t_s), &input);
    assert_eq!(stated(&rig), Course::Turning);
    assert!(!rig.arbiter.is_turning(Time::from_secs(rig.t_s)), "by no order");
}

#[test]
fn helm_switch_levels() {
    let config = DeckConfig {
        helm_switch: "switch".into(),
        ..DeckConfig::default()
    };
    let inputs = DeckInputs {
        turning: Some(false),
        ..DeckInputs::default()
    };
    let mut rig = Rig::of(&config, inputs);
    rig.run(&[], 300.0);
    assert_eq!(stated(&rig), Course::Steady(60.0));
    rig.order(DeckOrder::Steady(90));
    assert_eq!(stated(&rig), Course::Steady(90.0), "the longer promise");
    for level in [Some(true), None] {
        rig.inputs.turning = level;
        rig.run(&[], 3.0);
        assert_eq!(stated(&rig), Course::Turning, "{level:?}");
        rig.inputs.turning = Some(false);
        rig.run(&[], 0.5);
        assert!(matches!(stated(&rig), Course::Steady(_)));
    }
}

#[test]
fn wanted_steady_course() {
    let mut rig = Rig::new();
    let wants = |rig: &Rig| rig.arbiter.wants_steady(Time::from_secs(rig.t_s));
    for (state, wanted) in [
        (State::Approach, false),
        (State::TrackingStable, false),
        (State::Descent, true),
        (State::Flare, true),
        (State::Landed, false),
    ] {
        rig.run(&[(1, state)], 1.0);
        assert_eq!(wants(&rig), wanted, "{state:?}");
    }
    // It may be on its way down for as long as a descent lasts.
    rig.run(&[(1, State::Descent)], 1.0);
    rig.run(&[], 59.0);
    assert!(wants(&rig));
    rig.run(&[], 1.5);
    assert!(!wants(&rig));
    // One that begins no descent because of the course asks for a better one.
    rig.sequence += 1;
    let waits = DroneStatus {
        waiting: ReasonCode::VesselTurns.into(),
        ..rig.status((1, State::TrackingStable))
    };
    rig.step(vec![waits]);
    assert!(wants(&rig));
}

/// Two drones are ordered to one station: it is that of the first, also while that one is silent, until its time is over.
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
        let of = |id| {
            grant
                .places
                .iter()
                .position(|d| *d == id)
                .map_or(0, |k| grant.stations[k])
        };
        [of(1), of(2)]
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
