//! Tests of the rules with simulated facts, and of the gatherer on this computer.

use std::{
    net::UdpSocket,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use alight_computer::{
    certificates,
    config::{DroneComputerConfig, VesselComputerConfig},
    exit::Exit,
    io::mavlink_key,
    situation::SourceHealth,
    subject::Computer,
    terminal::Form,
};
use alight_shared::{
    autopilot_parameters::Maker,
    geodesy::Datum,
    geometry::DroneGeometry,
    mavlink::{Signatures, Signing},
    msg::{Certificate, Reason, ReasonCode},
    tags::ForeignTag,
    time::Span,
};
use alight_sim::{
    autopilots::simulated::SimulatedAutopilot,
    physics::{
        drone::{AutopilotConfig, NavigationConfig, PlantState},
        streams::Streams,
    },
};
use alight_transport::radio::TlsConfig;
use alight_uav::{
    autopilot::message::{CommandLong, MavCmd},
    camera::metering::Setting,
};
use alight_usv::sensors::SourceConfig;

use crate::{
    status::finding::{Finding, FindingLevel},
    tools::check::{
        CheckArgs, autopilot,
        facts::{
            AutopilotReport, CameraCheck, CameraImages, CheckFacts, ClockSync, Identity, Port, PortState,
            Reach, SharedMemory, SigningCheck,
        },
        gather,
        received::SensorStatistics,
        rules::judge,
        run, sources,
    },
};

mod faults;

fn certificate(name: &str, days_left: i64) -> Certificate {
    Certificate {
        path: format!("/etc/alight/keys/{name}.pem").as_str().into(),
        days_left,
        in_future: false,
        name: name.into(),
    }
}

fn tls(peers: &[&str]) -> TlsConfig {
    TlsConfig {
        authority: "a".into(),
        certificate: "c".into(),
        key: "k".into(),
        peers: peers.iter().map(|p| (*p).to_owned()).collect(),
        ..TlsConfig::default()
    }
}

fn vessel() -> CheckFacts {
    let mut computer = VesselComputerConfig::default();
    computer.radio.listen = vec!["quic/0.0.0.0:7447".into()];
    computer.radio.tls = tls(&["drone-1"]);
    computer.sensor.sources = vec![SourceConfig::default()];
    CheckFacts {
        config: PathBuf::from("/etc/alight/vessel.toml"),
        computer: Ok(Computer::Vessel(Box::new(computer))),
        running: false,
        zenoh: None,
        identity: Some(Identity {
            authority: Ok(certificate("Alight private authority", 3000)),
            own: Ok(certificate("vessel-1", 800)),
            key: Ok(()),
            key_mode: Some(0o100_640),
            key_fits: Some(true),
            of_authority: Some(true),
        }),
        clock_s: 1_800_000_000,
        sync: Some(ClockSync {
            source: "chrony",
            synchronised: true,
            error_s: Some(0.0002),
        }),
        memory: None,
        ports: vec![Port {
            key: "radio.listen",
            address: "quic/0.0.0.0:7447".into(),
            state: PortState::Free,
        }],
        dialled: Vec::new(),
        autopilot: None,
        signing: None,
        reported: None,
        receiver: None,
        frame: None,
        flown: None,
        vessel_deck: None,
        cameras: Vec::new(),
        sources: Vec::new(),
        measured: SensorStatistics::default(),
        held_sources: Vec::new(),
        deck_inputs: Vec::new(),
        governors: vec!["performance".into(); 4],
        realtime: true,
        processors: 4,
    }
}

/// A drone's computer with a typical configuration, changed by `set`.
fn configure(facts: &mut CheckFacts, set: fn(&mut DroneComputerConfig)) {
    let mut computer = DroneComputerConfig::default();
    computer.radio.connect = vec!["quic/192.168.7.1:7447".into()];
    computer.radio.tls = tls(&["vessel-1"]);
    computer.drone.mission.battery_endurance_s = 1200.0;
    set(&mut computer);
    facts.computer = Ok(Computer::Drone(Box::new(computer)));
}

fn drone() -> CheckFacts {
    let mut facts = vessel();
    configure(&mut facts, |_| {});
    facts.identity.as_mut().unwrap().own = Ok(certificate("drone-1", 800));
    facts.memory = Some(SharedMemory {
        free_bytes: Some(1 << 30),
        writable: Ok(()),
        directory: Ok("/run/alight/alight-drone".into()),
    });
    facts.ports.clear();
    facts.dialled = vec![("quic/192.168.7.1:7447".into(), Reach::Answers)];
    facts.autopilot = Some(("serial:///dev/ttyACM0:921600".into(), Ok(Reach::Answers)));
    facts
}

/// Signing with a key file of these permissions, and this number of unsigned frames.
fn signed(key: Result<u32, &str>, unsigned: u64) -> Option<SigningCheck> {
    Some(SigningCheck {
        path: "/etc/alight/mavlink.key".into(),
        key: key.map_err(Into::into),
        received: Signatures {
            unsigned,
            ..Signatures::default()
        },
        admitted: false,
    })
}

/// Report of PX4 with this value of one parameter and suitable values of all others.
fn reported(name: &str, value: f64) -> Option<Option<AutopilotReport>> {
    against(name, ReasonCode::AutopilotParameter, value)
}
/// Report of PX4 in which one parameter is missing after this number of requests and all others are suitable.
fn unreported(name: &str, requests: u32) -> Option<Option<AutopilotReport>> {
    against(name, ReasonCode::AutopilotParameterUnknown, f64::from(requests))
}
fn against(name: &str, code: ReasonCode, value: f64) -> Option<Option<AutopilotReport>> {
    let one = Maker::Px4.parameters([1, 17]).filter(|(_, p)| p.name == name);
    Some(Some(AutopilotReport {
        parameters: one
            .map(|(number, p)| (p, Reason::new(code, value, number as f64)))
            .collect(),
        origin: Some(Datum::new(70.1, 19.2, 3.0)),
        geoid_m: Some(30.0),
        dates: true,
        several: None,
    }))
}
/// Report of PX4 with suitable parameters and this change.
fn but(change: fn(&mut AutopilotReport)) -> Option<Option<AutopilotReport>> {
    let mut report = reported("none", 0.0)??;
    change(&mut report);
    Some(Some(report))
}

fn worst(findings: &[Finding]) -> FindingLevel {
    findings.iter().map(|f| f.level).max().unwrap()
}

fn camera(source: &str, there: Result<(), String>, calibrated: bool) -> CameraCheck {
    CameraCheck {
        key: "camera",
        lens: "drone.camera.lens",
        source: source.into(),
        there,
        calibrated,
        view: None,
    }
}

fn looked(view: Result<CameraImages, &str>) -> CameraCheck {
    CameraCheck {
        view: Some(view.map_err(str::to_owned)),
        ..camera("/dev/video0", Ok(()), true)
    }
}

fn exposed(contrast: f64, saturation: f64) -> CameraImages {
    CameraImages {
        images: 60,
        exposure: Some(Ok(Setting {
            exposure_s: 0.001,
            gain: 4.0,
        })),
        tag: Some([contrast, saturation]),
        dark: None,
        foreign_tag: None,
    }
}

#[test]
fn check_of_faultless_computers() {
    for facts in [vessel(), drone()] {
        let findings = judge(&facts);
        assert_eq!(worst(&findings), FindingLevel::Fine, "{findings:#?}");
        assert!(findings.iter().all(|f| f.remedy.is_empty()));
    }
}

#[test]
fn autopilot_check_with_and_without_answer() {
    let found = |reported| {
        let mut facts = drone();
        facts.autopilot = Some(("udpin://127.0.0.1:14540".into(), Ok(Reach::Routed)));
        facts.reported = reported;
        let of_link = |f: &Finding| f.topic == "autopilot";
        judge(&facts).into_iter().find(of_link).unwrap().found
    };
    assert_eq!(found(reported("none", 0.0)), "answers at udpin://127.0.0.1:14540");
    assert!(found(None).contains("alight status"));
    assert!(!found(Some(None)).contains("alight status"));
}

#[test]
fn camera_check_with_and_without_a_tag() {
    let found = |view: CameraImages| {
        let mut facts = drone();
        facts.cameras.push(looked(Ok(view)));
        let all = judge(&facts);
        let view = all.iter().rfind(|f| f.topic == "camera").unwrap();
        (view.level, view.found.clone())
    };
    let fit = found(exposed(0.6, 0.01));
    assert_eq!(fit.0, FindingLevel::Fine);
    assert!(fit.1.contains("contrast 60 %"), "{fit:?}");
    let none = found(CameraImages {
        tag: None,
        ..exposed(0.0, 0.0)
    });
    assert_eq!(none.0, FindingLevel::Fine);
    assert!(
        none.1.contains("60 images") && none.1.contains("no tag in view"),
        "{none:?}"
    );
    for (foreign_tag, text) in [
        (ForeignTag::Mirrored(7), "mirrored (number 7)"),
        (ForeignTag::Number(3), "number 3"),
        (ForeignTag::Family25h9, "another family (25h9)"),
    ] {
        let other = found(CameraImages {
            tag: None,
            foreign_tag: Some(foreign_tag),
            ..exposed(0.0, 0.0)
        });
        assert!(
            other.0 == FindingLevel::Warning && other.1.contains(text),
            "{other:?}"
        );
    }
}

#[test]
fn check_behind_a_router() {
    let mut facts = drone();
    let router_finding = |facts: &CheckFacts| judge(facts).into_iter().find(|f| f.topic == "router");
    assert!(router_finding(&facts).is_none());
    let Ok(Computer::Drone(computer)) = &mut facts.computer else {
        unreachable!("a drone's")
    };
    computer.radio.router = true;
    computer.radio.tls.router = "vessel-9".into();
    let found = router_finding(&facts).unwrap();
    assert!(found.level == FindingLevel::Fine && found.found.contains("vessel-9 forwards"));
}

#[test]
fn check_of_an_unprotected_radio() {
    let mut facts = vessel();
    facts.identity = None;
    let mut computer = VesselComputerConfig::default();
    computer.sensor.sources = vec![SourceConfig::default()];
    facts.computer = Ok(Computer::Vessel(Box::new(computer.clone())));
    assert_eq!(worst(&judge(&facts)), FindingLevel::Warning);
    computer.radio.listen = vec!["udp/127.0.0.1:7447".into()];
    facts.computer = Ok(Computer::Vessel(Box::new(computer)));
    assert_eq!(worst(&judge(&facts)), FindingLevel::Fine);
}

#[test]
fn check_of_an_origin_without_both_heights() {
    let mut facts = drone();
    facts.reported = but(|r| r.geoid_m = None);
    let all = judge(&facts);
    let origin = all.iter().find(|f| f.topic == "origin").unwrap();
    assert_eq!(origin.level, FindingLevel::Fine);
    assert!(origin.found.contains("by the geoid's model"), "{}", origin.found);
}

#[test]
fn check_next_to_a_running_vessel() {
    let mut facts = vessel();
    facts.ports[0].state = PortState::Busy;
    facts.running = true;
    facts.held_sources = vec![SourceHealth {
        name: "imu".into(),
        age_s: Some(0.1),
        ..SourceHealth::default()
    }];
    let all = judge(&facts);
    assert_eq!(worst(&all), FindingLevel::Fine);
    assert!(
        all.iter()
            .any(|f| f.topic == "source" && f.found.starts_with("imu"))
    );
}

fn scratch(name: &str) -> PathBuf {
    let directory = std::env::temp_dir().join(format!("alight-check-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    directory
}

fn check(config: &Path) -> Exit {
    run(&CheckArgs {
        config: Some(config.into()),
        instance: None,
        form: Form {
            json: true,
            ..Form::default()
        },
    })
    .unwrap()
}

#[test]
fn check_of_a_swapped_key_and_a_foreign_authority() {
    let directory = scratch("keys");
    let (ours, theirs) = (directory.join("ours"), directory.join("theirs"));
    for authority in [&ours, &theirs] {
        certificates::init(authority, 400).unwrap();
        certificates::issue(authority, "vessel", 1, &[], 400).unwrap();
    }
    let written = |radio: &TlsConfig| {
        let mut computer = VesselComputerConfig::default();
        computer.radio.listen = vec!["quic/127.0.0.1:0".into()];
        computer.radio.tls = radio.clone();
        let path = directory.join("vessel.toml");
        let radio = std::collections::BTreeMap::from([("radio", &computer.radio)]);
        let text = format!("vessel_id = 1\n{}", toml::to_string(&radio).unwrap());
        std::fs::write(&path, text).unwrap();
        gather::gather(&path, None).identity.unwrap()
    };
    let good = certificates::files(&ours.join("vessel-1"), vec!["drone-1".into()]).unwrap();
    let found = written(&good);
    assert_eq!((found.key_fits, found.of_authority), (Some(true), Some(true)));
    assert_eq!(found.own.unwrap().days_left, 399);
    let other = certificates::files(&theirs.join("vessel-1"), Vec::new()).unwrap();
    let mixed = TlsConfig {
        key: other.key,
        ..good.clone()
    };
    assert_eq!(written(&mixed).key_fits, Some(false));
    let foreign = TlsConfig {
        authority: other.authority,
        ..good
    };
    assert_eq!(written(&foreign).of_authority, Some(false));
    std::fs::remove_dir_all(&directory).unwrap();
}

#[test]
fn sensor_check_of_silent_and_missing_sources() {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let free = || UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let (speaks, silent) = (free(), free());
    let mut computer = VesselComputerConfig::default();
    computer.sensor.sources = ["speaks", "silent", "taken", "none", "wrong"]
        .into_iter()
        .zip([
            format!("udpin://{speaks}"),
            format!("udpin://{silent}"),
            format!("udpin://{}", socket.local_addr().unwrap()),
            "serial:///dev/none:9600".into(),
            "nmea://mast".into(),
        ])
        .map(|(name, connect)| SourceConfig {
            name: name.into(),
            connect,
            ..SourceConfig::default()
        })
        .collect();
    let (end, ended) = std::sync::mpsc::channel::<()>();
    let speaker = std::thread::spawn(move || {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let mut k = 0;
        while ended.recv_timeout(std::time::Duration::from_millis(20)).is_err() {
            let time = format!("1200{:02}.{:02}", k / 50, 2 * (k % 50));
            for part in [format!("GPZDA,{time},01,01,2026,00,00"), "GPHDT,90.0,T".into()] {
                let sum = part.bytes().fold(0_u8, |a, b| a ^ b);
                let _missed = socket.send_to(format!("${part}*{sum:02X}\r\n").as_bytes(), speaks);
            }
            k += 1;
        }
    });
    let received = sources::listen(&computer);
    end.send(()).unwrap();
    speaker.join().unwrap();
    let (found, measured) = (received.sources, received.measured);
    assert!(
        measured.attitude.is_none() && measured.heading.is_some_and(|f| f.rate_hz > 5.0),
        "{measured:?}"
    );
    let received = |k: usize| {
        found[k]
            .received
            .as_ref()
            .map(|(bytes, s)| (*bytes, s.decoded.good))
    };
    assert!(
        received(0).is_ok_and(|(bytes, good)| bytes > 100 && good > 2),
        "{found:?}"
    );
    assert_eq!(received(1), Ok((0, 0)), "{found:?}");
    assert!(received(2).is_err_and(|e| e.contains("udpin://")), "{found:?}");
    assert!(received(3).is_err_and(|e| e.contains("/dev/none")), "{found:?}");
    assert!(received(4).is_err_and(|e| e.contains("nmea://mast")), "{found:?}");
    assert!(
        sources::listen(&VesselComputerConfig::default())
            .sources
            .is_empty()
    );
}

#[test]
fn check_of_a_broken_configuration() {
    let directory = scratch("broken");
    let path = directory.join("any.toml");
    for text in [
        "",
        "vessel_id = 1\n[bridge]\ndrone_id = 1",
        "vessel_id = \"one\"",
        "instance = \"x\"\nunknown = 3",
        "not toml",
        "vessel_id = 1\n[radio]\nlease_s = -1.0",
    ] {
        std::fs::write(&path, text).unwrap();
        assert_eq!(check(&path), Exit::Broken, "{text}");
    }
    assert_eq!(check(&directory.join("none.toml")), Exit::Broken);
    std::fs::remove_dir_all(&directory).unwrap();
}

/// Reads a simulated autopilot that signs with `key`, from a computer with this configuration: its report, the
/// signatures, and the commands that it received.
fn found_of_autopilot(
    computer: &DroneComputerConfig,
    key: Option<Signing>,
) -> (Option<AutopilotReport>, Signatures, Vec<CommandLong>) {
    let at = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let done = Arc::new(AtomicBool::new(false));
    let ended = done.clone();
    let flown = std::thread::spawn(move || {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(at).unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(5))).unwrap();
        let mut truth = PlantState::default();
        let (c, n) = (AutopilotConfig::default(), NavigationConfig::default());
        let geometry = DroneGeometry::default();
        let mut px4 = SimulatedAutopilot::new(&c, &n, &geometry, &Streams::new(1), &truth, 0.4);
        px4.set_signing(key);
        (px4.origin, px4.geoid_m) = (Datum::new(43.5, 16.3, 12.0), Some(38.0));
        px4.parameters.insert("MPC_ACC_UP_MAX", 4.0);
        let mut bytes = [0; 1024];
        while !ended.load(Ordering::Relaxed) {
            truth.at += Span::from_millis(5);
            let received = socket.recv(&mut bytes).map(|n| bytes[..n].to_vec());
            let received: Vec<Vec<u8>> = received.into_iter().collect();
            for sent in px4.step_bytes(&truth, &received).1 {
                let _lost = socket.send(&sent);
            }
        }
        px4.commands.into_iter().map(|(_, command)| command).collect()
    });
    let mut signatures = Signatures::default();
    let found = autopilot::report(
        computer,
        &format!("udpin://{at}").parse().unwrap(),
        &mut signatures,
    );
    done.store(true, Ordering::Relaxed);
    (found, signatures, flown.join().unwrap())
}

#[test]
fn autopilot_check_over_a_signed_link() {
    let file = std::env::temp_dir().join(format!("alight-check-key-{}", std::process::id()));
    std::fs::write(&file, "a passphrase of the boat\n").unwrap();
    let key = mavlink_key::read("autopilot.signing_key", file.to_str().unwrap()).unwrap();
    let other = Some(Signing::new([7; 32]));
    let mut computer = DroneComputerConfig::default();
    let text = |s: Signatures, admitted| s.finding(admitted).map(|(text, _)| text).unwrap_or_default();
    // Without a configured key, signatures are reported but not checked.
    let (found, signatures, _) = found_of_autopilot(&computer, key.clone());
    assert!(
        found.is_some() && text(signatures, true).contains("neither checked"),
        "{signatures:?}"
    );
    computer.autopilot.signing_key = file.display().to_string();
    let (found, signatures, _) = found_of_autopilot(&computer, key);
    assert!(found.is_some_and(|f| f.origin.is_some()) && signatures.finding(true).is_none());
    for (other, why) in [(other, "another key"), (None, "not signed")] {
        let (found, signatures, commands) = found_of_autopilot(&computer, other);
        assert!(found.is_none() && commands.is_empty());
        assert!(text(signatures, false).contains(why), "{signatures:?}");
    }
    std::fs::remove_file(file).unwrap();
}

#[test]
fn autopilot_check_over_the_link() {
    let free = || UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let computer = DroneComputerConfig::default();
    let silent = format!("udpin://{}", free()).parse().unwrap();
    assert_eq!(
        autopilot::report(&computer, &silent, &mut Signatures::default()),
        None
    );

    let (found, _, commands) = found_of_autopilot(&computer, None);
    let requests_only = commands
        .iter()
        .all(|c| c.command == MavCmd::MAV_CMD_REQUEST_MESSAGE);
    assert!(requests_only, "commanded {commands:?}");
    let found = found.unwrap();
    let origin = Datum::new(43.5, 16.3, 12.0);
    assert!(found.origin.unwrap().distance_m(&origin) < 0.02);
    assert!((found.geoid_m.unwrap() - 38.0).abs() < 1e-3);
    let wrong: Vec<_> = found
        .parameters
        .into_iter()
        .map(|(p, why)| (p.name, why.code, why.value))
        .collect();
    let code = ReasonCode::AutopilotParameter;
    let expected = [("MPC_ACC_UP_MAX", code, 4.0)];
    assert_eq!(wrong, expected);
}
