//! The vessel's sensors as its process reads them: datagrams on a socket of the vessel's computer.
//! The process of the real sensors and other drivers send the same datagrams.

use std::io;
use std::net::UdpSocket;
use std::time::Duration;

use alight_shared::wire;
pub use alight_usv::sensors::Readings;

/// Measurements of each kind that one datagram holds, at most.
const MAX_PER_DATAGRAM: usize = 4;
/// Most datagrams that one read takes.
const MAX_PER_READ: usize = 32;

/// The receiving end.
pub struct SensorSocket {
    socket: UdpSocket,
    rejected: u64,
}

impl SensorSocket {
    /// Listens on `address`.
    pub fn listen(address: &str) -> io::Result<SensorSocket> {
        Ok(SensorSocket {
            socket: UdpSocket::bind(address)?,
            rejected: 0,
        })
    }
    /// Every reading that waits; waits at most `max_wait` for the first.
    pub fn read(&mut self, max_wait: Duration) -> Readings {
        let mut all = Readings::default();
        let mut buffer = [0_u8; wire::MAX_WIRE_BYTES];
        for k in 0..MAX_PER_READ {
            let ready = if k == 0 && !max_wait.is_zero() {
                self.socket
                    .set_nonblocking(false)
                    .and_then(|()| self.socket.set_read_timeout(Some(max_wait)))
            } else {
                self.socket.set_nonblocking(true)
            };
            let Ok(length) = ready.and_then(|()| self.socket.recv(&mut buffer)) else {
                break;
            };
            match wire::decode::<Readings>(buffer.get(..length).unwrap_or_default()) {
                Ok(readings) => all.append(readings),
                Err(_) => self.rejected += 1,
            }
        }
        all
    }
    /// A descriptor of the same socket, for who waits for other things, too.
    pub fn descriptor(&self) -> io::Result<UdpSocket> {
        self.socket.try_clone()
    }
    /// Datagrams that were not readings.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }
}

/// The sending end of sensors, simulated or real.
pub struct SensorSender {
    socket: UdpSocket,
}

impl SensorSender {
    /// Sends to the vessel's process at `address`.
    pub fn to(address: &str) -> io::Result<SensorSender> {
        let socket = UdpSocket::bind("127.0.0.1:0")?;
        socket.connect(address)?;
        Ok(SensorSender { socket })
    }
    /// Sends what there is. A vessel's process that is not there misses it, as it would at sea.
    pub fn send(&self, readings: &Readings) {
        if readings.is_empty() {
            return;
        }
        for part in readings.parts(MAX_PER_DATAGRAM) {
            if let Ok(bytes) = wire::encode(&part) {
                let _missed = self.socket.send(&bytes);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::ImuSample;

    #[test]
    fn sensor_socket_valid_and_invalid_datagrams() {
        let mut sensors = SensorSocket::listen("127.0.0.1:0").unwrap();
        let address = sensors.socket.local_addr().unwrap().to_string();
        let sender = SensorSender::to(&address).unwrap();
        let readings = Readings {
            imu: vec![ImuSample::default(); 3],
            ..Readings::default()
        };
        sender.send(&readings);
        sender.socket.send(&[7; 33]).unwrap();
        sender.send(&readings);
        let mut got = Readings::default();
        // Loopback delivers at once; the bound is against a test that never ends.
        for _ in 0..100 {
            got.imu.extend(sensors.read(Duration::from_millis(50)).imu);
            if got.imu.len() == 6 && sensors.rejected() == 1 {
                break;
            }
        }
        assert_eq!((got.imu.len(), sensors.rejected()), (6, 1));
    }
}
