use alight_shared::{
    msg::{
        AutopilotState, DeckForecast, DeckStage, DroneState, Header, Plan, PlanStage, Reason, ReasonCode, Seq,
    },
    time::{DroneClock, Span},
};

use super::*;
use crate::status::{Figure, StateView};

/// Forecast of a vessel that heads east, with the deck at north 10, east 20, one metre above the sea.
fn forecast(t_s: f64) -> DeckForecast {
    let stage = |k: usize| DeckStage {
        position: [10.0, 20.0 + 0.1 * k as f64, -1.0],
        euler: [0.1, -0.05, core::f64::consts::FRAC_PI_2],
        ..DeckStage::default()
    };
    DeckForecast {
        header: header(t_s),
        step: Span::from_millis(50),
        mean_heading: core::f64::consts::FRAC_PI_2,
        stages: Seq::filled((0..41).map(stage)),
        ..DeckForecast::default()
    }
}
fn header(t_s: f64) -> Header<DroneClock> {
    Header::new(1, 1, 7, 1, Time::from_secs(t_s))
}
fn at(t_s: f64) -> Time<TrueTime> {
    Time::from_secs(t_s)
}
fn mission(t_s: f64, state: State, waiting: Reason) -> MissionState {
    MissionState {
        header: header(t_s),
        since: Time::from_secs(t_s - 2.0),
        state,
        waiting,
        battery_reserve: 0.3,
        attempts: 1,
        ..MissionState::default()
    }
}
fn autopilot(battery: f64) -> AutopilotState {
    AutopilotState {
        armed: true,
        battery: Some(battery),
        ..AutopilotState::default()
    }
}
fn show(board: &mut Board, t_s: f64, messages: &[Message<'_>]) {
    messages.iter().for_each(|m| board.message(at(t_s), m));
}
fn named<'a>(picture: &'a Picture, name: &str) -> &'a Figure {
    picture.status.figures.iter().find(|f| f.name == name).unwrap()
}

#[test]
fn board_of_nothing() {
    let picture = Board::new(ComputerReport::default()).picture(at(5.0));
    let status = picture.status;
    assert!(status.state.is_none() && picture.scene.is_none() && picture.motion.roll_deg.is_empty());
    assert_eq!(status.figures.len(), 7);
    assert!(status.figures.iter().all(|f| f.value.is_none()), "{status:?}");
}

#[test]
fn board_places_of_drone_and_plan() {
    let mut board = Board::new(ComputerReport::default());
    let drone = DroneState {
        position: [7.0, 24.0, -6.0],
        wind: Some([-6.2, 0.0]),
        wind_sd_mps: Some(0.84),
        ..DroneState::default()
    };
    let stage = PlanStage {
        position: [10.0, 22.0, -2.0],
        ..PlanStage::default()
    };
    let plan = Plan {
        header: header(1.0),
        stages: Seq::filled([stage; 3]),
        ..Plan::default()
    };
    let messages = [
        Message::Forecast(&forecast(1.0)),
        Message::Drone(&drone),
        Message::Plan(header(1.0).at, &plan),
        Message::Autopilot(&autopilot(0.8)),
        Message::Mission(&mission(1.0, State::Tracking, Reason::default())),
    ];
    show(&mut board, 1.0, &messages);
    let picture = board.picture(at(1.0));
    let scene = picture.scene.clone().unwrap();
    assert_eq!(picture.track.drone, [Some([-3.0, 4.0])]);
    assert_eq!(picture.track.deck, [Some([0.0, 0.0])]);
    let compass = picture.status.compass.clone().unwrap();
    assert_eq!(
        (compass.wind_from_deg, compass.text.as_str()),
        (Some(-90.0), "wind 6 m/s from 90° to port of the bow")
    );
    // East of the deck is ahead of it, south is to starboard.
    assert_eq!(scene.drone.as_ref().unwrap().at, [4.0, 3.0, 5.0]);
    assert_eq!(scene.plan, [[2.0, 0.0, 1.0]; 2]);
    assert_eq!((scene.contact, scene.flare_m), (None, None));
    assert_eq!((scene.heading_deg, scene.euler_deg), (90.0, [5.7, -2.9, 0.0]));
    assert_eq!(named(&picture, "distance").value.as_deref(), Some("5.0 m"));
    let wind = named(&picture, "wind");
    assert_eq!(
        (wind.value.as_deref(), wind.note.as_str()),
        (Some("6 m/s from 0°"), "known to 0.8 m/s (one standard deviation)")
    );
    let later = board.picture(at(4.0)).scene.unwrap();
    assert!(later.forecast_stale && later.plan_stale && later.drone.unwrap().stale);
}

