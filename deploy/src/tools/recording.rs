//! One recording made of a flight: the steps of its processes in the order of the one steady clock of this computer,
//! each computed again, with the views for people.

use std::path::Path;

use alight_bridge::Bridge;
use alight_shared::config;
use alight_shared::node::Node;
use alight_shared::time::{Span, Time, TrueTime};
use alight_shared::transport::clock::ProcessClock;
use alight_uav::mission::Mission;
use alight_uav::pilot::Pilot;
use alight_uav::planner::Planner;
use alight_uav::predictor::Predictor;
use serde::de::DeserializeOwned;

use crate::config::{DroneComputer, DroneFile, VesselComputer};
use crate::drone::mission::MissionShell;
use crate::drone::pilot::PilotShell;
use crate::drone::planner::PlannerShell;
use crate::drone::predictor::PredictorShell;
use crate::exit::{CliError, Doing};
use crate::process::shell::Shell;
use crate::record::flight::reading::{Start, Steps, starts};
use crate::record::{DECK_FILE, DRONE_FILE, LIVE, NODES, Recorder, VESSEL_FILE};

/// The tick of a recording's times, as in lock-step, ns.
const TICK_NS: i64 = 10_000_000;

/// Steps of one start of a process, read one by one.
pub struct StepStream<I> {
    steps: Steps,
    next: Option<(i64, I)>,
}

impl<I: DeserializeOwned> StepStream<I> {
    /// From the first on.
    pub fn of(start: &Start) -> Result<StepStream<I>, CliError> {
        let mut stream = StepStream {
            steps: Steps::of(start)?,
            next: None,
        };
        if stream.steps.header().first_step > 0 {
            return Err(CliError(format!(
                "{}: begins at step {} of the {}: what was before is gone, and it cannot be recorded",
                stream.steps.path().display(),
                stream.steps.header().first_step,
                start.process
            )));
        }
        stream.advance()?;
        Ok(stream)
    }
    /// Its time, ns, and what it holds.
    pub fn newest(&self) -> Option<(i64, &I)> {
        self.next.as_ref().map(|(ns, input)| (*ns, input))
    }
    /// To the next.
    pub fn advance(&mut self) -> Result<(), CliError> {
        let origin = self.steps.path().display().to_string();
        self.next = match self.steps.next()? {
            None => None,
            Some(step) => {
                let (now_ns, input, _) = step.entry().doing(format_args!("reading {origin}"))?;
                Some((now_ns, input))
            }
        };
        Ok(())
    }
}

/// What is recorded step by step to an `R`.
pub trait Playback<R> {
    /// True time of the next step.
    fn due(&self) -> Option<Time<TrueTime>>;
    /// Records the next step.
    fn play(&mut self, recorder: &mut R) -> Result<(), CliError>;
}

/// How a step is recorded.
pub type RecordStep<R, N> =
    fn(&mut R, Time<TrueTime>, Time<<N as Node>::Clock>, &<N as Node>::In, &<N as Node>::Out);

/// How each node's steps are recorded.
pub struct RecordSteps<R> {
    /// Of the vessel's computer.
    pub vessel: RecordStep<R, alight_usv::VesselComputer>,
    /// Of the bridge.
    pub bridge: RecordStep<R, Bridge>,
    /// Of the predictor.
    pub predictor: RecordStep<R, Predictor>,
    /// Of the mission.
    pub mission: RecordStep<R, Mission>,
    /// Of the planner.
    pub planner: RecordStep<R, Planner>,
    /// Of the pilot.
    pub pilot: RecordStep<R, Pilot>,
}

/// [`RecordSteps`] of a type with a method for each node.
macro_rules! record_steps {
    ($recorder:ty) => {
        $crate::tools::recording::RecordSteps {
            vessel: |r: &mut $recorder, t, now, i, o| r.vessel(t, now, i, o),
            bridge: |r: &mut $recorder, t, now, i, o| r.bridge(t, now, i, o),
            predictor: |r: &mut $recorder, t, now, i, o| r.predictor(t, now, i, o),
            mission: |r: &mut $recorder, t, now, i, o| r.mission(t, now, i, o),
            planner: |r: &mut $recorder, t, now, i, o| r.planner(t, now, i, o),
            pilot: |r: &mut $recorder, t, now, i, o| r.pilot(t, now, i, o),
        }
    };
}
pub(crate) use record_steps;

