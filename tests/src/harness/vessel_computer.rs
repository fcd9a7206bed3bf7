//! The vessel's computer in lock-step: the rows of [`VesselRows`] over a bus in lock-step, and the vessel's sensors at their edge.

use super::bus::{LockStep, LockStepSender};
use super::edge::edge;
use super::failing::{Failing, HeldReadings, VesselSensorFaults};
use super::physics::{DRONE_ID, TICK, VESSEL_ID};
use super::scenario::{NodeConfigs, Scenario};
use crate::sensors::delay::DelayLine;
use alight_shared::bus::Writer as _;
use alight_shared::msg::{CrewOrder, DeckOrder, Header, RtcmFrames};
use alight_shared::process::ProcessKind;
use alight_shared::step::Step;
use alight_shared::time::{Span, Time, TrueTime, VesselClock};
use alight_usv::computer::{PROCESSES, VesselNodes, VesselRows};
use alight_usv::deck::MAX_DRONES;
use alight_usv::sensors::{
    Measurement, Readings, SensorNode, SourceConfig, SourceMeasurement, SourcesConfig,
};
use alight_usv::{ComputerIn, ComputerOut, VesselCheckpoint, VesselComputer};

/// Readings that arrive late, at most: ticks of half a second and more.
const MAX_LATE: usize = 256;

/// Rows of the computer, and who gives it orders.
pub(super) struct VesselSide {
    bus: LockStep,
    rows: VesselRows<LockStep>,
    nodes: VesselNodes,
    boot: u32,
    orders: LockStepSender<CrewOrder>,
    ordered: u32,
    rtcm: LockStepSender<RtcmFrames<VesselClock>>,
    sensors: SensorEdge,
    /// It stands still: orders wait, what was measured is lost.
    stands_still: bool,
    /// Input that has waited meanwhile.
    waiting: ComputerIn,
}

/// The sensors between their quantities and their bytes, with what they do wrong.
struct SensorEdge {
    faults: VesselSensorFaults,
    /// Readings that stuck sensors repeat.
    held: HeldReadings,
    /// Readings that arrive late.
    late: DelayLine<Readings>,
}

impl SensorEdge {
    /// Readings that arrive at `t` of those measured then.
    fn arrived(&mut self, t: Time<TrueTime>, mut measured: Readings) -> Readings {
        self.faults.spoil(&mut measured, &mut self.held);
        if self.faults.late_s <= 0.0 && self.late.is_empty() {
            return measured;
        }
        self.late.push(t + Span::from_secs(self.faults.late_s), measured);
        let mut arrived = Readings::default();
        for r in self.late.arrived(t) {
            arrived.imu.extend(r.imu);
            arrived.gnss.extend(r.gnss);
            arrived.heading.extend(r.heading);
            arrived.attitude.extend(r.attitude);
        }
        arrived
    }
}

