//! `alight sensors` as a process on real sockets, with a boat's sensors at one end and the vessel's process at the
//! other; links and decoders have separate tests.
use std::{
    fs,
    net::UdpSocket,
    path::{Path, PathBuf},
    process::Stdio,
    sync::mpsc::{Receiver, RecvTimeoutError},
    time::Duration,
};

use alight_transport::memory::{Instance, Memory, Services};
use serde_json::Value;

use crate::{
    common::{Running, alight, errors, free_udp, instance, once, run, scratch, service, signal},
    landing::pid,
};

fn sentence(body: &str) -> String {
    let sum = body.bytes().fold(0_u8, |a, b| a ^ b);
    format!("${body}*{sum:02X}\r\n")
}
/// Shared memory of a vessel without its other processes; only `alight sensors` runs, with these sources.
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
        fs::write(&config, format!("instance = \"{name}\"\n{sources}")).unwrap();
        let child = alight(format!("sensors --supervised --config {}", config.display()))
            .stdin(Stdio::piped())
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
    /// Stops the process as systemd does: both signals are pending, the request to end and the kill that follows.
    pub fn assert_stops(mut self) {
        let program = &mut self.program.0;
        for name in ["-STOP", "-TERM", "-CONT"] {
            signal(program.id().into(), name);
        }
        let mut ended = None;
        for _ in 0..200 {
            ended = program.try_wait().unwrap();
            if ended.is_some() {
                break;
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        assert_eq!(ended.and_then(|e| e.code()), Some(0));
    }
}

impl Drop for Sensors {
    fn drop(&mut self) {
        drop(self.program.0.stdin.take());
        let _ended = self.program.0.wait();
        let _left = self.instance.wipe();
        let _left = fs::remove_dir_all(self.instance.directory());
        let _left = fs::remove_file(&self.config);
    }
}

/// Output of `alight status` on the vessel once `wanted` is true.
fn status_when(config: &Path, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
    let look = || {
        let out = run(format!("status --json --config {}", config.display()));
        serde_json::from_slice(&out.stdout).unwrap_or(Value::Null)
    };
    once(what, look, wanted)
}

/// Sends the sentences of a mast without a pause, one in ten damaged, until ended.
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
        // There is no receiver while the process restarts.
        let _missed = socket.send_to(all.as_bytes(), to);
        k += 1;
    }
}

#[test]
fn vessel_process_with_its_sensors() {
    let udp = free_udp();
    let radio = free_udp();
    let directory = scratch("sensors-vessel");
    fs::create_dir_all(&directory).unwrap();
    let config = directory.join("vessel.toml");
    let flights = directory.join("flights");
    let text = format!(
        "instance = \"{}\"\n[radio]\nlisten = [\"udp/{radio}\"]\n[recorder]\ndirectory = \"{}\"\n\
         [[sensor.sources]]\nname = \"mast\"\nconnect = \"udpin://{udp}\"\n\
         [[sensor.sources]]\nname = \"spare\"\nconnect = \"serial:///dev/none:9600\"\n",
        instance("mast"),
        flights.display()
    );
    fs::write(&config, text).unwrap();
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
    // A frozen process is killed and restarted.
    let good = |status: &Value| {
        status["sources"][0]["status"]["decoded"]["good"]
            .as_u64()
            .unwrap_or(0)
    };
    let killed = pid(&status, "sensors").expect("it runs");
    let before = good(&status);
    signal(killed, "-STOP");
    status_when(
        &config,
        "another process has decoded more than the killed one",
        |status| pid(status, "sensors").is_some_and(|now| now != killed) && good(status) > before + 100,
    );
    // The sensors' process ends with the vessel's process.
    assert!(program.stop(), "it was killed");
    assert!(
        (0..100).any(|_| {
            std::thread::sleep(Duration::from_millis(50));
            UdpSocket::bind(&udp).is_ok()
        }),
        "the sensors' process still runs"
    );
    end.send(()).unwrap();
    mast.join().unwrap();
    // Replays of both starts of the sensors, including the killed one, compute the same measurements.
    let flight = fs::read_dir(&flights).unwrap().flatten().next().unwrap();
    let replay = run(format!("replay {} --json", flight.path().display()));
    assert!(replay.status.success(), "{}", errors(&replay));
    let replay: Value = serde_json::from_slice(&replay.stdout).unwrap();
    let of_sensors = |n: &&Value| n["node"].as_str().is_some_and(|n| n.starts_with("sensors-"));
    let starts: Vec<&Value> = replay["nodes"]
        .as_array()
        .unwrap()
        .iter()
        .filter(of_sensors)
        .collect();
    assert!(
        starts.len() == 2 && starts.iter().all(|n| n["steps"].as_u64() > Some(20)),
        "{replay}"
    );
    fs::remove_dir_all(directory).unwrap();
}
