//! The vessel's node as a process: sensors in, zenoh out.

pub mod deck_file;
pub mod deck_inputs;
pub mod drone_monitor;
pub mod sensor_supervisor;
pub mod sensors;
pub mod status_file;

use std::time::Duration;

use alight_shared::admission::RejectionReason;
use alight_shared::msg::{DroneStatus, MAX_SOURCES, Seq, TimeRequest};
use alight_shared::time::{DroneClock, Stamped};
use alight_shared::topics::{self, Topic};
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::metrics::{MetricName, MetricValue};
use alight_shared::transport::process::{ProcessKind, ProcessState};
use alight_shared::transport::radio::{Publication, Radio, Urgency};
use alight_shared::transport::rejections::{self, AccessRejections};
use alight_shared::transport::statistics::Quantiles;
use alight_shared::{config, wire};
use alight_usv::deck::{ArbiterIn, ArbiterOut, DeckArbiter, OperatorIn, OperatorRelay};
use alight_usv::{KINDS, SourceCounts, VesselIn, VesselNode};
use serde::Serialize;
use tracing::{info, warn};

use crate::config::VesselComputer;
use crate::exit::{CliError, Doing, Exit};
use crate::io::sensor_socket::SensorSocket;
use crate::process::args::ProcessArgs;
use crate::process::life::{LoggedNode, Process};
use crate::process::notify::Notify;
use crate::process::radio_keys::{
    STATUS, any_drone_status, any_operator_command, any_time_request, vessel_key,
};
use crate::process::radio_rates::RadioRates;
use crate::vessel::deck_file::{DeckFile, Kept};
use crate::vessel::deck_inputs::InputFiles;
use crate::vessel::drone_monitor::DroneMonitor;
use crate::vessel::sensor_supervisor::SensorSupervisor;
use crate::vessel::status_file::{DeckStatus, StatusFile};

/// A process without sensor readings wakes this often.
const MAX_WAIT: Duration = Duration::from_millis(10);
/// What the vessel publishes, in this order.
const ESTIMATE: usize = 0;
const WAVE: usize = 1;
const PREDICTION: usize = 2;
const TIME_REPLY: usize = 3;
const STATE: usize = 4;
const DECK: usize = 5;
const OPERATOR: usize = 6;
const DRONES: usize = 7;
const SURROUNDINGS: usize = 8;
/// While the link is congested, one in so many reports of the process is sent.
const STATUS_DECIMATION: u32 = 4;
/// With real sensors, time between two summaries of their measurements, ns.
const SOURCE_SUMMARY_PERIOD_NS: i64 = 60_000_000_000;
/// Their topics and how urgent they are; None is the report of the process.
const OUTLETS: [(Option<&Topic>, Urgency); 9] = [
    (Some(&topics::ESTIMATE), Urgency::State),
    (Some(&topics::WAVE), Urgency::Model),
    (Some(&topics::PREDICTION), Urgency::Model),
    (Some(&topics::TIME_REPLY), Urgency::State),
    (None, Urgency::Status),
    (Some(&topics::DECK), Urgency::State),
    (Some(&topics::OPERATOR), Urgency::State),
    (Some(&topics::DRONES), Urgency::Status),
    (Some(&topics::SURROUNDINGS), Urgency::State),
];

/// Names of the logs of the vessel's other nodes.
pub const DECK_ARBITER: &str = "deck-arbiter";
pub const OPERATOR_RELAY: &str = "operator-relay";

/// The subscriptions, in their order; the third is the status of drones.
const TIME_REQUESTS: usize = 0;
const COMMANDS: usize = 1;