/// At 3 m/s to the north the plan follows the deck's forecast and ends on the deck, however old both are.
#[test]
fn board_of_a_plan_under_way() {
    const STEP_S: f64 = 0.05;
    let north = |k: usize| 100.0 + 3.0 * STEP_S * k as f64;
    let heave = |k: usize| -1.0 - 0.01 * k as f64;
    let deck = |k: usize| DeckStage {
        position: [north(k), 5.0, heave(k)],
        velocity: [3.0, 0.0, -0.2],
        euler: [0.0, 0.02, 0.0],
        ..DeckStage::default()
    };
    let moving = DeckForecast {
        header: header(1.0),
        step: Span::from_secs(STEP_S),
        stages: Seq::filled((0..41).map(deck)),
        ..DeckForecast::default()
    };
    let stage = |k: usize| PlanStage {
        position: [
            north(k),
            5.0,
            heave(k) - 0.3 - 0.05 * 30_usize.saturating_sub(k) as f64,
        ],
        velocity: [3.0, 0.0, 0.8],
        ..PlanStage::default()
    };
    let plan = Plan {
        header: header(1.0),
        step: Span::from_secs(STEP_S),
        touchdown_at: Some(Time::from_secs(1.0 + 30.0 * STEP_S)),
        stages: Seq::filled((0..41).map(stage)),
        ..Plan::default()
    };
    let drone = DroneState {
        header: header(1.4),
        position: [north(8), 5.0, -3.0],
        velocity: [3.0, 0.0, 0.5],
        ..DroneState::default()
    };
    let mut board = Board::new(ComputerReport::default());
    board.heights_m = Some([0.3, 1.3]);
    let sinking = Reason::new(ReasonCode::Descending, 1.6, 0.9);
    let messages = [
        Message::Forecast(&moving),
        Message::Drone(&drone),
        Message::Plan(header(1.0).at, &plan),
        Message::Autopilot(&autopilot(0.8)),
        Message::Mission(&mission(1.0, State::Descent, sinking)),
    ];
    show(&mut board, 1.0, &messages);
    let scene = board.picture(at(1.4)).scene.unwrap();
    assert_eq!((scene.way_mps, scene.heading_deg), ([3.0, 0.0], 0.0));
    assert_eq!(
        (scene.flare_m, scene.feet_m, scene.freeboard_m),
        (Some(0.9), Some(0.3), Some(1.3))
    );
    let drone = scene.drone.unwrap();
    assert_eq!((drone.at, drone.closing_mps), ([0.0, 0.0, 1.92], 0.7));
    assert!(
        scene.plan.iter().all(|p| p[0].abs() < 0.02 && p[1] == 0.0),
        "{:?}",
        scene.plan
    );
    // From 1.8 m above the deck to the feet's height, in 15 steps of two stages.
    assert_eq!((scene.plan.len(), scene.plan[0][2]), (16, 1.8));
    let [ahead, right, up] = scene.plan[15];
    assert!(ahead.abs() < 0.02 && right == 0.0 && (up - 0.3).abs() < 0.02);
    let contact = scene.contact.unwrap();
    assert_eq!(
        (contact.in_s, contact.tilt_deg, contact.rise_m),
        (1.1, Some([0.0, 1.1]), Some(0.22))
    );
    // After the end of the forecast the deck remains at the origin, and old plans are not drawn.
    let later = board.picture(at(7.0)).scene.unwrap();
    assert_eq!((later.contact, later.plan.len()), (None, 0));
}

