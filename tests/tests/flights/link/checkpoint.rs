//! Restart of the link in flight, with and without its checkpoint.

use alight_shared::{
    geodesy::Datum,
    msg::{AutopilotMode, LinkCheckpoint, State},
};
use alight_uav::autopilot::modes::Firmware;

use super::{BOTH, aloft, commanding, rig::lead};

const AWAY_S: f64 = 0.2;

#[test]
fn link_successor_with_a_checkpoint() {
    for firmware in BOTH {
        let mut p = aloft(firmware);
        p.linked.autopilot.origin = Datum::new(43.5005, 16.2993, 5.0);
        p.run(5.0);
        p.give_the_mode();
        p.run(1.0);
        p.assert_commanding();
        p.pilot = Some(lead);
        p.mission = State::Tracking;
        p.run(4.0);
        p.assert_commanding();
        let (_, before) = *p.odometry.last().unwrap();
        p.restart_link(AWAY_S);
        let began_s = p.t_s;
        let known = p.odometry.len();
        p.run(1.0);
        let (at_s, _) = *p.sent.iter().find(|(t, _)| *t > began_s).unwrap();
        // The restarted link acts at its first odometry; ArduCopter sends one every 25 ms.
        assert!(at_s - began_s <= 0.04, "{firmware:?}: {} s", at_s - began_s);
        let (t_s, first) = p.odometry[known];
        assert!(t_s - began_s <= 0.04, "{firmware:?}: {} s", t_s - began_s);
        let moved = before.position() + before.velocity() * (first.header.at - before.header.at).secs();
        assert!(
            (first.position() - moved).norm() < 0.05,
            "{firmware:?}: {:?}",
            first.position() - moved
        );
        assert!(p.odometry.iter().all(|(_, o)| o.frames == first.frames));
        p.assert_commanding();
        assert!(p.state().hover_thrust > 0.0);
    }
}

#[test]
fn link_successor_after_a_takeover() {
    for firmware in BOTH {
        let mut p = commanding(firmware);
        p.mission = State::Tracking;
        // One report of the mode is lost; the next follows within half a second.
        p.linked.cut = true;
        assert!(p.choose(AutopilotMode::Other));
        p.restart_link(AWAY_S);
        p.linked.cut = false;
        let began_s = p.t_s;
        p.run(3.0);
        assert!(!p.authority().commands(), "{}", p.authority());
        assert_eq!(p.sent_since(began_s + 1.1), 0, "{firmware:?}");
    }
}

#[test]
fn link_successor_with_a_void_checkpoint() {
    type Change = fn(&mut LinkCheckpoint);
    let cases: [(&str, f64, Change); 7] = [
        ("too old", 1.6, |_| {}),
        ("not commanding", AWAY_S, |m| m.commanding = false),
        ("another drone's", AWAY_S, |m| m.header.drone = 2),
        ("another version", AWAY_S, |m| m.header.version += 1),
        ("damaged", AWAY_S, |m| m.datum.latitude_deg = f64::NAN),
        ("another firmware", AWAY_S, |m| m.autopilot = 0),
        ("nothing kept", AWAY_S, |m| *m = LinkCheckpoint::default()),
    ];
    for firmware in BOTH {
        for (what, away_s, change) in cases {
            let mut p = commanding(firmware);
            assert!(p.kept.datum == p.linked.autopilot.origin && p.kept.commanding);
            change(&mut p.kept);
            p.restart_link(away_s);
            p.run(0.02);
            assert!(!p.authority().commands(), "{firmware:?}, {what}");
        }
    }
}

/// PX4 enters its failsafe within 0.7 s; the restarted link commands the mode at once.
#[test]
fn link_successor_after_the_failsafe() {
    for firmware in BOTH {
        let mut p = commanding(firmware);
        p.mission = State::Tracking;
        p.pilot = Some(lead);
        p.run(1.0);
        p.restart_link(0.7);
        let held = p.mode() == AutopilotMode::Hold;
        let began_s = p.t_s;
        assert_eq!(held, firmware == Firmware::Px4);
        p.run(0.2);
        assert!(
            p.mode() == AutopilotMode::Offboard && p.sent_since(began_s) > 5,
            "{firmware:?}"
        );
        p.run(3.0);
        p.assert_commanding();
    }
}
