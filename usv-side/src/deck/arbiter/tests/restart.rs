//! Restarts of the vessel and of drones, and two senders with one number.

use super::*;

#[test]
fn arbiter_restart_with_drones_on_and_near_the_deck() {
    for last in [State::Landed, State::Descent, State::TrackingStable] {
        let mut rig = Rig::after(&[(State::TrackingStable, 0.5), (last, 5.0)]);
        rig.restart(Some(rig.arbiter.checkpoint()));
        let waiting = [(2, State::Approach)];
        assert_eq!(rig.run(&waiting, 600.0), 1, "{last:?}");
        // An order applies at once if it names the drone, or if the drone stood on the deck. A drone in the
        // air may have begun its landing just before the restart.
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
    // Without a readable file nothing is known about the deck. An order opens it even if the disk fails.
    for closure in [
        Closure::CheckpointMissing,
        Closure::CheckpointDamaged,
        Closure::CheckpointUnwritable,
    ] {
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
