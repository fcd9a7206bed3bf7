use std::{
    fs::{self, OpenOptions},
    io::ErrorKind,
    net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs, UdpSocket},
    os::unix::fs::{FileTypeExt, PermissionsExt},
    path::{Path, PathBuf},
    process::Command,
    time::Duration,
};

use alight_computer::{
    certificates,
    config::{DroneComputerConfig, VesselComputerConfig, camera::CameraSource, link_url::LinkUrl, method},
    exit::{CliError, Doing},
    io::{digital_line::DigitalLine, mavlink_key},
    process::{
        flight::{ATTITUDE_DEAD_TIME, ATTITUDE_LAG},
        instance,
        observer::Observer,
        scheduling,
        snapshot::Snapshot,
    },
    record::flight::store,
    subject::Computer,
    vessel::deck_inputs,
};
use alight_shared::{mavlink::Signatures, process::ProcessKind};
use alight_transport::{
    clock::steady_ns,
    memory::{Instance, Memory},
    radio::{RadioConfig, TlsConfig},
};
use alight_uav::camera::{Lens, uvdar::Fisheye};

use crate::tools::check::{
    autopilot, camera,
    facts::{
        CameraCheck, CheckFacts, ClockSync, DeckInputCheck, Identity, Port, PortState, Reach, SharedMemory,
        SigningCheck,
    },
    received::SensorStatistics,
    receiver, sources,
};

const TIMEOUT: Duration = Duration::from_secs(2);
const OBSERVATION_TIME: Duration = Duration::from_millis(1500);
const MAX_PROCESSORS: usize = 1024;

/// Facts about this computer and the configuration at `path`, whose processes may run as another `instance`.
pub fn gather(path: &Path, instance: Option<&str>) -> CheckFacts {
    let computer = configured(path).map(|c| c.named(instance));
    let computer = computer.map_err(|e| e.to_string());
    let mut facts = CheckFacts {
        config: path.into(),
        running: false,
        identity: None,
        zenoh: None,
        clock_s: certificates::today_s(),
        sync: sync(),
        memory: None,
        ports: Vec::new(),
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
        governors: governors(),
        realtime: scheduling::real_time_permitted(),
        processors: std::thread::available_parallelism().map_or(1, usize::from),
        computer: Err(String::new()),
    };
    match &computer {
        Ok(Computer::Vessel(v)) => facts.vessel(path, v),
        Ok(Computer::Drone(d)) => facts.drone(d),
        Err(_) => {}
    }
    facts.computer = computer;
    facts
}

fn configured(path: &Path) -> Result<Computer, CliError> {
    let computer = Computer::read(path)?;
    let text = fs::read_to_string(path).doing(format_args!("reading {}", path.display()))?;
    method::check_flight(&text, &path.display().to_string())?;
    Ok(computer)
}

/// Dead time and time constant of the attitude response, s, from the newest recorded flight that identified them.
fn flown(directory: &str) -> Option<[f64; 2]> {
    // Without a recorder no flight is recorded; `alight flights` reports a directory that cannot be read.
    let flights = store::flights(Path::new(directory)).unwrap_or_default();
    flights.iter().rev().find_map(|f| {
        let metrics = f.summary()?.figures;
        let of = |name: &str| metrics.get(name).copied();
        Some([of(ATTITUDE_DEAD_TIME)?, of(ATTITUDE_LAG)?])
    })
}

fn snapshot(instance: &Instance) -> Option<Snapshot> {
    let memory = Memory::join(instance, "check").ok()?;
    let mut observer = Observer::join(&memory).ok()?;
    memory.wait(OBSERVATION_TIME);
    observer.poll();
    Some(observer.snapshot)
}

