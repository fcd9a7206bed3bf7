//! Zenoh session of the node: opened with retries, publishing without waiting, with service requests in a bounded
//! queue.

use std::{
    marker::PhantomData,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, SyncSender, TryRecvError, TrySendError, sync_channel},
    },
};

use alight_computer::io::wall::wall_ns;
use alight_shared::msg::CommandKind;
use zenoh::{
    Wait,
    bytes::Encoding,
    config::WhatAmI,
    liveliness::LivelinessToken,
    pubsub::Publisher,
    qos::CongestionControl,
    query::{Query, Queryable},
};

use crate::ros2::{
    cdr,
    messages::{RosMessage, TRIGGER, TriggerResponse},
    names::{Endpoint, Entity, RosNode, attachment, gid, response_attachment, sent_ns},
    orders::Caller,
};

const RETRY_NS: i64 = 1_000_000_000;
const LOOK_NS: i64 = 1_000_000_000;
/// Maximum number of waiting requests; further requests are rejected.
const INBOX: usize = 16;
/// Maximum length of a request, bytes; a request of `Trigger` has five.
const MAX_REQUEST: usize = 64;
const MAX_MESSAGE_BYTES: u32 = 65_536;
const OPEN_MS: u32 = 3000;
/// Time for which a response waits for room in the middleware's queue before its link is closed, us.
const CONGESTED_US: u32 = 500_000;
/// History depth of a service (`rmw_qos_profile_services_default`).
const SERVICE_DEPTH: u32 = 10;

#[derive(Clone, Debug)]
pub enum RosConnection {
    /// A router listens there, as rmw_zenohd does.
    Router(String),
    /// ROS's sessions connect to this endpoint.
    Here(String),
}

impl RosConnection {
    fn config(&self) -> Result<zenoh::Config, String> {
        let (mode, list, endpoint) = match self {
            RosConnection::Router(endpoint) => (WhatAmI::Client, "connect/endpoints", endpoint),
            RosConnection::Here(endpoint) => (WhatAmI::Peer, "listen/endpoints", endpoint),
        };
        let settings = [
            ("mode", format!("{:?}", mode.to_str())),
            (list, format!("{:?}", [endpoint])),
            ("scouting/multicast/enabled", "false".into()),
            ("scouting/gossip/enabled", "false".into()),
            ("transport/unicast/open_timeout", OPEN_MS.to_string()),
            (
                "transport/link/rx/max_message_size",
                MAX_MESSAGE_BYTES.to_string(),
            ),
            (
                "transport/link/tx/queue/congestion_control/block/wait_before_close",
                CONGESTED_US.to_string(),
            ),
        ];
        let mut config = zenoh::Config::default();
        for (key, value) in settings {
            let inserted = config.insert_json5(key, &value);
            inserted.map_err(|e| format!("setting {key} to {value}: {e}"))?;
        }
        Ok(config)
    }
    /// Text about the connection; `is_there` while a peer is connected.
    fn contact(&self, is_there: bool) -> String {
        match (self, is_there) {
            (RosConnection::Router(at), true) => format!("connected to the router at {at}"),
            (RosConnection::Router(at), false) => {
                format!("no router at {at}; trying again (ros2 run rmw_zenoh_cpp rmw_zenohd starts one)")
            }
            (RosConnection::Here(at), true) => format!("connected at {at}"),
            (RosConnection::Here(at), false) => format!("no peer is connected at {at}"),
        }
    }
}

pub struct RosTopic<M>(usize, PhantomData<fn(M)>);

struct Published {
    port: Publisher<'static>,
    gid: [u8; 16],
    number: i64,
}

struct Open {
    publishers: Vec<Published>,
    _servers: Vec<Queryable<()>>,
    _tokens: Vec<LivelinessToken>,
    session: zenoh::Session,
}

enum State {
    Closed(i64),
    /// Opened by a separate thread, which may take as long as the network does.
    Opening(Receiver<Result<Open, String>>),
    Open(Open),
}

#[derive(Clone)]
struct Parts {
    place: RosConnection,
    node: RosNode,
    topics: Vec<Endpoint>,
    services: Vec<(Endpoint, CommandKind)>,
    inbox: SyncSender<Request>,
    /// Whether a session of a distribution with other keys is in the domain.
    is_apart: Arc<AtomicBool>,
}

pub struct RosSession {
    parts: Parts,
    inbox: Receiver<Request>,
    state: State,
    looked_ns: i64,
    /// Whether a peer was connected; None before the first check.
    contact: Option<bool>,
    why: String,
    warned: bool,
}

