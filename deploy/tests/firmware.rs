//! One landing of all processes with the drone flown by a firmware of the tests' own, which speaks
//! ArduPilot's JSON backend to the world and MAVLink to `alight autopilot`: the whole way through, with
//! an origin of its own. Nothing here asserts a time.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic
)]

#[path = "../../uav-side/tests/autopilot/standin.rs"]
#[allow(dead_code)]
mod standin;

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use alight_shared::frames::Datum;
use alight_shared::geometry::{DroneGeometry, GRAVITY};
use alight_uav::autopilot::modes::Firmware;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use standin::StandIn;

/// Where `alight land` lays its sea for a firmware, and where this firmware's estimate begins.
const SEA: Datum = Datum {
    latitude_deg: 43.5,
    longitude_deg: 16.3,
    height_m: 0.0,
};
const ORIGIN: Datum = Datum {
    latitude_deg: 43.4998,
    longitude_deg: 16.3003,
    height_m: 3.0,
};
/// Height above its pad that the person takes off to, m.
const TAKE_OFF_M: f64 = 8.0;

/// The numbers of a list in the plant's line.
fn list(line: &str, key: &str) -> Vec<f64> {
    let text = &line[line.find(key).unwrap() + key.len()..];
    let text = &text[text.find('[').unwrap() + 1..text.find(']').unwrap()];
    text.split(',').map(|w| w.parse().unwrap()).collect()
}
fn three(line: &str, key: &str) -> Vector3<f64> {
    Vector3::from_vec(list(line, key))
}

/// Rotor outputs for an attitude and a share of thrust: attitude and rate loop, and a mixer.
fn outputs(a: &StandIn, rates: &Vector3<f64>) -> [f64; 4] {
    if !a.armed {
        return [0.0; 4];
    }
    let g = DroneGeometry::default();
    let (wanted, thrust) = a.wanted();
    let error = (a.attitude.inverse() * wanted).scaled_axis();
    let turn = Vector3::new(5.0 * error.x, 5.0 * error.y, (2.0 * error.z).clamp(-1.0, 1.0)) - rates;
    let moment = turn
        .component_mul(&Vector3::new(18.0, 18.0, 6.0))
        .component_mul(&Vector3::from(g.inertia_kgm2));
    let side = g.arm_m / 2.0_f64.sqrt();
    [
        [1.0, 1.0, 1.0],
        [-1.0, -1.0, 1.0],
        [1.0, -1.0, -1.0],
        [-1.0, 1.0, -1.0],
    ]
    .map(|[x, y, sense]: [f64; 3]| {
        let force = -y * moment.x / side + x * moment.y / side + sense * moment.z / g.moment_per_force_m;
        (thrust + force / g.max_thrust_n).clamp(0.05, 1.0)
    })
}

