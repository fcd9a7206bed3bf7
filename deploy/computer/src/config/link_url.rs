//! Addresses of autopilots and sensors in MAVSDK's form. A listening address may name the only accepted sender
//! (`?from=HOST`); a Signal K server may need a token (`?token=FILE`).

use std::{fmt, net::IpAddr, path::PathBuf, str::FromStr};

/// Default ports and rates: PX4's link for companion computers, ArduPilot's for the first TCP client, a Pixhawk's
/// telemetry port, a Signal K server.
const UDP_PORT: u16 = 14540;
const TCP_PORT: u16 = 5760;
const BAUD: u32 = 57600;
const SIGNALK_PORT: u16 = 3000;
/// Maximum length of a network interface's name (IFNAMSIZ without the terminator).
const MAX_INTERFACE: usize = 15;
/// Baud rates of serial ports; NMEA 0183 uses 4800.
const BAUDS: [u32; 12] = [
    4800, 9600, 19200, 38400, 57600, 115_200, 230_400, 460_800, 500_000, 921_600, 1_500_000, 3_000_000,
];

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkUrl {
    /// Listens, optionally to this address only; replies to the first peer.
    UdpIn(String, Option<IpAddr>),
    UdpOut(String),
    /// Listens for one connection, optionally from this address only.
    TcpIn(String, Option<IpAddr>),
    TcpOut(String),
    Serial(PathBuf, u32),
    Can(String),
    /// Signal K server, and the file of its token if it needs one.
    SignalK(String, Option<PathBuf>),
}

const FORMS: &str = "write udpin://127.0.0.1:14540, udpin://0.0.0.0:14540?from=IP, udpout://HOST:PORT, \
                     tcpout://HOST:PORT, tcpin://127.0.0.1:PORT or serial:///dev/ttyACM0:921600; a sensor may be at \
                     can://can0 or ws://HOST:3000, too";

impl LinkUrl {
    /// Address of an autopilot. A link that listens on a whole network must name the autopilot's address; otherwise
    /// the first sender would be taken for the autopilot.
    pub fn of_autopilot(text: &str) -> Result<LinkUrl, String> {
        let open = format!(
            "and the first that sends would be taken for the autopilot: write udpin://127.0.0.1:PORT for one on this \
             computer, {text}?from=IP for one at the address IP, or a serial line"
        );
        Self::of_one_sender(text, &open, "not an autopilot's link")
    }
    /// Address of an NMEA 0183 receiver, on any link except a boat's bus. A listening link must name the receiver's
    /// address, because any other sender could steer the drone.
    pub fn of_sentences(text: &str) -> Result<LinkUrl, String> {
        let open = format!(
            "any of which could lead the drone: write {text}?from=IP for a receiver at the address IP, tcpout://HOST:PORT or \
             a serial line"
        );
        Self::of_one_sender(text, &open, "not a line of NMEA 0183")
    }
    /// Address of the drone's own GNSS receiver; the rules of [`Self::of_sentences`] apply.
    pub fn of_receiver(text: &str) -> Result<LinkUrl, String> {
        let open = format!(
            "any of which could give the drone a false place: write {text}?from=IP for a receiver at the address IP, \
             tcpout://HOST:PORT or a serial line"
        );
        Self::of_one_sender(text, &open, "not a GNSS receiver's line")
    }
    /// Address of a single sender. `open` completes the error for an address that is open to every sender, `bus` the
    /// error for a boat's bus.
    fn of_one_sender(text: &str, open: &str, bus: &str) -> Result<LinkUrl, String> {
        let url: LinkUrl = text.parse()?;
        match &url {
            LinkUrl::UdpIn(at, None) | LinkUrl::TcpIn(at, None) if !is_own(at) => Err(format!(
                "the address {text:?} is open to every computer of the network, {open}"
            )),
            LinkUrl::Can(_) | LinkUrl::SignalK(..) => Err(format!(
                "the address {text:?} is a boat's bus, which is {bus}; {FORMS}"
            )),
            LinkUrl::UdpIn(..)
            | LinkUrl::TcpIn(..)
            | LinkUrl::UdpOut(_)
            | LinkUrl::TcpOut(_)
            | LinkUrl::Serial(..) => Ok(url),
        }
    }
}

fn is_own(at: &str) -> bool {
    let host = at.rsplit_once(':').map_or(at, |(host, _)| host);
    let address = host.trim_matches(['[', ']']).parse::<IpAddr>();
    address.map_or(host == "localhost", |a| a.is_loopback())
}

