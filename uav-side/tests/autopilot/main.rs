//! The link to an autopilot against a stand-in that behaves as PX4 and ArduCopter do: every mode,
//! refusal, loss, take-over and disarm.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod arbitrary;
mod disarm;
mod fake_autopilot;
mod firmwares;
mod pair;

use alight_shared::frames::Datum;
use alight_shared::msg::{AutopilotMode, State};
use alight_uav::autopilot::config::BatteryConfig;
use alight_uav::autopilot::message::{Address, CommandResult, Message, command, id};
use alight_uav::autopilot::modes::Firmware;
use alight_uav::autopilot::{AutopilotLinkConfig, ControlAuthority, Diversion};
use fake_autopilot::{FakeAutopilot, HOVER, PX4_HOLD, PX4_LAND, PX4_OFFBOARD, PX4_RETURN};
use pair::{Pair, hold, lead, press};

const BOTH: [Firmware; 2] = [Firmware::Px4, Firmware::ArduCopter];

fn config() -> AutopilotLinkConfig {
    AutopilotLinkConfig::default()
}

#[test]
fn odometry_comes_at_its_rate_with_the_time_at_which_it_was_true() {
    for firmware in BOTH {
        let mut p = Pair::new(firmware, 5.0, &config());
        // Moving, so that a wrong time shows as a wrong place.
        p.autopilot.velocity.x = 2.0;
        p.run(4.0);
        p.odometry.clear();
        p.ranges.clear();
        let began = p.t_s;
        p.run(2.0);
        assert!(p.odometry.len() >= 180, "{firmware:?}: {}", p.odometry.len());
        assert!(p.ranges.len() >= 90, "{firmware:?}: {}", p.ranges.len());
        for (arrived, o) in &p.odometry {
            let age = arrived - o.header.at.secs();
            // The wire takes 6 ms, a step 5 ms; ArduCopter dates in whole milliseconds.
            assert!((0.004..0.014).contains(&age), "{firmware:?}: {age}");
        }
        assert!(p.odometry.windows(2).all(|w| w[1].1.header.at > w[0].1.header.at));
        let first = p.odometry.first().unwrap().1.header.at.secs();
        assert!(first >= began - 0.02);
        assert_eq!(
            p.link
                .metrics(alight_shared::time::Time::from_secs(p.t_s))
                .rejected,
            0
        );
    }
}

#[test]
fn px4_accepts_offboard_only_after_set_points_were_streamed() {
    let mut p = Pair::new(Firmware::Px4, 5.0, &config());
    p.pilot = None;
    p.run(5.0);
    assert_eq!(
        p.link.control_authority(),
        ControlAuthority::Standby {
            mode: AutopilotMode::Other
        }
    );
    assert!(!p.autopilot.choose(PX4_OFFBOARD), "accepted without set-points");
    p.pilot = Some(hold);
    p.run(0.5);
    assert!(!p.autopilot.choose(PX4_OFFBOARD), "accepted too early");
    p.run(1.5);
    assert!(p.autopilot.choose(PX4_OFFBOARD), "refused after an offer");
    p.run(0.6);
    assert!(p.link.control_authority().commands());
    let from = p.t_s;
    p.run(2.0);
    assert!(p.said_since(from) >= 100, "{} in 2 s", p.said_since(from));
    // Nobody but the person chose a mode or armed.
    assert!(p.told(command::SET_MODE).is_empty() && p.told(command::ARM_DISARM).is_empty());
}

#[test]
fn set_points_before_offboard_hold_the_place_and_nothing_else() {
    let mut p = Pair::new(Firmware::Px4, 5.0, &config());
    p.run(4.0);
    let from = p.t_s;
    // Attitudes, far places and set-points of a mission that flies are not offered.
    p.pilot = Some(press);
    p.run(1.0);
    p.pilot = Some(|d| alight_shared::msg::SetPoint {
        position: [d.position[0] + 20.0, 0.0, -5.0],
        ..hold(d)
    });
    p.run(1.0);
    p.pilot = Some(lead);
    p.mission = State::Approach;
    p.run(1.0);
    assert!(p.said_since(from + 0.05) <= 1, "{}", p.said_since(from));
    // ArduCopter is offered nothing at all.
    let mut p = Pair::new(Firmware::ArduCopter, 5.0, &config());
    p.run(5.0);
    assert!(p.link.control_authority().may_offer() && p.said.is_empty());
}

