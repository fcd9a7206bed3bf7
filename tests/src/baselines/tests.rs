#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use alight_shared::{
    config::{Check, Keys},
    msg::{DeckForecast, DeckStage, Header, MissionState, State},
    time::{DroneTime, Span, Time},
};
use alight_uav::{
    mission::MissionConfig,
    planner::{PlannerKind, model::ModelState as Start, reference::PlanReference},
    predictor::PredictorConfig,
};

use super::{modes::SpectralModes, *};

fn at(t: f64) -> DroneTime {
    Time::from_secs(t)
}

fn forecast(t: f64, tag_age_s: f64, deck: impl Fn(f64) -> DeckStage) -> DeckForecast {
    let mut f = DeckForecast {
        header: Header::new(1, 1, 1, 0, at(t)),
        step: Span::from_millis(100),
        tag_age_s,
        ..DeckForecast::default()
    };
    for k in 0..41 {
        let _ = f.stages.push(deck(t + 0.1 * f64::from(k)));
    }
    f
}

fn permits(state: State, descent_mps: f64) -> MissionState {
    MissionState {
        state,
        descent_mps,
        height_m: 7.0,
        minimum_altitude_m: 0.5,
        ..MissionState::default()
    }
}

fn resting(position: [f64; 3]) -> Start {
    let [n, e, d] = position;
    [n, e, d, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
}

#[test]
fn configurations_of_every_planner() {
    for kind in [PlannerKind::MpcFaa, PlannerKind::Alight] {
        let mission = kind.mission(MissionConfig::default());
        mission
            .check(&Keys::ROOT)
            .unwrap_or_else(|e| panic!("{}: {e}", kind.name()));
    }
    for baseline in Baseline::ALL {
        let mission = baseline.mission(MissionConfig::default());
        let predictor = baseline.predictor(PredictorConfig::default());
        for checked in [mission.check(&Keys::ROOT), predictor.check(&Keys::ROOT)] {
            checked.unwrap_or_else(|e| panic!("{}: {e}", baseline.name()));
        }
    }
}

/// Deck that heaves by 0.4 m with a period of 5 s and rolls by `roll` rad.
fn rocking(roll: f64) -> impl Fn(f64) -> DeckStage {
    move |t| {
        let (s, c) = (core::f64::consts::TAU / 5.0 * t).sin_cos();
        DeckStage {
            position: [0.0, 0.0, -1.5 + 0.4 * s],
            velocity: [0.0, 0.0, 0.4 * core::f64::consts::TAU / 5.0 * c],
            euler: [roll * s, 0.0, 0.0],
            ..DeckStage::default()
        }
    }
}

#[test]
fn deck_modes_prediction_from_the_tag_alone() {
    let mut modes = SpectralModes::default();
    let deck = rocking(0.1);
    let mut worst: (f64, f64) = (0.0, 0.0);
    for k in 0..1200 {
        let t = f64::from(k) / 30.0;
        modes.observe(at(t), &deck(t));
        if t < 20.0 {
            assert!(t > 9.9 || !modes.ready(), "ready after {t} s");
            continue;
        }
        let p = modes.at(at(t + 1.0)).unwrap();
        let truth = deck(t + 1.0);
        worst.0 = worst.0.max((p.position[2] - truth.position[2]).abs());
        worst.1 = worst.1.max((p.tilt_squared.sqrt() - truth.euler[0].abs()).abs());
    }
    assert!(worst.0 < 0.06 && worst.1 < 0.015, "{worst:?}");
}

/// Flies MPC-NE's plans over a rocking deck. Returns the final and the minimum height above it, m.
fn mpc_ne_over(roll: f64, state: State, descent_mps: f64) -> (f64, f64) {
    let config = PlannerConfig::default();
    let drone = DroneGeometry::default();
    let mut ne = MpcNe::new(&config.reset, &drone);
    let deck = rocking(roll);
    let above = |s: &Start, t: f64| deck(t).position[2] - drone.feet_below_m - s[2];
    let mut state_now = resting([0.2, -0.1, -7.5]);
    let mut min = f64::INFINITY;
    let mut begun = false;
    for k in 0..2000 {
        let t = 0.02 * f64::from(k);
        let f = forecast(t, 0.02, &deck);
        ne.observe(None, Some(&f), &PlanReference::default());
        if t < 12.0 {
            continue;
        }
        if !begun {
            ne.begin(at(t), &state_now, 0.0);
            begun = true;
        }
        let mut plan = ne.plan(at(t), &permits(state, descent_mps), &f).unwrap();
        plan.header.at = at(t);
        let stage = plan.sample(at(t + 0.02)).unwrap();
        let p = stage.position;
        let v = stage.velocity;
        state_now = [p[0], p[1], p[2], 0.0, 0.0, 0.0, v[0], v[1], v[2], 0.0, 0.0, 0.0];
        min = min.min(above(&state_now, t + 0.02));
        if min < 0.0 {
            break;
        }
    }
    (above(&state_now, 40.0), min)
}

#[test]
fn mpc_ne_over_tilting_and_steep_decks() {
    let (_, min) = mpc_ne_over(0.03, State::Descent, 1.0);
    assert!(min < 0.0, "never down: {min}");
    // At 0.5 rad the deck is never level for long enough.
    let (_, min) = mpc_ne_over(0.5, State::Descent, 1.0);
    assert!(min > 0.8, "through the barrier: {min}");
    let (_, min) = mpc_ne_over(0.0, State::Descent, 0.0);
    assert!(min > 4.0, "sank without permission: {min}");
    let (end, _) = mpc_ne_over(0.0, State::TrackingStable, 0.0);
    assert!((end - 7.0).abs() < 1.2, "{end}");
}
