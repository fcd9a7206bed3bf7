use alight_shared::msg::{
    CarrierSolution,
    ReasonCode::{
        Descending, Deviated, FlareHeight, Flaring, HarmLikely, LikelyTilted, Missed, NoPlan, Swings,
        TiltExcess, TooSteep, VisionLost,
    },
    RelativeState,
};
use nalgebra::{UnitQuaternion, Vector3};

use State::{Descent, Flare, Tracking, TrackingStable};

use super::{
    situation::{ClimbRoom, Deck, OwnState},
    tests::{
        Does::{Enter, Stay},
        *,
    },
    *,
};
use crate::fixtures::{drone, forecast, header, level};

#[test]
fn flare_clearance() {
    // Continuing is safer if the deck has risen to the drone.
    let risen = with_deck(|d| (d.clearance_m, d.distance_m) = (0.6, 0.7));
    let low = with_deck(|d| d.clearance_m = 0.85);
    let rows = [
        (fair(), 0.0, Stay(Descent, Descending)),
        (low, 0.0, Enter(Flare, FlareHeight)),
        (risen, 0.0, Enter(Flare, FlareHeight)),
    ];
    table(DESCENT, rows);
}

#[test]
fn descent_with_a_lasting_violation() {
    for (s, why) in [
        (with_deck(|d| d.vision_age_s = 1.2), VisionLost),
        (with_deck(|d| d.distance_m = 4.0), Deviated),
        (with_odds(|p| p.tilted = 0.7), LikelyTilted),
        (with_odds(|p| p.hard = 0.77), HarmLikely),
        (with_deck(|d| d.tilt_rad = 0.8), TooSteep),
        (with(|s| s.plan_age_s = 0.6), NoPlan),
        (with(|s| s.swing_rad = 0.2), Swings),
    ] {
        let rows = [(s, 0.2, Stay(Descent, why)), (s, 1.0, Enter(Tracking, why))];
        table(DESCENT, rows);
    }
}

/// The strict limit holds at the last height from which the drone can climb, also over a deck that rises to it, and
/// neither above nor below that height.
#[test]
fn harm_at_the_last_height_for_a_climb() {
    let harmful = |climb: ClimbRoom, hard: f64, clearance_m: f64| {
        let mut s = with_odds(|p| (p.hard, p.gusts) = (hard, true));
        let deck = s.deck.as_mut().unwrap();
        (deck.climb, deck.clearance_m) = (climb, clearance_m);
        s
    };
    let stays = Stay(Descent, Descending);
    let rows = [
        (harmful(ClimbRoom::Clear, 0.95, 2.5), 0.5, stays),
        (
            harmful(ClimbRoom::Clear, 0.95, 0.85),
            0.0,
            Enter(Tracking, HarmLikely),
        ),
        (
            harmful(ClimbRoom::Last, 0.95, 1.3),
            0.0,
            Enter(Tracking, HarmLikely),
        ),
        (
            harmful(ClimbRoom::Last, 0.95, 0.7),
            0.0,
            Enter(Tracking, HarmLikely),
        ),
        (harmful(ClimbRoom::Last, 0.995, 1.3), 0.5, stays),
        (
            harmful(ClimbRoom::Meets, 0.95, 0.7),
            0.0,
            Enter(Flare, FlareHeight),
        ),
    ];
    table(DESCENT, rows);
    goes(
        &step(FREE_FLARE, &harmful(ClimbRoom::Last, 0.95, 0.85)),
        Tracking,
        HarmLikely,
    );
    assert_eq!(
        step(COMMITTED, &harmful(ClimbRoom::Last, 0.95, 0.7))
            .phase
            .state(),
        Flare
    );
}

/// In gusts a descent pauses low above the deck until a lull, at most for eight seconds.
#[test]
fn pause_of_a_descent_in_gusts() {
    let at_height = |clearance_m: f64, gusts: bool, hard: f64| {
        let mut s = with_odds(|p| (p.hard, p.gusts) = (hard, gusts));
        s.deck.as_mut().unwrap().clearance_m = clearance_m;
        s
    };
    let rows = [
        (at_height(2.0, true, 0.96), 7.0, Stay(Descent, HarmLikely)),
        (at_height(2.0, true, 0.96), 9.0, Enter(Tracking, HarmLikely)),
        (at_height(2.0, true, 0.995), 9.0, Stay(Descent, Descending)),
        (at_height(2.0, false, 0.96), 9.0, Stay(Descent, Descending)),
        (at_height(3.0, true, 0.96), 9.0, Stay(Descent, Descending)),
    ];
    table(DESCENT, rows);
}

/// A deck that rises to a drone without a view of the tags does not make it land, as long as it can climb.
#[test]
fn deck_that_rises_to_a_paused_drone() {
    let risen = |climb| {
        with_deck(|d| {
            (d.clearance_m, d.vision_age_s) = (0.7, 0.8);
            (d.radio_age_s, d.climb) = (9.0, climb);
        })
    };
    let rows = [
        (risen(ClimbRoom::Last), 0.0, Enter(Tracking, VisionLost)),
        (risen(ClimbRoom::Meets), 0.0, Enter(Flare, FlareHeight)),
    ];
    table(DESCENT, rows);
}

