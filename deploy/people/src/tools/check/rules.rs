use alight_computer::{
    certificates::common_name, config::VesselComputerConfig, subject::Computer, vessel::deck_inputs,
};
use alight_shared::{
    autopilot_parameters::Severity,
    geoid,
    msg::{Reason, ReasonCode},
};
use alight_transport::radio::RadioConfig;

use crate::{
    explain::advice,
    status::{
        certificate,
        drone::frame,
        finding::{Finding, FindingTopic},
        sources::{self, remark},
    },
    tools::check::{
        equipment,
        facts::{
            AutopilotReport, CameraCheck, CheckFacts, DeckInputCheck, Identity, Port, PortState, Reach,
            SharedMemory, SigningCheck, SourceCheck,
        },
        receiver, view,
    },
};

/// Shared memory of a drone's processes, bytes: 7 MB measured with `alight land`, plus viewers and the remains of a
/// killed predecessor.
const MEMORY_BYTES: u64 = 64 << 20;
/// Earliest plausible time of the system clock, 2025-01-01, s since 1970; an earlier clock was never set.
const PLAUSIBLE_S: i64 = 1_735_689_600;
/// Clock error above which a warning is given, s; logs of both computers are aligned by this clock.
const CLOCK_ERROR_S: f64 = 0.1;
/// Minimum contrast of the tag without a warning. The detector needs a margin of 20 grey levels, which is a contrast
/// of 16 %; motion and noise reduce the contrast.
const MIN_CONTRAST: f64 = 0.3;
/// Maximum saturation of the tag without a warning: a third of its white area.
const MAX_SATURATION: f64 = 0.1;
/// Permission bits that let users other than the owner read or write a file.
const OTHERS: u32 = 0o077;
const GROUP_READS: u32 = 0o040;

/// Findings on `facts`, in the order in which an installer repairs them.
pub fn judge(facts: &CheckFacts) -> Vec<Finding> {
    let path = facts.config.display();
    let computer = match &facts.computer {
        Ok(computer) => computer,
        Err(why) => {
            return vec![FindingTopic("configuration").broken(
                why,
                format!("correct {path}; `alight config drone --all` (or vessel) prints every key of the file with its unit and default"),
            )];
        }
    };
    let (side, id, radio, looked_at) = match computer {
        Computer::Vessel(v) => ("vessel", v.vessel_id, &v.radio, &v.view),
        Computer::Drone(d) => ("drone", d.bridge.drone_id, &d.radio, &d.view),
    };
    let mut all = vec![FindingTopic("configuration").fine(format!("{path} is a {side}'s, number {id}"))];
    all.extend(clock(facts));
    all.extend(identity(facts, side, id, radio));
    all.extend(router(radio));
    let remedy = "correct the file that radio.zenoh names: neither vessel nor drone starts with it";
    all.extend(
        facts
            .zenoh
            .as_ref()
            .map(|why| FindingTopic("zenoh").broken(why, remedy)),
    );
    if let Computer::Drone(d) = computer {
        all.extend(vessel_admitted(radio, d.bridge.vessel_id));
    }
    all.extend(facts.ports.iter().map(|p| port(p, facts.running)));
    all.extend(facts.dialled.iter().map(|(to, reach)| dialled(to, reach)));
    all.extend(view::judge(looked_at));
    all.extend(facts.memory.as_ref().map(memory).into_iter().flatten());
    all.extend(facts.autopilot.as_ref().map(|a| autopilot(a, facts)));
    let orders = match computer {
        Computer::Drone(d) => d.autopilot.takes_orders(),
        Computer::Vessel(_) => false,
    };
    all.extend(facts.signing.as_ref().map(|check| signing(check, orders)));
    match (computer, &facts.reported) {
        (Computer::Drone(d), Some(Some(reported))) => {
            all.extend(reported.several.map(several_autopilots));
            all.extend(parameters(reported, d.autopilot.check_parameters));
            all.push(origin(reported));
            if !reported.dates {
                let code = ReasonCode::NoTimesync;
                let finding = Reason::from(code).to_string();
                all.push(FindingTopic("autopilot").stopping(finding, advice(code)));
            }
        }
        (Computer::Drone(_), Some(None)) => all.push(FindingTopic("parameters").warning(
            "no heartbeat of an autopilot was received: parameters and origin were not read",
            "is it powered, and does it send to this link?",
        )),
        (Computer::Drone(_), None) | (Computer::Vessel(_), _) => {}
    }
    all.extend(facts.receiver.as_ref().map(receiver::judge));
    all.extend(facts.frame.map(frame));
    if let Computer::Drone(d) = computer {
        all.extend(
            facts
                .flown
                .map(|flown| response(flown, d.drone.airframe.attitude_lag_s)),
        );
        all.push(equipment::deck(
            &d.drone.deck,
            &d.drone.airframe,
            facts.vessel_deck,
        ));
        all.extend(d.camera.is_there().then(|| equipment::tags(&d.drone)));
        all.extend(equipment::lenses(d));
        all.push(equipment::battery(&d.drone.mission));
    }
    all.extend(facts.cameras.iter().map(|c| camera(c, facts.running)));
    all.extend(facts.cameras.iter().filter_map(camera_view));
    if let Computer::Vessel(v) = computer {
        all.extend(vessel_devices(facts, v));
    }
    all.extend(processors(facts, matches!(computer, Computer::Drone(_))));
    all
}

