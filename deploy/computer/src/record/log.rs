//! Log of a flight: its directory, one of its files, or a recording, which is the flight in one file.

use std::{
    collections::VecDeque,
    path::{Path, PathBuf},
};

use alight_shared::{
    config::{self, Check},
    process::ProcessKind,
    time::{Span, Time, TrueTime, WorldTime},
    wire::WireError,
};
use alight_transport::clock::ProcessClock;
use serde::{Deserialize, de::DeserializeOwned};

use crate::{
    exit::CliError,
    record::{
        About, LIVE,
        entry::PartHeader,
        reading::{LogBeginning, LogFile, LogStep, parse_name, parts, read_header},
    },
};

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProcessStart {
    pub header: PartHeader,
    /// Files with its steps, in order.
    pub files: Vec<PathBuf>,
}

impl ProcessStart {
    pub fn name(&self) -> String {
        format!("{}-{:08x}", self.header.process, self.header.boot)
    }
    pub fn config<C: Check + DeserializeOwned>(&self) -> Result<C, CliError> {
        let file = self.files.first().map_or(Path::new(""), PathBuf::as_path);
        let origin = format!("{}, the {}'s configuration", file.display(), self.header.process);
        Ok(config::parse(&self.header.config, &origin)?)
    }
    pub fn clock(&self) -> ProcessClock {
        #[derive(Default, Deserialize)]
        #[serde(default)]
        struct Clocked {
            clock: ProcessClock,
        }
        // A world's configuration has no such clock: the steady clock applies.
        toml::from_str(&self.header.config).map_or_else(|_| ProcessClock::default(), |c: Clocked| c.clock)
    }
    fn is_of(&self, header: &PartHeader) -> bool {
        (&self.header.process, self.header.boot) == (&header.process, header.boot)
    }
    pub fn kind(&self) -> Option<ProcessKind> {
        ProcessKind::named(&self.header.process)
    }
    /// Order among entries of equal time: the world, then the rows in data-flow order.
    pub fn rank(&self) -> Option<usize> {
        let kind = self.kind()?;
        let rows = alight_usv::computer::PROCESSES.iter();
        rows.chain(alight_uav::computer::PROCESSES)
            .position(|row| *row == kind)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReplayOrder {
    /// One start after the other, with one file at a time in memory.
    ByStart,
    ByTime,
}

pub struct Log {
    path: PathBuf,
    /// Starts by process name, then in order; in a recording, in data-flow order.
    pub starts: Vec<ProcessStart>,
    /// Metadata of the recording; empty for a flight's directory and for a part.
    pub about: About,
    is_recording: bool,
}

impl Log {
    /// Opens the log at `path`. In a directory, a part that was cut off before its first step is ignored.
    pub fn open(path: &Path) -> Result<Log, CliError> {
        let mut log = Log {
            path: path.into(),
            starts: Vec::new(),
            about: About::default(),
            is_recording: false,
        };
        if path.is_dir() {
            log.starts = starts(parts(path)?)?;
            return Ok(log);
        }
        let found = LogBeginning::read(path)?.begun(path)?;
        log.starts = found
            .headers
            .into_iter()
            .map(|header| ProcessStart {
                header,
                files: vec![path.into()],
            })
            .collect();
        log.is_recording = !found.about.values.is_empty();
        log.about = found.about;
        Ok(log)
    }
    pub fn path(&self) -> &Path {
        &self.path
    }
    pub fn is_recording(&self) -> bool {
        self.is_recording
    }
    /// Whether steps have the time of a simulated world in addition to the node's own time.
    fn has_world_time(&self) -> bool {
        self.is_recording || !self.is_live()
    }
    /// Whether the nodes were processes, which begin by waiting for a predecessor's checkpoint.
    pub fn is_live(&self) -> bool {
        self.about.values.get(LIVE).is_none_or(|v| v != "0")
    }
    /// Text attached to a recording; empty if absent.
    pub fn text(&self, name: &str) -> &str {
        self.about.texts.get(name).map_or("", String::as_str)
    }
    pub fn find(&self, process: &str) -> Option<&ProcessStart> {
        self.starts.iter().find(|s| s.header.process == process)
    }
    pub fn first(&self, process: &str) -> Result<&ProcessStart, CliError> {
        self.find(process).ok_or_else(|| {
            CliError(format!(
                "{}: holds no step of the {process}'s process; its files are {process}-*.mcap",
                self.path.display()
            ))
        })
    }
    pub fn utc_ahead(&self) -> Result<Span, CliError> {
        for start in self.starts.iter().filter(|s| s.rank().is_some()) {
            if let Some(step) = Steps::of(&start.files)?.peek() {
                let utc: WorldTime = Time::from_nanos(i64::try_from(step.log_ns).unwrap_or(0));
                return Ok(utc - start.clock().steady::<TrueTime>(step.now_ns()));
            }
        }
        Ok(Span::from_nanos(0))
    }
    pub fn only(mut self, processes: &[&str]) -> Log {
        self.starts
            .retain(|s| processes.contains(&s.header.process.as_str()));
        self
    }
    /// Every step with the index of its start and its true time (in a recording, the recording's time).
    pub fn steps(
        &self,
        order: ReplayOrder,
        mut each: impl FnMut(usize, WorldTime, &LogStep<'_>) -> Result<(), WireError>,
    ) -> Result<(), CliError> {
        let all: Vec<&ProcessStart> = self.starts.iter().collect();
        let groups: Vec<&[&ProcessStart]> = match order {
            // In a recording all starts are in the same file.
            _ if self.is_recording() => all.chunks(1).take(1).collect(),
            ReplayOrder::ByStart => all.chunks(1).collect(),
            ReplayOrder::ByTime => vec![&all],
        };
        for group in groups {
            let open = |start: &&ProcessStart| Source::open(start, self.has_world_time());
            let mut sources = group.iter().map(open).collect::<Result<Vec<_>, CliError>>()?;
            while let Some(source) = sources
                .iter_mut()
                .filter(|s| s.due.is_some())
                .min_by_key(|s| s.due)
            {
                if let (Some((t, _)), Some(step)) = (source.due, source.steps.peek())
                    && let Some(at) = self.starts.iter().position(|s| s.is_of(step.header))
                {
                    each(at, t, &step).map_err(|e| {
                        let origin = self.path.display();
                        let process = &step.header.process;
                        CliError(format!(
                            "{origin}: the step of `{process}` at {:.2} s: {e}",
                            t.secs()
                        ))
                    })?;
                }
                source.advance()?;
            }
        }
        Ok(())
    }
}

/// Starts whose steps these parts hold, sorted by process name and then in order.
fn starts(parts: Vec<PathBuf>) -> Result<Vec<ProcessStart>, CliError> {
    let mut found = Vec::new();
    for part in parts {
        if let Some(header) = read_header(&part)? {
            let number = parse_name(&part).map_or(0, |(_, _, number)| number);
            found.push((
                (header.process.clone(), header.began_ns, header.boot, number),
                header,
                part,
            ));
        }
    }
    found.sort_by(|a, b| a.0.cmp(&b.0));
    let mut starts: Vec<ProcessStart> = Vec::new();
    for (_, header, part) in found {
        match starts.last_mut() {
            Some(last) if last.is_of(&header) => last.files.push(part),
            Some(_) | None => starts.push(ProcessStart {
                header,
                files: vec![part],
            }),
        }
    }
    Ok(starts)
}

/// Steps of several files in sequence, with one file at a time in memory.
struct Steps {
    waiting: VecDeque<PathBuf>,
    file: Option<LogFile>,
    at: usize,
}

impl Steps {
    fn of(files: &[PathBuf]) -> Result<Steps, CliError> {
        let mut steps = Steps {
            waiting: files.to_vec().into(),
            file: None,
            at: 0,
        };
        steps.load()?;
        Ok(steps)
    }
    fn peek(&self) -> Option<LogStep<'_>> {
        self.file.as_ref()?.step(self.at)
    }
    fn advance(&mut self) -> Result<(), CliError> {
        self.at += 1;
        self.load()
    }
    fn load(&mut self) -> Result<(), CliError> {
        while self.peek().is_none() {
            let Some(path) = self.waiting.pop_front() else {
                break;
            };
            self.file = Some(LogFile::open(&path)?);
            self.at = 0;
        }
        Ok(())
    }
}

struct Source {
    steps: Steps,
    /// Clock of a process; None for a simulated world, which has its own time.
    clock: Option<ProcessClock>,
    rank: Option<usize>,
    /// Time of the next step, and its rank among equal times.
    due: Option<(WorldTime, Option<usize>)>,
}

impl Source {
    fn open(start: &ProcessStart, has_world_time: bool) -> Result<Source, CliError> {
        let mut source = Source {
            steps: Steps::of(&start.files)?,
            clock: (!has_world_time).then(|| start.clock()),
            rank: start.rank(),
            due: None,
        };
        source.look();
        Ok(source)
    }
    fn advance(&mut self) -> Result<(), CliError> {
        self.steps.advance()?;
        self.look();
        Ok(())
    }
    fn look(&mut self) {
        let time = |step: LogStep<'_>| match &self.clock {
            Some(clock) => clock.steady(step.now_ns()),
            None => Time::from_nanos(i64::try_from(step.log_ns).unwrap_or(i64::MAX)),
        };
        self.due = self.steps.peek().map(|step| (time(step), self.rank));
    }
}
