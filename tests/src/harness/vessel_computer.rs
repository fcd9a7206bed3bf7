//! The vessel's computer in lock-step: the rows of [`VesselRows`] over a bus in lock-step, and the vessel's sensors at their edge.

use super::bus::{LockStep, Sender};
use super::physics::{TICK, VESSEL_ID};
use super::scenario::{NodeConfigs, Scenario};
use alight_shared::bus::{Row, Writer as _};
use alight_shared::msg::{CrewOrder, DeckOrder, Header};
use alight_shared::time::{Time, VesselClock};
use alight_usv::computer::VesselRows;
use alight_usv::sensors::{
    Measurement, Readings, SensorNode, SourceConfig, SourceMeasurement, SourcesConfig,
};
use alight_usv::{ComputerIn, ComputerOut, VesselCheckpoint, VesselComputer};

/// Its rows, and who gives it orders.
pub(super) struct VesselSide {
    bus: LockStep,
    rows: VesselRows<LockStep>,
    boot: u32,
    orders: Sender<CrewOrder>,
    ordered: u32,
}

impl VesselSide {
    pub(super) fn new(scenario: &Scenario, nodes: &NodeConfigs, boot: u32) -> VesselSide {
        let bus = LockStep::default();
        let sensors = SensorNode::new(&sources(scenario), VESSEL_ID, boot);
        let Ok(sensors) = Row::join(&bus, sensors);
        let mut side = VesselSide {
            rows: VesselRows {
                sensors: Some(sensors),
                vessel: None,
            },
            boot,
            orders: bus.sender(),
            ordered: 0,
            bus,
        };
        side.start_vessel(nodes);
        side
    }
    fn start_vessel(&mut self, nodes: &NodeConfigs) {
        let node = VesselComputer::new(&nodes.vessel, &nodes.deck, VESSEL_ID, self.boot);
        let Ok(row) = Row::join(&self.bus, node);
        self.rows.vessel = Some(row);
    }
    /// The vessel's process starts anew; what it kept.
    pub(super) fn restart_vessel(&mut self, nodes: &NodeConfigs) -> Option<VesselCheckpoint> {
        let kept = self.vessel().map(VesselComputer::checkpoint);
        self.boot += 1;
        self.start_vessel(nodes);
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
    /// One step of each row with what the sensors have measured, the second with what `edge` has beside; shown to `look`.
    pub(super) fn tick(
        &mut self,
        now: Time<VesselClock>,
        measured: &Readings,
        edge: ComputerIn,
        look: impl FnOnce(&ComputerIn, &ComputerOut),
    ) -> ComputerOut {
        if let Some(row) = &mut self.rows.sensors {
            row.step(now, |input| input.samples = vec![samples(measured)], |_, _| {});
        }
        let Some(row) = &mut self.rows.vessel else {
            return ComputerOut::default();
        };
        let beside = |input: &mut ComputerIn| {
            let (sensors, crew) = (
                core::mem::take(&mut input.sensors),
                core::mem::take(&mut input.crew),
            );
            *input = ComputerIn {
                sensors,
                crew,
                ..edge
            };
        };
        row.step(now, beside, |input, out| look(input, out))
    }
}

/// The vessel's device, whose measurements arrive with the world's ticks: it has one clock, against which the kind that comes
/// soonest counts.
fn sources(scenario: &Scenario) -> SourcesConfig {
    let s = &scenario.sensors;
    let attitude_s = s.vessel_attitude.as_ref().map(|a| a.latency_s);
    let latencies_s = [
        s.vessel_imu.latency_s,
        s.vessel_gnss.latency_s,
        s.vessel_heading.latency_s,
    ];
    let least_s = latencies_s
        .into_iter()
        .chain(attitude_s)
        .fold(f64::INFINITY, f64::min);
    SourcesConfig {
        sources: vec![SourceConfig {
            latency_s: (least_s / TICK.secs() - 1e-6).ceil() * TICK.secs(),
            ..SourceConfig::default()
        }],
    }
}

/// What has arrived of the device, dated by its clock.
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
