//! State table by situation and reason, except descent and flare.

use alight_shared::msg::{
    AutopilotMode, BatteryPlace, CameraLight, CommandKind, Course, DECK_CLOSED, PLACES,
    ReasonCode::{
        ArmedAgain, AtBeacon, AutopilotParameter, BeaconVague, Commanded, CourseEnds, DeckDiffers,
        DeckGrantStale, DeckReserved, Descending, Flaring, ForecastStale, Glare, HarmLikely, HeightReached,
        InSight, Infeasible, KnownByBeacon, LikelyFast, LikelyHard, LikelyOutside, LikelySlides,
        LikelyTilted, NoPlan, NoVessel, NoVision, NotCommanded, NotFlying, NotIdentified, NotSteady,
        OffHeight, OriginMoved, Permitted, Recovered, Searching, SeveralDecks, Steady, Swings, TagsInSight,
        TooDark, TooFar, TooFast, TooSteep, TurnTooFast, VesselTooFar, VesselTurns, VisionLost,
    },
};
use nalgebra::{Vector2, Vector3};

use Does::{Enter, Stay};
use State::{Approach, Descent, Flare, GetAltitude, Hold, Idle, Landed, Search, Tracking, TrackingStable};

use super::{
    phase::DroneTime,
    reservation::{Reservation, stated_course},
    situation::{Charges, ClimbRoom, Deck, OwnState, SortieEvidence, TakeOffEvidence},
    *,
};
use alight_shared::landing::Odds;

pub(super) fn at(s: f64) -> DroneTime {
    Time::from_secs(s)
}
pub(super) fn config() -> MissionConfig {
    MissionConfig::default()
}
pub(super) fn wanted() -> MissionProgress {
    MissionProgress {
        landing: true,
        started: at(0.0),
        ..MissionProgress::default()
    }
}

/// Calm, detected deck, 6.7 m below the feet.
fn fair_deck() -> Deck {
    Deck {
        clearance_m: 6.7,
        distance_m: 0.1,
        ring_m: 10.0,
        escapes: false,
        bearing_rad: 0.0,
        heading_rad: 0.0,
        feet: Vector2::zeros(),
        slide: Vector2::zeros(),
        closing_mps: 0.0,
        leaving_mps: 0.0,
        relative_speed_mps: 0.1,
        radio_age_s: 0.1,
        identified: true,
        vision_age_s: 0.05,
        relative_age_s: f64::INFINITY,
        sinking_mps: 0.3,
        heave_mps: 0.5,
        turn_radps: 0.0,
        turn_mps: 0.0,
        tilt_rad: 0.1,
        beacon: None,
        contradicted: None,
        ends: None,
        climb: ClimbRoom::Clear,
    }
}

/// Drone with fresh data, 7 m above the centre of a calm deck that it detects.
pub(super) fn fair() -> Situation {
    Situation {
        now: at(10.0),
        flight: ControlState::Ours,
        rejection: None,
        moved: None,
        several: None,
        battery: Some(0.9),
        battery_reserve: config().battery_reserve,
        charges: Charges {
            home: 0.06,
            home_is_sea: false,
            here: 0.03,
            deck: 0.04,
            attempt: 0.05,
            known: true,
        },
        own: Some(OwnState {
            position: Vector3::new(0.0, 0.0, -8.3),
            velocity: Vector3::zeros(),
            yaw: 0.0,
        }),
        odometry_age_s: 0.01,
        odometry_limit_s: 0.2,
        deck: Some(fair_deck()),
        mean_deck_z: Some(-1.3),
        lowest_z: None,
        doubt: None,
        tilt_excess_rad: 0.0,
        swing_rad: 0.0,
        staying: Staying::default(),
        odds: Some(SURE),
        forced_descent: None,
        worth_waiting: 0.9,
        water_z: 0.0,
        forecast_age_s: 0.01,
        forecast_limit_s: 0.3,
        plan_age_s: 0.02,
        plan_limit_s: 0.5,
        outside_m: -0.6,
        rests_outside_m: -0.6,
        reservation: Reservation::NotNeeded,
        other_deck: None,
        course: Course::Unknown,
        place: None,
        others: [0; PLACES],
        other_stations_m: [0; PLACES],
        motors_stopped: false,
        rotors_carry: Some(true),
        hard_contact_mps: None,
        deck_wanted: false,
        not_cleared: None,
        on_ground: false,
        battery_for_take_off: 0.3,
        sortie: SortieEvidence::default(),
        leaving: TakeOffEvidence {
            rise_measured: true,
            rotors_turn_s: 10.0,
            ..TakeOffEvidence::default()
        },
        dark: None,
    }
}
const SURE: Odds = Odds {
    hard: 1.0,
    fast: 1.0,
    tilted: 1.0,
    outside: 1.0,
    slides: 1.0,
    turns: false,
    gusts: false,
};
fn rejected() -> Situation {
    with(|s| s.rejection = Some(AutopilotParameter.into()))
}
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
/// Phase with its usual progress (an attempt in progress from the descent on), or the result of a decision.
#[derive(Clone, Copy)]
pub(super) struct StepStart(MissionPhase, MissionProgress);

