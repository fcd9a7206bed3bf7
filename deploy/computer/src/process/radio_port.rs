//! Endpoint of the radio, with its topics from the table ([`RadioTopic`]).

use std::{fmt::Display, time::Duration};

use alight_shared::{
    msg::Seq,
    process::{MAX_FLOWS, RadioFlow},
    radio::{RadioEnd, RadioRow, RadioTopic, Urgency},
};
use alight_transport::{
    Received, TransportError,
    radio::{Publication, Radio, RadioConfig, Subscription},
};

use crate::process::radio_rates::RadioRates;

/// Key of a topic of one computer, or of all of a kind with `$*` as their number.
pub fn key(kind: &str, number: impl Display, topic: &str) -> String {
    format!("alight/{kind}-{number}/{topic}")
}

pub struct RadioPort {
    pub radio: Radio,
    sent: Vec<RadioTopic>,
    read: Vec<RadioTopic>,
    rates: RadioRates,
}

impl RadioPort {
    /// Opens the endpoint `own`; `key` returns the key of each topic that it sends or reads.
    pub fn open(
        config: &RadioConfig,
        own: RadioEnd,
        key: impl Fn(RadioRow) -> String,
    ) -> Result<RadioPort, TransportError> {
        let of = |is_it: fn(RadioRow) -> RadioEnd| -> Vec<RadioTopic> {
            let all = RadioTopic::ALL.iter().copied();
            all.filter(|t| is_it(t.row()) == own).collect()
        };
        let sent = of(|row| row.from);
        let read = of(|row| row.to);
        let publication = |row: RadioRow| {
            let publication = Publication::new(key(row), row.urgency).of(row.topic);
            if row.held { publication.held() } else { publication }
        };
        let subscription = |row: RadioRow| {
            if row.urgency == Urgency::Order {
                Subscription::order(key(row))
            } else if row.held {
                Subscription::asked(key(row))
            } else {
                key(row).into()
            }
        };
        let topics: Vec<_> = sent.iter().map(|t| t.row().topic).collect();
        Ok(RadioPort {
            radio: Radio::open(
                config,
                sent.iter().map(|t| publication(t.row())).collect(),
                read.iter().map(|t| subscription(t.row())).collect(),
            )?,
            sent,
            read,
            rates: RadioRates::of(&topics),
        })
    }
    pub fn receive(&mut self) -> Option<(RadioTopic, Received)> {
        let received = self.radio.receive(Duration::ZERO)?;
        Some((*self.read.get(received.subscription)?, received))
    }
    /// Sends an encoded message; if `held`, it is kept for peers that join later.
    pub fn put(&mut self, topic: RadioTopic, bytes: Vec<u8>, held: bool) {
        if let Some(publication) = self.sent.iter().position(|t| *t == topic) {
            if held {
                self.radio.hold(publication, bytes.clone());
            }
            self.radio.send(publication, bytes);
        }
    }
    pub fn flows(&mut self, now_ns: i64) -> Seq<RadioFlow, MAX_FLOWS> {
        self.rates.since(&self.radio, now_ns)
    }
}
