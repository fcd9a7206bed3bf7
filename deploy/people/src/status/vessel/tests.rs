use alight_shared::{
    admission::AccessRejection,
    metrics::Metric,
    msg::{
        Certificate, ComputerReport, EstimatorStatus, FollowsAnother, Header, Line, Names, Reason,
        ReasonCode, Seq, SourceReport, Starved, State,
    },
    process::ProcessState,
    time::Time,
};

use super::*;
use alight_computer::process::snapshot::{Newest, Snapshot};

use crate::status::Status;

struct Vessel {
    process: ProcessState,
    status: VesselStatus,
    source: SourceReport,
    certificate: CertificateState,
    edited: Option<Line>,
}

fn held(days_left: i64) -> CertificateState {
    CertificateState::Read(Certificate {
        path: "certificate.pem".into(),
        days_left,
        in_future: false,
        name: "vessel-1".into(),
    })
}
fn vessel() -> Vessel {
    let drone = DroneStatus {
        header: Header::new(1, 1, 7, 1, Time::EPOCH),
        state: State::Descent,
        mission_age_s: 0.02,
        battery: Some(0.8),
        armed: true,
        ..DroneStatus::default()
    };
    let mut status = VesselStatus {
        deck_owner: Some(1),
        drones: Seq::filled([DroneContact {
            age_s: 0.3,
            status: drone,
        }]),
        estimator: EstimatorStatus {
            sensor_age_s: [Some(0.01), Some(0.1), Some(0.1)],
            estimate_age_s: Some(0.03),
            sd: [0.5, 0.1, 0.005, 0.01],
            waves: Some([0.9, 1.0]),
            ..EstimatorStatus::default()
        },
        ..VesselStatus::default()
    };
    status.uses[0].used = 880;
    let mut source = SourceReport::default();
    source.status.newest_s = Some(99.9);
    Vessel {
        process: ProcessState {
            kind: ProcessKind::Vessel,
            at_ns: 100_000_000_000,
            ..ProcessState::default()
        },
        status,
        source,
        certificate: held(300),
        edited: None,
    }
}
fn status(v: &Vessel, now_s: i64) -> Status {
    let reported = VesselReport {
        clock: Time::from_secs(now_s as f64),
        listen: Names::of(&["tls/0.0.0.0:7447".into()]),
        peers: Names::of(&["drone-1".into()]),
        certificate: v.certificate,
        sources: Seq::filled(["receiver".into()]),
        limits: DeckMotion {
            samples: 0,
            roll: 0.2,
            pitch: 0.2,
            inclination: 0.2,
            heave_rate: 1.0,
        },
        ..VesselReport::default()
    };
    let reported = ComputerReport {
        header: Header::new(1, 0, 1, 1, Time::from_secs(now_s as f64)),
        title: "vessel 1".into(),
        processes: Seq::filled([ProcessKind::Vessel]),
        edited: v.edited,
        vessel: Some(reported),
        ..ComputerReport::default()
    };
    let snapshot = Snapshot {
        processes: [(ProcessKind::Vessel, v.process)].into(),
        vessel: v.status.into(),
        sources: [(0, v.source)].into(),
        computer: reported.into(),
        ..Snapshot::default()
    };
    Status::of(ObservedSituation::of(&snapshot, now_s * 1_000_000_000))
}
fn measured(v: &mut Vessel, metrics: &[Metric]) {
    v.process.metrics = Seq::filled(metrics.iter().copied());
}

type Change<'a> = &'a dyn Fn(&mut Vessel);

fn worst(v: &Vessel, now_s: i64) -> (FindingLevel, Vec<&'static str>) {
    let all = status(v, now_s);
    let at = all.findings.iter().filter(|f| f.level == all.worst);
    (all.worst, at.map(|f| f.topic).collect())
}

#[test]
fn vessel_speed_while_it_is_known() {
    let mut estimator = vessel().status.estimator;
    assert_eq!(speed(&estimator, true).value, None);
    estimator.mean_velocity = Some([0.0, 2.0]);
    let shown = speed(&estimator, true);
    assert_eq!(shown.value.as_deref(), Some("3.9 kn"));
    assert_eq!(shown.note, "course over ground 090 deg");
    assert_eq!(speed(&estimator, false).value.as_deref(), Some("2.0 m/s"));
    estimator.estimate_age_s = Some(5.0);
    assert_eq!(speed(&estimator, true).value, None);
}

