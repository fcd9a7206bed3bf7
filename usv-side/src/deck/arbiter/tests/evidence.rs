//! Evidence that a drone has left the deck, or stands there.

use super::*;

#[test]
fn single_status_from_beyond_the_deck() {
    let far = |change: fn(&mut DroneStatus)| {
        let mut rig = Rig::with_a_landed_drone();
        let mut status = rig.flying(200.0);
        change(&mut status);
        let owners = [rig.run_as(status, 1), rig.run_as(status, 6)];
        (owners, rig.arbiter.occupied(Time::from_secs(rig.t_s)))
    };
    // Several statuses over seconds, armed and in the air, show that it has left.
    assert_eq!(far(|_| {}), ([1, 2], false));
    let contrary: [fn(&mut DroneStatus); 6] = [
        |s| s.armed = false,
        |s| s.landed = LandedState::OnGround,
        |s| s.landed = LandedState::Unknown,
        |s| s.deck_distance_m = None,
        |s| s.deck_distance_m = Some(14.0),
        // The mission reports the drone on the deck, with a wrong position.
        |s| s.state = State::Landed,
    ];
    for (k, change) in contrary.into_iter().enumerate() {
        assert_eq!(far(change), ([1, 1], true), "{k}");
    }
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
    let far = rig.flying(200.0);
    let near = rig.flying(1.0);
    for _ in 0..20 {
        assert_eq!([rig.run_as(far, 5), rig.run_as(near, 1)], [1, 1]);
    }
    // A silence or a restart of the drone resets the evidence.
    for _ in 0..3 {
        assert_eq!(
            [rig.run_as(far, 5), rig.run(&[(2, State::Approach)], 3.0)],
            [1, 1]
        );
    }
    for boot in 8..12 {
        let mut restarted = far;
        restarted.header.boot = boot;
        rig.run(&[(2, State::Approach)], 1.5);
        assert_eq!(rig.run_as(restarted, 5), 1);
    }
    // Statuses that arrive at once do not span the required time.
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
    // An order does not release a drone in the air above the deck.
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
        // No drone receives the deck, even when this one is switched off, and after a restart of the vessel.
        assert_eq!(rig.run(&[(2, State::Approach)], 600.0), 0);
        rig.restart(Some(rig.arbiter.checkpoint()));
        assert_eq!(rig.run_as(status, 60), 0, "{landed:?}");
        let far = DroneStatus {
            deck_distance_m: Some(200.0),
            ..status
        };
        let mut other = Rig::new();
        other.run_as(status, 4);
        assert_eq!([other.run_as(far, 1), other.run_as(status, 4)], [0, 0]);
        assert_eq!(other.run_as(far, 8), 2, "{landed:?}");
        let (_, mut rig, status) = parked(landed, None);
        rig.run_as(status, 4);
        rig.order(DeckOrder::Open);
        assert_eq!(rig.run_as(status, 4), 2, "{landed:?}");
    }
    // A drone without a position does not take the deck from its owner.
    let mut rig = Rig::new();
    rig.run(&[(2, State::TrackingStable)], 0.5);
    let status = DroneStatus {
        landed: LandedState::OnGround,
        ..rig.status((1, State::Idle))
    };
    assert_eq!(rig.run_as(status, 60), 2);
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
        // The drone may stand on the deck.
        (None, LandedState::OnGround, 0),
        // The drone is above the deck, whatever its intention.
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
