//! Responses of PX4 and ArduCopter to attitude and thrust, compared with measurements of the real firmwares.

use alight_shared::{
    frames::{DroneNed, Vector, wxyz},
    mavlink::dialect::{LANDING_TARGET_DATA, MavBool, MavFrame},
    msg::{DroneState, SetPoint, State},
};
use alight_uav::autopilot::{AutopilotLinkConfig, DeckMessage, message::MavMessage, modes::Firmware};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::{
    BOTH, config,
    rig::{LinkRig, hover, press},
};

/// Set-point that rocks the drone about its own axis at a heading of 180 deg, as above a rocking deck.
fn rock(d: &DroneState) -> SetPoint {
    let turning = core::f64::consts::TAU / 1.5;
    let (sin, cos) = (turning * d.header.at.secs()).sin_cos();
    SetPoint {
        attitude: wxyz(&UnitQuaternion::from_euler_angles(
            0.15 * sin,
            0.0,
            core::f64::consts::PI,
        )),
        rates: [0.15 * turning * cos, 0.0, 0.0],
        thrust: hover(),
        ..press(d)
    }
}

#[test]
fn ardu_copter_without_body_rates() {
    // Root mean square attitude error over three periods, rad.
    let apart = |firmware, send_rates| {
        let c = AutopilotLinkConfig {
            send_rates,
            ..config()
        };
        let mut p = LinkRig::at(firmware, 50.0, core::f64::consts::PI, &c);
        p.take_command();
        p.mission = State::Descent;
        p.pilot = Some(rock);
        p.run(1.5);
        let mut sum = 0.0;
        for _ in 0..450 {
            p.run(0.01);
            let state = p.odometry.last().expect("odometry").1;
            let [w, x, y, z] = rock(&state).attitude;
            let wanted = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
            sum += p.truth().attitude.0.angle_to(&wanted).powi(2);
        }
        (sum / 450.0).sqrt()
    };
    let default = AutopilotLinkConfig::default().send_rates;
    let [px4, copter] = BOTH.map(|f| apart(f, default));
    // ArduCopter shapes its input: at an amplitude of 8.6 deg it lags by 4 deg, PX4 by 2.7 deg.
    assert!(px4 < copter && copter < 0.08, "{px4} {copter}");
    let with = apart(Firmware::ArduCopter, true);
    assert!(with > 1.2 * copter, "{with} {copter}");
}

/// Tilt of 0.4 rad with the thrust of a level hover.
fn tilted(d: &DroneState) -> SetPoint {
    SetPoint {
        attitude: wxyz(&UnitQuaternion::from_euler_angles(0.4, 0.0, 0.0)),
        thrust: hover(),
        ..press(d)
    }
}

#[test]
fn thrust_of_a_tilted_drone() {
    // If the link did not compensate for it, ArduCopter would add 9 % of thrust to a tilted drone.
    for firmware in BOTH {
        let mut p = LinkRig::commanding(firmware, 50.0, &config());
        p.mission = State::Descent;
        p.pilot = Some(tilted);
        p.run(2.0);
        assert!(
            (p.linked.autopilot.thrust() - hover()).abs() < 0.005,
            "{firmware:?}: {}",
            p.linked.autopilot.thrust()
        );
        let reported = p.state().thrust.unwrap();
        assert!((reported - hover()).abs() < 0.01, "{firmware:?}: {reported}");
    }
}

/// Whether a firmware uses a LANDING_TARGET with a valid position, according to its source code. PX4
/// (`MavlinkReceiver::handle_message_landing_target`) requires `frame == MAV_FRAME_LOCAL_NED` (1), with the position
/// relative to the origin. ArduPilot (`AC_PrecLand_MAVLink::handle_msg`) requires `frame == MAV_FRAME_BODY_FRD` (12)
/// or, in newer versions, `MAV_FRAME_LOCAL_FRD` (20), and `distance > 0`, because it divides by the distance.
fn takes(firmware: Firmware, t: &LANDING_TARGET_DATA) -> bool {
    match firmware {
        Firmware::Px4 => t.frame as u8 == 1,
        Firmware::ArduCopter => matches!(t.frame as u8, 12 | 20) && t.distance > 0.0,
    }
}

