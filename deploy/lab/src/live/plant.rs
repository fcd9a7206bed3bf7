//! Source of the drone's rotor commands: the simulated autopilot, whose MAVLink goes to `alight autopilot` over UDP,
//! or a firmware in lock-step, by sockets around [`alight_sim::autopilots`]. The simulation does not wait for an
//! absent or late firmware: the drone stays on its pad or flies on with its last motor commands, and the sea
//! continues in real time.

use std::{
    io::{ErrorKind, Read, Write},
    net::{SocketAddr, TcpListener, TcpStream, UdpSocket},
    time::Duration,
};

use alight_computer::{
    exit::{CliError, Doing},
    process::supervisor::pause,
    terminal,
};
use alight_shared::{
    mavlink::Signing,
    msg::AutopilotMode,
    time::{TrueTime, WorldTime},
};
use alight_sim::{
    autopilots::{
        FirmwareConfig, FirmwareSensors, ardupilot, px4,
        px4::Px4Plant,
        simulated::{INNER_PER_OUTER, SimulatedAutopilot, mode_number},
    },
    harness::physics::{Physics, TICK},
    physics::drone::{MAX_ROTORS, PlantState},
    sensors::{DroneReadings, beacon::BEACON, clocks::ClockModel},
};
use alight_transport::{
    clock::{ProcessClock, steady_ns},
    memory::Memory,
    wake::end_requested,
};
use alight_uav::autopilot::wire::Encoder;

use crate::live::config::AutopilotKind;

const READ: Duration = Duration::from_millis(2);
/// Time limit for PX4's reply to a sample, ns. The reply to a missed sample comes at the earliest with the next
/// sample, because PX4's rate loop may run at every second sample. Meanwhile its set-points and odometry age.
/// Measured: waits of 0.5 s ended in Hold up to 11 times a flight, waits of 0.03 s never.
const ANSWER_NS: i64 = 30_000_000;
/// Silence of a firmware after which its motors are off, ns.
const GONE_NS: i64 = 1_000_000_000;
const MAX_READS: u32 = 64;

/// Waits; false if the process was asked to end. Without the memory of a drone's computer it only sleeps.
pub fn wait(memory: Option<&Memory>, span: Duration) -> bool {
    match memory {
        Some(memory) => memory.wait(span),
        None => {
            pause(span);
            !end_requested()
        }
    }
}

pub fn wait_until(memory: Option<&Memory>, clock: &ProcessClock, t: WorldTime) {
    let left = (t - clock.now::<TrueTime>()).nanos().clamp(0, TICK.nanos());
    let _stop_requested = wait(memory, Duration::from_nanos(left.unsigned_abs()));
}

