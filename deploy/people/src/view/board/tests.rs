use alight_shared::msg::{
    AutopilotState, DeckForecast, DeckStage, DroneState, Header, LinkState, Plan, PlanStage, Reason,
    ReasonCode, Seq,
};

use super::*;
use crate::status::Figure;
use crate::status::finding::Level;

/// The vessel heads east; the deck is at north 10, east 20, one metre above the sea.
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
fn mission(t_s: f64, state: State, waiting: Reason) -> MissionOut {
    let state = MissionState {
        header: header(t_s),
        since: Time::from_secs(t_s - 2.0),
        state,
        waiting,
        battery_reserve: 0.3,
        attempts: 1,
        ..MissionState::default()
    };
    MissionOut {
        state: Some(state),
        ..MissionOut::default()
    }
}
fn autopilot(battery: f64) -> MissionIn {
    let autopilot = AutopilotState {
        armed: true,
        battery: Some(battery),
        ..AutopilotState::default()
    };
    MissionIn {
        autopilot: Some(autopilot),
        ..MissionIn::default()
    }
}
fn named<'a>(picture: &'a Picture, name: &str) -> &'a Figure {
    picture.status.figures.iter().find(|f| f.name == name).unwrap()
}

#[test]
fn board_of_nothing() {
    let picture = Board::new(ComputerReport::default()).picture(at(5.0));
    let status = picture.status;
    assert!(status.state.is_none() && picture.scene.is_none() && picture.motion.roll_deg.is_empty());
    assert_eq!(status.figures.len(), 8);
    assert!(status.figures.iter().all(|f| f.value.is_none()), "{status:?}");
}

#[test]
fn board_places_of_drone_and_plan() {
    let mut board = Board::new(ComputerReport::default());
    let drone = DroneState {
        position: [7.0, 24.0, -6.0],
        ..DroneState::default()
    };
    let seen = PredictorIn {
        drone: Some(drone),
        ..PredictorIn::default()
    };
    let predicted = PredictorOut {
        forecast: Some(forecast(1.0)),
        ..PredictorOut::default()
    };
    board.predictor(at(1.0), &seen, &predicted);
    let stage = PlanStage {
        position: [10.0, 22.0, -2.0],
        ..PlanStage::default()
    };
    let plan = Plan {
        header: header(1.0),
        stages: Seq::filled([stage; 3]),
        ..Plan::default()
    };
    board.planner(at(1.0), &PlannerOut { plan: Some(plan) });
    let mut windy = mission(1.0, State::Tracking, Reason::default());
    windy.state.as_mut().unwrap().wind = Some([-6.2, 0.0]);
    board.mission(at(1.0), &autopilot(0.8), &windy);
    let picture = board.picture(at(1.0));
    let scene = picture.scene.clone().unwrap();
    assert_eq!(picture.track.drone, [Some([-3.0, 4.0])]);
    assert_eq!(picture.track.deck, [Some([0.0, 0.0])]);
    let compass = picture.status.compass.clone().unwrap();
    assert_eq!(
        (compass.wind_from_deg, compass.text.as_str()),
        (Some(-90.0), "wind 6 m/s from 90° to port of the bow")
    );
    // East of the deck is ahead of it, south to starboard.
    assert_eq!(scene.drone.as_ref().unwrap().at, [4.0, 3.0, 5.0]);
    assert_eq!(scene.plan, [[2.0, 0.0, 1.0]; 2]);
    assert_eq!(scene.forecast.last(), Some(&[4.0, 0.0, 0.0]));
    assert_eq!((scene.heading_deg, scene.euler_deg), (90.0, [5.7, -2.9, 0.0]));
    assert_eq!(named(&picture, "distance").value.as_deref(), Some("5.0 m"));
    // What blows to the south comes from the north.
    assert_eq!(named(&picture, "wind").value.as_deref(), Some("6 m/s from 0°"));
    let later = board.picture(at(4.0)).scene.unwrap();
    assert!(later.forecast_stale && later.plan_stale && later.drone.unwrap().stale);
}

#[test]
fn board_of_a_waiting_and_a_silent_mission() {
    let mut board = Board::new(ComputerReport::default());
    let waiting = Reason::new(ReasonCode::TooFast, 0.45, 0.3);
    board.mission(
        at(10.0),
        &autopilot(0.8),
        &mission(10.0, State::Tracking, waiting),
    );
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
fn board_alarms() {
    let mut board = Board::new(ComputerReport::default());
    let reason = Reason::default();
    board.mission(at(1.0), &autopilot(0.25), &mission(1.0, State::GaveUp, reason));
    let link = LinkState {
        age_s: 1.5,
        ..LinkState::default()
    };
    let received = BridgeOut {
        link: Some(link),
        ..BridgeOut::default()
    };
    board.bridge(at(1.0), &received);
    let picture = board.picture(at(1.1));
    let alarms = picture.status.alarms();
    let has = |text: &str| {
        alarms
            .iter()
            .any(|f| f.level == Level::Broken && f.found.contains(text))
    };
    assert!(
        has("Gave up") && has("estimate is 1.6 s old") && has("battery at 25 %"),
        "{alarms:?}"
    );
    for name in ["link", "battery"] {
        assert_eq!(named(&picture, name).level, Level::Broken, "{name}");
    }
}

#[test]
fn board_of_ended_flights() {
    let mut board = Board::new(ComputerReport::default());
    let mut step = |t_s: f64, state| {
        board.mission(
            at(t_s),
            &MissionIn::default(),
            &mission(t_s, state, Reason::default()),
        );
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
        ("gave up", "59 s ago")
    );
    assert!(newest.text.contains("1 descent, after 40 s"), "{newest:?}");
    board.reset(at(2000.0));
    let after = board.picture(at(2000.0));
    assert_eq!((after.flights.len(), after.status.state), (FLIGHTS, None));
}

/// The answer to an abort stays until the next flight begins: by a landing, or by the motors.
#[test]
fn board_of_an_old_answer() {
    let mut board = Board::new(ComputerReport::default());
    let step = |board: &mut Board, t_s: f64, state, armed| {
        let mut input = autopilot(0.8);
        input.autopilot.as_mut().unwrap().armed = armed;
        board.mission(at(t_s), &input, &mission(t_s, state, Reason::default()));
        board.picture(at(t_s)).order.answer
    };
    let answers = |board: &mut Board| board.order.answer = "abort taken: Gave up".into();
    step(&mut board, 1.0, State::Descent, true);
    step(&mut board, 2.0, State::GaveUp, true);
    answers(&mut board);
    assert_eq!(step(&mut board, 3.0, State::GaveUp, true), "abort taken: Gave up");
    assert_eq!(step(&mut board, 4.0, State::Hold, true), "");
    answers(&mut board);
    // The landing goes on.
    assert_ne!(step(&mut board, 5.0, State::Approach, true), "");
    assert_ne!(step(&mut board, 6.0, State::Idle, false), "");
    assert_eq!(step(&mut board, 7.0, State::Idle, true), "");
}
