//! `alight sensors` as a process on real sockets: a boat's sensors at one end, the vessel's process at the
//! other. Nothing here asserts a time: bounds on waiting are only against tests that never end.
use std::io::{Read, Write};
use std::net::{TcpListener, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

use alight_shared::msg::{SensorReadings, SourceReport, SourceStatus};
use alight_transport::memory::{Instance, Memory, Services};
use alight_usv::sensors::Readings;
use serde_json::Value;

use crate::common::{Running, alight, errors, free_udp, instance, run, scratch, service, signal};
use crate::landing::pid;

fn sentence(body: &str) -> String {
    let sum = body.bytes().fold(0_u8, |a, b| a ^ b);
    format!("${body}*{sum:02X}\r\n")
}
/// A vessel's memory without its other processes, and `alight sensors` with these sources in it.
pub struct Sensors {
    program: Running,
    pub memory: Memory,
    _services: Services,
    instance: Instance,
    config: PathBuf,
}

impl Sensors {
    pub fn start(name: &str, sources: &str) -> Sensors {
        let name = instance(name);
        let instance = Instance::new(&name).unwrap();
        instance.wipe().unwrap();
        let memory = Memory::join(&instance, "test").unwrap();
        let services = Services::create(&memory).unwrap();
        let config = scratch(&format!("{name}.toml"));
        std::fs::write(&config, format!("instance = \"{name}\"\n{sources}")).unwrap();
        let child = alight(format!("sensors --supervised --config {}", config.display()))
            .stdin(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program runs");
        Sensors {
            program: Running(child),
            memory,
            _services: services,
            instance,
            config,
        }
    }
}

impl Drop for Sensors {
    fn drop(&mut self) {
        drop(self.program.0.stdin.take());
        let _ended = self.program.0.wait();
        let _left = self.instance.wipe();
        let _left = std::fs::remove_dir_all(self.instance.directory());
        let _left = std::fs::remove_file(&self.config);
    }
}

#[test]
fn sensor_process_nmea_over_udp_and_tcp() {
    let (udp, tcp) = (free_udp(), TcpListener::bind("127.0.0.1:0").unwrap());
    let sources = format!(
        "[[sensor.sources]]\nname = \"receiver\"\nconnect = \"udpin://{udp}\"\n\
         [[sensor.sources]]\nname = \"motion\"\nconnect = \"tcpout://{}\"\n",
        tcp.local_addr().unwrap()
    );
    let sensors = Sensors::start("nmea", &sources);
    let mut readings = sensors.memory.subscriber::<SensorReadings>().unwrap();
    let mut reports = sensors.memory.subscriber::<SourceReport>().unwrap();
    let (mut motion, _) = tcp.accept().unwrap();
    let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut all = Readings::default();
    for k in 0..2000 {
        let time = format!("12{:02}{:02}.{:02}", k / 6000, (k / 100) % 60, k % 100);
        let gga = sentence(&format!(
            "GPGGA,{time},5000.0000,N,01430.0000,E,4,12,0.8,210.0,M,45.0,M,1.0,0001"
        ));
        receiver.send_to(gga.as_bytes(), &udp).unwrap();
        let pashr = sentence(&format!("PASHR,{time},90.0,T,2.00,-1.00,0.25,0.1,0.1,0.2,2,1"));
        motion.write_all(pashr.as_bytes()).unwrap();
        if k % 10 == 0 {
            motion.write_all(b"$PASHR,damaged*00\r\n").unwrap();
        }
        std::thread::sleep(Duration::from_millis(5));
        readings.all(0).iter().for_each(|m| all.append(m));
        if all.gnss.len() >= 20 && all.attitude.len() >= 20 && all.heading.len() >= 20 {
            break;
        }
    }
    assert!(all.gnss.len() >= 20 && all.attitude.len() >= 20, "{all:?}");
    // The first source's are 0, the second's 2.
    assert!(all.gnss.iter().all(|g| g.source == 0) && all.attitude.iter().all(|a| a.source == 2));
    assert!((all.attitude[0].tilt[0] - 2_f64.to_radians()).abs() < 1e-6);
    // In the order of the sensor's own times. They are sent faster than they are dated here, so how
    // exactly is for the clock's own tests.
    for w in all.attitude.windows(2) {
        assert!(w[1].header.at >= w[0].header.at, "{w:?}");
    }
    let mut newest = [None, None];
    for _ in 0..200 {
        for report in reports.all(0) {
            newest[report.number as usize] = Some(report.status);
        }
        let given = |s: SourceStatus| s.given[1] >= 20;
        let corrupted = |s: SourceStatus| s.decoded.corrupted >= 2;
        if newest[0].is_some_and(given) && newest[1].is_some_and(corrupted) {
            return;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    panic!("{newest:?}");
}

#[test]
fn sensor_process_stopped_as_by_systemd() {
    let source = format!(
        "[[sensor.sources]]\nname = \"receiver\"\nconnect = \"udpin://{}\"\n",
        free_udp()
    );
    let mut sensors = Sensors::start("stopped", &source);
    let program = &mut sensors.program;
    // Its first line comes before it waits.
    let mut first = [0];
    program.0.stderr.as_mut().unwrap().read_exact(&mut first).unwrap();
    std::thread::sleep(Duration::from_millis(300));
    // Both signals wait for it, the one that asks it to end and the one that follows.
    let pid = program.0.id().into();
    for name in ["-STOP", "-TERM", "-CONT"] {
        signal(pid, name);
    }
    let mut ended = None;
    for _ in 0..200 {
        ended = program.0.try_wait().unwrap();
        if ended.is_some() {
            break;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    assert_eq!(ended.and_then(|e| e.code()), Some(0));
}

/// Output of `alight status` on the vessel once `wanted` is true.
fn status_when(config: &Path, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
    let mut last = Value::Null;
    for _ in 0..400 {
        let out = run(format!("status --json --config {}", config.display()));
        last = serde_json::from_slice(&out.stdout).unwrap_or(Value::Null);
        if wanted(&last) {
            return last;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    panic!("{what}: not within its time: {last}");
}

/// Sends as a mast that never falls silent, and damages one sentence in ten, until it is ended.
fn send_sentences(to: &str, ended: &Receiver<()>) {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut k = 0;
    while ended.recv_timeout(Duration::from_millis(50)) == Err(RecvTimeoutError::Timeout) {
        let time = format!("12{:02}{:02}.{:02}", k / 1200, (k / 20) % 60, 5 * (k % 20));
        let all = sentence(&format!("PASHR,{time},90.0,T,2.00,-1.00,0.25,0.1,0.1,0.2,2,1"))
            + &sentence(&format!(
                "GPGGA,{time},5000.0000,N,01430.0000,E,4,12,0.8,210.0,M,45.0,M,1.0,0001"
            ))
            + if k % 10 == 0 { "$PASHR,damaged*00\r\n" } else { "" };
        // There is no receiver while the process is started again.
        let _missed = socket.send_to(all.as_bytes(), to);
        k += 1;
    }
}

#[test]
fn vessel_process_with_its_sensors() {
    let (udp, radio) = (free_udp(), free_udp());
    let directory = scratch("sensors-vessel");
    std::fs::create_dir_all(&directory).unwrap();
    let config = directory.join("vessel.toml");
    let text = format!(
        "instance = \"{}\"\n[radio]\nlisten = [\"udp/{radio}\"]\n[[sensor.sources]]\nname = \"mast\"\n\
         connect = \"udpin://{udp}\"\n[[sensor.sources]]\nname = \"spare\"\nconnect = \"serial:///dev/none:9600\"\n",
        instance("mast")
    );
    std::fs::write(&config, text).unwrap();
    let mut program = service("vessel", &directory, &[]);
    let (end, ended) = std::sync::mpsc::channel();
    let to = udp.clone();
    let mast = std::thread::spawn(move || send_sentences(&to, &ended));
    let is_fresh = |s: &Value| s["age_s"].as_f64().is_some_and(|age| age < 1.0);
    let status = status_when(&config, "the mast's measurements are used", |status| {
        let s = &status["sources"][0];
        s["used"].as_u64() > Some(20) && s["status"]["decoded"]["corrupted"].as_u64() > Some(1) && is_fresh(s)
    });
    let sources = &status["sources"];
    assert_eq!(
        (&sources[0]["name"], &sources[1]["name"]),
        (&"mast".into(), &"spare".into())
    );
    assert!(
        sources[0]["status"]["decoded"]["good"].as_u64() > Some(20),
        "{sources}"
    );
    assert!(
        sources[1]["why"]
            .as_str()
            .is_some_and(|w| w.contains("/dev/none")),
        "{sources}"
    );
    let findings = status["findings"].as_array().unwrap();
    let of = |name: &str| {
        let found = |f: &&Value| f["found"].as_str().is_some_and(|t| t.starts_with(name));
        findings
            .iter()
            .find(found)
            .unwrap_or_else(|| panic!("{name}: {status}"))
    };
    assert_eq!(
        (&of("mast: ")["level"], &of("spare: ")["level"]),
        (&"fine".into(), &"warning".into())
    );
    // One that stands still is killed and started again.
    let killed = pid(&status, "sensors").expect("it runs");
    signal(killed, "-STOP");
    status_when(&config, "another process reads the mast", |status| {
        pid(status, "sensors").is_some_and(|now| now != killed) && is_fresh(&status["sources"][0])
    });
    // With the vessel's process its sensors' ends too.
    assert!(program.stop(), "it was killed");
    assert!(
        (0..100).any(|_| {
            std::thread::sleep(Duration::from_millis(50));
            UdpSocket::bind(&udp).is_ok()
        }),
        "the sensors' process is left"
    );
    end.send(()).unwrap();
    mast.join().unwrap();
    std::fs::remove_dir_all(directory).unwrap();
}

#[test]
fn sensor_process_exit_code_2() {
    for (name, text, part) in [
        ("none", "", "[[sensor.sources]]"),
        (
            "url",
            "[[sensor.sources]]\nconnect = \"nmea://mast\"\n",
            "nmea://mast",
        ),
        ("format", "[[sensor.sources]]\nformat = \"seatalk\"\n", "seatalk"),
        ("range", "[[sensor.sources]]\nlatency_s = 9.0\n", "latency_s"),
        (
            "arm",
            "[[sensor.sources]]\n[sensor.sources.mount]\nantenna_m = [0.0, 0.0, -900.0]\n",
            "antenna_m",
        ),
    ] {
        let config = scratch(&format!("sensors-{name}.toml"));
        std::fs::write(&config, text).unwrap();
        let out = run(format!("sensors --config {}", config.display()));
        std::fs::remove_file(config).unwrap();
        assert_eq!(out.status.code(), Some(2), "{name}: {}", errors(&out));
        assert!(errors(&out).contains(part), "{name}: {}", errors(&out));
    }
}