/// Changes to a vessel, each with the level and topic of the resulting finding.
const FAULTS: [(Change<'static>, FindingLevel, &str); 28] = [
    (
        &|w| w.status.estimator.greatest.inclination = 0.21,
        FindingLevel::Warning,
        "greatest",
    ),
    (
        &|w| w.status.estimator.greatest.heave_rate = 1.1,
        FindingLevel::Warning,
        "greatest",
    ),
    (
        &|w| w.status.deck.closed = Some(Closure::Crew),
        FindingLevel::Warning,
        "deck",
    ),
    (
        &|w| w.status.deck.closed = Some(Closure::Sensor),
        FindingLevel::Warning,
        "deck",
    ),
    (
        &|w| w.status.deck.input_errors = Seq::filled(["gone".into()]),
        FindingLevel::Warning,
        "deck",
    ),
    (
        &|w| w.status.deck.owner_age_s = Some(60.0),
        FindingLevel::Warning,
        "deck",
    ),
    (
        &|w| w.status.deck.doubles = Seq::filled([1]),
        FindingLevel::Broken,
        "deck",
    ),
    (
        &|w| w.status.deck.aborts = Seq::filled([1]),
        FindingLevel::Warning,
        "deck",
    ),
    (
        &|w| w.status.deck.follows_another = Some(FollowsAnother { drone: 1, boot: 7 }),
        FindingLevel::Broken,
        "deck",
    ),
    (
        &|w| w.status.drones[0].status.mission_age_s = 60.0,
        FindingLevel::Broken,
        "drones",
    ),
    (
        &|w| w.status.deck.unplaced = Seq::filled([2]),
        FindingLevel::Warning,
        "deck",
    ),
    (
        &|w| {
            w.status.deck.starved = Some(Starved {
                owner: 1,
                silent_s: 75.0,
                waiting: 2,
                battery: 0.22,
            });
        },
        FindingLevel::Broken,
        "deck",
    ),
    (
        &|w| w.status.deck.file_error = Some("full".into()),
        FindingLevel::Warning,
        "deck",
    ),
    (
        &|w| measured(w, &[MetricName::StepsUnrecorded.count(9_u32)]),
        FindingLevel::Warning,
        "recorder",
    ),
    (
        &|w| {
            measured(
                w,
                &[
                    MetricName::LateSteps.count(1_u32),
                    MetricName::LongestStep.seconds(2.0),
                ],
            )
        },
        FindingLevel::Warning,
        "computer",
    ),
    (
        &|w| w.edited = Some("edited".into()),
        FindingLevel::Warning,
        "configuration",
    ),
    (
        &|w| w.status.estimator.sensor_age_s[1] = Some(9.0),
        FindingLevel::Broken,
        "sensors",
    ),
    (
        &|w| w.source.status.newest_s = Some(96.0),
        FindingLevel::Warning,
        "source",
    ),
    (
        &|w| (w.source.status.newest_s, w.source.why) = (None, Some("no such device".into())),
        FindingLevel::Warning,
        "source",
    ),
    (
        &|w| w.status.uses[0].is_stuck = true,
        FindingLevel::Broken,
        "source",
    ),
    (
        &|w| w.source.status.decoded.mismatched_pulses = 1,
        FindingLevel::Warning,
        "source",
    ),
    (
        &|w| w.status.estimator.estimate_age_s = None,
        FindingLevel::Broken,
        "estimator",
    ),
    (&|w| w.certificate = held(-2), FindingLevel::Broken, "certificate"),
    (
        &|w| w.certificate = held(10),
        FindingLevel::Warning,
        "certificate",
    ),
    (
        &|w| {
            measured(
                w,
                &[MetricName::PeersRejectedFor(AccessRejection::Expired).count(3_u32)],
            )
        },
        FindingLevel::Warning,
        "peers",
    ),
    (&|w| w.status.drones = Seq::new(), FindingLevel::Warning, "drones"),
    (
        &|w| w.status.drones[0].age_s = 60.0,
        FindingLevel::Warning,
        "drones",
    ),
    (
        &|w| w.status.drones[0].status.still_armed_s = Some(14.0),
        FindingLevel::Broken,
        "drones",
    ),
];

#[test]
fn vessel_status_of_each_fault() {
    assert_eq!(worst(&vessel(), 100).0, FindingLevel::Fine);
    assert_eq!(worst(&vessel(), 110), (FindingLevel::Broken, vec!["processes"]));
    let case = |change: Change<'_>| {
        let mut w = vessel();
        change(&mut w);
        worst(&w, 100)
    };
    for (change, level, topic) in FAULTS {
        assert_eq!(case(change), (level, vec![topic]), "{topic}");
    }
}

#[test]
fn vessel_text_with_each_fault() {
    let lines = |v: &Vessel| -> Vec<String> {
        let text = status(v, 100).text();
        text.lines().map(str::to_owned).collect()
    };
    let fine = lines(&vessel());
    assert_eq!(fine[0], "vessel 1: works, up 100 s");
    for part in [
        "deck       reserved for drone 1",
        "drones     drone 1: Descent",
        "alarms     none",
    ] {
        assert!(fine.iter().any(|l| l.starts_with(part)), "{part}: {fine:?}");
    }
    let mut wrong = vessel();
    wrong.status.drones[0].status.still_armed_s = Some(14.0);
    wrong.status.deck.closed = Some(Closure::Crew);
    wrong.status.estimator.estimate_age_s = None;
    wrong.certificate = CertificateState::Absent;
    let expired = MetricName::PeersRejectedFor(AccessRejection::Expired);
    measured(&mut wrong, &[expired.count(3_u32)]);
    wrong.status.uses[0].is_stuck = true;
    wrong.status.deck.doubles = Seq::filled([1, 2, 3]);
    let lines = lines(&wrong);
    assert!(
        lines.len() <= 20 && lines.iter().all(|l| l.chars().count() <= 80),
        "{lines:?}"
    );
    assert!(lines[0].contains("BROKEN"), "{lines:?}");
    assert!(lines.iter().any(|l| l.contains("still ARMED")), "{lines:?}");
}

