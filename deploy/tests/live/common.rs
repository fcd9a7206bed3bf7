//! What tests of processes share: the program, its certificates, ports, signals.

use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};

use alight_shared::transport::radio::{Publication, TlsConfig, Urgency};

/// The program under test.
pub fn alight() -> Command {
    Command::new(env!("CARGO_BIN_EXE_alight"))
}

/// An instance that no other test uses.
pub fn instance(test: &str) -> String {
    format!("{test}-{}", std::process::id())
}

/// A file or directory for temporary things that no other test uses.
pub fn scratch(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("alight-{name}-{}", std::process::id()))
}

/// A process whose standard input closes with its test, on which it ends.
pub struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        drop(self.0.stdin.take());
        let _ended = self.0.wait();
    }
}

/// An address of the loopback interface that is free.
pub fn free_udp() -> String {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    socket.local_addr().expect("an address").to_string()
}

/// A port of the loopback interface that is free.
pub fn free_port() -> u16 {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    socket.local_addr().expect("an address").port()
}

/// Sends `signal`, such as -STOP, to a process.
pub fn signal(pid: u64, signal: &str) {
    let done = Command::new("kill").args([signal, &pid.to_string()]).status();
    assert!(done.expect("kill runs").success());
}

/// An authority with a vessel 1 and a drone 1, made by the program itself; its directory.
pub fn certificates(name: &str) -> PathBuf {
    let directory = scratch(&format!("certificates-{name}"));
    let _none = std::fs::remove_dir_all(&directory);
    keys(&directory, &["init", "--days", "2"]);
    keys(&directory, &["vessel", "1", "--address", "127.0.0.1"]);
    keys(&directory, &["drone", "1"]);
    directory
}

/// `alight keys WHAT --dir DIRECTORY`.
pub fn keys(directory: &Path, what: &[&str]) {
    let mut command = alight();
    command.arg("keys").args(what).arg("--dir").arg(directory);
    let out = command.output().expect("the program runs");
    assert!(out.status.success(), "alight keys {what:?}: {out:?}");
}

/// The files of one side, which admits `peers`.
pub fn tls(directory: &Path, peers: &[&str]) -> TlsConfig {
    let file = |name: &str| directory.join(name).display().to_string();
    TlsConfig {
        authority: file("authority.pem"),
        certificate: file("certificate.pem"),
        key: file("key.pem"),
        peers: peers.iter().map(|p| (*p).to_owned()).collect(),
    }
}

/// One key to publish on.
pub fn publication(key: &str) -> Vec<Publication> {
    vec![Publication {
        key: key.into(),
        urgency: Urgency::State,
    }]
}
