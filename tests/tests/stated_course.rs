//! What the helm states of the vessel's course, in the whole world: from its order on board to the drone's descent.
// Helpers of tests may panic, as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

use alight_shared::msg::{CommandKind, ReasonCode, State};
use alight_sim::harness::physics::TICK;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::tap::NoTap;
use alight_sim::harness::world::World;
use alight_usv::deck::DeckOrder;

/// A drone in a slight sea that is commanded to land, on a vessel whose helm has stated this.
struct Story {
    world: World,
}

impl Story {
    fn begin(stated: Option<DeckOrder>) -> Story {
        let mut nodes = NodeConfigs::default();
        nodes.drone.mission.reservation_required = true;
        let scenario = Scenario {
            sea: "slight".parse().unwrap(),
            ..Scenario::default()
        };
        let mut world = World::new(&scenario, &nodes, 31).unwrap();
        world.warm_up(&mut NoTap);
        world.command(CommandKind::Land);
        let mut story = Story { world };
        assert!(story.fly(60.0, State::Tracking));
        if let Some(order) = stated {
            story.world.deck_order(order);
        }
        story
    }
    fn state(&self) -> State {
        self.world.drones()[0].mission_state.state
    }
    fn waits_for(&self) -> ReasonCode {
        self.world.drones()[0].mission_state.waiting.code
    }
    fn lamp_is_lit(&self) -> bool {
        self.world.wants_steady()
    }
    /// Until it is in `state`, `limit_s` at most; whether it is.
    fn fly(&mut self, limit_s: f64, state: State) -> bool {
        for _ in 0..(limit_s / TICK.secs()) as u32 {
            if self.state() == state {
                return true;
            }
            self.world.tick(&mut NoTap);
        }
        false
    }
}

#[test]
fn drone_lands_within_a_promise_of_60_s_and_where_nothing_is_stated() {
    for stated in [Some(DeckOrder::Steady(60)), None] {
        let mut story = Story::begin(stated);
        assert!(!story.lamp_is_lit());
        assert!(story.fly(20.0, State::Descent), "{stated:?}");
        assert!(story.fly(30.0, State::Flare), "{stated:?}");
        assert!(story.lamp_is_lit());
        assert!(story.fly(30.0, State::Landed), "{stated:?}");
        story.fly(2.0, State::Idle);
        assert!(!story.lamp_is_lit());
    }
}

#[test]
fn drone_begins_no_descent_on_a_vessel_that_turns_or_promises_too_little() {
    for (stated, why) in [
        (DeckOrder::Turning, ReasonCode::VesselTurns),
        (DeckOrder::Steady(10), ReasonCode::CourseEnds),
    ] {
        let mut story = Story::begin(None);
        // Given before a descent can have begun.
        story.world.deck_order(stated);
        assert!(!story.fly(8.0, State::Descent), "{stated:?}");
        assert_eq!(story.waits_for(), why);
        assert!(story.lamp_is_lit(), "it asks for a steady course");
        story.world.deck_order(DeckOrder::Steady(60));
        assert!(story.fly(30.0, State::Landed), "{stated:?}");
    }
}

#[test]
fn turn_stated_in_a_descent_breaks_it_off_above_the_commit_clearance() {
    let mut story = Story::begin(Some(DeckOrder::Steady(60)));
    assert!(story.fly(20.0, State::Descent));
    story.world.deck_order(DeckOrder::Turning);
    assert!(story.fly(1.0, State::Tracking));
    assert!(!story.fly(10.0, State::Descent));
}
