//! Rejected peers.
//!
//! A session whose certificate has a name that is not admitted is known by the links of the session ([`follow`]). Zenoh 1.10
//! reports the others in its log alone (crate `tracing`), from which a listener counts them:
//!
//! - a session whose TLS handshake (QUIC's, RFC 9001) failed: no certificate, another authority, expired. It has neither
//!   transport nor link, so no event of `transport_events_listener` or `link_events_listener` comes of it;
//! - a message of an admitted name on a key outside its rule, which the access control drops without any other trace.
//!
//! One more is noticed by [`PlaintextAttempts`]: a stream without TLS.
//!
//! The texts are those of the one version of zenoh that is built in; `deploy/tests/live/access.rs` fails when
//! they change.

use std::cell::Cell;
use std::fmt::{Debug, Write};
use std::net::TcpListener;
use std::sync::{Mutex, Once, PoisonError};

use alight_shared::admission::AccessRejection;
use tracing::field::{Field, Visit};
use tracing::{Event, Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::filter_fn;
use tracing_subscriber::layer::{Context, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;
use zenoh::Wait;
use zenoh::sample::SampleKind;
use zenoh::session::LinkEvent;

/// Refusals since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AccessRejections {
    /// How many sessions and messages.
    pub count: u64,
    pub last: Option<AccessRejection>,
    /// How many of each, in the order of [`AccessRejection::ALL`].
    each: [u64; AccessRejection::ALL.len()],
}

impl AccessRejections {
    /// How many for this reason.
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

/// Rejections of this process since it listens.
pub fn counted() -> AccessRejections {
    *COUNTED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What counts the rejections, for a process that has a log of its own.
pub fn layer<S: Subscriber + for<'a> LookupSpan<'a>>() -> impl Layer<S> {
    let says_so = |metadata: &Metadata<'_>| {
        metadata.is_event() && (metadata.target().starts_with(HANDSHAKES) || metadata.target() == RULES)
    };
    Counter.with_filter(filter_fn(says_so))
}

/// Counts from now on; a process that has a log of its own keeps it.
pub fn listen() {
    LISTENING.call_once(|| {
        let _another = tracing::subscriber::set_global_default(tracing_subscriber::registry().with(layer()));
    });
}

/// Counts the links of a session whose certificate has none of the `admitted` names: its access rules deny all that comes
/// over them.
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

/// Where the middleware logs a rejection.
const HANDSHAKES: &str = "zenoh_link_commons::quic";
const RULES: &str = "zenoh::net::routing::interceptor::access_control";

thread_local! {
    /// The middleware works out beforehand what somebody may do with a key: nobody has tried it yet.
    static BEFOREHAND: Cell<bool> = const { Cell::new(false) };
}

/// What the text means.
fn of(target: &str, text: &str) -> Option<AccessRejection> {
    if target.starts_with(HANDSHAKES) {
        // The middleware takes any failed handshake for a lack of open files.
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

/// Who comes to the same port over TCP: QUIC is a protocol over UDP, so nobody of ours does. Whoever knocks
/// is counted and shut out.
pub(super) struct PlaintextAttempts(TcpListener);

impl PlaintextAttempts {
    /// Looked at so many at once at most.
    const AT_ONCE: usize = 16;

    /// At the endpoint with certificates, if there is one. A port that another program has over TCP is
    /// that program's.
    pub(super) fn at(listen: &[String]) -> Option<PlaintextAttempts> {
        let address = listen.iter().find_map(|e| e.strip_prefix("quic/"))?;
        let address = address.split(['?', '#']).next()?;
        let listener = TcpListener::bind(address).ok()?;
        listener.set_nonblocking(true).ok()?;
        Some(PlaintextAttempts(listener))
    }
    /// Counts those who came since the last look; never waits.
    pub(super) fn poll(&self) {
        for _ in 0..Self::AT_ONCE {
            match self.0.accept() {
                Ok(_shut_at_once) => count(AccessRejection::NotTls),
                Err(_nobody) => break,
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

/// Counts the rejections in the middleware's log.
struct Counter;

impl<S: Subscriber> Layer<S> for Counter {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut text = Text(String::new());
        event.record(&mut text);
        if let Some(rejection) = of(event.metadata().target(), &text.0) {
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
        assert_eq!(of(RULES, put), Some(AccessRejection::Key));
        assert_eq!(of(RULES, "ACL (ingress): caching permissions for `x` ..."), None);
        assert_eq!(of(RULES, put), None);
        assert_eq!(
            of(RULES, &format!("Using cached result: {put}")),
            Some(AccessRejection::Key)
        );
        let last = "abc on drone-1 is unauthorized to Declare Liveliness Subscriber (ingress) on x";
        assert_eq!(of(RULES, last), None);
        assert_eq!(of(RULES, put), Some(AccessRejection::Key));
        assert_eq!(
            of(RULES, "abc on drone-1 is authorized to Put (ingress) on x"),
            None
        );
        // Its link is counted.
        let unnamed =
            "abc did not match any configured ACL subject. Default permission `Deny` will be applied";
        assert_eq!(of(RULES, unnamed), None);
    }
}
