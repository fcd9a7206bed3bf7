//! Landings of all processes with a drone flown by the tests' own firmware, which uses ArduPilot's JSON backend or
//! PX4's simulator API towards the world and MAVLink towards `alight autopilot`, with its own origin.
use std::{
    fs,
    io::{ErrorKind::WouldBlock, Read, Write},
    net::{TcpListener, TcpStream, UdpSocket},
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::Duration,
};

use alight_shared::{
    frames::yaw_rotation,
    geodesy::Datum,
    geometry::{DroneGeometry, GRAVITY},
    msg::AutopilotMode,
    time::{Time, WorldTime},
};
use alight_sim::{
    autopilots::{
        simulated::{SimulatedAutopilot, mode_number},
        stand_in,
    },
    physics::{
        drone::{AutopilotConfig, MAX_ROTORS, NavigationConfig, PlantState},
        streams::Streams,
    },
};
use alight_uav::autopilot::{
    message::{MavCmd, MavResult, MavlinkMessage},
    modes::Firmware,
    wire::Decoder,
};

use crate::common::{errors, free_port, printed, run};
use nalgebra::Vector3;
use serde_json::Value;

/// Position of the sea of `alight land`, and the origin of this firmware's estimate.
const SEA: Datum = Datum::new(43.5, 16.3, 0.0);
const ORIGIN: Datum = Datum::new(43.4998, 16.3003, 3.0);
/// Declination of the plant's magnetic field, rad: atan2(0.019, 0.235).
const FIELD_DECLINATION: f64 = 0.0807;
/// Minimum rate of gyroscope samples at which ArduCopter arms, Hz: 1.8 times its loop rate.
const GYROSCOPES_HZ: f64 = 1.8 * 400.0;
/// Number of samples per reply of PX4, whose rate is limited by IMU_GYRO_RATEMAX.
const PX4_ANSWERS: u32 = 2;
/// Height above the pad to which the pilot takes off, m.
const TAKE_OFF_M: f64 = 8.0;
/// Fraction of hover thrust below which a commanded thrust makes the drone descend or presses it onto the deck.
const PRESSES: f64 = 0.6;
/// Good sensors for PX4, because the stand-in has a poor estimator.
const GOOD_SENSORS: &str = "[drone.navigation]\ngnss_bias_m = 0.0\ngnss_noise_m = 0.02\ngnss_velocity_mps = 0.02\n\
                            gyro_bias_rps = 0.0\ngyro_noise_rps = 0.001\naccelerometer_bias_mps2 = 0.0\n";

#[derive(Clone, Debug)]
pub struct FirmwareFlight {
    pub firmware: Firmware,
    /// Further flags of `alight land`: sea, seed, fault.
    pub flags: String,
    /// Time after the first disarm command for which the autopilot denies commands, s.
    pub denies_s: f64,
}

impl FirmwareFlight {
    pub fn new(firmware: Firmware, flags: impl Into<String>) -> FirmwareFlight {
        FirmwareFlight {
            firmware,
            flags: flags.into(),
            denies_s: 0.0,
        }
    }
}

/// MAVLink of a firmware, which listens or dials, or of its pilot.
pub enum Link {
    Tcp(Door, Option<TcpStream>),
    Udp(UdpSocket),
}
pub enum Door {
    Listens(TcpListener),
    Dials(u16),
}

impl Link {
    pub fn receive(&mut self) -> Vec<Vec<u8>> {
        let mut buffer = [0_u8; 4096];
        let got = match self {
            Link::Tcp(door, stream) => {
                if stream.is_none() {
                    *stream = match door {
                        Door::Listens(door) => door.accept().ok().map(|(s, _)| s),
                        Door::Dials(port) => TcpStream::connect(("127.0.0.1", *port)).ok(),
                    };
                    stream.iter().for_each(|s| {
                        s.set_nonblocking(true).unwrap();
                        // As in ArduPilot: otherwise odometry waits for acknowledgements, sometimes for 39 ms.
                        s.set_nodelay(true).unwrap();
                    });
                }
                let read = stream.as_mut().map(|s| s.read(&mut buffer));
                // A restarted link connects again.
                if matches!(&read, Some(Ok(0))) || matches!(&read, Some(Err(e)) if e.kind() != WouldBlock) {
                    *stream = None;
                }
                read.and_then(Result::ok)
            }
            Link::Udp(socket) => socket.recv(&mut buffer).ok(),
        };
        got.map(|n| buffer[..n].to_vec()).into_iter().collect()
    }
    pub fn send(&mut self, bytes: &[u8]) {
        let _lost = match self {
            Link::Tcp(_, stream) => stream.as_mut().map(|s| s.write_all(bytes).is_ok()),
            Link::Udp(socket) => Some(socket.send(bytes).is_ok()),
        };
    }
}

struct Controls {
    a: Option<SimulatedAutopilot>,
    link: Link,
    flight: FirmwareFlight,
    pad: Vector3<f64>,
    taken_off: bool,
    slice: Option<WorldTime>,
    pressed: bool,
}

