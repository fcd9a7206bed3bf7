//! Take-off: mode, arming, denial, and disarm after a stop.

use alight_shared::msg::{AutopilotMode, DroneState, ReasonCode, SetPoint, SetPointKind, State};
use alight_sim::autopilots::simulated::own_mission_mode;
use alight_uav::autopilot::{
    message::{Address, MavAutopilot, MavCmd, MavModeFlag, MavType, heartbeat},
    modes::{Firmware, px4_mode},
};

use super::{
    BOTH, commanding, config,
    rig::{LinkRig, STEP, hover},
};

fn stand(_: &DroneState) -> SetPoint {
    SetPoint {
        kind: SetPointKind::Attitude,
        thrust: 0.3 * hover(),
        ..SetPoint::default()
    }
}
fn standing(firmware: Firmware) -> LinkRig {
    let mut p = LinkRig::new(firmware, 0.3, &config());
    p.linked.autopilot.arm(false);
    p.pilot = Some(stand);
    p.mission = State::Countdown;
    p.run(6.0);
    p
}

#[test]
fn mode_and_arming_of_a_take_off() {
    for firmware in BOTH {
        let mut p = standing(firmware);
        // The link commands nothing before the countdown ends.
        let commands = [MavCmd::MAV_CMD_DO_SET_MODE, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM];
        assert!(
            commands.iter().all(|c| p.commands_of(*c).is_empty()),
            "{firmware:?}"
        );
        p.mission = State::SpinUp;
        p.run(8.0);
        assert!(
            p.linked.autopilot.armed() && p.mode() == AutopilotMode::Offboard,
            "{firmware:?}"
        );
        p.assert_commanding();
        assert_eq!(p.arm_commands().len(), 1, "{firmware:?}");
        // The accepted command counts before the next heartbeat.
        let arms = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
        let sent = p.commands.iter().find(|(_, c)| c.command == arms);
        let armed = p.states.iter().find(|a| a.armed).map(|a| a.header.at.secs());
        let took_s = armed.unwrap() - sent.unwrap().0;
        assert!(took_s < 0.3, "{firmware:?}: {took_s} s");
        assert!(p.arm_commands()[0].parameters[1] == 0.0, "not by force");
        // The drone is disarmed after the stop, and not armed again.
        p.mission = State::StandDown;
        p.run(2.0);
        assert!(!p.linked.autopilot.armed(), "{firmware:?}");
        p.mission = State::Idle;
        p.run(5.0);
        assert!(!p.linked.autopilot.armed(), "{firmware:?}");
    }
}

#[test]
fn autopilot_that_does_not_arm() {
    let text = "Preflight Fail: Gyro 0 inconsistent - check cal";
    for firmware in BOTH {
        let mut p = standing(firmware);
        p.linked.autopilot.arming_fault = Some(text);
        p.mission = State::SpinUp;
        p.run(10.0);
        assert!(!p.linked.autopilot.armed());
        assert_eq!(p.arm_commands().len(), 3, "{firmware:?}");
        let expected = format!("{} does not arm: {text}", firmware.name());
        assert!(p.texts.contains(&expected), "{firmware:?}: {:?}", p.texts);
        let sent = p
            .notes
            .iter()
            .any(|(_, note)| note.contains("does not arm: Preflight"));
        assert!(sent, "{firmware:?}: {:?}", p.notes);
    }
}

/// The rotors start before a heartbeat reports it; the stop may come in between.
#[test]
fn take_off_stopped_as_the_autopilot_arms() {
    for firmware in BOTH {
        let mut p = standing(firmware);
        p.mission = State::SpinUp;
        for _ in 0..2000 {
            if !p.arm_commands().is_empty() {
                break;
            }
            p.run(STEP.secs());
        }
        p.run(0.1);
        p.mission = State::StandDown;
        p.run(4.0);
        let sent = p.arm_commands();
        let forced = sent.iter().skip(1).all(|c| c.parameters[1] != 0.0);
        assert!(sent.len() > 1 && forced, "{firmware:?}: {sent:?}");
        assert!(!p.linked.autopilot.armed(), "{firmware:?}");
    }
}

