//! Radio between the computers: a zenoh session with explicit endpoints and no scouting.
//!
//! The vessel listens and only drones dial, because two dialling sides can end up in a split session. zenoh
//! repeats nothing, so every message is small and complete, and the newest replaces its predecessors. A
//! message that does not fit into the local queue is dropped. A silent session is closed in a separate
//! thread, because closing may hang, and reopened. If the process is slow, the oldest states are dropped and
//! orders read first ([`Subscription::order`]).

mod answers;
mod attempts;
mod config;
mod held;
mod inbox;
mod presence;
mod publication;

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
        mpsc::{Receiver, TryRecvError, sync_channel},
    },
    time::Duration,
};

use tracing::warn;
use zenoh::{
    Wait,
    liveliness::LivelinessToken,
    pubsub::Publisher,
    qos::{CongestionControl, Reliability},
    query::{Querier, Queryable},
    sample::Sample,
};

pub use crate::radio::{
    config::{RadioConfig, TlsConfig, zenoh_text},
    publication::Publication,
};
use crate::{
    Received, TransportError,
    clock::steady_ns,
    observe::{ReceiveChannel, receive_channel},
    radio::{attempts::Attempts, config::ZenohFile, inbox::Inbox, presence::Present, publication::priority},
    rejections::{self, PlaintextAttempts},
};
pub use alight_shared::radio::Urgency;
use alight_shared::{
    admission::Sender,
    config::{Check, Keys},
    wire::MAX_WIRE_BYTES,
};

/// Timeout for a publisher's reply; broadcasts arrive in the meantime.
const ASK_TIMEOUT: Duration = Duration::from_secs(2);

/// Maximum number of consecutive messages without a pause; the longest ones fill half a step record.
const MAX_IN_A_ROW: usize = 128;
/// Polling interval for messages that a test bench delays, which arrive without a wake-up.
const BENCH_WAIT: Duration = Duration::from_millis(5);

#[derive(Clone, Debug)]
pub struct Subscription {
    key: String,
    /// The newest message is also queried ([`Radio::ask`]).
    asked: bool,
    order: bool,
}

impl Subscription {
    /// Subscription that queries the newest message once a publisher is present.
    pub fn asked(key: impl Into<String>) -> Subscription {
        let key: String = key.into();
        Subscription {
            asked: true,
            ..key.into()
        }
    }
    /// Subscription to orders, which are read first and never dropped in favour of other messages.
    pub fn order(key: impl Into<String>) -> Subscription {
        let key: String = key.into();
        Subscription {
            order: true,
            ..key.into()
        }
    }
}
impl From<String> for Subscription {
    fn from(key: String) -> Subscription {
        let asked = false;
        let order = false;
        Subscription { key, asked, order }
    }
}
impl From<&str> for Subscription {
    fn from(key: &str) -> Subscription {
        key.to_owned().into()
    }
}

