//! Notification of the service manager (systemd): ready, alive, status. Each is one datagram to the socket in
//! NOTIFY_SOCKET (sd_notify(3)); without that variable nothing is sent.
//!
//! The crate sd-notify is not used: its send blocks once a stopped manager has ten queued datagrams, and would block
//! the flight.

use std::os::{
    linux::net::SocketAddrExt,
    unix::net::{SocketAddr, UnixDatagram},
};

/// Period of watchdog messages, ns; every common watchdog timeout is several times longer.
const ALIVE_PERIOD_NS: i64 = 500_000_000;
const MAX_STATUS: usize = 200;
pub const SOCKET_VARIABLE: &str = "NOTIFY_SOCKET";

pub struct Notify {
    to: Option<(UnixDatagram, SocketAddr)>,
    ready: bool,
    next_ns: i64,
}

impl Default for Notify {
    fn default() -> Self {
        Notify::to(&std::env::var(SOCKET_VARIABLE).unwrap_or_default())
    }
}

impl Notify {
    /// Connects to the socket `name`: a path, or `@` and an abstract name.
    fn to(name: &str) -> Notify {
        let address = match name.strip_prefix('@') {
            Some(name) => SocketAddr::from_abstract_name(name),
            None => SocketAddr::from_pathname(name),
        };
        let socket = UnixDatagram::unbound()
            .ok()
            .filter(|s| s.set_nonblocking(true).is_ok());
        Notify {
            to: socket.zip(address.ok()).filter(|_| !name.is_empty()),
            ready: false,
            next_ns: i64::MIN,
        }
    }
    fn send(&self, text: &str) {
        if let Some((socket, to)) = &self.to {
            // A lost datagram is replaced by a later one.
            let _full = socket.send_to_addr(text.as_bytes(), to);
        }
    }
    pub fn ready(&mut self) {
        if !std::mem::replace(&mut self.ready, true) {
            self.send("READY=1");
        }
    }
    /// Notifies the watchdog when due, with a status of one line.
    pub fn alive(&mut self, now_ns: i64, status: impl FnOnce() -> String) {
        if now_ns < self.next_ns || self.to.is_none() {
            return;
        }
        self.next_ns = now_ns + ALIVE_PERIOD_NS;
        let plain = |c: char| if c.is_control() { ' ' } else { c };
        let line: String = status().chars().map(plain).take(MAX_STATUS).collect();
        self.send(&format!("WATCHDOG=1\nSTATUS={line}"));
    }
    pub fn stopping(&self) {
        self.send("STOPPING=1");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::scratch;

    fn received(socket: &UnixDatagram) -> String {
        let mut buffer = [0; 512];
        let n = socket.recv(&mut buffer).unwrap();
        String::from_utf8_lossy(&buffer[..n]).into_owned()
    }

    #[test]
    fn service_notifications() {
        let path = scratch("notify");
        let _none = std::fs::remove_file(&path);
        let by_path = UnixDatagram::bind(&path).unwrap();
        let name = format!("alight-notify-{}", std::process::id());
        let address = SocketAddr::from_abstract_name(&name).unwrap();
        let by_name = UnixDatagram::bind_addr(&address).unwrap();
        for (socket, name) in [
            (by_path, path.display().to_string()),
            (by_name, format!("@{name}")),
        ] {
            socket.set_nonblocking(true).unwrap();
            let mut notify = Notify::to(&name);
            notify.ready();
            notify.ready();
            for k in 0..10 {
                notify.alive(k * ALIVE_PERIOD_NS / 5, || "Tracking:\nfine".into());
            }
            notify.stopping();
            assert_eq!(received(&socket), "READY=1");
            assert_eq!(received(&socket), "WATCHDOG=1\nSTATUS=Tracking: fine");
            assert_eq!(received(&socket), "WATCHDOG=1\nSTATUS=Tracking: fine");
            assert_eq!(received(&socket), "STOPPING=1");
            assert!(socket.recv(&mut [0]).is_err());
        }
        std::fs::remove_file(&path).unwrap();
        let mut unsupervised = Notify::to("");
        unsupervised.ready();
        unsupervised.alive(0, || panic!("no receiver"));
    }

    #[test]
    fn service_with_a_manager_that_reads_nothing() {
        let name = format!("alight-notify-full-{}", std::process::id());
        let address = SocketAddr::from_abstract_name(&name).unwrap();
        let _unread = UnixDatagram::bind_addr(&address).unwrap();
        let mut notify = Notify::to(&format!("@{name}"));
        let mut sent = 0;
        for k in 0..10_000 {
            notify.alive(k * ALIVE_PERIOD_NS, || {
                sent += 1;
                "Tracking".into()
            });
        }
        assert_eq!(sent, 10_000);
    }
}
