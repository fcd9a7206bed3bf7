//! The wires between the simulated sensors and the vessel's computer: pseudo-terminals in the place of serial ports.
//!
//! Only the end of the sensor is held open. The computer's end stands under a path of its own, like the name that a
//! system gives a USB adapter; once the computer has closed it, it is another pseudo-terminal, because one keeps the
//! exclusive use that its reader asked for (TIOCEXCL), and what nobody read.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::{OpenOptionsExt, symlink};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use alight_sim::sensors::bytes::BoatSensor;
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use crate::exit::{CliError, Doing};
use crate::io::sensor_socket::SensorSocket;
use crate::process::scheduling;

/// Longest wait for readings.
const MAX_WAIT: Duration = Duration::from_millis(5);

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
        // Nobody listens: as on a wire, it is gone.
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
    // The kernel tells an end that was closed from one that is open; one that never was it takes for open.
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

/// The thread that turns the simulated world's readings into bytes on the lines.
pub struct SensorFeed {
    thread: Option<JoinHandle<()>>,
    end: Arc<AtomicBool>,
    readings: Arc<AtomicU64>,
}

impl SensorFeed {
    /// Takes readings at `address`.
    pub fn start(address: &str, lines: Vec<(SerialLine, BoatSensor)>) -> Result<SensorFeed, CliError> {
        let mut socket =
            SensorSocket::listen(address).doing(format_args!("taking the simulated sensors at {address}"))?;
        let (end, readings) = (Arc::<AtomicBool>::default(), Arc::<AtomicU64>::default());
        let (told, counted) = (Arc::clone(&end), Arc::clone(&readings));
        let mut lines = lines;
        let feed = move || {
            scheduling::set_real_time_world();
            while !told.load(Ordering::Relaxed) {
                let all = socket.read(MAX_WAIT);
                let count: usize = all.counts().iter().sum();
                counted.fetch_add(count as u64, Ordering::Relaxed);
                for (line, sensor) in &mut lines {
                    // A line that broke stays silent, which the vessel's computer reports.
                    let _written = line.exchange(&sensor.bytes(&all));
                }
            }
        };
        let thread = std::thread::Builder::new().spawn(feed);
        Ok(SensorFeed {
            thread: Some(thread.doing("starting the simulated sensors")?),
            end,
            readings,
        })
    }
    /// Readings that came from the world so far.
    pub fn readings(&self) -> u64 {
        self.readings.load(Ordering::Relaxed)
    }
}

impl Drop for SensorFeed {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ended = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::link_url::LinkUrl;
    use crate::io::byte_link::ByteLink;

    #[tokio::test]
    async fn serial_line_opened_again() {
        let path = std::env::temp_dir().join(format!("alight-line-{}", std::process::id()));
        let mut line = SerialLine::at(&path).unwrap();
        assert_eq!(line.exchange(b"before anybody listens").unwrap(), 0);
        for _ in 0..2 {
            let url = LinkUrl::Serial(path.clone(), 115_200);
            let mut computer = ByteLink::new(url).await.unwrap();
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
