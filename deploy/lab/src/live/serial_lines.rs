//! The wires between the simulated sensors and the vessel's computer: pseudo-terminals in the place of serial ports, or UDP.
//!
//! Only the end of the sensor is held open. The computer's end stands under a path of its own, like the name that a
//! system gives a USB adapter; once the computer has closed it, it is another pseudo-terminal, because one keeps the
//! exclusive use that its reader asked for (TIOCEXCL), and unread bytes.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::net::UdpSocket;
use std::os::unix::fs::{OpenOptionsExt, symlink};
use std::path::{Path, PathBuf};

use alight_computer::config::link_url::LinkUrl;
use alight_computer::exit::{CliError, Doing};
use alight_sim::harness::scenario::Scenario;
use alight_sim::sensors::bytes::{BoatSensor, Carries, StatedErrors};
use alight_usv::sensors::{Format, Readings, SourceConfig};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

/// One serial line.
pub struct SerialLine {
    path: PathBuf,
    sensor_end: File,
    /// The computer had it open when it was last looked at.
    open: bool,
}

impl SerialLine {
    /// A line that the computer opens at `path`.
    pub fn at(path: &Path) -> io::Result<SerialLine> {
        Ok(SerialLine {
            path: path.into(),
            sensor_end: connect(path)?,
            open: false,
        })
    }
    /// Sends `bytes` to the computer, if it listens, and takes what it sent (a decoder's requests).
    pub fn exchange(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut buffer = [0; 1024];
        let open = loop {
            match self.sensor_end.read(&mut buffer) {
                Ok(0) => break true,
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
        // No reader: as on a wire, it is gone.
        if !open || bytes.is_empty() {
            return Ok(0);
        }
        match self.sensor_end.write(bytes) {
            Err(e) if e.kind() == ErrorKind::WouldBlock => Ok(0),
            written => written,
        }
    }
}

/// A new pseudo-terminal whose other end is at `path`, and which knows that this is not open yet.
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
    // The kernel distinguishes an end that was closed from one that is open; one that never was it takes for open.
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

/// Measurements that each of these sensors of a vessel carries.
pub fn assigned(sources: &[SourceConfig]) -> Result<Vec<Carries>, CliError> {
    let formats: Vec<Format> = sources.iter().map(|s| s.format).collect();
    Carries::assign(&formats).ok_or_else(|| {
        CliError(
            "no sensor of the vessel's file has format = \"mavlink\", in which alone a rehearsal sends inertial \
             samples; add one for the rehearsal"
                .into(),
        )
    })
}

/// Line of a simulated sensor.
enum Wire {
    Serial(SerialLine),
    Udp(UdpSocket),
}

impl Wire {
    /// To the computer that reads at `url`.
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
                "{url}: a simulated sensor sends to serial:// or udpin:// alone"
            ))),
        }
    }
    fn send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Wire::Serial(line) => line.exchange(bytes),
            Wire::Udp(_) if bytes.is_empty() => Ok(0),
            Wire::Udp(socket) => socket.send(bytes),
        }
    }
}

/// The simulated sensors, each on its line.
pub struct SensorLines(Vec<(Wire, BoatSensor)>);

impl SensorLines {
    /// Lines of the sensors of this configuration, which are where it names them.
    pub fn of(sources: &[SourceConfig], scenario: &Scenario) -> Result<SensorLines, CliError> {
        let stated = StatedErrors::of(&scenario.sensors.vessel_gnss.error);
        let mut all = Vec::new();
        for (source, carries) in sources.iter().zip(assigned(sources)?) {
            let wire = Wire::to(&source.connect.parse().map_err(CliError)?)?;
            all.push((
                wire,
                BoatSensor::new(source.format, &source.mount, carries, stated),
            ));
        }
        Ok(SensorLines(all))
    }
    /// Sends what was measured.
    pub fn send(&mut self, readings: &Readings) {
        for (wire, sensor) in &mut self.0 {
            // A line that broke stays silent, which the vessel's computer reports.
            let _written = wire.send(&sensor.bytes(readings));
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
        assert_eq!(line.exchange(b"before anybody listens").unwrap(), 0);
        for _ in 0..2 {
            let url = LinkUrl::Serial(path.clone(), 115_200);
            let mut computer = ByteLink::with_peer(url, None).await.unwrap();
            // It opens with the first read, and asks for something.
            computer.read(|_| panic!("nothing was sent to it")).await;
            computer.write(b"request");
            assert_eq!(line.exchange(b"measured").unwrap(), 8);
            let mut got = Vec::new();
            while got.len() < 8 {
                computer.read(|b| got.extend_from_slice(b)).await;
            }
            assert_eq!(got, b"measured");
            assert_eq!(line.exchange(b"left unread").unwrap(), 11);
            drop(computer);
            assert_eq!(line.exchange(b"into the air").unwrap(), 0);
        }
        std::fs::remove_file(path).unwrap();
    }
}