fn vessel_devices(facts: &CheckFacts, v: &VesselComputerConfig) -> Vec<Finding> {
    let mut all: Vec<Finding> = v.sensor.sources.is_empty().then(no_sensor).into_iter().collect();
    all.extend(facts.held_sources.iter().flat_map(sources::of));
    for found in &facts.sources {
        all.push(source(found));
        all.extend(
            found
                .remarks
                .iter()
                .map(|r| remark(&found.name, &r.text, r.remedy.as_deref())),
        );
    }
    let listened = facts.held_sources.is_empty().then_some(&facts.sources);
    all.extend(listened.and_then(|s| equipment::vessel(s, &facts.measured)));
    all.extend(facts.deck_inputs.iter().map(deck_input));
    all
}

/// Sum of dead time and time constant above which the response is slow, s. ArduCopter with default gains, the slowest
/// autopilot flown, takes 0.3 s.
const SLOW_RESPONSE_S: f64 = 0.45;
/// Ratio of identified to configured time constant above which they differ.
const LAG_RATIO: f64 = 1.5;

fn response([dead_s, lag_s]: [f64; 2], configured_s: f64) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("response");
    let found = format!(
        "in the last flight the attitude responded with {dead_s:.2} s dead time and {lag_s:.2} s time constant"
    );
    if dead_s + lag_s > SLOW_RESPONSE_S {
        return TOPIC.warning(
            format!("{found}: slow, so the drone follows deck and gusts late"),
            "raise the autopilot's attitude gains (PX4 MC_ROLL_P, MC_PITCH_P; ArduCopter ATC_ANG_RLL_P, \
             ATC_ANG_PIT_P, less ATC_INPUT_TC), or shorten its link",
        );
    }
    let ratio = lag_s / configured_s.max(1e-3);
    if !(1.0 / LAG_RATIO..=LAG_RATIO).contains(&ratio) {
        return TOPIC.warning(
            format!("{found}; configured are {configured_s:.2} s"),
            format!("set drone.airframe.attitude_lag_s = {lag_s:.2}, the initial value of a flight"),
        );
    }
    TOPIC.fine(found)
}

fn clock(facts: &CheckFacts) -> Vec<Finding> {
    const TOPIC: FindingTopic = FindingTopic("clock");
    if facts.clock_s < PLAUSIBLE_S {
        return vec![TOPIC.broken(
            "the system's clock was never set: certificates count as not yet valid",
            "connect to a time source once, or add a battery-backed clock",
        )];
    }
    let install = "install chrony and give it a source, the vessel's GNSS receiver for instance; flight itself \
                   does not need it, certificates and the comparison of logs do";
    vec![match &facts.sync {
        None => TOPIC.warning("no program reports whether the clock is synchronised", install),
        Some(s) if !s.synchronised => {
            TOPIC.warning(format!("{} reports: not synchronised", s.source), install)
        }
        Some(s) => match s.error_s {
            Some(e) if e.abs() > CLOCK_ERROR_S => TOPIC.warning(
                format!("{} reports: {:.0} ms off", s.source, e * 1e3),
                "wait until it has converged, or look at its sources (chronyc sources)",
            ),
            Some(_) | None => TOPIC.fine(format!("synchronised, reports {}", s.source)),
        },
    }]
}

