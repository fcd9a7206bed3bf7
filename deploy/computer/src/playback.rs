//! Replay of a log: recorded inputs are passed to new nodes, outputs are compared bit for bit, and each step is shown
//! to observers.

use core::{any::Any, marker::PhantomData};

use alight_shared::{
    bus::{RowStep, Wired},
    geometry::{DeckGeometry, DroneGeometry},
    msg::ComputerReport,
    node::Node,
    process::ProcessKind,
    time::{Span, Time, WorldTime},
    wire::{self, WireError},
};
use alight_uav::{
    computer as uav,
    planner::{Planner, law::Law},
    predictor::Predictor,
    settings::DroneSettings,
};
use alight_usv::computer as usv;
use serde::{Serialize, de::DeserializeOwned};

use crate::{
    config::{DroneComputerConfig, VesselComputerConfig, view::ViewConfig},
    exit::{CliError, Doing},
    process::{
        supervision::{Observed, SupervisorNode},
        supervisor::SUPERVISOR,
    },
    record::{
        BASELINE_FILE, WORLD,
        entry::{self, Computed, Entry, PartHeader},
        log::{Log, ProcessStart, ReplayOrder},
        observer::StepObserver,
        reading::LogStep,
    },
    terminal::note,
};

/// Tick of a recording's times, as in lock-step, ns.
const TICK_NS: i64 = 10_000_000;

pub trait Plot: StepObserver {
    fn write(&self) -> Result<(), CliError>;
}

pub trait Viewer: StepObserver {
    /// Prints the addresses (`alone`: on standard error), opens a browser if this session has one, and waits for a
    /// viewer.
    fn begin(&self, alone: bool);
    /// Keeps the last picture of an ended flight on display for a little longer.
    fn linger(&self);
}

pub type Bodies = Option<(DeckGeometry, DroneGeometry)>;

/// Starts the view of a replayed flight under a name.
pub type StartViewer<'a> =
    &'a dyn Fn(&ViewConfig, &str, ComputerReport, Bodies) -> Result<Box<dyn Viewer>, CliError>;

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodeReplay {
    pub node: String,
    pub steps: u64,
    /// Time in a recording of the first step with a different output, s.
    pub differs_at_s: Option<f64>,
    pub differs_at_step: Option<u64>,
}

/// Builds the law of a recorded planner that the drone's program does not include, from the recording's text and the
/// settings.
pub type ForeignLaw<'a> = &'a dyn Fn(&str, &DroneSettings) -> Result<Option<Box<dyn Law>>, CliError>;

/// Process starts of the log's rows, in data-flow order; observers receive no others.
pub fn shown(log: &Log) -> Vec<PartHeader> {
    let mut rows: Vec<_> = log.starts.iter().filter(|s| s.rank().is_some()).collect();
    rows.sort_by_key(|s| s.rank());
    rows.into_iter().map(|s| s.header.clone()).collect()
}

/// Replays the log and shows each step to the observers, with its time moved by `shift`.
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
        // Topics for viewers are sampled on ticks; the step keeps the node's own time.
        let t = t + shift;
        let t = Time::from_nanos(t.nanos() - t.nanos().rem_euclid(TICK_NS));
        match &mut players[at] {
            Some(player) => player.step(t, step, &mut computed, &mut observers),
            None if log.starts[at].header.first_step == 0 => observers.recorded(t, step.header, step.bytes),
            None => Ok(()),
        }
    })?;
    let replayed: Vec<NodeReplay> = players.into_iter().flatten().map(|p| p.replayed).collect();
    if replayed.is_empty() || (log.is_recording() && replayed.iter().all(|r| r.steps == 0)) {
        return Err(CliError(format!(
            "{}: no process is recorded from its beginning, so none can be replayed; name the flight's directory",
            log.path().display()
        )));
    }
    Ok(replayed)
}

struct Player {
    /// None after the first step that is missing or has a different input.
    node: Option<Box<dyn Replayed>>,
    replayed: NodeReplay,
    has_time: bool,
}

