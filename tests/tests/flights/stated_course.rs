//! Course stated by the helm, in the whole world: from its order on board to the drone's descent.

use alight_shared::msg::{DeckOrder, ReasonCode, State};
use alight_sim::harness::rig::Rig;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};

/// A drone in a slight sea that tracks the deck of a vessel whose helm has stated this.
fn tracking(stated: Option<DeckOrder>) -> Rig {
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.reservation_required = true;
    let scenario = Scenario {
        sea: "slight".parse().unwrap(),
        ..Scenario::default()
    };
    let mut rig = Rig::landing(&scenario, &nodes, 31).unwrap();
    assert!(reaches(&mut rig, 60.0, State::Tracking));
    stated.into_iter().for_each(|order| rig.world.deck_order(order));
    rig
}
/// Flown until the drone is in this state, `limit_s` at most; whether it is.
fn reaches(rig: &mut Rig, limit_s: f64, state: State) -> bool {
    rig.until(limit_s, |rig| rig.state(0) == state)
}

#[test]
fn landing_within_a_promise_of_60_s_or_none() {
    for stated in [Some(DeckOrder::Steady(60)), None] {
        let mut rig = tracking(stated);
        assert!(!rig.world.wants_steady());
        assert!(reaches(&mut rig, 20.0, State::Descent), "{stated:?}");
        assert!(reaches(&mut rig, 30.0, State::Flare), "{stated:?}");
        assert!(rig.world.wants_steady());
        assert!(reaches(&mut rig, 30.0, State::Landed), "{stated:?}");
        reaches(&mut rig, 2.0, State::Idle);
        assert!(!rig.world.wants_steady());
    }
}

#[test]
fn descent_with_a_turn_or_a_short_promise() {
    for (stated, why) in [
        (DeckOrder::Turning, ReasonCode::VesselTurns),
        (DeckOrder::Steady(10), ReasonCode::CourseEnds),
    ] {
        let mut rig = tracking(None);
        // Given before a descent can have begun.
        rig.world.deck_order(stated);
        assert!(!reaches(&mut rig, 8.0, State::Descent), "{stated:?}");
        assert_eq!(rig.mission(0).waiting.code, why);
        assert!(rig.world.wants_steady(), "it asks for a steady course");
        rig.world.deck_order(DeckOrder::Steady(60));
        assert!(reaches(&mut rig, 30.0, State::Landed), "{stated:?}");
    }
}

#[test]
fn turn_stated_in_a_descent() {
    let mut rig = tracking(Some(DeckOrder::Steady(60)));
    assert!(reaches(&mut rig, 20.0, State::Descent));
    rig.world.deck_order(DeckOrder::Turning);
    assert!(reaches(&mut rig, 1.0, State::Tracking));
    assert!(!reaches(&mut rig, 10.0, State::Descent));
}
