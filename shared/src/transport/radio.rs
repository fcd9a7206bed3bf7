//! The radio between the computers: a zenoh session with explicit endpoints and no scouting.
//!
//! The vessel listens and only drones dial: two sides that dial can end up in a split session.
//! zenoh repeats nothing by itself, so every message is small, complete and the newest wins; a
//! message that does not fit into the local queue is dropped, never waited for. A session that went
//! silent is closed (which may hang, so it is left to a thread of its own) and opened anew.

use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, atomic::AtomicU64, atomic::Ordering};
use std::time::Duration;

use tokio::sync::Notify;
use zenoh::Wait;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority, Reliability};

use crate::admission::Sender;
use crate::config;
use crate::config::{Check, Keys};
use crate::transport::clock::steady_ns;
use crate::transport::observe::{ReceiveChannel, receive_channel};
use crate::transport::rejections::PlaintextAttempts;
use crate::transport::{Received, TransportError, access};
use crate::wire::MAX_WIRE_BYTES;

/// An attempt to open a session is given up after this long, ms. Over datagrams nothing is repeated
/// within it: soon, the next attempt is the repetition.
const DATAGRAM_OPEN_MS: u32 = 1000;
/// Over streams: TCP or QUIC and zenoh exchange three times, 0.6 s at 100 ms each way without any loss, and
/// a lost packet is repeated after 1 s at first (over 30 % loss and 100 ms: no stream's session in 33 s with
/// attempts of 1 s; with 3 s one in four succeeds and a session came back after up to 30 s).
const STREAM_OPEN_MS: u32 = 8000;

/// What an endpoint of QUIC is given beside its address: if the other side can too, one connection has a
/// stream for what must arrive (handshake, declarations) and datagrams for what we publish, where only the
/// newest counts.
const QUIC_METADATA: &str = "?mixed_rel=auto";

/// Largest batch of the middleware: with the headers of IPv6 and TCP it fits into one packet.
const BATCH_BYTES: u32 = 1380;
/// Longest message that the middleware puts together of its parts, bytes: a message of ours fits into one batch; the rest is
/// room for its own declarations. Its default is 1 GB, which one peer could have this computer hold.
const MAX_MESSAGE_BYTES: u32 = 16_384;
/// Sessions of each peer: one, and that before it started anew, until that has expired.
const SESSIONS_PER_PEER: usize = 2;
/// Sessions beside those, for peers that start again and again.
const SPARE_SESSIONS: usize = 8;
/// What a stream's socket may hold, bytes; the system counts its own overhead too, about as much
/// again as the payload.
const SOCKET_BYTES: u32 = 16_384;

/// Messages that wait for the process; what comes on top is dropped.
const INBOX: usize = 256;

config! {
    /// Who listens, who dials, over what.
    pub struct RadioConfig {
        /// Endpoints to listen on, such as `udp/0.0.0.0:7447`; a vessel's.
        pub listen: Vec<String> = Vec::new();
        /// Endpoints to dial, such as `udp/192.168.7.1:7447`; a drone's.
        pub connect: Vec<String> = Vec::new();
        /// A link over datagrams that carries nothing for this long is given up, s.
        /// Measured: with 10 s (the middleware's default) TCP delivers a backlog of 5.5 s after an
        /// outage of 5 s, with 2 s what comes is fresh.
        pub lease_s: f64 = 2.0, in 0.5..=60.0;
        /// The same of a link over a stream or QUIC, which may only wait for a retransmission, s.
        /// Measured at 30 % loss and 100 ms: a stream is silent for more than 2 s every 20 s and
        /// goes on within 5 s by itself, while a new session takes 2 to 10 s.
        pub stream_lease_s: f64 = 5.0, in 0.5..=60.0;
        /// A session over datagrams without any message for this long is opened anew, s; one over a stream or
        /// QUIC is left the time of its lease and of one attempt to open beside. A session that brings only what
        /// is older than this, for as long and its lease, is opened anew too.
        /// Chosen: a lease, the slowest retry, and as much again.
        pub reopen_after_s: f64 = 5.0, in 1.0..=600.0;
        /// Certificates, for endpoints that begin with `quic/`.
        pub tls: TlsConfig;
    }
    check |this, at| {
        at.require(
            this.listen.is_empty() != this.connect.is_empty(),
            "listen, connect",
            format!("{:?}, {:?}", this.listen, this.connect),
            "either endpoints to listen on (vessel) or endpoints to dial (drone)",
        )?;
        if let Some(endpoint) = this.listen.iter().chain(&this.connect).find(|e| !is_endpoint(e)) {
            at.require(
                false,
                "listen, connect",
                endpoint,
                "udp/, tcp/ or, with certificates, quic/, and address:port, as quic/192.168.7.1:7447 (tls/ was taken \
                 out: zenoh 1.10 reads and writes such a connection at once without a lock)",
            )?;
        }
        let peers = &this.tls.peers;
        at.require(
            this.tls.authority.is_empty() || !peers.is_empty() && peers.len() <= access::PEERS,
            "tls.peers",
            format!("{} names", peers.len()),
            "with certificates, the names of the admitted peers, such as [\"drone-1\"]; 64 at most",
        )?;
        at.require(
            peers.iter().all(|p| access::is_name(p)),
            "tls.peers",
            format!("{peers:?}"),
            "names as in certificates: small letters, digits and hyphens",
        )?;
    }
}