impl Player {
    /// None for the world, and for a start whose input was only partly recorded.
    fn of(log: &Log, start: &ProcessStart, law: ForeignLaw<'_>) -> Result<Option<Player>, CliError> {
        let header = &start.header;
        let name = start.name();
        if header.process == WORLD {
            return Ok(None);
        }
        if let Some(why) = not_recorded(start)? {
            note(true, format!("{name}: {why}, and is not replayed"));
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
    /// Replays a step. A missing step ends the replay, because the node's state is unknown after it.
    fn step(
        &mut self,
        t: WorldTime,
        step: &LogStep<'_>,
        computed: &mut Computed,
        observers: &mut dyn StepObserver,
    ) -> Result<(), WireError> {
        let (replayed, Some(node)) = (&mut self.replayed, &mut self.node) else {
            return Ok(());
        };
        if step.number != replayed.steps {
            let first = replayed.steps;
            let last = step.number.saturating_sub(1);
            note(
                true,
                format!(
                    "{}: steps {first} to {last} are missing: later steps are not replayed",
                    replayed.node
                ),
            );
            self.node = None;
            return Ok(());
        }
        if !node.step(t, step, computed, observers)? && replayed.differs_at_step.is_none() {
            replayed.differs_at_step = Some(step.number);
            replayed.differs_at_s = self.has_time.then(|| t.secs());
        }
        replayed.steps += 1;
        Ok(())
    }
}

/// Reason why a start cannot be replayed: a part of its input is not recorded.
fn not_recorded(start: &ProcessStart) -> Result<Option<String>, CliError> {
    let header = &start.header;
    let kind = start.kind();
    if header.first_step > 0 {
        return Ok(Some(format!("begins at step {}", header.first_step)));
    }
    if kind == Some(ProcessKind::Sensors) {
        let sources = start.config::<VesselComputerConfig>()?.sensor.sources;
        let signed = sources.into_iter().find(|s| !s.signing_key.is_empty());
        return Ok(signed.map(|s| {
            format!(
                "checks the signatures of {} with a key that no recording holds",
                s.name
            )
        }));
    }
    let of_images = [ProcessKind::Camera, ProcessKind::Uvdar]
        .map(Some)
        .contains(&kind);
    let by_hash = of_images && !start.config::<DroneComputerConfig>()?.recorder.images;
    Ok(by_hash.then(|| "has its images recorded by their hashes (recorder.images)".into()))
}

fn node(log: &Log, start: &ProcessStart, law: ForeignLaw<'_>) -> Result<Box<dyn Replayed>, CliError> {
    if start.header.process == SUPERVISOR {
        let limits = toml::from_str(&start.header.config).doing(start.name())?;
        return Ok(Box::new(SupervisorNode::new(limits)));
    }
    if let Some(kind) = start.kind()
        && log.about.foreign().contains(&kind)
    {
        let planner = kind == ProcessKind::Planner;
        return Ok(if planner {
            Box::new(Foreign::<Planner>(PhantomData))
        } else {
            Box::new(Foreign::<Predictor>(PhantomData))
        });
    }
    let beginning = Beginning { log, start, law };
    let found = start.kind().and_then(|kind| {
        uav::RowVisitor::visit(beginning, kind).or_else(|| usv::RowVisitor::visit(beginning, kind))
    });
    found.unwrap_or_else(|| {
        Err(CliError(format!(
            "{}: steps of a process {:?}, which this program does not have",
            log.path().display(),
            start.header.process
        )))
    })
}

#[derive(Clone, Copy)]
struct Beginning<'a> {
    log: &'a Log,
    start: &'a ProcessStart,
    law: ForeignLaw<'a>,
}

type MadeNode = Result<Box<dyn Replayed>, CliError>;

impl usv::RowVisitor for Beginning<'_> {
    type Found = MadeNode;
    fn row<N: usv::Installed + 'static>(self) -> MadeNode {
        let nodes = self.start.config::<VesselComputerConfig>()?.nodes();
        let node = N::installed(&nodes, self.start.header.boot);
        Ok(Box::new(ReplayedNode { node, kind: N::KIND }))
    }
}