enum Link {
    /// MAVLink bytes of the simulated autopilot, exchanged with the drone's computer.
    Simulated {
        socket: UdpSocket,
        station: Option<UdpSocket>,
        autopilot: Option<Box<SimulatedAutopilot>>,
        signing: Option<Signing>,
        handed_over: bool,
    },
    Px4 {
        door: TcpListener,
        stream: Option<TcpStream>,
        plant: Box<Px4Plant>,
    },
    Ardupilot {
        socket: UdpSocket,
        asker: Option<(SocketAddr, u32)>,
        motors: Option<[f64; MAX_ROTORS]>,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    Answered,
    /// The firmware does not reply to every sample, and no reply is due for this one.
    NoneDue,
    Unanswered,
}

pub struct Plant {
    link: Link,
    config: FirmwareConfig,
    exchanges: u32,
    received_ns: i64,
    beacon: Encoder,
    late: u64,
}

impl Plant {
    /// Listens on the port to which the firmware connects. The simulated autopilot sends its MAVLink to `mavlink` and
    /// to a ground station at `station`, signed if a key is set.
    pub fn open(
        kind: AutopilotKind,
        mavlink: &str,
        station: Option<&str>,
        signing: Option<Signing>,
        config: &FirmwareConfig,
        sensors: FirmwareSensors,
    ) -> Result<Plant, CliError> {
        let port = |usual: u16| if config.port == 0 { usual } else { config.port };
        let doing = |port: u16| format!("listening for the firmware on port {port}");
        let (link, exchanges) = match kind {
            AutopilotKind::Internal => {
                let dial = |to: &str| dial(to).doing(format_args!("sending MAVLink to {to}"));
                let link = Link::Simulated {
                    socket: dial(mavlink)?,
                    station: station.map(dial).transpose()?,
                    autopilot: None,
                    signing,
                    handed_over: false,
                };
                (link, INNER_PER_OUTER)
            }
            AutopilotKind::Px4 => {
                let port = port(px4::PORT);
                let door = TcpListener::bind(("0.0.0.0", port))
                    .and_then(|door| door.set_nonblocking(true).map(|()| door))
                    .doing(doing(port))?;
                let link = Link::Px4 {
                    door,
                    stream: None,
                    plant: Box::new(Px4Plant::new(config, sensors)),
                };
                (link, config.exchanges(px4::EXCHANGE_HZ))
            }
            AutopilotKind::Ardupilot => {
                let port = port(ardupilot::PORT);
                let socket = UdpSocket::bind(("0.0.0.0", port))
                    .and_then(|s| s.set_read_timeout(Some(READ)).map(|()| s))
                    .doing(doing(port))?;
                let link = Link::Ardupilot {
                    socket,
                    asker: None,
                    motors: None,
                };
                (link, config.exchanges(ardupilot::EXCHANGE_HZ))
            }
        };
        Ok(Plant {
            link,
            config: config.clone(),
            exchanges,
            received_ns: 0,
            beacon: Encoder::default(),
            late: 0,
        })
    }
    /// Places the drone when it is due: in the air under the simulated autopilot; on the ground under a firmware,
    /// from where a pilot flies it.
    pub fn place(&mut self, physics: &mut Physics) {
        if physics.drone(0).is_some() {
            return;
        }
        match &mut self.link {
            Link::Simulated {
                autopilot, signing, ..
            } => {
                if physics.now() >= physics.hover_from() {
                    physics.place_drone(0);
                    *autopilot = physics.autopilot(0).map(|(_, a)| Box::new(a));
                    if let Some(a) = autopilot {
                        a.set_signing(signing.take());
                    }
                }
            }
            Link::Px4 { .. } | Link::Ardupilot { .. } => physics.place_drone_on_pad(0),
        }
    }
    /// Removes the readings of devices attached to the simulated autopilot: rangefinder and beacon. A firmware's
    /// plant has neither, so its ranges remain in the readings.
    pub fn take(&mut self, readings: &mut DroneReadings, clock: &ClockModel) {
        let Link::Simulated {
            autopilot: Some(autopilot),
            socket,
            ..
        } = &mut self.link
        else {
            return;
        };
        for sample in readings.ranges.drain(..) {
            autopilot.take_range(clock.true_time(sample.header.at), sample);
        }
        for report in readings.beacons.drain(..) {
            let frame = self.beacon.frame(BEACON, &report.follow_target().into());
            if let Some(bytes) = &frame {
                drop(socket.send(bytes));
            }
        }
    }
    /// Number of slices in which the firmware did not reply in time.
    pub fn late(&self) -> u64 {
        self.late
    }
    /// Advances the world by one tick, slice by slice as the clock reaches each.
    pub fn advance(&mut self, physics: &mut Physics, memory: Option<&Memory>, clock: &ProcessClock) {
        if let Link::Simulated {
            autopilot: Some(autopilot),
            ..
        } = &mut self.link
        {
            autopilot.steel_m = physics.deck_distance_m(0);
        }
        physics.advance_with(self.exchanges, |_, sensed| {
            wait_until(memory, clock, sensed.at);
            self.exchange(sensed)
        });
    }

