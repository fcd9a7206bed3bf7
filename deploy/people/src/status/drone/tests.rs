use super::*;
use crate::status::Status;
use alight_computer::{
    exit::Exit,
    process::snapshot::{Newest, Snapshot},
};
use alight_shared::{
    autopilot_parameters::Maker,
    msg::{
        ComputerReport, DeckDimensions, DeckForecast, DeckGrant, DeckStage, DroneState, Header, LinkState,
        MissionSettings, Reason, RelativeState, Seq, WaveModel,
    },
    plain::Plain,
    process::ProcessState,
    time::DroneClock,
};
use alight_uav::computer::PROCESSES;

const NOW_NS: i64 = 100_000_000_000;

fn mission(state: State, waiting: ReasonCode) -> MissionState {
    MissionState {
        header: Header::new(0, 1, 1, 1, Time::from_secs(20.0)),
        state,
        since: Time::from_secs(12.0),
        entered: ReasonCode::InSight.into(),
        waiting: Reason::new(waiting, 0.31, 0.2),
        battery_reserve: 0.34,
        ..MissionState::default()
    }
}
fn came<T: Plain>(value: T) -> Newest<T> {
    let mut newest = Newest::default();
    newest.set(NOW_NS, Some(value));
    newest
}
fn status(snapshot: &Snapshot, now_ns: i64) -> Status {
    Status::of(ObservedSituation::of(snapshot, now_ns))
}
fn reported() -> ComputerReport {
    ComputerReport {
        header: Header::new(1, 1, 1, 1, Time::from_nanos(NOW_NS)),
        title: "default".into(),
        processes: Seq::filled(PROCESSES.iter().copied()),
        ..ComputerReport::default()
    }
}
fn flying() -> Snapshot {
    let report = |kind| ProcessState {
        kind,
        at_ns: NOW_NS,
        ..ProcessState::default()
    };
    Snapshot {
        computer: reported().into(),
        processes: PROCESSES.iter().map(|k| (*k, report(*k))).collect(),
        mission: came(mission(State::Tracking, ReasonCode::TooSteep)),
        autopilot: came(AutopilotState {
            armed: true,
            battery: Some(0.8),
            ..AutopilotState::default()
        }),
        link: came(LinkState {
            age_s: 0.06,
            ..LinkState::default()
        }),
        ..Snapshot::default()
    }
}
fn wave(confidence: f32) -> WaveModel<DroneClock> {
    WaveModel {
        header: Header::new(0, 1, 1, 1, Time::from_secs(20.0)),
        significant_height_m: 0.9,
        confidence,
        modes: Seq::new(),
        slopes: Seq::new(),
        advice: None,
    }
}
fn ready() -> Snapshot {
    let mut snapshot = flying();
    snapshot.autopilot = came(AutopilotState::default());
    snapshot.mission = came(MissionState {
        entered: ReasonCode::Operator.into(),
        ..mission(State::Hold, ReasonCode::NotCommanded)
    });
    snapshot.drone = came(DroneState {
        wind: Some([3.0, 1.0]),
        ..DroneState::default()
    });
    snapshot.forecast = came(DeckForecast::default());
    snapshot.wave = came(wave(0.8));
    snapshot
}
fn texts(snapshot: &Snapshot) -> Vec<String> {
    let text = status(snapshot, NOW_NS).text();
    text.lines().map(str::to_owned).collect()
}

#[test]
fn status_page_of_a_flying_drone() {
    let lines = texts(&flying());
    assert_eq!(lines[0], "default: Tracking since 8.0 s: the deck is in sight");
    for (label, part) in [
        ("mission", "deck tilts 17.8 deg (limit 11.5)"),
        ("distance", "no forecast"),
        ("link", "60 ms old"),
        ("battery", "80 %, needs 34 %"),
        ("autopilot", "armed"),
        ("processes", "8 run, bridge"),
        ("alarms", "none"),
    ] {
        let line = lines.iter().find(|l| l.starts_with(label));
        assert!(line.is_some_and(|l| l.contains(part)), "{label}: {lines:?}");
    }
    assert_eq!(status(&flying(), NOW_NS).worst.exit(), Exit::Success);
}

