//! Landings in lock-step with both firmwares and slow wires.

use alight_shared::{
    msg::{CommandKind, State},
    time::Span,
};
use alight_sim::harness::{
    observer::NoObserver,
    outcome::Outcome,
    scenario::{NodeConfigs, Scenario},
    trial::{self, Event, Watch, land},
    world::World,
};
use alight_uav::autopilot::modes::Firmware;

use crate::at_sea;

fn fly(firmware: Firmware, wire_s: f64, seed: u64) -> Outcome {
    let mut scenario = at_sea("moderate");
    let a = &mut scenario.drone.autopilot;
    a.firmware = firmware;
    a.wire_s = wire_s;
    trial::outcome(&scenario, &NodeConfigs::default(), seed, "moderate").unwrap()
}

/// Lands on two seeds at Moderate over each wire: all landings succeed within 0.15 m of the centre, and none is unsafe.
fn lands(firmware: Firmware) {
    for (wire_s, seed) in [0.005, 0.02, 0.04].repeat(2).into_iter().zip(300..) {
        let o = fly(firmware, wire_s, seed);
        let what = format!("{} over {wire_s} s: {o:?}", firmware.name());
        assert!(o.success && o.unsafe_contacts == 0, "{what}");
        assert!(o.position_error_m.is_some_and(|e| e < 0.15), "{what}");
    }
}

#[test]
fn px4_landing_with_5_to_40_ms_on_the_wire() {
    lands(Firmware::Px4);
}

#[test]
fn arducopter_landing_with_5_to_40_ms_on_the_wire() {
    lands(Firmware::ArduCopter);
}

#[test]
fn landing_after_the_failsafe_parameter() {
    // The time-out keeps the firmware's default until the pilot sets it 10 s after the order.
    let scenario = Scenario::default();
    let nodes = NodeConfigs::default();
    let mut world = World::new(&scenario, &nodes, 300).unwrap();
    let waited_s = 10.0;
    let set = |world: &mut World, timeout_s: f64| {
        let a = &mut world.linked(0).unwrap().autopilot;
        a.parameters.insert("COM_OF_LOSS_T", timeout_s);
    };
    while world.linked(0).is_none() {
        world.warm_up_tick(&mut NoObserver);
    }
    set(&mut world, 1.0);
    world.warm_up(&mut NoObserver);
    world.command(CommandKind::Land);
    while world.physics().time_since_start() < Span::from_secs(waited_s) {
        world.tick(&mut NoObserver);
        assert_eq!(world.mission_state().state, State::Idle);
    }
    set(&mut world, 0.25);
    let mut began_s = None;
    let watch = Watch {
        on_event: &mut |Event::Phase { t_s, .. }| {
            began_s.get_or_insert(*t_s);
        },
        trace_step_s: None,
    };
    let o = land(world, &scenario, &nodes, 300, "default", watch, &mut NoObserver).outcome;
    assert!(
        began_s.is_some_and(|t| (waited_s..waited_s + 2.5).contains(&t)),
        "{began_s:?}"
    );
    assert!(o.success, "{o:?}");
}
