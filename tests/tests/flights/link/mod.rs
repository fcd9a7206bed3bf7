//! The link with simulated autopilots that imitate PX4 and ArduCopter: every mode, denial, loss, take-over
//! and disarm, and landings.

mod arbitrary;
mod battery;
mod checkpoint;
mod disarm;
mod firmwares;
mod ground;
mod home;
mod landings;
mod parameters;
mod rig;
mod silence;
mod station_parameters;
mod takeoff;
mod wire;

use super::BOTH;
use alight_shared::{
    geodesy::Datum,
    geoid,
    mavlink::dialect::BATTERY_STATUS_DATA,
    msg::{AutopilotMode, ReasonCode, SetPoint, State},
    time::Time,
};
use alight_sim::autopilots::simulated::mode_number;
use alight_uav::autopilot::{
    AutopilotLinkConfig, ControlAuthority,
    message::{Address, MavAutopilot, MavMessage, MavModeFlag, MavResult, MavType, heartbeat},
    modes::Firmware,
};
use rig::{LinkRig, hold, lead, press};

/// Configuration that accepts unsigned orders.
fn config() -> AutopilotLinkConfig {
    AutopilotLinkConfig {
        unsigned_orders: true,
        ..AutopilotLinkConfig::default()
    }
}

/// Drone that flies at 5 m.
fn aloft(firmware: Firmware) -> LinkRig {
    LinkRig::new(firmware, 5.0, &config())
}
/// Drone that the link commands at 5 m.
fn commanding(firmware: Firmware) -> LinkRig {
    LinkRig::commanding(firmware, 5.0, &config())
}

#[test]
fn odometry_rate_and_time_of_validity() {
    // ArduCopter's telemetry sends at 40 Hz.
    for (firmware, positions, readings) in [(Firmware::Px4, 180, 90), (Firmware::ArduCopter, 76, 76)] {
        let mut p = aloft(firmware);
        p.run(4.0);
        p.odometry.clear();
        p.ranges.clear();
        let began = p.t_s;
        p.run(2.0);
        assert!(
            p.odometry.len() >= positions,
            "{firmware:?}: {}",
            p.odometry.len()
        );
        assert!(p.ranges.len() >= readings, "{firmware:?}: {}", p.ranges.len());
        for (arrived, o) in &p.odometry {
            let age = arrived - o.header.at.secs();
            // The wire takes 6 ms and a step 5 ms; ArduCopter's stamps have a resolution of 1 ms.
            assert!((0.004..0.014).contains(&age), "{firmware:?}: {age}");
        }
        assert!(p.odometry.windows(2).all(|w| w[1].1.header.at > w[0].1.header.at));
        let first = p.odometry.first().unwrap().1.header.at.secs();
        assert!(first >= began - 0.02);
        assert_eq!(
            p.link.as_ref().unwrap().metrics(Time::from_secs(p.t_s)).rejected,
            0
        );
    }
}

#[test]
fn px4_offboard_after_streamed_set_points() {
    let mut p = aloft(Firmware::Px4);
    p.pilot = None;
    p.run(5.0);
    assert_eq!(
        p.authority(),
        ControlAuthority::Standby {
            mode: AutopilotMode::Other
        }
    );
    assert!(!p.choose(AutopilotMode::Offboard), "accepted without set-points");
    p.pilot = Some(hold);
    p.run(0.5);
    assert!(!p.choose(AutopilotMode::Offboard), "accepted too early");
    p.run(1.5);
    assert!(
        p.choose(AutopilotMode::Offboard),
        "denied although set-points are streamed"
    );
    p.run(0.6);
    p.assert_commanding();
    let from = p.t_s;
    p.run(2.0);
    assert!(p.sent_since(from) >= 100, "{} in 2 s", p.sent_since(from));
    // Only the pilot selects a mode or arms.
    assert!(p.mode_commands().is_empty() && p.arm_commands().is_empty());
}