impl VesselSide {
    pub(super) fn new(scenario: &Scenario, nodes: &NodeConfigs, boot: u32) -> VesselSide {
        let bus = LockStep::default();
        let mut side = VesselSide {
            rows: VesselRows::default(),
            nodes: VesselNodes {
                id: VESSEL_ID,
                sensors: sources(scenario),
                vessel: nodes.vessel.clone(),
                deck: nodes.deck.clone(),
                drones: (DRONE_ID..).take(MAX_DRONES).collect(),
            },
            boot,
            orders: bus.sender(),
            ordered: 0,
            rtcm: bus.sender(),
            sensors: SensorEdge {
                faults: VesselSensorFaults::default(),
                held: HeldReadings::default(),
                late: DelayLine::new(MAX_LATE),
            },
            stands_still: false,
            waiting: ComputerIn::default(),
            bus,
        };
        PROCESSES.iter().for_each(|process| side.start(*process));
        side
    }
    fn start(&mut self, process: ProcessKind) {
        let Ok(()) = self.rows.start(process, &self.bus, (&self.nodes, self.boot));
    }
    /// Restarts the vessel's process; returns what it kept.
    pub(super) fn restart_vessel(&mut self) -> Option<VesselCheckpoint> {
        let kept = self.vessel().map(VesselComputer::checkpoint);
        self.boot += 1;
        self.start(ProcessKind::Vessel);
        kept
    }
    /// The second row's node; None: its process is dead.
    pub(super) fn vessel(&self) -> Option<&VesselComputer> {
        self.rows.vessel.as_ref().map(|row| &row.node)
    }
    /// The crew gives an order.
    pub(super) fn order(&mut self, now: Time<VesselClock>, order: DeckOrder) {
        self.ordered += 1;
        let header = Header::new(VESSEL_ID, 0, self.ordered, 0, now);
        self.orders.send(&CrewOrder { header, order });
    }
    /// Frames of its moving base arrive; lost where it stands still.
    pub(super) fn receive_rtcm(&mut self, frames: &[RtcmFrames<VesselClock>]) {
        if !self.stands_still {
            self.rtcm.send_each(frames);
        }
    }
    /// So much fails of it from now on.
    pub(super) fn fail(&mut self, failing: &Failing) {
        self.sensors.faults = failing.vessel;
        self.stands_still = failing.frozen.vessel;
    }
    /// One step of each row with what the sensors have measured, the second also with what it has `received`; shown to `look`.
    pub(super) fn tick(
        &mut self,
        (t, now): (Time<TrueTime>, Time<VesselClock>),
        measured: Readings,
        mut received: ComputerIn,
        mut look: impl FnMut(&Step<'_>),
    ) -> ComputerOut {
        let measured = self.sensors.arrived(t, measured);
        let waited = core::mem::take(&mut self.waiting);
        received.commands.splice(0..0, waited.commands);
        received.checkpoint = received.checkpoint.or(waited.checkpoint);
        if self.stands_still {
            self.waiting = ComputerIn {
                commands: received.commands,
                checkpoint: received.checkpoint,
                ..ComputerIn::default()
            };
            return ComputerOut::default();
        }
        if let Some(row) = &mut self.rows.sensors {
            let mut device = edge::<SensorNode>(|i| i.samples = vec![samples(&measured)], |_, _| {});
            let step = row.step(|| now, &mut device);
            look(&step.of(ProcessKind::Sensors, self.boot));
        }
        let Some(row) = &mut self.rows.vessel else {
            return ComputerOut::default();
        };
        let receive = |input: &mut ComputerIn| {
            *input = ComputerIn {
                sensors: core::mem::take(&mut input.sensors),
                crew: core::mem::take(&mut input.crew),
                rtcm: core::mem::take(&mut input.rtcm),
                ..core::mem::take(&mut received)
            };
        };
        let step = row.step(|| now, &mut edge::<VesselComputer>(receive, |_, _| {}));
        look(&step.of(ProcessKind::Vessel, self.boot));
        step.out
    }
}

/// The vessel's device, whose measurements arrive with the world's ticks: it has one clock, against which the kind that comes
/// soonest counts.
pub fn sources(scenario: &Scenario) -> SourcesConfig {
    let s = &scenario.sensors;
    let attitude_s = s.vessel_attitude.as_ref().map(|a| a.latency_s);
    let latencies_s = [
        s.vessel_imu.latency_s,
        s.vessel_gnss.latency_s,
        s.vessel_heading.latency_s,
    ];
    let min_s = latencies_s
        .into_iter()
        .chain(attitude_s)
        .fold(f64::INFINITY, f64::min);
    SourcesConfig {
        sources: vec![SourceConfig {
            latency_s: (min_s / TICK.secs() - 1e-6).ceil() * TICK.secs(),
            ..SourceConfig::default()
        }],
    }
}

/// Measurements that have arrived from the device, dated by its clock.
fn samples(measured: &Readings) -> Vec<SourceMeasurement> {
    fn of<M: Copy + Into<Measurement>>(all: &[M]) -> impl Iterator<Item = SourceMeasurement> {
        all.iter().map(|m| {
            let measurement: Measurement = (*m).into();
            SourceMeasurement::new(measurement.at().nanos(), measurement)
        })
    }
    of(&measured.imu)
        .chain(of(&measured.gnss))
        .chain(of(&measured.heading))
        .chain(of(&measured.attitude))
        .collect()
}
