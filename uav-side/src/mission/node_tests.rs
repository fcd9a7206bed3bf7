//! The mission's node: an ideal drone, commands, checkpoints, frames, random input.

use alight_shared::config::parse;
use alight_shared::msg::{AutopilotMode, Message, Phase, PlanStage};
use alight_shared::surroundings::KeepOut;
use nalgebra::Vector3;
use proptest::prelude::*;

use super::tests::{COMMITTED, DroneTime, at, config};
use super::*;
use crate::fixtures::{airborne, command, drone, forecast, header, level, plan};

pub(super) fn node() -> Mission {
    Mission::new(
        &config(),
        &DroneGeometry::default(),
        &DeckGeometry::default(),
        1,
        1,
    )
}

/// Everything fresh for a hovering drone over a level deck.
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

/// A level deck at that height, known to all.
fn deck(n: u32, t: DroneTime, z: f64) -> DeckForecast {
    DeckForecast {
        radio_age_s: 0.05,
        vision_age_s: 0.05,
        tag_age_s: 0.05,
        wave_confidence: 1.0,
        ..forecast(header(n, t), |_| level([0.0, 0.0, z]))
    }
}

/// These commands at `t` to a drone at the approach height over the deck.
fn ordered(t: f64, commands: Vec<Command>) -> MissionIn {
    MissionIn {
        commands,
        ..fresh_input((t * 100.0) as u32, at(t), [0.0, 0.0, -16.3])
    }
}
/// The state after them.
fn state_after(m: &mut Mission, t: f64, commands: Vec<Command>) -> State {
    m.step(at(t), &ordered(t, commands));
    m.phase.state()
}
/// Flies with another autopilot.
fn flown(
    m: &mut Mission,
    t: f64,
    commands: Vec<Command>,
    autopilot: impl FnOnce(&mut AutopilotState),
) -> State {
    let mut input = ordered(t, commands);
    autopilot(input.autopilot.as_mut().unwrap());
    m.step(at(t), &input);
    m.phase.state()
}

/// Low where only the tags are detected, as configured where the vessel is received and where nothing is detected any more.
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