fn serial(rest: &str) -> Result<LinkUrl, &'static str> {
    let (path, baud) = match rest.rsplit_once(':') {
        Some((path, baud)) => (path, baud.parse().map_err(|_| "not a baud rate")?),
        None => (rest, BAUD),
    };
    if !path.starts_with('/') {
        return Err("not the absolute path of a device");
    }
    if !BAUDS.contains(&baud) {
        return Err("not a rate of serial ports");
    }
    Ok(LinkUrl::Serial(path.into(), baud))
}

impl FromStr for LinkUrl {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = |what: &str| format!("the address {text:?}: {what}; {FORMS}");
        let (kind, rest) = text
            .split_once(':')
            .ok_or_else(|| wrong("the kind of link is missing"))?;
        let rest = rest.strip_prefix("//").unwrap_or(rest);
        let (rest, token) = match rest.split_once("?token=") {
            Some((rest, file)) if kind == "ws" && file.starts_with('/') => (rest, Some(file.into())),
            Some(_) => {
                return Err(wrong(
                    "token= is only for ws, and names the absolute path of a file",
                ));
            }
            None => (rest, None),
        };
        let (rest, from) = match rest.split_once("?from=") {
            Some((rest, ip)) => (
                rest,
                Some(
                    ip.parse::<IpAddr>()
                        .map_err(|_| wrong("not an IP address after from="))?,
                ),
            ),
            None => (rest, None),
        };
        if from.is_some() && !matches!(kind, "udpin" | "tcpin") {
            return Err(wrong("from= is only for udpin and tcpin"));
        }
        let host = |port: u16| -> Result<String, String> {
            let (host, port) = match rest.rsplit_once(':') {
                Some((host, port)) => (
                    host,
                    port.parse()
                        .ok()
                        .filter(|p| *p > 0)
                        .ok_or_else(|| wrong("not a port number"))?,
                ),
                None => (rest, port),
            };
            let sound = !host.is_empty()
                && host
                    .chars()
                    .all(|c| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_' | '[' | ']' | ':'));
            if sound {
                Ok(format!("{host}:{port}"))
            } else {
                Err(wrong("not a host"))
            }
        };
        match kind {
            "udpin" => Ok(LinkUrl::UdpIn(host(UDP_PORT)?, from)),
            "udpout" => Ok(LinkUrl::UdpOut(host(UDP_PORT)?)),
            "tcpin" => Ok(LinkUrl::TcpIn(host(TCP_PORT)?, from)),
            "tcpout" => Ok(LinkUrl::TcpOut(host(TCP_PORT)?)),
            "serial" => serial(rest).map_err(wrong),
            "can" => {
                let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_');
                let sound = (1..=MAX_INTERFACE).contains(&rest.len()) && rest.chars().all(allowed);
                sound
                    .then(|| LinkUrl::Can(rest.into()))
                    .ok_or_else(|| wrong("not the name of an interface"))
            }
            "ws" => Ok(LinkUrl::SignalK(host(SIGNALK_PORT)?, token)),
            "wss" => Err(wrong(
                "without encryption only: ws on the boat's own network, or through a tunnel",
            )),
            "udp" | "tcp" => Err(wrong("name the direction, udpin or udpout, tcpin or tcpout")),
            _ => Err(wrong("not a kind of link")),
        }
    }
}