impl uav::RowVisitor for Beginning<'_> {
    type Found = MadeNode;
    fn row<N: uav::Installed + 'static>(self) -> MadeNode {
        let log = self.log;
        let boot = self.start.header.boot;
        let computer: DroneComputerConfig = self.start.config()?;
        let nodes = computer.nodes();
        let own = &computer.drone;
        // The first start in a simulated world does not wait for a predecessor's checkpoint.
        let succeeds = log.is_live() || log.find(&self.start.header.process) != Some(self.start);
        let mut other: Option<Box<dyn Any>> = None;
        if N::KIND == ProcessKind::Mission && !succeeds {
            other = Some(Box::new(nodes.mission(boot)));
        }
        if N::KIND == ProcessKind::Planner
            && let Some(law) = (self.law)(log.text(BASELINE_FILE), own)?
        {
            let planner = Planner::with_law(law, &own.planner, &own.airframe, &own.deck, boot);
            other = Some(Box::new(planner));
        }
        let other = other.and_then(|node| node.downcast::<N>().ok());
        let node = other.map_or_else(|| N::installed(&nodes, boot), |node| *node);
        Ok(Box::new(ReplayedNode { node, kind: N::KIND }))
    }
}

trait Replayed {
    /// Replays one recorded step; true if the output is the same. An input with a forecast or plan that the replay
    /// has not computed counts as a difference.
    fn step(
        &mut self,
        t: WorldTime,
        step: &LogStep<'_>,
        computed: &mut Computed,
        observers: &mut dyn StepObserver,
    ) -> Result<bool, WireError>;
}

struct ReplayedNode<N> {
    node: N,
    kind: ProcessKind,
}

impl<N: Wired> Replayed for ReplayedNode<N> {
    fn step(
        &mut self,
        t: WorldTime,
        step: &LogStep<'_>,
        computed: &mut Computed,
        observers: &mut dyn StepObserver,
    ) -> Result<bool, WireError> {
        let Entry {
            now_ns,
            mut input,
            references,
            output,
        } = step.entry::<N::In>()?;
        let mut is_whole = true;
        N::read_parts(&mut input, &mut |part| {
            is_whole &= computed.fill(part, references).is_ok()
        });
        if !is_whole {
            return Ok(false);
        }
        let at = Time::from_nanos(now_ns);
        let out = self.node.step(at, &input);
        N::written_parts(&out, &mut |part| computed.keep(part));
        let made: RowStep<N> = RowStep {
            at,
            took: Span::ZERO,
            worked: true,
            input,
            out,
        };
        observers.step(t, &made.of(self.kind, step.header.boot));
        Ok(entry::hash(&made.out, &mut computed.scratch)? == output)
    }
}

/// Steps of a planner or predictor that was another program: its recorded outputs.
struct Foreign<N>(PhantomData<N>);

impl<N: uav::Installed> Replayed for Foreign<N>
where
    N::Out: DeserializeOwned,
{
    fn step(
        &mut self,
        t: WorldTime,
        step: &LogStep<'_>,
        computed: &mut Computed,
        observers: &mut dyn StepObserver,
    ) -> Result<bool, WireError> {
        let entry = step.entry::<N::Out>()?;
        N::written_parts(&entry.input, &mut |part| computed.keep(part));
        let made: RowStep<N> = RowStep {
            at: Time::from_nanos(entry.now_ns),
            took: Span::ZERO,
            worked: true,
            input: N::In::default(),
            out: entry.input,
        };
        observers.step(t, &made.of(N::KIND, step.header.boot));
        Ok(entry::hash(&made.out, &mut computed.scratch)? == entry.output)
    }
}