/// Configured cameras: examined here, or as reported by the process that owns them.
fn cameras(d: &DroneComputerConfig, running: Option<&Snapshot>) -> Vec<CameraCheck> {
    let settings = &d.drone.camera;
    let (tag, markers) = (&settings.lens, &settings.uvdar.lens);
    let tags = d.drone.tags();
    let check = |key, lens, calibrated, config: &CameraSource, kind, size: [u32; 2], tag| {
        let there = if config.is_simulation() {
            Ok(())
        } else {
            readable(&config.source)
        };
        let view = match (&there, running) {
            (Err(_), _) => None,
            (Ok(()), Some(snapshot)) => snapshot.processes.get(&kind).map(|p| Ok(camera::reported(p))),
            (Ok(()), None) if config.is_simulation() || is_pipe(&config.source) => None,
            (Ok(()), None) => Some(camera::look(config, size.map(|s| s as usize), tag)),
        };
        CameraCheck {
            key,
            lens,
            source: config.source.clone(),
            there,
            calibrated,
            view,
        }
    };
    let belly = || {
        let (size, calibrated) = ([tag.width_px, tag.height_px], *tag != Lens::default());
        let lens = "drone.camera.lens";
        check(
            "camera",
            lens,
            calibrated,
            &d.camera,
            ProcessKind::Camera,
            size,
            Some((&settings.tag, &tags)),
        )
    };
    let ultraviolet = d.ultraviolet();
    let uvdar = || {
        let (size, calibrated) = (
            [markers.width_px, markers.height_px],
            *markers != Fisheye::default(),
        );
        let lens = "drone.camera.uvdar.lens";
        check(
            "uvdar",
            lens,
            calibrated,
            &ultraviolet,
            ProcessKind::Uvdar,
            size,
            None,
        )
    };
    let found = [
        d.camera.is_there().then(belly),
        ultraviolet.is_there().then(uvdar),
    ];
    found.into_iter().flatten().collect()
}

/// Whether `name` is a named pipe: opening it blocks without a writer, and reading it removes bytes of its images.
fn is_pipe(name: &str) -> bool {
    fs::metadata(name).is_ok_and(|meta| meta.file_type().is_fifo())
}

fn readable(name: &str) -> Result<(), String> {
    if is_pipe(name) {
        return Ok(());
    }
    fs::File::open(name).map(drop).map_err(|e| e.to_string())
}

impl CheckFacts {
    fn vessel(&mut self, path: &Path, v: &VesselComputerConfig) {
        let instance = Instance::new(&v.instance);
        self.running = instance.as_ref().is_ok_and(instance::is_running);
        self.radio(&v.radio);
        let inputs = deck_inputs::configured(&v.deck).into_iter();
        self.deck_inputs = inputs
            .filter(|(_, path)| !path.is_empty())
            .map(|(key, path)| (key, path, DigitalLine::new(path)))
            // A running process owns these inputs and reports those that it cannot read.
            .filter(|(_, _, line)| !(self.running && line.is_exclusive()))
            .map(|(key, path, mut line)| DeckInputCheck {
                key,
                path: path.into(),
                level: line.read(),
            })
            .collect();
        let running = instance.as_ref().ok().filter(|_| self.running);
        let snapshot = running.and_then(snapshot);
        let (held, received) = sources::of(path, v, snapshot.as_ref());
        self.held_sources = held;
        (self.sources, self.measured) = (received.sources, received.measured);
        self.memory = Some(memory(instance.map_err(|e| e.to_string())));
    }
    fn drone(&mut self, d: &DroneComputerConfig) {
        let instance = Instance::new(&d.instance);
        self.running = instance.as_ref().is_ok_and(instance::is_running);
        self.radio(&d.radio);
        let running = instance.as_ref().ok().filter(|_| self.running);
        let snapshot = running.and_then(snapshot);
        if d.supervision.autopilot {
            self.autopilot(d, snapshot.as_ref());
            self.receiver = receiver::of(d, self.running, snapshot.as_ref());
        }
        self.frame = snapshot.as_ref().and_then(Snapshot::frame);
        self.vessel_deck = snapshot.as_ref().and_then(|s| (*s.grant)?.dimensions);
        self.flown = flown(&d.recorder.directory);
        self.cameras = cameras(d, snapshot.as_ref());
        self.memory = Some(memory(instance.map_err(|e| e.to_string())));
    }
    fn autopilot(&mut self, d: &DroneComputerConfig, snapshot: Option<&Snapshot>) {
        let name = d.autopilot.connect.clone();
        let url: Result<LinkUrl, String> = name.parse();
        let reach = url.as_ref().map(reach_autopilot).map_err(Clone::clone);
        // A running process owns the link and counts its frames.
        let link = snapshot.and_then(|s| s.processes.get(&ProcessKind::Autopilot));
        let mut received = link.map_or_else(Signatures::default, |p| mavlink_key::counts(&p.metrics));
        self.reported = match (&url, &reach) {
            (Ok(url), Ok(Reach::Answers | Reach::Routed)) if !self.running => {
                Some(autopilot::report(d, url, &mut received))
            }
            (_, _) => None,
        };
        let state = snapshot.and_then(|s| s.autopilot.fresh(steady_ns()));
        let admitted = state.is_some() || matches!(self.reported, Some(Some(_)));
        self.signing = Some(signing(&d.autopilot.signing_key, received, admitted));
        self.autopilot = Some((name, reach));
    }
    fn radio(&mut self, radio: &RadioConfig) {
        if !radio.tls.authority.is_empty() {
            self.identity = Some(identity(&radio.tls));
        }
        self.zenoh = radio.check_zenoh().err().map(|e| e.to_string());
        self.ports = radio
            .listen
            .iter()
            .map(|e| Port {
                key: "radio.listen",
                address: e.clone(),
                state: try_listening(e),
            })
            .collect();
        self.dialled = radio.connect.iter().map(|e| (e.clone(), reach(e))).collect();
    }
}