#[test]
fn takeover_by_a_person_ends_set_points_within_100_ms_for_good() {
    for firmware in BOTH {
        for phase in [State::Approach, State::Tracking, State::Descent, State::Flare] {
            for mode in [FakeAutopilot::manual_mode(firmware), 0] {
                let mut p = Pair::commanding(firmware, 5.0, &config());
                p.mission = phase;
                p.pilot = Some(if phase == State::Flare { press } else { lead });
                p.run(0.3);
                assert!(p.said_since(p.t_s - 0.1) > 3);
                p.autopilot.choose(mode);
                let at = p.t_s;
                // The pilot goes on and on; so does the mission.
                p.run(20.0);
                let last = p.said.last().unwrap().0;
                assert!(last - at <= 0.1, "{firmware:?} {phase:?}: {:.3} s", last - at);
                assert!(p.told(command::SET_MODE).is_empty(), "the mode was taken back");
                assert_eq!(p.autopilot.mode, mode);
                assert_eq!(p.states.last().unwrap().mode, AutopilotMode::Other);
            }
        }
    }
}

#[test]
fn authority_returns_only_when_a_person_gives_the_mode_again() {
    for firmware in BOTH {
        let mut p = Pair::commanding(firmware, 5.0, &config());
        p.autopilot.choose(FakeAutopilot::manual_mode(firmware));
        p.run(1.0);
        let quiet = p.said.len();
        p.run(0.5);
        assert_eq!(p.said.len(), quiet, "offered too early");
        p.run(4.0);
        assert!(p.autopilot.choose(FakeAutopilot::offboard_mode(firmware)));
        p.run(0.6);
        assert!(
            p.link.control_authority().commands(),
            "{}",
            p.link.control_authority()
        );
    }
}

#[test]
fn failsafes_of_the_autopilot_are_respected() {
    for (mode, seen) in [
        (PX4_RETURN, AutopilotMode::Return),
        (PX4_LAND, AutopilotMode::Land),
        (PX4_HOLD, AutopilotMode::Hold),
    ] {
        let mut p = Pair::commanding(Firmware::Px4, 5.0, &config());
        p.mission = State::Descent;
        p.autopilot.choose(mode);
        let at = p.t_s;
        p.run(30.0);
        assert!(p.said.last().unwrap().0 - at <= 0.1);
        assert_eq!(p.states.last().unwrap().mode, seen);
    }
    for (mode, seen) in [
        (6, AutopilotMode::Return),
        (9, AutopilotMode::Land),
        (17, AutopilotMode::Hold),
    ] {
        let mut p = Pair::commanding(Firmware::ArduCopter, 5.0, &config());
        p.mission = State::Descent;
        p.run(0.1);
        p.autopilot.choose(mode);
        let at = p.t_s;
        p.run(30.0);
        assert!(p.said.last().unwrap().0 - at <= 0.1);
        assert_eq!(p.states.last().unwrap().mode, seen);
    }
}

#[test]
fn silent_pilot_leaves_the_drone_to_the_failsafe_and_may_return() {
    let mut p = Pair::commanding(Firmware::Px4, 5.0, &config());
    p.pilot = None;
    let at = p.t_s;
    p.run(2.0);
    assert!(
        p.said.last().unwrap().0 - at <= 0.13,
        "stale set-points were repeated"
    );
    assert_eq!(p.autopilot.mode, PX4_HOLD);
    assert_eq!(
        p.link.control_authority(),
        ControlAuthority::TakenOver {
            mode: AutopilotMode::Hold
        }
    );
    // The person's choice is still OFFBOARD: PX4 returns to it with the stream.
    p.pilot = Some(hold);
    p.run(4.0);
    assert_eq!(p.autopilot.mode, PX4_OFFBOARD);
    assert!(p.link.control_authority().commands());
}