/// The firmware, until `end`.
fn fly(plant: u16, door: TcpListener, end: &AtomicBool) -> StandIn {
    let mut a = StandIn::new(Firmware::ArduCopter, 0.0);
    (a.external, a.origin, a.armed) = (true, ORIGIN, false);
    let g = DroneGeometry::default();
    a.hover = g.mass_kg * GRAVITY / g.max_thrust_n;
    let local = ORIGIN.offset_to::<alight_shared::frames::TrueNed>(&SEA).0;
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(("127.0.0.1", plant)).unwrap();
    socket.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
    door.set_nonblocking(true).unwrap();
    let (mut link, mut frame, mut pulses) = (None::<TcpStream>, 0_u32, [1000_u16; 16]);
    let (mut waiting, mut buffer) = (Vec::new(), [0_u8; 4096]);
    let mut pad = None;
    while !end.load(Ordering::Relaxed) {
        let mut packet = 18458_u16.to_le_bytes().to_vec();
        packet.extend(400_u16.to_le_bytes());
        packet.extend(frame.to_le_bytes());
        pulses.iter().for_each(|p| packet.extend(p.to_le_bytes()));
        // The world may not be there yet.
        let _refused = socket.send(&packet);
        let Ok(n) = socket.recv(&mut buffer) else {
            std::thread::sleep(Duration::from_millis(5));
            continue;
        };
        frame += 1;
        let line = String::from_utf8_lossy(&buffer[..n]).into_owned();
        let t_s: f64 = line
            .split("\"timestamp\":")
            .nth(1)
            .and_then(|t| t.split(',').next())
            .unwrap()
            .parse()
            .unwrap();
        let q = list(&line, "\"quaternion\":");
        let rates = three(&line, "\"gyro\":");
        let position = three(&line, "\"position\":") + local;
        // What the plant says, in place of the stand-in's own point mass.
        (a.position, a.velocity, a.rates) = (position, three(&line, "\"velocity\":"), rates);
        a.attitude = UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]));
        a.force = three(&line, "\"accel_body\":");
        a.thrust = if a.armed { a.wanted().1 } else { 0.0 };
        // The person: arms, takes off, and gives the drone once it is up.
        let pad = *pad.get_or_insert(position);
        if t_s > 3.0 && a.persons_place.is_none() {
            a.armed = true;
            a.persons_place = Some(pad - Vector3::z() * TAKE_OFF_M);
        }
        if t_s > 12.0 && a.chosen == StandIn::persons(Firmware::ArduCopter) {
            a.choose(StandIn::ours(Firmware::ArduCopter));
        }
        for (pulse, u) in pulses.iter_mut().zip(outputs(&a, &rates)) {
            *pulse = (1000.0 + 1000.0 * u) as u16;
        }
        if link.is_none() {
            link = door.accept().ok().map(|(stream, _)| {
                stream.set_nonblocking(true).unwrap();
                stream
            });
        }
        if let Some(stream) = &mut link
            && let Ok(n) = stream.read(&mut buffer)
        {
            waiting.push(buffer[..n].to_vec());
        }
        for bytes in a.step(t_s + 1000.0, &std::mem::take(&mut waiting)) {
            if let Some(stream) = &mut link {
                let _lost = stream.write_all(&bytes);
            }
        }
    }
    a
}

#[test]
fn a_firmware_takes_off_is_handed_over_and_is_landed_and_stopped() {
    let port = || {
        UdpSocket::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap()
            .port()
    };
    let plant = port();
    let door = TcpListener::bind("127.0.0.1:0").unwrap();
    let connect = format!("tcpout://{}", door.local_addr().unwrap());
    let name = format!("fw-{}", std::process::id());
    let config = std::env::temp_dir().join(format!("{name}.toml"));
    std::fs::write(&config, format!("port = {plant}\n")).unwrap();
    let end = Arc::new(AtomicBool::new(false));
    let firmware = {
        let end = Arc::clone(&end);
        std::thread::spawn(move || fly(plant, door, &end))
    };
    let out = Command::new(env!("CARGO_BIN_EXE_alight"))
        .args([
            "land",
            "--autopilot",
            "ardupilot",
            "--connect",
            &connect,
            "--firmware",
        ])
        .arg(&config)
        .args([
            "--sea",
            "calm",
            "--warm-up",
            "20",
            "--seed",
            "1",
            "--json",
            "--instance",
            &name,
        ])
        .stdin(Stdio::null())
        .output()
        .unwrap();
    end.store(true, Ordering::Relaxed);
    let a = firmware.join().unwrap();
    let _removed = std::fs::remove_file(config);
    let said = String::from_utf8_lossy(&out.stderr);
    let text = String::from_utf8_lossy(&out.stdout);
    let outcome: serde_json::Value = serde_json::from_str(text.lines().last().unwrap_or("null")).unwrap();
    // For a person, with --nocapture.
    println!("{outcome}");
    assert_eq!(outcome["outcome"], "success", "{text}\n{said}");
    assert!(!a.armed, "it was not disarmed\n{said}");
    assert_eq!(
        a.chosen,
        StandIn::ours(Firmware::ArduCopter),
        "the mode was changed"
    );
    // Motors off by one command or two, and by nothing else than the forced disarm.
    let disarms = a.commands.iter().filter(|(_, c)| c.command == 400).count();
    assert!((1..=2).contains(&disarms), "{disarms}");
}