fn identity(facts: &CheckFacts, side: &'static str, id: u32, radio: &RadioConfig) -> Vec<Finding> {
    const TOPIC: FindingTopic = FindingTopic("certificate");
    let endpoints = || radio.listen.iter().chain(&radio.connect).map(String::as_str);
    let Some(identity) = &facts.identity else {
        return vec![certificate::none(endpoints())];
    };
    let mut all = Vec::new();
    if let Some(plain) = endpoints().find(|e| !e.starts_with("quic/")) {
        all.push(TOPIC.broken(
            format!("{plain} is not quic/, which certificates require"),
            "write the endpoint as quic/HOST:PORT, or remove radio.tls",
        ));
    }
    let read = [&identity.authority, &identity.own].map(|c| c.as_ref().map_err(String::as_str));
    all.extend(read.map(certificate::judge));
    let wanted = common_name(side, id);
    if let Ok(own) = &identity.own
        && own.name.as_str() != wanted
    {
        all.push(TOPIC.broken(
            format!(
                "the certificate is {}'s, and the configuration names {wanted}",
                own.name
            ),
            format!("copy the files of {wanted} here, or correct the number"),
        ));
    }
    all.extend(key(identity));
    all
}

fn key(identity: &Identity) -> Vec<Finding> {
    const TOPIC: FindingTopic = FindingTopic("key");
    let mut all = Vec::new();
    match (&identity.key, identity.key_mode) {
        (Err(why), None) => all.push(TOPIC.broken(
            why,
            "copy the directory that alight keys made to the path in radio.tls, readable for the user alight",
        )),
        (Err(why), Some(_)) => all.push(TOPIC.broken(why, "chown it to the user alight, chmod 600")),
        (Ok(()), Some(mode)) if mode & OTHERS & !GROUP_READS != 0 => all.push(TOPIC.warning(
            format!("others may read or change it (mode {:o})", mode & 0o777),
            "chmod 600",
        )),
        (Ok(()), _) => {}
    }
    if identity.key_fits == Some(false) {
        all.push(TOPIC.broken(
            "it does not belong to the certificate",
            "copy both from the same directory of alight keys",
        ));
    }
    if identity.of_authority == Some(false) {
        all.push(TOPIC.broken(
            "the certificate was not made by the trusted authority",
            "make all certificates with one authority and copy its authority.pem to both sides",
        ));
    }
    if all.is_empty() {
        all.push(TOPIC.fine("fits the certificate"));
    }
    all
}

fn router(radio: &RadioConfig) -> Option<Finding> {
    (radio.router && !radio.tls.authority.is_empty()).then(|| {
        FindingTopic("router").fine(format!(
            "{} forwards the messages of peers: its own access rules decide who may use which key, operators included",
            radio.tls.router
        ))
    })
}

fn vessel_admitted(radio: &RadioConfig, vessel_id: u32) -> Option<Finding> {
    let vessel = common_name("vessel", vessel_id);
    (!radio.tls.authority.is_empty() && !radio.tls.peers.contains(&vessel)).then(|| {
        FindingTopic("vessel").broken(
            format!("{vessel} is not among radio.tls.peers: its messages are rejected"),
            format!("peers = [\"{vessel}\"], or correct bridge.vessel_id"),
        )
    })
}

