//! Every row of the state table.

use alight_shared::msg::ReasonCode::{
    AutopilotParameter, Commanded, CourseEnds, DeckGrantStale, DeckReserved, Deviated, ForecastStale,
    Infeasible, LikelyBeside, LikelyFast, LikelyHard, LikelySlides, LikelyTilted, Missed, NoPlan, NoVessel,
    NoVision, NotCommanded, NotFlying, NotSteady, OriginMoved, Reached, TiltExcess, TooFar, TooFast,
    TooSteep, Touchdown, TurnTooFast, VesselTooFar, VesselTurns, VisionLost,
};
use alight_shared::msg::{AutopilotMode, BatteryPlace, Course, DECK_CLOSED};
use nalgebra::{Vector2, Vector3};

use super::odds::Odds;
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
        rejection: None,
        moved: None,
        battery: Some(0.9),
        battery_reserve: config().battery_reserve,
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
            ring_m: 10.0,
            escapes: false,
            bearing_rad: 0.0,
            feet: Vector2::zeros(),
            closing_mps: 0.0,
            leaving_mps: 0.0,
            relative_speed_mps: 0.1,
            radio_age_s: 0.1,
            vision_age_s: 0.05,
            sinking_mps: 0.3,
            speed_mps: 0.5,
            heave_mps: 0.5,
            turn_radps: 0.0,
            turn_mps: 0.0,
            tilt_rad: 0.1,
            ends: None,
        }),
        mean_deck_z: Some(-1.3),
        tilt_excess_rad: 0.0,
        staying: Staying::default(),
        odds: Some(SURE),
        anyway: None,
        worth_waiting: 0.9,
        water_z: 0.0,
        forecast_age_s: 0.01,
        forecast_limit_s: 0.3,
        plan_age_s: 0.02,
        plan_limit_s: 0.5,
        outside_m: -0.6,
        reservation: Reservation::NotNeeded,
        course: Course::Unknown,
        place: None,
        motors_stopped: false,
        rotors_carry: true,
    }
}
const SURE: Odds = Odds {
    hard: 1.0,
    fast: 1.0,
    tilted: 1.0,
    beside: 1.0,
    slides: 1.0,
    turns: false,
};
/// Fair but for the odds of a landing.
pub(super) fn with_odds(change: impl FnOnce(&mut Odds)) -> Situation {
    with(|s| change(s.odds.as_mut().unwrap()))
}
pub(super) fn with(change: impl FnOnce(&mut Situation)) -> Situation {
    let mut s = fair();
    change(&mut s);
    s
}
pub(super) fn with_deck(change: impl FnOnce(&mut Deck)) -> Situation {
    with(|s| change(s.deck.as_mut().unwrap()))
}
/// Where a test begins: a phase with its usual progress (an attempt under way from the descent on), or what a
/// decision left.
#[derive(Clone, Copy)]
pub(super) struct Start(MissionPhase, Progress);

impl From<MissionPhase> for Start {
    fn from(phase: MissionPhase) -> Self {
        let landing = matches!(phase.state(), State::Descent | State::Flare | State::Landed);
        Start(phase, if landing { attempt() } else { wanted() })
    }
}
impl From<&Decision> for Start {
    fn from(d: &Decision) -> Self {
        Start(d.phase, d.progress)
    }
}
impl From<(MissionPhase, Progress)> for Start {
    fn from((phase, progress): (MissionPhase, Progress)) -> Self {
        Start(phase, progress)
    }
}

