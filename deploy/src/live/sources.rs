//! The vessel's real sensors as a process: bytes of serial ports, UDP and TCP in, dated measurements to
//! the vessel's process out, and every ten seconds what became of each source's bytes.

use std::time::Duration;

use alight_shared::config;
use alight_shared::node::Node;
use alight_shared::time::{Time, VesselClock};
use alight_shared::transport::clock::steady_ns;
use alight_usv::KINDS;
use alight_usv::sensors::{MOST_BYTES, SensorNode, SensorsIn, SourceConfig};
use serde_json::json;

use super::args::SensorsArgs;
use super::autopilot_url::AutopilotUrl;
use super::autopilot_wire::AutopilotWire;
use super::config::VesselComputer;
use super::interface::sensors::SimulatedSensors;
use super::process::{draw_boot, end_with_supervisor};
use super::sensor_ward::{self, SourceWord};
use super::supervisor::pause;
use crate::{End, Refused, say};
use alight_shared::transport::wake::end_requested;
use std::sync::atomic::Ordering;

/// Without news of any source it looks again after this long.
const BEAT: Duration = Duration::from_millis(2);
/// Time between two words about the sources to a person, ns.
const WORD_NS: i64 = 10_000_000_000;

/// Runs until told to end.
pub fn run(args: &SensorsArgs) -> Result<End, Refused> {
    let computer: VesselComputer = config::load(&args.config).map_err(|e| Refused(e.to_string()))?;
    let sources = &computer.sensor.sources;
    if sources.is_empty() {
        return Err(Refused(format!(
            "{}: no sensor is configured; add for each one a table [[sensor.sources]] with connect = \
             \"serial:///dev/ttyUSB0:115200\" (or udpin://, tcpout://) and format = \"nmea\", \"ubx\" or \"mavlink\"",
            args.config.display()
        )));
    }
    let mut wires = Vec::new();
    for source in sources {
        let url: AutopilotUrl = source.connect.parse().map_err(Refused)?;
        say::line(format_args!("{}: {url}", source.name));
        wires.push(AutopilotWire::new(url, steady_ns())?);
    }
    let to = SimulatedSensors::to(&computer.sensors)
        .map_err(|e| Refused::because(format!("sending to {}", computer.sensors), e))?;
    let mut node = SensorNode::new(&computer.sensor, computer.vessel_id, draw_boot());
    let end = end_with_supervisor(args.supervised);
    let word_ns = if args.supervised {
        sensor_ward::WORD_NS
    } else {
        WORD_NS
    };
    let mut next_word_ns = steady_ns() + word_ns;
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
                if bytes.len() < 2 * MOST_BYTES {
                    bytes.extend_from_slice(b);
                }
            });
            if !bytes.is_empty() {
                *why = None;
            }
            if let Some(complaint) = wire.complaint() {
                // A link that is tried again and again has one complaint.
                if why.as_ref() != Some(&complaint) {
                    say::line(format_args!("{}: {complaint}", source.name));
                }
                *why = Some(complaint);
            }
        }
        // Read after the bytes: nothing arrives later than now.
        let now = computer.clock.read(steady_ns());
        let out = node.step(now, &input);
        to.send(&out.readings);
        for (k, bytes) in &out.ask {
            if let Some(wire) = wires.get_mut(*k) {
                wire.write(steady_ns(), bytes);
            }
        }
        if steady_ns() >= next_word_ns {
            next_word_ns = steady_ns() + word_ns;
            tell(args, &words(sources, &node, now, &why));
        }
        if !any {
            pause(BEAT);
        }
    }
    let now = computer.clock.read(steady_ns());
    tell(args, &words(sources, &node, now, &why));
    Ok(End::Success)
}

/// What is to be said of each source.
fn words(
    sources: &[SourceConfig],
    node: &SensorNode,
    now: Time<VesselClock>,
    why: &[Option<String>],
) -> Vec<SourceWord> {
    let each = sources.iter().zip(node.status()).zip(why).enumerate();
    each.map(|(number, ((source, status), why))| SourceWord {
        number,
        source: source.name.clone(),
        status,
        age_s: status.newest_s.map(|s| now.secs() - s),
        why: why.clone(),
    })
    .collect()
}

/// A line for each source: for a person, or as JSON, which the vessel's process reads too.
fn tell(args: &SensorsArgs, all: &[SourceWord]) {
    for word in all {
        if args.json || args.supervised {
            say::line(json!(word));
            continue;
        }
        let (name, s) = (&word.source, &word.status);
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
        let pulses = match (d.pulses, d.pulses_apart) {
            (0, _) => String::new(),
            (n, 0) => format!("; {n} time pulses announced"),
            (n, apart) => format!("; {n} time pulses announced, {apart} of another time base than the fixes"),
        };
        say::line(format_args!(
            "{name}: {given}; messages {} good, {} corrupted, {} of other kinds; {} without a time, {} \
             misdated, {} out of order, {} repeated, {} bytes lost{pulses}",
            d.good, d.corrupted, d.ignored, d.undated, s.misdated, s.out_of_order, s.duplicated, s.lost_bytes
        ));
    }
}
