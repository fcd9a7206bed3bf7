//! Parameters of the autopilot that the link checks.

use super::{aloft, rig::LinkRig};
use alight_shared::msg::{AutopilotMode, Reason, ReasonCode};
use alight_uav::autopilot::{ControlAuthority, modes::Firmware};

#[test]
fn ardu_copter_without_the_thrust_option() {
    let mut p = aloft(Firmware::ArduCopter);
    p.linked.autopilot.parameters.insert("GUID_OPTIONS", 0.0);
    p.run(5.0);
    assert_eq!(p.authority(), ControlAuthority::OptionMissing);
    assert!(
        p.texts.iter().any(|t| t.contains("GUID_OPTIONS bit 3")),
        "{:?}",
        p.texts
    );
    p.choose(AutopilotMode::Offboard);
    p.run(2.0);
    assert!(p.sent.is_empty());
    assert_eq!(p.state().mode, AutopilotMode::Other);
    p.linked.autopilot.parameters.insert("GUID_OPTIONS", 8.0);
    p.run(2.0);
    p.assert_commanding();
}

#[test]
fn unsuitable_parameters_until_set() {
    for (firmware, name, wrong, good) in [
        (Firmware::Px4, "COM_OF_LOSS_T", 1.0, 0.25),
        (Firmware::Px4, "COM_OBL_RC_ACT", 0.0, 5.0),
        (Firmware::Px4, "MPC_ACC_UP_MAX", 4.0, 8.0),
        (Firmware::ArduCopter, "GUID_TIMEOUT", 3.0, 0.3),
    ] {
        let mut p = aloft(firmware);
        p.linked.autopilot.parameters.insert(name, wrong);
        p.run(3.0);
        let why = p.state().rejection;
        assert_eq!(why.code, ReasonCode::AutopilotParameter, "{firmware:?}: {why}");
        let text = format!("{name} is {wrong}");
        assert!(why.to_string().starts_with(&text), "{firmware:?}: {why}");
        assert_eq!(
            p.texts.iter().filter(|t| t.contains(&text)).count(),
            1,
            "{:?}",
            p.texts
        );
        // Control authority remains, so a descent in progress continues.
        p.give_the_mode();
        p.run(1.0);
        p.assert_commanding();
        p.linked.autopilot.parameters.insert(name, good);
        p.run(1.5);
        assert_eq!(p.state().rejection, Reason::default(), "{firmware:?}");
        p.linked.autopilot.parameters.insert(name, wrong);
        p.linked.autopilot.restart();
        p.run(5.0);
        assert_eq!(p.state().rejection, why, "{firmware:?}");
    }
}

#[test]
fn parameter_with_a_warning() {
    let mut p = aloft(Firmware::Px4);
    p.linked.autopilot.parameters.insert("MC_AIRMODE", 0.0);
    p.run(3.0);
    assert_eq!(p.state().rejection, Reason::default());
    assert!(
        p.texts.iter().any(|t| t.contains("MC_AIRMODE is 0")),
        "{:?}",
        p.texts
    );
    let named = |p: &LinkRig| p.state().warning.to_string();
    assert!(named(&p).starts_with("MC_AIRMODE is 0"), "{}", named(&p));
    p.linked.autopilot.parameters.insert("MC_AIRMODE", 1.0);
    p.run(1.5);
    assert!(!named(&p).contains("MC_AIRMODE"), "{}", named(&p));
}