impl fmt::Display for LinkUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LinkUrl::UdpIn(a, None) => write!(f, "udpin://{a}"),
            LinkUrl::UdpIn(a, Some(from)) => write!(f, "udpin://{a}?from={from}"),
            LinkUrl::UdpOut(a) => write!(f, "udpout://{a}"),
            LinkUrl::TcpIn(a, None) => write!(f, "tcpin://{a}"),
            LinkUrl::TcpIn(a, Some(from)) => write!(f, "tcpin://{a}?from={from}"),
            LinkUrl::TcpOut(a) => write!(f, "tcpout://{a}"),
            LinkUrl::Serial(path, baud) => write!(f, "serial://{}:{baud}", path.display()),
            LinkUrl::Can(interface) => write!(f, "can://{interface}"),
            LinkUrl::SignalK(a, None) => write!(f, "ws://{a}"),
            LinkUrl::SignalK(a, Some(token)) => write!(f, "ws://{a}?token={}", token.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn link_url_with_and_without_slashes() {
        let url = |t: &str| t.parse::<LinkUrl>().unwrap();
        let listen = LinkUrl::UdpIn("0.0.0.0:14540".into(), None);
        for t in ["udpin://0.0.0.0:14540", "udpin:0.0.0.0:14540", "udpin://0.0.0.0"] {
            assert_eq!(url(t), listen);
        }
        assert_eq!(
            url("tcpout://localhost"),
            LinkUrl::TcpOut("localhost:5760".into())
        );
        let serial = LinkUrl::Serial("/dev/ttyACM0".into(), 921_600);
        assert_eq!(url("serial:/dev/ttyACM0:921600"), serial);
        assert_eq!(url("serial:///dev/ttyACM0:921600"), serial);
        let from = url("udpin://0.0.0.0?from=192.168.7.20");
        assert_eq!(
            from,
            LinkUrl::UdpIn("0.0.0.0:14540".into(), Some([192, 168, 7, 20].into()))
        );
        assert_eq!(url("can://can0"), LinkUrl::Can("can0".into()));
        let server = url("ws://venus.local?token=/etc/alight/signalk.token");
        let token = Some("/etc/alight/signalk.token".into());
        assert_eq!(server, LinkUrl::SignalK("venus.local:3000".into(), token));
        for u in [
            &listen,
            &serial,
            &from,
            &server,
            &url("can://can0"),
            &url("ws://10.0.0.7:80"),
        ] {
            assert_eq!(&url(&u.to_string()), u);
        }
    }

    #[test]
    fn link_url_error() {
        for t in [
            "",
            "udpin",
            "udp://:14540",
            "udpin://:14540",
            "udpin://0.0.0.0:port",
            "udpin://0.0.0.0:0",
            "udpout://0.0.0.0:99999",
            "serial:ttyACM0:921600",
            "serial:/dev/ttyACM0:fast",
            "serial:/dev/ttyACM0:1",
            "http://host:80",
            "udpin://0.0.0.0:14540?from=autopilot",
            "udpout://127.0.0.1:14540?from=127.0.0.1",
            "tcpout://a b:1",
            "can://",
            "can://can0/..",
            "wss://venus.local",
            "ws://venus.local/signalk",
            "ws://venus.local?token=signalk.token",
            "tcpout://venus.local:3000?token=/token",
        ] {
            let e = t.parse::<LinkUrl>().unwrap_err();
            assert!(
                e.contains("udpin://127.0.0.1:14540") && e.contains(&format!("{t:?}")),
                "{e}"
            );
        }
    }

    #[test]
    fn autopilot_address_open_to_a_network() {
        for open in [
            "udpin://0.0.0.0:14540",
            "udpin://192.168.7.2",
            "udpin://[::]:14540",
            "tcpin://0.0.0.0:5760",
            "udpin://boat",
        ] {
            let why = LinkUrl::of_autopilot(open).unwrap_err();
            assert!(
                why.contains(&format!("{open}?from=IP")) && why.contains("udpin://127.0.0.1"),
                "{why}"
            );
        }
        for bus in ["can://can0", "ws://127.0.0.1"] {
            assert!(
                LinkUrl::of_autopilot(bus)
                    .unwrap_err()
                    .contains("not an autopilot's link")
            );
        }
        for owned in [
            "udpin://127.0.0.1:14540",
            "udpin://localhost:14540",
            "udpin://[::1]:14540",
            "udpin://0.0.0.0:14540?from=192.168.7.20",
            "udpout://192.168.7.20:14550",
            "tcpout://192.168.7.20:5760",
            "serial:///dev/ttyACM0:921600",
        ] {
            assert!(LinkUrl::of_autopilot(owned).is_ok(), "{owned}");
        }
    }

    #[test]
    fn receiver_address_open_to_a_network() {
        for open in ["udpin://0.0.0.0:10110", "tcpin://192.168.7.2:10110"] {
            let why = LinkUrl::of_sentences(open).unwrap_err();
            assert!(why.contains(&format!("{open}?from=IP")), "{why}");
        }
        for owned in [
            "udpin://127.0.0.1:10110",
            "udpin://0.0.0.0:10110?from=192.168.7.5",
            "tcpout://gateway:10110",
            "serial:///dev/ttyUSB1:38400",
        ] {
            assert!(LinkUrl::of_sentences(owned).is_ok(), "{owned}");
        }
    }
}
