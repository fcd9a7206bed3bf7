//! Lines between simulated devices and the computers: pseudo-terminals in place of serial ports, or UDP.
//!
//! Only the sensor's end is held open. The computer's end has a fixed path, like the name of a USB adapter. After the
//! computer has closed it, a new pseudo-terminal replaces it, because the old one keeps unread bytes and its reader's
//! exclusive mode (TIOCEXCL).

use std::{
    fs::{File, OpenOptions},
    io::{self, ErrorKind, Read, Write},
    net::UdpSocket,
    os::unix::fs::{OpenOptionsExt, symlink},
    path::{Path, PathBuf},
};

use alight_computer::{
    config::link_url::LinkUrl,
    exit::{CliError, Doing},
};
use alight_sim::{
    harness::scenario::Scenario,
    sensors::{
        bytes::{Carries, boat::Boat},
        clocks::ClockModel,
    },
};
use alight_usv::sensors::{Readings, SourceConfig};
use rustix::{
    fs::{OFlags, fcntl_getfl, fcntl_setfl},
    io::Errno,
    pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt},
};

const MAX_RECEIVED: usize = 1 << 16;

pub struct SerialLine {
    path: PathBuf,
    sensor_end: File,
    /// Whether the computer had the line open at the last check.
    open: bool,
}

impl SerialLine {
    pub fn at(path: &Path) -> io::Result<SerialLine> {
        Ok(SerialLine {
            path: path.into(),
            sensor_end: connect(path)?,
            open: false,
        })
    }
    /// Sends `bytes` to the computer if it listens, and returns the bytes that it sent: requests, corrections.
    pub fn exchange(&mut self, bytes: &[u8]) -> io::Result<Vec<u8>> {
        let mut buffer = [0; 1024];
        let mut received = Vec::new();
        let open = loop {
            match self.sensor_end.read(&mut buffer) {
                Ok(0) => break true,
                Ok(n) if received.len() < MAX_RECEIVED => {
                    received.extend_from_slice(buffer.get(..n).unwrap_or_default());
                }
                Ok(_) => {}
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) if e.kind() == ErrorKind::WouldBlock => break true,
                Err(e) if e.raw_os_error() == Some(Errno::IO.raw_os_error()) => break false,
                Err(e) => return Err(e),
            }
        };
        if self.open && !open {
            self.sensor_end = connect(&self.path)?;
        }
        self.open = open;
        // Without a reader, or when the line is full, bytes are lost as on a wire.
        if open && !bytes.is_empty() {
            match self.sensor_end.write(bytes) {
                Err(e) if e.kind() != ErrorKind::WouldBlock => return Err(e),
                Ok(_) | Err(_) => {}
            }
        }
        Ok(received)
    }
}

/// New pseudo-terminal whose other end is at `path` and counts as not open yet.
fn connect(path: &Path) -> io::Result<File> {
    let line = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
    grantpt(&line)?;
    unlockpt(&line)?;
    fcntl_setfl(&line, fcntl_getfl(&line)? | OFlags::NONBLOCK)?;
    let name = ptsname(&line, Vec::new())?;
    let name = name
        .to_str()
        .map_err(|e| io::Error::new(ErrorKind::InvalidData, e))?;
    let flags = OFlags::NOCTTY | OFlags::NONBLOCK;
    // The kernel reports whether an end is closed, but reports an end that was never opened as open.
    drop(
        OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags(flags.bits().cast_signed())
            .open(name)?,
    );
    let new = path.with_extension("new");
    let _none = std::fs::remove_file(&new);
    symlink(name, &new)?;
    std::fs::rename(&new, path)?;
    Ok(line.into())
}

/// Types of measurements that each of a vessel's sensors sends.
pub fn assigned(sources: &[SourceConfig]) -> Result<Vec<Carries>, CliError> {
    Carries::assign(sources).ok_or_else(|| {
        CliError(
            "no sensor of the vessel's file has format = \"mavlink\", the only one in which a rehearsal sends inertial \
             samples; add one for the rehearsal"
                .into(),
        )
    })
}

enum Wire {
    Serial(SerialLine),
    Udp(UdpSocket),
}

impl Wire {
    fn to(url: &LinkUrl) -> Result<Wire, CliError> {
        match url {
            LinkUrl::Serial(path, _) => {
                let line = SerialLine::at(path);
                let line = line.doing(format_args!("making the serial line {}", path.display()))?;
                Ok(Wire::Serial(line))
            }
            LinkUrl::UdpIn(at, _) => {
                let socket = UdpSocket::bind("0.0.0.0:0");
                let socket = socket.and_then(|s| s.connect(at.as_str()).map(|()| s));
                Ok(Wire::Udp(
                    socket.doing(format_args!("sending a sensor's bytes to {at}"))?,
                ))
            }
            LinkUrl::UdpOut(_)
            | LinkUrl::TcpIn(..)
            | LinkUrl::TcpOut(_)
            | LinkUrl::Can(_)
            | LinkUrl::SignalK(..) => Err(CliError(format!(
                "{url}: a simulated sensor sends only to serial:// or udpin://"
            ))),
        }
    }
    fn exchange(&mut self, bytes: &[u8]) -> io::Result<Vec<u8>> {
        match self {
            Wire::Serial(line) => line.exchange(bytes),
            Wire::Udp(_) if bytes.is_empty() => Ok(Vec::new()),
            Wire::Udp(socket) => socket.send(bytes).map(|_| Vec::new()),
        }
    }
}

pub struct SensorLines {
    boat: Boat,
    wires: Vec<Wire>,
}

impl SensorLines {
    /// Lines of the configured sensors at their addresses; measurements carry times of `clock`.
    pub fn of(
        sources: &[SourceConfig],
        scenario: &Scenario,
        clock: ClockModel,
    ) -> Result<SensorLines, CliError> {
        let boat = Boat::new(sources, assigned(sources)?, &scenario.sensors, clock);
        let wire = |source: &SourceConfig| Wire::to(&source.connect.parse().map_err(CliError)?);
        Ok(SensorLines {
            boat,
            wires: sources.iter().map(wire).collect::<Result<_, _>>()?,
        })
    }
    /// Sends the measurements, and the frames of the moving base.
    pub fn send(&mut self, readings: &Readings, rtcm: &[u8]) {
        let bytes = self.boat.bytes(readings, rtcm);
        for (wire, bytes) in self.wires.iter_mut().zip(bytes) {
            // A broken line stays silent, and the vessel's computer reports the silence.
            let _requests = wire.exchange(&bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_computer::io::byte_link::ByteLink;

    #[tokio::test]
    async fn serial_line_opened_again() {
        let path = std::env::temp_dir().join(format!("alight-line-{}", std::process::id()));
        let mut line = SerialLine::at(&path).unwrap();
        assert!(line.exchange(b"before anybody listens").unwrap().is_empty());
        for _ in 0..2 {
            let url = LinkUrl::Serial(path.clone(), 115_200);
            let mut computer = ByteLink::with_peer(url, None).await.unwrap();
            computer.read(|_| panic!("nothing was sent to it")).await;
            computer.write(b"request");
            assert_eq!(line.exchange(b"measured").unwrap(), b"request");
            let mut got = Vec::new();
            while got.len() < 8 {
                computer.read(|b| got.extend_from_slice(b)).await;
            }
            assert_eq!(got, b"measured");
            line.exchange(b"left unread").unwrap();
            drop(computer);
            assert!(line.exchange(b"into the air").unwrap().is_empty());
        }
        std::fs::remove_file(path).unwrap();
    }
}