#[test]
fn link_without_heartbeats_sends_no_set_points_and_reports_no_state() {
    for firmware in BOTH {
        let mut p = Pair::commanding(firmware, 5.0, &config());
        p.mission = State::Tracking;
        p.run(0.1);
        p.autopilot.silent = true;
        let at = p.t_s;
        p.run(4.0);
        assert_eq!(p.link.control_authority(), ControlAuthority::LinkLost);
        // Odometry ends with the link: set-points end with it, long before the heartbeats' limit.
        assert!(
            p.said.last().unwrap().0 - at <= 0.25,
            "{}",
            p.said.last().unwrap().0 - at
        );
        let told = p.states.len();
        p.run(2.0);
        assert_eq!(p.states.len(), told, "a state without a heartbeat");
        // The mission waits anew, as it does when the drone is not ours.
        p.mission = State::Idle;
        p.autopilot.silent = false;
        p.run(4.0);
        assert!(
            p.link.control_authority().commands(),
            "{}",
            p.link.control_authority()
        );
    }
}

#[test]
fn link_resynchronises_with_an_autopilot_that_restarts() {
    for firmware in BOTH {
        let mut p = Pair::commanding(firmware, 5.0, &config());
        let resets = p.states.last().unwrap().origin_resets;
        p.autopilot.restart();
        p.run(6.0);
        assert_ne!(p.states.last().unwrap().origin_resets, resets);
        let (arrived, o) = p.odometry.last().unwrap();
        assert!((0.0..0.02).contains(&(arrived - o.header.at.secs())));
        assert!(p.t_s - arrived < 0.05);
        assert!(
            p.link.control_authority().commands(),
            "{}",
            p.link.control_authority()
        );
    }
}

#[test]
fn link_recovers_after_a_cut_of_three_seconds() {
    let mut p = Pair::commanding(Firmware::Px4, 5.0, &config());
    p.cut = true;
    p.run(3.0);
    assert_eq!(p.link.control_authority(), ControlAuthority::LinkLost);
    p.cut = false;
    p.run(4.0);
    assert!(
        p.link.control_authority().commands(),
        "{}",
        p.link.control_authority()
    );
}

#[test]
fn link_flies_nothing_without_timesync() {
    let mut p = Pair::new(Firmware::Px4, 5.0, &config());
    p.autopilot.timeless = true;
    p.run(6.0);
    assert_eq!(p.link.control_authority(), ControlAuthority::NoClock);
    assert!(p.odometry.is_empty() && p.said.is_empty());
}

#[test]
fn ardu_copter_without_the_thrust_option_is_not_flown_and_explained() {
    let mut p = Pair::new(Firmware::ArduCopter, 5.0, &config());
    p.autopilot.options = 0;
    p.run(5.0);
    assert_eq!(p.link.control_authority(), ControlAuthority::OptionMissing);
    assert!(
        p.texts.iter().any(|t| t.contains("GUID_OPTIONS bit 3")),
        "{:?}",
        p.texts
    );
    p.autopilot.choose(4);
    p.run(2.0);
    assert!(p.said.is_empty());
    // The mission is not to believe that it has the drone.
    assert_eq!(p.states.last().unwrap().mode, AutopilotMode::Other);
    // The person sets it.
    p.autopilot.options = 8;
    p.run(2.0);
    assert!(
        p.link.control_authority().commands(),
        "{}",
        p.link.control_authority()
    );
}

#[test]
fn link_works_without_messages_that_the_firmware_lacks() {
    let mut p = Pair::new(Firmware::ArduCopter, 5.0, &config());
    p.run(5.0);
    // No ODOMETRY on ArduCopter: not even asked for, and odometry comes from 31 and 32.
    let asked = p.told(command::MESSAGE_INTERVAL);
    assert!(asked.iter().all(|c| c.parameters[0] as u32 != id::ODOMETRY));
    assert!(p.odometry.len() > 200);
    // An autopilot that refuses every rate: asked a bounded number of times, nothing flown.
    let mut p = Pair::new(Firmware::Px4, 5.0, &config());
    p.autopilot.answer = Some(CommandResult::Denied);
    p.run(30.0);
    assert_eq!(p.link.control_authority(), ControlAuthority::NoOdometry);
    assert!(p.commands.len() <= 3 * 7, "{}", p.commands.len());
}