#[test]
fn board_of_a_waiting_and_a_silent_mission() {
    let mut board = Board::new(ComputerReport::default());
    let waiting = Reason::new(ReasonCode::TooFast, 0.45, 0.3);
    let messages = [
        Message::Autopilot(&autopilot(0.8)),
        Message::Mission(&mission(10.0, State::Tracking, waiting)),
    ];
    show(&mut board, 10.0, &messages);
    let picture = board.picture(at(10.2));
    let state = picture.status.state.as_ref().unwrap();
    assert_eq!(state.waiting, "0.45 m/s relative to the deck (limit 0.30)");
    assert!((state.since_s - 2.2).abs() < 1e-6 && !state.stale);
    assert!(picture.status.alarms().is_empty());
    let silent = board.picture(at(13.0)).status;
    assert!(silent.state.as_ref().unwrap().stale);
    assert_eq!(silent.alarms()[0].found, "no message from the mission for 3 s");
    assert!(named(&board.picture(at(13.0)), "battery").stale);
}

#[test]
fn board_of_ended_flights() {
    let mut board = Board::new(ComputerReport::default());
    let mut step = |t_s: f64, state| {
        let state = mission(t_s, state, Reason::default());
        board.message(at(t_s), &Message::Mission(&state));
    };
    step(0.0, State::Idle);
    for k in 0..20 {
        let t_s = 100.0 * f64::from(k);
        step(t_s + 1.0, State::Approach);
        step(t_s + 30.0, State::Descent);
        step(t_s + 41.0, if k % 2 == 0 { State::Landed } else { State::GaveUp });
        step(t_s + 60.0, State::Idle);
    }
    let picture = board.picture(at(2000.0));
    assert_eq!(picture.flights.len(), FLIGHTS);
    assert_eq!(picture.log.len(), LOG_LINES);
    let newest = &picture.flights[0];
    assert_eq!(
        (newest.outcome.as_str(), newest.when.as_str()),
        ("Gave up", "59 s ago")
    );
    assert!(newest.text.contains("1 descent, after 40 s"), "{newest:?}");
    board.reset(at(2000.0));
    let after = board.picture(at(2000.0));
    assert_eq!((after.flights.len(), after.status.state), (FLIGHTS, None));
}

/// The reply to an abort remains until the next flight begins, by a landing order or by starting the motors.
#[test]
fn board_of_an_old_answer() {
    let mut board = Board::new(ComputerReport::default());
    let step = |board: &mut Board, t_s: f64, state, armed| {
        let autopilot = AutopilotState {
            armed,
            ..autopilot(0.8)
        };
        let state = mission(t_s, state, Reason::default());
        show(
            board,
            t_s,
            &[Message::Autopilot(&autopilot), Message::Mission(&state)],
        );
        board.picture(at(t_s)).order.answer
    };
    let answers = |board: &mut Board| board.order.answer = "abort taken: Gave up".into();
    step(&mut board, 1.0, State::Descent, true);
    step(&mut board, 2.0, State::GaveUp, true);
    answers(&mut board);
    assert_eq!(step(&mut board, 3.0, State::GaveUp, true), "abort taken: Gave up");
    assert_eq!(step(&mut board, 4.0, State::Hold, true), "");
    answers(&mut board);
    assert_ne!(step(&mut board, 5.0, State::Approach, true), "");
    assert_ne!(step(&mut board, 6.0, State::Idle, false), "");
    assert_eq!(step(&mut board, 7.0, State::Idle, true), "");
}