impl RosSession {
    pub fn of(node: RosNode, place: RosConnection) -> RosSession {
        let (sender, inbox) = sync_channel(INBOX);
        RosSession {
            parts: Parts {
                place,
                node,
                topics: Vec::new(),
                services: Vec::new(),
                inbox: sender,
                is_apart: Arc::default(),
            },
            inbox,
            state: State::Closed(i64::MIN),
            looked_ns: i64::MIN,
            contact: None,
            why: String::new(),
            warned: false,
        }
    }
    /// Adds a topic with this absolute name, before the session is opened; a receiver is to keep `depth` messages.
    pub fn topic<M: RosMessage>(&mut self, name: String, depth: u32) -> RosTopic<M> {
        self.parts.topics.push(Endpoint {
            name,
            kind: M::TYPE,
            entity: Entity::Publisher,
            depth,
        });
        RosTopic(self.parts.topics.len() - 1, PhantomData)
    }
    /// Adds a service with this absolute name that orders `kind`, before the session is opened.
    pub fn service(&mut self, name: String, kind: CommandKind) {
        let endpoint = Endpoint {
            name,
            kind: TRIGGER,
            entity: Entity::Server,
            depth: SERVICE_DEPTH,
        };
        self.parts.services.push((endpoint, kind));
    }
    /// Continues to open the session and checks for peers. Returns a text when the connection has changed, and once
    /// when a session of a distribution with other keys is found.
    pub fn poll(&mut self, now_ns: i64) -> Option<String> {
        match &self.state {
            State::Closed(at_ns) if now_ns >= *at_ns => {
                let (sender, opened) = sync_channel(1);
                let parts = self.parts.clone();
                std::thread::spawn(move || drop(sender.send(Open::of(&parts))));
                self.state = State::Opening(opened);
            }
            State::Closed(_) => {}
            State::Opening(opened) => match opened.try_recv() {
                Ok(Ok(open)) => self.state = State::Open(open),
                Ok(Err(why)) => self.fail(why, now_ns),
                Err(TryRecvError::Empty) => {}
                Err(TryRecvError::Disconnected) => self.fail("opening it has ended".into(), now_ns),
            },
            State::Open(_) => {}
        }
        self.changed_contact(now_ns).or_else(|| {
            let warns = !self.warned && self.parts.is_apart.load(Ordering::Relaxed);
            self.warned |= warns;
            warns.then(|| self.parts.node.distro().remedy().to_owned())
        })
    }
    fn fail(&mut self, why: String, now_ns: i64) {
        self.why = why;
        self.state = State::Closed(now_ns + RETRY_NS);
    }
    fn changed_contact(&mut self, now_ns: i64) -> Option<String> {
        let (is_there, why) = match &self.state {
            State::Open(open) if now_ns.saturating_sub(self.looked_ns) >= LOOK_NS => {
                self.looked_ns = now_ns;
                (open.has_contact(), "")
            }
            State::Closed(_) => (false, self.why.as_str()),
            State::Open(_) | State::Opening(_) => return None,
        };
        if self.contact == Some(is_there) {
            return None;
        }
        self.contact = Some(is_there);
        let line = self.parts.place.contact(is_there);
        Some(if why.is_empty() {
            line
        } else {
            format!("{line}: {why}")
        })
    }
    pub fn publish<M: RosMessage>(&mut self, topic: &RosTopic<M>, message: &M) {
        let State::Open(open) = &mut self.state else {
            return;
        };
        let Some(to) = open.publishers.get_mut(topic.0) else {
            return;
        };
        let Some(bytes) = cdr::encode(message) else { return };
        to.number += 1;
        let put = to.port.put(bytes);
        // A lost message is not reported, because the next one is newer.
        let _sent = put.attachment(attachment(to.number, wall_ns(), to.gid)).wait();
    }
    pub fn request(&self) -> Option<Request> {
        self.inbox.try_recv().ok()
    }
}

