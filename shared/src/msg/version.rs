//! Version of the radio's messages.

use std::sync::LazyLock;

use crate::{
    schema,
    topics::{self, Medium},
    wire::hash_record,
};

/// Version of all radio messages, a hash of their names, fields, types and variants; a receiver rejects any other.
pub fn message_version() -> u16 {
    static VERSION: LazyLock<u16> = LazyLock::new(|| {
        let all = topics::ALL.iter().chain([&topics::VESSEL_PROCESS]);
        let sent = all.filter(|topic| topic.medium == Medium::Radio);
        let hashes: Vec<_> = sent
            .map(|topic| (topic.name, schema::hash(&(topic.schema)())))
            .collect();
        hash_record(&hashes).unwrap_or_default() as u16
    });
    *VERSION
}
