//! `alight replay`: recorded inputs through new nodes, outputs compared bit for bit.

use std::collections::BTreeMap;
use std::path::Path;

use alight_bridge::Bridge;
use alight_shared::config;
use alight_shared::node::Node;
use alight_shared::time::Time;
use alight_shared::wire::{self, WireError};
use alight_uav::mission::Mission;
use alight_uav::pilot::Pilot;
use alight_uav::planner::Planner;
use alight_uav::predictor::{Predictor, PredictorIn};
use alight_usv::{VesselNode, VesselNodeConfig};
use mcap::read::Options;
use mcap::{MessageStream, Summary};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::json;

use super::args::ReplayArgs;
use super::entry::{Computed, ENCODING, Entry, FORMAT, Missing, MissionEntry, PilotEntry, PlannerEntry};
use super::{DRONE_FILE, NODES, RECORDING, VESSEL_FILE, topic};
use crate::configs::DroneFile;
use crate::say::{self, note};
use crate::{End, Refused};

/// No recording that this program makes is larger, bytes.
const MAX_FILE_BYTES: u64 = 2 << 30;

/// How one node's replay went.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Verdict {
    /// Steps replayed.
    pub steps: u64,
    /// The world's time of the first step whose output differs, s.
    pub differs_at_s: Option<f64>,
}

/// How a replay went, in the order of [`NODES`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Replayed {
    /// Per node.
    pub nodes: [Verdict; NODES.len()],
    /// Node and time of the first difference, s.
    pub first: Option<(&'static str, f64)>,
}

/// Replays and says how it went.
pub fn run(args: &ReplayArgs) -> Result<End, Refused> {
    let replayed = contained(&args.path)?;
    let say = |line: String| note(args.json, line);
    for (name, verdict) in NODES.iter().zip(&replayed.nodes) {
        let word = match verdict.differs_at_s {
            None => "identical".to_string(),
            Some(t) => format!("differs from {t:.2} s on"),
        };
        say(format!("{name:<10} {:>8} steps  {word}", verdict.steps));
    }
    let text = match replayed.first {
        None => "bit-identical".to_string(),
        Some((node, t)) => format!("first difference: {node} at {t:.2} s of the recording"),
    };
    if args.json {
        let nodes: Vec<_> = NODES
            .iter()
            .zip(&replayed.nodes)
            .map(|(name, v)| json!({"node": name, "steps": v.steps, "differs_at_s": v.differs_at_s}))
            .collect();
        say::line(json!({"identical": replayed.first.is_none(), "verdict": text, "nodes": nodes}));
    } else {
        say::line(text);
    }
    Ok(if replayed.first.is_none() {
        End::Success
    } else {
        End::Failed
    })
}

/// [`replay`], with a panic of the MCAP reader made an error: version 0.26 reserves what some damaged
/// length fields claim and panics on an overflow of the capacity.
fn contained(path: &Path) -> Result<Replayed, Refused> {
    let loud = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let replayed = std::panic::catch_unwind(|| replay(path));
    std::panic::set_hook(loud);
    replayed.unwrap_or_else(|_| {
        let origin = path.display();
        Err(Refused(format!(
            "reading {origin}: the recording is damaged; record it again"
        )))
    })
}

/// Replays the recording at `path`.
pub fn replay(path: &Path) -> Result<Replayed, Refused> {
    let origin = path.display().to_string();
    let reading = |e: &dyn std::fmt::Display| Refused::because(format!("reading {origin}"), e);
    let size = std::fs::metadata(path).map_err(|e| reading(&e))?.len();
    if size > MAX_FILE_BYTES {
        return Err(reading(&format_args!(
            "{size} bytes; at most {MAX_FILE_BYTES} are accepted"
        )));
    }
    let file = std::fs::read(path).map_err(|e| reading(&e))?;
    super::outline::check(&file).map_err(|e| reading(&e))?;
    let mut nodes = Nodes::of(&file, &origin)?;
    let mut replayed = Replayed::default();
    let topics = NODES.map(topic);
    let checked = Options::ValidateChunkCrcs.into();
    for message in MessageStream::new_with_options(&file, checked).map_err(|e| unreadable(&origin, &e))? {
        let message = message.map_err(|e| unreadable(&origin, &e))?;
        if message.channel.message_encoding != ENCODING {
            continue;
        }
        let Some(k) = topics.iter().position(|t| *t == message.channel.topic) else {
            continue;
        };
        let t_s = message.log_time as f64 * 1e-9;
        let same = nodes
            .step(k, &message.data)
            .map_err(|e| Refused(format!("{origin}: the step of `{}` at {t_s:.2} s: {e}", NODES[k])))?;
        let verdict = &mut replayed.nodes[k];
        verdict.steps += 1;
        if !same {
            verdict.differs_at_s.get_or_insert(t_s);
            replayed.first.get_or_insert((NODES[k], t_s));
        }
    }
    if replayed.nodes.iter().all(|v| v.steps == 0) {
        return Err(Refused(format!("{origin}: holds no step of any node")));
    }
    Ok(replayed)
}

