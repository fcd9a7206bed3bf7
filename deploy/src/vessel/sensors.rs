//! The vessel's real sensors as a process: bytes of serial ports, UDP and TCP in, dated measurements to
//! the vessel's process out, and every ten seconds a report about each source.

use std::time::Duration;

use alight_shared::config;
use alight_shared::node::Node;
use alight_shared::time::{Time, VesselClock};
use alight_shared::transport::clock::steady_ns;
use alight_usv::KINDS;
use alight_usv::sensors::{MAX_STEP_BYTES, SensorNode, SensorsIn, SourceConfig};
use serde_json::json;
use tracing::{info, warn};

use crate::config::VesselComputer;
use crate::exit::{CliError, Doing, Exit};
use crate::io::byte_link::ByteLink;
use crate::io::link_url::LinkUrl;
use crate::io::sensor_socket::SensorSender;
use crate::process::args::SensorsArgs;
use crate::process::life::{draw_boot, end_with_supervisor};
use crate::process::supervisor::pause;
use crate::terminal;
use crate::vessel::sensor_supervisor::{self, SourceReport};
use alight_shared::transport::wake::end_requested;
use std::sync::atomic::Ordering;

/// Pause when no source had bytes.
const IDLE_PAUSE: Duration = Duration::from_millis(2);
/// Time between two reports about the sources to a person, ns.
const SUMMARY_PERIOD_NS: i64 = 10_000_000_000;

/// Runs until it is asked to end.
pub fn run(args: &SensorsArgs) -> Result<Exit, CliError> {
    let computer: VesselComputer = config::load(&args.config)?;
    let sources = &computer.sensor.sources;
    if sources.is_empty() {
        return Err(CliError(format!(
            "{}: no sensor is configured; add for each one a table [[sensor.sources]] with connect = \
             \"serial:///dev/ttyUSB0:115200\" (or udpin://, tcpout://) and format = \"nmea\", \"ubx\" or \"mavlink\"",
            args.config.display()
        )));
    }
    let mut links = Vec::new();
    for source in sources {
        let url: LinkUrl = source.connect.parse().map_err(CliError)?;
        info!("{}: {url}", source.name);
        links.push(ByteLink::new(url, steady_ns())?);
    }
    let to = SensorSender::to(&computer.sensors).doing(format_args!("sending to {}", computer.sensors))?;
    let mut node = SensorNode::new(&computer.placed_sensors(), computer.vessel_id, draw_boot());
    let end = end_with_supervisor(args.supervised);
    let report_period_ns = if args.supervised {
        sensor_supervisor::REPORT_PERIOD_NS
    } else {
        SUMMARY_PERIOD_NS
    };
    let mut next_report_ns = steady_ns() + report_period_ns;
    let mut faults: Vec<Option<String>> = vec![None; links.len()];
    while !(end.load(Ordering::Relaxed) || end_requested()) {
        let mut input = SensorsIn {
            bytes: vec![Vec::new(); links.len()],
        };
        let mut any = false;
        for (k, link) in links.iter_mut().enumerate() {
            let (Some(bytes), Some(faults), Some(source)) =
                (input.bytes.get_mut(k), faults.get_mut(k), sources.get(k))
            else {
                continue;
            };
            // What a flood brings beyond two steps' bytes waits in the system's buffers.
            any |= link.read(steady_ns(), |b| {
                if bytes.len() < 2 * MAX_STEP_BYTES {
                    bytes.extend_from_slice(b);
                }
            });
            if !bytes.is_empty() {
                *faults = None;
            }
            if let Some(error) = link.last_error() {
                // A link that is reopened again and again reports its error once.
                if faults.as_ref() != Some(&error) {
                    warn!("{}: {error}", source.name);
                }
                *faults = Some(error);
            }
        }
        // Read after the bytes: no byte is from the future.
        let now = computer.clock.read(steady_ns());
        let out = node.step(now, &input);
        to.send(&out.readings);
        for (k, bytes) in &out.requests {
            if let Some(link) = links.get_mut(*k) {
                link.write(steady_ns(), bytes);
            }
        }
        if steady_ns() >= next_report_ns {
            next_report_ns = steady_ns() + report_period_ns;
            print_reports(args, &reports(sources, &node, now, &faults));
        }
        if !any {
            pause(IDLE_PAUSE);
        }
    }
    let now = computer.clock.read(steady_ns());
    print_reports(args, &reports(sources, &node, now, &faults));
    Ok(Exit::Success)
}

/// The report about each source.
fn reports(
    sources: &[SourceConfig],
    node: &SensorNode,
    now: Time<VesselClock>,
    faults: &[Option<String>],
) -> Vec<SourceReport> {
    let each = sources.iter().zip(node.status()).zip(faults).enumerate();
    each.map(|(number, ((source, status), fault))| SourceReport {
        number,
        source: source.name.clone(),
        status,
        age_s: status.newest_s.map(|s| now.secs() - s),
        why: fault.clone(),
    })
    .collect()
}

/// A line for each source: for a person, or as JSON, which the vessel's process reads too.
fn print_reports(args: &SensorsArgs, all: &[SourceReport]) {
    for report in all {
        if args.json || args.supervised {
            terminal::line(json!(report));
            continue;
        }
        let (name, s) = (&report.source, &report.status);
        let given: Vec<String> = KINDS
            .iter()
            .zip(s.given)
            .filter(|(_, n)| *n > 0)
            .map(|(kind, n)| format!("{n} {kind}"))
            .collect();
        let given = if given.is_empty() {
            "nothing".into()
        } else {
            given.join(", ")
        };
        let d = &s.decoded;
        let pulses = match (d.pulses, d.mismatched_pulses) {
            (0, _) => String::new(),
            (n, 0) => format!("; {n} time pulses announced"),
            (n, apart) => format!("; {n} time pulses announced, {apart} of another time base than the fixes"),
        };
        terminal::line(format_args!(
            "{name}: {given}; messages {} good, {} corrupted, {} of other kinds; {} without a time, {} \
             of an implausible time, {} out of order, {} repeated, {} bytes lost{pulses}",
            d.good,
            d.corrupted,
            d.ignored,
            d.undated,
            s.implausible_time,
            s.out_of_order,
            s.duplicated,
            s.lost_bytes
        ));
    }
}
