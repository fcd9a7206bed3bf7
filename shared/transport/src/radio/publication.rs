use std::sync::Arc;

use zenoh::{bytes::Encoding, qos::Priority};

use crate::radio::{HEADER_BYTES, held::NewestMessage};
use alight_shared::{radio::Urgency, topics::Topic};

pub(super) fn priority(urgency: Urgency) -> Priority {
    match urgency {
        Urgency::Order => Priority::RealTime,
        Urgency::State => Priority::InteractiveHigh,
        Urgency::Model => Priority::DataHigh,
        Urgency::Status => Priority::Background,
    }
}

#[derive(Clone, Debug)]
pub struct Publication {
    pub(super) key: String,
    pub(super) urgency: Urgency,
    /// Topic, which determines encoding and schema.
    pub(super) topic: Option<&'static Topic>,
    /// Header overhead of each message, bytes.
    pub(super) overhead: u64,
    pub(super) held: Option<Arc<NewestMessage>>,
}

impl Publication {
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
    /// Sets the topic, and with it the message version in the encoding and the schema for queries.
    pub fn of(self, topic: &'static Topic) -> Publication {
        Publication {
            topic: Some(topic),
            overhead: HEADER_BYTES + Topic::encoding_schema().len() as u64,
            ..self
        }
    }
    /// Answers queries with the last message passed to [`Radio::hold`](super::Radio::hold).
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
