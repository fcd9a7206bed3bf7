use alight_shared::{
    config::parse,
    msg::{AutopilotMode, CommandKind, Phase, PlanRefusal, PlanStage},
    surroundings::KeepOut,
};

use super::{
    phase::DroneTime,
    tests::{COMMITTED, at, config},
    *,
};
use crate::fixtures::{airborne, command, drone, forecast, header, level, plan};

pub(super) fn node() -> MissionNode {
    MissionNode::new(
        &config(),
        &DroneGeometry::default(),
        &DeckGeometry::default(),
        1,
        1,
    )
}

pub(super) fn fresh_input(n: u32, t: DroneTime, position: [f64; 3]) -> MissionIn {
    let header = header(n, t);
    MissionIn {
        forecast: Some(deck(n, t, -1.3)),
        drone: Some(drone(header, position)),
        autopilot: Some(airborne(header)),
        plan: Some(plan(header, |_| PlanStage::default())),
        ..MissionIn::default()
    }
}

fn deck(n: u32, t: DroneTime, z: f64) -> DeckForecast {
    DeckForecast {
        radio_age_s: 0.05,
        vision_age_s: 0.05,
        tag_age_s: 0.05,
        wave_confidence: 1.0,
        ..forecast(header(n, t), |_| level([0.0, 0.0, z]))
    }
}

fn ordered(t: f64, commands: Vec<Command>) -> MissionIn {
    MissionIn {
        commands,
        ..fresh_input((t * 100.0) as u32, at(t), [0.0, 0.0, -16.3])
    }
}
fn state_after(m: &mut MissionNode, t: f64, commands: Vec<Command>) -> State {
    m.step(at(t), &ordered(t, commands));
    m.phase.state()
}
fn flown(
    m: &mut MissionNode,
    t: f64,
    commands: Vec<Command>,
    autopilot: impl FnOnce(&mut AutopilotState),
) -> State {
    let mut input = ordered(t, commands);
    autopilot(input.autopilot.as_mut().unwrap());
    m.step(at(t), &input);
    m.phase.state()
}

/// The tracking height is low while only the tags are detected.
#[test]
fn tracking_height_over_a_silent_vessel() {
    let mut m = node();
    let mut height = |k: u32, radio_age_s: f64, vision_age_s: f64| {
        let mut input = fresh_input(k, at(1.0 + f64::from(k)), [0.0, 0.0, -8.3]);
        let forecast = input.forecast.as_mut().unwrap();
        (forecast.radio_age_s, forecast.vision_age_s) = (radio_age_s, vision_age_s);
        m.step(at(1.0 + f64::from(k)), &input);
        m.config.tracking_height_m
    };
    let configured = config().tracking_height_m;
    assert_eq!(height(0, 0.05, 0.05), configured);
    assert_eq!(height(1, 6.0, 0.05), limits::TAG_HEIGHT_M);
    assert_eq!(height(2, f64::INFINITY, 6.0), configured);
    assert_eq!(height(3, 0.05, 0.05), configured);
}

/// Wrong forecasts lower the minimum altitude, relative to the long-term water level, by at most 0.2 m/s.
#[test]
fn minimum_altitude_with_a_forecast_below_the_water() {
    let mut m = node();
    let mut lowest = Vec::new();
    for k in 0..1500_u32 {
        let t = at(1.0 + f64::from(k) * 0.01);
        let mut input = fresh_input(k, t, [0.0, 0.0, -8.3]);
        if k >= 500 {
            let depth = 4.0 + 4.0 * f64::from((k - 500) / 100);
            input.forecast = Some(deck(k, t, depth));
        }
        if k == 5 {
            input.commands = vec![command(header(1, t), CommandKind::Land)];
        }
        if let Some(state) = m.step(t, &input).state {
            lowest.push(state.minimum_altitude_m);
        }
    }
    let (first, last) = (lowest[10], *lowest.last().unwrap());
    assert!((first - config().minimum_altitude_m).abs() < 1e-6, "{first}");
    assert!(last < first && last > first - 0.2 * 10.0 - 1e-6, "{last}");
}

