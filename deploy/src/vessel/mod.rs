//! The vessel's computer as a process: sensors in, zenoh out.

pub mod deck_file;
pub mod deck_inputs;
pub mod helm_lamp;
pub mod radio;
pub mod sensor_supervisor;
pub mod sensors;
pub mod status_file;

use std::time::Duration;

use alight_shared::admission::RejectionReason;
use alight_shared::msg::{MAX_SOURCES, Seq};
use alight_shared::time::{Time, VesselClock};
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::metrics::{Metric, MetricName, MetricValue};
use alight_shared::transport::process::ProcessKind;
use alight_shared::transport::radio::RadioCounts;
use alight_shared::transport::readiness::watched;
use alight_shared::transport::rejections::{self, AccessRejections};
use alight_shared::transport::statistics::Quantiles;
use alight_usv::deck::DeckOrder;
use alight_usv::{ComputerIn, ComputerOut, KINDS, SourceCounts, VesselNode};
use tokio::io::Interest;
use tokio::time::sleep;
use tracing::{info, warn};

use crate::config::VesselComputer;
use crate::exit::{CliError, Doing, Exit};
use crate::io::runtime;
use crate::io::sensor_socket::SensorSocket;
use crate::process::args::{ProcessArgs, ViewArgs};
use crate::process::flight::Flight;
use crate::process::life::Process;
use crate::process::notify::Notify;
use crate::process::sealed::SealedConfig;
use crate::vessel::deck_file::DeckFile;
use crate::vessel::deck_inputs::InputFiles;
use crate::vessel::helm_lamp::HelmLamp;
use crate::vessel::radio::VesselRadio;
use crate::vessel::sensor_supervisor::SensorSupervisor;
use crate::vessel::status_file::{DeckStatus, StatusFile};

/// A process without sensor readings wakes this often.
const MAX_WAIT: Duration = Duration::from_millis(10);
/// With real sensors, time between two summaries of their measurements, ns.
const SOURCE_SUMMARY_PERIOD_NS: i64 = 60_000_000_000;

/// Runs until it is asked to end: receive, step, publish.
pub fn run(args: &ProcessArgs, view: &ViewArgs) -> Result<Exit, CliError> {
    runtime::block_on_with_radio(estimate(args, view))
}

async fn estimate(args: &ProcessArgs, view: &ViewArgs) -> Result<Exit, CliError> {
    let (computer, mut sealed) = SealedConfig::begin::<VesselComputer>(&args.config)?;
    let name = format!("vessel-{}", computer.vessel_id);
    let mut flight = Flight::begin(&computer.recorder, args, &name, steady_ns());
    let args = &ProcessArgs {
        flight: args.flight.clone().or(flight.as_ref().map(Flight::path)),
        ..args.clone()
    };
    let mut process = Process::start(ProcessKind::Vessel, args, computer.clock, |boot| {
        computer.node(boot)
    })?;
    let listening = || format!("listening for sensors on {}", computer.sensors);
    let mut sensors = SensorSocket::listen(&computer.sensors).doing(listening())?;
    let descriptor = sensors.descriptor().and_then(|d| watched(d, Interest::READABLE));
    let descriptor = descriptor.doing(listening())?;
    let mut radio = VesselRadio::open(&computer)?;
    let (mut deck_file, left) = DeckFile::open(&computer);
    let mut deck_inputs = InputFiles::start(&computer.deck, steady_ns());
    let mut helm_lamp = HelmLamp::start(&computer.deck.helm_lamp);
    let mut status_file = StatusFile::new(&computer);
    let mut people = ForPeople::new(!computer.sensor.sources.is_empty(), steady_ns());
    // The last to start: an error before it leaves no process behind.
    let mut sensor_supervisor = SensorSupervisor::start(&computer, args, view, sealed.path(), steady_ns())?;
    let mut notify = Notify::default();
    notify.ready();

    let (mut checkpoint, mut deck_order) = (Some(left), None::<DeckOrder>);
    let mut last_ns = steady_ns();
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
        tokio::select! {
            ready = descriptor.readable() => ready.doing("waiting for sensors")?.clear_ready(),
            () = radio.arrival() => {}
            () = sleep(MAX_WAIT) => {}
        }
        let mut input = ComputerIn {
            vessel: sensors.read(Duration::ZERO).input(),
            deck_orders: deck_order.take().into_iter().collect(),
            deck_inputs: deck_inputs.poll(steady_ns()),
            checkpoint: checkpoint.take(),
            ..ComputerIn::default()
        };
        radio.receive(|at_ns| process.at(at_ns), &mut input);
        // Read after the packets: a step is never earlier than what it consumes.
        let now = process.now();
        let out = process.step(now, &input, |out| {
            radio.publish(out);
            true
        });
        helm_lamp.set(out.wants_steady);
        people.show(&out, process.now(), process.node().node());
        deck_file.keep(process.node().checkpoint());
        status_file.observe(steady_ns(), &input, &out);
        for line in sensor_supervisor.poll(steady_ns()) {
            warn!("{line}");
        }

        let counts = radio.counts();
        let (node, rejected) = (process.node(), sensors.rejected());
        process.life.metrics = Seq::filled(metrics(node, &radio, rejected, &people, now));
        if let Some(report) = process.state(Vec::new, counts.unsent) {
            let report = radio.report(report, process.node().node().rate_fraction());
            deck_order = deck_file.order();
            sealed.poll(steady_ns());
            status_file.edited = sealed.edited();
            let deck = DeckStatus {
                file_error: deck_file.error(),
                input_errors: deck_inputs.errors(),
                lamp_error: helm_lamp.error(),
                ..DeckStatus::of(now, process.node())
            };
            let node = (process.node(), now);
            status_file.write(&computer, node, &report, deck, &people.peers, &sensor_supervisor);
        }
        if let Some(flight) = &mut flight {
            sum_up(flight, process.node(), &out);
        }
        notify.alive(steady_ns(), || {
            let received = process.node().drones().received();
            format!(
                "{} messages sent, {received} drone statuses received",
                counts.sent
            )
        });
    }
    notify.stopping();
    // Its recorder has written its end before the flight has one.
    drop(process);
    if let Some(flight) = flight {
        flight.end(steady_ns());
    }
    sealed.end();
    Ok(Exit::Success)
}

