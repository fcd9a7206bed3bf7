//! Messages that stop coming: reports of one kind, all of them for a moment, and the steps of the link's own computer.

use alight_shared::msg::{AutopilotMode, LandedState};
use alight_uav::autopilot::message::id;
use alight_uav::autopilot::modes::Firmware;

use super::rig::LinkRig;
use super::{BOTH, config};

/// BATTERY_STATUS stops at 57 %: that is no charge of now, and people learn it.
#[test]
fn battery_report_that_stops() {
    for firmware in BOTH {
        let mut p = LinkRig::commanding(firmware, 5.0, &config());
        p.linked.autopilot.battery = 0.57;
        p.run(3.0);
        assert!((p.state().battery.unwrap() - 0.57).abs() < 0.02, "{firmware:?}");
        p.linked.autopilot.muted = vec![id::BATTERY_STATUS];
        p.run(4.0);
        assert!(
            p.state().battery.is_some(),
            "{firmware:?}: the last report is fresh"
        );
        p.run(3.0);
        assert_eq!(p.state().battery, None, "{firmware:?}");
        let reported = |p: &LinkRig, what: &str| p.texts.iter().any(|t| t.contains(what));
        assert!(reported(&p, "reports its battery no more"), "{:?}", p.texts);
        p.linked.autopilot.muted.clear();
        p.run(3.0);
        assert!(p.state().battery.is_some() && reported(&p, "reports its battery again"));
    }
}

/// EXTENDED_SYS_STATE stops on the ground: in the air that is no opinion any more.
#[test]
fn landed_report_that_stops() {
    let mut p = LinkRig::commanding(Firmware::Px4, 5.0, &config());
    p.linked.autopilot.landed_report = Some(LandedState::OnGround);
    p.run(1.0);
    assert_eq!(p.state().landed, LandedState::OnGround);
    p.linked.autopilot.muted = vec![id::EXTENDED_SYS_STATE];
    p.run(4.0);
    assert_eq!(p.state().landed, LandedState::Unknown);
}

/// The computer of the link stands still, or the autopilot is silent: PX4 holds by itself, and that is no person's choice.
#[test]
fn standstill_of_either_computer() {
    let own = [0.6, 0.8, 1.5]
        .into_iter()
        .flat_map(|s| [(true, s, false), (true, s, true)]);
    for (own, gap_s, suspended) in own.chain([(false, 0.76, false)]) {
        let mut p = LinkRig::commanding(Firmware::Px4, 5.0, &config());
        p.suspended = suspended;
        let frames = |p: &LinkRig| p.odometry.last().map(|(_, d)| d.frames);
        let before_frames = frames(&p);
        let set = |p: &mut LinkRig, gone: bool| {
            if own {
                p.stands_still = gone;
            } else {
                (p.linked.autopilot.silent, p.linked.cut) = (gone, gone);
            }
        };
        set(&mut p, true);
        p.run(gap_s);
        assert_eq!(p.mode(), AutopilotMode::Hold, "own {own}, {gap_s} s");
        set(&mut p, false);
        let before = p.states.len();
        p.run(3.0);
        let held = p
            .states
            .iter()
            .skip(before)
            .filter(|s| s.mode == AutopilotMode::Hold);
        assert!(
            held.clone().all(|s| s.lapsed),
            "own {own}, {gap_s} s, suspended {suspended}: taken for a pilot's choice"
        );
        assert_eq!(
            p.mode(),
            AutopilotMode::Offboard,
            "own {own}, {gap_s} s, suspended {suspended}"
        );
        p.assert_commanding();
        assert_eq!(frames(&p), before_frames, "the autopilot has not restarted");
    }
}

/// A person chooses Hold a second after such a gap.
#[test]
fn hold_of_a_person_after_a_standstill() {
    let mut p = LinkRig::commanding(Firmware::Px4, 5.0, &config());
    p.stands_still = true;
    p.run(0.15);
    p.stands_still = false;
    p.run(1.5);
    p.assert_commanding();
    p.choose(AutopilotMode::Hold);
    let before = p.states.len();
    p.run(5.0);
    assert!(p.states.iter().skip(before).all(|s| !s.lapsed));
    assert_eq!(p.mode(), AutopilotMode::Hold);
}
