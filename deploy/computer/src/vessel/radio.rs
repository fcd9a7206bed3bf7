//! The vessel's radio: publishers and subscribers.

use std::time::Duration;

use alight_shared::admission::{Arrival, Sender};
use alight_shared::process::ProcessState;
use alight_shared::time::{Time, VesselClock};
use alight_shared::topics::{self, Topic};
use alight_shared::wire;
use alight_transport::Received;
use alight_transport::radio::{Publication, Radio, RadioCounts, Subscription, Urgency};
use alight_usv::{ComputerIn, ComputerOut};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::config::VesselComputerConfig;
use crate::exit::CliError;
use crate::process::radio_keys::{any_drone_status, any_operator_command, any_time_request, vessel_key};
use crate::process::radio_rates::RadioRates;

/// Messages of the vessel, in this order.
const ESTIMATE: usize = 0;
const WAVE: usize = 1;
const PREDICTION: usize = 2;
const TIME_REPLY: usize = 3;
const STATE: usize = 4;
const DECK: usize = 5;
const OPERATOR: usize = 6;
const DRONES: usize = 7;
const SURROUNDINGS: usize = 8;
const RECEIPTS: usize = 9;
const RTCM: usize = 10;
/// The topics and how urgent they are.
const PUBLICATIONS: [(&Topic, Urgency); 11] = [
    (&topics::ESTIMATE, Urgency::State),
    (&topics::WAVE, Urgency::Model),
    (&topics::PREDICTION, Urgency::Model),
    (&topics::TIME_REPLY, Urgency::State),
    (&topics::VESSEL_PROCESS, Urgency::Status),
    (&topics::DECK, Urgency::State),
    (&topics::OPERATOR, Urgency::Order),
    (&topics::DRONES, Urgency::Status),
    (&topics::SURROUNDINGS, Urgency::State),
    (&topics::RECEIPTS, Urgency::State),
    (&topics::RTCM, Urgency::Model),
];
/// The subscriptions, in their order; the third is the status of drones.
const TIME_REQUESTS: usize = 0;
const COMMANDS: usize = 1;
/// One in so many reports of the process, which are two a second, is sent; while the link is congested, half of them.
const STATUS_DECIMATION: u32 = 2;

/// The vessel's end of the radio.
pub struct VesselRadio {
    radio: Radio,
    rates: RadioRates,
    /// Peers have certificates: without, any peer in reach could command.
    secured: bool,
    /// Operators are among them, and are sent the statuses of drones.
    operators: bool,
    reports: u32,
    /// Time requests and commands that cannot be decoded, or come where no command is permitted.
    pub undecoded: u64,
    /// Statuses of drones that cannot be decoded.
    pub undecoded_statuses: u64,
}

impl VesselRadio {
    /// Opens the radio of this computer.
    pub fn open(computer: &VesselComputerConfig) -> Result<VesselRadio, CliError> {
        let publications = PUBLICATIONS.map(|(topic, urgency)| {
            let key = vessel_key(computer.vessel_id, topic.name);
            let publication = Publication::new(key, urgency).of(topic);
            // What a drone that comes later lacks and is broadcast seldom.
            match [topics::WAVE.name, topics::SURROUNDINGS.name].contains(&topic.name) {
                true => publication.held(),
                false => publication,
            }
        });
        let subscriptions = vec![
            any_time_request().into(),
            Subscription::order(any_operator_command()),
            any_drone_status().into(),
        ];
        let tls = &computer.radio.tls;
        Ok(VesselRadio {
            radio: Radio::open(&computer.radio, publications.to_vec(), subscriptions)?,
            rates: RadioRates::of(&PUBLICATIONS.map(|(topic, _)| topic)),
            secured: !tls.authority.is_empty(),
            operators: tls.peers.iter().any(|p| p.starts_with("operator-")),
            reports: 0,
            undecoded: 0,
            undecoded_statuses: 0,
        })
    }
    /// Drones that have a session, by their tokens.
    pub fn drones_present(&self) -> u64 {
        self.radio.count_present(|s| matches!(s, Sender::Drone(_))) as u64
    }
    /// Counts of the radio.
    pub fn counts(&self) -> RadioCounts {
        self.radio.counts()
    }
    /// Whether the session can be trusted after the process stood still for `gap_s`.
    pub fn survives_pause(&self, gap_s: f64) -> bool {
        self.radio.survives_pause(gap_s)
    }
    /// Leaves the session as it is, for a process that ends now.
    pub fn abandon(&mut self) {
        self.radio.abandon();
    }