fn signing(path: &str, received: Signatures, admitted: bool) -> SigningCheck {
    let key = mavlink_key::read("autopilot.signing_key", path).map_err(|e| e.to_string());
    SigningCheck {
        path: path.to_owned(),
        key: key.map(|_| fs::metadata(path).map_or(0, |m| m.permissions().mode())),
        received,
        admitted,
    }
}

fn identity(tls: &TlsConfig) -> Identity {
    let [authority, own] = [&tls.authority, &tls.certificate].map(|file| {
        let path = Path::new(file);
        certificates::read_certificate(path).map_err(|e| e.to_string())
    });
    let key = fs::read_to_string(&tls.key).map_err(|e| format!("reading {}: {e}", tls.key));
    let key_mode = fs::metadata(&tls.key).ok().map(|m| m.permissions().mode());
    let key_fits = match (&own, &key) {
        (Ok(own), Ok(key)) => Some(certificates::key_matches(key, own)),
        (_, _) => None,
    };
    let of_authority = match (&own, &authority) {
        (Ok(own), Ok(authority)) => certificates::is_signed_by(own, authority),
        (_, _) => None,
    };
    Identity {
        authority: authority.map(|l| l.certificate),
        own: own.map(|l| l.certificate),
        key: key.map(|_| ()),
        key_mode,
        key_fits,
        of_authority,
    }
}

/// Protocol and address of an endpoint such as `udp/0.0.0.0:7447?...#...`.
fn endpoint(text: &str) -> Option<(&str, &str)> {
    let (protocol, address) = text.split_once('/')?;
    let address = address.split(['?', '#']).next()?;
    matches!(protocol, "udp" | "tcp" | "quic").then_some((protocol, address))
}

fn port_state(e: &std::io::Error) -> PortState {
    if e.kind() == ErrorKind::AddrInUse {
        PortState::Busy
    } else {
        PortState::Unavailable(e.to_string())
    }
}

fn try_listening(text: &str) -> PortState {
    let tried = match endpoint(text) {
        None => return PortState::Untried,
        Some(("udp" | "quic", address)) => UdpSocket::bind(address).map(|_| ()),
        Some((_, address)) => TcpListener::bind(address).map(|_| ()),
    };
    tried.map_or_else(|e| port_state(&e), |()| PortState::Free)
}

