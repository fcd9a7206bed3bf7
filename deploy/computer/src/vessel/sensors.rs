//! Process of the vessel's real sensors: converts bytes of serial ports, UDP and TCP into dated measurements for the
//! vessel's process, and reports on each source at 2 Hz.

use std::{net::SocketAddr, sync::Arc, time::Duration};

use alight_shared::{
    bus::{Bus, Edge, Ports as _, Writer as _},
    config,
    msg::{Header, Line, Seq, SourceRemark, SourceReport},
    process::{ProcessKind, ProcessState},
    time::{Time, VesselClock},
};
use alight_transport::{clock::steady_ns, memory::Publisher};
use alight_usv::{
    computer::Installed as _,
    sensors::{MAX_STEP_BYTES, Remark, SensorNode, SensorPorts, SensorsIn, SensorsOut, SourceConfig},
};
use tokio::time::{Interval, MissedTickBehavior, interval};
use tracing::{info, warn};

use crate::{
    config::{VesselComputerConfig, link_url::LinkUrl},
    exit::{CliError, Exit},
    io::{
        byte_link::{ByteLink, MAX_AT_ONCE},
        byte_links::{ByteArrival, ByteLinks},
        mavlink_key,
        peer::Speaks,
        runtime,
        wakes::Wakes,
    },
    process::{
        args::ProcessArgs,
        run::{AwaitedEdge, NodeView, Process, ProcessEdge},
    },
};

const MAX_STEP_PERIOD: Duration = Duration::from_millis(20);
/// Time without an error of a link after which its next occurrence is reported, ns.
const REPORTED_NS: i64 = 60_000_000_000;
const MAX_REPORTED: usize = 8;

pub fn run(args: &ProcessArgs) -> Result<Exit, CliError> {
    runtime::block_on(read(args))
}

/// Node of this computer's sources, with their keys, for a start with this boot id.
pub fn node(computer: &VesselComputerConfig, boot: u32) -> Result<SensorNode, CliError> {
    let mut node = SensorNode::installed(&computer.nodes(), boot);
    for (number, source) in computer.sensor.sources.iter().enumerate() {
        let name = format!("signing_key of sensor {}", source.name);
        if let Some(key) = mavlink_key::read(&name, &source.signing_key)? {
            node.sign(number, key);
        }
    }
    Ok(node)
}

async fn read(args: &ProcessArgs) -> Result<Exit, CliError> {
    let computer: VesselComputerConfig = config::load(&args.config)?;
    let sources = &computer.sensor.sources;
    if sources.is_empty() {
        return Err(CliError(format!(
            "{}: no sensor is configured; add for each one a table [[sensor.sources]] with connect = \
             \"serial:///dev/ttyUSB0:115200\" (or udpin://, tcpout://, can://, ws://) and format = \"nmea\", \"n2k\", \"signalk\", \"ubx\", \
             \"mavlink\" or \"rtcm\"",
            args.config.display()
        )));
    }
    let mut links = Vec::new();
    for (number, source) in sources.iter().enumerate() {
        let url: LinkUrl = source.connect.parse().map_err(CliError)?;
        info!("{}: {url}", source.name);
        let speaks: Speaks = Arc::new(source.format.speaks());
        links.push((number, ByteLink::of_several(url, Some(speaks)).await?));
    }
    let of = (Some(computer.instance.as_str()), computer.clock);
    let process = Process::start(ProcessKind::Sensors, args, of, |boot| node(&computer, boot))?;
    let mut steps = interval(MAX_STEP_PERIOD);
    steps.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut edge = SensorEdge {
        sources,
        links: ByteLinks::start(links),
        steps,
        bytes: vec![Vec::new(); sources.len()],
        faults: vec![Fault::default(); sources.len()],
        foreign: vec![None; sources.len()],
        header: Header::new(computer.vessel_id, 0, process.boot(), 0, Time::EPOCH),
        reports: process.memory.writer()?,
    };
    process.run_awaiting(&mut edge).await
}

struct SensorEdge<'a> {
    sources: &'a [SourceConfig],
    links: ByteLinks,
    steps: Interval,
    bytes: Vec<Vec<u8>>,
    faults: Vec<Fault>,
    foreign: Vec<Foreign>,
    header: Header<VesselClock>,
    reports: Option<Publisher<SourceReport>>,
}

impl Edge<SensorNode> for SensorEdge<'_> {
    fn read(&mut self, input: &mut SensorsIn) {
        let none = vec![Vec::new(); self.sources.len()];
        input.bytes = core::mem::replace(&mut self.bytes, none);
    }
    fn write<B: Bus>(
        &mut self,
        _input: &SensorsIn,
        out: &mut SensorsOut,
        ports: &mut SensorPorts<B>,
    ) -> bool {
        ports.write(out);
        for (k, bytes) in &out.requests {
            self.links.write(*k, bytes);
        }
        true
    }
}

