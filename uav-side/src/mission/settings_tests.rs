//! Tests of a ground station's settings, and of an idle mission's state after a crash.

use alight_shared::msg::{CommandKind, LandingMode};

use super::{
    node_tests::{fresh_input, node},
    phase::DroneTime,
    tests::{at, config},
    *,
};
use crate::fixtures::{command, header};

fn order(t: f64, settings: MissionSettings) -> Option<SettingsOrder> {
    let header = header(1, at(t));
    Some(SettingsOrder { header, settings })
}
fn matching() -> MissionSettings {
    MissionSettings {
        mode: LandingMode::Match,
        approach_height_m: 12.0,
        ..config().settings()
    }
}
fn disarmed(t: f64) -> MissionIn {
    let mut input = fresh_input((t * 100.0) as u32, at(t), [30.0, 0.0, 0.0]);
    input.autopilot.as_mut().unwrap().armed = false;
    input.set_point = Some(SetPoint {
        header: header(1, at(t)),
        ..SetPoint::default()
    });
    input
}
fn after(m: &mut MissionNode, t: f64, input: &MissionIn) -> MissionState {
    m.step(at(t), input).state.unwrap()
}

#[test]
fn settings_of_a_ground_station() {
    let (before, wanted) = (config().settings(), matching());
    let mut m = node();
    assert_eq!(after(&mut m, 1.0, &disarmed(1.0)).settings, before);
    let set = |t, settings| MissionIn {
        settings: order(t, settings),
        ..disarmed(t)
    };
    let state = after(&mut m, 2.0, &set(2.0, wanted));
    assert!(state.settings == wanted && state.settable);
    assert_eq!(
        (m.config.mode, m.config.approach_height_m),
        (LandingMode::Match, 12.0)
    );
    // These values are out of bounds, or may be set only in the configuration file.
    for (t, wrong) in [
        (
            3.0,
            MissionSettings {
                approach_height_m: 500.0,
                ..wanted
            },
        ),
        (
            4.0,
            MissionSettings {
                lowest_clearance_m: 6.5,
                ..wanted
            },
        ),
        (
            5.0,
            MissionSettings {
                tracking_height_m: 6.0,
                ..wanted
            },
        ),
    ] {
        assert_eq!(after(&mut m, t, &set(t, wrong)).settings, wanted);
    }
    let s = m.situation(at(5.0));
    assert!(m.is_settable(&s));
    m.phase = MissionPhase::Countdown { since: at(5.0) };
    assert!(!m.is_settable(&s));
    m.phase = MissionPhase::Idle;
    for given in [4.9, 6.1] {
        let input = MissionIn {
            settings: order(given, before),
            ..disarmed(6.0)
        };
        m.step(at(6.0), &input);
        assert_eq!(m.settings, wanted, "{given}");
    }
}

#[test]
fn settings_while_armed_or_ordered_to_land() {
    let (before, wanted) = (config().settings(), matching());
    let mut m = node();
    let flying = MissionIn {
        settings: order(1.0, wanted),
        ..fresh_input(100, at(1.0), [30.0, 0.0, -16.0])
    };
    let state = after(&mut m, 1.0, &flying);
    assert!(state.settings == before && !state.settable);
    let mut m = node();
    let unknown = MissionIn {
        autopilot: None,
        ..flying
    };
    assert_eq!(after(&mut m, 1.0, &unknown).settings, before);
    // The order to land arrives together with the settings, then before them.
    let mut m = node();
    let ordered = MissionIn {
        commands: vec![command(header(1, at(1.0)), CommandKind::Land)],
        ..disarmed(1.0)
    };
    assert!(!after(&mut m, 1.0, &ordered).settable);
    let late = MissionIn {
        settings: order(1.1, wanted),
        ..disarmed(1.1)
    };
    assert_eq!(after(&mut m, 1.1, &late).settings, before);
}

fn successor(t: DroneTime, checkpoint: MissionCheckpoint, input: MissionIn) -> (MissionNode, MissionState) {
    let (drone, deck) = (DroneGeometry::default(), DeckGeometry::default());
    let mut m = MissionNode::new(&config(), &drone, &deck, 1, 2).as_successor();
    let input = MissionIn {
        checkpoint: Some(checkpoint),
        ..input
    };
    let state = m.step(t, &input).state.unwrap();
    (m, state)
}

#[test]
fn settings_of_a_crashed_mission() {
    let mut m = node();
    let set = MissionIn {
        settings: order(1.0, matching()),
        ..disarmed(1.0)
    };
    let left = m.step(at(1.0), &set).checkpoint.unwrap();
    let (next, state) = successor(at(1.5), left, disarmed(1.5));
    assert_eq!(state.settings, matching());
    assert_eq!(next.config.mode, LandingMode::Match);
}

/// After an operator's stop and a long crash the drone climbs to the height that was set, not to that of the file.
#[test]
fn approach_height_of_a_crashed_mission() {
    let mut m = node();
    let flies = |t: f64| fresh_input((t * 100.0) as u32, at(t), [0.0, 0.0, -8.3]);
    let left = m.step(at(1.0), &flies(1.0)).checkpoint.unwrap();
    let climbs_to = |approach_height_m| {
        let settings = MissionSettings {
            approach_height_m,
            ..config().settings()
        };
        let state = MissionState {
            state: State::Descent,
            settings,
            ..left.state
        };
        let stopped = MissionCheckpoint {
            state,
            stopped: true,
            ..left
        };
        let (_, state) = successor(at(2.0), stopped, flies(2.0));
        assert_eq!(
            (state.state, state.entered.code),
            (State::GaveUp, ReasonCode::Restarted)
        );
        -state.hold_position().z
    };
    let raised_m = climbs_to(30.0) - climbs_to(15.0);
    assert!((raised_m - 15.0).abs() < 1e-6, "{raised_m} m");
}

/// A vessel approaches a drone that hovers low without an order.
#[test]
fn vessel_that_comes_near_after_a_crash() {
    let hovers = |t: f64, north_m: f64| fresh_input((t * 100.0) as u32, at(t), [north_m, 0.0, -2.6]);
    let mut m = node();
    let left = m.step(at(1.0), &hovers(1.0, 20.0)).checkpoint.unwrap();
    assert!(left.was_away && left.state.state == State::Idle);
    let near = |was_away| {
        let left = MissionCheckpoint { was_away, ..left };
        successor(at(1.2), left, hovers(1.2, 8.0)).1
    };
    let climbs = near(true);
    assert_eq!(
        (climbs.state, climbs.entered.code),
        (State::GaveUp, ReasonCode::TooNear)
    );
    assert_eq!(near(false).state, State::Idle);
}
