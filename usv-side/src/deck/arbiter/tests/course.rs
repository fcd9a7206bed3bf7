//! Course in the grant, and requests for a steady course.

use super::*;
use alight_shared::msg::ReasonCode;

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
    rig.t_s += 0.01 - 0.5;
    assert_eq!(rig.order(DeckOrder::Turning).course, Course::Turning);
    rig.run(&[], 600.0);
    assert_eq!(stated(&rig), Course::Turning);
    rig.order(DeckOrder::Steady(0));
    assert_eq!(stated(&rig), Course::Unknown);
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
    // A silent drone may be descending for as long as a descent lasts.
    rig.run(&[(1, State::Descent)], 1.0);
    rig.run(&[], 59.0);
    assert!(wants(&rig));
    rig.run(&[], 1.5);
    assert!(!wants(&rig));
    rig.sequence += 1;
    let waits = DroneStatus {
        waiting: ReasonCode::VesselTurns.into(),
        ..rig.status((1, State::TrackingStable))
    };
    rig.step(vec![waits]);
    assert!(wants(&rig));
}