    /// Sends the drone's measurements to the firmware and receives its motor commands.
    fn exchange(&mut self, sensed: &PlantState) -> Option<[f64; MAX_ROTORS]> {
        let now = steady_ns();
        let answer_timeout_ns = (self.config.answer_timeout_s * 1e9) as i64;
        // Does not wait for a peer without a recent message.
        let present = now - self.received_ns < GONE_NS;
        let until = |timeout_ns: i64| now + if present { timeout_ns } else { 0 };
        let rate_hz = f64::from(self.exchanges) / TICK.secs();
        let (turn, motors) = match &mut self.link {
            Link::Simulated {
                socket,
                station,
                autopilot,
                handed_over,
                ..
            } => {
                let autopilot = autopilot.as_mut()?;
                let links = (&*socket, station.as_ref());
                (
                    Turn::Answered,
                    simulated_turn(links, autopilot, handed_over, sensed),
                )
            }
            Link::Px4 { door, stream, plant } => {
                accept_px4(door, stream);
                let sent = plant.encode_sensors(sensed, rate_hz);
                let timeout_ns = if plant.is_overdue() {
                    answer_timeout_ns
                } else {
                    answer_timeout_ns.min(ANSWER_NS)
                };
                let turn = px4_exchange(stream, plant, &sent, until(timeout_ns));
                (turn, plant.motors())
            }
            Link::Ardupilot {
                socket,
                asker,
                motors,
            } => {
                let answer = ardupilot::answer(sensed, 0.0);
                // The request of the last slice is answered with the resulting state.
                if let Some((to, _)) = asker {
                    let _lost = socket.send_to(answer.as_bytes(), *to);
                }
                let received = ardupilot_turn(socket, asker, &answer, until(answer_timeout_ns));
                let turn = match received {
                    Some(servos) => {
                        *motors = ardupilot::rotors(&self.config, &servos);
                        Turn::Answered
                    }
                    None => Turn::Unanswered,
                };
                if turn == Turn::Unanswered && now - self.received_ns > GONE_NS {
                    (*motors, *asker) = (None, None);
                }
                (turn, *motors)
            }
        };
        match turn {
            Turn::Answered => self.received_ns = now,
            Turn::NoneDue => {}
            Turn::Unanswered => self.late += u64::from(present),
        }
        motors
    }
}

fn dial(to: &str) -> std::io::Result<UdpSocket> {
    let socket = UdpSocket::bind("0.0.0.0:0")?;
    socket.connect(to)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

fn datagrams(socket: &UdpSocket) -> Vec<Vec<u8>> {
    let mut buffer = [0_u8; 2048];
    let mut received = Vec::new();
    while received.len() < MAX_READS as usize
        && let Ok(n) = socket.recv(&mut buffer)
    {
        received.push(buffer.get(..n).unwrap_or_default().to_vec());
    }
    received
}

/// Advances the simulated autopilot by a slice; returns its motor commands. `links`: the companion's, and the ground
/// station's if there is one.
fn simulated_turn(
    (socket, station): (&UdpSocket, Option<&UdpSocket>),
    autopilot: &mut SimulatedAutopilot,
    handed_over: &mut bool,
    sensed: &PlantState,
) -> Option<[f64; MAX_ROTORS]> {
    if !*handed_over {
        // PX4 rejects Offboard until set-points have been streamed for long enough, so the pilot tries again.
        let offboard = mode_number(autopilot.firmware(), AutopilotMode::Offboard);
        *handed_over = autopilot.choose(offboard);
    }
    let send = |to: &UdpSocket, all: &[Vec<u8>]| {
        for bytes in all {
            drop(to.send(bytes));
        }
    };
    let mut received = datagrams(socket);
    if let Some(station) = station {
        // Each link receives the messages of the other, as a firmware forwards them.
        let commanded = datagrams(station);
        send(station, &received);
        send(socket, &commanded);
        received.extend(commanded);
    }
    let (motors, sent) = autopilot.step_bytes(sensed, &received);
    send(socket, &sent);
    if let Some(station) = station {
        send(station, &sent);
    }
    motors
}

fn accept_px4(door: &TcpListener, stream: &mut Option<TcpStream>) {
    if stream.is_none()
        && let Ok((new, from)) = door.accept()
        && new
            .set_nonblocking(false)
            .and_then(|()| new.set_nodelay(true))
            .and_then(|()| new.set_read_timeout(Some(READ)))
            .is_ok()
    {
        terminal::line(format_args!("world: PX4 connected ({from})"));
        *stream = Some(new);
    }
}

/// Runs [`px4_turn`] if PX4 is connected; closes a broken link.
fn px4_exchange(stream: &mut Option<TcpStream>, plant: &mut Px4Plant, sent: &[u8], until: i64) -> Turn {
    let answered = stream.as_mut().map(|s| px4_turn(s, plant, sent, until));
    match answered {
        Some(Ok(turn)) => turn,
        Some(Err(())) => {
            terminal::line("world: PX4 closed the link");
            *stream = None;
            plant.lost();
            Turn::Unanswered
        }
        None => Turn::Unanswered,
    }
}

/// Sends the sensors' measurements and, if motor commands are due, reads until they arrive or until `until`. Err: the
/// link is broken.
fn px4_turn(stream: &mut TcpStream, plant: &mut Px4Plant, sent: &[u8], until: i64) -> Result<Turn, ()> {
    stream.write_all(sent).map_err(|_| ())?;
    if !plant.due() {
        return Ok(Turn::NoneDue);
    }
    let mut buffer = [0_u8; 2048];
    let mut reads = 0;
    while reads < MAX_READS {
        match stream.read(&mut buffer) {
            Ok(0) => return Err(()),
            Ok(n) if plant.decode(buffer.get(..n).unwrap_or_default()) => return Ok(Turn::Answered),
            Ok(_) => reads += 1,
            Err(e)
                if matches!(
                    e.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) => {}
            Err(_) => return Err(()),
        }
        if steady_ns() >= until {
            break;
        }
    }
    Ok(Turn::Unanswered)
}

/// Waits until `until` for a new packet; answers a repeated packet again.
fn ardupilot_turn(
    socket: &UdpSocket,
    asker: &mut Option<(SocketAddr, u32)>,
    answer: &str,
    until: i64,
) -> Option<ardupilot::Servos> {
    let mut buffer = [0_u8; 256];
    let mut reads = 0;
    while reads < MAX_READS {
        if let Ok((n, from)) = socket.recv_from(&mut buffer)
            && let Some(servos) = ardupilot::servos(buffer.get(..n).unwrap_or_default())
        {
            reads += 1;
            if *asker == Some((from, servos.frame)) {
                let _lost = socket.send_to(answer.as_bytes(), from);
            } else {
                if asker.is_none() {
                    terminal::line(format_args!("world: ArduPilot connected ({from})"));
                }
                *asker = Some((from, servos.frame));
                return Some(servos);
            }
        }
        if steady_ns() >= until {
            break;
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;
    use alight_sim::{autopilots::stand_in, physics::streams::Streams};
    use alight_uav::autopilot::{message::MavlinkMessage, wire::Decoder};
    use nalgebra::Vector3;

    const MAX: i64 = 2000;

    fn sensed(k: i64) -> PlantState {
        PlantState {
            at: Time::from_nanos(k * 2_500_000),
            position: Vector3::new(0.0, 0.0, -1.0),
            specific_force: Vector3::new(0.0, 0.0, -9.8),
            ..PlantState::default()
        }
    }
    fn open(kind: AutopilotKind, port: u16) -> Plant {
        let c = FirmwareConfig {
            port,
            ..FirmwareConfig::default()
        };
        let sensors = FirmwareSensors::new(&c, &Default::default(), Default::default(), &Streams::new(1));
        Plant::open(kind, "", None, None, &c, sensors).unwrap()
    }
    /// Exchanges until the motor commands satisfy `wanted`; returns that slice.
    fn until(plant: &mut Plant, from: i64, wanted: impl Fn(Option<[f64; MAX_ROTORS]>) -> bool) -> i64 {
        (from..from + MAX)
            .find(|k| {
                let done = wanted(plant.exchange(&sensed(*k)));
                alight_computer::process::supervisor::pause(Duration::from_millis(1));
                done
            })
            .expect("motor commands that satisfy `wanted`")
    }
    fn quarter(motors: Option<[f64; MAX_ROTORS]>) -> bool {
        motors.is_some_and(|m| m.iter().all(|s| (s - 0.25).abs() < 1e-3))
    }

    #[test]
    fn px4_lock_step_and_disconnection() {
        let port = crate::live::config::free_port().unwrap();
        let mut plant = open(AutopilotKind::Px4, port);
        // Without a firmware the drone stays on the ground, and nothing waits.
        assert!(plant.exchange(&sensed(0)).is_none() && plant.late() == 0);
        let firmware = std::thread::spawn(move || {
            let mut link = TcpStream::connect(("127.0.0.1", port)).unwrap();
            let mut decoder = Decoder::default();
            let mut times = Vec::new();
            let mut buffer = [0; 2048];
            while times.len() < 100 {
                let n = link.read(&mut buffer).unwrap();
                decoder.push(&buffer[..n]);
                while let Some(f) = decoder.next_frame() {
                    if let MavlinkMessage::HilSensor(s) = f.message {
                        times.push(s.time_us);
                        let answer = stand_in::motor_answer(s.time_us, [0.25; MAX_ROTORS], true);
                        link.write_all(&answer).unwrap();
                    }
                }
            }
            times
        });
        let k = until(&mut plant, 1, quarter);
        let end = until(&mut plant, k + 1, |m| m.is_none());
        assert!(end > k);
        let times = firmware.join().unwrap();
        assert!(times.windows(2).all(|w| w[1] == w[0] + 2500), "{times:?}");
    }

    #[test]
    fn ardupilot_replies_with_repeated_packets() {
        let port = crate::live::config::free_port().unwrap();
        let mut plant = open(AutopilotKind::Ardupilot, port);
        let firmware = std::thread::spawn(move || {
            let socket = UdpSocket::bind("0.0.0.0:0").unwrap();
            socket.connect(("127.0.0.1", port)).unwrap();
            socket.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
            let mut stamps = Vec::new();
            for frame in 0..50_u32 {
                let packet = stand_in::servo_packet(frame, [0.25; MAX_ROTORS]);
                socket.send(&packet).unwrap();
                if frame == 10 {
                    socket.send(&packet).unwrap();
                    let mut buffer = [0; 1024];
                    socket.recv(&mut buffer).unwrap();
                }
                let mut buffer = [0; 1024];
                let n = socket.recv(&mut buffer).unwrap();
                let line = String::from_utf8_lossy(&buffer[..n]);
                stamps.push(stand_in::read_line(&line).unwrap().at);
            }
            stamps
        });
        let k = until(&mut plant, 1, quarter);
        // The firmware ends after fifty packets; a second later its motors are off.
        until(&mut plant, k + 1, |m| m.is_none());
        let stamps = firmware.join().unwrap();
        assert!(stamps.windows(2).all(|w| w[1] >= w[0]), "{stamps:?}");
        assert!(plant.exchange(&sensed(9999)).is_none());
    }
}