impl From<MissionPhase> for StepStart {
    fn from(phase: MissionPhase) -> Self {
        let landing = matches!(phase.state(), State::Descent | State::Flare | State::Landed);
        StepStart(phase, if landing { attempt() } else { wanted() })
    }
}
impl From<&Decision> for StepStart {
    fn from(d: &Decision) -> Self {
        StepStart(d.phase, d.progress)
    }
}
impl From<(MissionPhase, MissionProgress)> for StepStart {
    fn from((phase, progress): (MissionPhase, MissionProgress)) -> Self {
        StepStart(phase, progress)
    }
}

pub(super) fn step(from: impl Into<StepStart>, s: &Situation) -> Decision {
    let StepStart(phase, progress) = from.into();
    decide(phase, progress, None, s, &config())
}
pub(super) fn commanded(from: impl Into<StepStart>, command: CommandKind, s: &Situation) -> Decision {
    let StepStart(phase, progress) = from.into();
    decide(phase, progress, Some(command), s, &config())
}
/// Decision that changed the state within `secs` of a constant situation, or the last decision.
pub(super) fn run(from: impl Into<StepStart>, s: &Situation, secs: f64) -> Decision {
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
pub(super) fn attempt() -> MissionProgress {
    MissionProgress {
        attempts: 1,
        ..wanted()
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Does {
    Enter(State, ReasonCode),
    Stay(State, ReasonCode),
}

impl Does {
    fn of(d: &Decision) -> Does {
        let why = d.entered.unwrap_or(d.waiting);
        assert!(!why.to_string().is_empty(), "{d:?}");
        match d.entered {
            Some(_) => Does::Enter(d.phase.state(), why.code),
            None => Does::Stay(d.phase.state(), why.code),
        }
    }
}
#[track_caller]
pub(super) fn goes(d: &Decision, to: State, why: ReasonCode) {
    assert_eq!(Does::of(d), Does::Enter(to, why), "{d:?}");
}
#[track_caller]
pub(super) fn waits(d: &Decision, in_state: State, why: ReasonCode) {
    assert_eq!(Does::of(d), Does::Stay(in_state, why), "{d:?}");
}
/// Rows of: constant situation, duration (s), and the decision that changed the state, or the last decision.
#[track_caller]
pub(super) fn table<const N: usize>(start: impl Into<StepStart>, rows: [(Situation, f64, Does); N]) {
    let start = start.into();
    for (k, (s, secs, does)) in rows.into_iter().enumerate() {
        let d = run(start, &s, secs);
        assert_eq!(Does::of(&d), does, "row {k}: {d:?}");
    }
}

#[test]
fn idle_conditions() {
    let flown = |flight| with(|s| s.flight = flight);
    let other = ControlState::OtherControl(AutopilotMode::Other);
    let unknown = with(|s| (s.deck, s.forecast_age_s) = (None, f64::INFINITY));
    let alone = with_deck(|d| d.radio_age_s = f64::INFINITY);
    let far = with_deck(|d| d.distance_m = 5100.0);
    let rows = [
        (flown(ControlState::Unknown), 0.0, Stay(Idle, NotFlying)),
        (flown(ControlState::Disarmed), 0.0, Stay(Idle, NotFlying)),
        (flown(ControlState::OnGround), 0.0, Stay(Idle, NotFlying)),
        (flown(other), 0.0, Stay(Idle, NotFlying)),
        (rejected(), 0.0, Stay(Idle, AutopilotParameter)),
        (unknown, 0.0, Stay(Idle, ForecastStale)),
        (alone, 0.0, Stay(Idle, NoVessel)),
        (far, 0.0, Stay(Idle, VesselTooFar)),
    ];
    table(MissionPhase::Idle, rows);
    let why = step(MissionPhase::Idle, &far).waiting.to_string();
    assert_eq!(why, "the vessel is 5.1 km away (limit 5)");
    let unasked = (MissionPhase::Idle, MissionProgress::default());
    waits(&step(unasked, &fair()), Idle, NotCommanded);
    let d = commanded(unasked, CommandKind::Land, &fair());
    goes(&d, GetAltitude, Commanded);
}

#[test]
fn silent_vessel_with_its_beacon() {
    let c = config();
    let step = |phase, s: &Situation| decide(phase, wanted(), None, s, &c);
    let known = |sd_m: f64, distance_m: f64| {
        with_deck(|d| {
            (d.radio_age_s, d.vision_age_s) = (f64::INFINITY, f64::INFINITY);
            (d.beacon, d.distance_m) = (Some([sd_m, 0.8]), distance_m);
        })
    };
    let far = step(MissionPhase::Idle, &known(5.0, 300.0));
    goes(&far, GetAltitude, KnownByBeacon);
    assert_eq!(
        far.entered.unwrap().to_string(),
        "vessel known by beacon, 5 m, 0.8 s old"
    );
    waits(&step(MissionPhase::Idle, &known(5.0, 6e3)), Idle, VesselTooFar);
    waits(&step(MissionPhase::Idle, &known(40.0, 300.0)), Idle, BeaconVague);
    waits(
        &step(MissionPhase::APPROACH, &known(5.0, 30.0)),
        Approach,
        NoVision,
    );
    let begun = step(MissionPhase::APPROACH, &known(5.0, 2.0));
    goes(&begun, Search, AtBeacon);
    waits(&step(begun.phase, &known(5.0, 2.0)), Search, Searching);
    // Without a beacon the vessel cannot be found; a vessel that is received is approached directly.
    let lost = with_deck(|d| (d.radio_age_s, d.vision_age_s) = (f64::INFINITY, f64::INFINITY));
    goes(&step(begun.phase, &lost), Hold, NoVessel);
    goes(
        &step(begun.phase, &with_deck(|d| d.vision_age_s = 9.0)),
        Approach,
        Recovered,
    );
    let several = Situation {
        several: Some(Reason::new(SeveralDecks, 2.0, 0.0)),
        ..with_deck(|d| d.vision_age_s = 9.0)
    };
    waits(&step(MissionPhase::APPROACH, &several), Approach, SeveralDecks);
}

#[test]
fn silent_vessel_with_its_tags_in_sight() {
    let silent = with_deck(|d| d.radio_age_s = f64::INFINITY);
    let by_tag = MissionConfig {
        min_vessel: VesselLevel::Tag,
        ..config()
    };
    let step = |phase, s: &Situation, c: &MissionConfig| decide(phase, wanted(), None, s, c);
    waits(&step(MissionPhase::Idle, &silent, &config()), Idle, NoVessel);
    goes(&step(MissionPhase::Idle, &silent, &by_tag), Tracking, TagsInSight);
    // A tag that is not detected, or that is away from the drone, does not lead to the vessel.
    for (vision_age_s, distance_m) in [(0.6, 0.1), (f64::INFINITY, 0.1), (0.1, 11.0)] {
        let s = with_deck(|d| {
            d.radio_age_s = f64::INFINITY;
            (d.vision_age_s, d.distance_m) = (vision_age_s, distance_m);
        });
        waits(&step(MissionPhase::Idle, &s, &by_tag), Idle, NoVessel);
    }
    goes(
        &step(MissionPhase::Idle, &fair(), &by_tag),
        GetAltitude,
        Commanded,
    );
    // A descent needs the vessel's motion, unless the battery is low.
    let unknown = with_deck(|d| (d.radio_age_s, d.identified) = (f64::INFINITY, false));
    let stable = MissionPhase::TrackingStable;
    waits(&step(stable, &unknown, &by_tag), TrackingStable, NotIdentified);
    goes(&step(stable, &silent, &by_tag), Descent, Permitted);
    let urgent = MissionProgress {
        low_battery: Some(BatteryPlace::Deck),
        ..wanted()
    };
    let empty = Situation {
        battery: Some(0.09),
        ..unknown
    };
    goes(&decide(stable, urgent, None, &empty, &by_tag), Descent, Permitted);
}

#[test]
fn vessel_beyond_5_km_in_the_approach() {
    let s = with_deck(|d| d.distance_m = 5100.0);
    let d = run(MissionPhase::APPROACH, &s, 1.0);
    goes(&d, Hold, VesselTooFar);
    waits(&run(&d, &s, 20.0), Hold, VesselTooFar);
}

#[test]
fn moved_origin_without_a_forecast_since() {
    let moved = with(|s| {
        (s.deck, s.forecast_age_s) = (None, f64::INFINITY);
        s.moved = Some(Reason::new(OriginMoved, 120.0, 0.0));
    });
    waits(&step(MissionPhase::Idle, &moved), Idle, OriginMoved);
    for phase in [TRACKING, DESCENT, FREE_FLARE] {
        goes(&step(phase, &moved), Hold, OriginMoved);
    }
}

#[test]
fn approach_conditions() {
    let climb = MissionPhase::GetAltitude { from: [1.0, 2.0] };
    let d = step(climb, &fair());
    assert!((d.waiting.value - 8.0).abs() < 1e-9, "{d:?}");
    let high = with(|s| s.own.as_mut().unwrap().position.z = -1.3 - 15.0 + 0.5);
    let undetected = with_deck(|d| d.vision_age_s = f64::INFINITY);
    let blind = with_deck(|d| (d.vision_age_s, d.radio_age_s) = (f64::INFINITY, 6.0));
    let dark = |distance_m| Situation {
        dark: Some(Reason::new(TooDark, 3.0, 0.004)),
        ..with_deck(|d| (d.vision_age_s, d.distance_m) = (f64::INFINITY, distance_m))
    };
    let lamp = CameraLight {
        glare: Some(0.014),
        ..CameraLight::default()
    };
    let blinded = Situation {
        dark: lamp.hides_tags(),
        ..dark(0.1)
    };
    let text = blinded.dark.unwrap().to_string();
    assert!(text.starts_with("blinded") && text.contains("1.4 %"), "{text}");
    assert_eq!(CameraLight::default().hides_tags(), None);
    waits(&d, GetAltitude, OffHeight);
    goes(&step(climb, &high), Approach, HeightReached);
    let rows = [
        (undetected, 5.0, Stay(Approach, NoVision)),
        (fair(), 0.0, Stay(Approach, NoVision)),
        (fair(), 1.0, Enter(Tracking, InSight)),
        // Above the deck it is too dark; away from the deck no detection is expected.
        (dark(0.1), 5.0, Stay(Approach, TooDark)),
        (dark(20.0), 5.0, Stay(Approach, NoVision)),
        (blinded, 5.0, Stay(Approach, Glare)),
        (blind, 1.0, Enter(Hold, NoVessel)),
    ];
    table(MissionPhase::APPROACH, rows);
}

#[test]
fn tracking_steadiness() {
    let fast = with_deck(|d| d.relative_speed_mps = 2.0);
    let deep = with(|s| s.mean_deck_z = Some(3.0));
    let rows = [
        (with_deck(|d| d.distance_m = 2.0), 2.0, Stay(Tracking, TooFar)),
        (fast, 2.0, Stay(Tracking, TooFast)),
        (deep, 2.0, Stay(Tracking, OffHeight)),
        (fair(), 0.3, Stay(Tracking, NotSteady)),
        (fair(), 1.0, Enter(TrackingStable, Steady)),
    ];
    table(TRACKING, rows);
}

#[test]
fn tracking_without_radio_or_vision() {
    let silent = with_deck(|d| d.radio_age_s = f64::INFINITY);
    let undetected = with_deck(|d| d.vision_age_s = 5.5);
    let nothing = with_deck(|d| (d.vision_age_s, d.radio_age_s) = (5.5, 5.5));
    let rows = [
        (silent, 1.0, Enter(TrackingStable, Steady)),
        (undetected, 1.0, Enter(Approach, VisionLost)),
        (nothing, 1.0, Enter(Hold, VisionLost)),
    ];
    table(TRACKING, rows);
}

#[test]
fn reasons_not_to_descend() {
    let stays = |why| Stay(TrackingStable, why);
    let each = with_odds(|p| (p.hard, p.fast, p.tilted) = (0.93, 0.92, 0.93));
    let harmful = Situation {
        worth_waiting: 0.0,
        ..with_odds(|p| p.hard = 0.84)
    };
    let others = with(|s| s.reservation = Reservation::Others(2));
    let unknown = with(|s| s.reservation = Reservation::Unknown(2.5));
    let promised = |s| with(|fair| fair.course = Course::Steady(s));
    let rows = [
        (with_deck(|d| d.vision_age_s = 1.5), stays(VisionLost)),
        (with_odds(|p| p.hard = 0.8), stays(LikelyHard)),
        (harmful, stays(HarmLikely)),
        (with_odds(|p| p.fast = 0.8), stays(LikelyFast)),
        (with_odds(|p| (p.fast, p.turns) = (0.8, true)), stays(TurnTooFast)),
        (with_odds(|p| p.tilted = 0.5), stays(LikelyTilted)),
        (with_odds(|p| p.outside = 0.5), stays(LikelyOutside)),
        (with_odds(|p| p.slides = 0.9), stays(LikelySlides)),
        // With each limit on its own, the probability is sufficient.
        (each, stays(LikelyFast)),
        (with_odds(|p| p.outside = f64::NAN), stays(LikelyOutside)),
        (with(|s| s.worth_waiting = 0.9995), stays(LikelyHard)),
        (with_deck(|d| d.heave_mps = 4.0), stays(Infeasible)),
        (with_deck(|d| d.tilt_rad = 0.5), stays(TooSteep)),
        (with_deck(|d| d.turn_radps = 0.3), stays(Infeasible)),
        (with(|s| s.course = Course::Turning), stays(VesselTurns)),
        (promised(15.0), stays(CourseEnds)),
        (with(|s| s.plan_age_s = f64::INFINITY), stays(NoPlan)),
        (rejected(), stays(AutopilotParameter)),
        (
            with(|s| s.other_deck = Some(DeckDiffers.into())),
            stays(DeckDiffers),
        ),
        (with(|s| s.swing_rad = 0.1), stays(Swings)),
        (others, stays(DeckReserved)),
        (unknown, stays(DeckGrantStale)),
        (fair(), Enter(Descent, Permitted)),
        // A low probability of an unsafe contact is required later, where more is known.
        (with_odds(|p| p.hard = 0.92), Enter(Descent, Permitted)),
        (promised(20.0), Enter(Descent, Permitted)),
        (with_deck(|d| d.distance_m = 2.5), Enter(Tracking, TooFar)),
    ];
    table(MissionPhase::TrackingStable, rows.map(|(s, does)| (s, 0.0, does)));
    assert_eq!(step(MissionPhase::TrackingStable, &fair()).progress.attempts, 1);
}

#[test]
fn landed_until_disarmed_and_armed() {
    let stopped = with(|s| s.motors_stopped = true);
    assert_ne!(step(MissionPhase::Idle, &stopped).phase.state(), Landed);
    let landed = MissionPhase::LANDED;
    let on_deck = with_deck(|d| d.clearance_m = 0.05);
    let d = commanded(landed, CommandKind::Land, &on_deck);
    assert_eq!(d.phase, landed);
    let off = with(|s| (s.flight, s.rotors_carry) = (ControlState::Disarmed, Some(false)));
    let d = step((landed, d.progress), &off);
    assert_eq!(
        d.phase,
        MissionPhase::Landed {
            disarmed: true,
            airborne: None,
        }
    );
    let d = step(&d, &fair());
    goes(&d, Idle, ArmedAgain);
    assert!(!d.progress.landing);
}

#[test]
fn closed_deck_without_reservation() {
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
fn turn_in_a_landing() {
    let violated = Some(at(9.0));
    let flare = |committed| MissionPhase::Flare { committed, violated };
    let descent = MissionPhase::Descent {
        violated,
        paused: None,
    };
    let low = |clearance_m: f64, mut s: Situation| {
        s.deck.as_mut().unwrap().clearance_m = clearance_m;
        s
    };
    let stated = with(|s| s.course = Course::Turning);
    let turns = with_odds(|p| (p.fast, p.turns) = (0.7, true));
    goes(&step(descent, &low(3.0, stated)), Tracking, VesselTurns);
    goes(&step(flare(false), &low(0.9, stated)), Tracking, VesselTurns);
    waits(&step(flare(true), &low(0.5, stated)), Flare, Flaring);
    goes(&step(descent, &low(3.0, turns)), Tracking, TurnTooFast);
    waits(&step(flare(true), &low(0.5, turns)), Flare, TurnTooFast);
    // With an empty battery the deck is the only place, even in a turn.
    let urgent = MissionProgress {
        low_battery: Some(BatteryPlace::Deck),
        ..attempt()
    };
    let empty = Situation {
        battery: Some(0.09),
        ..stated
    };
    waits(&step((descent, urgent), &low(3.0, empty)), Descent, Descending);
}

#[test]
fn stated_course_in_silence() {
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