/// If a landing takes too long, the crew is shown the reason that lasted longest, and its duration.
#[test]
fn reason_that_cost_a_landing_its_time() {
    let mut m = node();
    m.config.mission_timeout_s = 10.0;
    let gives_up = (0..2000_u32).find_map(|k| {
        let t = at(1.0 + f64::from(k) * 0.01);
        let mut input = fresh_input(k, t, [0.0, 0.0, -16.3]);
        if k == 0 {
            input.commands = vec![command(header(1, t), CommandKind::Land)];
        }
        m.step(t, &input).state.filter(|s| s.state == State::GaveUp)
    });
    let s = gives_up.unwrap();
    assert_eq!(s.entered.code, ReasonCode::WaitedTooLong);
    assert!(s.entered.value > 5.0 && s.entered.limit == 10.0, "{}", s.entered);
    // The drone stays at its approach height.
    assert_eq!(s.rejected.map(|why| why.code), Some(ReasonCode::OffHeight));
}

#[test]
fn waiting_and_leaving_among_volumes() {
    let mut m = node();
    let state = |k: u32, m: &mut MissionNode, position, kind: Option<CommandKind>| {
        let t = at(1.0 + f64::from(k) * 0.02);
        let mut input = fresh_input(k, t, position);
        let around = &mut input.forecast.as_mut().unwrap().surroundings;
        let (low, high) = ([2.0, 0.0, -14.0], [9.0, 0.0, 0.0]);
        let _ = around.keep_out.push(KeepOut { low, high });
        around.escape = Some(0.0);
        input.commands = kind.map(|kind| command(header(k, t), kind)).into_iter().collect();
        m.step(t, &input).state.unwrap()
    };
    let above = [0.0, 0.0, -1.3 - 14.0 - 5.0];
    state(5, &mut m, above, Some(CommandKind::Land));
    let goes = state(6, &mut m, above, None);
    assert_eq!(goes.state, State::Approach);
    // 14 m, 3 m for waiting, and 0.2 of 9 m.
    assert!((goes.height_m - 18.8).abs() < 1e-6, "{goes:?}");
    let leaves = state(7, &mut m, above, Some(CommandKind::Abort));
    assert!(leaves.state == State::GaveUp && leaves.with_deck, "{leaves:?}");
    // The drone is clear of the vessel beyond 9 m (volumes) plus the drone's size and margin.
    assert!(state(8, &mut m, [9.9, 0.0, above[2]], None).with_deck);
    assert!(!state(9, &mut m, [10.2, 0.0, above[2]], None).with_deck);
}

#[test]
fn age_of_plans_that_the_pilot_refuses() {
    let mut m = node();
    let mut age_s = |t: f64, refused: bool| {
        let plan_refusal = refused.then(PlanRefusal::default);
        let n = (t * 100.0) as u32;
        let input = MissionIn {
            set_point: Some(SetPoint {
                header: header(n, at(t)),
                plan_refusal,
                ..SetPoint::default()
            }),
            ..fresh_input(n, at(t), [0.0, 0.0, -5.0])
        };
        m.step(at(t), &input);
        m.situation(at(t)).plan_age_s
    };
    assert_eq!(age_s(1.0, true), f64::INFINITY);
    assert_eq!(age_s(2.0, false), 0.0);
    assert!((age_s(2.7, true) - 0.7).abs() < 1e-9);
    assert_eq!(age_s(2.8, false), 0.0);
}

/// The node follows what `CommandAdmission` admits, and answers the newest abort, also a repeated one.
#[test]
fn commands_in_their_order() {
    use CommandKind::{Abort, Land};
    let mut m = node();
    let mut give = |t: f64, sequence: u32, given: f64, kind| {
        let out = m.step(
            at(t),
            &ordered(t, vec![command(header(sequence, at(given)), kind)]),
        );
        (m.phase.state(), out.state.and_then(|s| s.abort))
    };
    assert_eq!(give(20.0, 1, 10.0, Land), (State::Idle, None), "too old");
    assert_eq!(give(20.1, 2, 20.0, Land), (State::GetAltitude, None));
    assert_eq!(give(20.5, 3, 20.5, Abort), (State::GaveUp, Some([1, 3])));
    assert_eq!(give(22.0, 4, 22.0, Land), (State::Hold, Some([1, 3])));
    assert_eq!(give(22.5, 5, 20.49, Abort), (State::Hold, Some([1, 5])));
}

