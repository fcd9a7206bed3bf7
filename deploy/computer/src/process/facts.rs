//! Facts about a computer, reported by its supervisor: initial configuration, certificate of the radio, and whether
//! the configuration was edited since the start. Viewers know the computer from this report alone.

use std::path::{Path, PathBuf};

use alight_shared::{
    landing::SupportPolygon,
    msg::{CertificateState, ComputerReport, DeckMotion, Header, Line, Name, Names, Seq, VesselReport},
    time::Time,
};
use alight_transport::{
    clock::ProcessClock,
    memory::{Memory, Publisher},
};

use crate::{
    certificates::read_certificate,
    config::{DroneComputerConfig, VesselComputerConfig},
    exit::CliError,
    process::life::draw_boot,
};

const PERIOD_NS: i64 = 500_000_000;
const CERTIFICATE_PERIOD_NS: i64 = 60_000_000_000;

#[derive(Clone, Debug)]
pub struct Facts {
    pub report: ComputerReport,
    /// File with the radio's certificate, which a vessel reports; empty without one.
    certificate: PathBuf,
    clock: ProcessClock,
}

impl Facts {
    pub fn drone(computer: &DroneComputerConfig) -> Facts {
        let bridge = &computer.bridge;
        let nodes = &computer.drone;
        let support = SupportPolygon::on(&nodes.deck, &nodes.airframe, nodes.mission.friction);
        let title = format!("drone {}, {}", bridge.drone_id, computer.instance);
        Facts {
            report: ComputerReport {
                header: Header::new(bridge.vessel_id, bridge.drone_id, 0, 0, Time::EPOCH),
                title: title.as_str().into(),
                drone_id: Some(bridge.drone_id),
                deck: Some(nodes.deck.dimensions()),
                deck_tilt_rad: Some(nodes.mission.deck_tilt_rad),
                parked_friction: Some(support.friction),
                disarm_s: Some(computer.autopilot.disarm.longest_s()),
                processes: Seq::filled(computer.processes()),
                knots: computer.view.knots,
                ..ComputerReport::default()
            },
            certificate: PathBuf::new(),
            clock: computer.clock,
        }
    }
    pub fn vessel(computer: &VesselComputerConfig) -> Facts {
        let radio = &computer.radio;
        let sources = &computer.sensor.sources;
        let limits = &computer.limits;
        let vessel = VesselReport {
            limits: DeckMotion {
                samples: 0,
                roll: limits.roll_deg.to_radians(),
                pitch: limits.pitch_deg.to_radians(),
                inclination: limits.inclination_deg.to_radians(),
                heave_rate: limits.heave_rate_mps,
            },
            listen: Names::of(&radio.listen),
            connect: Names::of(&radio.connect),
            peers: Names::of(&radio.tls.peers),
            sources: Seq::filled(sources.iter().map(|s| Name::from(s.name.as_str()))),
            ..VesselReport::default()
        };
        Facts {
            report: ComputerReport {
                header: Header::new(computer.vessel_id, 0, 0, 0, Time::EPOCH),
                title: format!("vessel {}", computer.vessel_id).as_str().into(),
                processes: Seq::filled(computer.processes()),
                knots: computer.view.knots,
                vessel: Some(vessel),
                ..ComputerReport::default()
            },
            certificate: PathBuf::from(&radio.tls.certificate),
            clock: computer.clock,
        }
    }
}

pub struct Reporter {
    facts: Facts,
    reports: Publisher<ComputerReport>,
    /// Times of the next publication and of the next reading of the certificate's file, on the steady clock, ns.
    due_ns: i64,
    read_due_ns: i64,
}

impl Reporter {
    pub fn join(memory: &Memory, mut facts: Facts) -> Result<Reporter, CliError> {
        facts.report.header.boot = draw_boot();
        Ok(Reporter {
            facts,
            reports: memory.publisher()?,
            due_ns: i64::MIN,
            read_due_ns: i64::MIN,
        })
    }
    /// Publishes the facts when they are due. `edited` returns a message if the configuration was edited.
    pub fn poll(&mut self, now_ns: i64, edited: impl FnOnce() -> Option<String>) {
        if now_ns < self.due_ns {
            return;
        }
        self.due_ns = now_ns.saturating_add(PERIOD_NS);
        let report = &mut self.facts.report;
        report.header.at = Time::from_nanos(now_ns);
        report.header.sequence = report.header.sequence.wrapping_add(1);
        report.edited = edited().as_deref().map(Line::from);
        if let Some(vessel) = &mut report.vessel {
            vessel.clock = self.facts.clock.read(now_ns);
            if now_ns >= self.read_due_ns {
                self.read_due_ns = now_ns.saturating_add(CERTIFICATE_PERIOD_NS);
                vessel.certificate = certificate(&self.facts.certificate);
            }
        }
        self.reports.send(report);
    }
}

fn certificate(file: &Path) -> CertificateState {
    if file.as_os_str().is_empty() {
        return CertificateState::Absent;
    }
    match read_certificate(file) {
        Ok(read) => CertificateState::Read(read.certificate),
        Err(e) => CertificateState::Unreadable(e.to_string().as_str().into()),
    }
}
