//! Process of the vessel's estimator, deck arbiter and broadcast, from sensors to Zenoh.

use std::time::Duration;

use alight_shared::{
    admission::{AccessRejection, RejectionReason},
    bus::{Bus, Edge, RowStep, Writer as _},
    config,
    metrics::{Metric, MetricName, MetricValue},
    msg::{Header, MAX_SOURCES, VesselStatus},
    process::{ProcessKind, ProcessState},
    time::{Time, VesselClock, VesselTime},
};
use alight_transport::{
    clock::{ProcessClock, steady_ns},
    memory::Publisher,
    radio::RadioCounts,
    rejections::{self, AccessRejections},
    statistics::Quantiles,
};
use alight_usv::{
    ComputerIn, ComputerOut, KINDS, SourceCounts, VesselCheckpoint, VesselComputer, VesselNode,
    computer::{Installed as _, VesselPorts},
};
use tokio::time::sleep;
use tracing::{info, warn};

use crate::{
    config::VesselComputerConfig,
    exit::{CliError, Exit},
    io::{runtime, wakes::Wakes},
    process::{
        args::ProcessArgs,
        run::{AwaitedEdge, NodeView, Process, ProcessEdge},
    },
    vessel::{
        deck_file::DeckFile,
        deck_inputs::InputFiles,
        helm_lamp::HelmLamp,
        radio::VesselRadio,
        status::{CrewDeviceErrors, VesselStatusReport},
    },
};

/// Maximum time between wake-ups without sensor readings.
const MAX_WAIT: Duration = Duration::from_millis(10);
const SOURCE_SUMMARY_PERIOD_NS: i64 = 60_000_000_000;

pub fn run(args: &ProcessArgs) -> Result<Exit, CliError> {
    runtime::block_on_with_radio(estimate(args))
}

async fn estimate(args: &ProcessArgs) -> Result<Exit, CliError> {
    let computer: VesselComputerConfig = config::load(&args.config)?;
    let of = (Some(computer.instance.as_str()), computer.clock);
    let make = |boot| Ok(VesselComputer::installed(&computer.nodes(), boot));
    let process = Process::start(ProcessKind::Vessel, args, of, make)?;
    let mut edge = DeckEdge::open(&computer, &process)?;
    process.run_awaiting(&mut edge).await
}

/// The vessel's radio, and the crew's equipment on deck: file, inputs, lamp.
struct DeckEdge {
    radio: VesselRadio,
    deck_file: DeckFile,
    deck_inputs: InputFiles,
    helm_lamp: HelmLamp,
    checkpoint: Option<VesselCheckpoint>,
    clock: ProcessClock,
    waited_ns: i64,
    people: ForPeople,
    status: VesselStatusReport,
    statuses: Option<Publisher<VesselStatus>>,
    /// A status is due because the crew has given an order.
    ordered: bool,
    header: Header<VesselClock>,
}

impl DeckEdge {
    fn open(
        computer: &VesselComputerConfig,
        process: &Process<VesselComputer>,
    ) -> Result<DeckEdge, CliError> {
        let radio = VesselRadio::open(computer)?;
        let (deck_file, left) = DeckFile::open(computer)?;
        Ok(DeckEdge {
            radio,
            deck_file,
            deck_inputs: InputFiles::start(&computer.deck, steady_ns()),
            helm_lamp: HelmLamp::start(&computer.deck.helm_lamp),
            checkpoint: Some(left),
            clock: computer.clock,
            waited_ns: steady_ns(),
            people: ForPeople::new(!computer.sensor.sources.is_empty(), steady_ns()),
            status: VesselStatusReport::default(),
            statuses: process.memory.writer()?,
            ordered: false,
            header: Header::new(computer.vessel_id, 0, process.boot(), 0, Time::EPOCH),
        })
    }
}

impl Edge<VesselComputer> for DeckEdge {
    fn read(&mut self, input: &mut ComputerIn) {
        input.deck_inputs = self.deck_inputs.poll(steady_ns());
        input.checkpoint = self.checkpoint.take();
        let clock = self.clock;
        self.radio.receive(|at_ns| clock.read(at_ns), input);
    }
    fn write<B: Bus>(
        &mut self,
        _input: &ComputerIn,
        out: &mut ComputerOut,
        _ports: &mut VesselPorts<B>,
    ) -> bool {
        self.radio.publish(out);
        true
    }
}

impl ProcessEdge<VesselComputer> for DeckEdge {
    fn stepped(&mut self, sent: &NodeView<'_, VesselComputer>, step: &RowStep<VesselComputer>) {
        let node = sent.node;
        self.helm_lamp.set(step.out.lamp);
        self.people.show(&step.out, sent.now, node.node());
        self.deck_file.keep(node.checkpoint());
        self.status.observe(steady_ns(), &step.input, &step.out);
        self.ordered = !step.input.crew.is_empty();
    }
    fn metrics(&mut self, at: &NodeView<'_, VesselComputer>) -> Vec<Metric> {
        let missed = (at.inputs)().first().map_or(0, |sensors| sensors.missed);
        metrics(at.node, &self.radio, missed, &self.people, at.now)
    }
    fn unsent(&self) -> u64 {
        self.radio.counts().unsent + self.statuses.unsent()
    }
    fn reports(&mut self, at: &NodeView<'_, VesselComputer>, own: Option<ProcessState>) -> Vec<ProcessState> {
        let node = at.node;
        if own.is_some() || self.ordered {
            let errors = CrewDeviceErrors {
                file: self.deck_file.error(),
                inputs: self.deck_inputs.errors(),
                lamp: self.helm_lamp.error(),
            };
            self.header.at = at.now;
            let now = (self.header, steady_ns());
            let orders = node.orders_taken();
            let status = self.status.message(node, now, orders, &errors);
            self.statuses.send(&status);
        }
        let rate_fraction = node.node().rate_fraction();
        let own = own.map(|own| self.radio.report(own, rate_fraction));
        Vec::from_iter(own)
    }
}

impl AwaitedEdge<VesselComputer> for DeckEdge {
    async fn arrival(&mut self, wakes: &Wakes) -> Result<bool, CliError> {
        let gap_s = (steady_ns() - self.waited_ns) as f64 * 1e-9;
        self.waited_ns = steady_ns();
        if !self.radio.survives_pause(gap_s) {
            self.radio.abandon();
            return Err(stood_still(gap_s));
        }
        tokio::select! {
            woken = wakes.woken() => woken?,
            () = self.radio.arrival() => {}
            () = sleep(MAX_WAIT) => {}
        }
        Ok(true)
    }
}

fn stood_still(gap_s: f64) -> CliError {
    CliError(format!(
        "the vessel's process was suspended for {gap_s:.1} s, longer than its radio session lasts: \
         it ends so that its supervisor restarts it"
    ))
}

/// Log messages of the process, and its metrics in addition to the node's.
struct ForPeople {
    estimate_age_s: Quantiles,
    peers: AccessRejections,
    /// Time of the next summary of the sources, on the steady clock; None without sources.
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
    fn show(&mut self, out: &ComputerOut, now: VesselTime, node: &VesselNode) {
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
                    "{name} {source}: {} used, {} of them outliers, {} out of order, {} rejected, {} spare",
                    c.taken, c.outliers, c.out_of_order, c.rejected, c.spare
                );
            }
        }
    }
}

fn metrics(
    node: &VesselComputer,
    radio: &VesselRadio,
    readings_missed: u64,
    people: &ForPeople,
    now: VesselTime,
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