struct NodePlayback<N: Node, R> {
    node: N,
    stream: StepStream<N::In>,
    clock: ProcessClock,
    /// Added to the true time.
    shift: Span,
    show: RecordStep<R, N>,
}

impl<N: Node<In: DeserializeOwned>, R> Playback<R> for NodePlayback<N, R> {
    fn due(&self) -> Option<Time<TrueTime>> {
        let (now_ns, _) = self.stream.newest()?;
        Some(true_time(&self.clock, now_ns) + self.shift)
    }
    fn play(&mut self, recorder: &mut R) -> Result<(), CliError> {
        if let (Some(t), Some((now_ns, input))) = (self.due(), self.stream.newest()) {
            let now: Time<N::Clock> = Time::from_nanos(now_ns);
            let out = self.node.step(now, input);
            // Recordings have times in ticks, on which what a person looks at is thinned out; the node's own time is
            // in the step.
            let t = Time::from_nanos(t.nanos() - t.nanos().rem_euclid(TICK_NS));
            (self.show)(recorder, t, now, input, &out);
        }
        self.stream.advance()
    }
}

/// The true time at which a process's clock read `now_ns`.
fn true_time(clock: &ProcessClock, now_ns: i64) -> Time<TrueTime> {
    let ahead = Time::<TrueTime>::from_nanos(now_ns) - Span::from_secs(clock.offset_s);
    let drift = ahead.nanos() as f64 * clock.drift_ppm * 1e-6 / (1.0 + clock.drift_ppm * 1e-6);
    ahead - Span::from_nanos(drift.round() as i64)
}

/// The nodes of a flight, each in the first start of its process.
pub struct Nodes<R> {
    /// In the order of [`NODES`], without those of which nothing is recorded.
    pub playbacks: Vec<Box<dyn Playback<R>>>,
    /// Boot ids, in the order of [`NODES`].
    pub boots: [Option<u32>; NODES.len()],
    /// Processes that were started again, and are in it up to their first end.
    pub restarted: Vec<&'static str>,
}

/// Reads the nodes of the flight in `directory`, whose times are moved by `shift`.
pub fn nodes<R: 'static>(
    directory: &Path,
    (vessel, drone): (&VesselComputer, &DroneComputer),
    planner: impl FnOnce(u32) -> Planner,
    show: RecordSteps<R>,
    shift: Span,
) -> Result<Nodes<R>, CliError> {
    let all = starts(directory)?;
    let mut found = Nodes {
        playbacks: Vec::new(),
        boots: [None; NODES.len()],
        restarted: Vec::new(),
    };
    macro_rules! play {
        ($at:literal $node:ident, $clock:expr, $make:expr) => {{
            let own = |s: &&Start| s.process == stringify!($node);
            if let Some(start) = all.iter().find(own) {
                if all.iter().filter(own).count() > 1 {
                    found.restarted.push(stringify!($node));
                }
                found.boots[$at] = Some(start.boot);
                found.playbacks.push(Box::new(NodePlayback {
                    node: $make(start.boot),
                    stream: StepStream::of(start)?,
                    clock: $clock,
                    shift,
                    show: show.$node,
                }));
            }
        }};
    }
    play!(0 vessel, vessel.clock, |boot| vessel.node(boot));
    play!(1 bridge, drone.clock, |boot| Bridge::new(&drone.bridge, boot));
    play!(2 predictor, drone.clock, |boot| PredictorShell::node(drone, boot));
    play!(3 mission, drone.clock, |boot| MissionShell::node(drone, boot));
    play!(4 planner, drone.clock, planner);
    play!(5 pilot, drone.clock, |boot| PilotShell::node(drone, boot));
    Ok(found)
}

/// Plays all to their ends: equal times in the order of the data, the first of the earliest.
pub fn play<R>(mut all: Vec<Box<dyn Playback<R>>>, recorder: &mut R) -> Result<(), CliError> {
    while let Some((_, next)) = all
        .iter()
        .enumerate()
        .filter_map(|(k, p)| Some((p.due()?, k)))
        .min()
    {
        let Some(played) = all.get_mut(next) else { break };
        played.play(recorder)?;
    }
    Ok(())
}

