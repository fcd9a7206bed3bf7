//! One landing of all processes with the drone flown by a firmware of the tests' own, which speaks
//! ArduPilot's JSON backend or PX4's simulator API to the world and MAVLink to `alight autopilot`: the whole way through, with
//! an origin of its own. Nothing here asserts a time.
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use alight_shared::frames::Datum;
use alight_shared::time::{Time, TrueTime};
use alight_sim::autopilots::fake::FakeAutopilot;
use alight_sim::autopilots::stand_in;
use alight_sim::physics::drone::PlantState;
use alight_uav::autopilot::message::Message;
use alight_uav::autopilot::modes::Firmware;
use alight_uav::autopilot::wire::Decoder;

use crate::common::{errors, free_port, printed, run};
use nalgebra::{UnitQuaternion, Vector3};

/// Where `alight land` lays its sea for a firmware, and where this firmware's estimate begins.
const SEA: Datum = Datum::new(43.5, 16.3, 0.0);
const ORIGIN: Datum = Datum::new(43.4998, 16.3003, 3.0);
/// Declination of the plant's magnetic field, rad: atan2(0.019, 0.235).
const FIELD_DECLINATION: f64 = 0.0807;
/// ArduCopter arms when its gyroscopes are read at least this often, Hz: 1.8 times in each of its loops.
const GYROSCOPES_HZ: f64 = 1.8 * 400.0;
/// PX4 answers every so many samples, as it does with its own IMU_GYRO_RATEMAX.
const PX4_ANSWERS: u32 = 2;
/// Height above its pad that the person takes off to, m.
const TAKE_OFF_M: f64 = 8.0;

/// The firmware's MAVLink.
enum Link {
    /// Waits for `alight autopilot` to connect.
    Tcp(TcpListener, Option<TcpStream>),
    /// Speaks to where it listens.
    Udp(UdpSocket),
}

impl Link {
    fn receive(&mut self) -> Vec<Vec<u8>> {
        let mut buffer = [0_u8; 4096];
        let got = match self {
            Link::Tcp(door, stream) => {
                if stream.is_none() {
                    *stream = door.accept().ok().map(|(s, _)| s);
                    stream.iter().for_each(|s| {
                        s.set_nonblocking(true).unwrap();
                        // As ArduPilot does: else odometry waits for acknowledgements, 39 ms at times.
                        s.set_nodelay(true).unwrap();
                    });
                }
                stream.as_mut().and_then(|s| s.read(&mut buffer).ok())
            }
            Link::Udp(socket) => socket.recv(&mut buffer).ok(),
        };
        got.map(|n| buffer[..n].to_vec()).into_iter().collect()
    }
    fn send(&mut self, bytes: &[u8]) {
        // Nobody may be there yet.
        let _lost = match self {
            Link::Tcp(_, stream) => stream.as_mut().map(|s| s.write_all(bytes).is_ok()),
            Link::Udp(socket) => Some(socket.send(bytes).is_ok()),
        };
    }
}

/// A firmware and the person at its controls.
struct Flown {
    a: FakeAutopilot,
    link: Link,
    pad: Option<Vector3<f64>>,
    slice: Option<Time<TrueTime>>,
}

impl Flown {
    fn new(firmware: Firmware, link: Link) -> Flown {
        let mut a = FakeAutopilot::new(firmware, 0.0);
        a.fly_plant();
        (a.origin, a.armed) = (ORIGIN, false);
        Flown {
            a,
            link,
            pad: None,
            slice: None,
        }
    }
    /// One slice with the drone's motion in this firmware's own NED: rotor outputs.
    fn step(&mut self, f: &PlantState) -> [f64; 4] {
        let (a, t_s) = (&mut self.a, f.at.secs());
        a.set_motion(f.position, f.velocity, f.attitude, f.rates, f.specific_force);
        // The person: arms, takes off, and gives the drone once it is up.
        let pad = *self.pad.get_or_insert(f.position);
        let hz = 1.0 / (f.at - self.slice.replace(f.at).unwrap_or_default()).secs();
        let armable = a.firmware == Firmware::Px4 || hz >= GYROSCOPES_HZ;
        if t_s > 3.0 && armable && a.manual_hold_position.is_none() {
            a.armed = true;
            a.manual_hold_position = Some(pad - Vector3::z() * TAKE_OFF_M);
        }
        if t_s > 12.0 && a.chosen == FakeAutopilot::manual_mode(a.firmware) {
            // PX4 refuses until an offer has lasted: a person tries again.
            let _refused = a.choose(FakeAutopilot::offboard_mode(a.firmware));
        }
        let received = self.link.receive();
        for bytes in a.step(t_s + 1000.0, &received) {
            self.link.send(&bytes);
        }
        a.motors()
    }
}