/// Header overhead of a message, bytes: UDP and IP 28, and about 20 for the middleware's framing.
pub const HEADER_BYTES: u64 = 48;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flow {
    pub messages: u64,
    /// Bytes including headers.
    pub bytes: u64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RadioCounts {
    pub sent: u64,
    pub sent_bytes: u64,
    pub unsent: u64,
    pub received: u64,
    pub asked: u64,
    /// Messages dropped because of their length, or replaced by newer ones before the process read them.
    pub dropped: u64,
    pub reopened: u64,
}

pub struct Radio {
    parts: Parts,
    open: Option<Open>,
    opening: Option<Receiver<Result<Open, TransportError>>>,
    attempts: Attempts,
    watched: bool,
    in_a_row: usize,
    counts: RadioCounts,
    flows: Vec<Flow>,
    last_received_ns: Option<i64>,
    /// Time of the last fresh message or of the opening of the session.
    last_fresh_ns: i64,
    plaintext_attempts: Option<PlaintextAttempts>,
    channel: Option<Box<dyn ReceiveChannel>>,
}

#[derive(Clone)]
struct Parts {
    config: RadioConfig,
    file: Option<ZenohFile>,
    publications: Vec<Publication>,
    subscriptions: Vec<Subscription>,
    inbox: Arc<Inbox>,
    dropped: Arc<AtomicU64>,
    /// A publisher is present that has not been queried yet.
    due: Arc<AtomicBool>,
}

struct Open {
    publishers: Vec<Publisher<'static>>,
    queriers: Vec<(usize, Querier<'static>)>,
    #[allow(dead_code, reason = "the queryables live as long as this is held")]
    queryables: Vec<Queryable<()>>,
    #[allow(dead_code, reason = "the token lives as long as this is held")]
    token: Option<LivelinessToken>,
    present: Present,
    session: zenoh::Session,
}

impl Parts {
    /// Common prefix of our keys, `alight/NAME`; None: nothing is published.
    fn name(&self) -> Option<&str> {
        let key = self.publications.first()?.key.as_str();
        let (at, _) = key.match_indices('/').nth(1)?;
        key.get(..at)
    }
    fn open(&self) -> Result<Open, TransportError> {
        let own: Vec<String> = self.publications.iter().map(|o| o.key.clone()).collect();
        let name = self.name().unwrap_or("alight/unnamed");
        let session = zenoh::open(self.config.session(name, &own, self.file.as_ref())?)
            .wait()
            .map_err(|e| TransportError::because("opening the radio's session", e))?;
        let declaring = |e| TransportError::because(format!("declaring {name} on the radio"), e);
        let mut open = Open {
            publishers: self.publishers(&session)?,
            queriers: Vec::new(),
            queryables: Vec::new(),
            token: None,
            present: Present::of(&session).map_err(declaring)?,
            session,
        };
        if let Some(admitted) = self.config.admitted() {
            rejections::follow(&open.session, admitted).map_err(declaring)?;
        }
        if let Some(name) = self.name() {
            open.queryables = answers::declare(&open.session, name, &self.publications).map_err(declaring)?;
            open.token = Some(presence::declare(&open.session, name).map_err(declaring)?);
        }
        for (number, subscription) in self.subscriptions.iter().enumerate() {
            let receive = self.receiver(number);
            open.session
                .declare_subscriber(subscription.key.clone())
                .callback(move |sample| receive(&sample))
                .background()
                .wait()
                .map_err(|e| TransportError::because(format!("reading {}", subscription.key), e))?;
            if subscription.asked {
                let querier = self.querier(&open.session, &subscription.key);
                let querier = querier
                    .map_err(|e| TransportError::because(format!("querying {}", subscription.key), e))?;
                open.queriers.push((number, querier));
            }
        }
        Ok(open)
    }
    fn publishers(&self, session: &zenoh::Session) -> Result<Vec<Publisher<'static>>, TransportError> {
        let declared = self.publications.iter().map(|publication| {
            session
                .declare_publisher(publication.key.clone())
                .encoding(publication.encoding())
                .congestion_control(CongestionControl::Drop)
                .priority(priority(publication.urgency))
                .express(true)
                // Retransmitted old messages would delay new ones. The setting has no effect over TCP and UDP.
                .reliability(Reliability::BestEffort)
                .wait()
                .map_err(|e| TransportError::because(format!("publishing {}", publication.key), e))
        });
        declared.collect()
    }
    /// Handler for messages, broadcast or queried.
    fn receiver(&self, subscription: usize) -> impl Fn(&Sample) + Send + Sync + use<> {
        let inbox = Arc::clone(&self.inbox);
        let dropped = Arc::clone(&self.dropped);
        let is_order = self.subscriptions.get(subscription).is_some_and(|s| s.order);
        move |sample| {
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
            dropped.fetch_add(inbox.put(received, is_order), Ordering::Relaxed);
        }
    }
    /// Querier that notices when a publisher is present.
    fn querier(&self, session: &zenoh::Session, key: &str) -> zenoh::Result<Querier<'static>> {
        let querier = session
            .declare_querier(key.to_owned())
            .congestion_control(CongestionControl::Drop)
            .priority(priority(Urgency::Model))
            .express(true)
            .timeout(ASK_TIMEOUT)
            .wait()?;
        let due = Arc::clone(&self.due);
        let answerable = querier.matching_listener().callback(move |status| {
            due.fetch_or(status.matching(), Ordering::Relaxed);
        });
        answerable.background().wait()?;
        Ok(querier)
    }
}