/// The situations recorded in `deploy/scripts/page` have the same fields as the pictures that the board makes now.
#[test]
fn recorded_situations_of_the_page() {
    use serde_json::Value;
    use std::collections::BTreeSet;
    let keys = |v: &Value| -> BTreeSet<String> {
        let all = v.as_object().into_iter().flatten();
        all.map(|(key, _)| key.clone()).collect()
    };
    let of = |v: serde_json::Result<Value>| keys(&v.unwrap());
    let picture = of(serde_json::to_value(Picture::default()));
    let scene = of(serde_json::to_value(SceneView::default()));
    let state = of(serde_json::to_value(StateView::default()));
    let record: Value = serde_json::from_str(include_str!("../../../../scripts/page.json")).unwrap();
    let situations = record.as_object().unwrap();
    assert_eq!(situations.len(), 10);
    for (name, situation) in situations {
        let shown = if name == "base" {
            situation
        } else {
            &situation["picture"]
        };
        let unknown: Vec<String> = keys(shown).difference(&picture).cloned().collect();
        assert!(unknown.iter().all(|k| k == "vessel"), "{name}: {unknown:?}");
        for (part, expected) in [("scene", &scene), ("state", &state)] {
            let found = keys(&shown[part]);
            assert!(
                found.is_empty() || found == *expected,
                "{name}: {part}: {found:?}"
            );
        }
    }
}

/// A landing's result has its place and speed, and the decrease of the battery's charge gives the time to the
/// reserve.
#[test]
fn board_of_a_contact_and_a_battery() {
    let mut board = Board::new(ComputerReport::default());
    board.heights_m = Some([0.3, 1.0]);
    show(&mut board, 1.0, &[Message::Autopilot(&autopilot(0.8))]);
    let fall = |board: &mut Board, t_s: f64, state, feet_m: f64, mps: f64| {
        let drone = DroneState {
            header: header(t_s),
            position: [10.0, 20.3, -1.3 - feet_m],
            velocity: [0.0, 0.0, mps],
            ..DroneState::default()
        };
        let messages = [
            Message::Mission(&mission(t_s, state, Reason::default())),
            Message::Forecast(&forecast(t_s)),
            Message::Drone(&drone),
        ];
        show(board, t_s, &messages);
    };
    fall(&mut board, 60.0, State::Flare, 0.5, 0.4);
    fall(&mut board, 60.9, State::Flare, 0.05, 0.35);
    fall(&mut board, 61.0, State::Flare, 0.01, 0.02);
    fall(&mut board, 61.2, State::Landed, 0.0, 0.0);
    show(&mut board, 61.0, &[Message::Autopilot(&autopilot(0.7))]);
    let picture = board.picture(at(61.2));
    let result = picture.result.clone().unwrap();
    assert_eq!(result.outcome, "Landed");
    assert!(
        result
            .text
            .starts_with("0.30 m off the deck's centre at 0.35 m/s; 1 descent"),
        "{result:?}"
    );
    // 40 % above the reserve at 10 % a minute.
    assert!(named(&picture, "battery").note.contains("4 min to the reserve"));
}

#[test]
fn board_of_a_simulation_early_and_too_slow() {
    let mut board = Board::new(ComputerReport::default());
    let mut report = |late_s: f64, t_s: f64| {
        let metrics = [
            MetricName::LatestTick.seconds(late_s),
            MetricName::TimeSinceStart.seconds(t_s),
        ];
        board.processes(vec![ProcessState {
            kind: ProcessKind::World,
            metrics: Seq::filled(metrics),
            ..ProcessState::default()
        }]);
        (board.picture(at(1.0)).begins_in_s, board.too_slow())
    };
    assert_eq!(report(0.0, -48.0).0, Some(48.0));
    assert_eq!(report(0.9, 3.0), (None, None));
    let end = report(1.3, 3.0).1.unwrap();
    for part in ["1.3 s behind", "not valid", "alight trial --view"] {
        assert!(end.contains(part), "{part}: {end}");
    }
}
