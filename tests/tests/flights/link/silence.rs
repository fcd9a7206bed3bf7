//! Loss of one kind of report.

use alight_shared::{
    mavlink::{MessageData as _, dialect as m},
    msg::LandedState,
};
use alight_uav::autopilot::modes::Firmware;

use super::{BOTH, commanding, rig::LinkRig};

/// The charge becomes unknown at 57 %, and the operator is informed.
#[test]
fn battery_report_that_stops() {
    for firmware in BOTH {
        let mut p = commanding(firmware);
        p.linked.autopilot.battery = 0.57;
        p.run(3.0);
        assert!((p.state().battery.unwrap() - 0.57).abs() < 0.02, "{firmware:?}");
        p.linked.autopilot.muted = vec![m::BATTERY_STATUS_DATA::ID];
        p.run(4.0);
        assert!(
            p.state().battery.is_some(),
            "{firmware:?}: the last report is fresh"
        );
        p.run(3.0);
        assert_eq!(p.state().battery, None, "{firmware:?}");
        let reported = |p: &LinkRig, what: &str| p.texts.iter().any(|t| t.contains(what));
        assert!(reported(&p, "no longer reports its battery"), "{:?}", p.texts);
        p.linked.autopilot.muted.clear();
        p.run(3.0);
        assert!(p.state().battery.is_some() && reported(&p, "reports its battery again"));
    }
}

/// The report stops on the ground; the landed state is then unknown in the air.
#[test]
fn landed_report_that_stops() {
    let mut p = commanding(Firmware::Px4);
    p.linked.autopilot.landed_report = Some(LandedState::OnGround);
    p.run(1.0);
    assert_eq!(p.state().landed, LandedState::OnGround);
    p.linked.autopilot.muted = vec![m::EXTENDED_SYS_STATE_DATA::ID];
    p.run(4.0);
    assert_eq!(p.state().landed, LandedState::Unknown);
}