/// ArduPilot's JSON backend, until `end`.
fn fly_json(plant: u16, mut flown: Flown, end: &AtomicBool) -> FakeAutopilot {
    let local = ORIGIN.offset_to::<alight_shared::frames::TrueNed>(&SEA).0;
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(("127.0.0.1", plant)).unwrap();
    socket.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
    let (mut frame, mut outputs, mut buffer) = (0_u32, [0.0; 4], [0_u8; 4096]);
    let (mut asked, mut newest) = (false, None);
    while !end.load(Ordering::Relaxed) {
        if !asked {
            // The world may not be there yet.
            let _refused = socket.send(&stand_in::servo_packet(frame, outputs));
        }
        let received = socket.recv(&mut buffer);
        asked = received.is_ok();
        let Ok(n) = received else {
            std::thread::sleep(Duration::from_millis(5));
            continue;
        };
        let mut sensed = stand_in::read_line(&String::from_utf8_lossy(&buffer[..n])).unwrap();
        // A packet that was sent again is answered again: that answer is not flown, or each would stay in the queue.
        if newest.replace(sensed.at).is_some_and(|at| sensed.at <= at) {
            continue;
        }
        (asked, frame) = (false, frame + 1);
        sensed.position += local;
        outputs = flown.step(&sensed);
    }
    flown.a
}

/// PX4's simulator API, until `end`: with an estimator of its own, because there are sensors only.
fn fly_hil(plant: u16, mut flown: Flown, end: &AtomicBool) -> FakeAutopilot {
    let (mut decoder, mut buffer, mut believed) = (Decoder::default(), [0_u8; 4096], None::<PlantState>);
    let (mut stream, mut sample) = (None::<TcpStream>, 0_u32);
    while !end.load(Ordering::Relaxed) {
        let Some(link) = &mut stream else {
            // The world may not be there yet.
            std::thread::sleep(Duration::from_millis(20));
            stream = TcpStream::connect(("127.0.0.1", plant)).ok();
            stream.iter().for_each(|s| {
                s.set_nodelay(true).unwrap();
                s.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
            });
            continue;
        };
        if let Ok(n) = link.read(&mut buffer) {
            decoder.push(&buffer[..n]);
        }
        while let Some(f) = decoder.next_frame() {
            match f.message {
                Message::HilGps(g) => {
                    let place = stand_in::place(&g, &ORIGIN);
                    if let Some(b) = &mut believed {
                        stand_in::correct(b, &g, place, 0.2);
                    }
                    believed.get_or_insert(PlantState {
                        position: place,
                        ..PlantState::default()
                    });
                }
                Message::HilSensor(s) => {
                    let Some(b) = &mut believed else { continue };
                    let at = Time::from_secs(s.time_us as f64 * 1e-6);
                    let dt = (at - b.at).secs();
                    b.at = at;
                    if !(0.0..0.1).contains(&dt) {
                        // On the pad: level, and the heading by the compass.
                        let m = s.magnetometer;
                        let yaw = FIELD_DECLINATION - m[1].atan2(m[0]);
                        b.attitude = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
                        continue;
                    }
                    stand_in::advance(b, &s, dt);
                    let u = flown.step(b);
                    sample += 1;
                    if !sample.is_multiple_of(PX4_ANSWERS) {
                        continue;
                    }
                    let _gone = link.write_all(&stand_in::motor_answer(s.time_us, u, flown.a.armed));
                }
                _ => {}
            }
        }
    }
    flown.a
}

