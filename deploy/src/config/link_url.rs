//! Addresses of autopilots, as MAVSDK writes them.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// Ports and rates that are usual when none is given: PX4's link for companions, ArduPilot's for the
/// first TCP client, a Pixhawk's telemetry port.
const UDP_PORT: u16 = 14540;
const TCP_PORT: u16 = 5760;
const BAUD: u32 = 57600;
/// Rates that serial ports know.
const BAUDS: [u32; 11] = [
    9600, 19200, 38400, 57600, 115_200, 230_400, 460_800, 500_000, 921_600, 1_500_000, 3_000_000,
];

/// A link by its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkUrl {
    /// Listens; answers the first peer.
    UdpIn(String),
    /// Sends to a peer.
    UdpOut(String),
    /// Listens for one connection.
    TcpIn(String),
    /// Connects.
    TcpOut(String),
    /// A serial port and its rate, Bd.
    Serial(PathBuf, u32),
}

/// The accepted forms.
const FORMS: &str = "write udpin://0.0.0.0:14540, udpout://HOST:PORT, tcpout://HOST:PORT, tcpin://0.0.0.0:PORT \
                     or serial:///dev/ttyACM0:921600";

impl FromStr for LinkUrl {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = |what: &str| format!("the address {text:?}: {what}; {FORMS}");
        let (kind, rest) = text
            .split_once(':')
            .ok_or_else(|| wrong("the kind of link is missing"))?;
        let rest = rest.strip_prefix("//").unwrap_or(rest);
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
            "udpin" => Ok(LinkUrl::UdpIn(host(UDP_PORT)?)),
            "udpout" => Ok(LinkUrl::UdpOut(host(UDP_PORT)?)),
            "tcpin" => Ok(LinkUrl::TcpIn(host(TCP_PORT)?)),
            "tcpout" => Ok(LinkUrl::TcpOut(host(TCP_PORT)?)),
            "serial" => {
                let (path, baud) = match rest.rsplit_once(':') {
                    Some((path, baud)) => (path, baud.parse().map_err(|_| wrong("not a baud rate"))?),
                    None => (rest, BAUD),
                };
                if !path.starts_with('/') {
                    return Err(wrong("not the absolute path of a device"));
                }
                if !BAUDS.contains(&baud) {
                    return Err(wrong("not a rate of serial ports"));
                }
                Ok(LinkUrl::Serial(path.into(), baud))
            }
            "udp" | "tcp" => Err(wrong("name the direction, udpin or udpout, tcpin or tcpout")),
            _ => Err(wrong("not a kind of link")),
        }
    }
}

impl fmt::Display for LinkUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LinkUrl::UdpIn(a) => write!(f, "udpin://{a}"),
            LinkUrl::UdpOut(a) => write!(f, "udpout://{a}"),
            LinkUrl::TcpIn(a) => write!(f, "tcpin://{a}"),
            LinkUrl::TcpOut(a) => write!(f, "tcpout://{a}"),
            LinkUrl::Serial(path, baud) => write!(f, "serial://{}:{baud}", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn link_url_with_and_without_slashes() {
        let url = |t: &str| t.parse::<LinkUrl>().unwrap();
        let listen = LinkUrl::UdpIn("0.0.0.0:14540".into());
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
        for u in [&listen, &serial] {
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
            "tcpout://a b:1",
        ] {
            let e = t.parse::<LinkUrl>().unwrap_err();
            assert!(
                e.contains("udpin://0.0.0.0:14540") && e.contains(&format!("{t:?}")),
                "{e}"
            );
        }
    }
}