/// Over a deck at rest a drone that sinks at 2.5 m/s can climb from 1 m, but not from half a metre.
#[test]
fn last_height_for_a_climb() {
    let climb = |clearance_m: f64, sink_mps: f64| {
        let feet_m = DroneGeometry::default().feet_below_m;
        let own = OwnState {
            position: Vector3::new(0.0, 0.0, -1.3 - feet_m - clearance_m),
            velocity: Vector3::new(0.0, 0.0, sink_mps),
            yaw: 0.0,
        };
        let f = forecast(header(1, at(1.0)), |_| level([0.0, 0.0, -1.3]));
        let upright = UnitQuaternion::identity();
        let deck = Deck::of(&f, &own, &DroneGeometry::default(), &upright, &config(), at(1.0));
        deck.unwrap().climb
    };
    let rooms = [(2.0, 2.5), (1.0, 2.5), (0.5, 2.5), (0.5, 0.0)].map(|(m, mps)| climb(m, mps));
    assert_eq!(
        rooms,
        [
            ClimbRoom::Clear,
            ClimbRoom::Last,
            ClimbRoom::Meets,
            ClimbRoom::Clear
        ]
    );
}

#[test]
fn descent_pause_at_the_decision_clearance() {
    let s = with_deck(|d| (d.clearance_m, d.radio_age_s, d.vision_age_s) = (1.2, 9.0, 0.8));
    let d = run(DESCENT, &s, 2.0);
    waits(&d, Descent, VisionLost);
    assert!(matches!(d.phase, MissionPhase::Descent { paused: Some(_), .. }));
    goes(&run(DESCENT, &s, 9.0), Tracking, VisionLost);
}

#[test]
fn tilt_beyond_the_command_in_the_air() {
    for (phase, clearance) in [(DESCENT, 4.0), (DESCENT, 1.0), (COMMITTED, 0.5)] {
        let tilted = |excess_deg: f64, clearance: f64| Situation {
            tilt_excess_rad: excess_deg.to_radians(),
            ..with_deck(|d| d.clearance_m = clearance)
        };
        goes(&step(phase, &tilted(11.0, clearance)), Tracking, TiltExcess);
        // The deck tilts a drone that touches it.
        for s in [tilted(9.0, clearance), tilted(30.0, 0.1)] {
            assert_ne!(step(phase, &s).phase.state(), Tracking);
        }
    }
}

#[test]
fn soft_violations_below_the_commit_clearance() {
    let soft = |clearance: f64| {
        with_deck(|d| {
            (d.clearance_m, d.distance_m) = (clearance, 1.6);
            (d.vision_age_s, d.radio_age_s) = (6.0, 6.0);
        })
    };
    goes(&run(FREE_FLARE, &soft(0.85), 2.0), Tracking, VisionLost);
    let rows = [
        (soft(0.5), 2.0, Stay(Flare, VisionLost)),
        // The deck has fallen away again, so there is time to decide.
        (soft(1.5), 2.0, Enter(Tracking, VisionLost)),
    ];
    table(COMMITTED, rows);
}

#[test]
fn flare_without_vision() {
    for radio_age_s in [fair().deck.unwrap().radio_age_s, 9.0] {
        let blind = with_deck(|d| (d.clearance_m, d.vision_age_s, d.radio_age_s) = (0.85, 2.0, radio_age_s));
        waits(&run(FREE_FLARE, &blind, 1.0), Flare, Flaring);
    }
}

#[test]
fn relative_place_instead_of_lost_tags() {
    let lost = |clearance_m: f64, relative_age_s: f64| {
        with_deck(|d| {
            (d.clearance_m, d.vision_age_s, d.relative_age_s) = (clearance_m, 8.0, relative_age_s);
            d.radio_age_s = 9.0;
        })
    };
    let rows = [
        (lost(1.8, 0.2), 2.0, Stay(Descent, Descending)),
        (lost(0.85, 0.2), 0.0, Enter(Flare, FlareHeight)),
        // The relative position expires, or the tags never confirmed it.
        (lost(1.8, 2.0), 1.0, Enter(Tracking, VisionLost)),
        (lost(1.8, f64::INFINITY), 1.0, Enter(Tracking, VisionLost)),
    ];
    table(DESCENT, rows);
    waits(&run(FREE_FLARE, &lost(0.85, 0.2), 1.0), Flare, Flaring);
    // A descent begins only if the tags are detected.
    let undetected_s = config().descent_vision_s + 0.5;
    let above = with_deck(|d| (d.vision_age_s, d.relative_age_s) = (undetected_s, 0.2));
    waits(
        &step(MissionPhase::TrackingStable, &above),
        TrackingStable,
        VisionLost,
    );
}

#[test]
fn relative_place_that_stands_in_for_tags() {
    let own = OwnState::of(&drone(header(1, at(1.0)), [0.0, 0.0, -4.0]));
    let age_s = |relative: Option<RelativeState>| {
        let f = DeckForecast {
            vision_age_s: 3.0,
            relative,
            ..forecast(header(1, at(1.0)), |_| level([0.0, 0.0, -1.3]))
        };
        let level = UnitQuaternion::identity();
        let deck = Deck::of(&f, &own, &DroneGeometry::default(), &level, &config(), at(1.0));
        deck.unwrap().located_age_s()
    };
    let confirmed = RelativeState {
        solution: CarrierSolution::Fixed,
        used_age_s: 0.2,
        confirmed: true,
        ..RelativeState::default()
    };
    let unconfirmed = RelativeState {
        confirmed: false,
        ..confirmed
    };
    let contradicted = RelativeState {
        contradicted_m: Some(0.5),
        ..confirmed
    };
    assert_eq!(age_s(Some(confirmed)), 0.2);
    for relative in [None, Some(unconfirmed), Some(contradicted)] {
        assert_eq!(age_s(relative), 3.0);
    }
}

#[test]
fn committed_flare_with_a_missed_deck() {
    let off_deck = Situation {
        outside_m: 0.4,
        ..with_deck(|d| d.clearance_m = 0.3)
    };
    let missed = with_deck(|d| d.clearance_m = -0.5);
    goes(&run(COMMITTED, &missed, 1.0), Tracking, Missed);
    goes(&run(COMMITTED, &off_deck, 1.0), Tracking, Deviated);
}
