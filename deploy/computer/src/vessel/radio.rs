//! The vessel's radio: publishers and subscribers.

use alight_shared::admission::{Arrival, Sender};
use alight_shared::process::ProcessState;
use alight_shared::radio::{RadioEnd, RadioTopic};
use alight_shared::time::{Time, VesselClock};
use alight_shared::{topics, wire};
use alight_transport::Received;
use alight_transport::radio::RadioCounts;
use alight_usv::{ComputerIn, ComputerOut};
use serde::de::DeserializeOwned;

use crate::config::VesselComputerConfig;
use crate::exit::CliError;
use crate::process::radio_keys::{any_drone_status, any_operator_command, any_time_request, vessel_key};
use crate::process::radio_port::RadioPort;

/// One in so many reports of the process, which are two a second, is sent; while the link is congested, half of them.
const STATUS_DECIMATION: u32 = 2;

/// The vessel's end of the radio.
pub struct VesselRadio {
    port: RadioPort,
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
        let tls = &computer.radio.tls;
        Ok(VesselRadio {
            port: RadioPort::open(&computer.radio, RadioEnd::Vessel, |row| match row.from {
                RadioEnd::Vessel => vessel_key(computer.vessel_id, row.topic.name),
                RadioEnd::Operator => any_operator_command(),
                RadioEnd::Drone if row.topic.name == topics::TIME_REQUEST.name => any_time_request(),
                RadioEnd::Drone => any_drone_status(),
            })?,
            secured: !tls.authority.is_empty(),
            operators: tls.peers.iter().any(|p| p.starts_with("operator-")),
            reports: 0,
            undecoded: 0,
            undecoded_statuses: 0,
        })
    }
    /// Drones that have a session, by their tokens.
    pub fn drones_present(&self) -> u64 {
        self.port.radio.count_present(|s| matches!(s, Sender::Drone(_))) as u64
    }
    /// Counts of the radio.
    pub fn counts(&self) -> RadioCounts {
        self.port.radio.counts()
    }
    /// Whether the session can be trusted after the process stood still for `gap_s`.
    pub fn survives_pause(&self, gap_s: f64) -> bool {
        self.port.radio.survives_pause(gap_s)
    }
    /// Leaves the session as it is, for a process that ends now.
    pub fn abandon(&mut self) {
        self.port.radio.abandon();
    }

    /// Waits until something has come.
    pub async fn arrival(&self) {
        self.port.radio.arrival().await;
    }
    /// Adds what has come to `input`; `at` converts an arrival on the steady clock, ns.
    pub fn receive(&mut self, at: impl Fn(i64) -> Time<VesselClock>, input: &mut ComputerIn) {
        while let Some((topic, packet)) = self.port.receive() {
            let at = at(packet.at_ns);
            if topic == RadioTopic::TimeRequest {
                let request = decode(&packet, at, &mut self.undecoded);
                input.time_requests.extend(request);
            } else if topic == RadioTopic::Status {
                let status = decode(&packet, at, &mut self.undecoded_statuses);
                input.statuses.extend(status);
            } else if self.secured {
                input.commands.extend(decode(&packet, at, &mut self.undecoded));
            } else {
                self.undecoded += 1;
            }
        }
    }

    /// Publishes the output of a step.
    pub fn publish(&mut self, out: &ComputerOut) {
        out.broadcast(|topic, bytes, held| {
            if self.operators || topic.row().to != RadioEnd::Operator {
                self.port.put(topic, bytes, held);
            }
        });
    }
    /// The report of the process with the rates of the radio; sent less often than it is made, for people can wait, and
    /// still less often while only `rate_fraction` of the full rates is used.
    pub fn report(&mut self, report: ProcessState, rate_fraction: f64) -> ProcessState {
        let report = ProcessState {
            flows: self.port.flows(report.at_ns),
            ..report
        };
        self.reports += 1;
        let congested = u32::from(rate_fraction <= 0.5);
        if self.reports.is_multiple_of(STATUS_DECIMATION << congested) {
            self.port.send(RadioTopic::Process, [&report]);
        }
        report
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