    /// Waits until something has come.
    pub async fn arrival(&self) {
        self.radio.arrival().await;
    }
    /// Adds what has come to `input`; `at` converts an arrival on the steady clock, ns.
    pub fn receive(&mut self, at: impl Fn(i64) -> Time<VesselClock>, input: &mut ComputerIn) {
        while let Some(packet) = self.radio.receive(Duration::ZERO) {
            let at = at(packet.at_ns);
            match packet.subscription {
                TIME_REQUESTS => {
                    let request = decode(&packet, at, &mut self.undecoded);
                    input.time_requests.extend(request);
                }
                COMMANDS if !self.secured => self.undecoded += 1,
                COMMANDS => input.commands.extend(decode(&packet, at, &mut self.undecoded)),
                _ => {
                    let status = decode(&packet, at, &mut self.undecoded_statuses);
                    input.statuses.extend(status);
                }
            }
        }
    }

    /// Publishes the output of a step.
    pub fn publish(&mut self, out: &ComputerOut) {
        let ComputerOut {
            vessel,
            grant,
            commands,
            receipts,
            statuses,
            rtcm,
            events: _,
            lamp: _,
        } = out;
        self.send(ESTIMATE, &vessel.estimate_update);
        self.send(TIME_REPLY, &vessel.time_replies);
        self.send(DECK, grant);
        self.send(OPERATOR, commands);
        // A joiner can use no wave model that continues another.
        self.hold(WAVE, vessel.wave_update.as_ref().filter(|m| m.is_whole()));
        self.send(WAVE, &vessel.wave_update);
        self.send(PREDICTION, &vessel.prediction);
        self.hold(SURROUNDINGS, vessel.surroundings.as_ref());
        self.send(SURROUNDINGS, &vessel.surroundings);
        self.send(RTCM, rtcm);
        if self.operators {
            self.send(DRONES, statuses);
            self.send(RECEIPTS, receipts);
        }
    }
    /// The report of the process with the rates of the radio; sent less often than it is made, for people can wait, and
    /// still less often while only `rate_fraction` of the full rates is used.
    pub fn report(&mut self, report: ProcessState, rate_fraction: f64) -> ProcessState {
        let report = ProcessState {
            flows: self.rates.since(&self.radio, report.at_ns),
            ..report
        };
        self.reports += 1;
        let congested = u32::from(rate_fraction <= 0.5);
        if self.reports.is_multiple_of(STATUS_DECIMATION << congested) {
            self.send(STATE, [&report]);
        }
        report
    }
    fn hold(&mut self, publication: usize, message: Option<&impl Serialize>) {
        if let Some(bytes) = message.and_then(|m| wire::encode(m).ok()) {
            self.radio.hold(publication, bytes);
        }
    }
    fn send<'a, M: Serialize + 'a>(&mut self, publication: usize, messages: impl IntoIterator<Item = &'a M>) {
        // A message that does not encode is a message that is not sent: the receiver sees the gap.
        for bytes in messages.into_iter().filter_map(|m| wire::encode(m).ok()) {
            self.radio.send(publication, bytes);
        }
    }
}

/// The message that arrived at `at`, or one more that is invalid.
fn decode<M: DeserializeOwned>(
    packet: &Received,
    at: Time<VesselClock>,
    undecoded: &mut u64,
) -> Option<Arrival<VesselClock, M>> {
    let message = wire::decode(&packet.bytes).ok();
    *undecoded += u64::from(message.is_none());
    Some(Arrival {
        at,
        sender: packet.sender,
        message: message?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::topics::Medium;

    /// A publication with a topic answers queries for its schema.
    #[test]
    fn senders_of_every_radio_topic() {
        let of_drones = [&topics::TIME_REQUEST, &topics::DRONE_STATUS];
        let sent = PUBLICATIONS.iter().map(|(topic, _)| *topic).chain(of_drones);
        let sent: Vec<&str> = sent.map(|t| t.name).collect();
        for topic in topics::ALL.iter().filter(|t| t.medium == Medium::Radio) {
            assert!(sent.contains(&topic.name), "{} is sent by none", topic.name);
        }
        assert!(sent.contains(&topics::VESSEL_PROCESS.name));
    }
}
