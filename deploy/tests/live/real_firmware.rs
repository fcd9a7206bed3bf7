//! Landing at Moderate with the makers' own firmware flying the simulated drone, if its program is on this computer.
//! `firmware.rs` flies the same plant with the tests' own firmware.

use std::{
    fs,
    net::{TcpListener, UdpSocket},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use alight_shared::mavlink::{MessageData as _, dialect as m};
use alight_uav::autopilot::{
    message::{
        Address, CommandLong, MavAutopilot, MavCmd, MavMessage, MavModeFlag, MavType, MavlinkMessage,
        heartbeat,
    },
    modes::{Firmware, px4_mode},
    wire::{Decoder, Encoder},
};

use crate::{
    common::{errors, free_port, printed, run},
    firmware::{Door, Link},
};

const PERSON: Address = Address::new(255, 190);
/// Height above the pad to which the pilot takes off, m.
const TAKE_OFF_M: f64 = 8.0;
/// Height above the pad beyond which the drone counts as flying, m.
const FLIES_M: f64 = 2.0;
/// Time that the firmware's estimator needs from its start, s.
const WARM_UP_S: &str = "80";
/// Parameters of the makers' simulators, as in docs/firmware.md; the last ones are values that a real vehicle gets by
/// calibration.
const COPTER: &str = "FRAME_CLASS 1\nFRAME_TYPE 1\nMOT_THST_EXPO 0\nMOT_SPIN_ARM 0.02\nMOT_SPIN_MIN 0.02\n\
                      MOT_SPIN_MAX 1\nGUID_OPTIONS 8\nGUID_TIMEOUT 0.3\nFS_THR_ENABLE 0\nBATT_MONITOR 4\nCOMPASS_OFS_X 5\n\
                      COMPASS_OFS_Y 13\nCOMPASS_OFS_Z -18\nCOMPASS_OFS2_X 5\nCOMPASS_OFS2_Y 13\n\
                      COMPASS_OFS2_Z -18\nCOMPASS_OFS3_X 5\nCOMPASS_OFS3_Y 13\nCOMPASS_OFS3_Z -18\n\
                      INS_ACCOFFS_X 0.001\nINS_ACCOFFS_Y 0.001\nINS_ACCOFFS_Z 0.001\nINS_ACCSCAL_X 1.001\n\
                      INS_ACCSCAL_Y 1.001\nINS_ACCSCAL_Z 1.001\nINS_ACC2OFFS_X 0.001\nINS_ACC2OFFS_Y 0.001\n\
                      INS_ACC2OFFS_Z 0.001\nINS_ACC2SCAL_X 1.001\nINS_ACC2SCAL_Y 1.001\nINS_ACC2SCAL_Z 1.001\n";

const PX4: [(&str, &str); 7] = [
    ("THR_MDL_FAC", "0"),
    ("MC_ROLL_P", "12"),
    ("MC_PITCH_P", "12"),
    ("MIS_TAKEOFF_ALT", "8"),
    ("COM_OF_LOSS_T", "0.25"),
    ("COM_OBL_RC_ACT", "5"),
    ("MPC_ACC_UP_MAX", "8"),
];

/// Pilot with a ground station, who arms, takes off and hands over the drone when the firmware permits it.
struct Person {
    firmware: Firmware,
    /// Second MAVLink of the firmware, for a ground station.
    link: Link,
    decoder: Decoder,
    encoder: Encoder,
    /// Number of heartbeats of the firmware, at 1 Hz.
    beats: u32,
    mode: u32,
    armed: bool,
    height_m: f64,
    aloft: u32,
    texts: Vec<String>,
}

impl Person {
    fn new(firmware: Firmware, link: Link) -> Person {
        Person {
            firmware,
            link,
            decoder: Decoder::default(),
            encoder: Encoder::default(),
            beats: 0,
            mode: 0,
            armed: false,
            height_m: 0.0,
            aloft: 0,
            texts: Vec::new(),
        }
    }
    fn send(&mut self, message: &MavlinkMessage) {
        self.link.send(&self.encoder.frame(PERSON, message).unwrap());
    }
    fn command<const N: usize>(&mut self, command: MavCmd, parameters: [f64; N]) {
        let to = Address::new(self.system(), 1);
        self.send(&CommandLong::new(to, command, parameters).into());
    }
    /// System id of the firmware: PX4 derives it from the instance number.
    fn system(&self) -> u8 {
        match self.firmware {
            Firmware::Px4 => PX4_INSTANCE + 1,
            Firmware::ArduCopter => 1,
        }
    }
    fn give_mode(&mut self, main: f64, sub: f64) {
        let to = Address::new(self.system(), 1);
        self.send(&CommandLong::mode(to, [main, sub]).into());
    }
    fn act(&mut self) {
        self.send(&heartbeat(
            MavAutopilot::MAV_AUTOPILOT_INVALID,
            MavType::MAV_TYPE_GCS,
            MavModeFlag::empty(),
            0,
        ));
        if self.beats <= 3 {
            let position = f64::from(m::LOCAL_POSITION_NED_DATA::ID);
            self.command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [position, 200_000.0]);
            return;
        }
        self.aloft += u32::from(self.armed && self.height_m > FLIES_M);
        if self.aloft > 0 && self.mode == self.ours() {
            return;
        }
        let arm = [1.0];
        match self.firmware {
            Firmware::ArduCopter if self.mode != self.ours() => self.give_mode(4.0, 0.0),
            Firmware::ArduCopter if !self.armed => self.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, arm),
            Firmware::ArduCopter => {
                self.command(
                    MavCmd::MAV_CMD_NAV_TAKEOFF,
                    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, TAKE_OFF_M],
                );
            }
            Firmware::Px4 if !self.armed && self.aloft == 0 => {
                self.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, arm)
            }
            // Take-off mode, then hold mode.
            Firmware::Px4 if self.aloft == 0 => self.give_mode(4.0, 2.0),
            Firmware::Px4 if self.aloft > 8 && self.armed => self.give_mode(6.0, 0.0),
            Firmware::Px4 => {}
        }
    }
    fn ours(&self) -> u32 {
        match self.firmware {
            Firmware::Px4 => px4_mode(6, 0),
            Firmware::ArduCopter => 4,
        }
    }
    fn fly(mut self, end: &AtomicBool) -> Person {
        // PX4 sends only to peers from which it has received.
        self.act();
        while !end.load(Ordering::Relaxed) {
            let bytes = self.link.receive().concat();
            if bytes.is_empty() {
                std::thread::sleep(Duration::from_millis(20));
            }
            if bytes.is_empty() && self.beats == 0 {
                self.act();
            }
            self.decoder.push(&bytes);
            while let Some(frame) = self.decoder.next_frame() {
                match frame.message {
                    MavlinkMessage::Common(MavMessage::HEARTBEAT(h))
                        if h.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID =>
                    {
                        self.mode = h.custom_mode;
                        self.armed = h.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
                        self.beats += 1;
                        self.act();
                    }
                    MavlinkMessage::Common(MavMessage::LOCAL_POSITION_NED(d)) => {
                        self.height_m = -f64::from(d.z)
                    }
                    MavlinkMessage::Text { text, .. } => self.texts.push(text),
                    _ => {}
                }
            }
        }
        self
    }
}