impl Radio {
    /// Opens the session with `publications` and `subscriptions`; waits for an absent router in the background.
    pub fn open(
        config: &RadioConfig,
        publications: Vec<Publication>,
        subscriptions: Vec<impl Into<Subscription>>,
    ) -> Result<Radio, TransportError> {
        // Invalid configurations are reported first, also to operator commands.
        config
            .check(&Keys::ROOT)
            .map_err(|e| TransportError::because("checking the radio's configuration", e))?;
        config.check_zenoh()?;
        let mut radio = Radio {
            flows: vec![Flow::default(); publications.len()],
            parts: Parts {
                config: config.clone(),
                file: ZenohFile::of(config)?,
                publications,
                subscriptions: subscriptions.into_iter().map(Into::into).collect(),
                inbox: Arc::default(),
                dropped: Arc::default(),
                due: Arc::default(),
            },
            open: None,
            opening: None,
            attempts: Attempts::default(),
            watched: false,
            in_a_row: 0,
            counts: RadioCounts::default(),
            last_received_ns: None,
            last_fresh_ns: steady_ns(),
            plaintext_attempts: None,
            channel: receive_channel(),
        };
        radio.begin()?;
        radio.plaintext_attempts = PlaintextAttempts::at(&config.listen);
        // A session that never receives counts as silent, for example if it stalled while opening (observed
        // once, over UDP on a loaded computer).
        radio.last_received_ns = Some(steady_ns());
        Ok(radio)
    }

    /// Opens the session in a separate thread, because a client then waits for its router.
    fn begin(&mut self) -> Result<(), TransportError> {
        if !self.parts.config.router {
            let open = self.parts.open()?;
            self.opened(open);
            return Ok(());
        }
        let (sender, opened) = sync_channel(1);
        let parts = self.parts.clone();
        let opening = move || {
            let _gone = sender.send(parts.open());
        };
        std::thread::Builder::new()
            .name("open".into())
            .spawn(opening)
            .map_err(|e| TransportError::because("starting a thread that opens the radio's session", e))?;
        self.opening = Some(opened);
        Ok(())
    }
    fn opened(&mut self, open: Open) {
        self.open = Some(open);
        self.attempts.succeeded();
        self.last_fresh_ns = steady_ns();
        self.last_received_ns = Some(self.last_fresh_ns);
    }
    /// Opens a new session; after a failure, another attempt follows.
    fn reopen(&mut self) {
        if let Err(e) = self.begin() {
            self.failed(&e);
        }
    }
    fn failed(&mut self, why: &TransportError) {
        if let Some(error) = self.attempts.failed(steady_ns(), why) {
            warn!("{error}");
        }
    }
    /// Takes over a session opened by the thread, or schedules another attempt.
    fn take_opened(&mut self) {
        let Some(opening) = &self.opening else {
            if self.open.is_none() && self.attempts.is_due(steady_ns()) {
                self.reopen();
            }
            return;
        };
        let result = match opening.try_recv() {
            Err(TryRecvError::Empty) => return,
            Ok(result) => result,
            Err(TryRecvError::Disconnected) => Err(TransportError::because(
                "opening the radio's session",
                "its thread ended without a result",
            )),
        };
        self.opening = None;
        match result {
            Ok(open) => self.opened(open),
            Err(e) => self.failed(&e),
        }
    }

    /// Queries the newest message of each queried subscription once a publisher is present. Replies are
    /// received like other messages.
    pub fn ask(&mut self) {
        let Some(open) = self.open.as_ref().filter(|o| !o.queriers.is_empty()) else {
            return;
        };
        if !self.parts.due.swap(false, Ordering::Relaxed) {
            return;
        }
        for (number, querier) in &open.queriers {
            let receive = self.parts.receiver(*number);
            let ask = querier.get().callback(move |reply| {
                // On an error, wait for the next broadcast.
                if let Ok(sample) = reply.result() {
                    receive(sample);
                }
            });
            if ask.wait().is_ok() {
                self.counts.asked += 1;
            }
        }
    }
    /// Number of these peers with a session, by liveliness tokens. A frozen process keeps its token, so
    /// decisions rely on messages and their times.
    pub fn count_present(&self, is_counted: impl Fn(&Sender) -> bool) -> usize {
        self.open.as_ref().map_or(0, |o| o.present.count(is_counted))
    }

    /// Stores this message for queries, if publication `publication` is held.
    pub fn hold(&self, publication: usize, bytes: Vec<u8>) {
        let kept = self.parts.publications.get(publication);
        if let Some(held) = kept.and_then(|p| p.held.as_ref()) {
            held.set(bytes.into());
        }
    }
    pub fn send(&mut self, publication: usize, bytes: Vec<u8>) {
        let length = bytes.len() as u64;
        let open = self.open.as_ref();
        let publisher = open.and_then(|o| o.publishers.get(publication));
        let kept = self.parts.publications.get(publication);
        if publisher.is_some_and(|p| p.put(bytes).wait().is_ok()) {
            self.counts.sent += 1;
            self.counts.sent_bytes += length;
            if let Some(flow) = self.flows.get_mut(publication) {
                flow.messages += 1;
                flow.bytes += length + kept.map_or(HEADER_BYTES, |p| p.overhead);
            }
        } else {
            self.counts.unsent += 1;
        }
    }

