//! The vessel's real sensors as a process: bytes of serial ports, UDP and TCP in, dated measurements to
//! the vessel's process out, and every ten seconds a report about each source.

use std::time::Duration;

use alight_shared::config;
use alight_shared::node::Node;
use alight_shared::time::{Time, VesselClock};
use alight_shared::transport::clock::steady_ns;
use alight_usv::KINDS;
use alight_usv::sensors::{MAX_STEP_BYTES, Remark, SensorNode, SensorsIn, SourceConfig};
use serde_json::json;
use tokio::time::{MissedTickBehavior, interval};
use tracing::{info, warn};

use crate::config::VesselComputer;
use crate::config::link_url::LinkUrl;
use crate::exit::{CliError, Doing, Exit};
use crate::io::byte_link::ByteLink;
use crate::io::byte_links::{Arrival, ByteLinks};
use crate::io::mavlink_key;
use crate::io::peer::Speaks;
use crate::io::runtime;
use crate::io::sensor_socket::SensorSender;
use crate::process::args::SensorsArgs;
use crate::process::life::{draw_boot, end_with_supervisor};
use crate::terminal;
use crate::vessel::sensor_supervisor::{self, SourceReport};
use alight_shared::transport::wake::end_requested;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// The node is stepped at least this often.
const MAX_STEP_PERIOD: Duration = Duration::from_millis(20);
/// Time between two reports about the sources to a person, ns.
const SUMMARY_PERIOD_NS: i64 = 10_000_000_000;

/// Runs until it is asked to end.
pub fn run(args: &SensorsArgs) -> Result<Exit, CliError> {
    runtime::block_on(read(args))
}

/// The node of this computer's sources, with their keys, for a start with this boot id.
pub fn node(computer: &VesselComputer, boot: u32) -> Result<SensorNode, CliError> {
    let mut node = SensorNode::new(&computer.placed_sensors(), computer.vessel_id, boot);
    for (number, source) in computer.sensor.sources.iter().enumerate() {
        let name = format!("signing_key of sensor {}", source.name);
        if let Some(key) = mavlink_key::read(&name, &source.signing_key)? {
            node.sign(number, key);
        }
    }
    Ok(node)
}

async fn read(args: &SensorsArgs) -> Result<Exit, CliError> {
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
    for (number, source) in sources.iter().enumerate() {
        let url: LinkUrl = source.connect.parse().map_err(CliError)?;
        info!("{}: {url}", source.name);
        let speaks: Speaks = Arc::new(source.format.speaks());
        links.push((number, ByteLink::with_peer(url, Some(speaks)).await?));
    }
    let mut links = ByteLinks::start(links);
    let to = SensorSender::to(&computer.sensors).doing(format_args!("sending to {}", computer.sensors))?;
    let mut node = node(&computer, draw_boot())?;
    let end = end_with_supervisor(args.supervised);
    let report_period_ns = if args.supervised {
        sensor_supervisor::REPORT_PERIOD_NS
    } else {
        SUMMARY_PERIOD_NS
    };
    let mut next_report_ns = steady_ns() + report_period_ns;
    let mut faults: Vec<Option<String>> = vec![None; sources.len()];
    let mut strangers: Vec<Strangers> = vec![None; sources.len()];
    let mut steps = interval(MAX_STEP_PERIOD);
    steps.set_missed_tick_behavior(MissedTickBehavior::Delay);
    while !(end.load(Ordering::Relaxed) || end_requested()) {
        let mut input = SensorsIn {
            bytes: vec![Vec::new(); sources.len()],
        };
        let mut arrival = tokio::select! {
            arrival = links.next() => Some(arrival),
            _ = steps.tick() => None,
        };
        while let Some(a) = arrival {
            if let Some(of) = strangers.get_mut(a.link) {
                *of = a.strangers;
            }
            take(a, sources, &mut input, &mut faults);
            // A step's bytes are a bound: more of them waits.
            let full = input.bytes.iter().any(|b| b.len() >= MAX_STEP_BYTES);
            arrival = if full { None } else { links.arrived() };
        }
        // Read after the bytes: no byte is from the future.
        let now = computer.clock.read(steady_ns());
        let out = node.step(now, &input);
        to.send(&out.readings);
        for (k, bytes) in &out.requests {
            links.write(*k, bytes);
        }
        if steady_ns() >= next_report_ns {
            next_report_ns = steady_ns() + report_period_ns;
            print_reports(args, &reports(sources, &node, now, &faults, &strangers));
        }
    }
    let now = computer.clock.read(steady_ns());
    print_reports(args, &reports(sources, &node, now, &faults, &strangers));
    Ok(Exit::Success)
}

/// Takes what a source's link brought. A link that is reopened again and again reports its error once.
fn take(arrival: Arrival, sources: &[SourceConfig], input: &mut SensorsIn, faults: &mut [Option<String>]) {
    let k = arrival.link;
    let (Some(bytes), Some(fault), Some(source)) =
        (input.bytes.get_mut(k), faults.get_mut(k), sources.get(k))
    else {
        return;
    };
    if !arrival.bytes.is_empty() {
        bytes.extend_from_slice(&arrival.bytes);
        *fault = None;
    }
    if let Some(error) = arrival.error {
        if fault.as_ref() != Some(&error) {
            warn!("{}: {error}", source.name);
        }
        *fault = Some(error);
    }
}

/// Datagrams of others than a link's peer, and who sent the newest.
type Strangers = Option<(u64, SocketAddr)>;

/// Who else sends to a source's port.
pub fn strangers_remark(strangers: Strangers) -> Option<Remark> {
    let (count, from) = strangers?;
    Some(Remark::fault(
        format!("{from} sends to the same port: {count} datagrams left out"),
        "one sender has the port, the first that sends what is read: give each device a port and a source of its own",
    ))
}

/// The report about each source.
fn reports(
    sources: &[SourceConfig],
    node: &SensorNode,
    now: Time<VesselClock>,
    faults: &[Option<String>],
    strangers: &[Strangers],
) -> Vec<SourceReport> {
    let each = sources.iter().zip(node.status()).zip(faults).enumerate();
    let said = node.remarks().into_iter().zip(strangers);
    each.zip(said)
        .map(
            |((number, ((source, status), fault)), (remarks, strangers))| SourceReport {
                remarks: strangers_remark(*strangers).into_iter().chain(remarks).collect(),
                number,
                source: source.name.clone(),
                status,
                age_s: status.newest_s.map(|s| now.secs() - s),
                why: fault.clone(),
            },
        )
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
        for remark in &report.remarks {
            let remedy = remark
                .remedy
                .as_ref()
                .map(|r| format!(": {r}"))
                .unwrap_or_default();
            terminal::line(format_args!("  {}{remedy}", remark.text));
        }
    }
}
