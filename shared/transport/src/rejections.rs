//! Counts of rejected peers.
//!
//! Sessions with a name that is not admitted are recognised by their links ([`follow`]). Zenoh 1.10 reports
//! other rejections only in its log (crate `tracing`), which a subscriber evaluates:
//!
//! - a session with a failed TLS handshake (QUIC's, RFC 9001): no certificate, another authority, or expired.
//!   Without transport and link, neither `transport_events_listener` nor `link_events_listener` reports it;
//! - a message of an admitted name on a key outside its rule, which the access control drops without any other trace.
//!
//! [`PlaintextAttempts`] detects streams without TLS.
//!
//! The log texts are those of the zenoh version in use; `deploy/tests/live/access.rs` fails if they change.

use std::{
    cell::Cell,
    fmt::{Debug, Write},
    net::TcpListener,
    sync::{Mutex, Once, PoisonError},
};

use alight_shared::admission::AccessRejection;
use tracing::{
    Event, Metadata, Subscriber,
    field::{Field, Visit},
};
use tracing_subscriber::{
    Layer,
    filter::filter_fn,
    layer::{Context, SubscriberExt},
    registry::LookupSpan,
};
use zenoh::{Wait, sample::SampleKind, session::LinkEvent};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AccessRejections {
    pub count: u64,
    pub last: Option<AccessRejection>,
    /// Number per reason in the order of [`AccessRejection::ALL`].
    each: [u64; AccessRejection::ALL.len()],
}

impl AccessRejections {
    pub fn of(&self, rejection: AccessRejection) -> u64 {
        let at = AccessRejection::ALL.iter().position(|r| *r == rejection);
        at.and_then(|k| self.each.get(k)).copied().unwrap_or(0)
    }
}

static COUNTED: Mutex<AccessRejections> = Mutex::new(AccessRejections {
    count: 0,
    last: None,
    each: [0; AccessRejection::ALL.len()],
});
static LISTENING: Once = Once::new();

pub fn counted() -> AccessRejections {
    *COUNTED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Counting layer for a process with its own log.
pub fn layer<S: Subscriber + for<'a> LookupSpan<'a>>() -> impl Layer<S> {
    let is_rejection = |metadata: &Metadata<'_>| {
        metadata.is_event() && (metadata.target().starts_with(HANDSHAKES) || metadata.target() == RULES)
    };
    Counter.with_filter(filter_fn(is_rejection))
}

/// Starts counting; an existing log of the process is kept.
pub fn listen() {
    LISTENING.call_once(|| {
        let _another = tracing::subscriber::set_global_default(tracing_subscriber::registry().with(layer()));
    });
}

/// Counts sessions whose certificate has none of the `admitted` names; access rules reject their messages.
pub(super) fn follow(session: &zenoh::Session, admitted: Vec<String>) -> zenoh::Result<()> {
    let changed = move |event: LinkEvent| {
        let name = event.link().auth_identifier();
        let is_admitted = name.is_some_and(|name| admitted.iter().any(|a| a == name));
        if event.kind() == SampleKind::Put && !is_admitted {
            count(AccessRejection::Name);
        }
    };
    let links = session.info();
    let listener = links.link_events_listener().history(true).callback(changed);
    listener.background().wait()
}

fn count(rejection: AccessRejection) {
    let mut counted = COUNTED.lock().unwrap_or_else(PoisonError::into_inner);
    counted.count = counted.count.saturating_add(1);
    counted.last = Some(rejection);
    let at = AccessRejection::ALL.iter().position(|r| *r == rejection);
    if let Some(n) = at.and_then(|k| counted.each.get_mut(k)) {
        *n = n.saturating_add(1);
    }
}

const HANDSHAKES: &str = "zenoh_link_commons::quic";
const RULES: &str = "zenoh::net::routing::interceptor::access_control";

thread_local! {
    /// Set while the middleware precomputes permissions for a key, before it is used.
    static BEFOREHAND: Cell<bool> = const { Cell::new(false) };
}