fn land(boot: u32, sequence: u32, given: f64) -> Command {
    command(Header::new(1, 1, boot, sequence, at(given)), CommandKind::Land)
}

/// A pilot hands the drone back by remote control while the order is still being repeated.
#[test]
fn repeated_landing_after_a_takeover() {
    for (repeated, state) in [
        (land(7, 2, 20.0), State::Idle),
        (land(8, 1, 20.01), State::Idle),
        // The order was sent before the takeover.
        (land(8, 1, 20.9), State::Idle),
        (land(7, 2, 21.6), State::GetAltitude),
    ] {
        let mut m = node();
        assert_eq!(
            state_after(&mut m, 20.0, vec![land(7, 1, 20.0)]),
            State::GetAltitude
        );
        let taken = flown(&mut m, 21.0, Vec::new(), |a| a.mode = AutopilotMode::Other);
        assert_eq!(taken, State::Idle);
        assert_eq!(state_after(&mut m, 21.7, vec![repeated]), state, "{repeated:?}");
        let ordered = state_after(&mut m, 22.7, vec![land(9, 1, 22.7)]);
        assert_eq!(ordered.phase(), Phase::Navigation, "{ordered:?}");
    }
}

/// A pilot selects Hold or Brake, and minutes later OFFBOARD or GUIDED: a descent then needs a new order.
#[test]
fn order_after_a_hold_by_the_pilot() {
    let mode = AutopilotMode::Hold;
    for (set_points_lost, flies) in [(false, false), (true, true)] {
        let mut m = node();
        assert_eq!(
            state_after(&mut m, 20.0, vec![land(7, 1, 20.0)]),
            State::GetAltitude
        );
        for k in 0..30 {
            let t = 21.0 + 0.1 * f64::from(k);
            let held = flown(&mut m, t, Vec::new(), |a| {
                (a.mode, a.set_points_lost) = (mode, set_points_lost)
            });
            assert_eq!(held, State::Idle);
        }
        let flown = [(25.0, Vec::new()), (25.1, vec![land(7, 2, 20.0)])].map(|(t, repeated)| {
            let state = state_after(&mut m, t, repeated);
            state.phase() == Phase::Navigation
        });
        assert_eq!(flown, [flies; 2], "set_points_lost: {set_points_lost}");
    }
}

/// A repetition with the next sequence number is not an order to use the battery's reserve.
#[test]
fn repeated_landing_below_the_reserve() {
    let mut m = node();
    m.config.battery_order = vec![alight_shared::msg::BatteryPlace::Home];
    let low = |m: &mut MissionNode, t: f64, commands| {
        let battery = Some(0.3 * config().battery_reserve);
        flown(m, t, commands, |a| a.battery = battery)
    };
    assert_eq!(
        state_after(&mut m, 20.0, vec![land(7, 1, 20.0)]),
        State::GetAltitude
    );
    for k in 0..70 {
        let t = 20.5 + 0.1 * f64::from(k);
        low(&mut m, t, Vec::new());
    }
    assert_eq!(m.phase.state(), State::GaveUp);
    for (t, ordered, state) in [
        (27.5, land(7, 2, 20.01), State::GaveUp),
        (28.0, land(7, 3, 19.99), State::GaveUp),
        (28.5, land(7, 4, 28.5), State::Hold),
    ] {
        assert_eq!(low(&mut m, t, vec![ordered]), state, "{ordered:?}");
    }
}