fn unreadable(origin: &str, e: &dyn std::fmt::Display) -> Refused {
    Refused(format!(
        "{origin} is damaged, cut off or not an MCAP file: {e}; record it again \
         (`alight trial --seed N --record FILE.mcap`)"
    ))
}

/// The nodes as they began.
struct Nodes {
    vessel: VesselNode,
    bridge: Bridge,
    predictor: Predictor,
    mission: Mission,
    planner: Planner,
    pilot: Pilot,
    computed: Computed,
}

impl Nodes {
    /// From the recorded configurations.
    fn of(file: &[u8], origin: &str) -> Result<Nodes, Refused> {
        let summary = Summary::read(file)
            .map_err(|e| unreadable(origin, &e))?
            .ok_or_else(|| unreadable(origin, &"no summary at its end"))?;
        let text = |name: &str| -> Result<String, Refused> {
            let index = summary.attachment_indexes.iter().find(|a| a.name == name);
            let index = index.ok_or_else(|| foreign(origin, name))?;
            let attached = mcap::read::attachment(file, index).map_err(|e| unreadable(origin, &e))?;
            String::from_utf8(attached.data.into_owned()).map_err(|e| unreadable(origin, &e))
        };
        let index = summary.metadata_indexes.iter().find(|m| m.name == RECORDING);
        let index = index.ok_or_else(|| foreign(origin, RECORDING))?;
        let values: BTreeMap<String, String> = mcap::read::metadata(file, index)
            .map_err(|e| unreadable(origin, &e))?
            .metadata;
        let number = |name: &str| -> Result<u32, Refused> {
            let value = values.get(name).and_then(|v| v.parse().ok());
            value.ok_or_else(|| foreign(origin, name))
        };
        let format = number("format")?;
        if format != FORMAT {
            return Err(Refused(format!(
                "{origin}: recorded in format {format}, this program reads format {FORMAT}; record it again"
            )));
        }
        let (vessel_id, id) = (number("vessel_id")?, number("drone_id")?);
        let mut boots = [0; NODES.len()];
        for (boot, node) in boots.iter_mut().zip(NODES) {
            *boot = number(&super::boot(node))?;
        }
        let [v, b, p, m, l, t] = boots;
        let refused = |e: config::ConfigError| Refused(e.to_string());
        let vessel: VesselNodeConfig =
            config::parse(&text(VESSEL_FILE)?, &format!("{origin}, {VESSEL_FILE}")).map_err(refused)?;
        let DroneFile { bridge, drone } =
            config::parse(&text(DRONE_FILE)?, &format!("{origin}, {DRONE_FILE}")).map_err(refused)?;
        Ok(Nodes {
            vessel: VesselNode::new(&vessel, vessel_id, v),
            bridge: Bridge::new(&bridge, b),
            predictor: Predictor::new(&drone.predictor(), p),
            mission: Mission::new(&drone.mission(), &drone.airframe, &drone.deck, id, m),
            planner: Planner::new(&drone.planner, &drone.airframe, &drone.deck, l),
            pilot: Pilot::new(&drone.pilot, &drone.airframe, id, t),
            computed: Computed::default(),
        })
    }

    /// One recorded step of node `k` of [`NODES`]; is its output the same?
    fn step(&mut self, k: usize, bytes: &[u8]) -> Result<bool, WireError> {
        let computed = &mut self.computed;
        match k {
            0 => same(&mut self.vessel, bytes, Ok).map(|(same, _)| same),
            1 => same(&mut self.bridge, bytes, Ok).map(|(same, _)| same),
            2 => {
                let (same, output) = same(&mut self.predictor, bytes, |i: PredictorIn| {
                    computed.drone(i.drone);
                    Ok(i)
                })?;
                computed.forecast(output.and_then(|o| o.forecast));
                Ok(same)
            }
            3 => same(&mut self.mission, bytes, |i: MissionEntry| i.input(computed)).map(|(same, _)| same),
            4 => {
                let (same, output) = same(&mut self.planner, bytes, |i: PlannerEntry| i.input(computed))?;
                computed.plan(output.and_then(|o| o.plan));
                Ok(same)
            }
            _ => {
                same(&mut self.pilot, bytes, |i: PilotEntry<Vec<_>>| i.input(computed)).map(|(same, _)| same)
            }
        }
    }
}

fn foreign(origin: &str, what: &str) -> Refused {
    Refused(format!(
        "{origin}: not a recording of `alight --record`: `{what}` is missing in it"
    ))
}

/// Feeds one entry to a node. An input that names a forecast or plan that the replay has not
/// computed is a difference.
fn same<N, I>(
    node: &mut N,
    bytes: &[u8],
    input: impl FnOnce(I) -> Result<N::In, Missing>,
) -> Result<(bool, Option<N::Out>), WireError>
where
    N: Node<Out: Serialize>,
    I: DeserializeOwned,
{
    let entry: Entry<I> = wire::decode_record(bytes)?;
    let Ok(input) = input(entry.input) else {
        return Ok((false, None));
    };
    let output = node.step(Time::from_nanos(entry.now_ns), &input);
    Ok((wire::hash_record(&output)? == entry.output, Some(output)))
}
