//! Every row of the state table.

use alight_shared::msg::AutopilotMode;
use nalgebra::{Vector2, Vector3};

use super::*;

pub(super) type DroneTime = Time<DroneClock>;

pub(super) fn at(s: f64) -> DroneTime {
    Time::from_secs(s)
}
pub(super) fn config() -> MissionConfig {
    MissionConfig::default()
}
pub(super) fn wanted() -> Progress {
    Progress {
        landing: true,
        started: at(0.0),
        ..Progress::default()
    }
}

/// A drone 7 m above the middle of a calm deck that it sees, everything fresh.
pub(super) fn fair() -> Situation {
    Situation {
        now: at(10.0),
        flight: ControlState::Ours,
        battery: Some(0.9),
        own: Some(OwnState {
            position: Vector3::new(0.0, 0.0, -8.3),
            velocity: Vector3::zeros(),
            yaw: 0.0,
        }),
        odometry_age_s: 0.01,
        odometry_limit_s: 0.2,
        deck: Some(Deck {
            clearance_m: 6.7,
            distance_m: 0.1,
            bearing_rad: 0.0,
            feet: Vector2::zeros(),
            relative_speed_mps: 0.1,
            radio_age_s: 0.1,
            vision_age_s: 0.05,
            horizontal_sd_m: 0.1,
            vertical_sd_m: 0.05,
            speed_mps: 0.5,
            heave_mps: 0.5,
            turn_radps: 0.0,
            acceleration_mps2: 1.0,
            tilt_rad: 0.1,
            friction_used_mps2: 1.0,
            mean_z: -1.3,
            predicted_slope: None,
            wave_following_deficit: 0.0,
        }),
        mean_deck_z: Some(-1.3),
        wind_peak_mps2: 0.0,
        wind_mps2: 0.0,
        friction_used_mps2: 0.0,
        recent_tilt_rad: 0.0,
        apparent_slope: ApparentSlopeHistory::default(),
        water_z: 0.0,
        forecast_age_s: 0.01,
        forecast_limit_s: 0.3,
        plan_age_s: 0.02,
        plan_limit_s: 0.5,
        outside_m: -0.6,
        reservation: Reservation::NotNeeded,
        motors_stopped: false,
    }
}
pub(super) fn with_deck(change: impl FnOnce(&mut Deck)) -> Situation {
    let mut s = fair();
    change(s.deck.as_mut().unwrap());
    s
}
/// Runs `phase` in the unchanging situation for `secs`; the last decision that changed the state,
/// or the last one.
pub(super) fn run(phase: MissionPhase, progress: Progress, s: &Situation, secs: f64) -> Decision {
    let mut s = *s;
    let (mut phase, mut progress) = (phase, progress);
    let mut last = decide(phase, progress, None, &s, &config());
    for _ in 0..(secs / 0.01) as usize {
        if last.entered.is_some() {
            break;
        }
        (phase, progress) = (last.phase, last.progress);
        s.now += Span::from_millis(10);
        last = decide(phase, progress, None, &s, &config());
    }
    last
}
pub(super) const TRACKING: MissionPhase = MissionPhase::Tracking { steady: None };
pub(super) const DESCENT: MissionPhase = MissionPhase::Descent {
    violated: None,
    paused: None,
};
pub(super) const FREE_FLARE: MissionPhase = MissionPhase::Flare {
    committed: false,
    violated: None,
};
pub(super) const COMMITTED: MissionPhase = MissionPhase::Flare {
    committed: true,
    violated: None,
};
pub(super) fn attempt() -> Progress {
    Progress {
        attempts: 1,
        ..wanted()
    }
}

#[track_caller]
pub(super) fn goes(d: &Decision, to: State, why: ReasonCode) {
    assert_eq!(d.phase.state(), to, "{d:?}");
    assert_eq!(d.entered.map(|r| r.code), Some(why), "{d:?}");
}
#[track_caller]
pub(super) fn waits(d: &Decision, in_state: State, why: ReasonCode) {
    assert_eq!(d.phase.state(), in_state, "{d:?}");
    assert_eq!(d.entered, None, "{d:?}");
    assert_eq!(d.waiting.code, why, "{d:?}");
}