/// The configuration that the first of these processes was started with; the default where there is none of them.
fn configuration<C>(all: &[Start], processes: &[&str]) -> Result<C, CliError>
where
    C: DeserializeOwned + config::Check + Default,
{
    let Some(start) = all.iter().find(|s| processes.contains(&s.process.as_str())) else {
        return Ok(C::default());
    };
    let steps = Steps::of(start)?;
    let origin = format!("{}, its configuration", steps.path().display());
    Ok(config::parse(&steps.header().config, &origin)?)
}

/// What UTC was ahead of the true time of a flight: recordings have people's time.
fn utc_ahead(all: &[Start], clock: &ProcessClock) -> Result<Span, CliError> {
    let Some(start) = all.iter().find(|s| NODES.contains(&s.process.as_str())) else {
        return Ok(Span::from_nanos(0));
    };
    let mut steps = Steps::of(start)?;
    let Some(step) = steps.next()? else {
        return Ok(Span::from_nanos(0));
    };
    // Of any step the time comes first.
    let now_ns = step
        .bytes
        .get(..8)
        .and_then(|b| b.try_into().ok())
        .map_or(0, i64::from_le_bytes);
    let utc: Time<TrueTime> = Time::from_nanos(i64::try_from(step.utc_ns).unwrap_or(0));
    Ok(utc - true_time(clock, now_ns))
}

/// Records to `path` what the processes of a flight recorded, for viewers; lines for people.
pub fn write(path: &Path, directory: &Path) -> Result<Vec<String>, CliError> {
    let all = starts(directory)?;
    let vessel: VesselComputer = configuration(&all, &["vessel"])?;
    let drone: DroneComputer = configuration(&all, &["bridge", "predictor", "mission", "planner", "pilot"])?;
    let aboard = all.iter().any(|s| s.process == "mission");
    let clock = if aboard { drone.clock } else { vessel.clock };
    let found = nodes(
        directory,
        (&vessel, &drone),
        |boot| PlannerShell::node(&drone, boot),
        record_steps!(Recorder),
        utc_ahead(&all, &clock)?,
    )?;
    if found.playbacks.is_empty() {
        return Err(CliError(format!(
            "{}: no node's steps to record",
            directory.display()
        )));
    }
    let doing = format_args!("recording to {}", path.display());
    let file = DroneFile {
        bridge: drone.bridge.clone(),
        drone: drone.drone.clone(),
    };
    let texts = [
        (VESSEL_FILE, toml::to_string(&vessel.vessel).doing(doing)?),
        (DECK_FILE, toml::to_string(&vessel.deck).doing(doing)?),
        (DRONE_FILE, toml::to_string(&file).doing(doing)?),
    ];
    let values = [
        ("vessel_id", vessel.vessel_id.to_string()),
        ("drone_id", drone.bridge.drone_id.to_string()),
        (LIVE, "1".into()),
    ];
    let boots = found.boots.map(Option::unwrap_or_default);
    let (mut recorder, ()) = Recorder::create(path, &texts, &values, boots, |_| Ok(()))?;
    play(found.playbacks, &mut recorder)?;
    recorder.finish(path, &[("flight", directory.display().to_string())])?;
    let mut lines = up_to_first_end(&found.restarted);
    lines.push(format!("recording: {}", path.display()));
    Ok(lines)
}

/// What is said of processes that were started again.
pub fn up_to_first_end(restarted: &[&str]) -> Vec<String> {
    let line = |process: &&str| format!("the recording of the {process} ends at its first exit");
    restarted.iter().map(line).collect()
}

/// The first start of a process in a flight's directory.
pub fn first_start(directory: &Path, process: &str) -> Result<Start, CliError> {
    let first = starts(directory)?.into_iter().find(|s| s.process == process);
    first.ok_or_else(|| {
        CliError(format!(
            "the {process} has recorded nothing in {}",
            directory.display()
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::DroneClock;

    #[test]
    fn true_time_of_a_clock() {
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
