//! `alight autopilot` as a process on real sockets and shared memory, the simulated autopilot at
//! the other end. Nothing here asserts a time: bounds on waiting are only against tests that never end.
use std::net::UdpSocket;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use alight_shared::geometry::{DroneGeometry, GRAVITY};
use alight_shared::msg::{
    AutopilotMode, AutopilotState, DroneState, Header, MissionState, SetPoint, SetPointKind, State,
};
use alight_shared::time::{DroneClock, Time};
use alight_sim::autopilots::simulated::{SimulatedAutopilot, mode_number};
use alight_sim::physics::drone::{AutopilotConfig, NavigationConfig, PlantState};
use alight_sim::physics::streams::Streams;
use alight_transport::clock::ProcessClock;
use alight_transport::memory;
use alight_uav::autopilot::modes::Firmware;

use nalgebra::Vector3;

use crate::common::{alight, errors};

/// Wait of a round of the test, and the number of rounds that it waits for anything at most.
const ROUND: Duration = Duration::from_millis(4);
const MAX_ROUNDS: u32 = 10_000;

struct Scene {
    instance: memory::Instance,
    _services: memory::Services,
    child: Child,
    socket: UdpSocket,
    autopilot: SimulatedAutopilot,
    began: Instant,
    to_it: Vec<Vec<u8>>,
    odometry: memory::Subscriber<DroneState>,
    states: memory::Subscriber<AutopilotState>,
    set_points: memory::Publisher<SetPoint>,
    missions: memory::Publisher<MissionState>,
    sequence: u32,
    mission: State,
    newest: Option<DroneState>,
    state: AutopilotState,
    received: u32,
}

/// A drone that stands still in the air.
fn still() -> PlantState {
    PlantState {
        position: Vector3::new(0.0, 0.0, -5.0),
        specific_force: Vector3::new(0.0, 0.0, -GRAVITY),
        ..PlantState::default()
    }
}
fn hovering(firmware: Firmware) -> SimulatedAutopilot {
    let c = AutopilotConfig {
        firmware,
        ..AutopilotConfig::default()
    };
    let (n, streams) = (NavigationConfig::default(), Streams::new(1));
    SimulatedAutopilot::new(&c, &n, &DroneGeometry::default(), &streams, &still(), 0.4)
}

impl Drop for Scene {
    fn drop(&mut self) {
        drop(self.child.stdin.take());
        let _ended = self.child.wait();
        let _left = self.instance.wipe();
        let _left = std::fs::remove_dir_all(self.instance.directory());
    }
}

impl Scene {
    fn begin(firmware: Firmware) -> Scene {
        let name = format!("mav-{}-{}", firmware as u8, std::process::id());
        let instance = memory::Instance::new(&name).unwrap();
        std::fs::create_dir_all(instance.directory()).unwrap();
        let memory = memory::Memory::join(&instance, "test").unwrap();
        let services = memory::Services::create(&memory).unwrap();
        let config = instance.directory().join("drone.toml");
        std::fs::write(&config, format!("instance = {name:?}\n")).unwrap();
        // Both ends on ports that are free now.
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_nonblocking(true).unwrap();
        let ours = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        socket.connect(ours).unwrap();
        let arguments = format!(
            "autopilot --supervised --connect udpin://{ours} --config {}",
            config.display()
        );
        let child = alight(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        Scene {
            odometry: memory.subscriber().unwrap(),
            states: memory.subscriber().unwrap(),
            set_points: memory.publisher().unwrap(),
            missions: memory.publisher().unwrap(),
            instance,
            _services: services,
            child,
            socket,
            autopilot: hovering(firmware),
            began: Instant::now(),
            to_it: Vec::new(),
            sequence: 0,
            mission: State::Idle,
            newest: None,
            state: AutopilotState::default(),
            received: 0,
        }
    }

    fn round(&mut self) {
        std::thread::sleep(ROUND);
        let mut buffer = [0; 2048];
        while let Ok(n) = self.socket.recv(&mut buffer) {
            self.to_it.push(buffer[..n].to_vec());
        }
        let t_s = self.began.elapsed().as_secs_f64();
        let truth = PlantState {
            at: Time::from_secs(t_s),
            ..still()
        };
        let (_, sent) = self
            .autopilot
            .step_bytes(&truth, &std::mem::take(&mut self.to_it));
        for bytes in sent {
            // The program may not listen yet.
            let _lost = self.socket.send(&bytes);
        }
        let now: Time<DroneClock> = ProcessClock::default().now();
        for m in self.odometry.all(now.nanos()) {
            self.received += 1;
            self.newest = Some(m);
        }
        self.state = self.states.newest(now.nanos()).unwrap_or(self.state);
        self.sequence += 1;
        let header = Header::new(1, 1, 1, self.sequence, now);
        self.missions.send(&MissionState {
            header,
            state: self.mission,
            ..MissionState::default()
        });
        if let Some(d) = self.newest {
            self.set_points.send(&SetPoint {
                header,
                kind: SetPointKind::Trajectory,
                position: d.position,
                ..SetPoint::default()
            });
        }
    }

    fn until(&mut self, what: &str, done: impl Fn(&Scene) -> bool) {
        for _ in 0..MAX_ROUNDS {
            if done(self) {
                return;
            }
            self.round();
            assert!(
                self.child.try_wait().unwrap().is_none(),
                "the program ended: {what}"
            );
        }
        panic!("{what} did not happen");
    }
}

#[test]
fn handover_and_takeover_over_udp() {
    for firmware in [Firmware::Px4, Firmware::ArduCopter] {
        let mut s = Scene::begin(firmware);
        s.until("odometry", |s| s.received > 100);
        // PX4 rejects it until set-points were offered long enough: the pilot tries again.
        for _ in 0..MAX_ROUNDS {
            if s.autopilot.choose(mode_number(firmware, AutopilotMode::Offboard)) {
                break;
            }
            s.round();
        }
        s.until("our mode", |s| s.state.mode == AutopilotMode::Offboard);
        // A landing is commanded: in flight nothing is offered, and GUIDED is no longer left to itself.
        s.mission = State::Tracking;
        let n = s.autopilot.set_points;
        s.until("set-points", |s| s.autopilot.set_points > n + 100);
        s.autopilot.choose(mode_number(firmware, AutopilotMode::Other));
        s.until("the other mode", |s| s.state.mode == AutopilotMode::Other);
        // What was under way arrives; then nothing more, although the pilot goes on.
        (0..25).for_each(|_| s.round());
        let n = s.autopilot.set_points;
        (0..100).for_each(|_| s.round());
        assert_eq!(s.autopilot.set_points, n, "{firmware:?}");
        assert_eq!(s.autopilot.mode(), mode_number(firmware, AutopilotMode::Other));
    }
}

#[test]
fn autopilot_process_malformed_address() {
    let name = format!("mav-wrong-{}", std::process::id());
    let config = std::env::temp_dir().join(format!("{name}.toml"));
    std::fs::write(&config, format!("instance = {name:?}\n")).unwrap();
    for url in ["udp://:14540", "serial:ttyACM0", "tcpout://no such host:1"] {
        let out = alight("autopilot --connect")
            .args([url, "--config"])
            .arg(&config)
            .output()
            .unwrap();
        let errors = errors(&out);
        assert_eq!(out.status.code(), Some(2), "{url}: {errors}");
        assert!(errors.contains("serial:///dev/ttyACM0:921600"), "{errors}");
    }
    let _removed = std::fs::remove_file(config);
}
