//! Report of a live landing in addition to its outcome: resource usage of the processes, delays, effects of the
//! faults.

use alight_computer::{
    process::snapshot::{Snapshot, time},
    record::flight::summary::{FlightSummary, PhaseEntry},
};
use alight_shared::{metrics::MetricName, msg::ReasonCode, process::ProcessKind};
use alight_sim::harness::outcome::Outcome;
use serde::{Deserialize, Serialize};

use crate::live::{air::RadioReport, fault::FaultReport};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProcessUsage {
    pub process: String,
    /// Processor time per time since the last start, per cent of one core.
    pub cpu_percent: f64,
    pub memory_mb: f64,
    /// Median duration of a step of its node, s.
    pub step_p50_s: f64,
    pub step_p99_s: f64,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LiveReport {
    pub restarts: u32,
    pub processes: Vec<ProcessUsage>,
    /// Delay from a measurement on the vessel to the set-point on the drone, median and 99th percentile, s.
    pub vessel_to_set_point_s: [f64; 2],
    /// Delay from odometry to set-point, median and 99th percentile, s.
    pub odometry_to_set_point_s: [f64; 2],
    /// Maximum lateness of a tick of the simulated world, s.
    pub world_late_s: f64,
    /// Number of its ticks more than one period late.
    pub world_late_ticks: u64,
    pub first_contact_s: Option<f64>,
    /// Time on the deck with motors on, s.
    #[serde(default)]
    pub motors_on_deck_s: f64,
    pub phases: Vec<PhaseEntry>,
    /// The last state was entered after a successful match.
    #[serde(skip)]
    pub is_matched: bool,
    pub radio: RadioReport,
    pub faults: Vec<FaultReport>,
}

/// Outcome and report of a live landing, as one JSON object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LiveOutcome {
    #[serde(flatten)]
    pub outcome: Outcome,
    pub live: LiveReport,
}

impl LiveReport {
    pub fn of(snapshot: &Snapshot, restarts: u32) -> LiveReport {
        let [pilot, world] = [ProcessKind::Pilot, ProcessKind::World]
            .map(|kind| snapshot.processes.get(&kind).copied().unwrap_or_default());
        LiveReport {
            restarts,
            processes: snapshot
                .processes
                .values()
                .map(|p| ProcessUsage {
                    process: p.kind.name().into(),
                    cpu_percent: 100.0 * p.cpu_s / ((p.at_ns - p.began_ns) as f64 * 1e-9).max(1e-3),
                    memory_mb: p.resident_bytes as f64 / 1e6,
                    step_p50_s: p.step_p50_s,
                    step_p99_s: p.step_p99_s,
                })
                .collect(),
            vessel_to_set_point_s: [MetricName::VesselToSetPointP50, MetricName::VesselToSetPointP99]
                .map(|m| pilot.seconds(m)),
            odometry_to_set_point_s: [
                MetricName::OdometryToSetPointP50,
                MetricName::OdometryToSetPointP99,
            ]
            .map(|m| pilot.seconds(m)),
            world_late_s: world.seconds(MetricName::LatestTick),
            world_late_ticks: world.count(MetricName::LateTicks),
            is_matched: snapshot
                .mission
                .as_ref()
                .is_some_and(|m| m.entered.code == ReasonCode::Matched),
            ..LiveReport::default()
        }
    }
    pub fn matched(&self) -> Option<&str> {
        let newest = self.phases.last().filter(|_| self.is_matched);
        newest.map(|p| p.reason.as_str())
    }
    pub fn summary(&self, o: &Outcome) -> FlightSummary {
        let name = if o.success { "landed" } else { o.outcome.name() };
        let matched = self.matched();
        let metrics = [
            ("landed", o.success.then_some(1.0)),
            ("landing_s", o.landing_time_s),
            ("off_centre_m", o.position_error_m),
            ("descents", Some(f64::from(o.attempts))),
            ("restarts", Some(f64::from(self.restarts))),
        ];
        let metrics = metrics
            .into_iter()
            .filter_map(|(name, v)| Some((name.to_owned(), v?)));
        FlightSummary {
            length_s: o.sim_time_s,
            ended: true,
            outcome: matched.map_or(name, |_| "matched").into(),
            reason: matched.unwrap_or(&o.reason).into(),
            phases: self.phases.clone(),
            figures: metrics.collect(),
            ..FlightSummary::of("simulation")
        }
    }
    pub fn text(&self) -> String {
        let [a, b] = self.vessel_to_set_point_s.map(time);
        let [c, d] = self.odometry_to_set_point_s.map(time);
        let out = format!(
            "  measurement on the vessel to set-point: {a} (p50), {b} (p99); odometry to set-point: {c}, {d}\n  \
             the world's worst tick was {} late, {} ticks more than one period; {} restarts\n",
            time(self.world_late_s),
            self.world_late_ticks,
            self.restarts
        );
        out + &self.radio.text() + &self.faults()
    }
    pub fn faults(&self) -> String {
        let line = |f: &FaultReport| format!("  fault {}: {f}\n", f.fault);
        self.faults.iter().map(line).collect()
    }
}
