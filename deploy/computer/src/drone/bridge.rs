//! The drone's bridge as a process: zenoh in, shared memory out.

use std::time::Duration;

use alight_bridge::{Bridge, BridgeIn, Packet, PacketKind};
use alight_shared::admission::{Rejections, Sender};
use alight_shared::bus::{MAX_WAIT, Ports, Wired};
use alight_shared::metrics::{Metric, MetricName, Metrics};
use alight_shared::msg::Seq;
use alight_shared::process::{ProcessKind, ProcessState};
use alight_shared::time::Stamped;
use alight_shared::topics::{self, Topic};
use alight_shared::{config, wire};
use alight_transport::TransportError;
use alight_transport::clock::steady_ns;
use alight_transport::memory::{Instance, Memory, Publisher};
use alight_transport::radio::{Publication, Radio, Subscription, Urgency};
use alight_uav::computer::Installed as _;
use tokio::time::timeout;
use tracing::{info, warn};

use crate::config::DroneComputerConfig;
use crate::exit::{CliError, Exit};
use crate::io::runtime;
use crate::process::args::ProcessArgs;
use crate::process::life::Process;
use crate::process::radio_keys::{drone_key, vessel_key};
use crate::process::radio_rates::RadioRates;

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
    let vessel = computer.bridge.vessel_id;
    let mut process = Process::start(ProcessKind::Bridge, args, computer.clock, |boot| {
        Bridge::installed(&computer.nodes(), boot)
    })?;
    let memory = Memory::join(&Instance::new(&computer.instance)?, "bridge")?;
    let mut ports = <Bridge as Wired>::Ports::join(&memory)?;
    let mut state: Publisher<ProcessState> = memory.publisher()?;
    let mut second_sender = None;
    let mut age_s = f64::INFINITY;
    let (mut received_bytes, mut rejected) = (0_u64, 0_u64);

    let mut radio = open_radio(&computer)?;
    let mut flows = RadioRates::of(&[&topics::TIME_REQUEST, &topics::DRONE_STATUS]);
    let max_wait = Duration::from_nanos(MAX_WAIT.nanos().unsigned_abs());
    while !process.ended() {
        let _late = timeout(max_wait, radio.arrival()).await;
        let mut packets = Vec::new();
        let mut received = radio.receive(Duration::ZERO);
        while let Some(packet) = received {
            received_bytes += packet.bytes.len() as u64;
            match SUBSCRIPTIONS.get(packet.subscription) {
                Some((kind, _)) => {
                    let packet_in = Packet {
                        kind: *kind,
                        sender: packet.sender,
                        bytes: packet.bytes,
                    };
                    packets.push((packet.at_ns, packet_in));
                }
                None => rejected += u64::from(!show_vessel(&mut state, &packet.bytes)),
            }
            received = radio.receive(Duration::ZERO);
        }
        let read = ports.read(process.now().nanos());
        let now = process.now();
        let packets = packets
            .into_iter()
            .map(|(at_ns, packet)| Stamped::new(process.at(at_ns).min(now), packet))
            .collect();
        let input = BridgeIn { packets, ..read };
        let out = process.step(now, &input, |out| {
            ports.write(out);
            out.estimate.is_some()
        });
        // Before the clocks agree an answer could not be dated.
        if process.node().offset(now).is_some() {
            radio.ask();
        }
        age_s = out.link.map_or(age_s, |l| l.age_s);
        if let Some(link) = out.link.filter(|l| l.second_sender != second_sender) {
            second_sender = link.second_sender;
            log_second_sender(vessel, second_sender);
        }
        if let Some(Ok(bytes)) = out.time_request.as_ref().map(wire::encode) {
            radio.send(0, bytes);
        }
        if let Some(Ok(bytes)) = out.status.as_ref().map(wire::encode) {
            radio.send(1, bytes);
        }
        let counts = radio.counts();
        let sessions = radio.count_present(|s| *s == Sender::Vessel(vessel)) as u64;
        let own = [
            MetricName::BytesReceived.count(received_bytes),
            MetricName::PacketsDropped.count(counts.dropped),
            MetricName::SessionsReopened.count(counts.reopened),
            MetricName::VesselStatusRejected.count(rejected),
            MetricName::NewestAsked.count(counts.asked),
            MetricName::VesselSession.count(sessions),
        ];
        process.life.metrics = metrics(own, process.node().rejections());
        if let Some(report) = process.state(|| ports.states(now.nanos()), counts.unsent + ports.unsent()) {
            let flows = flows.since(&radio, report.at_ns);
            state.send(&ProcessState { flows, ..report });
            radio.watch(age_s);
        }
    }
    Ok(Exit::Success)
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

/// The bridge's own metrics, and why it rejected what.
fn metrics(own: impl IntoIterator<Item = Metric>, rejections: &Rejections) -> Metrics {
    let reasons = rejections
        .iter()
        .filter(|(_, n)| *n > 0)
        .map(|(reason, n)| MetricName::Rejected(reason).count(n));
    Seq::filled(own.into_iter().chain(reasons))
}

/// Passes the report of the vessel's process on to observers; false when it is no such report.
fn show_vessel(state: &mut Publisher<ProcessState>, bytes: &[u8]) -> bool {
    let Ok(report) = wire::decode::<ProcessState>(bytes) else {
        return false;
    };
    if report.kind != ProcessKind::Vessel {
        return false;
    }
    // Its times are the other computer's; their difference is the same here.
    let (at_ns, up_ns) = (steady_ns(), report.at_ns.saturating_sub(report.began_ns));
    let began_ns = at_ns.saturating_sub(up_ns);
    state.send(&ProcessState {
        at_ns,
        began_ns,
        ..report
    });
    true
}
