//! CAN frames as lines in candump's format. The interface is only read: nothing is ever sent to a boat's bus.

use core::fmt::Write;
use std::{
    fs::File,
    io::{self, ErrorKind},
    os::fd::OwnedFd,
};

use can_socket::CanSocket;

/// Size of the kernel's `can_frame` (linux/can.h): identifier with flags, length, 3 bytes, 8 bytes of data.
pub const FRAME: usize = 16;
/// Flags of the identifier: 29 bits, remote request, error.
const EXTENDED: u32 = 0x8000_0000;
const REQUEST: u32 = 0x4000_0000;
const ERROR: u32 = 0x2000_0000;

/// Opens an interface (`can0`), non-blocking.
pub fn open(interface: &str) -> io::Result<File> {
    let socket = CanSocket::bind(interface).map_err(|e| absent(interface, &e))?;
    socket.set_nonblocking(true)?;
    Ok(OwnedFd::from(socket).into())
}

fn absent(interface: &str, e: &io::Error) -> io::Error {
    let message = format!("{e}: bring it up: ip link set {interface} up type can bitrate 250000");
    io::Error::new(e.kind(), message)
}
/// Error of a read, with the remedy for an interface that is down, which opens but fails at the first read.
pub fn broken(interface: &str, e: io::Error) -> io::Error {
    match e.kind() {
        ErrorKind::NetworkDown => absent(interface, &e),
        _ => e,
    }
}

/// Line of a frame; empty for frames with 11-bit identifiers, which are not NMEA 2000.
pub fn line(interface: &str, frame: &[u8; FRAME]) -> String {
    let [a, b, c, d, length, _, _, _, data @ ..] = frame;
    let id = u32::from_ne_bytes([*a, *b, *c, *d]);
    if id & (EXTENDED | REQUEST | ERROR) != EXTENDED {
        return String::new();
    }
    let mut line = format!("{interface} {:08X}#", id & !EXTENDED);
    for byte in data.iter().take((*length).into()) {
        let _written = write!(line, "{byte:02X}");
    }
    line.push('\n');
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn can_frames_as_lines() {
        let frame = |id: u32, length: u8| {
            let [a, b, c, d] = id.to_ne_bytes();
            [
                a, b, c, d, length, 0, 0, 0, 0xa0, 0x7d, 0xe6, 0x18, 0xc0, 0x05, 0xfb, 0xd5,
            ]
        };
        let whole = "can0 09F80115#A07DE618C005FBD5\n";
        assert_eq!(line("can0", &frame(0x89f8_0115, 8)), whole);
        assert_eq!(line("can0", &frame(0x89f8_0115, 200)), whole);
        assert_eq!(line("can0", &frame(0x89f8_0115, 2)), "can0 09F80115#A07D\n");
        for other in [0x123, 0xc9f8_0115, 0xa9f8_0115] {
            assert_eq!(line("can0", &frame(other, 8)), "");
        }
    }

    #[test]
    fn can_interface_that_is_not_there() {
        let e = open("nocan7").unwrap_err().to_string();
        assert!(e.contains("ip link set nocan7 up"), "{e}");
    }

    #[test]
    fn can_interface_that_is_down() {
        let of = |kind: ErrorKind| broken("can1", kind.into()).to_string();
        let e = of(ErrorKind::NetworkDown);
        assert!(e.contains("ip link set can1 up"), "{e}");
        let e = of(ErrorKind::UnexpectedEof);
        assert!(!e.contains("ip link"), "{e}");
    }
}