#[test]
fn idle_waits_for_command_flight_and_vessel() {
    let idle = MissionPhase::Idle;
    let d = decide(idle, Progress::default(), None, &fair(), &config());
    waits(&d, State::Idle, ReasonCode::NotCommanded);
    for flight in [
        ControlState::Unknown,
        ControlState::Disarmed,
        ControlState::OnGround,
        ControlState::OtherControl(AutopilotMode::Other),
    ] {
        let s = Situation { flight, ..fair() };
        waits(
            &decide(idle, wanted(), None, &s, &config()),
            State::Idle,
            ReasonCode::NotFlying,
        );
    }
    let s = Situation {
        deck: None,
        forecast_age_s: f64::INFINITY,
        ..fair()
    };
    waits(
        &decide(idle, wanted(), None, &s, &config()),
        State::Idle,
        ReasonCode::ForecastStale,
    );
    let s = with_deck(|d| d.radio_age_s = f64::INFINITY);
    waits(
        &decide(idle, wanted(), None, &s, &config()),
        State::Idle,
        ReasonCode::NoVessel,
    );
    let d = decide(
        idle,
        Progress::default(),
        Some(CommandKind::Land),
        &fair(),
        &config(),
    );
    goes(&d, State::GetAltitude, ReasonCode::Commanded);
}

#[test]
fn get_altitude_ends_at_the_approach_height() {
    let from = MissionPhase::GetAltitude { from: [1.0, 2.0] };
    let d = decide(from, wanted(), None, &fair(), &config());
    waits(&d, State::GetAltitude, ReasonCode::TooFar);
    assert!((d.waiting.value - 8.0).abs() < 1e-9, "{d:?}");
    let mut s = fair();
    s.own.as_mut().unwrap().position.z = -1.3 - 15.0 + 0.5;
    goes(
        &decide(from, wanted(), None, &s, &config()),
        State::Approach,
        ReasonCode::Reached,
    );
}

#[test]
fn approach_ends_with_confirmed_detection() {
    let approach = MissionPhase::Approach { detected: None };
    let unseen = with_deck(|d| d.vision_age_s = f64::INFINITY);
    waits(
        &run(approach, wanted(), &unseen, 5.0),
        State::Approach,
        ReasonCode::NoVision,
    );
    // A single sighting is not enough.
    waits(
        &decide(approach, wanted(), None, &fair(), &config()),
        State::Approach,
        ReasonCode::NoVision,
    );
    goes(
        &run(approach, wanted(), &fair(), 1.0),
        State::Tracking,
        ReasonCode::Reached,
    );
    // Neither sight nor radio.
    let blind = with_deck(|d| (d.vision_age_s, d.radio_age_s) = (f64::INFINITY, 6.0));
    goes(
        &run(approach, wanted(), &blind, 1.0),
        State::Hold,
        ReasonCode::NoVessel,
    );
}

#[test]
fn tracking_becomes_stable_after_half_a_second_of_steadiness() {
    for (s, why) in [
        (with_deck(|d| d.distance_m = 2.0), ReasonCode::TooFar),
        (with_deck(|d| d.relative_speed_mps = 2.0), ReasonCode::TooFast),
        (
            Situation {
                mean_deck_z: Some(3.0),
                ..fair()
            },
            ReasonCode::TooFar,
        ),
    ] {
        waits(&run(TRACKING, wanted(), &s, 2.0), State::Tracking, why);
    }
    waits(
        &run(TRACKING, wanted(), &fair(), 0.3),
        State::Tracking,
        ReasonCode::NotSteady,
    );
    goes(
        &run(TRACKING, wanted(), &fair(), 1.0),
        State::TrackingStable,
        ReasonCode::Reached,
    );
}

#[test]
fn tracking_continues_without_radio_and_returns_to_approach_without_vision() {
    let silent = with_deck(|d| d.radio_age_s = f64::INFINITY);
    goes(
        &run(TRACKING, wanted(), &silent, 1.0),
        State::TrackingStable,
        ReasonCode::Reached,
    );
    let unseen = with_deck(|d| d.vision_age_s = 5.5);
    goes(
        &run(TRACKING, wanted(), &unseen, 1.0),
        State::Approach,
        ReasonCode::VisionLost,
    );
    let nothing = with_deck(|d| (d.vision_age_s, d.radio_age_s) = (5.5, 5.5));
    goes(
        &run(TRACKING, wanted(), &nothing, 1.0),
        State::Hold,
        ReasonCode::VisionLost,
    );
}

