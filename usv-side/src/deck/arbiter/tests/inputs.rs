//! Digital inputs: the crew's switch and the occupancy sensor.

use super::*;

/// Rig with an open crew switch and a sensor that reports a free deck.
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
    assert_eq!(rig.closed(), Some(Closure::Switch), "the switch is still closed");
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
    // A closed input has the effect of an order, also for the present owner.
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
    // A sensor that reports a free deck never ends an ownership.
    rig.inputs.occupied = Some(false);
    assert_eq!(rig.run(&first(State::Landed), 9.0), 1);
    assert_eq!(rig.run(&[(2, State::Approach)], 600.0), 1);
    assert!(occupied(&rig));
    // The drone landed without a radio.
    let mut rig = with_inputs();
    rig.run(&first(State::TrackingStable), 0.5);
    rig.run(&first(State::Descent), 0.5);
    rig.inputs.occupied = Some(true);
    assert_eq!((rig.run(&[(2, State::Approach)], 9.0), rig.closed()), (1, None));
}