#[test]
fn hover_thrust_is_identified_in_flight_and_reported() {
    for firmware in BOTH {
        let mut p = Pair::commanding(firmware, 5.0, &config());
        p.run(6.0);
        let s = p.states.last().unwrap();
        assert!(
            (s.hover_thrust - HOVER).abs() < 0.01,
            "{firmware:?}: {}",
            s.hover_thrust
        );
        assert!((s.battery - 0.9).abs() < 0.011);
    }
}

#[test]
fn link_arms_only_when_configured() {
    for (may_arm, denied) in [(false, false), (true, false), (true, true)] {
        let c = AutopilotLinkConfig { may_arm, ..config() };
        let mut p = Pair::new(Firmware::ArduCopter, 0.3, &c);
        p.autopilot.armed = false;
        p.waits_for_flight = true;
        p.run(5.0);
        assert!(p.told(command::ARM_DISARM).is_empty(), "armed in a person's mode");
        p.autopilot.answer = denied.then_some(CommandResult::Denied);
        p.autopilot.choose(4);
        p.run(20.0);
        let told = p.told(command::ARM_DISARM).len();
        let expected = match (may_arm, denied) {
            (false, _) => 0,
            (true, false) => 1,
            (true, true) => 3,
        };
        assert_eq!(told, expected);
        assert_eq!(p.autopilot.armed, may_arm && !denied);
        // A person disarms: it is not armed again.
        p.autopilot.armed = false;
        p.run(10.0);
        assert_eq!(p.told(command::ARM_DISARM).len(), expected);
    }
}

#[test]
fn battery_reserve_diverts_the_drone_as_configured() {
    for (firmware, to, mode) in [
        (Firmware::Px4, Diversion::Return, PX4_RETURN),
        (Firmware::Px4, Diversion::Land, PX4_LAND),
        (Firmware::ArduCopter, Diversion::Return, 6),
        (Firmware::ArduCopter, Diversion::Land, 9),
    ] {
        let c = AutopilotLinkConfig {
            battery: BatteryConfig {
                diversion: to,
                ..BatteryConfig::default()
            },
            ..config()
        };
        let mut p = Pair::commanding(firmware, 5.0, &c);
        p.mission = State::Tracking;
        p.autopilot.battery = 0.05;
        p.run(6.0);
        assert_eq!(p.autopilot.mode, mode);
        assert_eq!(p.told(command::SET_MODE).len(), 1);
        let at = p.t_s;
        p.run(10.0);
        assert_eq!(p.said_since(at), 0);
    }
    let none = AutopilotLinkConfig {
        battery: BatteryConfig {
            diversion: Diversion::None,
            ..BatteryConfig::default()
        },
        ..config()
    };
    let mut p = Pair::commanding(Firmware::Px4, 5.0, &none);
    p.autopilot.battery = 0.05;
    p.run(10.0);
    assert!(p.link.control_authority().commands() && p.told(command::SET_MODE).is_empty());
}

#[test]
fn denied_diversion_is_tried_a_bounded_number_of_times_without_set_points() {
    let mut p = Pair::commanding(Firmware::ArduCopter, 5.0, &config());
    p.autopilot.battery = 0.05;
    p.autopilot.answer = Some(CommandResult::Denied);
    p.run(20.0);
    assert_eq!(p.told(command::SET_MODE).len(), 3);
    assert_eq!(p.said_since(p.t_s - 10.0), 0);
    assert_eq!(
        p.link.control_authority(),
        ControlAuthority::Diverted(Diversion::Return)
    );
}

#[test]
fn battery_reserve_does_not_divert_in_the_flare() {
    let mut p = Pair::commanding(Firmware::Px4, 5.0, &config());
    p.mission = State::Flare;
    p.autopilot.battery = 0.05;
    p.run(6.0);
    assert!(p.told(command::SET_MODE).is_empty() && p.link.control_authority().commands());
}