fn port(port: &Port, running: bool) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("ports");
    let what = format!("{} {}", port.key, port.address);
    match &port.state {
        PortState::Free => TOPIC.fine(format!("{what} is free")),
        PortState::Busy if running => TOPIC.fine(format!("{what} is taken, and Alight runs")),
        PortState::Busy => TOPIC.broken(
            format!("{what} is taken by another program"),
            "ss -lnptu shows which; stop it, or choose another port on both sides",
        ),
        PortState::Unavailable(why) => TOPIC.broken(
            format!("{what}: {why}"),
            "name an address of this computer (ip address) and a port above 1023",
        ),
        PortState::Untried => TOPIC.warning(
            format!("{what} cannot be tried"),
            "write it as PROTOCOL/ADDRESS:PORT with udp, tcp or quic",
        ),
    }
}

fn dialled(to: &str, reach: &Reach) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("vessel");
    match reach {
        Reach::Answers => TOPIC.fine(format!("{to} answers")),
        Reach::Routed => TOPIC.fine(format!(
            "there is a route to {to}; alight status shows whether it answers"
        )),
        Reach::Unreachable(why) => TOPIC.warning(
            format!("connecting to {to}: {why}"),
            "start alight-vessel on the vessel's computer; if it runs, ping that address and check the radio",
        ),
    }
}

fn autopilot((url, reach): &(String, Result<Reach, String>), facts: &CheckFacts) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("autopilot");
    match reach {
        Ok(Reach::Answers | Reach::Routed) => match facts.reported {
            Some(Some(_)) => TOPIC.fine(format!("answers at {url}")),
            // The finding on its parameters reports the missing heartbeat.
            Some(None) => TOPIC.fine(format!("{url} can be opened")),
            None => TOPIC.fine(format!("{url} can be opened; alight status shows whether the autopilot answers")),
        },
        Ok(Reach::Unreachable(why)) if facts.running => {
            TOPIC.fine(format!("{url} is taken ({why}), and Alight runs"))
        }
        Ok(Reach::Unreachable(why)) => TOPIC.warning(
            format!("{url}: {why}"),
            "is it powered and plugged in, may the user alight open it (group dialout), does another program hold it?",
        ),
        Err(why) => TOPIC.broken(why, "correct autopilot.connect"),
    }
}

fn signing(check: &SigningCheck, orders: bool) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("signing");
    match (&check.key, check.received.finding(check.admitted)) {
        (Err(why), _) => TOPIC.broken(why, "correct autopilot.signing_key or that file"),
        (Ok(_), Some((signatures, remedy_of_signatures))) => TOPIC.broken(signatures, remedy_of_signatures),
        (Ok(mode), None) if mode & OTHERS & !GROUP_READS != 0 => TOPIC.warning(
            format!(
                "others may read or change {} (mode {:o})",
                check.path,
                mode & 0o777
            ),
            "chmod 600",
        ),
        (Ok(_), None) if check.path.is_empty() && orders => TOPIC.warning(
            "autopilot.unsigned_orders: whoever reaches the autopilot's link may order landings and take-offs",
            "set autopilot.signing_key instead",
        ),
        (Ok(_), None) if check.path.is_empty() => {
            TOPIC.fine("frames are not signed: from a ground station only an abort is accepted")
        }
        (Ok(_), None) => TOPIC.fine("frames are signed; others are rejected"),
    }
}

fn several_autopilots([first, other]: [u8; 2]) -> Finding {
    FindingTopic("autopilot").stopping(
        format!("autopilots of two vehicles, {first} and {other}, are received: no landing begins"),
        "set autopilot.vehicle to the system id of this drone's autopilot (PX4 MAV_SYS_ID, ArduPilot MAV_SYSID, before 4.7 SYSID_THISMAV)",
    )
}

fn origin(reported: &AutopilotReport) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("origin");
    let Some(o) = &reported.origin else {
        return TOPIC.warning(
            "the autopilot has not reported the origin of its frame (GPS_GLOBAL_ORIGIN), which every flight needs",
            "the first GNSS fix sets it: wait under open sky, and check again",
        );
    };
    let at = format!(
        "the origin of the drone's frame is at {:.6}, {:.6}, {:.1} m above the sea, which is",
        o.latitude_deg, o.longitude_deg, o.height_m
    );
    match reported.geoid_m {
        Some(g) => TOPIC.fine(format!("{at} {g:.1} m above the ellipsoid by its receiver")),
        None => {
            let [latitude, longitude] = [o.latitude_deg, o.longitude_deg].map(f64::to_radians);
            let g = geoid::undulation(latitude, longitude);
            TOPIC.fine(format!(
                "{at} {:.1} m above the ellipsoid by the geoid's model (EGM96; its receiver, which does not give both heights, \
                 may differ by {:.1} m)",
                g.height_m, g.sigma_m
            ))
        }
    }
}