#[test]
fn status_page_with_every_alarm() {
    let mut s = flying();
    s.processes.clear();
    s.computer = came(ComputerReport {
        edited: Some("drone.toml was edited since the start".into()),
        ..reported()
    });
    s.mission = came(MissionState {
        settings: MissionSettings {
            mode: LandingMode::Shadow,
            ..MissionSettings::default()
        },
        waiting: Reason::new(ReasonCode::AutopilotParameterUnknown, 10.0, 0.0),
        ..mission(State::Landed, ReasonCode::None)
    });
    s.autopilot = came(AutopilotState {
        armed: true,
        battery: Some(0.1),
        rejection: Reason::new(ReasonCode::AutopilotParameterUnknown, 10.0, 0.0),
        shadow: Some(ShadowComparison::default()),
        ..AutopilotState::default()
    });
    s.link = came(LinkState {
        age_s: f64::INFINITY,
        second_sender: Some(7),
        ..LinkState::default()
    });
    let lines = texts(&s);
    assert!(
        lines.len() <= 20 && lines.iter().all(|l| l.chars().count() <= 80),
        "{lines:?}"
    );
    let has = |part: &str| lines.iter().any(|l| l.contains(part));
    for part in [
        "still ARMED",
        "no report of bridge",
        "no landing:",
        "battery at 10 %",
        "a SECOND COMPUTER",
        "was edited",
        "no vessel received yet",
    ] {
        assert!(has(part), "{part}: {lines:?}");
    }
    assert_eq!(status(&s, NOW_NS).worst.exit(), Exit::Broken);
}

#[test]
fn parameter_that_forbids_no_landing() {
    let mut s = flying();
    let (number, _) = Maker::Px4
        .parameters([1, 17])
        .find(|(_, p)| p.name == "MC_AIRMODE")
        .unwrap();
    s.autopilot = came(AutopilotState {
        warning: Reason::new(ReasonCode::AutopilotParameter, 0.0, number as f64),
        ..AutopilotState::default()
    });
    let lines = texts(&s);
    assert!(lines.iter().any(|l| l.contains("MC_AIRMODE is 0")), "{lines:?}");
}

#[test]
fn silent_vessel_with_its_tags_in_sight() {
    let mut s = flying();
    s.link = came(LinkState {
        age_s: f64::INFINITY,
        ..LinkState::default()
    });
    s.forecast = came(DeckForecast {
        radio_age_s: f64::INFINITY,
        vision_age_s: 0.1,
        ..DeckForecast::default()
    });
    for (min_vessel, stops) in [(VesselLevel::Computer, true), (VesselLevel::Tag, false)] {
        s.mission = came(MissionState {
            min_vessel,
            ..mission(State::Tracking, ReasonCode::NotIdentified)
        });
        let all = findings(&ObservedSituation::of(&s, NOW_NS));
        let link = all.iter().find(|f| f.topic == "link");
        assert!(link.is_some_and(|f| f.stops == stops), "{all:?}");
    }
    // A beacon locates the vessel, if the mission permits it.
    s.forecast = came(DeckForecast {
        radio_age_s: f64::INFINITY,
        vision_age_s: f64::INFINITY,
        beacon: Some([12.0, 0.8]),
        ..DeckForecast::default()
    });
    for (min_vessel, stops) in [(VesselLevel::Computer, true), (VesselLevel::Beacon, false)] {
        s.mission = came(MissionState {
            min_vessel,
            ..mission(State::Search, ReasonCode::Searching)
        });
        let all = findings(&ObservedSituation::of(&s, NOW_NS));
        let link = all.iter().find(|f| f.topic == "link");
        assert!(link.is_some_and(|f| f.stops == stops), "{all:?}");
    }
}

#[test]
fn processes_that_have_just_started() {
    let mut snapshot = flying();
    snapshot.processes.retain(|kind, _| *kind == PROCESSES[0]);
    let mut missing = |since_s: i64| {
        snapshot.since_ns = NOW_NS - since_s * 1_000_000_000;
        let all = status(&snapshot, NOW_NS).findings;
        all.iter().any(|f| f.found.starts_with("no report of"))
    };
    assert!(!missing(1) && missing(2));
}

#[test]
fn status_page_key() {
    let key = |s: &Snapshot, now_ns| status(s, now_ns).key();
    let mut other = flying();
    let before = key(&other, NOW_NS);
    other.link = came(LinkState {
        age_s: 0.09,
        ..LinkState::default()
    });
    other.mission = came(MissionState {
        waiting: Reason::new(ReasonCode::TooSteep, 0.4, 0.2),
        ..mission(State::Tracking, ReasonCode::TooSteep)
    });
    assert_eq!(key(&other, NOW_NS), before);
    assert_ne!(key(&other, NOW_NS + 60_000_000_000), before, "silent processes");
    other.mission = came(mission(State::Descent, ReasonCode::TooSteep));
    assert_ne!(key(&other, NOW_NS), before);
}