/// Runs until it is asked to end.
pub fn run(args: &ProcessArgs) -> Result<Exit, CliError> {
    let computer: VesselComputer = config::load(&args.config)?;
    let id = computer.vessel_id;
    let mut process = Process::start(ProcessKind::Vessel, args, computer.clock, |boot| {
        VesselNode::new(&computer.vessel, id, boot)
    })?;
    let mut sensors = SensorSocket::listen(&computer.sensors)
        .doing(format_args!("listening for sensors on {}", computer.sensors))?;
    let publications = OUTLETS
        .map(|(topic, urgency)| Publication::new(vessel_key(id, topic.map_or(STATUS, |t| t.name)), urgency))
        .to_vec();
    let mut radio = Radio::open(
        &computer.radio,
        publications,
        vec![any_time_request(), any_operator_command(), any_drone_status()],
    )?;
    let mut said_after = Quantiles::default();
    let mut drone = DroneMonitor::new(id);
    let secured = !computer.radio.tls.authority.is_empty();
    let operators = computer
        .radio
        .tls
        .peers
        .iter()
        .any(|p| p.starts_with("operator-"));
    let boot = process.life.boot();
    let relay = OperatorRelay::new(id, boot);
    let mut operator_relay = LoggedNode::new(OPERATOR_RELAY, args, boot, relay)?;
    let arbiter = DeckArbiter::new(&computer.deck, id, boot);
    let mut arbiter = LoggedNode::new(DECK_ARBITER, args, boot, arbiter)?;
    let (mut deck_file, left) = DeckFile::open(&computer);
    let (mut deck_checkpoint, mut aborts, mut void) = (Some(left.deck), left.aborts, left.void);
    let mut deck_inputs = InputFiles::start(&computer.deck, steady_ns());
    let mut orders = Vec::new();
    let mut doubles = Vec::new();
    let mut undecoded = 0_u64;
    let mut status_file = StatusFile::new(&computer);

    // The last to start: an error before it leaves no process behind.
    let mut sensor_supervisor = SensorSupervisor::start(&computer, args, steady_ns())?;
    let mut notify = Notify::default();
    notify.ready();
    let mut flows = RadioRates::of(&OUTLETS.map(|(topic, _)| topic));
    let mut own_statuses = 0_u32;
    let mut reported = AccessRejections::default();
    let mut last_ns = steady_ns();
    let mut next_count_ns = last_ns + SOURCE_SUMMARY_PERIOD_NS;
    while !process.ended() {
        let gap_s = (steady_ns() - last_ns) as f64 * 1e-9;
        last_ns = steady_ns();
        if !radio.survives_pause(gap_s) {
            radio.abandon();
            return Err(CliError(format!(
                "the vessel's process stood still for {gap_s:.1} s, longer than its radio session lasts: \
                 it ends so that its supervisor starts it anew"
            )));
        }
        let readings = sensors.read(MAX_WAIT);
        let mut commands = Vec::new();
        let mut time_requests: Vec<(i64, TimeRequest<DroneClock>)> = Vec::new();
        let mut statuses: Vec<(i64, DroneStatus)> = Vec::new();
        while let Some(packet) = radio.receive(Duration::ZERO) {
            match packet.subscription {
                TIME_REQUESTS => match wire::decode(&packet.bytes) {
                    Ok(request) => time_requests.push((packet.at_ns, request)),
                    Err(_) => undecoded += 1,
                },
                // Without certificates any peer in reach could command.
                COMMANDS if !secured => undecoded += 1,
                COMMANDS => match wire::decode(&packet.bytes) {
                    Ok(command) => commands.push(command),
                    Err(_) => undecoded += 1,
                },
                _ => match wire::decode(&packet.bytes) {
                    Ok(status) => statuses.push((packet.at_ns, status)),
                    Err(_) => drone.reject(),
                },
            }
        }
        for (at_ns, status) in &statuses {
            if let Some(line) = drone.receive(*at_ns, status) {
                info!("{line}");
            }
        }
        status_file.observe_drones(&computer, &statuses);
        let now = process.now();
        let former_owner = arbiter.node().owner();
        let drone_statuses: Vec<DroneStatus> = statuses.iter().map(|(_, status)| *status).collect();
        let input = ArbiterIn {
            statuses: drone_statuses.clone(),
            orders: std::mem::take(&mut orders),
            inputs: deck_inputs.poll(steady_ns()),
            checkpoint: deck_checkpoint.take(),
        };
        let ArbiterOut { grant } = arbiter.step(now, &input);
        publish(&mut radio, DECK, grant.as_ref());
        status_file.observe_grant(grant.as_ref());
        let input = OperatorIn {
            commands,
            statuses: drone_statuses,
            aborts: std::mem::take(&mut aborts),
            void: std::mem::take(&mut void),
        };
        let relayed = operator_relay.step(now, &input);
        for command in &relayed.accepted {
            info!(
                "an operator commands drone {}: {:?}",
                command.header.drone, command.kind
            );
        }
        for command in &relayed.commands {
            publish(&mut radio, OPERATOR, Some(command));
        }
        for (_, status) in statuses.iter().filter(|_| operators) {
            publish(&mut radio, DRONES, Some(status));
        }
        deck_file.keep(Kept {
            deck: arbiter.node().checkpoint(),
            aborts: operator_relay.node().aborts(),
            void: operator_relay.node().void(),
        });
        let now_double: Vec<_> = arbiter.node().doubles().collect();
        for (id, [one, other]) in now_double.iter().filter(|d| !doubles.contains(*d)) {
            warn!(
                "two drones have the number {id} (boot ids {one:08x} and {other:08x}): neither is given the deck; \
                 change bridge.drone_id of one of them"
            );
        }
        doubles = now_double;
        if arbiter.node().owner() != former_owner {
            match arbiter.node().owner() {
                Some(id) => info!("the deck is reserved for drone {id}"),
                None => info!("the deck is free"),
            }
        }
        let time_requests = time_requests
            .into_iter()
            .map(|(at_ns, request)| Stamped::new(process.at(at_ns).min(now), request))
            .collect();
        let input = VesselIn {
            time_requests,
            landing: arbiter.node().landing(now),
            ..readings.input()
        };
        let out = process.step(now, &input, |_| true);
        status_file.observe_step(steady_ns(), &input, &out);
        publish(&mut radio, ESTIMATE, out.estimate.as_ref());
        if let Some(estimate) = &out.estimate {
            said_after.add((process.now() - estimate.header.at).secs());
        }
        publish(&mut radio, WAVE, out.wave.as_ref());
        publish(&mut radio, PREDICTION, out.prediction.as_ref());
        publish(&mut radio, SURROUNDINGS, out.surroundings.as_ref());
        for reply in &out.time_replies {
            publish(&mut radio, TIME_REPLY, Some(reply));
        }
        let counts = radio.counts();
        let node = process.node().rejected();
        let requests: u32 = [
            RejectionReason::Version,
            RejectionReason::Vessel,
            RejectionReason::Flood,
        ]
        .map(|reason| node.of(reason))
        .iter()
        .sum();
        let peers = rejections::counted();
        if peers.last != reported.last {
            let why = peers.last.map_or("nobody", |r| r.name());
            warn!("rejected at the radio: {why} ({} so far)", peers.count);
            reported = peers;
        }
        let own = [
            MetricName::SensorDatagramsRejected.count(sensors.rejected()),
            MetricName::BytesSent.count(counts.sent_bytes),
            MetricName::PacketsDropped.count(counts.dropped),
            MetricName::TimeRequestsRejected
                .count(undecoded + operator_relay.node().rejected() + u64::from(requests)),
            MetricName::RateFraction.fraction(process.node().rate_fraction()),
            MetricName::PeersRejected.count(peers.count),
            MetricName::LastPeerRejection.with(MetricValue::AccessRejection(peers.last)),
            MetricName::MeasurementToEstimateP50.seconds(said_after.quantile(0.5)),
            MetricName::MeasurementToEstimateP99.seconds(said_after.quantile(0.99)),
        ];
        process.life.metrics = Seq::filled(own.into_iter().chain(drone.metrics(steady_ns())));
        let said = process.state(Vec::new, counts.unsent).map(|said| ProcessState {
            flows: flows.since(&radio, said.at_ns),
            ..said
        });
        for line in sensor_supervisor.poll(steady_ns()) {
            warn!("{line}");
        }
        if let Some(said) = &said {
            arbiter.flush();
            operator_relay.flush();
            if let Some(order) = deck_file.order() {
                info!("the crew says of the deck: {order:?}");
                orders.push(order);
            }
            status_file.write(
                &computer,
                process.node(),
                said,
                DeckStatus {
                    file_error: deck_file.error(),
                    input_errors: deck_inputs.errors(),
                    ..DeckStatus::of(now, arbiter.node(), operator_relay.node())
                },
                &reported,
                &sensor_supervisor,
            );
        }
        notify.alive(steady_ns(), || {
            format!(
                "{} messages sent, {} drone statuses received",
                counts.sent,
                drone.received()
            )
        });
        if !computer.sensor.sources.is_empty() && steady_ns() >= next_count_ns {
            next_count_ns = steady_ns() + SOURCE_SUMMARY_PERIOD_NS;
            for (kind, name) in KINDS.iter().enumerate() {
                for source in 0..MAX_SOURCES {
                    let c = process.node().source(kind, source);
                    if c != SourceCounts::default() {
                        info!(
                            "{name} {source}: {} used, {} of them gated, {} out of order, {} rejected, {} spare",
                            c.taken, c.gated, c.out_of_order, c.rejected, c.spare
                        );
                    }
                }
            }
        }
        // For people, who can wait: over a congested link less often.
        own_statuses += u32::from(said.is_some());
        let due = process.node().rate_fraction() > 0.5 || own_statuses.is_multiple_of(STATUS_DECIMATION);
        publish(&mut radio, STATE, said.as_ref().filter(|_| due));
    }
    notify.stopping();
    Ok(Exit::Success)
}

fn publish<M: Serialize>(radio: &mut Radio, publication: usize, message: Option<&M>) {
    // A message that does not encode is a message that is not sent: the receiver sees the gap.
    if let Some(Ok(bytes)) = message.map(wire::encode) {
        radio.send(publication, bytes);
    }
}