#[test]
fn tracking_stable_reports_each_reason_not_to_descend() {
    let stable = MissionPhase::TrackingStable;
    let c = config();
    for (s, why) in [
        (with_deck(|d| d.vision_age_s = 1.5), ReasonCode::VisionLost),
        (with_deck(|d| d.distance_m = 1.2), ReasonCode::TooFar),
        (with_deck(|d| d.relative_speed_mps = 1.1), ReasonCode::TooFast),
        (with_deck(|d| d.horizontal_sd_m = 0.7), ReasonCode::Uncertain),
        (with_deck(|d| d.vertical_sd_m = 0.5), ReasonCode::Uncertain),
        (with_deck(|d| d.vertical_sd_m = f64::NAN), ReasonCode::Uncertain),
        (with_deck(|d| d.speed_mps = 8.0), ReasonCode::Infeasible),
        (with_deck(|d| d.heave_mps = 4.0), ReasonCode::Infeasible),
        (with_deck(|d| d.acceleration_mps2 = 7.0), ReasonCode::Infeasible),
        (with_deck(|d| d.tilt_rad = 0.5), ReasonCode::TooSteep),
        (with_deck(|d| d.turn_radps = 0.3), ReasonCode::Infeasible),
        (
            Situation {
                plan_age_s: f64::INFINITY,
                ..fair()
            },
            ReasonCode::NoPlan,
        ),
        (
            Situation {
                recent_tilt_rad: 0.41,
                ..fair()
            },
            ReasonCode::TooSteep,
        ),
        // Waves to come will tilt the deck before the drone is at rest, or have shed what stood there a
        // moment ago as nothing had foretold.
        (
            with_deck(|d| d.predicted_slope = Some(0.3)),
            ReasonCode::SlidePredicted,
        ),
        (
            Situation {
                apparent_slope: ApparentSlopeHistory::of(&[10, 60], 0.45),
                ..with_deck(|d| d.predicted_slope = Some(0.1))
            },
            ReasonCode::SlideObserved,
        ),
        // Where crests are reckoned with, their slope is known better.
        (
            with_deck(|d| (d.predicted_slope, d.wave_following_deficit) = (Some(0.36), 1.0)),
            ReasonCode::SlidePredicted,
        ),
        // Nothing is foretold, and the deck shed what stood there a moment ago.
        (
            Situation {
                apparent_slope: ApparentSlopeHistory::of(&[10, 60], 0.45),
                ..fair()
            },
            ReasonCode::SlideObserved,
        ),
        (
            Situation {
                wind_peak_mps2: 3.6,
                ..fair()
            },
            ReasonCode::TooWindy,
        ),
        (
            Situation {
                reservation: Reservation::Others(2),
                ..fair()
            },
            ReasonCode::DeckReserved,
        ),
        (
            Situation {
                reservation: Reservation::Unknown(2.5),
                ..fair()
            },
            ReasonCode::DeckGrantStale,
        ),
        (
            // Half as much wind, on a deck whose motion takes most of the feet's grip.
            Situation {
                wind_peak_mps2: 1.8,
                friction_used_mps2: 3.4,
                ..fair()
            },
            ReasonCode::TooWindy,
        ),
    ] {
        let d = decide(stable, wanted(), None, &s, &c);
        waits(&d, State::TrackingStable, why);
        assert!(!d.waiting.to_string().is_empty());
    }
    let d = decide(stable, wanted(), None, &fair(), &c);
    goes(&d, State::Descent, ReasonCode::Reached);
    assert_eq!(d.progress.attempts, 1);
    let s = with_deck(|d| d.distance_m = 2.5);
    goes(
        &decide(stable, wanted(), None, &s, &c),
        State::Tracking,
        ReasonCode::TooFar,
    );
}

#[test]
fn descent_becomes_flare_below_its_clearance() {
    waits(
        &decide(DESCENT, attempt(), None, &fair(), &config()),
        State::Descent,
        ReasonCode::TooFar,
    );
    let low = with_deck(|d| d.clearance_m = 0.85);
    goes(
        &decide(DESCENT, attempt(), None, &low, &config()),
        State::Flare,
        ReasonCode::Reached,
    );
}

#[test]
fn descent_returns_to_tracking_when_a_condition_stays_violated() {
    for (s, why) in [
        (with_deck(|d| d.vision_age_s = 1.2), ReasonCode::VisionLost),
        (with_deck(|d| d.distance_m = 4.0), ReasonCode::Deviated),
        (with_deck(|d| d.horizontal_sd_m = 1.0), ReasonCode::Uncertain),
        (with_deck(|d| d.acceleration_mps2 = 10.0), ReasonCode::Infeasible),
        (with_deck(|d| d.tilt_rad = 0.8), ReasonCode::TooSteep),
        (
            Situation {
                plan_age_s: 0.6,
                ..fair()
            },
            ReasonCode::NoPlan,
        ),
    ] {
        waits(&run(DESCENT, attempt(), &s, 0.2), State::Descent, why);
        goes(&run(DESCENT, attempt(), &s, 1.0), State::Tracking, why);
    }
}