config! {
    /// Certificate files (PEM); empty for endpoints without TLS, which is part of QUIC (RFC 9001).
    pub struct TlsConfig {
        /// The authority that signed both sides' certificates.
        pub authority: String = String::new();
        /// Our certificate.
        pub certificate: String = String::new();
        /// Its private key.
        pub key: String = String::new();
        /// Names in the certificates of admitted peers, `vessel-N` or `drone-N`: each under its own key
        /// expressions only.
        pub peers: Vec<String> = Vec::new();
    }
}

/// Whether a text is an endpoint: `protocol/host:port`, with or without Zenoh's metadata (`?`) and configuration (`#`).
fn is_endpoint(text: &str) -> bool {
    let bare = text.split(['?', '#']).next().unwrap_or_default();
    let is_host = |host: &str| {
        let mut all = host.chars();
        !host.is_empty() && all.all(|c| c.is_ascii_alphanumeric() || ".-_:[]%".contains(c))
    };
    bare.split_once('/').is_some_and(|(protocol, address)| {
        let parts = address.rsplit_once(':');
        matches!(protocol, "udp" | "tcp" | "quic")
            && parts.is_some_and(|(host, port)| is_host(host) && port.parse::<u16>().is_ok())
    })
}

impl RadioConfig {
    /// Listens at one endpoint, with these certificates.
    pub fn listening(endpoint: impl Into<String>, tls: TlsConfig) -> RadioConfig {
        RadioConfig {
            listen: vec![endpoint.into()],
            tls,
            ..RadioConfig::default()
        }
    }
    /// Dials one endpoint, with these certificates.
    pub fn dialling(endpoint: impl Into<String>, tls: TlsConfig) -> RadioConfig {
        RadioConfig {
            connect: vec![endpoint.into()],
            tls,
            ..RadioConfig::default()
        }
    }
    /// Whether the session is opened, and kept alive, over something that repeats what was lost.
    fn is_stream(&self) -> bool {
        let stream = |e: &String| e.starts_with("tcp/") || e.starts_with("quic/");
        self.listen.iter().chain(&self.connect).any(stream)
    }
    fn open_ms(&self) -> u32 {
        if self.is_stream() {
            STREAM_OPEN_MS
        } else {
            DATAGRAM_OPEN_MS
        }
    }
    fn link_lease_s(&self) -> f64 {
        if self.is_stream() {
            self.stream_lease_s
        } else {
            self.lease_s
        }
    }
    /// Silence after which the watchdog acts, s.
    fn silence_limit_s(&self) -> f64 {
        if self.is_stream() {
            self.reopen_after_s + self.stream_lease_s + f64::from(STREAM_OPEN_MS) * 1e-3
        } else {
            self.reopen_after_s
        }
    }
    fn max_sessions(&self) -> usize {
        let peers = match self.tls.peers.len() {
            // Without certificates nobody is named.
            0 => access::PEERS,
            named => named,
        };
        SESSIONS_PER_PEER * peers + SPARE_SESSIONS
    }
    fn session(&self, own: &[String]) -> Result<zenoh::Config, TransportError> {
        let ms = |s: f64| (s * 1e3).round().to_string();
        let text = |v: &dyn core::fmt::Debug| format!("{v:?}");
        let open_ms = self.open_ms().to_string();
        let ends = |endpoints: &[String]| text(&endpoints.iter().map(|e| completed(e)).collect::<Vec<_>>());
        let mut settings: Vec<(&str, String)> = vec![
            ("mode", text(&"peer")),
            ("listen/endpoints", ends(&self.listen)),
            ("connect/endpoints", ends(&self.connect)),
            // Retry for ever, in the background.
            ("connect/timeout_ms", "-1".into()),
            ("connect/exit_on_failure", "false".into()),
            (
                "connect/retry",
                r#"{ "period_init_ms": 200, "period_max_ms": 500, "period_increase_factor": 1.5 }"#.into(),
            ),
            ("scouting/multicast/enabled", "false".into()),
            ("scouting/gossip/enabled", "false".into()),
            ("transport/link/tx/lease", ms(self.link_lease_s())),
            ("transport/unicast/open_timeout", open_ms.clone()),
            ("transport/unicast/accept_timeout", open_ms),
            // What waits in the middleware and in the socket is old before it leaves: a batch holds
            // one packet, not 64 kB, and the socket a few.
            ("transport/link/tx/batch_size", BATCH_BYTES.to_string()),
            ("transport/link/tcp/so_sndbuf", SOCKET_BYTES.to_string()),
            (
                "transport/link/rx/max_message_size",
                MAX_MESSAGE_BYTES.to_string(),
            ),
            // One certificate could open a thousand otherwise; the middleware bounds the sum only.
            ("transport/unicast/max_sessions", self.max_sessions().to_string()),
        ];
        if !self.tls.authority.is_empty() {
            settings.extend([
                (
                    "transport/link/tls/root_ca_certificate",
                    text(&self.tls.authority),
                ),
                (
                    "transport/link/tls/listen_certificate",
                    text(&self.tls.certificate),
                ),
                ("transport/link/tls/listen_private_key", text(&self.tls.key)),
                (
                    "transport/link/tls/connect_certificate",
                    text(&self.tls.certificate),
                ),
                ("transport/link/tls/connect_private_key", text(&self.tls.key)),
                ("transport/link/tls/enable_mtls", "true".into()),
                ("transport/link/protocols", r#"["quic"]"#.into()),
                ("access_control", access::rules(own, &self.tls.peers).to_string()),
            ]);
        }
        let mut config = zenoh::Config::default();
        for (key, value) in settings {
            config
                .insert_json5(key, &value)
                .map_err(|e| TransportError::because(format!("setting {key} of the radio to {value}"), e))?;
        }
        Ok(config)
    }
}

/// The endpoint as the middleware is given it.
fn completed(endpoint: &str) -> String {
    if endpoint.starts_with("quic/") && !endpoint.contains(['?', '#']) {
        format!("{endpoint}{QUIC_METADATA}")
    } else {
        endpoint.to_owned()
    }
}

/// How urgent a key's messages are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Urgency {
    /// State and time: before everything else.
    State,
    /// Models and predictions.
    Model,
    /// For people.
    Status,
}

