use super::*;
use crate::deck::ClearanceEnd;
use alight_shared::msg::TAKE_OFF_CLEARANCE_S;

/// A clearance applies to the drone on the deck, for a limited time, until the deck is closed.
#[test]
fn clearance_for_a_take_off() {
    let mut rig = Rig::new();
    assert!(
        !rig.order(DeckOrder::TakeOff(1)).take_off,
        "no drone stands there"
    );
    assert_eq!(rig.run(&[(1, State::Landed)], 2.0), 1);
    let cleared = |rig: &Rig| rig.arbiter.take_off;
    assert!(cleared(&rig), "given before the drone was known to stand there");
    rig.run(&[(1, State::Preparing)], 2.0);
    rig.run(&[(1, State::SpinUp)], 2.0);
    assert!(cleared(&rig));
    assert!(!rig.order(DeckOrder::Closed).take_off);
    assert!(
        !rig.order(DeckOrder::Open).take_off,
        "a clearance from before the deck was closed"
    );
    assert!(!rig.order(DeckOrder::TakeOff(2)).take_off, "another's");
    assert!(rig.order(DeckOrder::TakeOff(1)).take_off);
    rig.run(&[(1, State::SpinUp)], TAKE_OFF_CLEARANCE_S + 1.0);
    assert!(!cleared(&rig), "it has expired");
    // The drone keeps the deck until it has certainly left.
    rig.order(DeckOrder::TakeOff(1));
    assert_eq!(rig.run(&[(1, State::TakeOff), (2, State::Approach)], 3.0), 1);
    assert!(!cleared(&rig));
    assert_eq!(rig.run(&[(1, State::ClimbOut), (2, State::Approach)], 8.0), 1);
    rig.run(&[(1, State::Landed)], 2.0);
    assert!(!cleared(&rig), "the clearance was for one take-off");
}

/// A take-off that is stopped on the deck, or not begun in time, uses the clearance up.
#[test]
fn clearance_after_a_stopped_take_off() {
    let cleared = |before, after| {
        let mut rig = Rig::new();
        rig.run(&[(1, State::Landed)], 2.0);
        assert!(rig.order(DeckOrder::TakeOff(1)).take_off);
        for state in [before, after, State::Preparing] {
            rig.run(&[(1, state)], 2.0);
        }
        rig.arbiter.take_off
    };
    for (before, after) in [
        (State::SpinUp, State::StandDown),
        (State::SpinUp, State::Landed),
        (State::Preparing, State::Landed),
        (State::Landed, State::StandDown),
    ] {
        assert!(!cleared(before, after), "{before:?}, {after:?}");
    }
    assert!(cleared(State::Countdown, State::Preparing));
}

/// A standing clearance outlasts take-offs and an abandoned preparation, but not a take-off stopped on the deck.
#[test]
fn standing_clearance_after_the_end_of_a_take_off() {
    let stands = |states: &[State]| {
        let mut rig = Rig::new();
        rig.run(&[(1, State::Landed)], 2.0);
        assert!(rig.order(DeckOrder::TakeOffStanding(1)).take_off);
        for state in states.iter().chain(&[State::Landed]) {
            rig.run(&[(1, *state)], 2.0);
        }
        rig.arbiter.take_off
    };
    assert!(stands(&[
        State::SpinUp,
        State::TakeOff,
        State::ClimbOut,
        State::Hold
    ]));
    assert!(stands(&[State::Preparing]));
    assert!(!stands(&[State::SpinUp, State::StandDown]));
    assert!(!stands(&[State::Countdown, State::Idle]));
}

/// Standing clearances of two drones, each for its own take-offs until the deck is closed; the deck is also requested.
#[test]
fn standing_clearance_of_two_drones() {
    let mut rig = Rig::new();
    rig.order(DeckOrder::TakeOffStanding(1));
    rig.order(DeckOrder::TakeOffStanding(2));
    let cleared = |rig: &Rig| rig.arbiter.take_off;
    let there = State::Landed;
    for (here, comes) in [(1, 2), (2, 1), (1, 2)] {
        assert_eq!(rig.run(&[(here, there)], TAKE_OFF_CLEARANCE_S + 1.0), here);
        assert!(cleared(&rig), "drone {here}, after hours as well");
        assert!(!rig.arbiter.is_wanted(Time::from_secs(rig.t_s)));
        rig.run(&[(here, there), (comes, State::Approach)], 1.0);
        assert!(rig.arbiter.is_wanted(Time::from_secs(rig.t_s)));
        rig.run(&[(here, State::TakeOff), (comes, State::Approach)], 3.0);
        assert!(!cleared(&rig));
        let owner = rig.run(&[(here, State::Hold), (comes, State::Approach)], 20.0);
        assert_eq!(owner, comes);
        assert!(
            !rig.arbiter.is_wanted(Time::from_secs(rig.t_s)),
            "no drone stands there"
        );
    }
    rig.run(&[(2, State::Landed), (1, State::Hold)], 2.0);
    assert!(cleared(&rig));
    assert!(!rig.order(DeckOrder::Closed).take_off);
    rig.order(DeckOrder::Open);
    rig.run(&[(2, State::Landed)], 2.0);
    assert!(!cleared(&rig), "closing the deck ended it");
}