#[test]
fn descent_pauses_at_the_decision_clearance_until_the_flare_is_possible() {
    for (s, why) in [
        (
            with_deck(|d| (d.clearance_m, d.distance_m) = (1.2, 0.8)),
            ReasonCode::TooFar,
        ),
        (
            with_deck(|d| (d.clearance_m, d.tilt_rad) = (1.2, 0.42)),
            ReasonCode::TooSteep,
        ),
        (
            with_deck(|d| (d.clearance_m, d.radio_age_s, d.vision_age_s) = (1.2, 9.0, 0.8)),
            ReasonCode::VisionLost,
        ),
    ] {
        let d = run(DESCENT, attempt(), &s, 2.0);
        waits(&d, State::Descent, why);
        assert!(matches!(d.phase, MissionPhase::Descent { paused: Some(_), .. }));
        goes(&run(DESCENT, attempt(), &s, 9.0), State::Tracking, why);
    }
}

#[test]
fn descent_ignores_soft_violations_below_the_commit_clearance() {
    let soft = |clearance: f64| {
        with_deck(|d| {
            d.clearance_m = clearance;
            d.distance_m = 1.6;
            d.vision_age_s = 6.0;
            d.radio_age_s = 6.0;
            d.horizontal_sd_m = 2.0;
        })
    };
    waits(
        &run(COMMITTED, attempt(), &soft(0.5), 2.0),
        State::Flare,
        ReasonCode::VisionLost,
    );
    goes(
        &run(FREE_FLARE, attempt(), &soft(0.85), 2.0),
        State::Tracking,
        ReasonCode::VisionLost,
    );
    // The deck fell away again: there is time to judge.
    goes(
        &run(COMMITTED, attempt(), &soft(1.5), 2.0),
        State::Tracking,
        ReasonCode::VisionLost,
    );
    // The deck rose to the descending drone: going on is the safer way.
    let near = with_deck(|d| (d.clearance_m, d.distance_m) = (0.6, 0.7));
    goes(
        &decide(DESCENT, attempt(), None, &near, &config()),
        State::Flare,
        ReasonCode::Reached,
    );
}

#[test]
fn flare_continues_through_its_end_without_vision() {
    let blind = with_deck(|d| (d.clearance_m, d.vision_age_s) = (0.85, 2.0));
    waits(
        &run(FREE_FLARE, attempt(), &blind, 1.0),
        State::Flare,
        ReasonCode::TooFar,
    );
    let silent = with_deck(|d| (d.clearance_m, d.vision_age_s, d.radio_age_s) = (0.85, 2.0, 9.0));
    waits(
        &run(FREE_FLARE, attempt(), &silent, 1.0),
        State::Flare,
        ReasonCode::TooFar,
    );
}

#[test]
fn flare_breaks_off_even_committed_when_the_deck_is_missed_or_lost() {
    let missed = with_deck(|d| d.clearance_m = -0.5);
    goes(
        &run(COMMITTED, attempt(), &missed, 1.0),
        State::Tracking,
        ReasonCode::Missed,
    );
    let beside = Situation {
        outside_m: 0.4,
        ..with_deck(|d| d.clearance_m = 0.3)
    };
    goes(
        &run(COMMITTED, attempt(), &beside, 1.0),
        State::Tracking,
        ReasonCode::Deviated,
    );
}

#[test]
fn mission_lands_when_the_pilot_stops_the_motors() {
    let s = Situation {
        motors_stopped: true,
        ..with_deck(|d| d.clearance_m = 0.0)
    };
    goes(
        &decide(COMMITTED, attempt(), None, &s, &config()),
        State::Landed,
        ReasonCode::Touchdown,
    );
    let d = decide(MissionPhase::Idle, wanted(), None, &s, &config());
    assert_ne!(d.phase.state(), State::Landed);
}

#[test]
fn landed_is_left_only_after_disarming_and_arming() {
    let landed = MissionPhase::Landed { disarmed: false };
    let d = decide(landed, attempt(), Some(CommandKind::Land), &fair(), &config());
    assert_eq!(d.phase, landed);
    let off = Situation {
        flight: ControlState::Disarmed,
        ..fair()
    };
    let d = decide(landed, d.progress, None, &off, &config());
    assert_eq!(d.phase, MissionPhase::Landed { disarmed: true });
    let d = decide(d.phase, d.progress, None, &fair(), &config());
    goes(&d, State::Idle, ReasonCode::Reached);
    assert!(!d.progress.landing);
}