#[test]
fn standstill_in_the_flare() {
    for (height, still_s, thrust, wanted) in [
        (0.5, 0.3, 0.34, State::Flare),
        (0.5, 0.8, 0.34, State::Tracking),
        (0.05, 0.8, 0.34, State::Flare),
        (0.05, 0.8, 0.1, State::Landed),
    ] {
        let z = -1.3 - DroneGeometry::default().feet_below_m - height;
        let mut m = node();
        (m.phase, m.since, m.progress.landing) = (COMMITTED, at(9.9), true);
        m.step(at(10.0), &fresh_input(1, at(10.0), [0.1, 0.0, z]));
        assert_eq!(m.phase.state(), State::Flare);
        let t = at(10.0 + still_s);
        let mut input = fresh_input(2, t, [0.1, 0.0, z]);
        input.autopilot.as_mut().unwrap().thrust = Some(thrust);
        let out = m.step(t, &input);
        assert_eq!(
            out.state.map(|s| s.state),
            Some(wanted),
            "{height} m, {still_s} s, thrust {thrust}"
        );
    }
}

#[test]
fn drone_without_an_order_where_the_vessel_comes() {
    for (first_m, then_m, height_m, wanted) in [
        (30.0, 30.0, 1.0, State::Idle),
        (30.0, 9.0, 1.0, State::GaveUp),
        (30.0, 9.0, 3.0, State::Idle),
        (9.0, 9.0, 1.0, State::Idle),
    ] {
        let mut m = node();
        let z = -1.3 - DroneGeometry::default().feet_below_m - height_m;
        for (k, x) in [(1, first_m), (2, first_m), (3, then_m)] {
            let t = at(10.0 + 0.01 * f64::from(k));
            m.step(t, &fresh_input(k, t, [x, 0.0, z]));
            let expected = if k < 3 { State::Idle } else { wanted };
            assert_eq!(m.phase.state(), expected, "{then_m} m away, {height_m} m above");
        }
    }
}

#[test]
fn set_point_loss_low_above_the_deck() {
    for (height, unfit, thrust, held, wanted) in [
        (0.5, false, 0.34, State::Idle, State::GetAltitude),
        (0.5, true, 0.34, State::Idle, State::GetAltitude),
        (0.05, false, 0.34, State::Idle, State::Flare),
        (0.05, false, 0.1, State::Landed, State::Landed),
    ] {
        let z = -1.3 - DroneGeometry::default().feet_below_m - height;
        let mut m = node();
        (m.phase, m.since, m.progress.landing) = (MissionPhase::DESCENT, at(9.9), true);
        let mut step = |k: u32, mode: AutopilotMode| {
            let t = at(10.0 + 0.01 * f64::from(k));
            let mut input = fresh_input(k, t, [0.1, 0.0, z]);
            input.forecast.as_mut().unwrap().radio_age_s = 9.0;
            let a = input.autopilot.as_mut().unwrap();
            (a.mode, a.set_points_lost) = (mode, mode == AutopilotMode::Hold);
            a.thrust = Some(thrust);
            if unfit {
                a.rejection = Reason::plain(ReasonCode::AutopilotParameterUnknown);
            }
            m.step(t, &input);
            m.phase.state()
        };
        let ours = AutopilotMode::Offboard;
        assert_eq!(step(1, ours).phase(), Phase::Landing);
        assert_eq!(step(2, AutopilotMode::Hold), held);
        assert_eq!(step(3, ours), wanted, "{height} m, {unfit}, thrust {thrust}");
    }
}

#[test]
fn mission_at_an_origin_reset() {
    let mut m = node();
    for k in 0..300_u32 {
        let t = at(1.0 + f64::from(k) * 0.01);
        let mut input = fresh_input(k, t, [0.0, 0.0, -16.3]);
        input
            .commands
            .extend((k == 3).then_some(command(header(1, t), CommandKind::Land)));
        if k == 200 {
            input.drone.as_mut().unwrap().frames = 1;
            input.forecast = None;
        }
        let before = m.phase.state();
        m.step(t, &input);
        if k == 200 {
            assert_eq!(before.phase(), Phase::Follow);
            assert_eq!(m.phase.state(), State::Hold);
        }
    }
}

#[test]
fn mission_configuration() {
    assert!(parse::<MissionConfig>("", "test").is_ok());
    let e = parse::<MissionConfig>("tracking_height_m = 40.0", "test")
        .unwrap_err()
        .to_string();
    assert!(e.contains("tracking_height_m") && e.contains("40"), "{e}");
}
