//! Process of the drone's bridge, from Zenoh to shared memory.

use std::time::Duration;

use alight_bridge::{Bridge, BridgeIn, BridgeOut, BridgePorts, Packet};
use alight_shared::{
    admission::Sender,
    bus::{Bus, Edge, MAX_WAIT, Ports as _, RowStep},
    config,
    metrics::{Metric, MetricName},
    process::{ProcessKind, ProcessState},
    radio::{RadioEnd, RadioTopic},
    time::Stamped,
    wire,
};
use alight_transport::{
    TransportError,
    clock::{ProcessClock, steady_ns},
};
use alight_uav::computer::Installed as _;
use tokio::time::timeout;
use tracing::{info, warn};

use crate::{
    config::DroneComputerConfig,
    exit::{CliError, Exit},
    io::{runtime, wakes::Wakes},
    process::{
        args::ProcessArgs,
        radio_port::{RadioPort, key},
        run::{AwaitedEdge, NodeView, Process, ProcessEdge},
    },
};

/// Runs until stopped; sends the drone's status to the vessel at 2 Hz.
pub fn run(args: &ProcessArgs) -> Result<Exit, CliError> {
    runtime::block_on_with_radio(relay(args))
}

async fn relay(args: &ProcessArgs) -> Result<Exit, CliError> {
    let computer: DroneComputerConfig = config::load(&args.config)?;
    let of = (Some(computer.instance.as_str()), computer.clock);
    let make = |boot| Ok(Bridge::installed(&computer.nodes(), boot));
    let process = Process::start(ProcessKind::Bridge, args, of, make)?;
    process.run_awaiting(&mut RadioEdge::open(&computer)?).await
}

struct RadioEdge {
    port: RadioPort,
    clock: ProcessClock,
    vessel: u32,
    second_sender: Option<u32>,
    age_s: f64,
    received_bytes: u64,
    /// Process reports received from the vessel, to be republished for observers, and the number of invalid ones.
    shown: Vec<ProcessState>,
    rejected: u64,
}

impl RadioEdge {
    fn open(computer: &DroneComputerConfig) -> Result<RadioEdge, TransportError> {
        Ok(RadioEdge {
            port: open_radio(computer)?,
            clock: computer.clock,
            vessel: computer.bridge.vessel_id,
            second_sender: None,
            age_s: f64::INFINITY,
            received_bytes: 0,
            shown: Vec::new(),
            rejected: 0,
        })
    }
}

impl Edge<Bridge> for RadioEdge {
    fn read(&mut self, input: &mut BridgeIn) {
        while let Some((kind, packet)) = self.port.receive() {
            self.received_bytes += packet.bytes.len() as u64;
            if kind == RadioTopic::Process {
                let report = vessel_report(&packet.bytes);
                self.rejected += u64::from(report.is_none());
                self.shown.extend(report);
            } else {
                let at = self.clock.read(packet.at_ns);
                let sender = packet.sender;
                let bytes = packet.bytes;
                input
                    .packets
                    .push(Stamped::new(at, Packet { kind, sender, bytes }));
            }
        }
    }
    fn write<B: Bus>(&mut self, _input: &BridgeIn, out: &mut BridgeOut, ports: &mut BridgePorts<B>) -> bool {
        ports.write(out);
        out.estimate.is_some()
    }
}

impl ProcessEdge<Bridge> for RadioEdge {
    fn stepped(&mut self, at: &NodeView<'_, Bridge>, step: &RowStep<Bridge>) {
        let out = &step.out;
        // The time of a reply cannot be converted until the clocks are synchronised.
        if at.node.offset(step.at).is_some() {
            self.port.radio.ask();
        }
        self.age_s = out.link.map_or(self.age_s, |l| l.age_s);
        if let Some(link) = out.link.filter(|l| l.second_sender != self.second_sender) {
            self.second_sender = link.second_sender;
            log_second_sender(self.vessel, link.second_sender);
        }
        out.broadcast(|topic, bytes| self.port.put(topic, bytes, false));
    }
    fn metrics(&mut self, at: &NodeView<'_, Bridge>) -> Vec<Metric> {
        let radio = &self.port.radio;
        let counts = radio.counts();
        let vessel = Sender::Vessel(self.vessel);
        let mut metrics = vec![
            MetricName::BytesReceived.count(self.received_bytes),
            MetricName::PacketsDropped.count(counts.dropped),
            MetricName::SessionsReopened.count(counts.reopened),
            MetricName::VesselStatusRejected.count(self.rejected),
            MetricName::NewestAsked.count(counts.asked),
            MetricName::VesselSession.count(radio.count_present(|s| *s == vessel) as u64),
        ];
        let reasons = at.node.rejections().iter().filter(|(_, n)| *n > 0);
        metrics.extend(reasons.map(|(reason, n)| MetricName::Rejected(reason).count(n)));
        metrics
    }
    fn unsent(&self) -> u64 {
        self.port.radio.counts().unsent
    }
    fn reports(&mut self, _at: &NodeView<'_, Bridge>, own: Option<ProcessState>) -> Vec<ProcessState> {
        let mut reports = core::mem::take(&mut self.shown);
        if let Some(mut own) = own {
            own.flows = self.port.flows(own.at_ns);
            self.port.radio.watch(self.age_s);
            reports.push(own);
        }
        reports
    }
}

impl AwaitedEdge<Bridge> for RadioEdge {
    async fn arrival(&mut self, _wakes: &Wakes) -> Result<bool, CliError> {
        let max_wait = Duration::from_nanos(MAX_WAIT.nanos().unsigned_abs());
        let _late = timeout(max_wait, self.port.radio.arrival()).await;
        Ok(true)
    }
}

fn open_radio(computer: &DroneComputerConfig) -> Result<RadioPort, TransportError> {
    RadioPort::open(&computer.radio, RadioEnd::Drone, |row| match row.from {
        RadioEnd::Drone => key("drone", computer.bridge.drone_id, row.topic.name),
        RadioEnd::Vessel | RadioEnd::Operator => key("vessel", computer.bridge.vessel_id, row.topic.name),
    })
}

/// Logs when a second computer, with this boot id, starts or stops sending as the vessel.
fn log_second_sender(vessel: u32, second_sender: Option<u32>) {
    match second_sender {
        Some(boot) => warn!(
            "a second computer sends as vessel {vessel} with its certificate (boot {boot:08x}), and its messages \
             are ignored: switch one of the two off"
        ),
        None => info!("only one computer sends as vessel {vessel} again"),
    }
}

fn vessel_report(bytes: &[u8]) -> Option<ProcessState> {
    let report = wire::decode::<ProcessState>(bytes).ok()?;
    // Times in the report are on the vessel's clock; only their difference is kept.
    let (at_ns, up_ns) = (steady_ns(), report.at_ns.saturating_sub(report.began_ns));
    let began_ns = at_ns.saturating_sub(up_ns);
    (report.kind == ProcessKind::Vessel).then_some(ProcessState {
        at_ns,
        began_ns,
        ..report
    })
}