#[test]
fn other_systems_on_the_link_are_not_taken_for_the_autopilot() {
    let mut p = Pair::commanding(Firmware::Px4, 5.0, &config());
    let beat = |autopilot, vehicle, custom_mode| Message::Heartbeat {
        autopilot,
        vehicle,
        base_mode: 1,
        custom_mode,
    };
    for _ in 0..100 {
        // A ground station, a camera of the same drone, another drone that is flown by hand.
        p.inject(
            Address {
                system: 255,
                component: 190,
            },
            &beat(8, 6, 0),
        );
        p.inject(
            Address {
                system: 3,
                component: 100,
            },
            &beat(8, 30, 0),
        );
        p.inject(
            Address {
                system: 4,
                component: 1,
            },
            &beat(12, 2, FakeAutopilot::manual_mode(Firmware::Px4)),
        );
        p.inject(
            Address {
                system: 4,
                component: 1,
            },
            &Message::Battery {
                number: 0,
                remaining: Some(0.0),
            },
        );
        p.run(0.05);
        assert!(
            p.link.control_authority().commands(),
            "{}",
            p.link.control_authority()
        );
    }
    assert!(p.states.iter().skip(20).all(|s| s.battery > 0.5));
}

#[test]
fn deck_is_published_to_the_autopilot_when_configured() {
    let c = AutopilotLinkConfig {
        publish_deck: true,
        ..config()
    };
    for (c, some) in [(config(), false), (c, true)] {
        let mut p = Pair::new(Firmware::Px4, 5.0, &c);
        p.run(5.0);
        assert_eq!(p.offered >= 20, some, "{}", p.offered);
    }
}

#[test]
fn positions_and_set_points_are_converted_to_the_datum_and_back() {
    let datum = Datum {
        latitude_deg: 43.5,
        longitude_deg: 16.3,
        height_m: 40.0,
    };
    let origin = Datum {
        latitude_deg: 43.5005,
        longitude_deg: 16.2993,
        height_m: 5.0,
    };
    // The autopilot tells heights above the sea, here 40 m above the ellipsoid.
    let c = AutopilotLinkConfig {
        geoid_m: 40.0,
        ..config()
    };
    let shift = datum
        .offset_to::<alight_shared::frames::DroneNed>(&Datum {
            height_m: 45.0,
            ..origin
        })
        .0;
    for firmware in BOTH {
        let mut p = Pair::at(firmware, 5.0, &c, Some(datum));
        p.autopilot.origin = origin;
        p.autopilot.answer = Some(CommandResult::Denied);
        p.autopilot.deaf_to_requests = true;
        p.run(3.0);
        assert_eq!(p.link.control_authority(), ControlAuthority::NoOrigin);
        assert!(p.odometry.is_empty());
        (p.autopilot.answer, p.autopilot.deaf_to_requests) = (None, false);
        p.run(65.0);
        let told = p.odometry.last().unwrap().1;
        assert!(
            (told.position() - p.autopilot.position - shift).norm() < 0.02,
            "{told:?}"
        );
        assert!(
            p.autopilot.choose(FakeAutopilot::offboard_mode(firmware)),
            "{}",
            p.link.control_authority()
        );
        let before = p.autopilot.position;
        p.mission = State::Hold;
        p.run(3.0);
        assert!(p.said_since(p.t_s - 1.0) >= 50);
        // Held in its place, not kilometres away.
        assert!((p.autopilot.position - before).norm() < 0.1);
        // The estimator begins anew elsewhere: the origin moves, and that is a jump for the others.
        let resets = p.states.last().unwrap().origin_resets;
        p.autopilot.origin.latitude_deg += 1e-4;
        p.run(6.0);
        assert_ne!(p.states.last().unwrap().origin_resets, resets);
    }
}

#[test]
fn before_a_landing_guided_gets_no_set_points_and_offboard_holds() {
    for (firmware, some) in [(Firmware::ArduCopter, false), (Firmware::Px4, true)] {
        let mut p = Pair::commanding(firmware, 5.0, &config());
        let from = p.t_s;
        p.run(2.0);
        assert_eq!(p.said_since(from) > 0, some, "{firmware:?}");
        p.mission = State::GetAltitude;
        let from = p.t_s;
        p.run(1.0);
        assert!(p.said_since(from) >= 50, "{firmware:?}");
    }
}