/// Instance number of PX4 on this computer, which determines its ports.
const PX4_INSTANCE: u8 = 7;

struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ended = self.0.kill();
        let _ended = self.0.wait();
    }
}

fn start(command: &mut Command, directory: &Path) -> Running {
    let log = std::fs::File::create(directory.join("firmware.txt")).unwrap();
    let running = command
        .current_dir(directory)
        .stdin(Stdio::null())
        .stderr(log.try_clone().unwrap())
        .stdout(log)
        .spawn();
    Running(running.expect("the firmware's program starts"))
}

fn ports() -> u16 {
    let free = |p: u16| TcpListener::bind(("127.0.0.1", p)).is_ok();
    (20_000..30_000)
        .step_by(10)
        .find(|p| free(*p) && free(p + 2))
        .expect("free ports")
}

/// Flies once; returns whether the landing succeeded.
fn flight(firmware: Firmware, program: &Path) -> bool {
    let name = format!("own-{}-{}", firmware as u8, std::process::id());
    let directory = std::env::temp_dir().join(&name);
    fs::create_dir_all(&directory).unwrap();
    let plant = match firmware {
        Firmware::ArduCopter => free_port(),
        Firmware::Px4 => 4560 + u16::from(PX4_INSTANCE),
    };
    let config = directory.join("plant.toml");
    fs::write(&config, format!("port = {plant}\n")).unwrap();
    let (kind, running, link, connect) = match firmware {
        Firmware::ArduCopter => {
            let base = ports();
            let parameters = directory.join("copter.parm");
            fs::write(&parameters, COPTER).unwrap();
            let mut command = Command::new(program);
            command
                .args(["--model", "JSON:127.0.0.1", "--home", "43.5,16.3,0,0", "--wipe"])
                .args(["--speedup", "10", "--base-port", &base.to_string()])
                .args(["--sim-port-out", &plant.to_string(), "--defaults"])
                .arg(&parameters);
            let connect = format!("tcpout://127.0.0.1:{base}");
            (
                "ardupilot",
                start(&mut command, &directory),
                Link::Tcp(Door::Dials(base + 2), None),
                connect,
            )
        }
        Firmware::Px4 => {
            let mut command = Command::new(program);
            command
                .args(["-d", "-i", &PX4_INSTANCE.to_string(), "-w"])
                .arg(&directory)
                .arg(program.parent().and_then(Path::parent).unwrap().join("etc"))
                .env("PX4_SIM_MODEL", "none_iris");
            for (key, value) in PX4 {
                command.env(format!("PX4_PARAM_{key}"), value);
            }
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            socket
                .connect(("127.0.0.1", 18570 + u16::from(PX4_INSTANCE)))
                .unwrap();
            socket.set_nonblocking(true).unwrap();
            let connect = format!("udpin://127.0.0.1:{}", 14540 + u16::from(PX4_INSTANCE));
            ("px4", start(&mut command, &directory), Link::Udp(socket), connect)
        }
    };
    let end = Arc::new(AtomicBool::new(false));
    let person = {
        let end = Arc::clone(&end);
        std::thread::spawn(move || Person::new(firmware, link).fly(&end))
    };
    let out = run(format!(
        "land --autopilot {kind} --external --connect {connect} --sea moderate --warm-up {WARM_UP_S} --seed 1 --json \
         --instance {name} --firmware {}",
        config.display()
    ));
    end.store(true, Ordering::Relaxed);
    let person = person.join().unwrap();
    drop(running);
    let errors = errors(&out);
    let text = printed(&out);
    let outcome: serde_json::Value = serde_json::from_str(text.lines().last().unwrap_or("null")).unwrap();
    println!("{outcome}");
    let success = outcome["outcome"] == "success";
    if !success {
        println!("{errors}\n{:#?}", person.texts);
    }
    assert!(person.aloft > 0, "it never flew: {:#?}\n{errors}", person.texts);
    if success {
        assert!(!person.armed, "it was not disarmed: {:#?}", person.texts);
    }
    let _removed = fs::remove_dir_all(&directory);
    success
}

/// Asserts a successful landing in one of two flights: a busy computer does not keep hard real time.
fn land(firmware: Firmware, variable: &str) {
    // One after the other, because they fly in real time.
    static ONE: Mutex<()> = Mutex::new(());
    let program = std::env::var_os(variable).expect("it names the firmware's program");
    let program = PathBuf::from(program);
    let _turn = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    if !flight(firmware, &program) {
        assert!(flight(firmware, &program), "neither of two flights was a success");
    }
}

#[test]
#[ignore = "needs ALIGHT_ARDUCOPTER=/path/to/arducopter"]
fn landing_of_the_ardupilot_firmware() {
    land(Firmware::ArduCopter, "ALIGHT_ARDUCOPTER");
}

#[test]
#[ignore = "needs ALIGHT_PX4=/path/to/bin/px4, with its etc next to bin"]
fn landing_of_the_px4_firmware() {
    land(Firmware::Px4, "ALIGHT_PX4");
}