/// What the vessel knows of this flight: the drones' states, and the waves.
fn sum_up(flight: &mut Flight, node: &alight_usv::VesselComputer, out: &ComputerOut) {
    let now_ns = steady_ns();
    for status in node.drones().statuses() {
        let s = &status.message;
        flight
            .log()
            .state(now_ns, Some(s.header.drone), s.state, s.entered, s.waiting);
    }
    if let Some(wave) = &out.vessel.wave {
        flight
            .log()
            .set("wave_height_m", f64::from(wave.significant_height_m));
    }
    flight.poll(now_ns);
}

/// What the process shows people in its journal, and what it measures beside its node.
struct ForPeople {
    /// Since the measurement of an estimate when that was published, s.
    estimate_age_s: Quantiles,
    peers: AccessRejections,
    /// When the sources are summed up next, on the steady clock; None without any.
    summary_ns: Option<i64>,
}

impl ForPeople {
    fn new(sources: bool, now_ns: i64) -> ForPeople {
        ForPeople {
            estimate_age_s: Quantiles::default(),
            peers: AccessRejections::default(),
            summary_ns: sources.then_some(now_ns + SOURCE_SUMMARY_PERIOD_NS),
        }
    }
    /// Shows what a step that was published at `now` brought about.
    fn show(&mut self, out: &ComputerOut, now: Time<VesselClock>, node: &VesselNode) {
        for event in &out.events {
            if event.is_warning() {
                warn!("{event}");
            } else {
                info!("{event}");
            }
        }
        if let Some(estimate) = &out.vessel.estimate {
            self.estimate_age_s.add((now - estimate.header.at).secs());
        }
        let before = std::mem::replace(&mut self.peers, rejections::counted());
        if let Some(why) = self.peers.last.filter(|_| self.peers.last != before.last) {
            warn!(
                "rejected at the radio: {} ({} so far)",
                why.name(),
                self.peers.count
            );
        }
        if self.summary_ns.is_some_and(|at| steady_ns() >= at) {
            self.summary_ns = Some(steady_ns() + SOURCE_SUMMARY_PERIOD_NS);
            show_sources(node);
        }
    }
}

fn show_sources(node: &VesselNode) {
    for (kind, name) in KINDS.iter().enumerate() {
        for source in 0..MAX_SOURCES {
            let c = node.source(kind, source);
            if c != SourceCounts::default() {
                info!(
                    "{name} {source}: {} used, {} of them gated, {} out of order, {} rejected, {} spare",
                    c.taken, c.gated, c.out_of_order, c.rejected, c.spare
                );
            }
        }
    }
}

/// The metrics of the process at `now`.
fn metrics(
    node: &alight_usv::VesselComputer,
    radio: &VesselRadio,
    datagrams_rejected: u64,
    people: &ForPeople,
    now: Time<VesselClock>,
) -> Vec<Metric> {
    let RadioCounts {
        sent_bytes, dropped, ..
    } = radio.counts();
    let rejected = node.node().rejected();
    let requests = [
        RejectionReason::Version,
        RejectionReason::Vessel,
        RejectionReason::Flood,
    ]
    .map(|reason| u64::from(rejected.of(reason)));
    let requests =
        radio.undecoded + u64::from(node.relay().rejected().total()) + requests.iter().sum::<u64>();
    let drones = node.drones();
    let age_s = |q| people.estimate_age_s.quantile(q);
    let mut metrics = vec![
        MetricName::SensorDatagramsRejected.count(datagrams_rejected),
        MetricName::BytesSent.count(sent_bytes),
        MetricName::PacketsDropped.count(dropped),
        MetricName::TimeRequestsRejected.count(requests),
        MetricName::RateFraction.fraction(node.node().rate_fraction()),
        MetricName::PeersRejected.count(people.peers.count),
        MetricName::LastPeerRejection.with(MetricValue::AccessRejection(people.peers.last)),
        MetricName::MeasurementToEstimateP50.seconds(age_s(0.5)),
        MetricName::MeasurementToEstimateP99.seconds(age_s(0.99)),
        MetricName::Rejected(RejectionReason::Sender).count(node.on_other_keys()),
        MetricName::DroneMessages.count(drones.received()),
        MetricName::DroneMessagesRejected.count(drones.rejected() + radio.undecoded_statuses),
    ];
    if let Some(newest) = drones.newest() {
        let status = &newest.message;
        metrics.extend([
            MetricName::DroneMessageAge.seconds((now - newest.at).secs()),
            MetricName::DroneState.with(MetricValue::State(Some(status.state))),
            MetricName::DroneDescents.count(status.attempts),
        ]);
        metrics.extend(status.battery.map(|b| MetricName::DroneBattery.fraction(b)));
    }
    metrics
}
