//! Radio session between two computers: channels, transport, and a session that closes after a silence and
//! reopens by a handshake.

use alight_shared::time::{Span, Time, WorldTime};

use super::{
    ChannelCounts, ChannelFault, Direction, RadioChannel, SimulatedRadio, SimulatedRadioConfig, Transport,
    stream::RadioStream,
};
use crate::physics::streams::Streams;

/// Transmission times of a packet in a stream's handshake, s after the start of the exchange.
const TRIES_S: [f64; 5] = [0.0, 0.4, 1.2, 2.8, 6.0];
/// Transmission times of a stream's first packet, before a round trip is measured, s (Linux since 6.5:
/// initially once per second).
const FIRST_TRIES_S: [f64; 5] = [0.0, 1.0, 2.0, 3.0, 4.0];
/// Transmission times of QUIC's first packet, s.
const QUIC_TRIES_S: [f64; 4] = [0.0, 1.0, 3.0, 7.0];
/// Time from a failed attempt to the next, s (longest retry interval of the middleware).
const RETRY_S: f64 = 0.5;
/// Keep-alives sent per lease by a side that has no messages to send.
const KEEP_ALIVES: f64 = 4.0;
/// Size of handshake packets and keep-alives, bytes.
const SMALL: usize = 80;

#[derive(Clone, Debug)]
enum OneWayLink<T> {
    Datagrams(Box<SimulatedRadio<T>>),
    Stream(Box<RadioStream<T>>),
}

impl<T: Clone> OneWayLink<T> {
    fn new(config: &SimulatedRadioConfig, direction: Direction, streams: &Streams) -> OneWayLink<T> {
        let there = RadioChannel::new(config, direction, streams);
        match config.transport {
            Transport::Udp | Transport::Quic => OneWayLink::Datagrams(Box::new(SimulatedRadio::over(there))),
            Transport::Tcp => {
                let back = RadioChannel::back(config, direction, streams);
                OneWayLink::Stream(Box::new(RadioStream::new(config, there, back)))
            }
        }
    }
    fn send(&mut self, t: WorldTime, bytes: usize, packet: T) {
        match self {
            OneWayLink::Datagrams(radio) => radio.send(t, bytes, packet),
            OneWayLink::Stream(stream) => stream.send(t, bytes, packet),
        }
    }
    fn receive(&mut self, t: WorldTime) -> Vec<(WorldTime, T)> {
        match self {
            OneWayLink::Datagrams(radio) => radio.receive(t),
            OneWayLink::Stream(stream) => stream.receive(t),
        }
    }
    fn counts(&self) -> ChannelCounts {
        match self {
            OneWayLink::Datagrams(radio) => radio.counts(),
            OneWayLink::Stream(stream) => stream.counts(),
        }
    }
    fn set_outage(&mut self, window: [WorldTime; 2]) {
        match self {
            OneWayLink::Datagrams(radio) => radio.set_outage(window),
            OneWayLink::Stream(stream) => stream.channels().into_iter().for_each(|c| c.set_outage(window)),
        }
    }
    fn fail(&mut self, fault: ChannelFault) {
        match self {
            OneWayLink::Datagrams(radio) => radio.fail(fault),
            OneWayLink::Stream(stream) => stream.channels().into_iter().for_each(|c| c.fail(fault)),
        }
    }
    /// Replaces the connection; a stream loses its bytes in transit.
    fn reopen(&mut self, config: &SimulatedRadioConfig) {
        match self {
            OneWayLink::Datagrams(_) => {}
            OneWayLink::Stream(stream) => stream.reopen(config),
        }
    }
}

#[derive(Clone, Debug)]
pub struct Session<T> {
    config: SimulatedRadioConfig,
    to_drone: OneWayLink<T>,
    to_vessel: OneWayLink<T>,
    /// Channels for handshakes and keep-alives, to the drone and to the vessel. They use separate random
    /// streams, so that the fates of messages do not change.
    probes: [RadioChannel; 2],
    /// Last reception by the drone and by the vessel; None before the first.
    last_received: [Option<WorldTime>; 2],
    keep_alive: WorldTime,
    /// End of the current attempt to open the session, and whether it will succeed; None: the session is open.
    attempt: Option<(WorldTime, bool)>,
    reopened: u32,
}

impl<T: Clone> Session<T> {
    pub fn new(config: &SimulatedRadioConfig, streams: &Streams) -> Session<T> {
        Session {
            config: config.clone(),
            to_drone: OneWayLink::new(config, Direction::ToDrone, streams),
            to_vessel: OneWayLink::new(config, Direction::ToVessel, streams),
            probes: [Direction::ToDrone, Direction::ToVessel]
                .map(|d| RadioChannel::probe(config, d, streams)),
            last_received: [None; 2],
            keep_alive: Time::EPOCH,
            attempt: None,
            reopened: 0,
        }
    }
    /// `length` is the length of the message, bytes.
    pub fn send_to_drone(&mut self, t: WorldTime, length: usize, packet: T) {
        if self.attempt.is_none() {
            self.to_drone.send(t, self.config.transport.bytes(length), packet);
        }
    }
    pub fn send_to_vessel(&mut self, t: WorldTime, length: usize, packet: T) {
        if self.attempt.is_none() {
            self.to_vessel
                .send(t, self.config.transport.bytes(length), packet);
        }
    }
    pub fn at_drone(&mut self, t: WorldTime) -> Vec<(WorldTime, T)> {
        let came = self.to_drone.receive(t);
        self.note_received(0, came.last().map(|c| c.0));
        self.poll(t);
        came
    }
    pub fn at_vessel(&mut self, t: WorldTime) -> Vec<(WorldTime, T)> {
        let came = self.to_vessel.receive(t);
        self.note_received(1, came.last().map(|c| c.0));
        came
    }
    /// Loses all packets sent in the window `[from, until)`, in both directions.
    pub fn set_outage(&mut self, window: [WorldTime; 2]) {
        self.to_drone.set_outage(window);
        self.to_vessel.set_outage(window);
        for c in &mut self.probes {
            c.set_outage(window);
        }
    }
    /// Replaces the active faults: to the drone, to the vessel.
    pub fn fail(&mut self, [to_drone, to_vessel]: [ChannelFault; 2]) {
        self.to_drone.fail(to_drone);
        self.to_vessel.fail(to_vessel);
        let [there, back] = &mut self.probes;
        there.fail(to_drone);
        back.fail(to_vessel);
    }
    /// Packet counts: to the drone, to the vessel.
    pub fn counts(&self) -> [ChannelCounts; 2] {
        [self.to_drone.counts(), self.to_vessel.counts()]
    }
    pub const fn reopened(&self) -> u32 {
        self.reopened
    }

