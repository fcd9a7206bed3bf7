//! Radio between vessel and drone: rate, delay, loss, duplication, outages.
//!
//! [`channel`] decides the fate of packets in the lock-step world, in the radio impairment of a live process,
//! and in the link emulator. [`SimulatedRadio`] carries the messages.

pub mod channel;
pub mod session;
pub mod stream;

use alight_shared::{config, time::WorldTime};
use serde::{Deserialize, Serialize};

use crate::{
    physics::streams::Streams,
    sensors::{delay::DelayLine, noise::Windows},
};
pub use channel::{ChannelCounts, ChannelFault, Direction, RadioChannel};
pub use session::Session;

/// Maximum number of packets in transit in one direction; more are lost.
const QUEUE: usize = 4096;

/// Framing that the middleware adds to a message, bytes (measured).
const FRAMING: usize = 20;
/// IP and UDP headers, bytes.
const DATAGRAM_HEADERS: usize = 28;
/// QUIC's short header, the frame of a datagram, and the tag of its encryption (RFC 9000, RFC 9221), bytes.
const QUIC_FRAME: usize = 32;

/// Bytes on the air for a message of `length` in a datagram.
pub const fn on_air(length: usize) -> usize {
    length + FRAMING + DATAGRAM_HEADERS
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Transport {
    /// Datagrams without retransmission.
    #[default]
    Udp,
    /// A byte stream, in which a retransmission delays all later data.
    Tcp,
    /// Datagrams in an encrypted connection, whose handshake is repeated until it succeeds.
    Quic,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Congestion {
    /// Reduces its rate on loss (Linux's default).
    Cubic,
    /// Keeps its measured rate (Linux: `net.ipv4.tcp_congestion_control = bbr`), as required by a radio whose
    /// losses are not caused by congestion.
    #[default]
    Bbr,
}

impl Transport {
    /// Bytes of a message of `length` on the channel: a datagram with headers, or bytes of a stream, whose
    /// headers belong to its segments.
    pub const fn bytes(self, length: usize) -> usize {
        match self {
            Transport::Udp => on_air(length),
            // Two bytes for the length of a message.
            Transport::Tcp => length + FRAMING + 2,
            Transport::Quic => on_air(length) + QUIC_FRAME,
        }
    }
    /// Time-out of an attempt to open a session, s (`alight_transport::radio`).
    const fn open_timeout_s(self) -> f64 {
        match self {
            Transport::Udp => 1.0,
            Transport::Tcp | Transport::Quic => 8.0,
        }
    }
    /// Packet exchanges to open a session: two of the middleware, and one of TCP or QUIC.
    const fn exchanges(self) -> usize {
        match self {
            Transport::Udp => 2,
            Transport::Tcp | Transport::Quic => 3,
        }
    }
}

config! {
    /// Radio, both directions.
    pub struct SimulatedRadioConfig {
        /// Mean delay before truncation, s.
        /// Source: 50 +- 20 ms, 2 % loss.
        pub delay_s: f64 = 0.05, in 0.0..=10.0;
        /// Standard deviation of the delay, s. Delays are independent, and reorder packets unless `keep_order` is set.
        pub delay_sd_s: f64 = 0.02, in 0.0..=10.0;
        /// Minimum delay, s.
        /// Chosen: time on the air and in two network stacks.
        pub delay_min_s: f64 = 0.005, in 0.0..=10.0;
        /// Additional delay from vessel to drone, s.
        pub to_drone_extra_s: f64 = 0.0, in 0.0..=10.0;
        /// Additional delay from drone to vessel, s.
        pub to_vessel_extra_s: f64 = 0.0, in 0.0..=10.0;
        /// Probability that a packet is lost.
        pub loss: f64 = 0.02, in 0.0..=1.0;
        /// Fraction of packets additionally lost in bursts (Gilbert-Elliott).
        pub burst_loss: f64 = 0.0, in 0.0..=0.95;
        /// Mean length of a burst, packets.
        /// Chosen: a deep fade or a wave in the radio path lasts a quarter of a second at 40 packets/s.
        pub burst_packets: f64 = 10.0, in 1.0..=1e5;
        /// Probability that a delivered packet arrives twice.
        /// Chosen: datagrams are duplicated occasionally.
        pub duplicate: f64 = 0.001, in 0.0..=1.0;
        /// Bit rate of the link, IP headers included, bit/s; 0: unlimited.
        pub rate_bps: f64 = 0.0, in 0.0..=1e12;
        /// Maximum number of bytes in the queue of a slow link; further packets are lost.
        /// Chosen: a small queue, as in radio modems; half a second at 64 kbit/s.
        pub queue_bytes: u32 = 4096, in 100.0..=1e9;
        /// Deliver packets in the order in which they were sent.
        pub keep_order: bool = false;
        /// Transport of the messages in lock-step; in live flights the processes' configuration selects it.
        pub transport: Transport = Transport::Udp;
        /// Congestion control of a stream.
        pub congestion: Congestion = Congestion::Bbr;
        /// Maximum number of bytes in the socket of a stream; further messages are dropped.
        /// Source: bytes in transit with a Linux kernel and a socket of 16 kB, as in
        /// `alight_transport::radio`: 46 segments of 290 B.
        pub stream_buffer_bytes: u32 = 14_000, in 2048.0..=1e8;
        /// Time without reception after which a session over datagrams is closed and reopened, s.
        /// Source: `alight_transport::radio`.
        pub lease_s: f64 = 2.0, in 0.5..=60.0;
        /// Time without reception after which a session over a stream is closed and reopened, s.
        pub stream_lease_s: f64 = 5.0, in 0.5..=60.0;
        /// Windows `[start, end)` of the send time in which all packets are lost, s of true time.
        pub outages_s: Windows = Windows::default(), in -1e9..=1e9;
    }
}

impl SimulatedRadioConfig {
    /// Time without reception until a session is reopened, s.
    pub const fn session_lease_s(&self) -> f64 {
        match self.transport {
            Transport::Udp => self.lease_s,
            Transport::Tcp | Transport::Quic => self.stream_lease_s,
        }
    }
}

#[derive(Clone, Debug)]
pub struct SimulatedRadio<T> {
    channel: RadioChannel,
    line: DelayLine<T>,
}

impl<T: Clone> SimulatedRadio<T> {
    pub fn new(config: &SimulatedRadioConfig, direction: Direction, streams: &Streams) -> Self {
        SimulatedRadio::over(RadioChannel::new(config, direction, streams))
    }
    pub fn over(channel: RadioChannel) -> Self {
        SimulatedRadio {
            channel,
            line: DelayLine::new(QUEUE),
        }
    }
    /// `bytes` is the size including headers.
    pub fn send(&mut self, t: WorldTime, bytes: usize, packet: T) {
        let [first, second] = self.channel.send(t, bytes);
        if let Some(at) = second {
            self.line.push(at, packet.clone());
        }
        if let Some(at) = first
            && !self.line.push(at, packet)
        {
            self.channel.drop_one();
        }
    }
    pub fn receive(&mut self, t: WorldTime) -> Vec<(WorldTime, T)> {
        core::iter::from_fn(|| self.line.pop(t)).collect()
    }
    pub fn next(&self) -> Option<WorldTime> {
        self.line.next()
    }
    pub const fn fail(&mut self, fault: ChannelFault) {
        self.channel.fail(fault);
    }
    /// Loses all packets sent in the window `[from, until)`; packets in transit arrive. Later calls do not
    /// change the window.
    pub fn set_outage(&mut self, window: [WorldTime; 2]) {
        self.channel.set_outage(window);
    }
    pub const fn counts(&self) -> ChannelCounts {
        self.channel.counts()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{estimation::moments, time::Time};

    fn run(config: &SimulatedRadioConfig, direction: Direction, n: usize) -> Vec<(usize, f64)> {
        let mut radio = SimulatedRadio::new(config, direction, &Streams::new(7));
        let mut out = vec![];
        for k in 0..n + 200 {
            let t = Time::from_nanos(k as i64 * 10_000_000);
            if k < n {
                radio.send(t, 300, k);
            }
            for (at, i) in radio.receive(t) {
                assert!(at <= t);
                out.push((i, at.secs() - i as f64 * 0.01));
            }
        }
        out
    }

    #[test]
    fn radio_delay_and_loss() {
        let n = 20_000;
        let config = SimulatedRadioConfig {
            duplicate: 0.0,
            ..SimulatedRadioConfig::default()
        };
        let got = run(&config, Direction::ToDrone, n);
        let loss = 1.0 - got.len() as f64 / n as f64;
        assert!((loss - 0.02).abs() < 0.004, "loss {loss}");
        let delays: Vec<f64> = got.iter().map(|g| g.1).collect();
        let (mean, sd) = moments(&delays);
        // Truncation at 5 ms shifts the mean by 0.5 ms.
        assert!((mean - 0.0506).abs() < 0.001, "mean {mean}");
        assert!((sd - 0.0193).abs() < 0.001, "sd {sd}");
        assert!(got.iter().all(|g| g.1 >= 0.005));
        assert!(got.windows(2).any(|w| w[1].0 < w[0].0), "nothing overtakes");
    }

    #[test]
    fn radio_asymmetry_outages_and_duplicates() {
        let config = SimulatedRadioConfig {
            to_vessel_extra_s: 0.1,
            duplicate: 0.25,
            outages_s: Windows(vec![[1.0, 2.0]]),
            ..SimulatedRadioConfig::default()
        };
        let mean = |d| {
            let delays: Vec<f64> = run(&config, d, 4000).iter().map(|g| g.1).collect();
            moments(&delays).0
        };
        let apart = mean(Direction::ToVessel) - mean(Direction::ToDrone);
        assert!((apart - 0.1).abs() < 0.002, "{apart}");
        let got = run(&config, Direction::ToDrone, 4000);
        assert!(got.iter().all(|g| !(100..200).contains(&g.0)));
        let expected = 3900.0 * 0.98 * 1.25;
        assert!((got.len() as f64 / expected - 1.0).abs() < 0.03, "{}", got.len());

        let mut radio = SimulatedRadio::new(
            &SimulatedRadioConfig { loss: 0.0, ..config },
            Direction::ToDrone,
            &Streams::new(1),
        );
        radio.set_outage([0.5, 0.8].map(Time::from_secs));
        radio.set_outage([0.2, 0.9].map(Time::from_secs));
        for (t, v) in [(0.49, 1), (0.5, 2), (0.79, 3), (0.8, 4)] {
            radio.send(Time::from_secs(t), 300, v);
        }
        let got = radio.receive(Time::from_secs(0.99));
        assert!(!got.is_empty() && got.iter().all(|(_, v)| [1, 4].contains(v)));
        let counts = radio.counts();
        assert_eq!((counts.sent, counts.lost), (4, 2));
    }

    #[test]
    fn radio_outage_and_other_packets() {
        let clear = run(&SimulatedRadioConfig::default(), Direction::ToDrone, 500);
        let config = SimulatedRadioConfig {
            outages_s: Windows(vec![[1.0, 2.0]]),
            ..SimulatedRadioConfig::default()
        };
        let cut = run(&config, Direction::ToDrone, 500);
        let rest: Vec<_> = clear.into_iter().filter(|g| !(100..200).contains(&g.0)).collect();
        assert_eq!(rest, cut);
    }
}