/// One landing of `firmware` in a scenario.
fn land(firmware: Firmware, scenario: &str) {
    // One after the other: they fly in real time.
    static ONE: Mutex<()> = Mutex::new(());
    let _turn = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let plant = free_port();
    let (link, connect) = match firmware {
        Firmware::ArduCopter => {
            let door = TcpListener::bind("127.0.0.1:0").unwrap();
            door.set_nonblocking(true).unwrap();
            let at = door.local_addr().unwrap();
            (Link::Tcp(door, None), format!("tcpout://{at}"))
        }
        Firmware::Px4 => {
            let to = free_port();
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            socket.connect(("127.0.0.1", to)).unwrap();
            socket.set_nonblocking(true).unwrap();
            (Link::Udp(socket), format!("udpin://127.0.0.1:{to}"))
        }
    };
    let name = format!("fw-{}-{}", firmware.name().to_lowercase(), std::process::id());
    let file = |end: &str| std::env::temp_dir().join(format!("{name}-{end}.toml"));
    let (config, scene) = (file("plant"), file("scene"));
    std::fs::write(&config, format!("port = {plant}\n")).unwrap();
    std::fs::write(&scene, scenario).unwrap();
    let end = Arc::new(AtomicBool::new(false));
    let flown = {
        let end = Arc::clone(&end);
        std::thread::spawn(move || {
            let flown = Flown::new(firmware, link);
            match firmware {
                Firmware::ArduCopter => fly_json(plant, flown, &end),
                Firmware::Px4 => fly_hil(plant, flown, &end),
            }
        })
    };
    let kind = match firmware {
        Firmware::ArduCopter => "ardupilot",
        Firmware::Px4 => "px4",
    };
    let out = run(format!(
        "land --autopilot {kind} --connect {connect} --firmware {} --scenario {} --sea calm --warm-up 20 --seed 1 \
         --json --instance {name}",
        config.display(),
        scene.display()
    ));
    end.store(true, Ordering::Relaxed);
    let a = flown.join().unwrap();
    let _removed = [config, scene].map(std::fs::remove_file);
    let (errors, text) = (errors(&out), printed(&out));
    let outcome: serde_json::Value = serde_json::from_str(text.lines().last().unwrap_or("null")).unwrap();
    // For a person, with --nocapture.
    println!("{outcome}");
    let phases = outcome["live"]["phases"].as_array().cloned().unwrap_or_default();
    let landed = phases.iter().any(|p| p["state"] == "Landed");
    let disarms = a.commands.iter().filter(|(_, c)| c.command == 400).count();
    assert_eq!(
        a.chosen,
        FakeAutopilot::offboard_mode(firmware),
        "the mode was changed"
    );
    if !landed {
        assert_eq!(disarms, 0, "disarmed without a landing\n{errors}");
    }
    assert!(landed, "{text}\n{errors}");
    assert!(!a.armed, "it was not disarmed\n{errors}");
    // Motors off by one command or two, and by nothing else than the forced disarm.
    assert!((1..=2).contains(&disarms), "{disarms}\n{errors}");
    assert_eq!(outcome["outcome"], "success", "{text}\n{errors}");
}

#[test]
fn ardupilot_stand_in_is_handed_over_landed_and_disarmed() {
    land(Firmware::ArduCopter, "");
}

#[test]
fn px4_stand_in_is_handed_over_landed_and_disarmed() {
    // Good sensors: the stand-in's estimator is a poor one.
    let scenario = "[drone.navigation]\ngnss_bias_m = 0.0\ngnss_noise_m = 0.02\ngnss_velocity_mps = 0.02\n\
                    gyro_bias_rps = 0.0\ngyro_noise_rps = 0.001\naccelerometer_bias_mps2 = 0.0\n";
    land(Firmware::Px4, scenario);
}