    fn note_received(&mut self, side: usize, at: Option<WorldTime>) {
        if let (Some(at), Some(last_received)) = (at, self.last_received.get_mut(side)) {
            *last_received = Some(last_received.map_or(at, |h| h.max(at)));
        }
    }

    fn poll(&mut self, t: WorldTime) {
        if let Some((over, succeeds)) = self.attempt {
            if t < over {
                return;
            }
            if succeeds {
                self.attempt = None;
                self.reopened += 1;
                self.last_received = [Some(t); 2];
            } else {
                self.attempt = Some(self.handshake(t + Span::from_secs(RETRY_S)));
            }
            return;
        }
        let lease = Span::from_secs(self.config.session_lease_s());
        if t >= self.keep_alive {
            self.keep_alive = t + Span::from_secs(self.config.session_lease_s() / KEEP_ALIVES);
            // The vessel sends continuously; only the drone may be quiet.
            let arrival = self.probes[1].send(t, SMALL)[0];
            self.note_received(1, arrival);
        }
        if self
            .last_received
            .iter()
            .any(|h| h.is_some_and(|h| t - h > lease))
        {
            self.to_drone.reopen(&self.config);
            self.to_vessel.reopen(&self.config);
            self.attempt = Some(self.handshake(t + Span::from_secs(RETRY_S)));
        }
    }

    /// End of an attempt that starts at `from` to open the session, and whether it succeeds.
    fn handshake(&mut self, from: WorldTime) -> (WorldTime, bool) {
        let end = from + Span::from_secs(self.config.transport.open_timeout_s());
        let mut t = from;
        for exchange in 0..self.config.transport.exchanges() {
            let tries = match self.config.transport {
                Transport::Udp => &TRIES_S[..1],
                Transport::Tcp if exchange == 0 => &FIRST_TRIES_S[..],
                // RFC 9002: three times the initial round-trip estimate, then doubled each time.
                Transport::Quic if exchange == 0 => &QUIC_TRIES_S[..],
                Transport::Tcp | Transport::Quic => &TRIES_S[..],
            };
            let done = tries.iter().find_map(|wait| {
                let there = self.probes[1].send(t + Span::from_secs(*wait), SMALL)[0]?;
                self.probes[0].send(there, SMALL)[0]
            });
            match done {
                Some(at) if at <= end => t = at,
                Some(_) | None => return (end, false),
            }
        }
        (t, true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ages of the newest sample at the drone every 10 ms, with samples sent at 30 Hz, and the number of
    /// reopened sessions.
    fn ages(config: &SimulatedRadioConfig, seconds: usize) -> (Vec<f64>, u32) {
        let mut session: Session<f64> = Session::new(config, &Streams::new(3));
        let mut newest = f64::NEG_INFINITY;
        let mut ages = Vec::new();
        for k in 0..seconds * 100 {
            let t = Time::from_secs(k as f64 * 0.01);
            if k % 3 == 0 {
                session.send_to_drone(t, 246, t.secs());
            }
            for (_, sent) in session.at_drone(t) {
                newest = newest.max(sent);
            }
            if k % 50 == 0 {
                session.send_to_vessel(t, 26, t.secs());
            }
            session.at_vessel(t);
            ages.push(t.secs() - newest);
        }
        (ages, session.reopened())
    }
    fn config(transport: Transport) -> SimulatedRadioConfig {
        SimulatedRadioConfig {
            transport,
            ..SimulatedRadioConfig::default()
        }
    }

    #[test]
    fn session_on_a_usual_link() {
        for transport in [Transport::Udp, Transport::Tcp, Transport::Quic] {
            let (ages, reopened) = ages(&config(transport), 120);
            let usual = ages.iter().skip(100).filter(|a| **a < 0.3).count();
            assert_eq!(reopened, 0, "{transport:?}");
            assert!(usual > 115 * 100, "{transport:?}: {usual}");
        }
    }

    #[test]
    fn session_after_an_outage_longer_than_its_lease() {
        for transport in [Transport::Udp, Transport::Tcp, Transport::Quic] {
            let config = SimulatedRadioConfig {
                outages_s: crate::sensors::noise::Windows(vec![[20.0, 25.0]]),
                ..config(transport)
            };
            let (ages, reopened) = ages(&config, 60);
            assert_eq!(reopened, 1, "{transport:?}");
            let worst = ages.iter().skip(100).copied().fold(0.0, f64::max);
            // Measured over an emulated link: silence of 6 to 9 s.
            assert!((5.0..11.5).contains(&worst), "{transport:?}: {worst}");
            assert!(ages[3500..].iter().all(|a| *a < 1.0), "{transport:?}");
        }
    }
}