/// Rig whose first drone stands on the deck with a standing clearance.
fn standing_with(config: &DeckConfig, inputs: DeckInputs) -> Rig {
    let mut rig = Rig::of(config, inputs);
    rig.run(&[(1, State::Landed)], 2.0);
    assert!(rig.order(DeckOrder::TakeOffStanding(1)).take_off);
    rig
}

#[test]
fn standing_clearance_that_was_forgotten() {
    let weighed = DeckConfig {
        occupancy_sensor: "weight".into(),
        ..DeckConfig::default()
    };
    let there = DeckInputs {
        occupied: Some(true),
        ..DeckInputs::default()
    };
    for (config, inputs, lasts_s, ends_s) in [
        (DeckConfig::default(), DeckInputs::default(), 590.0, 20.0),
        (weighed, there, 14_000.0, 500.0),
    ] {
        let mut rig = standing_with(&config, inputs);
        rig.run(&[(1, State::Landed)], lasts_s);
        assert!(rig.arbiter.take_off);
        rig.run(&[(1, State::Landed)], ends_s);
        assert!(!rig.arbiter.take_off, "after {lasts_s} s");
        assert_eq!(rig.arbiter.ended_clearances(), [(1, ClearanceEnd::Time)]);
        assert!(rig.order(DeckOrder::TakeOff(1)).take_off, "given again");
    }
    // A sortie does not use up a standing clearance, and each stay has its own time limit.
    let mut rig = standing_with(&DeckConfig::default(), DeckInputs::default());
    for state in [State::TakeOff, State::ClimbOut, State::Hold, State::Descent] {
        rig.run(&[(1, state)], 200.0);
    }
    rig.run(&[(1, State::Landed)], 500.0);
    assert!(rig.arbiter.take_off);
}

/// Signs that somebody was at the drone: changed battery, restarted computer, lifted drone.
#[test]
fn clearance_after_somebody_was_at_the_drone() {
    type Change = fn(&mut DroneStatus);
    let battery = |charge: f64| {
        let mut rig = standing_with(&DeckConfig::default(), DeckInputs::default());
        for _ in 0..60 {
            rig.t_s += 0.5;
            rig.sequence += 1;
            let mut status = rig.status((1, State::Landed));
            status.battery = Some(charge);
            rig.step(vec![status]);
        }
        (rig.arbiter.take_off, rig.arbiter.ended_clearances())
    };
    assert_eq!(battery(1.0), (false, vec![(1, ClearanceEnd::Battery)]));
    assert_eq!(battery(0.9), (true, vec![]), "a gauge that recovers");
    let restarted: Change = |s| s.header.boot = 8;
    let silent = |change: Change| {
        let mut rig = standing_with(&DeckConfig::default(), DeckInputs::default());
        for k in 0..6 {
            rig.t_s += if k == 0 { 20.0 } else { 0.5 };
            rig.sequence += 1;
            let mut status = rig.status((1, State::Landed));
            change(&mut status);
            rig.step(vec![status]);
        }
        (rig.arbiter.take_off, rig.arbiter.ended_clearances())
    };
    assert_eq!(silent(restarted), (false, vec![(1, ClearanceEnd::Computer)]));
    assert_eq!(silent(|_| ()), (true, vec![]));
    // A charger takes longer than a battery change.
    let mut rig = standing_with(&DeckConfig::default(), DeckInputs::default());
    for k in 0..800 {
        rig.t_s += 0.5;
        rig.sequence += 1;
        let mut status = rig.status((1, State::Landed));
        status.battery = Some(0.3 + 0.0015 * 0.5 * f64::from(k));
        rig.step(vec![status]);
    }
    assert!(rig.arbiter.take_off);
}

#[test]
fn clearance_of_a_drone_that_was_lifted() {
    let weighed = DeckConfig {
        occupancy_sensor: "weight".into(),
        ..DeckConfig::default()
    };
    let level = |level| DeckInputs {
        occupied: Some(level),
        ..DeckInputs::default()
    };
    let lifted = |state| {
        let mut rig = standing_with(&weighed, level(true));
        rig.run(&[(1, state)], 1.0);
        rig.inputs = level(false);
        rig.run(&[(1, state)], 1.0);
        rig.inputs = level(true);
        rig.run(&[(1, state)], 1.0);
        rig.arbiter.ended_clearances()
    };
    assert_eq!(lifted(State::Landed), [(1, ClearanceEnd::Lifted)]);
    assert_eq!(lifted(State::SpinUp), [], "by its rotors");
}
