//! `alight land --record`: one MCAP file made of what the processes and the world logged, in the
//! order of their steps on the one steady clock of this computer.

use std::path::{Path, PathBuf};

use alight_bridge::Bridge;
use alight_shared::node::Node;
use alight_shared::time::{Span, Time, TrueTime};
use alight_shared::transport::clock::ProcessClock;
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::tap::Tap;
use serde::de::DeserializeOwned;

use crate::config::{DroneComputer, VesselComputer};
use crate::drone::mission::MissionShell;
use crate::drone::pilot::PilotShell;
use crate::drone::predictor::PredictorShell;
use crate::exit::{CliError, Doing};
use crate::lab::live::truth::Truth;
use crate::lab::record::{FlightRecorder, Subject};
use crate::process::log::LogReader;
use crate::process::shell::Shell;
use crate::record::NODES;

/// A log that is read step by step.
struct LogStream<I> {
    log: LogReader,
    next: Option<(i64, I)>,
    path: PathBuf,
}

impl<I: DeserializeOwned> LogStream<I> {
    fn new(log: LogReader, path: &Path) -> Result<LogStream<I>, CliError> {
        let mut stream = LogStream {
            log,
            next: None,
            path: path.into(),
        };
        stream.advance()?;
        Ok(stream)
    }
    fn advance(&mut self) -> Result<(), CliError> {
        let step = self.log.step();
        let step = step.doing(format_args!("reading {}", self.path.display()))?;
        self.next = step.map(|(now_ns, input, _)| (now_ns, input));
        Ok(())
    }
}

/// A log whose steps are recorded one by one.
trait Playback {
    /// True time of the next step.
    fn due(&self) -> Option<Time<TrueTime>>;
    /// Records the next step.
    fn play(&mut self, recorder: &mut FlightRecorder) -> Result<(), CliError>;
}

/// How a step is recorded.
type RecordStep<N> =
    fn(&mut FlightRecorder, Time<TrueTime>, Time<<N as Node>::Clock>, &<N as Node>::In, &<N as Node>::Out);

struct NodePlayback<N: Node> {
    node: N,
    stream: LogStream<N::In>,
    clock: ProcessClock,
    show: RecordStep<N>,
}

impl<N: Node<In: DeserializeOwned>> Playback for NodePlayback<N> {
    fn due(&self) -> Option<Time<TrueTime>> {
        let (now_ns, _) = self.stream.next.as_ref()?;
        Some(true_time(&self.clock, *now_ns))
    }
    fn play(&mut self, recorder: &mut FlightRecorder) -> Result<(), CliError> {
        if let (Some(t), Some((now_ns, input))) = (self.due(), &self.stream.next) {
            let now: Time<N::Clock> = Time::from_nanos(*now_ns);
            let out = self.node.step(now, input);
            (self.show)(recorder, t, now, input, &out);
        }
        self.stream.advance()
    }
}

impl Playback for LogStream<Truth> {
    fn due(&self) -> Option<Time<TrueTime>> {
        self.next.as_ref().map(|(ns, _)| Time::from_nanos(*ns))
    }
    fn play(&mut self, recorder: &mut FlightRecorder) -> Result<(), CliError> {
        if let Some((ns, truth)) = &self.next {
            recorder.truth(Time::from_nanos(*ns), &truth.vessel(), truth.drone().as_ref());
        }
        self.advance()
    }
}

/// The true time at which a process's clock read `now_ns`.
fn true_time(clock: &ProcessClock, now_ns: i64) -> Time<TrueTime> {
    let ahead = Time::<TrueTime>::from_nanos(now_ns) - Span::from_secs(clock.offset_s);
    let drift = ahead.nanos() as f64 * clock.drift_ppm * 1e-6 / (1.0 + clock.drift_ppm * 1e-6);
    ahead - Span::from_nanos(drift.round() as i64)
}

