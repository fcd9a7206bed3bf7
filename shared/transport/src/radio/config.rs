//! Configuration of the radio, and the resulting zenoh settings.

use std::{fs::File, io::Read};

use serde_json::Value;

use crate::{TransportContext, TransportError, access};
use alight_shared::config;

/// Timeout for opening a datagram session, ms. An attempt repeats no datagram, so it is short.
const DATAGRAM_OPEN_MS: u32 = 1000;
/// Timeout for opening a stream session, ms. TCP or QUIC and zenoh need three round trips, 0.6 s at 100 ms
/// each way, and a lost packet is first repeated after 1 s. At 30 % loss and 100 ms no stream opened in 33 s
/// with attempts of 1 s; with 3 s one attempt in four succeeded, and a session was restored within 30 s.
const STREAM_OPEN_MS: u32 = 8000;

/// Metadata of a QUIC endpoint: if both sides support it, a stream for reliable messages (handshake,
/// declarations) and datagrams for publications, only the newest of which matters.
const QUIC_METADATA: &str = "?mixed_rel=auto";

/// Maximum batch of the middleware, bytes; with IPv6 and TCP headers it fits into one packet.
const BATCH_BYTES: u32 = 1380;
/// Maximum length of a reassembled message, bytes. Ours fit into one batch; the rest is for zenoh's
/// declarations. Zenoh's default would let a peer occupy 1 GB.
const MAX_MESSAGE_BYTES: u32 = 16_384;
/// Sessions per peer: the present one, and the one before a restart until it expires.
const SESSIONS_PER_PEER: usize = 2;
/// Additional sessions for peers that restart repeatedly.
const SPARE_SESSIONS: usize = 8;
/// Capacity of a stream's socket, bytes, to which the system adds about as much for overhead.
const SOCKET_BYTES: u32 = 16_384;