fn reach(text: &str) -> Reach {
    let Some((protocol, address)) = endpoint(text) else {
        return Reach::Unreachable("not PROTOCOL/ADDRESS:PORT with udp, tcp or quic".into());
    };
    let found = address
        .to_socket_addrs()
        .map_err(|e| e.to_string())
        .and_then(|mut all| all.next().ok_or_else(|| "no such host".to_owned()));
    let result = found.and_then(|to| {
        match protocol {
            "udp" => routed(to).map(|_| Reach::Routed),
            "quic" => routed(to).and_then(|s| speaks_quic(&s)).map(|()| Reach::Answers),
            _ => TcpStream::connect_timeout(&to, TIMEOUT).map(|_| Reach::Answers),
        }
        .map_err(|e| e.to_string())
    });
    result.unwrap_or_else(Reach::Unreachable)
}

fn routed(to: SocketAddr) -> std::io::Result<UdpSocket> {
    let any = if to.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
    let socket = UdpSocket::bind(any)?;
    socket.connect(to)?;
    Ok(socket)
}

/// Whether a QUIC server answers. A server answers an unknown version with its supported versions (RFC 9000, section
/// 6.1), without a handshake and without counting a rejected peer. The query is sent three times, because a radio
/// loses packets.
fn speaks_quic(socket: &UdpSocket) -> std::io::Result<()> {
    // Long header, a version reserved for this (0x?a?a?a?a), two connection identifiers of 8 bytes. Servers ignore
    // datagrams below 1200 bytes.
    let mut hello = vec![0u8; 1200];
    let header = [
        &[0xc0, 0x0a, 0x0a, 0x0a, 0x0a, 8][..],
        b"alight-d",
        &[8],
        b"alight-s",
    ]
    .concat();
    hello.splice(..header.len(), header);
    socket.set_read_timeout(Some(TIMEOUT / 3))?;
    let mut answer = [0u8; 1500];
    let silent = format!("no QUIC server answered within {} s", TIMEOUT.as_secs());
    let mut last = std::io::Error::new(ErrorKind::TimedOut, silent);
    for _ in 0..3 {
        let read = socket.send(&hello).and_then(|_| socket.recv(&mut answer));
        match read {
            Ok(n) if n >= 7 && answer[0] & 0x80 != 0 && answer[1..5] == [0; 4] => return Ok(()),
            Ok(_) => {}
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(e) => last = e,
        }
    }
    Err(last)
}

fn reach_autopilot(url: &LinkUrl) -> Reach {
    let bound = |tried: std::io::Result<()>| {
        tried.map_or_else(|e| Reach::Unreachable(e.to_string()), |()| Reach::Routed)
    };
    match url {
        LinkUrl::UdpIn(at, _) => bound(UdpSocket::bind(at.as_str()).map(drop)),
        LinkUrl::TcpIn(at, _) => bound(TcpListener::bind(at.as_str()).map(drop)),
        LinkUrl::UdpOut(to) => reach(&format!("udp/{to}")),
        LinkUrl::TcpOut(to) => reach(&format!("tcp/{to}")),
        LinkUrl::Serial(path, _) => match OpenOptions::new().read(true).write(true).open(path) {
            Ok(_) => Reach::Answers,
            Err(e) => Reach::Unreachable(e.to_string()),
        },
        LinkUrl::Can(_) | LinkUrl::SignalK(..) => Reach::Unreachable("not an autopilot's link".into()),
    }
}

fn memory(instance: Result<Instance, String>) -> SharedMemory {
    let probe = PathBuf::from(format!("/dev/shm/alight-check-{}", std::process::id()));
    let writable = fs::write(&probe, [0_u8; 4096]).map_err(|e| e.to_string());
    let _none = fs::remove_file(&probe);
    let directory = instance.and_then(|i| {
        let path = i.directory();
        let doing = |e| format!("{} cannot be used: {e}", path.display());
        let probe = path.join(format!("check-{}", std::process::id()));
        if !path.exists() {
            // The program creates this directory, so its parent must be writable.
            fs::create_dir(&path).map_err(doing)?;
            let _left = fs::remove_dir(&path);
            return Ok(path);
        }
        fs::write(&probe, "").map_err(doing)?;
        let _left = fs::remove_file(&probe);
        Ok(path)
    });
    SharedMemory {
        free_bytes: rustix::fs::statvfs("/dev/shm")
            .ok()
            .map(|s| s.f_bavail * s.f_frsize),
        writable,
        directory,
    }
}

