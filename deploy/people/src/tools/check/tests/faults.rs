use alight_shared::msg::SourceStatus;

use super::*;
use crate::tools::check::facts::{DeckInputCheck, SourceCheck};

/// Change that causes a fault, and a part of the finding's text.
type Fault = (fn(&mut CheckFacts), &'static str);
type FaultTable = (fn() -> CheckFacts, FindingLevel, &'static [Fault]);

fn own(f: &mut CheckFacts) -> &mut Identity {
    f.identity.as_mut().unwrap()
}

fn shared(f: &mut CheckFacts) -> &mut SharedMemory {
    f.memory.as_mut().unwrap()
}

fn unmeasured(f: &mut CheckFacts) {
    let Ok(Computer::Vessel(v)) = &mut f.computer else {
        panic!("the vessel's");
    };
    v.sensor.sources.clear();
}

fn source(f: &mut CheckFacts, received: Result<(usize, SourceStatus), String>) {
    f.sources = vec![SourceCheck {
        name: "compass".into(),
        connect: "serial:///dev/ttyUSB0:115200".into(),
        received,
        remarks: Vec::new(),
    }];
}

fn input(f: &mut CheckFacts, level: Result<bool, String>) {
    f.deck_inputs = vec![DeckInputCheck {
        key: "deck.crew_switch",
        path: "/sys/class/gpio/gpio17/value".into(),
        level,
    }];
}

const VESSEL_BROKEN: &[Fault] = &[
    (|f| f.clock_s = 40, "never set"),
    (
        |f| own(f).own = Ok(certificate("vessel-1", -3)),
        "expired 3 days ago",
    ),
    (|f| own(f).own = Ok(certificate("vessel-2", 800)), "vessel-2's"),
    (|f| own(f).own.as_mut().unwrap().in_future = true, "not valid yet"),
    (|f| own(f).authority = Err("no such file".into()), "no such file"),
    (
        |f| own(f).key = Err("permission denied".into()),
        "permission denied",
    ),
    (|f| own(f).key_fits = Some(false), "does not belong"),
    (|f| own(f).of_authority = Some(false), "the trusted authority"),
    (|f| f.identity = None, "names no files"),
    (|f| f.ports[0].state = PortState::Busy, "another program"),
    (
        |f| f.ports[0].state = PortState::Unavailable("not here".into()),
        "not here",
    ),
];

const VESSEL_WARNINGS: &[Fault] = &[
    (|f| f.sync = None, "no program reports"),
    (
        |f| f.sync.as_mut().unwrap().synchronised = false,
        "not synchronised",
    ),
    (|f| f.sync.as_mut().unwrap().error_s = Some(-0.3), "-300 ms"),
    (
        |f| own(f).own = Ok(certificate("vessel-1", 29)),
        "expires in 29 days",
    ),
    (|f| own(f).key_mode = Some(0o100_644), "mode 644"),
    (|f| unmeasured(f), "no sensor is configured"),
    (|f| source(f, Err("no such device".into())), "no such device"),
    (
        |f| source(f, Ok((0, SourceStatus::default()))),
        "no data received",
    ),
    (|f| source(f, Ok((900, SourceStatus::default()))), "900 bytes"),
    (
        |f| input(f, Err("not exported".into())),
        "gpio17/value: not exported",
    ),
    (|f| f.governors[2] = "powersave".into(), "powersave"),
];

const DRONE_WARNINGS: &[Fault] = &[
    (
        |f| f.dialled[0].1 = Reach::Unreachable("connection refused".into()),
        "connecting to quic/",
    ),
    (
        |f| {
            f.autopilot = Some((
                "serial:///dev/x".into(),
                Ok(Reach::Unreachable("not there".into())),
            ))
        },
        "not there",
    ),
    (
        |f| f.cameras.push(camera("/dev/video0", Ok(()), false)),
        "simulated camera's",
    ),
    (
        |f| f.cameras.push(looked(Ok(exposed(0.2, 0.0)))),
        "contrast 20 %, saturation 0 % on the tag, exposed for 1.0 ms with gain 4",
    ),
    (
        |f| f.cameras.push(looked(Ok(exposed(0.6, 0.3)))),
        "saturation 30 %",
    ),
    (
        |f| {
            f.cameras.push(looked(Ok(CameraImages {
                tag: None,
                dark: Some(3.2),
                ..exposed(0.0, 0.0)
            })))
        },
        "too dark to see the tags: image mean 3 of 255, exposed for 1.0 ms with gain 4",
    ),
    (
        |f| {
            f.cameras.push(looked(Ok(CameraImages {
                exposure: Some(Err("has no control".into())),
                ..exposed(0.6, 0.0)
            })))
        },
        "has no control: the camera's own automatic exposure is in use",
    ),
    (
        |f| f.frame = Some((Datum::new(70.1, 19.2, 33.0), Some(7200.0))),
        "7200 m away",
    ),
    (|f| f.signing = signed(Ok(0o644), 0), "others may read or change"),
    (
        |f| {
            configure(f, |d| d.autopilot.unsigned_orders = true);
            f.signing = signed(Ok(0), 0).map(|s| SigningCheck {
                path: String::new(),
                ..s
            });
        },
        "whoever reaches the autopilot's link may order",
    ),
    (|f| f.reported = Some(None), "no heartbeat"),
    (|f| f.reported = but(|r| r.origin = None), "GPS_GLOBAL_ORIGIN"),
    (
        |f| f.reported = but(|r| r.several = Some([1, 2])),
        "of two vehicles, 1 and 2",
    ),
    (
        |f| f.reported = but(|r| r.dates = false),
        "does not answer TIMESYNC",
    ),
    (
        |f| f.reported = reported("MC_AIRMODE", 0.0),
        "MC_AIRMODE is 0; 1 to 2 is needed",
    ),
    (
        |f| f.reported = unreported("MC_AIRMODE", 3),
        "the autopilot has not reported MC_AIRMODE (3 requests)",
    ),
    (
        |f| {
            f.reported = reported("COM_OF_LOSS_T", 1.0);
            configure(f, |d| d.autopilot.check_parameters = false);
        },
        "COM_OF_LOSS_T is 1 s",
    ),
    (
        |f| configure(f, |d| d.drone.mission.battery_endurance_s = 0.0),
        "battery_endurance_s is not set",
    ),
    (|f| f.realtime = false, "real-time"),
    (|f| f.processors = 1, "one processor"),
];

const DRONE_BROKEN: &[Fault] = &[
    (|f| f.signing = signed(Err("no such file"), 0), "no such file"),
    (|f| f.signing = signed(Ok(0o600), 4), "not signed"),
    (|f| shared(f).free_bytes = Some(1 << 20), "1 MB free"),
    (|f| shared(f).writable = Err("read-only".into()), "read-only"),
    (|f| shared(f).directory = Err("another's".into()), "another's"),
    (
        |f| f.reported = reported("COM_OF_LOSS_T", 1.0),
        "COM_OF_LOSS_T is 1 s; 0.1 to 0.5 s is needed",
    ),
    (
        |f| f.reported = unreported("COM_OF_LOSS_T", 10),
        "the autopilot has not reported COM_OF_LOSS_T (10 requests)",
    ),
    (
        |f| f.autopilot = Some(("usb".into(), Err("no kind of link".into()))),
        "no kind of link",
    ),
    (
        |f| {
            f.cameras
                .push(camera("/dev/video9", Err("no such file".into()), true))
        },
        "no such file",
    ),
    (|f| f.cameras.push(looked(Err("no image came"))), "no image came"),
    (
        |f| configure(f, |d| d.radio.tls = tls(&["vessel-2"])),
        "vessel-1 is not among",
    ),
];

/// Frames of other senders, and frames sent before the autopilot had the key, are harmless on a link that also admits
/// the autopilot's frames.
#[test]
fn frames_left_out_of_a_link_that_works() {
    let mut facts = drone();
    facts.signing = signed(Ok(0o600), 1).map(|s| SigningCheck { admitted: true, ..s });
    let findings = judge(&facts);
    let bad: Vec<_> = findings
        .iter()
        .filter(|f| f.level != FindingLevel::Fine)
        .collect();
    assert!(bad.is_empty(), "{bad:#?}");
}

#[test]
fn check_of_each_fault() {
    let faults: [FaultTable; 4] = [
        (vessel, FindingLevel::Broken, VESSEL_BROKEN),
        (vessel, FindingLevel::Warning, VESSEL_WARNINGS),
        (drone, FindingLevel::Warning, DRONE_WARNINGS),
        (drone, FindingLevel::Broken, DRONE_BROKEN),
    ];
    let each = faults
        .iter()
        .flat_map(|(facts, level, faults)| faults.iter().map(move |f| (facts(), *level, f)));
    for (mut facts, level, (spoil, text)) in each {
        spoil(&mut facts);
        let findings = judge(&facts);
        let bad: Vec<_> = findings
            .iter()
            .filter(|f| f.level != FindingLevel::Fine)
            .collect();
        assert_eq!(bad.len(), 1, "{text}: {bad:#?}");
        assert!(
            bad[0].level == level && bad[0].found.contains(text),
            "{text}: {bad:?}"
        );
        assert!(bad[0].remedy.len() > 8, "{text}: names a remedy: {bad:?}");
    }
}
