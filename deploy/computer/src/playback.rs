//! A log computed again: recorded inputs through new nodes, outputs compared bit for bit, each step shown.

use alight_bridge::Bridge;
use alight_shared::geometry::{DeckGeometry, DroneGeometry};
use alight_shared::msg::ComputerReport;
use alight_shared::node::Node;
use alight_shared::time::{Span, Time, TrueTime};
use alight_shared::wire::{self, WireError};
use alight_uav::autopilot::AutopilotLink;
use alight_uav::computer::Installed as _;
use alight_uav::mission::MissionNode;
use alight_uav::pilot::Pilot;
use alight_uav::planner::Planner;
use alight_uav::planner::law::Law;
use alight_uav::predictor::Predictor;
use alight_uav::settings::DroneSettings;
use alight_usv::VesselComputer;
use alight_usv::computer::Installed as _;
use serde::Serialize;

use crate::config::view::ViewConfig;
use crate::config::{DroneComputerConfig, VesselComputerConfig};
use crate::exit::{CliError, Doing};
use crate::process::supervision::{Observed, SupervisorNode};
use crate::process::supervisor::SUPERVISOR;
use crate::record::entry::{Computed, Entry, Input, PartHeader};
use crate::record::log::{Log, ProcessStart, ReplayOrder};
use crate::record::observer::{NodeStep, StepObserver};
use crate::record::reading::LogStep;
use crate::record::{BASELINE_FILE, NODES, WORLD};
use crate::terminal::note;

/// The tick of a recording's times, as in lock-step, ns.
const TICK_NS: i64 = 10_000_000;

/// Draws a flight that is computed again.
pub trait Plot: StepObserver {
    /// Writes what it was shown to its file.
    fn write(&self) -> Result<(), CliError>;
}

/// Shows a flight to people while it is computed, held back to real time.
pub trait Viewer: StepObserver {
    /// The flight has ended: whoever looks on sees its last picture for a little longer.
    fn linger(&self);
}

/// Deck and drone, where they are known.
pub type Bodies = Option<(DeckGeometry, DroneGeometry)>;

/// Starts the view of a flight that is computed, under a name; also gives the lines with its addresses.
pub type StartViewer<'a> =
    &'a dyn Fn(&ViewConfig, &str, ComputerReport, Bodies) -> Result<(Box<dyn Viewer>, Vec<String>), CliError>;

/// Result of one node's replay.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodeReplay {
    pub node: String,
    /// Steps replayed.
    pub steps: u64,
    /// A recording's time of the first step whose output differs, s.
    pub differs_at_s: Option<f64>,
    /// The number of that step, from 0 on.
    pub differs_at_step: Option<u64>,
}

/// The law of a recorded planner that the drone does not carry, from what a recording has of it.
pub type ForeignLaw<'a> = &'a dyn Fn(&str, &DroneSettings) -> Result<Option<Box<dyn Law>>, CliError>;

/// The starts of a log that observers are shown: those of the nodes.
pub fn shown(log: &Log) -> Vec<PartHeader> {
    let of = |node: &'static str| log.starts.iter().filter(move |s| s.header.process == node);
    NODES.into_iter().flat_map(of).map(|s| s.header.clone()).collect()
}

/// Replays the log before the eyes of who looks on, to whom its times are moved by `shift`.
pub fn replay(
    log: &Log,
    law: ForeignLaw<'_>,
    shift: Span,
    mut observers: Vec<&mut dyn StepObserver>,
) -> Result<Vec<NodeReplay>, CliError> {
    let order = if observers.is_empty() {
        ReplayOrder::ByStart
    } else {
        ReplayOrder::ByTime
    };
    let player = |start| Player::of(log, start, law);
    let mut players = log.starts.iter().map(player).collect::<Result<Vec<_>, _>>()?;
    let mut computed = Computed::default();
    log.steps(order, |at, t, step| {
        // The topics for people are thinned out on ticks; the node's own time is in the step.
        let t = t + shift;
        let t = Time::from_nanos(t.nanos() - t.nanos().rem_euclid(TICK_NS));
        match &mut players[at] {
            _ if step.header.process == WORLD => observers.world(t, step.bytes),
            Some(player) => player.step(t, step, &mut computed, &mut observers),
            None => Ok(()),
        }
    })?;
    let replayed: Vec<NodeReplay> = players.into_iter().flatten().map(|p| p.replayed).collect();
    if replayed.is_empty() || (log.is_recording() && replayed.iter().all(|r| r.steps == 0)) {
        return Err(CliError(format!(
            "{}: no process is recorded from its beginning, and none can be computed again; name the flight's directory",
            log.path().display()
        )));
    }
    Ok(replayed)
}

/// A start of a process that is computed again.
struct Player {
    /// None: not any further.
    node: Option<Box<dyn Replayed>>,
    replayed: NodeReplay,
    has_time: bool,
}