/// One step without a command.
pub(super) fn step(from: impl Into<Start>, s: &Situation) -> Decision {
    let Start(phase, progress) = from.into();
    decide(phase, progress, None, s, &config())
}
/// One step with a command.
pub(super) fn commanded(from: impl Into<Start>, command: CommandKind, s: &Situation) -> Decision {
    let Start(phase, progress) = from.into();
    decide(phase, progress, Some(command), s, &config())
}
/// Runs in the unchanging situation for `secs`; the last decision that changed the state, or the last one.
pub(super) fn run(from: impl Into<Start>, s: &Situation, secs: f64) -> Decision {
    let mut s = *s;
    let mut last = step(from, &s);
    for _ in 0..(secs / 0.01) as usize {
        if last.entered.is_some() {
            break;
        }
        s.now += Span::from_millis(10);
        last = step(&last, &s);
    }
    last
}
pub(super) const TRACKING: MissionPhase = MissionPhase::TRACKING;
pub(super) const DESCENT: MissionPhase = MissionPhase::DESCENT;
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
    let d = step((idle, Progress::default()), &fair());
    waits(&d, State::Idle, NotCommanded);
    for flight in [
        ControlState::Unknown,
        ControlState::Disarmed,
        ControlState::OnGround,
        ControlState::OtherControl(AutopilotMode::Other),
    ] {
        let s = with(|s| s.flight = flight);
        waits(&step(idle, &s), State::Idle, NotFlying);
    }
    let s = with(|s| s.rejection = Some(AutopilotParameter.into()));
    waits(&step(idle, &s), State::Idle, AutopilotParameter);
    let s = with(|s| (s.deck, s.forecast_age_s) = (None, f64::INFINITY));
    waits(&step(idle, &s), State::Idle, ForecastStale);
    let s = with_deck(|d| d.radio_age_s = f64::INFINITY);
    waits(&step(idle, &s), State::Idle, NoVessel);
    let s = with_deck(|d| d.distance_m = 5100.0);
    let d = step(idle, &s);
    waits(&d, State::Idle, VesselTooFar);
    assert_eq!(d.waiting.to_string(), "the vessel is 5.1 km away (limit 5)");
    let d = commanded((idle, Progress::default()), CommandKind::Land, &fair());
    goes(&d, State::GetAltitude, Commanded);
}

#[test]
fn vessel_beyond_5_km_in_the_approach() {
    let s = with_deck(|d| d.distance_m = 5100.0);
    let d = run(MissionPhase::APPROACH, &s, 1.0);
    goes(&d, State::Hold, VesselTooFar);
    waits(&run(&d, &s, 20.0), State::Hold, VesselTooFar);
}

#[test]
fn moved_origin_without_a_forecast_since() {
    let moved = with(|s| {
        (s.deck, s.forecast_age_s) = (None, f64::INFINITY);
        s.moved = Some(Reason::new(OriginMoved, 120.0, 0.0));
    });
    waits(&step(MissionPhase::Idle, &moved), State::Idle, OriginMoved);
    for phase in [MissionPhase::TRACKING, DESCENT, FREE_FLARE] {
        let d = step(phase, &moved);
        assert_eq!(d.entered.map(|why| why.code), Some(OriginMoved), "{phase:?}");
    }
}

#[test]
fn get_altitude_ends_at_the_approach_height() {
    let from = MissionPhase::GetAltitude { from: [1.0, 2.0] };
    let d = step(from, &fair());
    waits(&d, State::GetAltitude, TooFar);
    assert!((d.waiting.value - 8.0).abs() < 1e-9, "{d:?}");
    let mut s = fair();
    s.own.as_mut().unwrap().position.z = -1.3 - 15.0 + 0.5;
    goes(&step(from, &s), State::Approach, Reached);
}

#[test]
fn approach_ends_with_confirmed_detection() {
    let approach = MissionPhase::APPROACH;
    let unseen = with_deck(|d| d.vision_age_s = f64::INFINITY);
    waits(&run(approach, &unseen, 5.0), State::Approach, NoVision);
    // A single detection is not enough.
    waits(&step(approach, &fair()), State::Approach, NoVision);
    goes(&run(approach, &fair(), 1.0), State::Tracking, Reached);
    // Neither vision nor radio.
    let blind = with_deck(|d| (d.vision_age_s, d.radio_age_s) = (f64::INFINITY, 6.0));
    goes(&run(approach, &blind, 1.0), State::Hold, NoVessel);
}