/// Firmware on its pad, with good sensors, because the stand-in firmware has errors of its own.
fn on_pad(firmware: Firmware, at: &PlantState) -> SimulatedAutopilot {
    let c = AutopilotConfig {
        firmware,
        loss_after_s: 0.5,
        ..AutopilotConfig::default()
    };
    let g = DroneGeometry::default();
    let n = NavigationConfig::without_errors();
    let hover = g.mass_kg * GRAVITY / g.max_thrust_n;
    let mut a = SimulatedAutopilot::new(&c, &n, &g, &Streams::new(1), at, hover);
    a.origin = ORIGIN;
    a.arm(false);
    a
}

impl Controls {
    fn new(flight: FirmwareFlight, link: Link) -> Controls {
        Controls {
            a: None,
            link,
            flight,
            pad: Vector3::zeros(),
            taken_off: false,
            slice: None,
            pressed: false,
        }
    }
    /// Advances by one slice; the motion is in this firmware's NED frame. Returns rotor outputs; None if motors are
    /// off.
    fn step(&mut self, f: &PlantState) -> Option<[f64; MAX_ROTORS]> {
        if self.a.is_none() {
            self.pad = f.position;
        }
        let firmware = self.flight.firmware;
        let a = self.a.get_or_insert_with(|| on_pad(firmware, f));
        let t_s = f.at.secs();
        // The pilot arms, takes off, and then hands over the drone.
        let dt = (f.at - self.slice.replace(f.at).unwrap_or_default()).secs();
        let armable = firmware == Firmware::Px4 || 1.0 / dt >= GYROSCOPES_HZ;
        if t_s > 3.0 && armable && !self.taken_off {
            a.arm(true);
            a.hold_at(self.pad - Vector3::z() * TAKE_OFF_M);
            self.taken_off = true;
        }
        if t_s > 12.0 && a.chosen() == mode_number(firmware, AutopilotMode::Other) {
            // PX4 rejects the mode until set-points have arrived for some time, so the pilot tries again.
            let _rejected = a.choose(mode_number(firmware, AutopilotMode::Offboard));
        }
        let first = a
            .commands
            .iter()
            .find(|(_, c)| c.command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM);
        let denied = first.is_none_or(|(at, _)| t_s < at.secs() + self.flight.denies_s)
            && self.pressed
            && self.flight.denies_s > 0.0;
        a.answer = denied.then_some(MavResult::MAV_RESULT_DENIED);
        let (motors, sent) = a.step_bytes(f, &self.link.receive());
        for bytes in sent {
            self.link.send(&bytes);
        }
        self.pressed |= a.in_offboard() && a.thrust() < PRESSES * a.hover_thrust();
        motors
    }
}

fn fly_json(plant: u16, mut flown: Controls, end: &AtomicBool) -> Controls {
    let local = ORIGIN.to::<alight_shared::frames::TrueNed>(&SEA).0;
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(("127.0.0.1", plant)).unwrap();
    socket.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
    let mut frame = 0_u32;
    let mut outputs = [0.0; MAX_ROTORS];
    let mut buffer = [0_u8; 4096];
    let mut asked = false;
    let mut newest = None;
    while !end.load(Ordering::Relaxed) {
        if !asked {
            let _unsent = socket.send(&stand_in::servo_packet(frame, outputs));
        }
        let received = socket.recv(&mut buffer);
        asked = received.is_ok();
        let Ok(n) = received else {
            std::thread::sleep(Duration::from_millis(5));
            continue;
        };
        let mut sensed = stand_in::read_line(&String::from_utf8_lossy(&buffer[..n])).unwrap();
        // Drops the reply to a repeated packet; otherwise each would remain in the queue.
        if newest.replace(sensed.at).is_some_and(|at| sensed.at <= at) {
            continue;
        }
        asked = false;
        frame += 1;
        sensed.position += local;
        outputs = flown.step(&sensed).unwrap_or_default();
    }
    flown
}

/// Serves PX4's simulator API until `end`, with a separate estimator, because that API provides only sensor data.
fn fly_hil(plant: u16, mut flown: Controls, end: &AtomicBool) -> Controls {
    let mut decoder = Decoder::default();
    let mut buffer = [0_u8; 4096];
    let mut believed = None::<PlantState>;
    let mut stream = None::<TcpStream>;
    let mut sample = 0_u32;
    while !end.load(Ordering::Relaxed) {
        let Some(link) = &mut stream else {
            std::thread::sleep(Duration::from_millis(20));
            stream = TcpStream::connect(("127.0.0.1", plant)).ok();
            if let Some(s) = &stream {
                s.set_nodelay(true).unwrap();
                s.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
            }
            continue;
        };
        if let Ok(n) = link.read(&mut buffer) {
            decoder.push(&buffer[..n]);
        }
        while let Some(f) = decoder.next_frame() {
            match f.message {
                MavlinkMessage::HilGps(g) => {
                    let place = stand_in::place(&g, &ORIGIN);
                    if let Some(b) = &mut believed {
                        stand_in::correct(b, &g, place, 0.2);
                    }
                    believed.get_or_insert(PlantState {
                        position: place,
                        ..PlantState::default()
                    });
                }
                MavlinkMessage::HilSensor(s) => {
                    let Some(b) = &mut believed else { continue };
                    let at = Time::from_secs(s.time_us as f64 * 1e-6);
                    let dt = (at - b.at).secs();
                    b.at = at;
                    if !(0.0..0.1).contains(&dt) {
                        // On the pad: level, with the heading of the compass.
                        let m = s.magnetometer;
                        let yaw = FIELD_DECLINATION - m[1].atan2(m[0]);
                        b.attitude = yaw_rotation(yaw);
                        continue;
                    }
                    stand_in::advance(b, &s, dt);
                    let motors = flown.step(b);
                    sample += 1;
                    if !sample.is_multiple_of(PX4_ANSWERS) {
                        continue;
                    }
                    let armed = motors.is_some();
                    let u = motors.unwrap_or_default();
                    let _gone = link.write_all(&stand_in::motor_answer(s.time_us, u, armed));
                }
                _ => {}
            }
        }
    }
    flown
}

