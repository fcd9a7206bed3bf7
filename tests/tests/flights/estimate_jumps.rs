//! Jumps of the autopilot's estimate: a late heading alignment, and resets of position and height during the
//! descent, whether or not the autopilot counts them.

use alight_shared::msg::State;
use alight_sim::harness::{
    outcome::TIME_LIMIT_S,
    rig::Rig,
    scenario::{NodeConfigs, Scenario},
};
use alight_uav::autopilot::modes::Firmware;
use nalgebra::Vector3;

use crate::{BOTH, judged};

fn scenario(firmware: Firmware) -> Scenario {
    let mut scenario = Scenario::default();
    scenario.drone.autopilot.firmware = firmware;
    scenario
}

#[test]
fn deck_detected_after_a_late_heading() {
    for firmware in BOTH {
        let mut rig = Rig::landing(&scenario(firmware), &NodeConfigs::default(), 0).unwrap();
        let sees = |rig: &Rig| {
            let newest = rig.world.drones()[0].forecast;
            newest.is_some_and(|f| f.vision_age_s < 1.0)
        };
        assert!(rig.until(120.0, sees), "{firmware:?}: {:?}", rig.visited(0));
    }
}

/// Directions are unknown before the alignment: no odometry, no mode, no set-point.
#[test]
fn nothing_flown_before_the_heading_is_aligned() {
    for firmware in BOTH {
        for seed in 0..2 {
            let mut scenario = scenario(firmware);
            scenario.start.hover_s = 1.0;
            let mut rig = Rig::landing(&scenario, &NodeConfigs::default(), seed).unwrap();
            let mut aligned = false;
            rig.until(6.0, |rig| {
                let drone = &rig.world.drones()[0];
                aligned |= drone.autopilot_is_aligned();
                let flies = !matches!(drone.mission_state.state, State::Idle);
                assert!(
                    aligned || !flies && drone.forecast.is_none(),
                    "{firmware:?} {seed}"
                );
                aligned && flies
            });
            assert!(
                aligned && rig.state(0) != State::Idle,
                "{firmware:?} {seed}: {}",
                rig.mission(0).waiting
            );
        }
    }
}

/// Flies every seventh combination of reset and phase, with alternating autopilots.
#[test]
fn position_resets_in_every_phase() {
    let phases = [
        (State::Flare, 0.1),
        (State::Flare, 0.5),
        (State::Descent, 1.0),
        (State::Tracking, 0.3),
        (State::Approach, 2.0),
    ];
    let resets = [[0.0, 0.0, 0.4], [0.0, 0.0, -0.4], [2.5, -1.5, 0.0]];
    let cases = phases
        .into_iter()
        .flat_map(|phase| resets.map(|by| [true, false].map(|counted| (phase, by, counted))))
        .flatten();
    let firmwares = BOTH.into_iter().cycle();
    for ((n, (phase, by, counted)), firmware) in cases.enumerate().step_by(7).zip(firmwares) {
        let seed = 201 + n as u64;
        let mut rig = Rig::landing(&scenario(firmware), &NodeConfigs::default(), seed).unwrap();
        let mut done = false;
        let outcome = judged(&mut rig, seed, TIME_LIMIT_S, |rig| {
            if !done && rig.is_due(phase.0, phase.1) {
                done = true;
                rig.world.reset_position(0, &Vector3::from(by), counted);
            }
        });
        let lands = outcome.success && outcome.attempts == 1 && outcome.touchdown_speed_mps < Some(1.0);
        assert!(
            done && lands,
            "{firmware:?} {phase:?} {by:?} {counted}: {outcome:#?}"
        );
    }
}
