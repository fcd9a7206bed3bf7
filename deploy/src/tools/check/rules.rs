//! What is fine, what is worth a warning and what is broken: pure rules over gathered facts.

use alight_shared::transport::radio::RadioConfig;
use serde::Serialize;

use crate::certificates::{Certificate, RENEWAL_DAYS, common_name};
use crate::exit::Exit;
use crate::tools::check::facts::{
    CameraCheck, Computer, Facts, Identity, Port, PortState, Reach, SharedMemory, SourceCheck,
};

/// Shared memory that a drone's processes take, bytes: 7 MB measured with `alight land`; with people
/// who look on, and a start whose predecessor was killed.
const MEMORY_BYTES: u64 = 64 << 20;
/// The system's clock before this was never set: 2025-01-01, s since 1970.
const PLAUSIBLE_S: i64 = 1_735_689_600;
/// Error of a synchronised clock that is worth a warning, s: logs of both computers are compared by it.
const CLOCK_ERROR_S: f64 = 0.1;
/// Bits of a key's file that let others than its owner read or write it.
const OTHERS: u32 = 0o077;
/// Bits with which a group may read, and nothing else.
const GROUP_READS: u32 = 0o040;

/// How bad.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// As it should be.
    Fine,
    /// Works, but not as it should.
    Warning,
    /// Does not work.
    Broken,
}

impl Level {
    /// The worst of what was found.
    pub fn worst(findings: &[Finding]) -> Level {
        findings.iter().map(|f| f.level).max().unwrap_or(Level::Fine)
    }
    /// How a command ends that found nothing worse.
    pub const fn exit(self) -> Exit {
        match self {
            Level::Fine => Exit::Success,
            Level::Warning => Exit::Failed,
            Level::Broken => Exit::Broken,
        }
    }
}

/// One thing that was looked at.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What was looked at.
    pub topic: &'static str,
    /// How bad.
    pub level: Level,
    /// What was found.
    pub found: String,
    /// What to do; empty when fine.
    pub remedy: String,
}