fn parameters(reported: &AutopilotReport, rejects: bool) -> Vec<Finding> {
    const TOPIC: FindingTopic = FindingTopic("parameters");
    let mut all: Vec<Finding> = reported
        .parameters
        .iter()
        .map(|(p, why)| {
            let wrong = why.to_string();
            let change = if why.code == ReasonCode::AutopilotParameterUnknown {
                "check the link, and whether its firmware has this parameter".to_owned()
            } else {
                format!("set {} to {} on the autopilot", p.name, p.corrected(why.value))
            };
            match p.severity {
                Severity::Reject if rejects => TOPIC.broken(wrong, change),
                Severity::Reject | Severity::Warn => TOPIC.warning(wrong, change),
            }
        })
        .collect();
    if all.is_empty() {
        all.push(TOPIC.fine("the autopilot's parameters suit a landing"));
    }
    all
}

fn camera(found: &CameraCheck, running: bool) -> Finding {
    let CameraCheck { key, source, .. } = found;
    match &found.there {
        Err(why) => FindingTopic(key).broken(
            format!("{source}: {why}"),
            format!(
                "is it plugged in (v4l2-ctl --list-devices), may the user alight open it (group video)? Else \
                 correct {key}.source"
            ),
        ),
        Ok(()) if !found.calibrated => FindingTopic(key).warning(
            format!("{source} exists, but its lens is the simulated camera's"),
            format!(
                "calibrate it and write focal_px, centre_px and distortion into [{}] (alight help camera)",
                found.lens
            ),
        ),
        Ok(()) if running => {
            FindingTopic(key).fine(format!("{source} exists, and the drone's process uses it"))
        }
        Ok(()) => FindingTopic(key).fine(format!("{source} is there")),
    }
}

fn camera_view(found: &CameraCheck) -> Option<Finding> {
    let (topic, source) = (FindingTopic(found.key), &found.source);
    let view = match found.view.as_ref()? {
        Ok(view) => view,
        Err(why) => {
            return Some(topic.broken(
                format!("{source}: {why}"),
                format!(
                    "v4l2-ctl --list-formats-ext prints its formats: correct [{}] and [{}]; does another program hold it?",
                    found.key, found.lens
                ),
            ));
        }
    };
    let exposure = match &view.exposure {
        Some(Ok(s)) => format!(
            ", exposed for {:.1} ms with gain {:.0}",
            1e3 * s.exposure_s,
            s.gain
        ),
        Some(Err(why)) => {
            return Some(topic.warning(
                format!("{source} {why}: the camera's own automatic exposure is in use"),
                format!(
                    "v4l2-ctl --list-ctrls prints its controls; expose by its maker's means for less than \
                     {0}.exposure_s and set {0}.exposure_s = 0",
                    found.key
                ),
            ));
        }
        None => String::new(),
    };
    if let Some(mean) = view.dark {
        return Some(topic.warning(
            format!("too dark to see the tags: image mean {mean:.0} of 255{exposure}; the exposure is at its limit"),
            "light the deck, or lay tags that are lit (alight help camera); by day, take the cap off the lens",
        ));
    }
    let Some([contrast, saturation]) = view.tag else {
        return Some(equipment::no_tag(topic, view, &exposure));
    };
    let tag = format!(
        "contrast {:.0} %, saturation {:.0} % on the tag{exposure}",
        100.0 * contrast,
        100.0 * saturation
    );
    Some(if contrast < MIN_CONTRAST {
        topic.warning(
            tag,
            "light the tag, clean the lens, print it matt and black; at full gain a faster lens is needed",
        )
    } else if saturation > MAX_SATURATION {
        topic.warning(
            tag,
            "shade it or print it matt against glare; is the exposure fixed (gain), or metered by another program?",
        )
    } else {
        topic.fine(tag)
    })
}

