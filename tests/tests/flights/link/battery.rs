//! Actions of the link on a low battery: according to its own reserve, and according to the mission's choice.

use super::{BOTH, commanding, config, rig::LinkRig};
use alight_shared::msg::{AutopilotMode, BatteryPlace, LastResort, ReasonCode, State};
use alight_uav::autopilot::{ControlAuthority, Diversion, message::MavResult, modes::Firmware};

#[test]
fn battery_reserve_diversions() {
    for (firmware, to, mode) in [
        (Firmware::Px4, Diversion::Return, AutopilotMode::Return),
        (Firmware::Px4, Diversion::Land, AutopilotMode::Land),
        (Firmware::ArduCopter, Diversion::Return, AutopilotMode::Return),
        (Firmware::ArduCopter, Diversion::Land, AutopilotMode::Land),
    ] {
        let mut c = config();
        c.battery.diversion = to;
        let mut p = LinkRig::commanding(firmware, 5.0, &c);
        p.mission = State::Tracking;
        p.counted = Some(0.05);
        p.linked.autopilot.battery = 0.05;
        p.run(6.0);
        assert_eq!(p.mode(), mode);
        assert_eq!(p.mode_commands().len(), 1);
        let at = p.t_s;
        p.run(10.0);
        assert_eq!(p.sent_since(at), 0);
    }
    let mut none = config();
    none.battery.diversion = Diversion::None;
    let mut p = LinkRig::commanding(Firmware::Px4, 5.0, &none);
    p.linked.autopilot.battery = 0.05;
    p.run(10.0);
    assert!(p.authority().commands() && p.mode_commands().is_empty());
}

#[test]
fn low_battery_return_and_landing() {
    for (place, mode) in [
        (BatteryPlace::Home, AutopilotMode::Return),
        (BatteryPlace::Here, AutopilotMode::Land),
        (BatteryPlace::Deck, AutopilotMode::Offboard),
    ] {
        let mut p = commanding(Firmware::Px4);
        p.mission = State::GaveUp;
        // The charge is first below the mission's reserve, later below that of the link, which does not act.
        p.linked.autopilot.battery = 0.15;
        p.run(1.0);
        p.assert_commanding();
        p.low_battery = Some(place);
        p.run(1.0);
        assert_eq!(p.mode(), mode, "{place:?}");
        p.linked.autopilot.battery = 0.05;
        p.run(6.0);
        assert_eq!(p.mode(), mode, "{place:?}");
    }
}

/// The gauge steps below the last reserve; the mission confirms the low charge and chooses a landing place before
/// the link diverts.
#[test]
fn diversion_after_the_mission_has_counted() {
    for firmware in BOTH {
        let mut p = commanding(firmware);
        p.mission = State::Tracking;
        p.counted = Some(0.6);
        p.linked.autopilot.battery = 0.08;
        p.run(5.5);
        p.assert_commanding();
        p.counted = Some(0.08);
        p.low_battery = Some(BatteryPlace::Deck);
        p.run(10.0);
        p.assert_commanding();
        // A mission that confirms the low charge but chooses nothing; below, a mission that never confirms it.
        p.low_battery = None;
        p.run(4.0);
        assert_eq!(p.mode(), AutopilotMode::Return, "{firmware:?}");
    }
    let mut p = commanding(Firmware::Px4);
    p.counted = Some(0.6);
    p.linked.autopilot.battery = 0.08;
    p.run(70.0);
    assert_eq!(p.mode(), AutopilotMode::Return);
}

/// A mission that waited for the deck falls silent: its last resort counts, and only once it is not restarted.
#[test]
fn last_resort_of_a_silent_mission() {
    let mut p = LinkRig::commanding(Firmware::Px4, 15.0, &config());
    p.mission = State::Tracking;
    p.low_battery = Some(BatteryPlace::Deck);
    p.last_resort = Some(LastResort {
        place: BatteryPlace::Here,
        charge: 0.05,
    });
    p.linked.autopilot.battery = 0.08;
    p.run(1.0);
    p.mission_silent = true;
    p.run(15.0);
    p.assert_commanding();
    p.linked.autopilot.battery = 0.045;
    p.run(4.0);
    p.assert_commanding();
    p.run(4.0);
    assert_eq!(p.mode(), AutopilotMode::Land);
}

#[test]
fn denied_diversion_attempts() {
    let mut p = commanding(Firmware::ArduCopter);
    p.counted = Some(0.05);
    p.linked.autopilot.battery = 0.05;
    p.linked.autopilot.answer = Some(MavResult::MAV_RESULT_DENIED);
    p.run(20.0);
    assert_eq!(p.mode_commands().len(), 3);
    assert_eq!(p.sent_since(p.t_s - 10.0), 0);
    assert_eq!(p.authority(), ControlAuthority::Diverted(Diversion::Return));
}

#[test]
fn battery_reserve_in_descent_and_flare() {
    for state in [State::Descent, State::Flare] {
        let mut p = commanding(Firmware::Px4);
        p.mission = state;
        p.counted = Some(0.05);
        p.linked.autopilot.battery = 0.05;
        p.run(6.0);
        assert!(p.mode_commands().is_empty() && p.authority().commands());
        // The link does not act while the pilot continues without the mission, either.
        p.mission_silent = true;
        p.run(3.0);
        assert!(p.mode_commands().is_empty() && p.authority().commands());
        p.run(2.0);
        assert!(!p.mode_commands().is_empty());
    }
}

/// The deck is free again: the link takes back a drone that it has sent away, but not one that a person has sent.
#[test]
fn drone_sent_away_and_taken_back() {
    for firmware in BOTH {
        for by_person in [false, true] {
            let mut p = commanding(firmware);
            p.mission = State::GaveUp;
            p.linked.autopilot.battery = 0.15;
            if by_person {
                p.choose(AutopilotMode::Return);
            } else {
                p.low_battery = Some(BatteryPlace::Home);
            }
            p.run(3.0);
            assert_eq!(p.mode(), AutopilotMode::Return, "{firmware:?}");
            p.mission = State::Idle;
            p.low_battery = None;
            p.waiting = Some(ReasonCode::BatteryDeck);
            p.run(5.0);
            let expected = if by_person {
                AutopilotMode::Return
            } else {
                AutopilotMode::Offboard
            };
            assert_eq!(p.mode(), expected, "{firmware:?}");
        }
    }
}
