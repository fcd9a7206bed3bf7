//! The drone's bridge as a process: zenoh in, shared memory out.

use std::time::Duration;

use alight_bridge::{Bridge, BridgeIn, BridgeOut, BridgePorts, Packet, PacketKind};
use alight_shared::admission::Sender;
use alight_shared::bus::{Bus, Edge, MAX_WAIT, Ports as _, RowStep};
use alight_shared::metrics::{Metric, MetricName};
use alight_shared::process::{ProcessKind, ProcessState};
use alight_shared::time::Stamped;
use alight_shared::topics::{self, Topic};
use alight_shared::{config, wire};
use alight_transport::TransportError;
use alight_transport::clock::{ProcessClock, steady_ns};
use alight_transport::radio::{Publication, Radio, Subscription, Urgency};
use alight_uav::computer::Installed as _;
use tokio::time::timeout;
use tracing::{info, warn};

use crate::config::DroneComputerConfig;
use crate::exit::{CliError, Exit};
use crate::io::runtime;
use crate::io::wakes::Wakes;
use crate::process::args::ProcessArgs;
use crate::process::radio_keys::{drone_key, vessel_key};
use crate::process::radio_rates::RadioRates;
use crate::process::run::{AwaitedEdge, Look, Process, ProcessEdge};

/// Messages of each subscription; the one after them is the report of the vessel's process.
const SUBSCRIPTIONS: [(PacketKind, &Topic); 8] = [
    (PacketKind::Estimate, &topics::ESTIMATE),
    (PacketKind::Wave, &topics::WAVE),
    (PacketKind::Prediction, &topics::PREDICTION),
    (PacketKind::TimeReply, &topics::TIME_REPLY),
    (PacketKind::Deck, &topics::DECK),
    (PacketKind::Surroundings, &topics::SURROUNDINGS),
    (PacketKind::Rtcm, &topics::RTCM),
    (PacketKind::Command, &topics::OPERATOR),
];
/// A query to the vessel once it is there, for messages that come seldom.
const ASKED: [PacketKind; 2] = [PacketKind::Wave, PacketKind::Surroundings];

/// Runs until it is asked to end. Twice a second it sends the drone's status to the vessel.
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

/// The drone's end of the radio.
struct RadioEdge {
    radio: Radio,
    flows: RadioRates,
    clock: ProcessClock,
    vessel: u32,
    second_sender: Option<u32>,
    age_s: f64,
    received_bytes: u64,
    /// Reports of the vessel's process that came, and how many were none.
    shown: Vec<ProcessState>,
    rejected: u64,
}

