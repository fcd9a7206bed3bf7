//! What is published on the radio: a key, its urgency, what it carries.

use std::sync::Arc;

use zenoh::bytes::Encoding;
use zenoh::qos::Priority;

use crate::radio::HEADER_BYTES;
use crate::radio::held::NewestMessage;
use alight_shared::radio::Urgency;
use alight_shared::topics::Topic;

/// Zenoh's priority of messages.
pub(super) fn priority(urgency: Urgency) -> Priority {
    match urgency {
        Urgency::Order => Priority::RealTime,
        Urgency::State => Priority::InteractiveHigh,
        Urgency::Model => Priority::DataHigh,
        Urgency::Status => Priority::Background,
    }
}

/// A key to publish on.
#[derive(Clone, Debug)]
pub struct Publication {
    /// The key expression.
    pub(super) key: String,
    pub(super) urgency: Urgency,
    /// What is published on it, by which its encoding and schema are known.
    pub(super) topic: Option<&'static Topic>,
    /// Bytes that each message has in addition to its payload.
    pub(super) overhead: u64,
    /// A message is kept for who asks for it.
    pub(super) held: Option<Arc<NewestMessage>>,
}

impl Publication {
    /// Of this key and urgency.
    pub fn new(key: impl Into<String>, urgency: Urgency) -> Publication {
        let key = key.into();
        Publication {
            key,
            urgency,
            topic: None,
            overhead: HEADER_BYTES,
            held: None,
        }
    }
    /// With the messages of this topic: their encoding names the version, and their schema can be asked for.
    pub fn of(self, topic: &'static Topic) -> Publication {
        Publication {
            topic: Some(topic),
            overhead: HEADER_BYTES + Topic::encoding_schema().len() as u64,
            ..self
        }
    }
    /// The message that [`Radio::hold`](super::Radio::hold) was given last answers who asks on its key.
    pub fn held(self) -> Publication {
        let held = Some(Arc::default());
        Publication { held, ..self }
    }
    pub(super) fn encoding(&self) -> Encoding {
        let schema = self.topic.map(|_| Topic::encoding_schema());
        schema.map_or_else(Encoding::default, |s| {
            Encoding::APPLICATION_OCTET_STREAM.with_schema(s)
        })
    }
}
