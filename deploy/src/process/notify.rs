//! What a service tells its manager (systemd): that it is ready, that it is alive, what it does. One
//! datagram each to the socket named in NOTIFY_SOCKET (sd_notify(3)); nothing without that name.

use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

/// Time between two words that the service is alive, ns: several within any watchdog's patience.
const ALIVE_PERIOD_NS: i64 = 500_000_000;
/// Longest line of status.
const STATUS: usize = 200;

/// The way to the service's manager.
pub struct Notify {
    to: Option<(UnixDatagram, SocketAddr)>,
    ready: bool,
    next_ns: i64,
}

impl Notify {
    /// As the manager asked for it.
    pub fn from_environment() -> Notify {
        Notify::to(&std::env::var("NOTIFY_SOCKET").unwrap_or_default())
    }
    /// To the socket `name`: a path, or `@` and an abstract name.
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
    fn say(&self, text: &str) {
        if let Some((socket, to)) = &self.to {
            // A manager that does not listen has nothing to miss.
            let _unheard = socket.send_to_addr(text.as_bytes(), to);
        }
    }
    /// Everything is there; said once.
    pub fn ready(&mut self) {
        if !self.ready {
            self.ready = true;
            self.say("READY=1");
        }
    }
    /// The loop goes round; what it does, in one line.
    pub fn alive(&mut self, now_ns: i64, status: impl FnOnce() -> String) {
        if now_ns < self.next_ns || self.to.is_none() {
            return;
        }
        self.next_ns = now_ns + ALIVE_PERIOD_NS;
        let line: String = status()
            .chars()
            .map(|c| if c.is_control() { ' ' } else { c })
            .take(STATUS)
            .collect();
        self.say(&format!("WATCHDOG=1\nSTATUS={line}"));
    }
    /// It ends because it was told to.
    pub fn stopping(&self) {
        self.say("STOPPING=1");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(socket: &UnixDatagram) -> String {
        let mut buffer = [0; 512];
        let n = socket.recv(&mut buffer).unwrap();
        String::from_utf8_lossy(&buffer[..n]).into_owned()
    }

    #[test]
    fn the_manager_hears_ready_once_and_life_no_more_often_than_its_period() {
        let path = std::env::temp_dir().join(format!("alight-notify-{}", std::process::id()));
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
            assert_eq!(heard(&socket), "READY=1");
            assert_eq!(heard(&socket), "WATCHDOG=1\nSTATUS=Tracking: fine");
            assert_eq!(heard(&socket), "WATCHDOG=1\nSTATUS=Tracking: fine");
            assert_eq!(heard(&socket), "STOPPING=1");
            assert!(socket.recv(&mut [0]).is_err());
        }
        std::fs::remove_file(&path).unwrap();
        let mut nobody = Notify::to("");
        nobody.ready();
        nobody.alive(0, || panic!("nobody listens"));
    }
}
