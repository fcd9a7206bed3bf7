//! Export of a flight to one file: every node's step to its own channel, and views for people.

use std::collections::BTreeMap;
use std::path::Path;

use alight_shared::time::{Time, TrueTime};
use alight_shared::wire::{self, WireError};
use mcap::McapError;
use serde::Serialize;

use crate::exit::CliError;
use crate::record::entry::{Computed, Entry, Input, NewestHeader, PartHeader, References};
use crate::record::observer::{NodeStep, StepObserver};
use crate::record::sink::{ChannelId, Sink, TakeMessages, unwritable};
use crate::record::views::{Views, stamp};
use crate::record::{About, RECORDING};

/// Writes the steps of a log that is computed again.
pub struct Recorder {
    pub sink: Sink,
    /// Topics for people.
    pub views: Views,
    /// Writers of each start.
    channels: Vec<((String, u32), ChannelId)>,
    /// Writer of the start whose step comes next.
    current: ChannelId,
    newest: NewestHeader,
    written: Computed,
    failed: Option<WireError>,
}

fn named(values: &[(&str, String)]) -> BTreeMap<String, String> {
    let named = |(name, value): &(&str, String)| (name.to_string(), value.clone());
    values.iter().map(named).collect()
}

impl Recorder {
    /// Creates the file of these starts, with its metadata and the channels that `more` opens.
    pub fn create<T>(
        path: &Path,
        headers: &[PartHeader],
        about: &About,
        more: impl FnOnce(&mut Sink) -> Result<T, McapError>,
    ) -> Result<(Recorder, T), CliError> {
        let create = || -> Result<(Recorder, T), McapError> {
            let mut sink = Sink::create(path)?;
            sink.metadata(RECORDING, about.values.clone())?;
            for (name, text) in &about.texts {
                sink.attach(name, text)?;
            }
            let starts = headers.iter().map(|h| (h.process.clone(), h.boot));
            let channels = starts.zip(sink.processes(headers)?).collect();
            let (views, more) = (Views::new(&mut sink)?, more(&mut sink)?);
            let recorder = Recorder {
                sink,
                views,
                channels,
                current: ChannelId::default(),
                newest: NewestHeader::default(),
                written: Computed::default(),
                failed: None,
            };
            Ok((recorder, more))
        };
        create()
            .map_err(|e| CliError::because(format!("recording to {}", path.display()), unwritable(path, &e)))
    }

    /// Whether the file can be written, for a command that would else find out after the flight.
    pub fn check(path: &Path) -> Result<(), CliError> {
        let begun = Sink::create(path).map(drop);
        begun.map_err(|e| CliError::because(format!("recording to {}", path.display()), unwritable(path, &e)))
    }
    fn entry(&mut self, t: Time<TrueTime>, now_ns: i64, input: &impl Input, output: &impl Serialize) {
        let mut input = input.clone();
        let references = References::take(&mut input, &mut self.newest, &self.written);
        let wrote = wire::hash_record(output).and_then(|output| {
            let entry = Entry {
                now_ns,
                input,
                references,
                output,
            };
            self.sink
                .message(self.current, stamp(t), |to| wire::append_record(to, &entry))
        });
        if let Err(e) = wrote {
            self.failed.get_or_insert(e);
        }
    }

    /// Ends the recording with what came out of the flight.
    pub fn finish(mut self, path: &Path, outcome: &[(&str, String)]) -> Result<(), CliError> {
        let doing = format_args!("recording to {}", path.display());
        let ended = self.sink.metadata("outcome", named(outcome));
        let written = self.sink.finish().and(ended);
        written.map_err(|e| CliError::because(doing, unwritable(path, &e)))?;
        match self.failed {
            Some(e) => Err(CliError::because(doing, e)),
            None => Ok(()),
        }
    }
}

impl StepObserver for Recorder {
    fn of(&mut self, process: &str, boot: u32) {
        let own = |((of, number), _): &&((String, u32), ChannelId)| of == process && *number == boot;
        self.current = self.channels.iter().find(own).map_or(self.current, |(_, c)| *c);
    }
    fn step(&mut self, t: Time<TrueTime>, step: NodeStep<'_>) {
        match step {
            NodeStep::Vessel(now, i, o) => self.entry(t, now.nanos(), i, o),
            NodeStep::Bridge(now, i, o) => self.entry(t, now.nanos(), i, o),
            NodeStep::Predictor(now, i, o) => self.entry(t, now.nanos(), i, o),
            NodeStep::Mission(now, i, o) => self.entry(t, now.nanos(), i, o),
            NodeStep::Planner(now, i, o) => self.entry(t, now.nanos(), i, o),
            NodeStep::Pilot(now, i, o) => self.entry(t, now.nanos(), i, o),
        }
        self.written.keep(&step);
        self.views.step(&mut self.sink, t, step);
    }
}