    /// Waits until a message can be received; can be combined with other futures.
    pub async fn arrival(&self) {
        let arrival = self.parts.inbox.arrival();
        if self.channel.is_some() {
            let _late = tokio::time::timeout(BENCH_WAIT, arrival).await;
        } else {
            arrival.await;
        }
    }
    /// Next message, orders first; waits at most `timeout`. With a zero timeout it pauses after 128 in a row,
    /// so that the process steps even in a flood.
    pub fn receive(&mut self, timeout: Duration) -> Option<Received> {
        if let Some(plaintext_attempts) = &self.plaintext_attempts {
            plaintext_attempts.poll();
        }
        self.take_opened();
        let received = self.take(timeout);
        if received.is_none() {
            self.in_a_row = 0;
        }
        received
    }
    fn take(&mut self, mut timeout: Duration) -> Option<Received> {
        while !timeout.is_zero() || self.in_a_row < MAX_IN_A_ROW {
            let Some(received) = self.parts.inbox.take(timeout) else {
                break;
            };
            self.in_a_row += 1;
            self.counts.received += 1;
            self.last_received_ns = Some(received.at_ns);
            let Some(channel) = &mut self.channel else {
                return Some(received);
            };
            channel.take(received);
            timeout = Duration::ZERO;
        }
        self.channel.as_mut()?.ready(steady_ns())
    }

    /// Watchdog of the dialling side, to be called periodically. Reopens the session if it is silent, or has brought no
    /// fresh messages for too long; `age_s` is the age of the newest (infinite: unknown). The latter occurs if a stream is
    /// far behind, or if declarations of a datagram session were lost or overtaken, so that one side publishes without a
    /// subscriber (30 ms of jitter: 2 of 8 sessions). The listening side keeps its socket, and silence does not indicate a
    /// fault there; its watchdog is [`Radio::survives_pause`].
    pub fn watch(&mut self, age_s: f64) {
        self.watched = true;
        let is_begun = self.opening.is_some() || self.open.is_none() && self.attempts.is_pausing();
        if self.parts.config.connect.is_empty() || is_begun {
            return;
        }
        let now = steady_ns();
        let since_s = |at: i64| now.saturating_sub(at) as f64 * 1e-9;
        let limit_s = self.parts.config.reopen_after_s;
        let lease_s = self.parts.config.link_lease_s();
        if age_s <= limit_s {
            self.last_fresh_ns = now;
        }
        let silent_s = self.last_received_ns.map_or(0.0, since_s);
        let silent = silent_s > self.parts.config.silence_limit_s();
        let old = silent_s < lease_s && since_s(self.last_fresh_ns) > limit_s + lease_s;
        if !silent && !old && self.open.is_some() {
            return;
        }
        if let Some(old) = self.open.take() {
            // Detached, because closing may hang for ten seconds under loss.
            let _detached = std::thread::Builder::new().name("close".into()).spawn(move || {
                let session = old.session.clone();
                drop(old);
                let _closed = session.close().wait();
            });
        }
        self.last_received_ns = Some(now);
        self.last_fresh_ns = now;
        self.reopen();
    }

    /// Whether the session is usable after its process was suspended for `gap_s`. After about one lease, the middleware's
    /// reader of a listener's datagram socket stays blocked and keeps the port (SIGSTOP for 2 s: 9 of 9 never read again,
    /// even with the session closed), so only a new process receives again. The dialling side has its watchdog
    /// ([`Radio::watch`]); a vessel behind a router has none, because silence does not indicate a fault there.
    pub fn survives_pause(&self, gap_s: f64) -> bool {
        let config = &self.parts.config;
        let recovers = self.watched && !config.connect.is_empty();
        recovers || gap_s < 0.9 * config.link_lease_s()
    }

    /// Leaks the session of a process that ends now: closing a stuck one would block forever.
    pub fn abandon(&mut self) {
        core::mem::forget((self.open.take(), self.opening.take()));
    }

    pub fn flows(&self) -> &[Flow] {
        &self.flows
    }
    pub fn counts(&self) -> RadioCounts {
        RadioCounts {
            dropped: self.parts.dropped.load(Ordering::Relaxed),
            reopened: self.attempts.reopened(),
            ..self.counts
        }
    }
}
