use std::{
    cell::RefCell,
    net::UdpSocket,
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    sync::{Condvar, Mutex, PoisonError},
    time::Duration,
};

use alight_lab::live::service::Service;
use alight_transport::radio::{Publication, TlsConfig, Urgency};
use serde_json::Value;

/// Number of test threads that use this computer, and whether one of them uses it exclusively.
static USERS: (Mutex<(usize, bool)>, Condvar) = (Mutex::new((0, false)), Condvar::new());

thread_local! {
    /// This thread's use of the computer, until the thread ends.
    static USE: RefCell<Option<Use>> = const { RefCell::new(None) };
}

struct Use {
    alone: bool,
}

impl Use {
    /// Waits until this thread may use the computer. A thread that waits for exclusive use does not block other
    /// threads, which may need the computer again first.
    fn begin(alone: bool) -> Use {
        let (users, changed) = &USERS;
        let free = |(users, taken): &mut (usize, bool)| *taken || alone && *users > 0;
        let users = users.lock().unwrap_or_else(PoisonError::into_inner);
        let mut users = changed
            .wait_while(users, free)
            .unwrap_or_else(PoisonError::into_inner);
        if alone {
            users.1 = true;
        } else {
            users.0 += 1;
        }
        Use { alone }
    }
}

impl Drop for Use {
    fn drop(&mut self) {
        let (users, changed) = &USERS;
        let mut users = users.lock().unwrap_or_else(PoisonError::into_inner);
        if self.alone {
            users.1 = false;
        } else {
            users.0 -= 1;
        }
        changed.notify_all();
    }
}

/// Reserves the computer for this test. On two processors a flight of two computers' processes with a rendered camera
/// stops for half a second while another flight starts, which ends in the autopilot's hold.
pub fn alone() {
    USE.with_borrow_mut(|u| {
        *u = None;
        *u = Some(Use::begin(true));
    });
}

fn with_others() {
    USE.with_borrow_mut(|u| {
        u.get_or_insert_with(|| Use::begin(false));
    });
}

pub fn alight(arguments: impl AsRef<str>) -> Command {
    with_others();
    let mut command = Command::new(env!("CARGO_BIN_EXE_alight"));
    command.args(arguments.as_ref().split_whitespace());
    command
}

pub fn run(arguments: impl AsRef<str>) -> Output {
    alight(arguments)
        .stdin(Stdio::null())
        .output()
        .expect("the program runs")
}

/// Starts the program under test with these arguments; the test reads both outputs.
pub fn started(arguments: impl AsRef<str>) -> Child {
    alight(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts")
}

pub fn errors(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

pub fn printed(out: &Output) -> String {
    String::from_utf8_lossy(&out.stdout).into_owned()
}

/// Asserts that the exit code is that of the worst finding.
pub fn assert_exit(out: &Output, status: &Value) {
    let mut codes = (0_i32..).zip(["fine", "warning", "broken"]);
    let worst = codes.find(|(_, level)| status["worst"] == *level);
    assert_eq!(out.status.code(), worst.map(|(code, _)| code), "{status}");
}

/// Repeats `look` until its output is `wanted`, for at most about two minutes.
#[track_caller]
pub fn once(what: &str, mut look: impl FnMut() -> Value, mut wanted: impl FnMut(&Value) -> bool) -> Value {
    for _ in 0..600 {
        let now = look();
        if wanted(&now) {
            return now;
        }
        std::thread::sleep(Duration::from_millis(200));
    }
    panic!("{what}: timed out: {}", look());
}

pub fn instance(test: &str) -> String {
    format!("{test}-{}", std::process::id())
}

/// Path of a temporary file or directory that no other test uses.
pub fn scratch(name: &str) -> PathBuf {
    with_others();
    std::env::temp_dir().join(format!("alight-{name}-{}", std::process::id()))
}

pub fn service(name: &'static str, directory: &Path, more: &[&str]) -> Service {
    with_others();
    Service::start(name, &[env!("CARGO_BIN_EXE_alight")], directory, more).expect("starts")
}

/// Process that ends with its test, when its standard input closes.
pub struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        drop(self.0.stdin.take());
        let _ended = self.0.wait();
    }
}

pub fn free_udp() -> String {
    format!("127.0.0.1:{}", free_port())
}

pub fn free_port() -> u16 {
    with_others();
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    socket.local_addr().expect("an address").port()
}

pub fn signal(pid: u64, signal: &str) {
    let done = Command::new("kill").args([signal, &pid.to_string()]).status();
    assert!(done.expect("kill runs").success());
}

/// Creates an authority with a vessel 1 and a drone 1, using the program itself; returns its directory.
pub fn certificates(name: &str) -> PathBuf {
    let directory = scratch(&format!("certificates-{name}"));
    let _none = std::fs::remove_dir_all(&directory);
    keys(&directory, "init --days 2");
    keys(&directory, "vessel 1 --address 127.0.0.1");
    keys(&directory, "drone 1");
    directory
}

pub fn keys(directory: &Path, what: &str) {
    let out = run(format!("keys {what} --dir {}", directory.display()));
    assert!(out.status.success(), "alight keys {what}: {out:?}");
}

/// TLS configuration with the files of one side; it admits only `peers`.
pub fn tls(directory: &Path, peers: &[&str]) -> TlsConfig {
    let file = |name: &str| directory.join(name).display().to_string();
    TlsConfig {
        authority: file("authority.pem"),
        certificate: file("certificate.pem"),
        key: file("key.pem"),
        peers: peers.iter().map(|p| (*p).to_owned()).collect(),
        ..TlsConfig::default()
    }
}

pub fn publication(key: &str) -> Vec<Publication> {
    vec![Publication::new(key, Urgency::State)]
}