pub struct FirmwareOutcome {
    pub outcome: Value,
    pub errors: String,
    pub autopilot: SimulatedAutopilot,
}

/// Asserts that the drone was disarmed in the mode in which it was handed over: by one command or two, and only by
/// the forced disarm.
pub fn assert_disarmed(a: &SimulatedAutopilot) {
    assert!(!a.armed(), "it was not disarmed");
    let offboard = mode_number(a.firmware(), AutopilotMode::Offboard);
    assert_eq!(a.chosen(), offboard, "the mode was changed");
    let disarms = a
        .commands
        .iter()
        .filter(|(_, c)| c.command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM);
    assert!((1..=2).contains(&disarms.count()));
}

impl FirmwareOutcome {
    pub fn entered(&self, state: &str) -> bool {
        let phases = self.outcome["live"]["phases"].as_array();
        phases.is_some_and(|all| all.iter().any(|p| p["state"] == state))
    }
    pub fn show(&self) -> String {
        format!("{}\n{}", self.outcome, self.errors)
    }
}

/// Stand-in firmware with its pilot, waiting for a plant.
pub struct StandIn {
    flown: JoinHandle<Controls>,
    end: Arc<AtomicBool>,
    pub kind: &'static str,
    pub connect: String,
    /// Configuration of the plant, which names its port.
    pub config: PathBuf,
}

impl StandIn {
    pub fn start(name: &str, flight: &FirmwareFlight) -> StandIn {
        let firmware = flight.firmware;
        let plant = free_port();
        let (kind, link, connect) = match firmware {
            Firmware::ArduCopter => {
                let door = TcpListener::bind("127.0.0.1:0").unwrap();
                door.set_nonblocking(true).unwrap();
                let at = door.local_addr().unwrap();
                (
                    "ardupilot",
                    Link::Tcp(Door::Listens(door), None),
                    format!("tcpout://{at}"),
                )
            }
            Firmware::Px4 => {
                let to = free_port();
                let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
                socket.connect(("127.0.0.1", to)).unwrap();
                socket.set_nonblocking(true).unwrap();
                ("px4", Link::Udp(socket), format!("udpin://127.0.0.1:{to}"))
            }
        };
        let config = std::env::temp_dir().join(format!("{name}-plant.toml"));
        fs::write(&config, format!("port = {plant}\n")).unwrap();
        let end = Arc::new(AtomicBool::new(false));
        let stop = Arc::clone(&end);
        let flight = flight.clone();
        let flown = std::thread::spawn(move || {
            let controls = Controls::new(flight, link);
            match firmware {
                Firmware::ArduCopter => fly_json(plant, controls, &stop),
                Firmware::Px4 => fly_hil(plant, controls, &stop),
            }
        });
        StandIn {
            flown,
            end,
            kind,
            connect,
            config,
        }
    }
    pub fn end(self) -> SimulatedAutopilot {
        self.end.store(true, Ordering::Relaxed);
        let _removed = fs::remove_file(self.config);
        self.flown.join().unwrap().a.expect("it never flew")
    }
}

pub fn fly(name: &str, flight: &FirmwareFlight) -> FirmwareOutcome {
    let scene = std::env::temp_dir().join(format!("{name}-scene.toml"));
    let scenario = match flight.firmware {
        Firmware::ArduCopter => "",
        Firmware::Px4 => GOOD_SENSORS,
    };
    fs::write(&scene, scenario).unwrap();
    let stand_in = StandIn::start(name, flight);
    let out = run(format!(
        "land --autopilot {} --external --connect {} --firmware {} --scenario {} --warm-up 15 --json --instance {name} {}",
        stand_in.kind,
        stand_in.connect,
        stand_in.config.display(),
        scene.display(),
        flight.flags
    ));
    let autopilot = stand_in.end();
    let _removed = fs::remove_file(scene);
    // The flight proves nothing if the computer did not keep up.
    assert_ne!(out.status.code(), Some(3), "{}", errors(&out));
    FirmwareOutcome {
        outcome: serde_json::from_str(printed(&out).lines().last().unwrap_or("null")).unwrap(),
        errors: errors(&out),
        autopilot,
    }
}
