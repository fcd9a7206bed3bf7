//! The vessel's estimator, deck arbiter and broadcast as a process: sensors in, zenoh out.

use std::time::Duration;

use alight_shared::admission::AccessRejection;
use alight_shared::admission::RejectionReason;
use alight_shared::bus::{Ports as _, Wired};
use alight_shared::config;
use alight_shared::metrics::{Metric, MetricName, MetricValue};
use alight_shared::msg::{Header, MAX_SOURCES, Seq, VesselStatus};
use alight_shared::process::{ProcessKind, ProcessState};
use alight_shared::time::{Time, VesselClock};
use alight_transport::clock::steady_ns;
use alight_transport::memory::{Instance, Memory, Publisher};
use alight_transport::radio::RadioCounts;
use alight_transport::rejections::{self, AccessRejections};
use alight_transport::statistics::Quantiles;
use alight_usv::{ComputerIn, ComputerOut, KINDS, SourceCounts, VesselNode};
use tokio::time::sleep;
use tracing::{info, warn};

use crate::config::VesselComputerConfig;
use crate::exit::{CliError, Exit};
use crate::io::runtime;
use crate::io::wakes::Wakes;
use crate::process::args::ProcessArgs;
use crate::process::life::Process;
use crate::vessel::deck_file::DeckFile;
use crate::vessel::deck_inputs::InputFiles;
use crate::vessel::helm_lamp::HelmLamp;
use crate::vessel::radio::VesselRadio;
use crate::vessel::status::{CrewDeviceErrors, VesselStatusReport};

/// A process without sensor readings wakes this often.
const MAX_WAIT: Duration = Duration::from_millis(10);
/// With real sensors, time between two summaries of their measurements, ns.
const SOURCE_SUMMARY_PERIOD_NS: i64 = 60_000_000_000;

/// Runs until it is asked to end: receive, step, publish.
pub fn run(args: &ProcessArgs) -> Result<Exit, CliError> {
    runtime::block_on_with_radio(estimate(args))
}

async fn estimate(args: &ProcessArgs) -> Result<Exit, CliError> {
    let computer: VesselComputerConfig = config::load(&args.config)?;
    let mut process = Process::start(ProcessKind::Vessel, args, computer.clock, |boot| {
        computer.node(boot)
    })?;
    let memory = Memory::join(&Instance::new(&computer.instance)?, ProcessKind::Vessel.name())?;
    let mut ports = <alight_usv::VesselComputer as Wired>::Ports::join(&memory)?;
    let mut states: Publisher<ProcessState> = memory.publisher()?;
    let mut statuses: Publisher<VesselStatus> = memory.publisher()?;
    let wakes = Wakes::of::<alight_usv::VesselComputer>(&memory)?;
    let mut radio = VesselRadio::open(&computer)?;
    let (mut deck_file, left) = DeckFile::open(&computer)?;
    let mut deck_inputs = InputFiles::start(&computer.deck, steady_ns());
    let mut helm_lamp = HelmLamp::start(&computer.deck.helm_lamp);
    let mut status = VesselStatusReport::default();
    let mut people = ForPeople::new(!computer.sensor.sources.is_empty(), steady_ns());

    let mut checkpoint = Some(left);
    let mut last_ns = steady_ns();
    while !process.ended() {
        let gap_s = (steady_ns() - last_ns) as f64 * 1e-9;
        last_ns = steady_ns();
        if !radio.survives_pause(gap_s) {
            radio.abandon();
            return Err(stood_still(gap_s));
        }
        arrival(&wakes, &radio).await?;
        let mut input = ComputerIn {
            deck_inputs: deck_inputs.poll(steady_ns()),
            checkpoint: checkpoint.take(),
            ..ports.read(process.now().nanos())
        };
        radio.receive(|at_ns| process.at(at_ns), &mut input);
        // Read after the packets: a step is never earlier than what it consumes.
        let now = process.now();
        let out = process.step(now, &input, |out| {
            radio.publish(out);
            true
        });
        helm_lamp.set(out.lamp);
        people.show(&out, process.now(), process.node().node());
        deck_file.keep(process.node().checkpoint());
        status.observe(steady_ns(), &input, &out);

        let inputs = ports.states(now.nanos());
        let missed = inputs.first().map_or(0, |sensors| sensors.missed);
        process.life.metrics = Seq::filled(metrics(process.node(), &radio, missed, &people, now));
        let unsent = radio.counts().unsent + states.unsent() + statuses.unsent();
        let report = process.state(|| inputs, unsent);
        if report.is_some() || !input.crew.is_empty() {
            let errors = CrewDeviceErrors {
                file: deck_file.error(),
                inputs: deck_inputs.errors(),
                lamp: helm_lamp.error(),
            };
            let header = Header::new(computer.vessel_id, 0, process.life.boot(), 0, now);
            let message = status.message(
                process.node(),
                (header, steady_ns()),
                process.node().orders_taken(),
                &errors,
            );
            statuses.send(&message);
        }
        if let Some(report) = report {
            let report = radio.report(report, process.node().node().rate_fraction());
            states.send(&report);
        }
    }
    Ok(Exit::Success)
}

fn stood_still(gap_s: f64) -> CliError {
    CliError(format!(
        "the vessel's process stood still for {gap_s:.1} s, longer than its radio session lasts: \
         it ends so that its supervisor starts it again"
    ))
}

/// Waits for measurements or packets, or for its time.
async fn arrival(wakes: &Wakes, radio: &VesselRadio) -> Result<(), CliError> {
    tokio::select! {
        woken = wakes.woken() => woken,
        () = radio.arrival() => Ok(()),
        () = sleep(MAX_WAIT) => Ok(()),
    }
}

/// Report of the process for its journal, and its metrics in addition to those of its node.
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
    readings_missed: u64,
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
        MetricName::SensorReadingsMissed.count(readings_missed),
        MetricName::BytesSent.count(sent_bytes),
        MetricName::PacketsDropped.count(dropped),
        MetricName::TimeRequestsRejected.count(requests),
        MetricName::DroneSessions.count(radio.drones_present()),
        MetricName::RateFraction.fraction(node.node().rate_fraction()),
        MetricName::PeersRejected.count(people.peers.count),
        MetricName::LastPeerRejection.with(MetricValue::AccessRejection(people.peers.last)),
        MetricName::MeasurementToEstimateP50.seconds(age_s(0.5)),
        MetricName::MeasurementToEstimateP99.seconds(age_s(0.99)),
        MetricName::Rejected(RejectionReason::Sender).count(node.on_other_keys()),
        MetricName::DroneMessages.count(drones.received()),
        MetricName::DroneMessagesRejected.count(drones.rejected() + radio.undecoded_statuses),
    ];
    let rtcm = Some(node.rtcm().dropped()).filter(|n| *n > 0);
    metrics.extend(rtcm.map(|n| MetricName::RtcmDropped.count(n)));
    let for_reason = |r: AccessRejection| MetricName::PeersRejectedFor(r).count(people.peers.of(r));
    let rejected = AccessRejection::ALL
        .into_iter()
        .filter(|r| people.peers.of(*r) > 0);
    metrics.extend(rejected.map(for_reason));
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