#[test]
fn tracking_becomes_stable_after_half_a_second_of_steadiness() {
    for (s, why) in [
        (with_deck(|d| d.distance_m = 2.0), TooFar),
        (with_deck(|d| d.relative_speed_mps = 2.0), TooFast),
        (with(|s| s.mean_deck_z = Some(3.0)), TooFar),
    ] {
        waits(&run(TRACKING, &s, 2.0), State::Tracking, why);
    }
    waits(&run(TRACKING, &fair(), 0.3), State::Tracking, NotSteady);
    goes(&run(TRACKING, &fair(), 1.0), State::TrackingStable, Reached);
}

#[test]
fn tracking_continues_without_radio_and_returns_to_approach_without_vision() {
    let silent = with_deck(|d| d.radio_age_s = f64::INFINITY);
    goes(&run(TRACKING, &silent, 1.0), State::TrackingStable, Reached);
    let unseen = with_deck(|d| d.vision_age_s = 5.5);
    goes(&run(TRACKING, &unseen, 1.0), State::Approach, VisionLost);
    let nothing = with_deck(|d| (d.vision_age_s, d.radio_age_s) = (5.5, 5.5));
    goes(&run(TRACKING, &nothing, 1.0), State::Hold, VisionLost);
}

#[test]
fn tracking_stable_reports_each_reason_not_to_descend() {
    let stable = MissionPhase::TrackingStable;
    for (s, why) in [
        (with_deck(|d| d.vision_age_s = 1.5), VisionLost),
        (with_odds(|p| p.hard = 0.94), LikelyHard),
        (with_odds(|p| p.fast = 0.9), LikelyFast),
        (with_odds(|p| (p.fast, p.turns) = (0.9, true)), TurnTooFast),
        (with_odds(|p| p.tilted = 0.5), LikelyTilted),
        (with_odds(|p| p.beside = 0.5), LikelyBeside),
        (with_odds(|p| p.slides = 0.8), LikelySlides),
        // Each likely enough by itself.
        (
            with_odds(|p| (p.hard, p.fast, p.slides) = (0.98, 0.98, 0.97)),
            LikelySlides,
        ),
        (with_odds(|p| p.beside = f64::NAN), LikelyBeside),
        (with(|s| s.worth_waiting = 0.9995), LikelyHard),
        (with_deck(|d| d.speed_mps = 8.0), Infeasible),
        (with_deck(|d| d.heave_mps = 4.0), Infeasible),
        (with_deck(|d| d.tilt_rad = 0.5), TooSteep),
        (with_deck(|d| d.turn_radps = 0.3), Infeasible),
        (with(|s| s.course = Course::Turning), VesselTurns),
        (with(|s| s.course = Course::Steady(15.0)), CourseEnds),
        (with(|s| s.plan_age_s = f64::INFINITY), NoPlan),
        (
            with(|s| s.rejection = Some(AutopilotParameter.into())),
            AutopilotParameter,
        ),
        (with(|s| s.reservation = Reservation::Others(2)), DeckReserved),
        (
            with(|s| s.reservation = Reservation::Unknown(2.5)),
            DeckGrantStale,
        ),
    ] {
        let d = step(stable, &s);
        waits(&d, State::TrackingStable, why);
        assert!(!d.waiting.to_string().is_empty());
    }
    let d = step(stable, &fair());
    goes(&d, State::Descent, Reached);
    assert_eq!(d.progress.attempts, 1);
    let d = step(stable, &with(|s| s.course = Course::Steady(20.0)));
    goes(&d, State::Descent, Reached);
    let s = with_deck(|d| d.distance_m = 2.5);
    goes(&step(stable, &s), State::Tracking, TooFar);
}

#[test]
fn descent_becomes_flare_below_its_clearance() {
    waits(&step(DESCENT, &fair()), State::Descent, TooFar);
    let low = with_deck(|d| d.clearance_m = 0.85);
    goes(&step(DESCENT, &low), State::Flare, Reached);
}