#[test]
fn set_points_before_offboard() {
    let mut p = aloft(Firmware::Px4);
    p.run(4.0);
    let from = p.t_s;
    // Set-points for distant positions are not streamed.
    p.pilot = Some(press);
    p.run(1.0);
    p.pilot = Some(|d| SetPoint {
        position: [d.position[0] + 20.0, 0.0, -5.0],
        ..hold(d)
    });
    p.run(1.0);
    p.pilot = Some(lead);
    p.mission = State::Approach;
    p.run(1.0);
    assert!(p.sent_since(from + 0.05) <= 1, "{}", p.sent_since(from));
    // ArduCopter does not require a stream.
    let mut p = aloft(Firmware::ArduCopter);
    p.run(5.0);
    assert!(p.authority().may_offer() && p.sent.is_empty());
}

#[test]
fn takeover_by_a_pilot() {
    for firmware in BOTH {
        for phase in [State::Approach, State::Tracking, State::Descent, State::Flare] {
            for mode in [mode_number(firmware, AutopilotMode::Other), 0] {
                let mut p = commanding(firmware);
                p.mission = phase;
                p.pilot = Some(if phase == State::Flare { press } else { lead });
                p.run(0.3);
                assert!(p.sent_since(p.t_s - 0.1) > 3);
                p.linked.autopilot.choose(mode);
                let at = p.t_s;
                p.run(20.0);
                let last = p.silent_since();
                assert!(last - at <= 0.1, "{firmware:?} {phase:?}: {:.3} s", last - at);
                assert!(p.mode_commands().is_empty(), "the link took the mode back");
                assert_eq!(p.linked.autopilot.mode(), mode);
                assert_eq!(p.state().mode, AutopilotMode::Other);
            }
        }
    }
}

#[test]
fn autopilot_failsafes() {
    let modes = [AutopilotMode::Return, AutopilotMode::Land, AutopilotMode::Hold];
    for (firmware, mode) in BOTH.into_iter().flat_map(|f| modes.map(|m| (f, m))) {
        let mut p = commanding(firmware);
        p.mission = State::Descent;
        p.run(0.1);
        p.choose(mode);
        let at = p.t_s;
        p.run(30.0);
        assert!(p.silent_since() - at <= 0.1);
        assert_eq!(p.state().mode, mode);
        // The pilot selected Hold or Brake while set-points arrived.
        assert!(
            p.states.iter().all(|s| !s.set_points_lost),
            "{firmware:?} {mode:?}"
        );
    }
}

/// Loses the remote control of a drone above the deck whose failsafe holds in OFFBOARD (GUIDED) as well.
fn with_remote_failsafe(firmware: Firmware, state: State) -> LinkRig {
    let mut p = aloft(firmware);
    p.linked.autopilot.channels = Some([1500; 18]);
    for name in ["COM_RCL_EXCEPT", "FS_OPTIONS"] {
        if let Some(value) = p.linked.autopilot.parameters.get_mut(name) {
            *value = 0.0;
        }
    }
    p.take_command();
    p.mission = state;
    p.run(2.0);
    p
}

#[test]
fn hold_after_a_lost_remote_control() {
    for (firmware, state) in BOTH
        .into_iter()
        .flat_map(|f| [(f, State::Tracking), (f, State::Flare)])
    {
        let mut p = with_remote_failsafe(firmware, state);
        p.linked.autopilot.conditions.remote_lost = true;
        let from = p.states.len();
        p.run(0.3);
        // The mission keeps the order, and offers a hold.
        p.mission = State::Idle;
        p.run(4.0);
        p.assert_commanding();
        assert_eq!(p.mode(), AutopilotMode::Offboard, "{firmware:?} {state:?}");
        let requests = p.mode_commands().len();
        assert!((1..=3).contains(&requests), "{requests}");
        let since = &p.states[from..];
        assert!(
            since
                .iter()
                .all(|s| s.mode != AutopilotMode::Hold || s.set_points_lost)
        );
        // Somebody chooses the hold while the remote control is still lost.
        p.choose(AutopilotMode::Hold);
        p.run(5.0);
        assert_eq!(p.mode(), AutopilotMode::Hold);
        assert_eq!(p.mode_commands().len(), requests);
        assert!(!p.state().set_points_lost);
    }
}