impl ProcessEdge<SensorNode> for SensorEdge<'_> {
    fn unsent(&self) -> u64 {
        self.reports.unsent()
    }
    fn reports(&mut self, at: &NodeView<'_, SensorNode>, own: Option<ProcessState>) -> Vec<ProcessState> {
        if own.is_some() {
            self.header.at = at.now;
            self.header.sequence = self.header.sequence.wrapping_add(1);
            let reports = source_reports(self.header, at.node, &self.faults, &self.foreign);
            self.reports.send_each(&reports);
        }
        Vec::from_iter(own)
    }
}

impl AwaitedEdge<SensorNode> for SensorEdge<'_> {
    async fn arrival(&mut self, _wakes: &Wakes) -> Result<bool, CliError> {
        let mut arrival = tokio::select! {
            arrival = self.links.next() => Some(arrival),
            _ = self.steps.tick() => None,
        };
        while let Some(a) = arrival {
            if let Some(of) = self.foreign.get_mut(a.link) {
                *of = a.foreign;
            }
            self.take(a, steady_ns());
            // A step takes a limited number of bytes; the rest wait.
            let full = self.bytes.iter().any(|b| b.len() + MAX_AT_ONCE > MAX_STEP_BYTES);
            arrival = if full { None } else { self.links.arrived() };
        }
        Ok(true)
    }
}

impl SensorEdge<'_> {
    /// Handles an event of a source's link. A link that is reopened again and again reports its error once.
    fn take(&mut self, arrival: ByteArrival, now_ns: i64) {
        let k = arrival.link;
        let (Some(bytes), Some(fault), Some(source)) =
            (self.bytes.get_mut(k), self.faults.get_mut(k), self.sources.get(k))
        else {
            return;
        };
        if !arrival.bytes.is_empty() {
            bytes.extend_from_slice(&arrival.bytes);
            fault.now = None;
        }
        if let Some(error) = arrival.error {
            if fault.is_news(&error, now_ns) {
                warn!("{}: {error}", source.name);
            }
            fault.now = Some(error);
        }
    }
}

#[derive(Clone, Debug, Default)]
struct Fault {
    /// Error since the newest byte.
    now: Option<String>,
    /// Reported errors, each with the time of its newest occurrence, ns.
    reported: Vec<(String, i64)>,
}

impl Fault {
    /// Whether to report an error: once while it recurs, even if bytes arrive in between.
    fn is_news(&mut self, error: &str, now_ns: i64) -> bool {
        self.reported
            .retain(|(_, at_ns)| now_ns.saturating_sub(*at_ns) < REPORTED_NS);
        if let Some((_, at_ns)) = self.reported.iter_mut().find(|(reported, _)| reported == error) {
            *at_ns = now_ns;
            return false;
        }
        let has_room = self.reported.len() < MAX_REPORTED;
        if has_room {
            self.reported.push((error.into(), now_ns));
        }
        has_room
    }
}

type Foreign = Option<(u64, SocketAddr)>;

pub fn foreign_remark(foreign: Foreign) -> Option<Remark> {
    let (count, from) = foreign?;
    Some(Remark::fault(
        format!("{from} sends to the same port: {count} datagrams left out"),
        "only the first sender of measurements is accepted: give each device a separate port and source",
    ))
}

fn source_reports(
    header: Header<VesselClock>,
    node: &SensorNode,
    faults: &[Fault],
    foreign: &[Foreign],
) -> Vec<SourceReport> {
    let remark = |r: Remark| SourceRemark {
        text: r.text.as_str().into(),
        remedy: r.remedy.as_deref().map(Line::from),
    };
    let each = node.status().into_iter().zip(node.remarks());
    each.zip(faults.iter().zip(foreign))
        .zip(0..)
        .map(|(((status, remarks), (fault, foreign)), number)| SourceReport {
            header,
            number,
            status,
            why: fault.now.as_deref().map(Line::from),
            remarks: Seq::filled(foreign_remark(*foreign).into_iter().chain(remarks).map(remark)),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_a_link_that_breaks_again_and_again() {
        let mut fault = Fault::default();
        let reported = |fault: &mut Fault, error: &str, at_s: i64| fault.is_news(error, at_s * 1_000_000_000);
        let all = (0..300).filter(|k| reported(&mut fault, ["rejected", "closed"][*k as usize % 2], *k));
        assert_eq!(all.count(), 2);
        assert!(reported(&mut fault, "closed", 360), "it was gone for a minute");
        let many = (0..100).filter(|k| reported(&mut fault, &format!("error {k}"), 361));
        assert!(many.count() < MAX_REPORTED);
    }
}