#[test]
fn landing_target_by_firmware() {
    let c = AutopilotLinkConfig {
        publish_deck: true,
        ..config()
    };
    for firmware in BOTH {
        // Neither level nor heading north, so that a wrong frame gives a different direction.
        let mut p = LinkRig::at(firmware, 6.0, 1.1, &c);
        p.deck_offset = [2.0, -1.0];
        p.take_command();
        p.mission = State::Descent;
        p.pilot = Some(tilted);
        p.run(0.8);
        let a = &p.linked.autopilot;
        let roll = p.odometry.last().expect("odometry").1.euler().x;
        assert!(roll > 0.15, "{firmware:?}: tilts by {roll} rad");
        assert!(p.targets.len() > 30, "{firmware:?}: {}", p.targets.len());
        assert!(p.targets.iter().all(|t| takes(firmware, t)), "{firmware:?}");
        assert_eq!(a.targets_rejected, 0, "{firmware:?}");
        // Expected: 2 m north and 1 m west of the point below the drone.
        let at = a.target.expect("a target") - a.position();
        let apart = at - Vector3::new(2.0, -1.0, -a.position().z);
        assert!(apart.norm() < 0.5, "{firmware:?}: {at:?}");
    }
}

#[test]
fn landing_target_of_the_other_firmware() {
    let target = |frame, distance_m: f64| LANDING_TARGET_DATA {
        frame,
        x: 1.0,
        y: 2.0,
        z: 4.0,
        distance: distance_m as f32,
        position_valid: MavBool::MAV_BOOL_TRUE,
        ..LANDING_TARGET_DATA::DEFAULT
    };
    let norm = Vector3::new(1.0, 2.0, 4.0).norm();
    for (frame, distance_m, takers) in [
        (MavFrame::MAV_FRAME_LOCAL_NED, 0.0, &[Firmware::Px4][..]),
        (MavFrame::MAV_FRAME_BODY_FRD, norm, &[Firmware::ArduCopter]),
        (MavFrame::MAV_FRAME_LOCAL_FRD, norm, &[Firmware::ArduCopter]),
        (MavFrame::MAV_FRAME_BODY_FRD, 0.0, &[]),
    ] {
        let t = target(frame, distance_m);
        for firmware in BOTH {
            let mut p = LinkRig::new(firmware, 6.0, &config());
            p.give(&MavMessage::LANDING_TARGET(t.clone()).into());
            let a = &p.linked.autopilot;
            let expected = takers.contains(&firmware);
            assert_eq!(takes(firmware, &t), expected, "{firmware:?} {frame:?}");
            assert_eq!(a.target.is_some(), expected, "{firmware:?} {frame:?}");
            assert_eq!(a.targets_rejected, u32::from(!expected), "{firmware:?} {frame:?}");
        }
    }
}

#[test]
fn deck_for_a_target_estimator() {
    let c = AutopilotLinkConfig {
        publish_deck: true,
        deck_message: DeckMessage::Target,
        ..config()
    };
    let mut p = LinkRig::at(Firmware::Px4, 6.0, 1.1, &c);
    p.deck_offset = [2.0, -1.0];
    p.take_command();
    p.mission = State::Descent;
    p.run(0.8);
    assert!(p.targets.is_empty() && p.relative.len() > 30 && p.absolute.len() > 30);
    let own = p.odometry.last().expect("odometry").1;
    let target = p.relative.last().expect("a target");
    let apart = Vector3::from(target.position) - Vector3::new(2.0, -1.0, -own.position[2]);
    assert!(apart.norm() < 0.1, "{target:?} {own:?}");
    // PX4 derives our clock from answers to TIMESYNC.
    let late_s = p.t_s - 1e-6 * target.time_us as f64;
    assert!((0.0..0.2).contains(&late_s), "{late_s}");
    let received = p.absolute.last().expect("a target");
    let deck = Vector3::from(own.position) + Vector3::new(2.0, -1.0, -own.position[2]);
    let expected = own.datum.at(&Vector::<DroneNed>::from(deck));
    assert!(received.place.distance_m(&expected) < 0.2, "{received:?}");

    // ArduCopter receives only LANDING_TARGET.
    let mut p = LinkRig::commanding(Firmware::ArduCopter, 6.0, &c);
    p.mission = State::Descent;
    p.run(0.8);
    assert!(!p.targets.is_empty() && p.relative.is_empty() && p.absolute.is_empty());
}