#[test]
fn vessel_with_more_endpoints_than_reported() {
    let reported = |left_out| {
        let listen = Names {
            left_out,
            ..Names::of(&["udp/127.0.0.1:7447".into()])
        };
        let known = VesselReport {
            listen,
            ..VesselReport::default()
        };
        certificate::none(endpoints(&known)).level
    };
    assert_eq!(
        (reported(0), reported(1)),
        (FindingLevel::Fine, FindingLevel::Warning)
    );
}

/// Before the vessel's first report, the certificate is judged by its topic alone; topics that need the report are
/// not judged.
#[test]
fn vessel_certificate_by_its_topic_alone() {
    let mut v = vessel();
    v.certificate = CertificateState::Unreadable("reading certificate.pem: no such file".into());
    v.edited = Some("vessel.toml was edited".into());
    let found = |s: &Status, topic: &str| -> Vec<String> {
        let of = s.findings.iter().filter(|f| f.topic == topic);
        of.map(|f| f.found.clone()).collect()
    };
    let reported = status(&v, 100);
    assert_eq!(
        found(&reported, "certificate"),
        ["reading certificate.pem: no such file"]
    );
    assert_eq!(found(&reported, "configuration"), ["vessel.toml was edited"]);
    assert_eq!(reported.title, "vessel 1");
    let mut silent = reported.situation.snapshot.clone();
    silent.computer = Newest::default();
    let unreported = Status::of(ObservedSituation::look(
        &silent,
        &reported.situation.known,
        100_000_000_000,
    ));
    assert_eq!(unreported.headline, "does not report");
    assert!(found(&unreported, "certificate").is_empty());
}

#[test]
fn go_of_a_vessel_and_of_its_drone() {
    let go = |change: Change<'_>| {
        let mut w = vessel();
        w.status.drones[0].status.wind = Some([3.0, 1.0]);
        w.status.drones[0].status.state = State::Idle;
        change(&mut w);
        let s = status(&w, 100);
        let own = own_go(&s.findings, &w.status);
        ([own.go, s.go.go], s.go.why)
    };
    let (fine, nothing) = (Some(true), "ready to land");
    assert_eq!(go(&|_| {}), ([fine; 2], nothing.into()));
    let (no, unknown) = (Some(false), None);
    let cases: [(Change<'_>, [Option<bool>; 2], &str); 11] = [
        (
            &|w| {
                w.status.drones[0].status.state = State::Descent;
                w.status.drones[0].status.waiting = ReasonCode::Descending.into();
            },
            [fine; 2],
            "drone 1: keep course and speed",
        ),
        (
            &|w| {
                w.status.drones[0].status.state = State::Hold;
                w.status.drones[0].status.waiting = Reason::new(ReasonCode::OdometryStale, 0.9, 0.2);
            },
            [fine, unknown],
            "drone 1: own odometry 0.90 s old (limit 0.20)",
        ),
        (
            &|w| {
                w.status.drones[0].status.state = State::Descent;
                w.status.deck.wants_steady = true;
                w.status.deck.course = Course::Turning;
            },
            [no; 2],
            "keep course and speed, and confirm",
        ),
        (
            &|w| w.status.estimator.waves = Some([0.9, 0.0]),
            [unknown; 2],
            "quality 0 %",
        ),
        (&|w| w.status.estimator.waves = None, [unknown; 2], "waves"),
        (&|w| w.status.deck.closed = Some(Closure::Crew), [no; 2], "closed"),
        (
            &|w| w.status.deck.aborts = Seq::filled([1]),
            [no; 2],
            "acknowledged an abort",
        ),
        (
            &|w| w.status.drones[0].status.wind = None,
            [fine, unknown],
            "drone 1: the wind",
        ),
        (
            &|w| w.status.drones[0].status.state = State::Landed,
            [fine, no],
            "drone 1: keep clear until it is disarmed",
        ),
        (
            &|w| w.status.drones[0].status.state = State::GaveUp,
            [fine, no],
            "drone 1: Gave up",
        ),
        (
            &|w| w.status.drones = Seq::new(),
            [fine, unknown],
            "no drone is received",
        ),
    ];
    for (change, expected, why) in cases {
        let (shown, because) = go(change);
        assert_eq!(shown, expected, "{because}");
        assert!(because.contains(why), "{because}");
    }
    let lost = go(&|w| w.status.drones[0].age_s = 9.0);
    assert_eq!(lost.0, [fine, unknown], "{}", lost.1);
}