/// The link does not guess which of the autopilots belongs to the drone.
#[test]
fn take_off_with_two_autopilots_on_the_link() {
    let mut p = standing(Firmware::Px4);
    let neighbour = heartbeat(
        MavAutopilot::MAV_AUTOPILOT_PX4,
        MavType::MAV_TYPE_QUADROTOR,
        MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
        px4_mode(4, 4),
    );
    p.mission = State::SpinUp;
    for _ in 0..16 {
        p.inject(Address::new(4, 1), &neighbour);
        p.run(0.5);
    }
    let commands = [MavCmd::MAV_CMD_DO_SET_MODE, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM];
    assert!(commands.iter().all(|c| p.commands_of(*c).is_empty()));
    assert_eq!(p.state().rejection.code, ReasonCode::SeveralAutopilots);
}

/// A pilot who selects a mode takes manual control: the link neither takes it back nor disarms.
#[test]
fn person_who_takes_the_drone_over_while_it_spins_up() {
    for firmware in BOTH {
        let mut p = standing(firmware);
        p.mission = State::SpinUp;
        p.run(6.0);
        assert!(p.linked.autopilot.armed(), "{firmware:?}");
        assert!(p.choose(AutopilotMode::Other));
        let before = p.commands.len();
        p.run(3.0);
        p.mission = State::StandDown;
        p.run(3.0);
        let since = p.commands.iter().skip(before);
        let mut commanded = since.filter(|(_, c)| {
            matches!(
                c.command,
                MavCmd::MAV_CMD_DO_SET_MODE | MavCmd::MAV_CMD_COMPONENT_ARM_DISARM
            )
        });
        assert!(commanded.next().is_none(), "{firmware:?}");
    }
}

/// After set-points stopped, the autopilot made the drone climb. Set-points that would let the drone fall are
/// not forwarded, and it is not disarmed.
#[test]
fn set_points_that_come_back_in_the_air() {
    for firmware in BOTH {
        for state in [State::SpinUp, State::StandDown] {
            let mut p = commanding(firmware);
            p.pilot = None;
            p.mission = state;
            p.run(1.0);
            p.pilot = Some(stand);
            p.run(3.0);
            let height_m = -p.truth().position.0.z;
            assert!(p.linked.autopilot.armed(), "{firmware:?}, {state:?}");
            assert!(height_m > 4.5, "{firmware:?}, {state:?}: {height_m} m");
        }
    }
}

/// The link ends the autopilot's mission once per flight if the drone must turn back; a pilot who selects the
/// mission again keeps it.
#[test]
fn mission_chosen_again_after_the_turn_back() {
    for firmware in BOTH {
        let own_mission = own_mission_mode(firmware);
        let mut p = LinkRig::commanding(firmware, 15.0, &config());
        assert!(p.linked.autopilot.choose(own_mission), "{firmware:?}");
        p.run(5.0);
        assert!(p.mode_commands().is_empty(), "{firmware:?}");
        p.waiting = Some(ReasonCode::TurnsBack);
        p.run(5.0);
        assert_eq!(p.mode(), AutopilotMode::Offboard, "{firmware:?}");
        let sent = p.mode_commands().len();
        assert!((1..=3).contains(&sent), "{firmware:?}: {sent}");
        for _ in 0..2 {
            assert!(p.linked.autopilot.choose(own_mission), "{firmware:?}");
            p.run(5.0);
            assert_eq!(p.linked.autopilot.mode(), own_mission, "{firmware:?}");
        }
        // A restarted link does not end that mission, either.
        p.restart_link(0.2);
        p.run(5.0);
        assert_eq!(p.linked.autopilot.mode(), own_mission, "{firmware:?}");
        assert_eq!(p.mode_commands().len(), sent, "{firmware:?}");
    }
}

/// After a restart or a disarm, the link does not repeat an arming that the pilot may have ended.
#[test]
fn arming_that_a_pilot_may_have_ended() {
    for firmware in BOTH {
        let mut p = standing(firmware);
        p.mission = State::SpinUp;
        p.run(0.5);
        p.restart_link(0.2);
        p.run(8.0);
        assert!(p.arm_commands().is_empty(), "{firmware:?}");
        let mut p = standing(firmware);
        p.mission = State::SpinUp;
        p.run(6.0);
        assert!(p.linked.autopilot.armed(), "{firmware:?}");
        p.linked.autopilot.arm(false);
        p.run(3.0);
        assert!(!p.linked.autopilot.armed(), "{firmware:?}");
    }
}