fn command_output(program: &str, args: &[&str]) -> Option<String> {
    let out = Command::new(program)
        .args(args)
        .env("LC_ALL", "C")
        .output()
        .ok()?;
    out.status
        .success()
        .then(|| String::from_utf8_lossy(&out.stdout).into_owned())
}

fn sync() -> Option<ClockSync> {
    if let Some(text) = command_output("chronyc", &["-c", "tracking"])
        && let Some(found) = chrony(&text)
    {
        return Some(found);
    }
    let text = command_output("timedatectl", &["show", "-p", "NTPSynchronized", "--value"])?;
    Some(ClockSync {
        source: "timedatectl",
        synchronised: text.trim() == "yes",
        error_s: None,
    })
}

/// Result of `chronyc -c tracking`: field 3 is the stratum (0: none), field 7 the root mean square of the recent
/// offsets, s, field 14 the leap status (Not synchronised).
fn chrony(text: &str) -> Option<ClockSync> {
    let fields: Vec<&str> = text.trim().split(',').collect();
    let stratum: u32 = fields.get(2)?.parse().ok()?;
    let unsynchronised = fields.get(13).is_some_and(|leap| leap.starts_with("Not"));
    Some(ClockSync {
        source: "chrony",
        synchronised: stratum > 0 && !unsynchronised,
        error_s: fields.get(6)?.parse().ok(),
    })
}

fn governors() -> Vec<String> {
    (0..MAX_PROCESSORS)
        .map_while(|k| {
            let path = format!("/sys/devices/system/cpu/cpu{k}/cpufreq/scaling_governor");
            fs::read_to_string(path).ok()
        })
        .map(|text| text.trim().to_owned())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clock_check_of_chrony_tracking() {
        let good = "A29FC87B,162.159.200.123,4,1700000000.1,0.000012,0.000003,0.000210,-7.6,0.0,0.05,0.01,0.001,64.5,Normal\n";
        let s = chrony(good).unwrap();
        assert!(s.synchronised && s.error_s == Some(0.00021));
        let none = "7F7F0101,,0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,1.0,1.0,0.0,Not synchronised\n";
        assert!(!chrony(none).unwrap().synchronised);
        assert!(chrony("506 Cannot talk to daemon").is_none());
    }

    #[test]
    fn reachability_check_of_quic_servers() {
        // Bytes after the header of a version negotiation are ignored.
        for (answer, found) in [
            (&[0x9f, 0, 0, 0, 0, 8, 1, 2, 3][..], true),
            (&b"220 welcome"[..], false),
        ] {
            let server = UdpSocket::bind("127.0.0.1:0").unwrap();
            let endpoint = format!("quic/{}", server.local_addr().unwrap());
            let answering = std::thread::spawn(move || {
                let mut question = [0; 1500];
                for _ in 0..if found { 1 } else { 3 } {
                    let (length, from) = server.recv_from(&mut question).unwrap();
                    assert_eq!((length, &question[1..5]), (1200, &[0x0a; 4][..]));
                    server.send_to(answer, from).unwrap();
                }
            });
            assert_eq!(reach(&endpoint) == Reach::Answers, found);
            answering.join().unwrap();
        }
        let silent = UdpSocket::bind("127.0.0.1:0").unwrap();
        let endpoint = format!("quic/{}", silent.local_addr().unwrap());
        let why = "no QUIC server answered within 2 s".to_owned();
        assert_eq!(reach(&endpoint), Reach::Unreachable(why));
    }

    #[test]
    fn port_check_of_used_and_foreign_addresses() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let taken = format!("udp/{}", socket.local_addr().unwrap());
        assert_eq!(try_listening(&taken), PortState::Busy);
        drop(socket);
        assert_eq!(try_listening(&taken), PortState::Free);
        // TEST-NET-1: an address without a computer.
        assert!(matches!(
            try_listening("quic/192.0.2.1:7447"),
            PortState::Unavailable(_)
        ));
        assert_eq!(try_listening("serial/dev/ttyUSB0"), PortState::Untried);
    }
}