/// A key to publish on.
#[derive(Clone, Debug)]
pub struct Publication {
    /// The key expression.
    pub key: String,
    /// How urgent.
    pub urgency: Urgency,
}

impl Publication {
    /// Of this key and urgency.
    pub fn new(key: impl Into<String>, urgency: Urgency) -> Publication {
        let key = key.into();
        Publication { key, urgency }
    }
}

/// UDP's and IP's header, 28 bytes, and about 20 of the middleware's framing of a message.
pub const HEADER_BYTES: u64 = 48;

/// What went out on one outlet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flow {
    /// Messages.
    pub messages: u64,
    /// Their bytes with headers.
    pub bytes: u64,
}

/// What the radio counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RadioCounts {
    /// Messages handed to the middleware.
    pub sent: u64,
    /// Bytes of them.
    pub sent_bytes: u64,
    /// Messages it did not take.
    pub unsent: u64,
    /// Messages that came.
    pub received: u64,
    /// Messages dropped because they were too long or the process did not read.
    pub dropped: u64,
    /// How often the watchdog opened the session anew.
    pub reopened: u64,
}

/// One side of the radio.
pub struct Radio {
    config: RadioConfig,
    publications: Vec<Publication>,
    subscriptions: Vec<String>,
    open: Option<Open>,
    sender: SyncSender<Received>,
    inbox: Receiver<Received>,
    /// Something has arrived.
    arrival: Arc<Notify>,
    dropped: Arc<AtomicU64>,
    counts: RadioCounts,
    flows: Vec<Flow>,
    last_received_ns: Option<i64>,
    /// When the news were last young enough, or a session was opened.
    last_fresh_ns: i64,
    /// Strangers that knock without TLS.
    plaintext_attempts: Option<PlaintextAttempts>,
    /// What a test bench put between the session and the process.
    channel: Option<Box<dyn ReceiveChannel>>,
}