#[test]
fn descent_returns_to_tracking_when_a_condition_stays_violated() {
    for (s, why) in [
        (with_deck(|d| d.vision_age_s = 1.2), VisionLost),
        (with_deck(|d| d.distance_m = 4.0), Deviated),
        (with_odds(|p| p.tilted = 0.85), LikelyTilted),
        (with_deck(|d| d.tilt_rad = 0.8), TooSteep),
        (with(|s| s.plan_age_s = 0.6), NoPlan),
    ] {
        waits(&run(DESCENT, &s, 0.2), State::Descent, why);
        goes(&run(DESCENT, &s, 1.0), State::Tracking, why);
    }
}

#[test]
fn descent_pauses_at_the_decision_clearance_until_the_flare_is_possible() {
    let s = with_deck(|d| (d.clearance_m, d.radio_age_s, d.vision_age_s) = (1.2, 9.0, 0.8));
    let d = run(DESCENT, &s, 2.0);
    waits(&d, State::Descent, VisionLost);
    assert!(matches!(d.phase, MissionPhase::Descent { paused: Some(_), .. }));
    goes(&run(DESCENT, &s, 9.0), State::Tracking, VisionLost);
}

#[test]
fn descent_and_flare_break_off_at_once_when_the_drone_tilts_beyond_the_command_in_the_air() {
    let flare = MissionPhase::Flare {
        committed: true,
        violated: None,
    };
    for (phase, clearance) in [
        (MissionPhase::DESCENT, 4.0),
        (MissionPhase::DESCENT, 1.0),
        (flare, 0.5),
    ] {
        let tilted = |excess_deg: f64, clearance: f64| {
            with(|s| {
                s.tilt_excess_rad = excess_deg.to_radians();
                s.deck.as_mut().unwrap().clearance_m = clearance;
            })
        };
        goes(
            &step(phase, &tilted(11.0, clearance)),
            State::Tracking,
            TiltExcess,
        );
        assert_ne!(
            step(phase, &tilted(9.0, clearance)).phase.state(),
            State::Tracking
        );
        // The deck tilts what touches it.
        assert_ne!(step(phase, &tilted(30.0, 0.1)).phase.state(), State::Tracking);
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
        })
    };
    waits(&run(COMMITTED, &soft(0.5), 2.0), State::Flare, VisionLost);
    goes(&run(FREE_FLARE, &soft(0.85), 2.0), State::Tracking, VisionLost);
    // The deck fell away again: there is time to judge.
    goes(&run(COMMITTED, &soft(1.5), 2.0), State::Tracking, VisionLost);
    // The deck rose to the descending drone: going on is the safer way.
    let near = with_deck(|d| (d.clearance_m, d.distance_m) = (0.6, 0.7));
    goes(&step(DESCENT, &near), State::Flare, Reached);
}

#[test]
fn flare_continues_through_its_end_without_vision() {
    let blind = with_deck(|d| (d.clearance_m, d.vision_age_s) = (0.85, 2.0));
    waits(&run(FREE_FLARE, &blind, 1.0), State::Flare, TooFar);
    let silent = with_deck(|d| (d.clearance_m, d.vision_age_s, d.radio_age_s) = (0.85, 2.0, 9.0));
    waits(&run(FREE_FLARE, &silent, 1.0), State::Flare, TooFar);
}

#[test]
fn flare_breaks_off_even_committed_when_the_deck_is_missed_or_lost() {
    let missed = with_deck(|d| d.clearance_m = -0.5);
    goes(&run(COMMITTED, &missed, 1.0), State::Tracking, Missed);
    let beside = Situation {
        outside_m: 0.4,
        ..with_deck(|d| d.clearance_m = 0.3)
    };
    goes(&run(COMMITTED, &beside, 1.0), State::Tracking, Deviated);
}

#[test]
fn mission_lands_when_the_pilot_stops_the_motors() {
    let s = Situation {
        motors_stopped: true,
        ..with_deck(|d| d.clearance_m = 0.0)
    };
    goes(&step(COMMITTED, &s), State::Landed, Touchdown);
    let d = step(MissionPhase::Idle, &s);
    assert_ne!(d.phase.state(), State::Landed);
}

