//! What the figures of each process mean, by their order.

use alight_shared::admission::RejectionReason;
use alight_shared::transport::process::{ProcessKind, ProcessState};
use alight_shared::transport::rejections::AccessRejection;

use crate::process::snapshot::time;
use crate::vessel::drone_monitor::state;

/// How a figure reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Unit {
    /// A number of things.
    Count,
    /// Seconds.
    Time,
    /// 0 to 1.
    Share,
    /// Why somebody was refused; 0: nobody was.
    AccessRejection,
    /// A state of the mission.
    State,
}

/// Figures of the vessel; the last two are how long after its measurement an estimate is sent.
pub const VESSEL_FIGURES: usize = 15;

const VESSEL: [(&str, Unit); VESSEL_FIGURES] = [
    ("sensor datagrams refused", Unit::Count),
    ("bytes sent", Unit::Count),
    ("packets dropped", Unit::Count),
    ("time requests refused", Unit::Count),
    ("drone's words heard", Unit::Count),
    ("drone's words refused", Unit::Count),
    ("drone last heard", Unit::Time),
    ("drone's state", Unit::State),
    ("drone's descents", Unit::Count),
    ("drone's battery", Unit::Share),
    ("share of the full rates", Unit::Share),
    ("strangers refused", Unit::Count),
    ("the last for", Unit::AccessRejection),
    ("measurement to estimate sent p50", Unit::Time),
    ("measurement to estimate sent p99", Unit::Time),
];
const BRIDGE: [(&str, Unit); 4] = [
    ("bytes heard", Unit::Count),
    ("packets dropped", Unit::Count),
    ("sessions opened anew", Unit::Count),
    ("vessel's words refused", Unit::Count),
];
const PILOT: [(&str, Unit); 4] = [
    ("vessel's measurement to set-point p50", Unit::Time),
    ("vessel's measurement to set-point p99", Unit::Time),
    ("odometry to set-point p50", Unit::Time),
    ("odometry to set-point p99", Unit::Time),
];
const AUTOPILOT: [(&str, Unit); 6] = [
    ("doubt about the autopilot's clock", Unit::Time),
    ("samples refused", Unit::Count),
    ("autopilot's clock began anew", Unit::Count),
    ("thrust that hovers", Unit::Share),
    ("set-points sent", Unit::Count),
    ("link opened again", Unit::Count),
];
/// Of the camera, in the order of its process.
const CAMERA: [(&str, Unit); 10] = [
    ("images", Unit::Count),
    ("with the tag", Unit::Count),
    ("other tags", Unit::Count),
    ("too faint", Unit::Count),
    ("misshapen", Unit::Count),
    ("without a pose", Unit::Count),
    ("of another size", Unit::Count),
    ("exposure to sighting p50", Unit::Time),
    ("exposure to sighting p99", Unit::Time),
    ("source opened again", Unit::Count),
];
/// Of the ultraviolet camera, in the order of its process.
const ULTRAVIOLET: [(&str, Unit); 9] = [
    ("images", Unit::Count),
    ("with a place of the deck", Unit::Count),
    ("markers known", Unit::Count),
    ("with one marker only", Unit::Count),
    ("without a place", Unit::Count),
    ("of another size", Unit::Count),
    ("exposure to fix p50", Unit::Time),
    ("exposure to fix p99", Unit::Time),
    ("source opened again", Unit::Count),
];
const WORLD: [(&str, Unit); 5] = [
    ("latest tick", Unit::Time),
    ("late ticks", Unit::Count),
    ("time since the start", Unit::Time),
    ("slices left unanswered", Unit::Count),
    ("images never rendered", Unit::Count),
];

fn names(kind: ProcessKind) -> Vec<(String, Unit)> {
    let own = |names: &[(&str, Unit)]| names.iter().map(|(n, u)| (n.to_string(), *u)).collect();
    match kind {
        ProcessKind::Vessel => own(&VESSEL),
        ProcessKind::Pilot => own(&PILOT),
        ProcessKind::World => own(&WORLD),
        ProcessKind::Autopilot => own(&AUTOPILOT),
        ProcessKind::Camera => own(&CAMERA),
        ProcessKind::Uvdar => own(&ULTRAVIOLET),
        ProcessKind::Bridge => {
            let mut all: Vec<(String, Unit)> = own(&BRIDGE);
            all.extend(
                RejectionReason::ALL
                    .iter()
                    .map(|r| (format!("refused: {}", r.name()), Unit::Count)),
            );
            all
        }
        ProcessKind::Predictor
        | ProcessKind::Mission
        | ProcessKind::Planner
        | ProcessKind::Link
        | ProcessKind::Sensors => Vec::new(),
    }
}

/// The figures of a process by name, for machines.
pub fn named(p: &ProcessState) -> Vec<(String, f64)> {
    names(p.kind)
        .into_iter()
        .zip(p.figures.iter())
        .map(|((name, _), value)| (name, *value))
        .collect()
}

/// The figures of a process in words, without counts of zero; empty for one without.
pub fn text(p: &ProcessState) -> String {
    let shown: Vec<String> = names(p.kind)
        .into_iter()
        .zip(p.figures.iter())
        .filter(|((_, unit), value)| !matches!(unit, Unit::Count | Unit::AccessRejection) || **value != 0.0)
        .map(|((name, unit), value)| {
            let value = match unit {
                Unit::Count => format!("{value:.0}"),
                Unit::Time => time(*value),
                Unit::Share => format!("{:.0} %", 100.0 * value),
                Unit::AccessRejection => AccessRejection::numbered(*value).map_or("-", |r| r.name()).into(),
                Unit::State => state(*value).map_or("-", |s| s.name()).into(),
            };
            format!("{name} {value}")
        })
        .collect();
    shown.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::Seq;
    use alight_shared::transport::process::MAX_METRICS;

    #[test]
    fn metrics_of_every_process_fit_and_are_named() {
        for kind in ProcessKind::ALL {
            assert!(names(kind).len() <= MAX_METRICS, "{kind:?}");
        }
        let figures = [
            0.0, 1200.0, 0.0, 3.0, 9.0, 0.0, 0.25, 3.0, 0.0, 0.8, 1.0, 4.0, 3.0, 0.01, 0.02,
        ];
        let vessel = ProcessState {
            kind: ProcessKind::Vessel,
            figures: Seq::filled(figures),
            ..ProcessState::default()
        };
        assert_eq!(
            text(&vessel),
            "bytes sent 1200, time requests refused 3, drone's words heard 9, drone last heard 250.0 ms, \
             drone's state Tracking, drone's battery 80 %, share of the full rates 100 %, strangers refused 4, the last for an expired certificate, measurement to estimate sent p50 10.0 ms, \
             measurement to estimate sent p99 20.0 ms"
        );
        assert_eq!(named(&vessel).len(), VESSEL.len());
    }
}