/// The logs of a process in `directory`, the first start's first.
fn logs(directory: &Path, process: &str) -> Result<Vec<PathBuf>, CliError> {
    let entries =
        std::fs::read_dir(directory).doing(format_args!("reading the logs in {}", directory.display()))?;
    let mut found: Vec<_> = entries
        .flatten()
        .filter(|e| {
            e.file_name()
                .to_string_lossy()
                .starts_with(&format!("{process}-"))
        })
        .filter_map(|e| Some((e.metadata().ok()?.modified().ok()?, e.path())))
        .collect();
    found.sort();
    Ok(found.into_iter().map(|(_, path)| path).collect())
}

/// Opens the log of a process's first start.
fn open(directory: &Path, process: &str) -> Result<(LogReader, u32, PathBuf), CliError> {
    let first = logs(directory, process)?.into_iter().next();
    let path = first.ok_or_else(|| CliError(format!("the {process} has logged nothing to record")))?;
    let (log, head) = LogReader::open(&path).doing(format_args!("reading {}", path.display()))?;
    if head.first_step > 0 {
        return Err(CliError(format!(
            "{}: begins at step {} of the {process}: nothing before could be written, and it cannot be recorded",
            path.display(),
            head.first_step
        )));
    }
    Ok((log, head.boot, path))
}

/// Records to `path` what lies in `directory`. Processes that were started again are in it up to
/// then; gives their names.
pub fn write(
    path: &Path,
    directory: &Path,
    (vessel, drone): (&VesselComputer, &DroneComputer),
    mut subject: Subject<'_>,
    outcome: &Outcome,
) -> Result<Vec<&'static str>, CliError> {
    let (world, _, world_path) = open(directory, "world")?;
    let mut all: Vec<Box<dyn Playback>> = vec![Box::new(LogStream::<Truth>::new(world, &world_path)?)];
    let mut boots = Vec::new();
    macro_rules! play {
        ($node:ident, $clock:expr, $make:expr) => {{
            let (log, boot, path) = open(directory, stringify!($node))?;
            boots.push(boot);
            all.push(Box::new(NodePlayback {
                node: $make(boot),
                stream: LogStream::new(log, &path)?,
                clock: $clock,
                show: |r, t, now, i, o| r.$node(t, now, i, o),
            }));
        }};
    }
    play!(vessel, vessel.clock, |boot| vessel.node(boot));
    play!(bridge, drone.clock, |boot| Bridge::new(&drone.bridge, boot));
    play!(predictor, drone.clock, |boot| PredictorShell::node(drone, boot));
    play!(mission, drone.clock, |boot| MissionShell::node(drone, boot));
    play!(planner, drone.clock, |boot| subject.nodes.planner(boot));
    play!(pilot, drone.clock, |boot| PilotShell::node(drone, boot));

    for (to, boot) in subject.boots.iter_mut().zip(boots) {
        *to = boot;
    }
    let mut recorder = FlightRecorder::create(path, &subject)?;
    // Equal times in the order of the data: the first of the earliest.
    while let Some((_, next)) = all
        .iter()
        .enumerate()
        .filter_map(|(k, p)| Some((p.due()?, k)))
        .min()
    {
        let Some(played) = all.get_mut(next) else { break };
        played.play(&mut recorder)?;
    }
    recorder.finish(path, outcome)?;
    let mut restarted = Vec::new();
    for node in NODES {
        if logs(directory, node)?.len() > 1 {
            restarted.push(node);
        }
    }
    Ok(restarted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::DroneClock;

    #[test]
    fn true_time_is_the_clock_read_backwards() {
        let clock = ProcessClock {
            epoch_ns: 7_000_000_000,
            offset_s: 100.25,
            drift_ppm: 20.0,
        };
        let now: Time<DroneClock> = clock.read(7_000_000_000 + 90_000_000_000);
        let back = true_time(&clock, now.nanos());
        assert!((back.nanos() - 90_000_000_000).abs() <= 2, "{back:?}");
    }
}