/// The minimum altitude is a height over the long-term water level: a wrong forecast may lower it by 0.2 m/s and
/// no more, by jumps of any size.
#[test]
fn minimum_altitude_with_a_forecast_below_the_water() {
    let mut m = node();
    let mut lowest = Vec::new();
    for k in 0..1500_u32 {
        let t = at(1.0 + f64::from(k) * 0.01);
        let mut input = fresh_input(k, t, [0.0, 0.0, -8.3]);
        if k >= 500 {
            // Ever deeper, in steps.
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

/// The radio has the deck 31 m too low, and no camera sees it: by mean sea level the drone stays 15 m above where it is.
#[test]
fn heights_of_two_receivers_that_disagree() {
    let mut m = node();
    let mut last = State::Idle;
    for k in 0..400_u32 {
        let t = at(1.0 + f64::from(k) * 0.01);
        let mut input = fresh_input(k, t, [40.0, 0.0, -12.0]);
        input.forecast = Some(DeckForecast {
            vision_age_s: 100.0,
            tag_age_s: 100.0,
            ..deck(k, t, -1.3 + 31.0)
        });
        input.autopilot.as_mut().unwrap().origin_sea_m = Some(0.0);
        if k == 5 {
            input.commands = vec![command(header(1, t), CommandKind::Land)];
        }
        if let Some(state) = m.step(t, &input).state.filter(|_| k > 2) {
            assert!(state.minimum_altitude_m > 16.2, "{state:?}");
            assert!(
                state.state == State::Idle || state.hold_position[2] < -16.2,
                "{state:?}"
            );
            last = state.state;
        }
    }
    assert_eq!(last, State::GetAltitude);
}

#[test]
fn waiting_and_leaving_among_volumes() {
    let mut m = node();
    let state = |k: u32, m: &mut Mission, position, kind: Option<CommandKind>| {
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
    // As high as there, but not away.
    assert!(leaves.state == State::GaveUp && leaves.with_deck, "{leaves:?}");
    // Beyond the volumes' 9 m and a drone with its margin.
    assert!(state(8, &mut m, [9.9, 0.0, above[2]], None).with_deck);
    assert!(!state(9, &mut m, [10.2, 0.0, above[2]], None).with_deck);
}

/// A drone that goes at once where the mission wants it, and a pilot that stops at the deck.
#[test]
fn landing_of_an_ideal_drone() {
    let mut m = node();
    let mut p = Vector3::new(40.0, -10.0, -12.0);
    let (mut detected, mut touched) = (vec![State::Idle], false);
    let (mut arrived, mut begun) = (None, None);
    for k in 0..6000_u32 {
        let t = at(1.0 + f64::from(k) * 0.01);
        let mut input = fresh_input(k, t, p.into());
        if k == 5 {
            input.commands = vec![command(header(1, t), CommandKind::Land)];
        }
        if touched {
            input.set_point = Some(SetPoint {
                header: header(k, t),
                motors: Motors::Stop,
                ..SetPoint::default()
            });
        }
        let Some(state) = m.step(t, &input).state else {
            continue;
        };
        assert!(state.check().is_ok());
        if detected.last() != Some(&state.state) {
            detected.push(state.state);
        }
        let target = match state.state.phase() {
            Phase::Navigation if state.state != State::Approach => state.hold_position(),
            Phase::Navigation | Phase::Follow => Vector3::new(0.0, 0.0, -1.3 - state.height_m),
            Phase::Landing => Vector3::new(0.0, 0.0, p.z + state.descent_mps),
            Phase::None => p,
        };
        let step = target - p;
        let max = if state.state.phase() == Phase::Landing {
            0.02 * state.descent_mps
        } else {
            0.08
        };
        p += step * (max / step.norm().max(max));
        if p.xy().norm() < 2.0 {
            arrived.get_or_insert(t);
        }
        if state.state == State::Descent {
            begun.get_or_insert(t);
        }
        touched |= p.z > -1.3 - 0.3;
    }
    assert_eq!(
        detected,
        [
            State::Idle,
            State::GetAltitude,
            State::Approach,
            State::Tracking,
            State::TrackingStable,
            State::Descent,
            State::Flare,
            State::Landed
        ]
    );
    let dawdled = (begun.unwrap() - arrived.unwrap()).secs();
    assert!(dawdled < 4.0, "{dawdled}");
    let rejected = m.forecast.rejected() + m.drone.rejected() + m.autopilot.rejected() + m.plan.rejected();
    assert_eq!(
        rejected + m.set_point.rejected() + m.commands.rejected().total(),
        0
    );
}

#[test]
fn command_freshness_and_order() {
    let mut m = node();
    let give = |m: &mut Mission, t: f64, given: f64, n: u32, kind| {
        state_after(m, t, vec![command(header(n, at(given)), kind)]);
        m.commands.rejected().total()
    };
    assert_eq!(give(&mut m, 20.0, 10.0, 1, CommandKind::Land), 1, "too old");
    assert_eq!(m.phase.state(), State::Idle);
    assert_eq!(give(&mut m, 20.1, 20.0, 2, CommandKind::Land), 1);
    assert_eq!(m.phase.state(), State::GetAltitude);
    assert_eq!(give(&mut m, 20.2, 20.15, 3, CommandKind::Abort), 1);
    assert_eq!(give(&mut m, 20.3, 20.0, 2, CommandKind::Land), 2, "out of order");
    assert_eq!(m.phase.state(), State::GaveUp);
}

/// An order to land by the operator who has this boot id.
fn land(boot: u32, sequence: u32, given: f64) -> Command {
    command(Header::new(1, 1, boot, sequence, at(given)), CommandKind::Land)
}

/// A person takes the drone over by remote control, and gives it back while the order is still repeated.
#[test]
fn repeated_landing_after_a_takeover() {
    for (repeated, state) in [
        (land(7, 2, 20.0), State::Idle),
        // From a relay that was restarted.
        (land(8, 1, 20.01), State::Idle),
        // On its way since before the take-over.
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

/// A person chooses Hold or Brake, and OFFBOARD or GUIDED minutes later: nothing descends without a new order.
#[test]
fn order_after_a_hold_of_a_person() {
    let mode = AutopilotMode::Hold;
    for (lapsed, flies) in [(false, false), (true, true)] {
        let mut m = node();
        assert_eq!(
            state_after(&mut m, 20.0, vec![land(7, 1, 20.0)]),
            State::GetAltitude
        );
        for k in 0..30 {
            let t = 21.0 + 0.1 * f64::from(k);
            let held = flown(&mut m, t, Vec::new(), |a| (a.mode, a.lapsed) = (mode, lapsed));
            assert_eq!(held, State::Idle);
        }
        let flown = [(25.0, Vec::new()), (25.1, vec![land(7, 2, 20.0)])].map(|(t, repeated)| {
            let state = state_after(&mut m, t, repeated);
            state.phase() == Phase::Navigation
        });
        assert_eq!(flown, [flies; 2], "lapsed: {lapsed}");
    }
}

/// One reading of an empty battery, and one that lasts.
#[test]
fn lasting_empty_battery() {
    let mut m = node();
    let step = |m: &mut Mission, t: f64, battery: Option<f64>, commands| {
        let mut input = fresh_input((t * 100.0) as u32, at(t), [60.0, 0.0, -16.3]);
        input.autopilot = input.autopilot.map(|a| AutopilotState { battery, ..a });
        m.step(at(t), &MissionIn { commands, ..input });
        m.progress.low_battery.is_some()
    };
    assert!(!step(&mut m, 20.0, Some(0.8), vec![land(7, 1, 20.0)]));
    for k in 1..100 {
        let t = 20.0 + 0.1 * f64::from(k);
        // A gauge that loses its reading, once a second.
        let battery = if k % 10 == 0 { 0.0 } else { 0.8 };
        assert!(!step(&mut m, t, Some(battery), Vec::new()), "{t}");
    }
    for k in 0..60 {
        let t = 30.0 + 0.1 * f64::from(k);
        let diverts = step(&mut m, t, Some(0.0), Vec::new());
        assert_eq!(diverts, k >= 50, "{t}");
    }
}

/// A repetition under the next sequence number is no order to use the battery's reserve.
#[test]
fn repeated_landing_below_the_reserve() {
    let mut m = node();
    m.config.battery_order = vec![alight_shared::msg::BatteryPlace::Home];
    let low = |m: &mut Mission, t: f64, commands| {
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
fn landing_of_another_operator_about_an_abort() {
    let land_at = |boot: u32, given: f64| land(boot, 9, given);
    for (land, state) in [
        // Pending since before the abort, and repeated.
        (land_at(7, 19.9), State::GaveUp),
        (land_at(7, 20.2), State::GaveUp),
        // The sender of the abort goes on, or another that knows of it.
        (land_at(1, 20.2), State::Hold),
        (land_at(7, 21.2), State::Hold),
    ] {
        let mut m = node();
        let mut step = |t: f64, commands| state_after(&mut m, t, commands);
        step(19.5, vec![command(header(1, at(19.5)), CommandKind::Land)]);
        let abort = command(header(2, at(20.0)), CommandKind::Abort);
        assert_eq!(step(20.0, vec![abort]), State::GaveUp);
        assert_eq!(step(21.5, vec![land]), state, "{land:?}");
    }
    // Of what comes in one step the abort counts.
    let abort = command(header(1, at(19.99)), CommandKind::Abort);
    let both = vec![abort, land_at(7, 20.0)];
    assert_eq!(state_after(&mut node(), 20.0, both), State::GaveUp);
}

#[test]
fn late_abort_after_a_newer_order() {
    let mut m = node();
    let mut step = |t: f64, commands| state_after(&mut m, t, commands);
    let abort = |sequence: u32, given: f64| command(header(sequence, at(given)), CommandKind::Abort);
    step(20.0, vec![land(7, 1, 20.0)]);
    // Given before that landing, and late.
    assert_eq!(step(21.0, vec![abort(1, 19.5)]), State::GaveUp);
    // That landing again, by an operator who cannot know.
    assert_eq!(step(21.5, vec![land(7, 2, 20.0)]), State::GaveUp);
    assert_eq!(step(23.0, vec![land(7, 3, 22.9)]), State::Hold);
    // The abort that was applied, again.
    assert_eq!(step(23.2, vec![abort(2, 19.55)]), State::Hold);
    assert_eq!(step(23.4, vec![abort(3, 23.3)]), State::GaveUp);
}

#[test]
fn abort_echo_with_its_newest_repetition() {
    let mut m = node();
    let mut echo = |t: f64, commands: Vec<Command>| {
        let out = m.step(at(t), &ordered(t, commands));
        (m.phase.state(), out.state.and_then(|s| s.abort))
    };
    let abort = |sequence: u32, given: f64| command(header(sequence, at(given)), CommandKind::Abort);
    assert_eq!(echo(20.0, vec![land(1, 1, 20.0)]).1, None);
    assert_eq!(echo(20.5, vec![abort(2, 20.5)]), (State::GaveUp, Some([1, 2])));
    // Its repetition stops no landing that was ordered since, and is answered.
    assert_eq!(echo(22.0, vec![land(1, 3, 22.0)]), (State::Hold, Some([1, 2])));
    assert_eq!(echo(22.5, vec![abort(4, 20.49)]), (State::Hold, Some([1, 4])));
}

/// The checkpoint of a mission that is over the deck in this state.
fn checkpoint(state: State, t: f64) -> MissionCheckpoint {
    let header = Header::new(1, 1, 5, 9, at(t));
    MissionCheckpoint {
        header,
        state: MissionState {
            header,
            state,
            attempts: 1,
            since: at(t - 1.0),
            hold_position: [1.0, 2.0, -16.0],
            ..MissionState::default()
        },
        landing: true,
        started: at(t - 30.0),
        mean_deck_z: Some(-1.3),
        ..MissionCheckpoint::default()
    }
}

/// State in which a successor begins that is given this checkpoint at 10 s while the drone hovers at `height` above the
/// deck; and why it rejected it.
fn begun(checkpoint: Option<MissionCheckpoint>, height: f64) -> (MissionState, Option<CheckpointRejection>) {
    let (drone, deck) = (DroneGeometry::default(), DeckGeometry::default());
    let mut m = Mission::new(&config(), &drone, &deck, 1, 2).as_successor();
    for k in 0..100_u32 {
        let t = at(10.0 + 0.01 * f64::from(k));
        let z = -1.3 - drone.feet_below_m - height;
        let input = MissionIn {
            checkpoint,
            ..fresh_input(k, t, [0.1, 0.0, z])
        };
        let out = m.step(t, &input);
        if let Some(state) = out.state {
            assert_eq!(out.checkpoint.map(|m| m.state), Some(state));
            return (state, out.rejected);
        }
    }
    panic!("no state for a second")
}

#[test]
fn successor_with_a_checkpoint() {
    for state in [
        State::Idle,
        State::GetAltitude,
        State::Approach,
        State::Tracking,
        State::Descent,
        State::Landed,
        State::Hold,
        State::GaveUp,
    ] {
        let (s, rejected) = begun(Some(checkpoint(state, 9.8)), 3.0);
        let wanted = if state == State::Idle {
            State::GetAltitude
        } else {
            state
        };
        assert_eq!((s.state, rejected), (wanted, None));
        if matches!(state, State::Hold | State::GaveUp) {
            // Over the deck it moves with that until it is as high.
            assert_eq!((s.hold_position, s.with_deck), ([0.1, 0.0, -16.0], true));
        }
    }
    for (at_s, height, state) in [
        (9.8, 0.5, State::Flare),
        // The pilot has left the plan since: it begins again, but not from the deck.
        (9.0, 0.5, State::Tracking),
        (9.0, 0.05, State::Flare),
    ] {
        assert_eq!(begun(Some(checkpoint(State::Flare, at_s)), height).0.state, state);
    }
    assert_eq!(begun(Some(checkpoint(State::Descent, 9.8)), 3.0).0.attempts, 1);
}

/// The pilot stopped the motors while no mission ran; the successor reads its set-point one step late.
#[test]
fn successor_after_the_pilot_stopped_the_motors() {
    let (drone, deck) = (DroneGeometry::default(), DeckGeometry::default());
    let mut m = Mission::new(&config(), &drone, &deck, 1, 2).as_successor();
    for k in 0..10_u32 {
        let t = at(10.0 + 0.01 * f64::from(k));
        let mut input = fresh_input(k, t, [0.1, 0.0, -1.3 - drone.feet_below_m]);
        input.checkpoint = Some(checkpoint(State::Flare, 9.9));
        input.autopilot = input.autopilot.map(|a| AutopilotState { armed: false, ..a });
        input.set_point = Some(SetPoint {
            header: header(k, t),
            motors: Motors::Stop,
            ..SetPoint::default()
        })
        .filter(|_| k > 2);
        m.step(t, &input);
    }
    assert_eq!(m.phase.state(), State::Landed);
}

#[test]
fn standstill_in_the_flare() {
    for (height, still_s, wanted) in [
        (0.5, 0.3, State::Flare),
        (0.5, 0.8, State::Tracking),
        (0.05, 0.8, State::Flare),
    ] {
        let z = -1.3 - DroneGeometry::default().feet_below_m - height;
        let mut m = node();
        (m.phase, m.since, m.progress.landing) = (COMMITTED, at(9.9), true);
        m.step(at(10.0), &fresh_input(1, at(10.0), [0.1, 0.0, z]));
        assert_eq!(m.phase.state(), State::Flare);
        let t = at(10.0 + still_s);
        let out = m.step(t, &fresh_input(2, t, [0.1, 0.0, z]));
        assert_eq!(
            out.state.map(|s| s.state),
            Some(wanted),
            "{height} m, {still_s} s"
        );
    }
}

#[test]
fn drone_without_an_order_where_the_vessel_comes() {
    for (first_m, then_m, height_m, wanted) in [
        (30.0, 30.0, 1.0, State::Idle),
        (30.0, 9.0, 1.0, State::GaveUp),
        (30.0, 9.0, 3.0, State::Idle),
        // It was handed over there.
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
fn lapse_low_above_the_deck() {
    for (height, unfit, wanted) in [
        (0.5, false, State::GetAltitude),
        (0.5, true, State::GetAltitude),
        (0.05, false, State::Flare),
    ] {
        let z = -1.3 - DroneGeometry::default().feet_below_m - height;
        let mut m = node();
        (m.phase, m.since, m.progress.landing) = (MissionPhase::DESCENT, at(9.9), true);
        let mut step = |k: u32, mode: AutopilotMode| {
            let t = at(10.0 + 0.01 * f64::from(k));
            let mut input = fresh_input(k, t, [0.1, 0.0, z]);
            input.forecast.as_mut().unwrap().radio_age_s = 9.0;
            let a = input.autopilot.as_mut().unwrap();
            (a.mode, a.lapsed) = (mode, mode == AutopilotMode::Hold);
            if unfit {
                a.rejection = Reason::plain(ReasonCode::AutopilotParameterUnknown);
            }
            m.step(t, &input);
            m.phase.state()
        };
        let ours = AutopilotMode::Offboard;
        assert_eq!(step(1, ours).phase(), Phase::Landing);
        assert_eq!(step(2, AutopilotMode::Hold), State::Idle);
        assert_eq!(step(3, ours), wanted, "{height} m, {unfit}");
    }
}

#[test]
fn successor_without_a_sound_checkpoint() {
    let change = |f: fn(&mut MissionCheckpoint)| {
        let mut m = checkpoint(State::Descent, 9.8);
        f(&mut m);
        Some(m)
    };
    use CheckpointRejection::{Age, Damaged, OtherDrone, Version};
    for (bad, why) in [
        (None, None),
        // The keeper has none.
        (Some(MissionCheckpoint::default()), None),
        (change(|m| m.header.version -= 1), Some(Version)),
        (change(|m| m.state.header.version -= 1), Some(Damaged)),
        (change(|m| m.header.drone = 2), Some(OtherDrone)),
        (change(|m| m.header.at = at(4.0)), Some(Age)),
        (change(|m| m.header.at = at(11.0)), Some(Age)),
        (change(|m| m.state.hold_position[0] = f64::NAN), Some(Damaged)),
        (change(|m| m.mean_deck_z = Some(f64::NAN)), Some(Damaged)),
    ] {
        let (s, rejected) = begun(bad, 1.0);
        assert_eq!((s.state, rejected), (State::GaveUp, why), "{bad:?}");
        assert_eq!(s.entered.code, ReasonCode::Restarted);
        assert!((s.hold_position[2] + 16.3).abs() < 0.1, "{s:?}");
    }
    // On the deck the pilot's evidence decides; away from it nothing happens.
    assert_eq!(begun(None, 0.05).0.state, State::Flare);
    assert_eq!(begun(None, 12.0).0.state, State::Idle);
}

#[test]
fn abort_among_many_commands_to_a_successor() {
    let (drone, deck) = (DroneGeometry::default(), DeckGeometry::default());
    for abort_at in [0, 15, 16, 29] {
        let mut m = Mission::new(&config(), &drone, &deck, 1, 2).as_successor();
        let mut entered = None;
        for k in 0..100_u32 {
            let t = at(10.0 + 0.01 * f64::from(k));
            let kind = if k == abort_at {
                CommandKind::Abort
            } else {
                CommandKind::Land
            };
            let input = MissionIn {
                commands: (k < 30)
                    .then(|| command(header(k + 1, t), kind))
                    .into_iter()
                    .collect(),
                checkpoint: (k == 29).then(|| checkpoint(State::Tracking, 10.2)),
                ..fresh_input(k, t, [0.1, 0.0, -8.3])
            };
            if let Some(state) = m.step(t, &input).state {
                entered.get_or_insert(state.state);
            }
        }
        assert_eq!(entered, Some(State::GaveUp), "abort as command {abort_at}");
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

fn wild() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -20.0..20.0_f64,
        2 => 0.0..1.0_f64,
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(-1e300),
    ]
}

#[derive(Clone, Debug)]
struct Blow {
    mask: u8,
    age_ms: i64,
    position: [f64; 3],
    drone: [f64; 3],
    ages: [f64; 2],
    sd: f64,
    armed: bool,
    mode: AutopilotMode,
    stop: bool,
    command: Option<CommandKind>,
    battery: f64,
    repeat: u8,
}

fn blow() -> impl Strategy<Value = Blow> {
    let mode = prop_oneof![
        6 => Just(AutopilotMode::Offboard),
        1 => Just(AutopilotMode::Other),
        1 => Just(AutopilotMode::Hold),
    ];
    let command = prop_oneof![
        20 => Just(None),
        4 => Just(Some(CommandKind::Land)),
        1 => Just(Some(CommandKind::Abort)),
        1 => Just(Some(CommandKind::Hold)),
    ];
    let deck = prop_oneof![4 => Just([0.0, 0.0, -1.3]), 1 => prop::array::uniform3(wild())];
    let drone = prop_oneof![
        2 => Just([0.0, 0.0, -16.3]),
        3 => Just([0.1, 0.0, -8.3]),
        3 => (0.0..3.0_f64).prop_map(|h| [0.1, 0.1, -1.6 - h]),
        1 => prop::array::uniform3(wild()),
    ];
    let age = prop_oneof![3 => 0.0..0.4_f64, 1 => wild()];
    (
        (any::<u8>(), -200..800_i64, deck, drone),
        (age.clone(), age, wild(), prop::bool::weighted(0.95), mode),
        (prop::bool::weighted(0.02), command, wild(), 1..80_u8),
    )
        .prop_map(
            |((mask, age_ms, position, drone), (a, b, sd, armed, mode), (stop, command, battery, repeat))| {
                Blow {
                    // Most inputs arrive most of the time.
                    mask: mask | mask.rotate_left(3) | mask.rotate_left(5),
                    age_ms: if age_ms < 600 { 0 } else { age_ms - 500 },
                    position,
                    drone,
                    ages: [a, b],
                    sd: if sd > 1.0 { 0.05 } else { sd },
                    armed,
                    mode,
                    stop,
                    command,
                    battery,
                    repeat,
                }
            },
        )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]
    #[test]
    fn mission_random_input(blows in prop::collection::vec(blow(), 1..60)) {
        let mut m = node();
        let mut now = at(1.0);
        let mut n = 0_u32;
        let (mut followed, mut stop_at) = (false, None);
        for b in &blows {
            for r in 0..b.repeat {
                n += 1;
                now += Span::from_millis(10);
                let then = now - Span::from_millis(b.age_ms);
                let mut input = fresh_input(n, then, b.drone);
                let f = input.forecast.as_mut().unwrap();
                [f.radio_age_s, f.vision_age_s] = b.ages;
                for s in f.stages.iter_mut() {
                    s.position = b.position;
                    s.position_sd = [b.sd.abs(); 3];
                }
                let a = input.autopilot.as_mut().unwrap();
                (a.armed, a.mode, a.battery) = (b.armed, b.mode, Some(b.battery.abs().min(1.0)));
                if b.mask & 1 == 0 { input.forecast = None }
                if b.mask & 2 == 0 { input.drone = None }
                if b.mask & 4 == 0 { input.autopilot = None }
                if b.mask & 8 == 0 { input.plan = None }
                if b.stop && b.mask & 16 != 0 {
                    input.set_point = Some(SetPoint { header: header(n, then), motors: Motors::Stop, ..SetPoint::default() });
                    stop_at = stop_at.max(Some(then));
                }
                if r == 0 {
                    input.commands.extend(b.command.map(|kind| command(header(n, then), kind)));
                }
                let out = m.step(now, &input);
                let state = m.phase.state();
                // After a lapse of the link a drone that stands on the deck with its motors running finishes its
                // landing.
                let begins = |code| matches!(code, ReasonCode::Restarted | ReasonCode::GivenBack);
                let stands = |s: &MissionState| begins(s.entered.code) && s.entered.value.abs() < 0.15;
                followed |= state.phase() == Phase::Follow || out.state.as_ref().is_some_and(stands);
                if state == State::Idle { followed = false }
                prop_assert!(state.phase() != Phase::Landing || followed, "landing without following");
                if let Some(s) = out.state {
                    prop_assert!(s.check().is_ok(), "{s:?}");
                    if s.descent_mps > 0.0 {
                        prop_assert!(m.forecast.fresh(now, topics::FORECAST.stale_after).is_some());
                        prop_assert!(m.drone.fresh(now, topics::DRONE_STATE.stale_after).is_some());
                        prop_assert!(m.autopilot.get().is_some_and(|a| a.armed));
                        let detected = m.forecast.get().map_or(f64::INFINITY, |f| f.vision_age_s);
                        prop_assert!(detected <= 13.0, "deck not detected: {detected}");
                    }
                    if s.state == State::Landed && s.previous != State::Landed && s.since == now {
                        prop_assert!(stop_at.is_some_and(|t| now - t <= Span::from_millis(110)));
                    }
                }
            }
        }
    }
}
