//! The vessel's computer in lock-step: the rows of [`VesselRows`] with the vessel's sensors at their edge.

use core::mem::swap;
use std::collections::VecDeque;

use super::{
    bus::{LockStep, LockStepSender},
    edge::edge,
    failing::{Failing, HeldReadings, VesselSensorFaults, shift},
    physics::{DRONE_ID, TICK, VESSEL_ID},
    scenario::{NodeConfigs, Scenario},
};
use crate::sensors::{
    bytes::{
        Carries,
        boat::{Boat, DEVICES, in_ticks_s},
    },
    clocks::ClockModel,
    delay::DelayLine,
};
use alight_shared::{
    bus::Writer as _,
    msg::{CrewOrder, DeckOrder, Header, MAX_SOURCES},
    process::ProcessKind,
    step::Step,
    time::{Span, VesselTime, WorldTime},
};
use alight_usv::{
    ComputerIn, ComputerOut, KINDS, VesselCheckpoint, VesselComputer,
    computer::{PROCESSES, VesselNodes, VesselRows},
    deck::MAX_DRONES,
    sensors::{Measurement, Readings, SensorNode, SensorsIn, SourceConfig, SourceMeasurement, SourcesConfig},
};

/// Ticks over which rejected measurements are compared with used ones, as in the vessel's status: 10 s.
const LATELY: usize = 1000;
const QUANTITIES: &str = "quantities";
/// Maximum number of delayed readings: 10 s of ticks, the longest delay of a full line.
const MAX_LATE: usize = 1000;
/// Rate at which the backlog of a line that was full is read, s/s.
const DRAINS: f64 = 0.5;

pub(super) struct VesselSide {
    bus: LockStep,
    rows: VesselRows<LockStep>,
    nodes: VesselNodes,
    boot: u32,
    orders: LockStepSender<CrewOrder>,
    ordered: u32,
    sensors: SensorEdge,
    /// The computer is frozen: orders wait, measurements are lost.
    stands_still: bool,
    /// Input that waits until a freeze ends.
    waiting: ComputerIn,
    /// Numbers of used and rejected measurements of each kind at the last ticks.
    rejected: VecDeque<[[u64; 2]; KINDS.len()]>,
}

/// Measurements of one tick: quantities, and bytes from a moving base.
pub(super) type Measured = (Readings, Vec<u8>);

struct SensorEdge {
    faults: VesselSensorFaults,
    held: HeldReadings,
    late: DelayLine<Readings>,
    /// Delay on a full line, and lead that the compass's clock has gained, s.
    filled_s: f64,
    gained_s: f64,
    /// Devices that send bytes; None: all devices give quantities.
    boat: Option<Boat>,
    given_by: usize,
}

impl SensorEdge {
    /// Delays readings measured at `t`, and returns those that arrive at `t`.
    fn arrived(&mut self, t: WorldTime, mut measured: Readings) -> Readings {
        self.faults.spoil(&mut measured, &mut self.held);
        let dt = TICK.secs();
        self.gained_s += self.faults.compass_clock_rate * dt;
        let [imu, gnss, compass] = self.faults.ahead_s;
        let ahead_s = [imu, gnss, compass + self.gained_s, 0.0];
        shift(&mut measured, ahead_s.map(Span::from_secs));
        let fills = if self.faults.line_fills > 0.0 {
            self.faults.line_fills
        } else {
            -DRAINS
        };
        self.filled_s = (self.filled_s + fills * dt).max(0.0);
        let late_s = self.faults.late_s + self.filled_s;
        if late_s <= 0.0 && self.late.is_empty() {
            return measured;
        }
        self.late.push(t + Span::from_secs(late_s), measured);
        let mut arrived = Readings::default();
        for r in self.late.arrived(t) {
            arrived.imu.extend(r.imu);
            arrived.gnss.extend(r.gnss);
            arrived.heading.extend(r.heading);
            arrived.attitude.extend(r.attitude);
        }
        arrived
    }
    /// `ahead` is the lead of the vessel's steady clock.
    fn input(&mut self, (mut readings, rtcm): Measured, ahead: Span) -> SensorsIn {
        let bytes = self.boat.as_mut().map(|boat| boat.bytes(&readings, &rtcm));
        shift(&mut readings, [ahead; 4]);
        // The last source is that of the quantities and sends no bytes.
        let bytes = bytes.unwrap_or_else(|| vec![rtcm]);
        let mut samples = vec![Vec::new(); self.given_by];
        samples.push(quantities(&readings, self.boat.is_none()));
        SensorsIn { bytes, samples }
    }
}