config! {
    /// Endpoints and timeouts of the radio.
    pub struct RadioConfig {
        /// Endpoints to listen on, such as `udp/0.0.0.0:7447`; for a vessel.
        pub listen: Vec<String> = Vec::new();
        /// Endpoints to dial, such as `udp/192.168.7.1:7447`; for a drone.
        pub connect: Vec<String> = Vec::new();
        /// Silence after which a datagram link is closed, s.
        /// Measured: after an outage of 5 s, TCP delivers a backlog of 5.5 s with a lease of 10 s (the default),
        /// and fresh messages with 2 s.
        pub lease_s: f64 = 2.0, in 0.5..=60.0;
        /// Silence after which a stream or QUIC link is closed, s. Measured at 30 % loss and 100 ms: a stream
        /// is silent for over 2 s every 20 s and recovers within 5 s, while a new session takes 2 to 10 s.
        pub stream_lease_s: f64 = 5.0, in 0.5..=60.0;
        /// Silence after which a datagram session is reopened, s; a stream or QUIC session, after its lease
        /// plus one attempt to open. A session whose messages are all older than this is reopened after this
        /// time plus its lease.
        /// Chosen: twice the sum of a lease and the slowest retry.
        pub reopen_after_s: f64 = 5.0, in 1.0..=600.0;
        /// The endpoints to dial are a Zenoh router's (zenohd), such as the boat's own, that connects vessels
        /// and drones. With certificates, `tls.router` is its name, and it checks each peer's keys.
        pub router: bool = false;
        /// File of Zenoh's own configuration (JSON5), or its text in braces; empty: none. Settings that
        /// contradict Alight are rejected.
        pub zenoh: String = String::new();
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
        at.require(
            !this.router || !this.connect.is_empty(),
            "router",
            true,
            "with a router both vessel and drone dial: put its endpoint into connect and leave listen empty",
        )?;
        let secured = !this.tls.authority.is_empty();
        at.require(
            (this.router && secured) != this.tls.router.is_empty(),
            "tls.router",
            format!("{:?}", this.tls.router),
            "the name in the router's certificate, such as \"vessel-9\", with router = true and certificates; empty otherwise",
        )?;
        at.require(
            this.tls.router.is_empty() || access::is_name(&this.tls.router),
            "tls.router",
            &this.tls.router,
            "a name as in certificates: small letters, digits and hyphens",
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
    /// Certificate files (PEM). Leave empty for endpoints without TLS, which is part of QUIC (RFC 9001).
    pub struct TlsConfig {
        /// Certificate of the authority that signed both sides' certificates.
        pub authority: String = String::new();
        /// Our certificate.
        pub certificate: String = String::new();
        /// Private key of the certificate.
        pub key: String = String::new();
        /// Certificate names of admitted peers, `vessel-N` or `drone-N`. Each may publish under its own key
        /// expressions only.
        pub peers: Vec<String> = Vec::new();
        /// Certificate name of the Zenoh router (`radio.router`); empty: none. Peers' keys are permitted on
        /// its link only, and its access rules must check which certificate may use which key.
        pub router: String = String::new();
    }
}

/// Whether a text is an endpoint: `protocol/host:port`, optionally with Zenoh's metadata (`?`) and configuration (`#`).
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
    /// Configuration that listens at one endpoint with these certificates.
    pub fn listening(endpoint: impl Into<String>, tls: TlsConfig) -> RadioConfig {
        RadioConfig {
            listen: vec![endpoint.into()],
            tls,
            ..RadioConfig::default()
        }
    }
    /// Configuration that dials one endpoint with these certificates.
    pub fn dialling(endpoint: impl Into<String>, tls: TlsConfig) -> RadioConfig {
        RadioConfig {
            connect: vec![endpoint.into()],
            tls,
            ..RadioConfig::default()
        }
    }
    /// Whether the session runs over a transport with retransmission.
    pub(super) fn is_stream(&self) -> bool {
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
    pub(super) fn link_lease_s(&self) -> f64 {
        if self.is_stream() {
            self.stream_lease_s
        } else {
            self.lease_s
        }
    }
    /// Silence after which the watchdog reopens the session, s.
    pub(super) fn silence_limit_s(&self) -> f64 {
        if self.is_stream() {
            self.reopen_after_s + self.stream_lease_s + f64::from(STREAM_OPEN_MS) * 1e-3
        } else {
            self.reopen_after_s
        }
    }
    /// Certificate names that access rules apply to; None without certificates.
    pub(super) fn admitted(&self) -> Option<Vec<String>> {
        let tls = &self.tls;
        let names = if self.router {
            vec![tls.router.clone()]
        } else {
            tls.peers.clone()
        };
        (!tls.authority.is_empty()).then_some(names)
    }
    fn max_sessions(&self) -> usize {
        let peers = match self.tls.peers.len() {
            // Without certificates peers have no names.
            0 => access::PEERS,
            named => named,
        };
        SESSIONS_PER_PEER * peers + SPARE_SESSIONS
    }
    /// Checks that Zenoh's own configuration can be read and agrees with this one.
    pub fn check_zenoh(&self) -> Result<(), TransportError> {
        let file = ZenohFile::of(self)?;
        self.session("alight/any", &[], file.as_ref()).map(|_| ())
    }
    /// Settings of the session: those of `file`, overridden by this configuration. `name` is our key prefix,
    /// `own` our keys.
    pub(super) fn session(
        &self,
        name: &str,
        own: &[String],
        file: Option<&ZenohFile>,
    ) -> Result<zenoh::Config, TransportError> {
        file.map_or(Ok(()), ZenohFile::leaves_messages)?;
        let mut config = file.map_or_else(|| Ok(zenoh::Config::default()), ZenohFile::config)?;
        for (key, value) in self.settings(name, own) {
            if let Some(file) = file {
                file.agrees(key, &value)?;
            }
            config
                .insert_json5(key, &value)
                .map_err(|e| TransportError::because(format!("setting {key} of the radio to {value}"), e))?;
        }
        Ok(config)
    }
    fn settings(&self, name: &str, own: &[String]) -> Vec<(&'static str, String)> {
        let ms = |s: f64| (s * 1e3).round().to_string();
        let text = |v: &dyn core::fmt::Debug| format!("{v:?}");
        let open_ms = self.open_ms().to_string();
        let ends = |endpoints: &[String]| text(&endpoints.iter().map(|e| completed(e)).collect::<Vec<_>>());
        let mut settings: Vec<(&str, String)> = vec![
            ("mode", text(&if self.router { "client" } else { "peer" })),
            ("listen/endpoints", ends(&self.listen)),
            ("connect/endpoints", ends(&self.connect)),
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
            // Messages waiting in middleware or socket age: limit a batch to one packet, the socket to a few.
            ("transport/link/tx/batch_size", BATCH_BYTES.to_string()),
            ("transport/link/tcp/so_sndbuf", SOCKET_BYTES.to_string()),
            (
                "transport/link/rx/max_message_size",
                MAX_MESSAGE_BYTES.to_string(),
            ),
            // Otherwise one certificate could open a thousand sessions: the middleware limits only their sum.
            ("transport/unicast/max_sessions", self.max_sessions().to_string()),
            ("low_pass_filter", access::question_sizes().to_string()),
        ];
        if !self.router {
            // Behind a router, all peers would have one common query rate.
            settings.push(("downsampling", access::question_rates(name, own).to_string()));
        }
        if !self.tls.authority.is_empty() {
            let router = self.router.then_some(self.tls.router.as_str());
            let rules = access::rules(name, own, &self.tls.peers, router);
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
                ("transport/link/tls/verify_name_on_connect", "true".into()),
                ("transport/link/protocols", r#"["quic"]"#.into()),
                ("access_control", rules.to_string()),
            ]);
        }
        settings
    }
}

/// Maximum length of Zenoh's configuration file, bytes; its complete example takes 40 kB.
const MAX_FILE_BYTES: u64 = 1 << 18;

/// Settings that Alight does not make and that must not be set, with reasons.
const UNSETTABLE: [(&str, &str); 2] = [
    (
        "namespace",
        "it would prefix every key, which other computers and access rules expect as alight/NAME",
    ),
    (
        "qos",
        "it would change priority and congestion control, which Alight chooses for each topic",
    ),
];

fn is_empty(value: &Value) -> bool {
    match value {
        Value::Null => true,
        Value::Array(items) => items.iter().all(is_empty),
        Value::Object(keys) => keys.values().all(is_empty),
        Value::Bool(_) | Value::Number(_) | Value::String(_) => false,
    }
}

#[derive(Clone, Debug)]
pub(super) struct ZenohFile {
    path: String,
    text: String,
    values: Value,
}

/// Whether `radio.zenoh` is the text itself, which always contains a brace.
fn is_text(zenoh: &str) -> bool {
    zenoh.contains('{')
}

/// Zenoh's own configuration: the text in `radio.zenoh`, or the file that it names; None if empty.
pub fn zenoh_text(zenoh: &str) -> Result<Option<String>, TransportError> {
    if zenoh.is_empty() || is_text(zenoh) {
        return Ok((!zenoh.is_empty()).then(|| zenoh.to_owned()));
    }
    let mut text = String::new();
    File::open(zenoh)
        .and_then(|f| f.take(MAX_FILE_BYTES).read_to_string(&mut text))
        .map_err(|e| TransportError {
            doing: format!("reading Zenoh's configuration {zenoh} (radio.zenoh)"),
            what: format!("{e}; check the path and its permissions"),
        })?;
    Ok(Some(text))
}

impl ZenohFile {
    pub(super) fn of(config: &RadioConfig) -> Result<Option<ZenohFile>, TransportError> {
        let Some(text) = zenoh_text(&config.zenoh)? else {
            return Ok(None);
        };
        let path = if is_text(&config.zenoh) {
            "given as text".into()
        } else {
            config.zenoh.clone()
        };
        let values = json5::from_str(&text).map_err(|e| TransportError {
            doing: format!("reading Zenoh's configuration {path} (radio.zenoh)"),
            what: format!("{e}; it must be JSON5"),
        })?;
        Ok(Some(ZenohFile { path, text, values }))
    }
    fn config(&self) -> Result<zenoh::Config, TransportError> {
        zenoh::Config::from_json5(&self.text).doing(|| format!("reading Zenoh's configuration {}", self.path))
    }
    /// Checks that the file does not change keys and priorities of messages.
    fn leaves_messages(&self) -> Result<(), TransportError> {
        let set = |key: &str| self.values.get(key).filter(|v| !is_empty(v));
        let Some((key, value, why)) = UNSETTABLE
            .iter()
            .find_map(|(key, why)| set(key).map(|value| (key, value, why)))
        else {
            return Ok(());
        };
        Err(TransportError {
            doing: format!("reading Zenoh's configuration {}", self.path),
            what: format!("{key} is {value} in it, and {why}; remove it there"),
        })
    }
    /// Checks that the file leaves `key` unset, or sets it to Alight's `value`.
    fn agrees(&self, key: &str, value: &str) -> Result<(), TransportError> {
        let own: Value = json5::from_str(value).doing(|| format!("reading the radio's own {key}"))?;
        let Some(theirs) = self
            .values
            .pointer(&format!("/{key}"))
            .filter(|v| !v.is_null() && **v != own)
        else {
            return Ok(());
        };
        let by = match key {
            "access_control" => "sets it by radio.tls.peers".into(),
            _ => format!("sets it to {own}"),
        };
        Err(TransportError {
            doing: format!("reading Zenoh's configuration {}", self.path),
            what: format!(
                "{key} is {theirs} in it, and Alight {by}; remove it there (the table radio has its settings)"
            ),
        })
    }
}

fn completed(endpoint: &str) -> String {
    if endpoint.starts_with("quic/") && !endpoint.contains(['?', '#']) {
        format!("{endpoint}{QUIC_METADATA}")
    } else {
        endpoint.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{
        config::{Check, Keys},
        wire::MAX_WIRE_BYTES,
    };

    #[test]
    fn memory_and_sessions_that_peers_may_take() {
        let mut config = RadioConfig::listening("quic/127.0.0.1:7447", TlsConfig::default());
        config.tls.peers = (1..=3).map(|k| format!("drone-{k}")).collect();
        let number = |config: &RadioConfig, key: &str| -> usize {
            let session = config.session("alight/vessel-1", &[], None).unwrap();
            session.get_json(key).unwrap().parse().unwrap()
        };
        let longest = number(&config, "transport/link/rx/max_message_size");
        assert!((2 * MAX_WIRE_BYTES..=16_384).contains(&longest), "{longest}");
        assert_eq!(number(&config, "transport/unicast/max_sessions"), 14);
        config.tls.peers.clear();
        assert!(number(&config, "transport/unicast/max_sessions") > 2 * 64);
    }

    #[test]
    fn tls_endpoint() {
        let text = "listen = [\"tls/127.0.0.1:7447\"]";
        let rejected = config::parse::<RadioConfig>(text, "test.toml");
        let rejected = rejected.unwrap_err().to_string();
        assert!(
            rejected.contains("tls/127.0.0.1:7447") && rejected.contains("quic/"),
            "{rejected}"
        );
    }

    #[test]
    fn questions_that_peers_may_send() {
        let config = RadioConfig::listening("tcp/127.0.0.1:7447", TlsConfig::default());
        let own = ["wave", "estimate"].map(|topic| format!("alight/vessel-1/{topic}"));
        let session = config.session("alight/vessel-1", &own, None).unwrap();
        let set = |key: &str| -> Value { serde_json::from_str(&session.get_json(key).unwrap()).unwrap() };
        let sizes = set("low_pass_filter");
        let rates = set("downsampling");
        // The receiver counts messages that are too long, and no newer message is dropped for an older one.
        for rule in [&sizes[0], &rates[0]] {
            assert_eq!(rule["messages"], serde_json::json!(["query"]));
            assert_eq!(rule["flows"], serde_json::json!(["ingress"]));
        }
        assert!(sizes[0]["size_limit"].as_u64().unwrap() < 1000 && sizes[1].is_null());
        // A drone queries several keys at once, with separate rates.
        let keys = rates[0]["rules"].as_array().unwrap().iter();
        let keys: Vec<&str> = keys.map(|r| r["key_expr"].as_str().unwrap()).collect();
        assert_eq!(
            keys,
            ["alight/vessel-1/@schema/**", own[0].as_str(), own[1].as_str()]
        );
    }

    fn through_router(router: &str) -> RadioConfig {
        let tls = TlsConfig {
            authority: "authority.pem".into(),
            peers: vec!["vessel-1".into()],
            router: router.into(),
            ..TlsConfig::default()
        };
        RadioConfig {
            router: true,
            ..RadioConfig::dialling("quic/127.0.0.1:7447", tls)
        }
    }

    #[test]
    fn router_without_the_name_of_its_certificate() {
        let checked = |config: &RadioConfig| config.check(&Keys::ROOT).map_err(|e| e.to_string());
        assert_eq!(checked(&through_router("vessel-9")), Ok(()));
        for unnamed in ["", "vessel/*"] {
            assert!(
                checked(&through_router(unnamed))
                    .unwrap_err()
                    .contains("tls.router")
            );
        }
        let mut config = through_router("vessel-9");
        config.router = false;
        assert!(checked(&config).unwrap_err().contains("tls.router"));
        config.tls.router.clear();
        assert_eq!(checked(&config), Ok(()));
    }

    #[test]
    fn zenoh_file_with_certificates() {
        let mut config = through_router("vessel-9");
        let mut tried = |text: &str| {
            config.zenoh = text.into();
            config.check_zenoh().map_err(|e| e.to_string())
        };
        assert_eq!(tried("{ transport: { link: { tls: {} } } }"), Ok(()));
        let why = tried("{ transport: { link: { tls: { verify_name_on_connect: false } } } }").unwrap_err();
        assert!(why.contains("verify_name_on_connect is false"), "{why}");
        let why = tried("{ access_control: { enabled: false } }").unwrap_err();
        assert!(why.contains("access_control is"), "{why}");
    }

    #[test]
    fn zenoh_file_and_configuration() {
        let path = std::env::temp_dir().join(format!("alight-zenoh-{}.json5", std::process::id()));
        let tried = |text: &str| {
            std::fs::write(&path, text).unwrap();
            let mut config = RadioConfig::dialling("tcp/127.0.0.1:7447", TlsConfig::default());
            config.router = true;
            config.zenoh = path.display().to_string();
            config.check_zenoh().map_err(|e| e.to_string())
        };
        assert_eq!(
            tried("{ metadata: { boat: 'Ida' }, // a comment\n mode: 'client' }"),
            Ok(())
        );
        assert_eq!(tried("{ access_control: { enabled: false } }"), Ok(()));
        assert_eq!(tried("{ namespace: null, qos: { publication: [] } }"), Ok(()));
        for (text, named) in [
            (
                "{ mode: 'peer' }",
                "mode is \"peer\" in it, and Alight sets it to \"client\"",
            ),
            (
                "{ scouting: { multicast: { enabled: true } } }",
                "scouting/multicast/enabled is true",
            ),
            ("{ listen: { endpoints: ['tcp/0.0.0.0:0'] } }", "listen/endpoints"),
            (
                "{ transport: { link: { tx: { lease: 10000 } } } }",
                "transport/link/tx/lease is 10000",
            ),
            ("{ no_such_key: 1 }", "no_such_key"),
            ("{ namespace: 'boat' }", "namespace is \"boat\" in it"),
            (
                "{ qos: { publication: [{ key_exprs: ['alight/**'], config: { priority: 'background' } }] } }",
                "priority and congestion control",
            ),
            ("{ mode: ", "JSON5"),
        ] {
            let why = tried(text).unwrap_err();
            assert!(
                why.contains(named) && why.contains("alight-zenoh-"),
                "{text}: {why}"
            );
        }
        std::fs::remove_file(&path).unwrap();
        assert!(tried_missing(&path).contains("check the path"));
    }

    fn tried_missing(path: &std::path::Path) -> String {
        let mut config = RadioConfig::listening("tcp/127.0.0.1:7447", TlsConfig::default());
        config.zenoh = path.display().to_string();
        config.check_zenoh().unwrap_err().to_string()
    }
}