impl Player {
    /// None of the world, and of a start whose beginning is gone.
    fn of(log: &Log, start: &ProcessStart, law: ForeignLaw<'_>) -> Result<Option<Player>, CliError> {
        let (header, name) = (&start.header, start.name());
        if header.process == WORLD {
            return Ok(None);
        }
        if header.first_step > 0 {
            let first = header.first_step;
            note(
                true,
                format!("{name}: begins at step {first}, and is not computed again"),
            );
            return Ok(None);
        }
        let has_time = log.is_recording();
        Ok(Some(Player {
            node: Some(node(log, start, law)?),
            replayed: NodeReplay {
                node: if has_time && log.find(&header.process) == Some(start) {
                    header.process.clone()
                } else {
                    name
                },
                steps: 0,
                differs_at_s: None,
                differs_at_step: None,
            },
            has_time,
        }))
    }
    /// A step: up to the first that is missing, without which the node's state is not known.
    fn step(
        &mut self,
        t: Time<TrueTime>,
        step: &LogStep<'_>,
        computed: &mut Computed,
        observers: &mut dyn StepObserver,
    ) -> Result<(), WireError> {
        let (replayed, Some(node)) = (&mut self.replayed, &mut self.node) else {
            return Ok(());
        };
        if step.number != replayed.steps {
            let (first, last) = (replayed.steps, step.number.saturating_sub(1));
            note(
                true,
                format!(
                    "{}: steps {first} to {last} are missing: the steps after them are not computed again",
                    replayed.node
                ),
            );
            self.node = None;
            return Ok(());
        }
        observers.of(&step.header.process, step.header.boot);
        if !node.step(t, step.bytes, computed, observers)? && replayed.differs_at_step.is_none() {
            replayed.differs_at_step = Some(step.number);
            replayed.differs_at_s = self.has_time.then(|| t.secs());
        }
        replayed.steps += 1;
        Ok(())
    }
}

/// The node of a start as it began.
fn node(log: &Log, start: &ProcessStart, law: ForeignLaw<'_>) -> Result<Box<dyn Replayed>, CliError> {
    let boot = start.header.boot;
    // The first start in a simulated world waits for no predecessor's checkpoint.
    let succeeds = log.is_live() || log.find(&start.header.process) != Some(start);
    let drone = || start.config::<DroneComputerConfig>();
    Ok(match start.header.process.as_str() {
        "vessel" => {
            let nodes = start.config::<VesselComputerConfig>()?.nodes();
            let node = VesselComputer::installed(&nodes, boot);
            ReplayedNode::of(node, |now, i, o| NodeStep::Vessel(now, i, o))
        }
        "bridge" => {
            let node = Bridge::installed(&drone()?.nodes(), boot);
            ReplayedNode::of(node, |now, i, o| NodeStep::Bridge(now, i, o))
        }
        "predictor" => {
            let node = Predictor::installed(&drone()?.nodes(), boot);
            ReplayedNode::of(node, |now, i, o| NodeStep::Predictor(now, i, o))
        }
        "mission" => {
            let drone = drone()?;
            let node = match succeeds {
                true => MissionNode::installed(&drone.nodes(), boot),
                false => drone.nodes().mission(boot),
            };
            ReplayedNode::of(node, |now, i, o| NodeStep::Mission(now, i, o))
        }
        "planner" => {
            let drone = drone()?;
            let own = &drone.drone;
            let node = match law(log.text(BASELINE_FILE), own)? {
                None => Planner::installed(&drone.nodes(), boot),
                Some(law) => Planner::with_law(law, &own.planner, &own.airframe, &own.deck, boot),
            };
            ReplayedNode::of(node, |now, i, o| NodeStep::Planner(now, i, o))
        }
        "pilot" => {
            let node = Pilot::installed(&drone()?.nodes(), boot);
            ReplayedNode::of(node, |now, i, o| NodeStep::Pilot(now, i, o))
        }
        "autopilot" => Box::new(ReplayedNode {
            node: AutopilotLink::installed(&drone()?.nodes(), boot),
            show: None,
        }),
        SUPERVISOR => Box::new(ReplayedNode {
            node: SupervisorNode::new(toml::from_str(&start.header.config).doing(start.name())?),
            show: None,
        }),
        other => {
            return Err(CliError(format!(
                "{}: steps of a process {other:?}, which this program does not have",
                log.path().display()
            )));
        }
    })
}

impl Input for Vec<Observed> {}

/// A node that is computed again.
trait Replayed {
    /// One recorded step; whether its output is the same. An input that names a forecast or plan that the replay has
    /// not computed is a difference.
    fn step(
        &mut self,
        t: Time<TrueTime>,
        entry: &[u8],
        computed: &mut Computed,
        observers: &mut dyn StepObserver,
    ) -> Result<bool, WireError>;
}

/// Display of a node's step.
type Show<N> =
    for<'a> fn(Time<<N as Node>::Clock>, &'a <N as Node>::In, &'a <N as Node>::Out) -> NodeStep<'a>;

struct ReplayedNode<N: Node> {
    node: N,
    show: Option<Show<N>>,
}

impl<N: Node<In: Input, Out: Serialize> + 'static> ReplayedNode<N> {
    fn of(node: N, show: Show<N>) -> Box<dyn Replayed> {
        let show = Some(show);
        Box::new(ReplayedNode { node, show })
    }
}

impl<N: Node<In: Input, Out: Serialize>> Replayed for ReplayedNode<N> {
    fn step(
        &mut self,
        t: Time<TrueTime>,
        entry: &[u8],
        computed: &mut Computed,
        observers: &mut dyn StepObserver,
    ) -> Result<bool, WireError> {
        let mut entry: Entry<N::In> = wire::decode_record(entry)?;
        if computed.fill(&mut entry.input, entry.references).is_err() {
            return Ok(false);
        }
        let now = Time::from_nanos(entry.now_ns);
        let output = self.node.step(now, &entry.input);
        if let Some(show) = self.show {
            let step = show(now, &entry.input, &output);
            computed.keep(&step);
            observers.step(t, step);
        }
        Ok(wire::hash_record(&output)? == entry.output)
    }
}