struct Open {
    session: zenoh::Session,
    publishers: Vec<Publisher<'static>>,
}

impl Radio {
    /// Opens the session, publishes on `publications` and reads `subscriptions`.
    pub fn open(
        config: &RadioConfig,
        publications: Vec<Publication>,
        subscriptions: Vec<String>,
    ) -> Result<Radio, TransportError> {
        // Whoever opens it, also an operator's command: what cannot work is reported before it is tried.
        config
            .check(&Keys::ROOT)
            .map_err(|e| TransportError::because("checking the radio's configuration", e))?;
        let (sender, inbox) = sync_channel(INBOX);
        let mut radio = Radio {
            config: config.clone(),
            flows: vec![Flow::default(); publications.len()],
            publications,
            subscriptions,
            open: None,
            sender,
            inbox,
            arrival: Arc::new(Notify::new()),
            dropped: Arc::new(AtomicU64::new(0)),
            counts: RadioCounts::default(),
            last_received_ns: None,
            last_fresh_ns: steady_ns(),
            plaintext_attempts: None,
            channel: receive_channel(),
        };
        radio.open = Some(radio.session()?);
        radio.plaintext_attempts = PlaintextAttempts::at(&config.listen);
        // A session that never receives anything is silent too: an opening that stalled half way
        // (seen once, over UDP on a computer under load) ends there.
        radio.last_received_ns = Some(steady_ns());
        Ok(radio)
    }

    fn session(&self) -> Result<Open, TransportError> {
        let own: Vec<String> = self.publications.iter().map(|o| o.key.clone()).collect();
        let session = zenoh::open(self.config.session(&own)?)
            .wait()
            .map_err(|e| TransportError::because("opening the radio's session", e))?;
        let mut publishers = Vec::with_capacity(self.publications.len());
        for publication in &self.publications {
            let priority = match publication.urgency {
                Urgency::State => Priority::RealTime,
                Urgency::Model => Priority::InteractiveHigh,
                Urgency::Status => Priority::Background,
            };
            let publisher = session
                .declare_publisher(publication.key.clone())
                .congestion_control(CongestionControl::Drop)
                .priority(priority)
                .express(true)
                // Repeated, the old would hold up the new; over TCP and UDP this changes nothing.
                .reliability(Reliability::BestEffort)
                .wait()
                .map_err(|e| TransportError::because(format!("publishing {}", publication.key), e))?;
            publishers.push(publisher);
        }
        for (subscription, key) in self.subscriptions.iter().enumerate() {
            let (sender, dropped) = (self.sender.clone(), Arc::clone(&self.dropped));
            let arrival = Arc::clone(&self.arrival);
            session
                .declare_subscriber(key.clone())
                .callback(move |sample| {
                    let payload = sample.payload();
                    if payload.len() > MAX_WIRE_BYTES {
                        dropped.fetch_add(1, Ordering::Relaxed);
                        return;
                    }
                    let bytes = payload.to_bytes().into_owned();
                    let received = Received {
                        subscription,
                        sender: Sender::of_key(sample.key_expr().as_str()),
                        at_ns: steady_ns(),
                        bytes,
                    };
                    match sender.try_send(received) {
                        Ok(()) => arrival.notify_one(),
                        Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {
                            dropped.fetch_add(1, Ordering::Relaxed);
                        }
                    }
                })
                .background()
                .wait()
                .map_err(|e| TransportError::because(format!("reading {key}"), e))?;
        }
        Ok(Open { session, publishers })
    }

    /// Publishes on publication `publication`.
    pub fn send(&mut self, publication: usize, bytes: Vec<u8>) {
        let length = bytes.len() as u64;
        let open = self.open.as_ref();
        let publisher = open.and_then(|o| o.publishers.get(publication));
        if publisher.is_some_and(|p| p.put(bytes).wait().is_ok()) {
            self.counts.sent += 1;
            self.counts.sent_bytes += length;
            if let Some(flow) = self.flows.get_mut(publication) {
                flow.messages += 1;
                flow.bytes += length + HEADER_BYTES;
            }
        } else {
            self.counts.unsent += 1;
        }
    }

