//! The link disarms only on the deck, and only with evidence of a landing.

use alight_shared::msg::{AutopilotMode, State};
use alight_uav::autopilot::{
    AutopilotLinkConfig,
    message::{MavCmd, MavResult, severity},
    modes::Firmware,
};

use super::{
    BOTH, config,
    rig::{LinkRig, press, stop},
};

/// Rig whose pilot presses the drone onto the deck, up to the detection of a touchdown.
fn pressed(firmware: Firmware, config: &AutopilotLinkConfig) -> LinkRig {
    let mut p = LinkRig::commanding(firmware, 1.0, config);
    p.run(4.0);
    p.mission = State::Flare;
    p.pilot = Some(press);
    p.run(2.0);
    assert!(p.on_deck, "{}", p.truth().position.0.z);
    p
}

#[test]
fn disarm_without_a_land_detector() {
    for firmware in BOTH {
        let mut p = pressed(firmware, &config());
        p.pilot = Some(stop);
        let at = p.t_s;
        p.run(1.0);
        let disarms = p.arm_commands();
        assert!(!p.linked.autopilot.armed(), "{firmware:?}");
        assert!((disarms[0].parameters[1] - 21196.0).abs() < 0.1 && disarms.len() <= 2);
        let mut arrived = p.linked.autopilot.commands.iter();
        let disarm = arrived.find(|(_, c)| c.command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM);
        let (when, _) = disarm.unwrap();
        let after_s = when.secs() - at;
        assert!(after_s < 0.1, "{after_s}");
        assert!(p.states.iter().any(|s| !s.armed));
        let n = disarms.len();
        p.run(10.0);
        assert_eq!(p.arm_commands().len(), n, "a disarmed drone was disarmed");
    }
}

#[test]
fn denied_disarm_attempts_and_report() {
    let mut p = pressed(Firmware::Px4, &config());
    p.linked.autopilot.answer = Some(MavResult::MAV_RESULT_DENIED);
    p.pilot = Some(stop);
    p.mission = State::Landed;
    p.run(20.0);
    assert!(
        p.texts
            .iter()
            .any(|t| t.contains("still armed after 10 commands")),
        "{:?}",
        p.texts
    );
    assert_eq!(still_armed(&p), ["3 s", "13 s"]);
    let alarms = |(s, text): &(u8, String)| *s <= severity::WARNING && text.contains("still ARMED");
    assert!(p.notes.iter().any(alarms), "{:?}", p.notes);
    // The drone stays on the deck with zero thrust; set-points continue.
    assert!(p.sent_since(p.t_s - 0.1) > 3 && p.on_deck);
    p.linked.autopilot.answer = None;
    p.run(3.0);
    assert!(!p.linked.autopilot.armed());
}

#[test]
fn false_touchdown_in_the_air() {
    for firmware in BOTH {
        for (height, mission, forecast) in [
            (5.0, State::Flare, true),
            (5.0, State::Landed, false),
            (1.2, State::Descent, true),
            (0.8, State::Flare, false),
            (0.35, State::Tracking, true),
        ] {
            let mut p = LinkRig::commanding(firmware, height, &config());
            p.mission = mission;
            p.forecast = forecast;
            p.pilot = Some(stop);
            let before = p.truth().position.0.z;
            p.run(10.0);
            assert!(p.arm_commands().is_empty(), "{firmware:?} at {height} m");
            assert!(p.linked.autopilot.armed());
            let up = before - p.truth().position.0.z;
            assert!((0.8..1.2).contains(&up), "{firmware:?} at {height} m: {up} m");
        }
    }
}

/// Reported times armed after a landing.
fn still_armed(p: &LinkRig) -> Vec<String> {
    let text = |t: &String| {
        let after = t.strip_prefix("on deck, still ARMED for ")?;
        Some(after.strip_suffix(": disarm by remote control")?.to_owned())
    };
    p.texts.iter().filter_map(text).collect()
}

/// Rig whose pilot has stopped the drone on the deck; the autopilot denies the first disarm.
fn stopped(firmware: Firmware, config: &AutopilotLinkConfig) -> LinkRig {
    let mut p = pressed(firmware, config);
    p.linked.autopilot.answer = Some(MavResult::MAV_RESULT_DENIED);
    p.pilot = Some(stop);
    p.mission = State::Landed;
    p.run(0.1);
    p
}

#[test]
fn disarm_without_the_pilot_in_hold() {
    for firmware in BOTH {
        for cut_s in [0.0, 2.0] {
            let mut p = stopped(firmware, &config());
            p.pilot = None;
            p.linked.cut = true;
            p.run(cut_s);
            let held = firmware == Firmware::Px4 && cut_s > 0.0;
            assert_eq!(p.mode() == AutopilotMode::Hold, held, "{firmware:?}");
            p.linked.cut = false;
            p.run(1.0);
            assert!(p.linked.autopilot.armed());
            p.linked.autopilot.answer = None;
            p.run(3.0);
            let armed = p.linked.autopilot.armed();
            assert!(!armed && p.on_deck, "{firmware:?}, {cut_s} s");
        }
    }
}

#[test]
fn disarm_without_the_pilot_evidence() {
    for firmware in BOTH {
        for height in [0.7, 0.8, 5.0] {
            let mut p = LinkRig::commanding(firmware, height, &config());
            p.mission = State::Landed;
            p.pilot = None;
            p.run(10.0);
            assert!(p.arm_commands().is_empty() && p.linked.autopilot.armed());
        }
        let mut p = stopped(firmware, &config());
        p.linked.autopilot.answer = None;
        p.choose(AutopilotMode::Other);
        p.run(0.1);
        let n = p.arm_commands().len();
        p.pilot = None;
        p.run(5.0);
        assert_eq!(p.arm_commands().len(), n, "{firmware:?}");
    }
}

#[test]
fn abort_on_the_deck_restarts_the_disarm() {
    for firmware in BOTH {
        let c = config();
        let mut p = stopped(firmware, &c);
        let count = |p: &LinkRig| p.arm_commands().len();
        let rare = c.disarm.tries as usize + 2;
        for _ in 0..100 {
            if count(&p) < rare {
                p.run(0.1);
            }
        }
        // The fast retries are over; the next retry follows after 2 s.
        assert_eq!(count(&p), rare, "{firmware:?}");
        p.linked.autopilot.answer = None;
        p.run(0.5);
        assert!(p.linked.autopilot.armed(), "{firmware:?}");
        p.abort = Some([1, 1]);
        p.run(0.5);
        assert!(!p.linked.autopilot.armed() && p.on_deck, "{firmware:?}");
    }
}