fn rejection_in(target: &str, text: &str) -> Option<AccessRejection> {
    if target.starts_with(HANDSHAKES) {
        // The middleware mistakes any failed handshake for a lack of file descriptors.
        if !text.contains("Hint: increase the system open file limit") {
            return None;
        }
        return Some(
            if text.contains("NoCertificates") || text.contains("no certificates") {
                AccessRejection::NoCertificate
            } else if text.contains("UnknownIssuer") || text.contains("BadSignature") {
                AccessRejection::OtherAuthority
            } else if text.contains("xpired")
                || text.contains("NotValidYet")
                || text.contains("not valid yet")
            {
                AccessRejection::Expired
            } else {
                AccessRejection::Handshake
            },
        );
    }
    if text.contains("caching permissions") {
        BEFOREHAND.set(true);
        return None;
    }
    if text.contains("Declare Liveliness Subscriber") {
        BEFOREHAND.set(false);
        return None;
    }
    let put = ["Put", "Reply"]
        .iter()
        .any(|what| text.contains(&format!("is unauthorized to {what} (ingress)")));
    let tried = text.starts_with("Using cached") || !BEFOREHAND.get();
    (put && tried).then_some(AccessRejection::Key)
}

/// Connection attempts over TCP to the same port, which are counted and closed: QUIC runs over UDP, so no legitimate
/// peer connects over TCP.
pub(super) struct PlaintextAttempts(TcpListener);

impl PlaintextAttempts {
    /// Maximum number of attempts handled per poll.
    const AT_ONCE: usize = 16;

    /// Listens at the endpoint with certificates, unless another program uses its TCP port.
    pub(super) fn at(listen: &[String]) -> Option<PlaintextAttempts> {
        let address = listen.iter().find_map(|e| e.strip_prefix("quic/"))?;
        let address = address.split(['?', '#']).next()?;
        let listener = TcpListener::bind(address).ok()?;
        listener.set_nonblocking(true).ok()?;
        Some(PlaintextAttempts(listener))
    }
    pub(super) fn poll(&self) {
        for _ in 0..Self::AT_ONCE {
            match self.0.accept() {
                Ok(_shut_at_once) => count(AccessRejection::NotTls),
                Err(_none_waiting) => break,
            }
        }
    }
}

struct Text(String);

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        if field.name() == "message" {
            // Writing to memory cannot fail.
            let _written = write!(self.0, "{value:?}");
        }
    }
}

struct Counter;

impl<S: Subscriber> Layer<S> for Counter {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut text = Text(String::new());
        event.record(&mut text);
        if let Some(rejection) = rejection_in(event.metadata().target(), &text.0) {
            count(rejection);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn access_rejections_with_cached_permissions() {
        let put = "abc on drone-1 is unauthorized to Put (ingress) on alight/vessel-1/estimate";
        assert_eq!(rejection_in(RULES, put), Some(AccessRejection::Key));
        assert_eq!(
            rejection_in(RULES, "ACL (ingress): caching permissions for `x` ..."),
            None
        );
        assert_eq!(rejection_in(RULES, put), None);
        assert_eq!(
            rejection_in(RULES, &format!("Using cached result: {put}")),
            Some(AccessRejection::Key)
        );
        let last = "abc on drone-1 is unauthorized to Declare Liveliness Subscriber (ingress) on x";
        assert_eq!(rejection_in(RULES, last), None);
        assert_eq!(rejection_in(RULES, put), Some(AccessRejection::Key));
        assert_eq!(
            rejection_in(RULES, "abc on drone-1 is authorized to Put (ingress) on x"),
            None
        );
        // A peer without an admitted name is counted by its link instead.
        let unnamed =
            "abc did not match any configured ACL subject. Default permission `Deny` will be applied";
        assert_eq!(rejection_in(RULES, unnamed), None);
    }
}