impl RadioEdge {
    fn open(computer: &DroneComputerConfig) -> Result<RadioEdge, TransportError> {
        Ok(RadioEdge {
            radio: open_radio(computer)?,
            flows: RadioRates::of(&[&topics::TIME_REQUEST, &topics::DRONE_STATUS]),
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
        while let Some(packet) = self.radio.receive(Duration::ZERO) {
            self.received_bytes += packet.bytes.len() as u64;
            if let Some((kind, _)) = SUBSCRIPTIONS.get(packet.subscription) {
                let at = self.clock.read(packet.at_ns);
                let (sender, bytes, kind) = (packet.sender, packet.bytes, *kind);
                input
                    .packets
                    .push(Stamped::new(at, Packet { kind, sender, bytes }));
            } else {
                let report = vessel_report(&packet.bytes);
                self.rejected += u64::from(report.is_none());
                self.shown.extend(report);
            }
        }
    }
    fn write<B: Bus>(&mut self, _input: &BridgeIn, out: &mut BridgeOut, ports: &mut BridgePorts<B>) -> bool {
        ports.write(out);
        out.estimate.is_some()
    }
}

impl ProcessEdge<Bridge> for RadioEdge {
    fn stepped(&mut self, at: &Look<'_, Bridge>, step: &RowStep<Bridge>) {
        let (radio, out) = (&mut self.radio, &step.out);
        // Before the clocks agree an answer could not be dated.
        if at.node.offset(step.at).is_some() {
            radio.ask();
        }
        self.age_s = out.link.map_or(self.age_s, |l| l.age_s);
        if let Some(link) = out.link.filter(|l| l.second_sender != self.second_sender) {
            self.second_sender = link.second_sender;
            log_second_sender(self.vessel, link.second_sender);
        }
        if let Some(Ok(bytes)) = out.time_request.as_ref().map(wire::encode) {
            radio.send(0, bytes);
        }
        if let Some(Ok(bytes)) = out.status.as_ref().map(wire::encode) {
            radio.send(1, bytes);
        }
    }
    /// With why the node rejected what.
    fn metrics(&mut self, at: &Look<'_, Bridge>) -> Vec<Metric> {
        let counts = self.radio.counts();
        let vessel = Sender::Vessel(self.vessel);
        let mut metrics = vec![
            MetricName::BytesReceived.count(self.received_bytes),
            MetricName::PacketsDropped.count(counts.dropped),
            MetricName::SessionsReopened.count(counts.reopened),
            MetricName::VesselStatusRejected.count(self.rejected),
            MetricName::NewestAsked.count(counts.asked),
            MetricName::VesselSession.count(self.radio.count_present(|s| *s == vessel) as u64),
        ];
        let reasons = at.node.rejections().iter().filter(|(_, n)| *n > 0);
        metrics.extend(reasons.map(|(reason, n)| MetricName::Rejected(reason).count(n)));
        metrics
    }
    fn unsent(&self) -> u64 {
        self.radio.counts().unsent
    }
    fn reports(&mut self, _at: &Look<'_, Bridge>, own: Option<ProcessState>) -> Vec<ProcessState> {
        let mut reports = core::mem::take(&mut self.shown);
        if let Some(mut own) = own {
            own.flows = self.flows.since(&self.radio, own.at_ns);
            self.radio.watch(self.age_s);
            reports.push(own);
        }
        reports
    }
}

impl AwaitedEdge<Bridge> for RadioEdge {
    async fn arrival(&mut self, _wakes: &Wakes) -> Result<bool, CliError> {
        let max_wait = Duration::from_nanos(MAX_WAIT.nanos().unsigned_abs());
        let _late = timeout(max_wait, self.radio.arrival()).await;
        Ok(true)
    }
}

/// Opens the radio: the drone's publications, and the vessel's topics in the order of [`SUBSCRIPTIONS`].
fn open_radio(computer: &DroneComputerConfig) -> Result<Radio, TransportError> {
    let (vessel, own) = (computer.bridge.vessel_id, computer.bridge.drone_id.to_string());
    let publication =
        |topic: &'static Topic, urgency| Publication::new(drone_key(&own, topic.name), urgency).of(topic);
    let publications = vec![
        publication(&topics::TIME_REQUEST, Urgency::State),
        publication(&topics::DRONE_STATUS, Urgency::Status),
    ];
    let subscription = |(kind, topic): &(PacketKind, &Topic)| {
        let key = vessel_key(vessel, topic.name);
        if *kind == PacketKind::Command {
            Subscription::order(key)
        } else if ASKED.contains(kind) {
            Subscription::asked(key)
        } else {
            key.into()
        }
    };
    let mut keys: Vec<Subscription> = SUBSCRIPTIONS.iter().map(subscription).collect();
    keys.push(vessel_key(vessel, topics::VESSEL_PROCESS.name).into());
    Radio::open(&computer.radio, publications, keys)
}

/// Logs that a second computer speaks as the vessel, by its boot, or no longer does.
fn log_second_sender(vessel: u32, second_sender: Option<u32>) {
    match second_sender {
        Some(boot) => warn!(
            "a second computer speaks as vessel {vessel} with her certificate (boot {boot:08x}), and nothing of it \
             is used: switch one of the two off"
        ),
        None => info!("one computer speaks as vessel {vessel} again"),
    }
}

/// The report of the vessel's process, for observers; None where it is no such report.
fn vessel_report(bytes: &[u8]) -> Option<ProcessState> {
    let report = wire::decode::<ProcessState>(bytes).ok()?;
    // Its times are the other computer's; their difference is the same here.
    let (at_ns, up_ns) = (steady_ns(), report.at_ns.saturating_sub(report.began_ns));
    let began_ns = at_ns.saturating_sub(up_ns);
    (report.kind == ProcessKind::Vessel).then_some(ProcessState {
        at_ns,
        began_ns,
        ..report
    })
}
