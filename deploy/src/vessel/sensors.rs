//! The vessel's real sensors as a process: bytes of serial ports, UDP and TCP in, dated measurements to
//! the vessel's process out, and every ten seconds what became of each source's bytes.

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
use crate::exit::{CliError, Exit};
use crate::io::byte_link::ByteLink;
use crate::io::link_url::LinkUrl;
use crate::io::sensor_socket::SensorSender;
use crate::process::args::SensorsArgs;
use crate::process::life::{draw_boot, end_with_supervisor};
use crate::process::supervisor::pause;
use crate::terminal;
use crate::vessel::sensor_supervisor;
use crate::vessel::sensor_supervisor::SourceReport;
use alight_shared::transport::wake::end_requested;
use std::sync::atomic::Ordering;

/// Without news of any source it looks again after this long.
const IDLE_PAUSE: Duration = Duration::from_millis(2);
/// Time between two words about the sources to a person, ns.
const SUMMARY_PERIOD_NS: i64 = 10_000_000_000;

/// Runs until told to end.
pub fn run(args: &SensorsArgs) -> Result<Exit, CliError> {
    let computer: VesselComputer = config::load(&args.config).map_err(|e| CliError(e.to_string()))?;
    let sources = &computer.sensor.sources;
    if sources.is_empty() {
        return Err(CliError(format!(
            "{}: no sensor is configured; add for each one a table [[sensor.sources]] with connect = \
             \"serial:///dev/ttyUSB0:115200\" (or udpin://, tcpout://) and format = \"nmea\", \"ubx\" or \"mavlink\"",
            args.config.display()
        )));
    }
    let mut wires = Vec::new();
    for source in sources {
        let url: LinkUrl = source.connect.parse().map_err(CliError)?;
        info!("{}: {url}", source.name);
        wires.push(ByteLink::new(url, steady_ns())?);
    }
    let to = SensorSender::to(&computer.sensors)
        .map_err(|e| CliError::because(format!("sending to {}", computer.sensors), e))?;
    let mut node = SensorNode::new(&computer.sensor, computer.vessel_id, draw_boot());
    let end = end_with_supervisor(args.supervised);
    let report_period_ns = if args.supervised {
        sensor_supervisor::REPORT_PERIOD_NS
    } else {
        SUMMARY_PERIOD_NS
    };
    let mut next_report_ns = steady_ns() + report_period_ns;
    let mut why: Vec<Option<String>> = vec![None; wires.len()];
    while !(end.load(Ordering::Relaxed) || end_requested()) {
        let mut input = SensorsIn {
            bytes: vec![Vec::new(); wires.len()],
        };
        let mut any = false;
        for (k, wire) in wires.iter_mut().enumerate() {
            let (Some(bytes), Some(why), Some(source)) =
                (input.bytes.get_mut(k), why.get_mut(k), sources.get(k))
            else {
                continue;
            };
            // What a flood brings beyond one step's share waits in the system's own buffers.
            any |= wire.read(steady_ns(), |b| {
                if bytes.len() < 2 * MAX_STEP_BYTES {
                    bytes.extend_from_slice(b);
                }
            });
            if !bytes.is_empty() {
                *why = None;
            }
            if let Some(complaint) = wire.last_error() {
                // A link that is tried again and again has one complaint.
                if why.as_ref() != Some(&complaint) {
                    warn!("{}: {complaint}", source.name);
                }
                *why = Some(complaint);
            }
        }
        // Read after the bytes: nothing arrives later than now.
        let now = computer.clock.read(steady_ns());
        let out = node.step(now, &input);
        to.send(&out.readings);
        for (k, bytes) in &out.requests {
            if let Some(wire) = wires.get_mut(*k) {
                wire.write(steady_ns(), bytes);
            }
        }
        if steady_ns() >= next_report_ns {
            next_report_ns = steady_ns() + report_period_ns;
            print_reports(args, &reports(sources, &node, now, &why));
        }
        if !any {
            pause(IDLE_PAUSE);
        }
    }
    let now = computer.clock.read(steady_ns());
    print_reports(args, &reports(sources, &node, now, &why));
    Ok(Exit::Success)
}

/// What is to be said of each source.
fn reports(
    sources: &[SourceConfig],
    node: &SensorNode,
    now: Time<VesselClock>,
    why: &[Option<String>],
) -> Vec<SourceReport> {
    let each = sources.iter().zip(node.status()).zip(why).enumerate();
    each.map(|(number, ((source, status), why))| SourceReport {
        number,
        source: source.name.clone(),
        status,
        age_s: status.newest_s.map(|s| now.secs() - s),
        why: why.clone(),
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
             implausible_time, {} out of order, {} repeated, {} bytes lost{pulses}",
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
