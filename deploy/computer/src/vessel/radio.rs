use alight_shared::{
    admission::{Arrival, Sender},
    process::ProcessState,
    radio::{RadioEnd, RadioTopic},
    time::{VesselClock, VesselTime},
    topics, wire,
};
use alight_transport::{Received, radio::RadioCounts};
use alight_usv::{ComputerIn, ComputerOut};
use serde::de::DeserializeOwned;

use crate::{
    config::VesselComputerConfig,
    exit::CliError,
    process::{
        radio_keys::{any_drone_status, any_operator_command, any_time_request, vessel_key},
        radio_port::RadioPort,
    },
};

/// Number of the process's reports, made at 2 Hz, per report sent by radio; doubled while the link is congested.
const STATUS_DECIMATION: u32 = 2;

pub struct VesselRadio {
    port: RadioPort,
    /// Peers have certificates; without them, any peer within range could send commands.
    secured: bool,
    /// Some peers are operators, who receive the drones' statuses.
    operators: bool,
    reports: u32,
    /// Number of time requests and commands that cannot be decoded, or that arrive when no command is permitted.
    pub undecoded: u64,
    pub undecoded_statuses: u64,
}

impl VesselRadio {
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
    pub fn drones_present(&self) -> u64 {
        self.port.radio.count_present(|s| matches!(s, Sender::Drone(_))) as u64
    }
    pub fn counts(&self) -> RadioCounts {
        self.port.radio.counts()
    }
    /// Whether the session is still valid after the process was suspended for `gap_s`, s.
    pub fn survives_pause(&self, gap_s: f64) -> bool {
        self.port.radio.survives_pause(gap_s)
    }
    pub fn abandon(&mut self) {
        self.port.radio.abandon();
    }

    pub async fn arrival(&self) {
        self.port.radio.arrival().await;
    }
    /// Adds the received packets to `input`; `at` converts the arrival time on the steady clock, ns.
    pub fn receive(&mut self, at: impl Fn(i64) -> VesselTime, input: &mut ComputerIn) {
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

    pub fn publish(&mut self, out: &ComputerOut) {
        out.broadcast(|topic, bytes, held| {
            if self.operators || topic.row().to != RadioEnd::Operator {
                self.port.put(topic, bytes, held);
            }
        });
    }
    /// Adds the radio's rates to the report of the process and sends it. Users can wait, so only some reports are
    /// sent, and fewer while only `rate_fraction` of the full rates is used.
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

/// Decodes a message that arrived at `at`; counts an invalid one in `undecoded`.
fn decode<M: DeserializeOwned>(
    packet: &Received,
    at: VesselTime,
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