#[test]
fn landed_is_left_only_after_disarming_and_arming() {
    let landed = MissionPhase::LANDED;
    let on_deck = with_deck(|d| d.clearance_m = 0.05);
    let d = commanded(landed, CommandKind::Land, &on_deck);
    assert_eq!(d.phase, landed);
    let off = with(|s| (s.flight, s.rotors_carry) = (ControlState::Disarmed, false));
    let d = step((landed, d.progress), &off);
    assert_eq!(
        d.phase,
        MissionPhase::Landed {
            disarmed: true,
            airborne: None,
        }
    );
    let d = step(&d, &fair());
    goes(&d, State::Idle, Reached);
    assert!(!d.progress.landing);
}

#[test]
fn closed_deck_is_closed_to_a_drone_that_reserves_nothing() {
    let grant = |owner, at_s| DeckGrant {
        header: Header::new(1, 0, 1, 1, at(at_s)),
        owner,
        ..DeckGrant::default()
    };
    let c = config();
    assert!(!c.reservation_required);
    let of = |owner, at_s| Reservation::of(Some(&grant(owner, at_s)), 1, at(10.0), &c);
    assert_eq!(of(2, 9.5), Reservation::NotNeeded);
    assert_eq!(of(DECK_CLOSED, 5.0), Reservation::NotNeeded, "stale");
    let closed = of(DECK_CLOSED, 9.5);
    assert!(closed.rejection().is_some() && closed.lost().is_some());
    let why = closed.rejection().unwrap_or_default().to_string();
    assert!(why.contains("the deck is closed"), "{why}");
}

#[test]
fn turn_in_a_landing_breaks_it_off_only_above_the_commit_clearance() {
    let flare = |committed| MissionPhase::Flare {
        committed,
        violated: Some(at(9.0)),
    };
    let descent = MissionPhase::Descent {
        violated: Some(at(9.0)),
        paused: None,
    };
    let stated = |clearance_m: f64| {
        let mut s = with(|s| s.course = Course::Turning);
        s.deck.as_mut().unwrap().clearance_m = clearance_m;
        s
    };
    let turns = |clearance_m: f64| {
        let mut s = with_odds(|p| (p.fast, p.turns) = (0.8, true));
        s.deck.as_mut().unwrap().clearance_m = clearance_m;
        s
    };
    goes(&step(descent, &stated(3.0)), State::Tracking, VesselTurns);
    goes(&step(flare(false), &stated(0.9)), State::Tracking, VesselTurns);
    waits(&step(flare(true), &stated(0.5)), State::Flare, TooFar);
    goes(&step(descent, &turns(3.0)), State::Tracking, TurnTooFast);
    waits(&step(flare(true), &turns(0.5)), State::Flare, TurnTooFast);
    // An empty battery leaves no other place than the deck, turning or not.
    let urgent = Progress {
        low_battery: Some(BatteryPlace::Deck),
        ..attempt()
    };
    let d = step((descent, urgent), &stated(3.0));
    waits(&d, State::Descent, TooFar);
}

#[test]
fn promise_outlives_silence_until_its_end_and_a_stated_turn_does_not() {
    let of = |course, age_s: f64| {
        let grant = DeckGrant {
            header: Header::new(1, 0, 1, 1, at(0.0)),
            course,
            ..DeckGrant::default()
        };
        stated_course(Some(&grant), at(age_s))
    };
    assert_eq!(of(Course::Steady(60.0), 20.0), Course::Steady(40.0));
    assert_eq!(of(Course::Steady(60.0), 60.0), Course::Unknown);
    assert_eq!(of(Course::Turning, 1.0), Course::Turning);
    assert_eq!(of(Course::Turning, 3.0), Course::Unknown);
    assert_eq!(stated_course(None, at(1.0)), Course::Unknown);
}