#[test]
fn status_page_shadow_line() {
    let s = ShadowComparison {
        tilt: [0.1, -0.05],
        thrust: 0.41,
        apart_rad: 0.02,
        apart_mps: 0.3,
        ..ShadowComparison::default()
    };
    assert_eq!(
        shadow(&s),
        Figure::of(
            "shadow",
            "would command roll 5.7 pitch -2.9 deg, thrust 0.41",
            "apart by 1.1 deg, 0.30 m/s"
        )
    );
}

#[test]
fn relative_place_of_a_forecast() {
    let shown = |solution, confirmed, contradicted_m| {
        let mut snapshot = flying();
        let state = RelativeState {
            solution,
            sd_m: 0.021,
            confirmed,
            contradicted_m,
            ..RelativeState::default()
        };
        snapshot.forecast = came(DeckForecast {
            relative: Some(state),
            ..DeckForecast::default()
        });
        relative(&ObservedSituation::of(&snapshot, NOW_NS))
    };
    for (figure, value, part) in [
        (
            shown(CarrierSolution::Fixed, true, None),
            "fixed, 2 cm",
            ", confirmed by the tags",
        ),
        (
            shown(CarrierSolution::Fixed, true, Some(0.5)),
            "fixed, 2 cm",
            "by 0.50 m, not used",
        ),
        (
            shown(CarrierSolution::Float, false, None),
            "float, 2 cm",
            "not confirmed",
        ),
        (shown(CarrierSolution::None, false, None), "none", "not confirmed"),
    ] {
        let figure = figure.unwrap();
        assert_eq!(figure.value.as_deref(), Some(value));
        assert!(figure.note.contains(part), "{}", figure.note);
    }
    assert_eq!(relative(&ObservedSituation::of(&flying(), NOW_NS)), None);
}

#[test]
fn go_of_a_drone_by_what_is_known() {
    let go = |snapshot: &Snapshot| {
        let go = status(snapshot, NOW_NS).go;
        (go.go, go.why)
    };
    assert_eq!(go(&ready()).0, Some(true));
    let windless = Snapshot {
        drone: came(DroneState::default()),
        ..ready()
    };
    assert_eq!(go(&windless), (None, go::NO_WIND.into()));
    // The quality of the forecast matters unless the drone can land without the vessel's computer.
    let mut snapshot = ready();
    snapshot.wave = came(wave(0.001));
    let (shown, why) = go(&snapshot);
    assert_eq!((shown, why.contains("quality 0 %")), (None, true), "{why}");
    snapshot.wave = Newest::default();
    assert_eq!(go(&snapshot).0, None);
    let mut by_tag = snapshot.mission.unwrap();
    by_tag.min_vessel = VesselLevel::Tag;
    snapshot.mission = came(by_tag);
    assert_eq!(go(&snapshot).0, Some(true));
}

#[test]
fn deck_of_other_dimensions_by_the_vessel() {
    let own = DeckDimensions {
        size: [2.5, 1.7],
        ..DeckDimensions::default()
    };
    let names_both = |width| {
        let vessel = DeckDimensions {
            size: [2.5, width],
            ..own
        };
        let grant = DeckGrant {
            dimensions: Some(vessel),
            ..DeckGrant::default()
        };
        let computer = ComputerReport {
            deck: Some(own),
            ..reported()
        };
        let snapshot = Snapshot {
            grant: came(grant),
            computer: computer.into(),
            ..flying()
        };
        let all = findings(&ObservedSituation::of(&snapshot, NOW_NS));
        all.iter()
            .any(|f| f.found.contains("1.70 m") && f.found.contains("1.90 m"))
    };
    assert!(names_both(1.9) && !names_both(1.7));
}