impl Finding {
    /// As it should be.
    pub fn fine(topic: &'static str, found: impl Into<String>) -> Finding {
        Finding {
            topic,
            level: Level::Fine,
            found: found.into(),
            remedy: String::new(),
        }
    }
    /// Works, but not as it should.
    pub fn warning(topic: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Finding {
        Finding {
            topic,
            level: Level::Warning,
            found: found.into(),
            remedy: remedy.into(),
        }
    }
    /// Does not work.
    pub fn broken(topic: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Finding {
        Finding {
            level: Level::Broken,
            ..Finding::warning(topic, found, remedy)
        }
    }
}

/// The findings about `facts`, in the order in which a person mends them.
pub fn judge(facts: &Facts) -> Vec<Finding> {
    let path = facts.config.display();
    let computer = match &facts.computer {
        Ok(computer) => computer,
        Err(why) => {
            return vec![Finding::broken(
                "configuration",
                why,
                format!("correct {path}; the shipped file names every key with its unit and default"),
            )];
        }
    };
    let (side, id, radio) = match computer {
        Computer::Vessel(v) => ("vessel", v.vessel_id, &v.radio),
        Computer::Drone(d) => ("drone", d.bridge.drone_id, &d.radio),
    };
    let mut all = vec![Finding::fine(
        "configuration",
        format!("{path} is a {side}'s, number {id}"),
    )];
    all.extend(clock(facts));
    all.extend(identity(facts, side, id, radio));
    if let Computer::Drone(d) = computer {
        all.extend(hears_vessel(radio, d.bridge.vessel_id));
    }
    all.extend(facts.ports.iter().map(|p| port(p, facts.running)));
    all.extend(facts.dialled.iter().map(|(to, reach)| dialled(to, reach)));
    all.extend(facts.memory.as_ref().map(memory).into_iter().flatten());
    all.extend(facts.autopilot.as_ref().map(|a| autopilot(a, facts.running)));
    all.extend(facts.cameras.iter().map(camera));
    if matches!(computer, Computer::Vessel(_)) {
        all.extend(sensors(facts));
        all.extend(facts.sources.iter().flatten().map(source));
    }
    all.extend(processors(facts, matches!(computer, Computer::Drone(_))));
    all
}

fn clock(facts: &Facts) -> Vec<Finding> {
    const TOPIC: &str = "clock";
    if facts.clock_s < PLAUSIBLE_S {
        return vec![Finding::broken(
            TOPIC,
            "the system's clock was never set: certificates count as not yet valid",
            "connect to a time source once, or add a battery-backed clock",
        )];
    }
    let install = "install chrony and give it a source, the vessel's GNSS receiver for instance; flight itself \
                   does not need it, certificates and the comparison of logs do";
    vec![match &facts.sync {
        None => Finding::warning(
            TOPIC,
            "no program reports whether the clock is synchronised",
            install,
        ),
        Some(s) if !s.synchronised => {
            Finding::warning(TOPIC, format!("{} reports: not synchronised", s.source), install)
        }
        Some(s) => match s.error_s {
            Some(e) if e.abs() > CLOCK_ERROR_S => Finding::warning(
                TOPIC,
                format!("{} reports: {:.0} ms off", s.source, e * 1e3),
                "wait until it has settled, or look at its sources (chronyc sources)",
            ),
            Some(_) | None => Finding::fine(TOPIC, format!("synchronised, reports {}", s.source)),
        },
    }]
}

/// Whether an endpoint stays inside this computer.
fn is_loopback(endpoint: &str) -> bool {
    let host = endpoint.split_once('/').map_or(endpoint, |(_, host)| host);
    host.starts_with("127.") || host.starts_with("localhost:") || host.starts_with("[::1]")
}

fn identity(facts: &Facts, side: &'static str, id: u32, radio: &RadioConfig) -> Vec<Finding> {
    const TOPIC: &str = "certificates";
    let endpoints = || radio.listen.iter().chain(&radio.connect);
    let Some(identity) = &facts.identity else {
        if endpoints().any(|e| e.starts_with("quic/")) {
            return vec![Finding::broken(
                TOPIC,
                "the radio's endpoint is quic/ but radio.tls names no files",
                "make them with alight keys and name them in radio.tls",
            )];
        }
        if endpoints().all(|e| is_loopback(e)) {
            return vec![Finding::fine(
                TOPIC,
                "none, and the radio stays inside this computer",
            )];
        }
        return vec![Finding::warning(
            TOPIC,
            "the radio is not protected: any peer that reaches the port is accepted",
            "use quic/ endpoints with certificates of alight keys, or UDP on an address inside WireGuard only",
        )];
    };
    let mut all = Vec::new();
    if let Some(plain) = endpoints().find(|e| !e.starts_with("quic/")) {
        all.push(Finding::broken(
            TOPIC,
            format!("{plain} is not quic/, and with certificates nothing else is taken"),
            "write the endpoint as quic/HOST:PORT, or remove radio.tls",
        ));
    }
    for certificate in [&identity.authority, &identity.own] {
        all.push(match certificate {
            Ok(certificate) => dates(certificate),
            Err(why) => Finding::broken(
                TOPIC,
                why,
                "copy the directory that alight keys made to the path in radio.tls, readable for the user alight",
            ),
        });
    }
    let wanted = common_name(side, id);
    if let Ok(own) = &identity.own
        && own.name != wanted
    {
        all.push(Finding::broken(
            TOPIC,
            format!(
                "the certificate is {}'s, and the configuration says {wanted}",
                own.name
            ),
            format!("copy the files of {wanted} here, or correct the number"),
        ));
    }
    all.extend(key(identity));
    all
}

fn dates(certificate: &Certificate) -> Finding {
    const TOPIC: &str = "certificates";
    let path = certificate.path.display();
    let renew = "make a new one with alight keys and copy it here";
    match certificate.days_left {
        _ if certificate.in_future => Finding::broken(
            TOPIC,
            format!("{path} is not valid yet by this computer's clock"),
            "set the clock",
        ),
        days if days < 0 => Finding::broken(TOPIC, format!("{path} expired {} days ago", -days), renew),
        days if days < RENEWAL_DAYS => {
            Finding::warning(TOPIC, format!("{path} expires in {days} days"), renew)
        }
        days => Finding::fine(TOPIC, format!("{path}: {}, {days} days left", certificate.name)),
    }
}

fn key(identity: &Identity) -> Vec<Finding> {
    const TOPIC: &str = "key";
    let mut all = Vec::new();
    match (&identity.key, identity.key_mode) {
        (Err(why), _) => all.push(Finding::broken(
            TOPIC,
            why,
            "chown it to the user alight, chmod 600",
        )),
        (Ok(()), Some(mode)) if mode & OTHERS & !GROUP_READS != 0 => all.push(Finding::warning(
            TOPIC,
            format!("others may read or change it (mode {:o})", mode & 0o777),
            "chmod 600",
        )),
        (Ok(()), _) => {}
    }
    if identity.key_fits == Some(false) {
        all.push(Finding::broken(
            TOPIC,
            "it does not belong to the certificate",
            "copy both from the same directory of alight keys",
        ));
    }
    if identity.of_authority == Some(false) {
        all.push(Finding::broken(
            TOPIC,
            "the certificate was made by another authority than the one that is trusted",
            "make all certificates with one authority and copy its authority.pem to both sides",
        ));
    }
    if all.is_empty() {
        all.push(Finding::fine(TOPIC, "fits the certificate"));
    }
    all
}

fn hears_vessel(radio: &RadioConfig, vessel_id: u32) -> Option<Finding> {
    let vessel = common_name("vessel", vessel_id);
    (!radio.tls.authority.is_empty() && !radio.tls.peers.contains(&vessel)).then(|| {
        Finding::broken(
            "vessel",
            format!("{vessel} is not among radio.tls.peers: its messages are rejected"),
            format!("peers = [\"{vessel}\"], or correct bridge.vessel_id"),
        )
    })
}

fn port(port: &Port, running: bool) -> Finding {
    const TOPIC: &str = "ports";
    let what = format!("{} {}", port.key, port.address);
    match &port.state {
        PortState::Free => Finding::fine(TOPIC, format!("{what} is free")),
        PortState::Busy if running => Finding::fine(TOPIC, format!("{what} is taken, and Alight runs")),
        PortState::Busy => Finding::broken(
            TOPIC,
            format!("{what} is taken by another program"),
            "ss -lnptu shows which; stop it, or choose another port on both sides",
        ),
        PortState::Unavailable(why) => Finding::broken(
            TOPIC,
            format!("{what}: {why}"),
            "name an address of this computer (ip address) and a port above 1023",
        ),
        PortState::Untried => Finding::warning(
            TOPIC,
            format!("{what} cannot be tried"),
            "write it as PROTOCOL/ADDRESS:PORT with udp, tcp or quic",
        ),
    }
}

fn dialled(to: &str, reach: &Reach) -> Finding {
    const TOPIC: &str = "vessel";
    match reach {
        Reach::Answers => Finding::fine(TOPIC, format!("{to} answers")),
        Reach::Routed => Finding::fine(
            TOPIC,
            format!("there is a route to {to}; whether it answers shows only in alight status"),
        ),
        Reach::Unreachable(why) => Finding::warning(
            TOPIC,
            format!("{to} does not answer: {why}"),
            "is the vessel's computer on, its radio within reach (ping) and alight-vessel running?",
        ),
    }
}

fn autopilot((url, reach): &(String, Result<Reach, String>), running: bool) -> Finding {
    const TOPIC: &str = "autopilot";
    match reach {
        Ok(Reach::Answers) => Finding::fine(TOPIC, format!("{url} is there")),
        Ok(Reach::Routed) => Finding::fine(
            TOPIC,
            format!("{url} is free; whether the autopilot answers shows only in alight status"),
        ),
        Ok(Reach::Unreachable(why)) if running => {
            Finding::fine(TOPIC, format!("{url} is taken ({why}), and Alight runs"))
        }
        Ok(Reach::Unreachable(why)) => Finding::warning(
            TOPIC,
            format!("{url}: {why}"),
            "is it powered and plugged in, may the user alight open it (group dialout), does another program hold it?",
        ),
        Err(why) => Finding::broken(TOPIC, why, "correct autopilot.connect"),
    }
}

fn camera(found: &CameraCheck) -> Finding {
    let CameraCheck { key, source, .. } = found;
    match &found.there {
        Err(why) => Finding::broken(
            key,
            format!("{source}: {why}"),
            format!(
                "is it plugged in (v4l2-ctl --list-devices), may the user alight open it (group video)? Else \
                 correct {key}.source"
            ),
        ),
        Ok(()) if !found.calibrated => Finding::warning(
            key,
            format!("{source} is there, its lens is the simulated camera's"),
            format!(
                "calibrate it and write focal_px, centre_px and distortion into [{}] (README, A camera)",
                found.lens
            ),
        ),
        Ok(()) => Finding::fine(key, format!("{source} is there")),
    }
}

fn memory(memory: &SharedMemory) -> Vec<Finding> {
    const TOPIC: &str = "shared memory";
    let mut all = Vec::new();
    match (&memory.writable, memory.free_bytes) {
        (Err(why), _) => all.push(Finding::broken(
            TOPIC,
            format!("no file can be made in /dev/shm: {why}"),
            "mount a tmpfs there, mode 1777",
        )),
        (Ok(()), Some(free)) if free < MEMORY_BYTES => all.push(Finding::broken(
            TOPIC,
            format!(
                "{} MB free in /dev/shm, {} needed",
                free >> 20,
                MEMORY_BYTES >> 20
            ),
            "remove what others left there, or mount it larger",
        )),
        (Ok(()), Some(free)) => all.push(Finding::fine(TOPIC, format!("{} MB free", free >> 20))),
        (Ok(()), None) => all.push(Finding::warning(
            TOPIC,
            "the free memory is not known",
            "df /dev/shm",
        )),
    }
    all.push(match &memory.directory {
        Ok(path) => Finding::fine(TOPIC, format!("{} can be used", path.display())),
        Err(why) => Finding::broken(
            TOPIC,
            why,
            "run this as the user that runs Alight (sudo -u alight), or remove what another user left",
        ),
    });
    all
}

fn sensors(facts: &Facts) -> Option<Finding> {
    const TOPIC: &str = "sensors";
    let received = facts.sensors?;
    let missing: Vec<&str> = [
        ("inertial samples", received.imu),
        ("GNSS fixes", received.gnss),
        ("headings", received.heading),
    ]
    .into_iter()
    .filter(|(_, n)| *n == 0)
    .map(|(name, _)| name)
    .collect();
    Some(if received.invalid > 0 {
        Finding::warning(
            TOPIC,
            format!("{} datagrams were not measurements", received.invalid),
            "another program sends to this port, or the driver is of another version",
        )
    } else if missing.is_empty() {
        Finding::fine(
            TOPIC,
            format!(
                "{} inertial samples, {} fixes, {} headings while listening",
                received.imu, received.gnss, received.heading
            ),
        )
    } else {
        Finding::warning(
            TOPIC,
            format!("no {} came while listening", missing.join(", no ")),
            "start the sensors' driver, and look where it sends to",
        )
    })
}

fn source(found: &SourceCheck) -> Finding {
    const TOPIC: &str = "sensors";
    let who = format!("{} ({})", found.name, found.connect);
    match &found.received {
        Err(why) => Finding::warning(
            TOPIC,
            format!("{who}: {why}"),
            "is it powered and plugged in, may the user alight open it (group dialout), does another program hold it?",
        ),
        Ok((0, _)) => Finding::warning(
            TOPIC,
            format!("{who}: nothing came while listening"),
            "is it powered and plugged in, and does it send there?",
        ),
        Ok((bytes, s)) if s.given.iter().all(|n| *n == 0) => Finding::warning(
            TOPIC,
            format!(
                "{who}: {bytes} bytes and no measurement: {} messages good, {} corrupted, {} of other kinds, {} \
                 without a time",
                s.decoded.good, s.decoded.corrupted, s.decoded.ignored, s.decoded.undated
            ),
            "see to its rate and format in vessel.toml, and to the messages that it is set to send",
        ),
        Ok((_, s)) => Finding::fine(
            TOPIC,
            format!(
                "{who}: {} measurements, {} messages corrupted while listening",
                s.given.iter().sum::<u64>(),
                s.decoded.corrupted
            ),
        ),
    }
}

fn processors(facts: &Facts, drone: bool) -> Vec<Finding> {
    const TOPIC: &str = "processors";
    let mut all = Vec::new();
    let slow: Vec<&String> = facts.governors.iter().filter(|g| *g != "performance").collect();
    all.push(match slow.first() {
        Some(governor) => Finding::warning(
            TOPIC,
            format!("frequency chosen by {governor}: a plan may take several times longer after a rest"),
            "echo performance | tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor",
        ),
        None => Finding::fine(TOPIC, "at full frequency"),
    });
    if drone && facts.processors < 2 {
        all.push(Finding::warning(
            TOPIC,
            "one processor: planner and pilot wait for each other",
            "use a computer with two or more",
        ));
    }
    if drone && !facts.realtime {
        all.push(Finding::warning(
            TOPIC,
            "this user may not ask for real-time priority",
            "the shipped unit permits it (LimitRTPRIO); beside it: ulimit -r 40",
        ));
    }
    all
}