/// The supervisor's steps are not shown, because it is not a row.
impl Replayed for SupervisorNode {
    fn step(
        &mut self,
        _t: WorldTime,
        step: &LogStep<'_>,
        _computed: &mut Computed,
        _observers: &mut dyn StepObserver,
    ) -> Result<bool, WireError> {
        let entry = step.entry::<Vec<Observed>>()?;
        let output = Node::step(self, Time::from_nanos(entry.now_ns), &entry.input);
        Ok(wire::hash_record(&output)? == entry.output)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use alight_shared::{config, time::DroneTime};
    use alight_uav::camera::{CameraFrame, CameraIn, CameraNode, GreyImage};
    use alight_usv::sensors::{SensorNode, SensorsIn};

    use super::*;
    use crate::{record::flight::recorder::NodeRecorder, scratch::scratch, vessel::sensors};
    use std::fs;

    fn record<N: Wired>(
        directory: &Path,
        (kind, boot): (ProcessKind, u32),
        config: &str,
        mut node: N,
        inputs: &[N::In],
    ) {
        let header = PartHeader {
            process: kind.name().into(),
            boot,
            config: config.into(),
            ..PartHeader::default()
        };
        let mut recorder = NodeRecorder::begin(directory, header);
        for (k, input) in (1..).zip(inputs) {
            let now_ns = k * 20_000_000;
            let out = node.step(Time::from_nanos(now_ns), input);
            recorder.step(now_ns, now_ns, input, &out);
        }
    }
    fn image(k: i64) -> CameraIn {
        let level = |p: usize| (p / 7 + k as usize) as u8;
        let image = GreyImage::new(640, 480, (0..640 * 480).map(level).collect()).unwrap();
        let at = DroneTime::from_nanos(k * 20_000_000);
        CameraIn {
            frames: vec![CameraFrame { at, image }],
            exposed: None,
        }
    }

    #[test]
    fn replay_of_sensors_and_cameras() {
        const KEY: &str = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let directory = scratch("rows");
        fs::create_dir_all(&directory).unwrap();
        let key = directory.join("key");
        fs::write(&key, KEY).unwrap();
        let source = "[[sensor.sources]]\nname = \"mast\"\nconnect = \"udpin://127.0.0.1:9\"\n";
        let signed = format!(
            "{source}format = \"mavlink\"\nsigning_key = \"{}\"\n",
            key.display()
        );
        let sentence = |k: i64| SensorsIn {
            bytes: vec![format!("$HEHDT,{}.0,T*{:02X}\r\n", k, 0x1A).into_bytes()],
            ..SensorsIn::default()
        };
        let sentences: Vec<SensorsIn> = (1..6).map(sentence).collect();
        for (boot, text) in [(1, source), (2, &signed)] {
            let computer = config::parse(text, "vessel").unwrap();
            let node: SensorNode = sensors::node(&computer, boot).unwrap();
            record(&directory, (ProcessKind::Sensors, boot), text, node, &sentences);
        }
        for (boot, keeps) in [(1, true), (2, false)] {
            let text = format!("[recorder]\nimages = {keeps}\n");
            let computer: DroneComputerConfig = config::parse(&text, "drone").unwrap();
            let mut images: Vec<CameraIn> = (1..4).map(image).collect();
            if keeps {
                for i in &mut images {
                    i.frames[0].image.keep();
                }
            }
            let node = <CameraNode as uav::Installed>::installed(&computer.nodes(), boot);
            record(&directory, (ProcessKind::Camera, boot), &text, node, &images);
        }
        let log = Log::open(&directory).unwrap();
        let replayed = replay(&log, &|_, _| Ok(None), Span::ZERO, Vec::new()).unwrap();
        let found: Vec<_> = replayed
            .iter()
            .map(|r| (r.node.as_str(), r.steps, r.differs_at_step))
            .collect();
        assert_eq!(
            found,
            [("camera-00000001", 3, None), ("sensors-00000001", 5, None)]
        );

        let why = |k: usize| not_recorded(&log.starts[k]).unwrap().unwrap_or_default();
        assert!(
            why(1).contains("recorder.images") && why(3).contains("signatures of mast"),
            "{}",
            why(3)
        );
        let secret: Vec<u8> = (0..32)
            .map(|k| u8::from_str_radix(&KEY[2 * k..2 * k + 2], 16).unwrap())
            .collect();
        let holds = |bytes: &[u8], part: &[u8]| bytes.windows(part.len()).any(|w| w == part);
        log.steps(ReplayOrder::ByStart, |_, _, step| {
            for bytes in [step.bytes, step.header.config.as_bytes()] {
                assert!(!holds(bytes, &secret) && !holds(bytes, KEY.as_bytes()));
            }
            Ok(())
        })
        .unwrap();
        fs::remove_dir_all(&directory).unwrap();
    }
}