fn memory(memory: &SharedMemory) -> Vec<Finding> {
    const TOPIC: FindingTopic = FindingTopic("shared memory");
    let mut all = Vec::new();
    match (&memory.writable, memory.free_bytes) {
        (Err(why), _) => all.push(TOPIC.broken(
            format!("no file can be made in /dev/shm: {why}"),
            "mount a tmpfs there, mode 1777",
        )),
        (Ok(()), Some(free)) if free < MEMORY_BYTES => all.push(TOPIC.broken(
            format!(
                "{} MB free in /dev/shm, {} needed",
                free >> 20,
                MEMORY_BYTES >> 20
            ),
            "remove files of other programs, or mount it larger",
        )),
        (Ok(()), Some(free)) => all.push(TOPIC.fine(format!("{} MB free", free >> 20))),
        (Ok(()), None) => all.push(TOPIC.warning("the free memory is not known", "df /dev/shm")),
    }
    all.push(match &memory.directory {
        Ok(path) => TOPIC.fine(format!("{} can be used", path.display())),
        Err(why) => TOPIC.broken(
            why,
            "run this as the user that runs Alight (sudo -u alight), or remove what another user left",
        ),
    });
    all
}

fn no_sensor() -> Finding {
    FindingTopic("sensors").warning(
        "no sensor is configured: there is no estimate",
        "add a table [[sensor.sources]] for each sensor to vessel.toml (alight help sensors)",
    )
}

fn source(found: &SourceCheck) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("sensors");
    let who = format!("{} ({})", found.name, found.connect);
    match &found.received {
        Err(why) => TOPIC.warning(
            format!("{who}: {why}"),
            "is it powered and plugged in, may the user alight open it (group dialout), does another program hold it?",
        ),
        Ok((0, _)) => TOPIC.warning(
            format!("{who}: no data received"),
            "is it powered and plugged in, and does it send there?",
        ),
        Ok((bytes, s)) if s.given.iter().all(|n| *n == 0) && s.newest_s.is_none() => TOPIC.warning(
            format!(
                "{who}: {bytes} bytes and no measurement: {} messages good, {} corrupted, {} of other kinds, {} \
                 without a time",
                s.decoded.good, s.decoded.corrupted, s.decoded.ignored, s.decoded.undated
            ),
            "check its rate and format in vessel.toml, and the messages that it is set to send",
        ),
        Ok((_, s)) => TOPIC.fine(format!(
            "{who}: {} measurements, {} messages corrupted while listening",
            s.given.iter().sum::<u64>(),
            s.decoded.corrupted
        )),
    }
}

fn deck_input(found: &DeckInputCheck) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("deck");
    let input = format!("{}: {}", found.key, found.path);
    match &found.level {
        Err(why) => TOPIC.warning(format!("{input}: {why}"), deck_inputs::REMEDY),
        Ok(active) => TOPIC.fine(format!("{input} holds {}", u8::from(*active))),
    }
}

fn processors(facts: &CheckFacts, drone: bool) -> Vec<Finding> {
    const TOPIC: FindingTopic = FindingTopic("processors");
    let mut all = Vec::new();
    let slow: Vec<&String> = facts.governors.iter().filter(|g| *g != "performance").collect();
    all.push(match slow.first() {
        Some(governor) => TOPIC.warning(
            format!(
                "frequency chosen by {governor}: a plan may take several times longer after an idle period"
            ),
            "echo performance | tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor",
        ),
        None => TOPIC.fine("at full frequency"),
    });
    if drone && facts.processors < 2 {
        all.push(TOPIC.warning(
            "one processor: planner and pilot wait for each other",
            "use a computer with two or more",
        ));
    }
    if drone && !facts.realtime {
        all.push(TOPIC.warning(
            "this user may not ask for real-time priority",
            "the shipped unit permits it (LimitRTPRIO); in a shell: ulimit -r 40",
        ));
    }
    all
}
