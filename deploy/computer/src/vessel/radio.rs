use alight_shared::{
    admission::{Arrival, Sender},
    process::ProcessState,
    radio::{RadioEnd, RadioTopic},
    time::VesselTime,
};
use alight_transport::radio::RadioCounts;
use alight_usv::{ComputerIn, ComputerOut};

use crate::{
    config::VesselComputerConfig,
    exit::CliError,
    process::radio_port::{RadioPort, key},
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
                RadioEnd::Vessel => key("vessel", computer.vessel_id, row.topic.name),
                RadioEnd::Operator => key("operator", "$*", row.topic.name),
                RadioEnd::Drone => key("drone", "$*", row.topic.name),
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
            let arrival = Arrival {
                at: at(packet.at_ns),
                sender: packet.sender,
                message: packet.bytes,
            };
            let permitted = self.secured || topic.row().from != RadioEnd::Operator;
            if permitted && input.receive(topic, &arrival).is_ok() {
                continue;
            }
            if topic == RadioTopic::Status {
                self.undecoded_statuses += 1;
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
            RadioTopic::Process.encode_each([&report], |topic, bytes| self.port.put(topic, bytes, false));
        }
        report
    }
}