impl Open {
    fn of(parts: &Parts) -> Result<Open, String> {
        // The middleware's errors end with the position in its sources.
        let reason = |e: String| {
            e.split(" at /")
                .next()
                .unwrap_or_default()
                .trim_end_matches([' ', '!'])
                .to_owned()
        };
        Open::declare(parts).map_err(|e| reason(e.to_string()))
    }
    fn declare(parts: &Parts) -> zenoh::Result<Open> {
        let session = zenoh::open(parts.place.config()?).wait()?;
        let node = &parts.node;
        let zid = session.zid().to_string();
        let token = |text: String| session.liveliness().declare_token(text).wait();
        let is_apart = Arc::clone(&parts.is_apart);
        let distro = node.distro();
        session
            .liveliness()
            .declare_subscriber(node.tokens())
            .history(true)
            .callback(move |sample| {
                if distro.is_apart(sample.key_expr().as_str()) {
                    is_apart.store(true, Ordering::Relaxed);
                }
            })
            .background()
            .wait()?;
        let mut tokens = vec![token(node.token(&zid))?];
        let mut publishers = Vec::with_capacity(parts.topics.len());
        for topic in &parts.topics {
            let text = node.token_of(&zid, tokens.len(), topic);
            let port = session
                .declare_publisher(node.key(topic))
                .encoding(Encoding::APPLICATION_CDR)
                .congestion_control(CongestionControl::Drop)
                .wait()?;
            publishers.push(Published {
                port,
                gid: gid(&text),
                number: 0,
            });
            tokens.push(token(text)?);
        }
        let mut servers = Vec::with_capacity(parts.services.len());
        for (service, kind) in &parts.services {
            let inbox = parts.inbox.clone();
            let kind = *kind;
            let key = node.key(service);
            let server = session
                .declare_queryable(key.clone())
                .complete(true)
                .callback(move |query| Request::receive(query, kind, &key, &inbox))
                .wait()?;
            servers.push(server);
            tokens.push(token(node.token_of(&zid, tokens.len(), service))?);
        }
        Ok(Open {
            publishers,
            _servers: servers,
            _tokens: tokens,
            session,
        })
    }
    fn has_contact(&self) -> bool {
        let info = self.session.info();
        info.routers_zid().wait().next().is_some() || info.peers_zid().wait().next().is_some()
    }
}

pub struct Request {
    pub kind: CommandKind,
    /// Time of sending, ns since 1970 by the client's clock.
    pub sent_ns: i64,
    query: Query,
    attachment: Vec<u8>,
}

impl Request {
    /// Queues a client's request for the service on `key`. Rejects it with the reason if the queue is full, or if the
    /// request is invalid or names more services than this one.
    fn receive(query: Query, kind: CommandKind, key: &str, inbox: &SyncSender<Request>) {
        if !names(query.key_expr().as_str(), key) {
            reject(
                &query,
                "not ordered: a wildcard in place of the service's name and type",
            );
            return;
        }
        let attachment = query.attachment().map(|a| a.to_bytes().into_owned());
        let is_client = attachment
            .as_ref()
            .is_some_and(|a| response_attachment(a, 0).is_some());
        let fits = query.payload().is_some_and(|p| p.len() <= MAX_REQUEST);
        let request = attachment.filter(|_| is_client && fits);
        let Some((attachment, sent_ns)) = request.and_then(|a| sent_ns(&a).map(|sent| (a, sent))) else {
            reject(
                &query,
                "not a request of std_srvs/srv/Trigger in rmw_zenoh's form",
            );
            return;
        };
        let request = Request {
            kind,
            sent_ns,
            query,
            attachment,
        };
        match inbox.try_send(request) {
            Ok(()) => {}
            Err(TrySendError::Full(r) | TrySendError::Disconnected(r)) => {
                // A ROS client would wait forever without a response that it accepts.
                r.reply(false, "not ordered: too many requests wait");
            }
        }
    }
}

/// Whether `asked` names only the service on `key`, ignoring the type hash.
fn names(asked: &str, key: &str) -> bool {
    let named = |key: &str| key.rsplit_once('/').map(|(name, _)| name.to_owned());
    named(asked).is_some() && named(asked) == named(key)
}

fn reject(query: &Query, why: &str) {
    let _gone = query.reply_err(why).encoding(Encoding::TEXT_PLAIN).wait();
}

impl Caller for Request {
    fn reply(self, taken: bool, message: &str) {
        let response = TriggerResponse {
            success: taken,
            message: message.into(),
        };
        let attachment = response_attachment(&self.attachment, wall_ns());
        let (Some(bytes), Some(attachment)) = (cdr::encode(&response), attachment) else {
            return;
        };
        let reply = self.query.reply(self.query.key_expr().clone(), bytes);
        let _gone = reply
            .encoding(Encoding::APPLICATION_CDR)
            .attachment(attachment)
            .wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ros_service_by_its_name() {
        let key = "0/alight/drone_1/land/std_srvs::srv::dds_::Trigger_/RIHS01_ee";
        let asked = |name: &str| names(&format!("0/alight/drone_1/{name}"), key);
        assert!(names(key, key) && asked("land/std_srvs::srv::dds_::Trigger_/*"));
        for several in [
            "*/std_srvs::srv::dds_::Trigger_/RIHS01_ee",
            "l$*/std_srvs::srv::dds_::Trigger_/*",
            "land/**",
            "**",
            "land/*/RIHS01_ee",
        ] {
            assert!(!asked(several), "{several}");
        }
        assert!(!names("**", key));
    }
}
