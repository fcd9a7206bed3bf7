//! `alight sensors` as a process on real sockets: a boat's sensors at one end, the vessel's process at the
//! other. Nothing here asserts a time: bounds on waiting are only against tests that never end.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic
)]

use std::io::{Read, Write};
use std::net::{TcpListener, UdpSocket};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use alight_shared::wire;
use alight_usv::sensors::Readings;

struct Program(Child);

impl Drop for Program {
    fn drop(&mut self) {
        drop(self.0.stdin.take());
        let _ended = self.0.wait();
    }
}

fn sentence(body: &str) -> String {
    let sum = body.bytes().fold(0_u8, |a, b| a ^ b);
    format!("${body}*{sum:02X}\r\n")
}
fn free_udp() -> String {
    UdpSocket::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .to_string()
}

#[test]
fn sentences_over_udp_and_tcp_become_measurements_of_their_own_times() {
    let vessel = UdpSocket::bind("127.0.0.1:0").unwrap();
    vessel.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let (udp, tcp) = (free_udp(), TcpListener::bind("127.0.0.1:0").unwrap());
    let config = std::env::temp_dir().join(format!("alight-sensors-{}.toml", std::process::id()));
    let text = format!(
        "sensors = \"{}\"\n[[sensor.sources]]\nname = \"receiver\"\nconnect = \"udpin://{udp}\"\n\
         [[sensor.sources]]\nname = \"motion\"\nconnect = \"tcpout://{}\"\n",
        vessel.local_addr().unwrap(),
        tcp.local_addr().unwrap()
    );
    std::fs::write(&config, text).unwrap();
    let child = Command::new(env!("CARGO_BIN_EXE_alight"))
        .args(["sensors", "--supervised", "--json", "--config"])
        .arg(&config)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program runs");
    let mut program = Program(child);
    let (mut motion, _) = tcp.accept().unwrap();
    let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut all = Readings::default();
    let mut buffer = [0; 4096];
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
        if let Ok(n) = vessel.recv(&mut buffer) {
            all.append(wire::decode(&buffer[..n]).unwrap());
        }
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
    drop(program.0.stdin.take());
    let mut said = String::new();
    program
        .0
        .stdout
        .take()
        .unwrap()
        .read_to_string(&mut said)
        .unwrap();
    let status = |name: &str| -> serde_json::Value {
        let line = said
            .lines()
            .rfind(|l| l.contains(&format!("\"source\":\"{name}\"")));
        serde_json::from_str(line.unwrap_or_else(|| panic!("{name} in {said}"))).unwrap()
    };
    assert!(
        status("motion")["status"]["decoded"]["corrupted"]
            .as_u64()
            .unwrap()
            >= 2
    );
    assert!(status("receiver")["status"]["given"][1].as_u64().unwrap() >= 20);
    std::fs::remove_file(config).unwrap();
}

#[test]
fn without_sensors_or_with_a_wrong_address_it_ends_with_code_2() {
    let run = |name: &str, text: &str| {
        let config = std::env::temp_dir().join(format!("alight-sensors-{name}-{}.toml", std::process::id()));
        std::fs::write(&config, text).unwrap();
        let out = Command::new(env!("CARGO_BIN_EXE_alight"))
            .args(["sensors", "--config"])
            .arg(&config)
            .output()
            .expect("the program runs");
        std::fs::remove_file(config).unwrap();
        (
            out.status.code(),
            String::from_utf8_lossy(&out.stderr).into_owned(),
        )
    };
    for (name, text, says) in [
        ("none", "", "[[sensor.sources]]"),
        (
            "url",
            "[[sensor.sources]]\nconnect = \"nmea://mast\"\n",
            "nmea://mast",
        ),
        ("format", "[[sensor.sources]]\nformat = \"n2k\"\n", "n2k"),
        ("range", "[[sensor.sources]]\nlatency_s = 9.0\n", "latency_s"),
        (
            "arm",
            "[[sensor.sources]]\n[sensor.sources.mount]\nantenna_m = [0.0, 0.0, -900.0]\n",
            "antenna_m",
        ),
    ] {
        let (code, said) = run(name, text);
        assert_eq!(code, Some(2), "{name}: {said}");
        assert!(said.contains(says), "{name}: {said}");
    }
}