    /// Waits until something has arrived since the last wait, for who waits for other things, too.
    pub async fn arrival(&self) {
        self.arrival.notified().await;
    }
    /// The next message; waits at most `timeout` for it.
    pub fn receive(&mut self, timeout: Duration) -> Option<Received> {
        if let Some(plaintext_attempts) = &self.plaintext_attempts {
            plaintext_attempts.poll();
        }
        let mut next = if timeout.is_zero() {
            self.inbox.try_recv().ok()
        } else {
            // We hold a sender ourselves: the only error is that the time is up.
            self.inbox.recv_timeout(timeout).ok()
        };
        while let Some(received) = next {
            self.counts.received += 1;
            self.last_received_ns = Some(received.at_ns);
            let Some(channel) = &mut self.channel else {
                return Some(received);
            };
            channel.take(received);
            next = self.inbox.try_recv().ok();
        }
        self.channel.as_mut()?.ready(steady_ns())
    }

    /// The watchdog of the side that dials: opens the session anew when it went silent, or when it has
    /// brought no news younger than the limit for too long, the newest now being `age_s` old (infinite:
    /// unknown). The latter is a stream that is far behind, or a session over datagrams whose
    /// declarations were lost or overtaken, for then one side speaks and the other has nobody to speak to
    /// (measured over a link with 30 ms of jitter: 2 of 8 sessions). To be called now and then. The side
    /// that listens keeps its socket, and silence is no news to it; what it cannot mend is
    /// [`Radio::survives_pause`].
    pub fn watch(&mut self, age_s: f64) {
        if self.config.connect.is_empty() {
            return;
        }
        let now = steady_ns();
        let since_s = |at: i64| now.saturating_sub(at) as f64 * 1e-9;
        let (limit_s, lease_s) = (self.config.reopen_after_s, self.config.link_lease_s());
        if age_s <= limit_s {
            self.last_fresh_ns = now;
        }
        let silent_s = self.last_received_ns.map_or(0.0, since_s);
        let silent = silent_s > self.config.silence_limit_s();
        let old = silent_s < lease_s && since_s(self.last_fresh_ns) > limit_s + lease_s;
        if !silent && !old && self.open.is_some() {
            return;
        }
        if let Some(old) = self.open.take() {
            // Closing may hang for ten seconds under loss; nobody waits for it.
            let _detached = std::thread::Builder::new().name("close".into()).spawn(move || {
                drop(old.publishers);
                let _closed = old.session.close().wait();
            });
        }
        // A session that cannot be opened is tried again after the same silence.
        self.last_received_ns = Some(now);
        self.last_fresh_ns = now;
        if let Ok(open) = self.session() {
            self.open = Some(open);
            self.counts.reopened += 1;
        }
    }

    /// Whether the session of a listener can be trusted after its process stood still for `gap_s`: held
    /// up for about a lease, the middleware's reader of a datagram socket stays blocked for good and
    /// keeps the port (measured: SIGSTOP for 2 s, 9 of 9 never read again; closing the session does not
    /// free it). Only a new process receives again.
    pub fn survives_pause(&self, gap_s: f64) -> bool {
        !self.config.connect.is_empty() || gap_s < 0.9 * self.config.link_lease_s()
    }

    /// Leaves the session as it is: closing one that is stuck would wait for ever. For a process that
    /// ends now.
    pub fn abandon(self) {
        core::mem::forget(self);
    }

    /// What went out, by outlet.
    pub fn flows(&self) -> &[Flow] {
        &self.flows
    }
    /// What was counted.
    pub fn counts(&self) -> RadioCounts {
        RadioCounts {
            dropped: self.dropped.load(Ordering::Relaxed),
            ..self.counts
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_and_sessions_that_peers_may_take() {
        let mut config = RadioConfig::listening("quic/127.0.0.1:7447", TlsConfig::default());
        config.tls.peers = (1..=3).map(|k| format!("drone-{k}")).collect();
        let number = |config: &RadioConfig, key: &str| -> usize {
            let session = config.session(&[]).unwrap();
            session.get_json(key).unwrap().parse().unwrap()
        };
        let longest = number(&config, "transport/link/rx/max_message_size");
        assert!((2 * MAX_WIRE_BYTES..=16_384).contains(&longest), "{longest}");
        assert_eq!(number(&config, "transport/unicast/max_sessions"), 14);
        config.tls.peers.clear();
        assert!(number(&config, "transport/unicast/max_sessions") > 2 * 64);
    }
}