#[test]
fn hold_that_no_failsafe_near_the_deck_explains() {
    for (firmware, lost) in BOTH.into_iter().flat_map(|f| [(f, false), (f, true)]) {
        let mut p = with_remote_failsafe(firmware, State::Approach);
        // On the way to the vessel the hold stays.
        p.linked.autopilot.conditions.remote_lost = lost;
        if !lost {
            p.mission = State::Flare;
            p.choose(AutopilotMode::Hold);
        }
        p.run(5.0);
        assert_eq!(p.mode(), AutopilotMode::Hold, "{firmware:?}");
        assert!(p.mode_commands().is_empty());
        assert!(!p.state().set_points_lost);
    }
}

#[test]
fn silent_pilot_and_its_return() {
    let mut p = commanding(Firmware::Px4);
    p.pilot = None;
    let at = p.t_s;
    p.run(2.0);
    assert!(p.silent_since() - at <= 0.13, "stale set-points were repeated");
    assert_eq!(p.mode(), AutopilotMode::Hold);
    assert_eq!(
        p.authority(),
        ControlAuthority::Standby {
            mode: AutopilotMode::Hold
        }
    );
    assert!(p.state().set_points_lost);
    // OFFBOARD is still the crew's choice: PX4 returns to it when the stream resumes.
    p.pilot = Some(hold);
    p.run(2.0);
    assert_eq!(p.mode(), AutopilotMode::Offboard);
    p.assert_commanding();
    assert!(!p.state().set_points_lost);
}

#[test]
fn link_without_heartbeats() {
    for firmware in BOTH {
        let mut p = commanding(firmware);
        p.mission = State::Tracking;
        p.run(0.1);
        p.linked.autopilot.silent = true;
        let at = p.t_s;
        p.run(4.0);
        assert_eq!(p.authority(), ControlAuthority::LinkLost);
        // Without odometry, set-points stop long before the heartbeat time limit.
        assert!(p.silent_since() - at <= 0.25, "{}", p.silent_since() - at);
        let reported = p.states.len();
        p.run(2.0);
        assert_eq!(p.states.len(), reported, "a state without a heartbeat");
        // The mission waits again because it does not command the drone.
        p.mission = State::Idle;
        p.linked.autopilot.silent = false;
        p.run(4.0);
        p.assert_commanding();
    }
}

#[test]
fn link_with_a_restarted_autopilot() {
    for firmware in BOTH {
        let mut p = commanding(firmware);
        let frames = p.frames();
        p.linked.autopilot.restart();
        p.run(6.0);
        assert_ne!(p.frames(), frames);
        let (arrived, o) = p.odometry.last().unwrap();
        assert!((0.0..0.02).contains(&(arrived - o.header.at.secs())));
        assert!(p.t_s - arrived < 0.05);
        p.assert_commanding();
    }
}

/// The link does not arm the drone if arming is not permitted, on a deck that the crew has not cleared, or if
/// the deck is unknown. Otherwise it arms once, in its own mode.
#[test]
fn arming_when_configured() {
    for (firmware, may_arm, away_m, forecast, denied, expected) in [
        (Firmware::ArduCopter, false, 60.0, true, false, 0),
        (Firmware::ArduCopter, true, 60.0, true, false, 1),
        (Firmware::ArduCopter, true, 60.0, true, true, 3),
        (Firmware::Px4, true, 0.0, true, false, 0),
        (Firmware::ArduCopter, true, 0.0, true, false, 0),
        (Firmware::Px4, true, 0.0, false, false, 0),
        (Firmware::ArduCopter, true, 0.0, false, false, 0),
    ] {
        let c = AutopilotLinkConfig { may_arm, ..config() };
        let mut p = LinkRig::new(firmware, 0.3, &c);
        p.deck_offset = [away_m, 0.0];
        p.forecast = forecast;
        p.waits_for_flight = true;
        p.linked.autopilot.arm(false);
        let sent = |p: &LinkRig| p.arm_commands().len();
        p.run(5.0);
        assert_eq!(sent(&p), 0, "armed in a pilot's mode");
        p.linked.autopilot.answer = denied.then_some(MavResult::MAV_RESULT_DENIED);
        p.choose(AutopilotMode::Offboard);
        p.run(20.0);
        assert_eq!(
            sent(&p),
            expected,
            "{firmware:?}, {away_m} m, forecast: {forecast}"
        );
        assert_eq!(p.linked.autopilot.armed(), expected == 1);
        // The drone is not armed again after a manual disarm.
        p.linked.autopilot.arm(false);
        p.run(10.0);
        assert_eq!(sent(&p), expected, "{firmware:?}");
    }
}