impl VesselSide {
    pub(super) fn new(scenario: &Scenario, nodes: &NodeConfigs, clock: ClockModel, boot: u32) -> VesselSide {
        let bus = LockStep::default();
        let sensors = sources(scenario, nodes);
        let with_bytes = |s: &&SourceConfig| s.name != QUANTITIES;
        let given_by = sensors.sources.iter().filter(with_bytes).count();
        let boat = devices(
            scenario,
            sensors.sources.get(..given_by).unwrap_or_default(),
            clock,
        );
        let mut side = VesselSide {
            rows: VesselRows::default(),
            nodes: VesselNodes {
                id: VESSEL_ID,
                sensors,
                vessel: nodes.vessel.clone(),
                deck: nodes.deck.clone(),
                drones: (DRONE_ID..).take(MAX_DRONES).collect(),
            },
            boot,
            orders: bus.sender(),
            ordered: 0,
            sensors: SensorEdge {
                faults: VesselSensorFaults::default(),
                held: HeldReadings::default(),
                late: DelayLine::new(MAX_LATE),
                filled_s: 0.0,
                gained_s: 0.0,
                boat,
                given_by,
            },
            stands_still: false,
            waiting: ComputerIn::default(),
            rejected: VecDeque::new(),
            bus,
        };
        for process in PROCESSES {
            side.start(*process);
        }
        side
    }
    fn start(&mut self, process: ProcessKind) {
        let Ok(()) = self.rows.start(process, &self.bus, (&self.nodes, self.boot));
    }
    /// Restarts the process and returns its checkpoint.
    pub(super) fn restart_vessel(&mut self) -> Option<VesselCheckpoint> {
        self.rejected.clear();
        let kept = self.vessel().map(VesselComputer::checkpoint);
        self.boot += 1;
        self.start(ProcessKind::Vessel);
        kept
    }
    /// Node of the second row; None if its process is dead.
    pub(super) fn vessel(&self) -> Option<&VesselComputer> {
        self.rows.vessel.as_ref().map(|row| &row.node)
    }
    /// Whether a finding on a device of the vessel asks for action: by its bytes, or by its rejected measurements.
    pub(super) fn is_doubted(&self) -> bool {
        let asks = |node: &SensorNode| node.remarks().iter().flatten().any(|r| r.remedy.is_some());
        let now = self.rejections();
        let before = self.rejected.front().copied().unwrap_or(now);
        let rejects = |(now, before): (&[u64; 2], &[u64; 2])| now[1] - before[1] > now[0] - before[0];
        self.rows.sensors.as_ref().is_some_and(|row| asks(&row.node)) || now.iter().zip(&before).any(rejects)
    }
    /// Numbers of used and of rejected measurements of each kind since the start of the process.
    fn rejections(&self) -> [[u64; 2]; KINDS.len()] {
        let mut all = [[0; 2]; KINDS.len()];
        for (kind, [used, rejected]) in all.iter_mut().enumerate() {
            for source in 0..MAX_SOURCES {
                let counts = self
                    .vessel()
                    .map(|v| v.node().source(kind, source))
                    .unwrap_or_default();
                *used += counts.taken.saturating_sub(counts.outliers);
                *rejected += counts.rejected + counts.outliers + counts.stuck;
            }
        }
        all
    }
    pub(super) fn order(&mut self, now: VesselTime, order: DeckOrder) {
        self.ordered += 1;
        let header = Header::new(VESSEL_ID, 0, self.ordered, 0, now);
        self.orders.send(&CrewOrder { header, order });
    }
    pub(super) fn fail(&mut self, failing: &Failing) {
        self.sensors.faults = failing.vessel;
        self.stands_still = failing.frozen.vessel;
    }
    /// Steps each row with the devices' measurements, and the second row also with the `received` messages;
    /// shows the steps to `look`. `ahead` is the lead of the steady clock over its simulated clock model.
    pub(super) fn tick(
        &mut self,
        (t, now, ahead): (WorldTime, VesselTime, Span),
        (measured, rtcm): Measured,
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
            let mut input = self.sensors.input((measured, rtcm), ahead);
            let mut device = edge::<SensorNode>(|i| swap(i, &mut input), |_, _| {});
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
        let out = core::mem::take(&mut row.last.out);
        self.rejected.push_back(self.rejections());
        if self.rejected.len() > LATELY {
            self.rejected.pop_front();
        }
        out
    }
}

/// Sources of the scene's vessel, as an installer configures them. The last source gives the quantities of
/// devices that send no bytes: an attitude sensor, or all devices of a scene without a geographic position.
/// The latency of that source is the shortest of these devices.
pub fn sources(scenario: &Scenario, nodes: &NodeConfigs) -> SourcesConfig {
    let s = &scenario.sensors;
    let mut sources = s.sources(nodes.vessel.deck.centre_m);
    let given: Vec<_> = if scenario.place.among.is_empty() {
        sources.drain(..DEVICES).collect()
    } else {
        Vec::new()
    };
    let attitude_s = s.vessel_attitude.as_ref().map(|a| in_ticks_s(a.latency_s));
    let soonest_s = given
        .iter()
        .map(|d| d.latency_s)
        .chain(attitude_s)
        .reduce(f64::min);
    sources.extend(soonest_s.map(|latency_s| SourceConfig {
        name: QUANTITIES.into(),
        latency_s,
        ..SourceConfig::default()
    }));
    SourcesConfig { sources }.placed(&nodes.vessel.imu, &nodes.vessel.gnss)
}

/// One device per source; None in a scene without a geographic position.
fn devices(scenario: &Scenario, sources: &[SourceConfig], clock: ClockModel) -> Option<Boat> {
    let carries = Carries::assign(sources).filter(|_| !scenario.place.among.is_empty())?;
    Some(Boat::new(sources, carries, &scenario.sensors, clock))
}

/// Quantities that have arrived, stamped by the devices' clock: from `all` devices, or from the attitude sensor only.
fn quantities(measured: &Readings, all: bool) -> Vec<SourceMeasurement> {
    fn of<M: Copy + Into<Measurement>>(all: &[M]) -> impl Iterator<Item = SourceMeasurement> {
        all.iter().map(|m| {
            let measurement: Measurement = (*m).into();
            SourceMeasurement::new(measurement.at().nanos(), measurement)
        })
    }
    let attitudes = of(&measured.attitude);
    if !all {
        return attitudes.collect();
    }
    of(&measured.imu)
        .chain(of(&measured.gnss))
        .chain(of(&measured.heading))
        .chain(attitudes)
        .collect()
}