/// Columns as in the table in `deploy/docs/view.md`: state, reasons for entering it and for waiting, ages of radio,
/// camera and mission (s), alarm, and the text of the page.
#[test]
fn page_in_each_state_with_each_loss() {
    let rows = [
        "Hold Operator NotCommanded 0 0 0 - GO: ready to land",
        "Hold ForecastStale ForecastStale 9 9 0 alarm WAITS: deck forecast 0.31 s old (limit 0.20)",
        "Approach Commanded NoVision 9 99 0 - WAITS: goes on by the forecast; radio lost 9 s",
        "Approach Commanded HeightUnconfirmed 0 0 0 - ACT: Fly the drone by hand to 15 m above the deck",
        "Tracking InSight TooFar 9 0 0 - WAITS: goes on by camera; radio lost 9 s",
        "TrackingStable Steady TooFast 0 0 0 - WAITS: 0.31 m/s relative to the deck (limit 0.20)",
        "Descent Permitted Descending 0 0 0 - LANDS: no action needed",
        "Flare FlareHeight Flaring 9 0 0 - LANDS: goes on by camera; radio lost 9 s",
        "Descent Permitted Descending 0 2 0 - LANDS: goes on by radio; camera lost 2 s",
        "Descent Permitted Descending 0 0 3 alarm ACT: it restarts by itself; otherwise take manual control",
        "Landed Touchdown None 0 0 0 - Landed: keep clear until it is disarmed",
        "Landed HardContact None 0 0 0 - NO-GO: the drone is in state Landed: hard contact",
        "GaveUp Operator NotCommanded 0 0 0 - Aborted: holds clear of the deck: order a landing, or take over",
        "GaveUp Matched NotCommanded 0 0 0 - Matched: holds clear of the deck: order a landing, or take over",
        "GaveUp OutOfRetries NotCommanded 0 0 0 alarm NO-GO: the drone is in state Gave up: attempts used",
    ];
    for row in rows {
        let parts: Vec<&str> = row.splitn(8, ' ').collect();
        let [radio_s, camera_s, mission_s] = [3, 4, 5].map(|k: usize| parts[k].parse::<f64>().unwrap());
        let code = |k: usize| serde_json::from_value::<ReasonCode>(parts[k].into()).unwrap();
        let mut s = ready();
        let state = MissionState {
            header: Header::new(0, 1, 1, 1, Time::from_secs(12.1)),
            entered: code(1).into(),
            state: serde_json::from_value(parts[0].into()).unwrap(),
            ..mission(State::Idle, code(2))
        };
        s.mission.set(NOW_NS - (1e9 * mission_s) as i64, Some(state));
        s.autopilot = flying().autopilot;
        s.link = came(LinkState {
            age_s: radio_s,
            ..LinkState::default()
        });
        s.forecast = came(DeckForecast {
            vision_age_s: camera_s,
            ..DeckForecast::default()
        });
        if radio_s > 1.0 {
            s.wave = Newest::default();
        }
        let status = status(&s, NOW_NS);
        let shown = format!("{}: {}", status.go.verdict, status.go.why);
        assert!(shown.starts_with(parts[7]), "{row}: {shown}");
        assert_eq!(status.worst == FindingLevel::Broken, parts[6] == "alarm", "{row}");
    }
}

/// A probability is shown where it decides: over the deck and before the flare, which has no condition to wait for.
#[test]
fn probability_and_waiting_by_state() {
    let shown = |state, north_m| {
        let mut s = flying();
        s.mission = came(MissionState {
            likelihood: Some(0.93),
            harm: Some(0.004),
            ..mission(state, ReasonCode::LikelyHard)
        });
        s.drone = came(DroneState {
            position: [north_m, 0.0, -5.0],
            ..DroneState::default()
        });
        s.forecast = came(DeckForecast {
            stages: Seq::filled([DeckStage::default()]),
            ..DeckForecast::default()
        });
        let size = [2.5, 1.7];
        s.computer = came(ComputerReport {
            deck: Some(DeckDimensions {
                size,
                ..DeckDimensions::default()
            }),
            ..reported()
        });
        let status = status(&s, NOW_NS);
        let waits = status.state.is_some_and(|s| !s.waiting.is_empty());
        let text = |name| status.figures.iter().find(|f| f.name == name).unwrap().text();
        (text("probability"), text("distance").unwrap(), waits)
    };
    let (over, near, waits) = shown(State::Descent, 0.4);
    assert_eq!(over.as_deref(), Some("93 %, unsafe contact 0.4 %"));
    assert!(near.starts_with("0.40 m, 5.0 m above the deck") && waits);
    let (abeam, away, _) = shown(State::Tracking, 38.2);
    assert!(
        abeam.is_none() && away.starts_with("38 m, ahead, 5.0 m above"),
        "{away}"
    );
    assert_eq!(
        (shown(State::Flare, 0.1).0, shown(State::Flare, 0.1).2),
        (None, false)
    );
}

#[test]
fn parked_drone_on_a_steep_deck() {
    let mut snapshot = flying();
    snapshot.mission = came(mission(State::Landed, ReasonCode::None));
    snapshot.computer = ComputerReport {
        parked_friction: Some(0.4),
        ..reported()
    }
    .into();
    let mut deck = |roll: f64| {
        let stage = DeckStage {
            euler: [roll, 0.0, 0.0],
            ..DeckStage::default()
        };
        snapshot.forecast = came(DeckForecast {
            stages: Seq::filled([stage]),
            ..DeckForecast::default()
        });
        let found = status(&snapshot, NOW_NS).findings;
        found
            .into_iter()
            .any(|f| f.topic == "deck" && f.level == FindingLevel::Broken)
    };
    assert!(!deck(0.3) && deck(0.5));
}