#[test]
fn other_systems_on_the_link() {
    let mut p = commanding(Firmware::Px4);
    let mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
    let other = |kind| heartbeat(MavAutopilot::MAV_AUTOPILOT_INVALID, kind, mode, 0);
    let flown_by_hand = heartbeat(
        MavAutopilot::MAV_AUTOPILOT_PX4,
        MavType::MAV_TYPE_QUADROTOR,
        mode,
        mode_number(Firmware::Px4, AutopilotMode::Other),
    );
    let empty = MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA::DEFAULT).into();
    for _ in 0..100 {
        // Heartbeats of a ground station, of a camera on this drone, and of another drone in manual flight.
        p.inject(Address::new(255, 190), &other(MavType::MAV_TYPE_GCS));
        p.inject(Address::new(3, 100), &other(MavType::MAV_TYPE_CAMERA));
        p.inject(Address::new(4, 1), &flown_by_hand);
        p.inject(Address::new(4, 1), &empty);
        p.run(0.05);
        p.assert_commanding();
    }
    assert!(
        p.states
            .iter()
            .skip(20)
            .all(|s| s.battery.is_some_and(|b| b > 0.5))
    );
}

#[test]
fn odometry_about_the_autopilots_origin() {
    let origin = Datum::new(-16.8, 179.9993, 5.0);
    // The autopilot's heights are above the sea, which is `by_model` above the ellipsoid.
    let [latitude, longitude] = [origin.latitude_deg, origin.longitude_deg].map(f64::to_radians);
    let by_model = geoid::undulation(latitude, longitude).height_m;
    for firmware in BOTH {
        let mut p = aloft(firmware);
        p.linked.autopilot.origin = origin;
        // One receiver reports both heights, the other only one: a missing height must not count as zero.
        p.linked.autopilot.geoid_m = (firmware == Firmware::Px4).then_some(41.0);
        p.linked.autopilot.answer = Some(MavResult::MAV_RESULT_DENIED);
        p.linked.autopilot.no_origin = true;
        p.run(3.0);
        assert_eq!(p.authority(), ControlAuthority::NoOrigin);
        assert_eq!(p.state().rejection.code, ReasonCode::NoOrigin);
        assert!(p.odometry.is_empty());
        p.linked.autopilot.answer = None;
        p.linked.autopilot.no_origin = false;
        p.run(65.0);
        let (_, reported) = *p.odometry.last().unwrap();
        let above_m = if firmware == Firmware::Px4 { 41.0 } else { by_model };
        let height_m = 5.0 + above_m;
        assert!((p.state().origin_sea_m.unwrap() - 5.0).abs() < 0.01);
        let by_message = Datum { height_m, ..origin };
        assert!(
            reported.datum.distance_m(&by_message) < 0.02,
            "{:?}",
            reported.datum
        );
        assert!(
            (reported.position() - p.linked.autopilot.position()).norm() < 0.02,
            "{reported:?}"
        );
        p.give_the_mode();
        p.run(1.0);
        let before = p.truth().position.0;
        p.mission = State::Hold;
        p.run(3.0);
        assert!(p.sent_since(p.t_s - 1.0) >= 50);
        // The drone must hold its position and not fly kilometres.
        assert!((p.truth().position.0 - before).norm() < 0.1);
        // The estimator restarts at another position: for the other nodes the origin jumps.
        let frames = p.frames();
        p.linked.autopilot.origin.latitude_deg += 1e-4;
        p.run(6.0);
        assert_ne!(p.frames(), frames);
        let (_, reported) = *p.odometry.last().unwrap();
        assert!((reported.datum.latitude_deg - p.linked.autopilot.origin.latitude_deg).abs() < 1e-7);
    }
}

#[test]
fn set_points_before_a_landing() {
    for (firmware, some) in [(Firmware::ArduCopter, false), (Firmware::Px4, true)] {
        let mut p = commanding(firmware);
        let from = p.t_s;
        p.run(2.0);
        assert_eq!(p.sent_since(from) > 0, some, "{firmware:?}");
        p.mission = State::GetAltitude;
        let from = p.t_s;
        p.run(1.0);
        assert!(p.sent_since(from) >= 50, "{firmware:?}");
    }
}
