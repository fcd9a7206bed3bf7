//! Stated course: from the helm's order on the vessel to the drone's descent.

use alight_shared::msg::{DeckOrder, ReasonCode, State};
use alight_sim::harness::{rig::Rig, scenario::NodeConfigs};

use crate::at_sea;

fn tracking() -> Rig {
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.reservation_required = true;
    let scenario = at_sea("slight");
    let mut rig = Rig::landing(&scenario, &nodes, 31).unwrap();
    assert!(reaches(&mut rig, 60.0, State::Tracking));
    rig
}
fn reaches(rig: &mut Rig, limit_s: f64, state: State) -> bool {
    rig.until(limit_s, |rig| rig.state(0) == state)
}

#[test]
fn descent_with_a_turn_or_a_short_promise() {
    for (stated, why) in [
        (DeckOrder::Turning, ReasonCode::VesselTurns),
        (DeckOrder::Steady(10), ReasonCode::CourseEnds),
    ] {
        let mut rig = tracking();
        // Ordered before a descent can begin.
        rig.world.deck_order(stated);
        assert!(!reaches(&mut rig, 8.0, State::Descent), "{stated:?}");
        assert_eq!(rig.mission(0).waiting.code, why);
        assert!(rig.world.wants_steady(), "it asks for a steady course");
        rig.world.deck_order(DeckOrder::Steady(60));
        assert!(reaches(&mut rig, 30.0, State::Landed), "{stated:?}");
    }
}
