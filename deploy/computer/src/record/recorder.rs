//! Export of a flight to one file: every node's steps on a separate channel, and views for users.

use std::{collections::BTreeMap, path::Path};

use alight_shared::{process::ProcessKind, step::Step, time::WorldTime, wire::WireError};
use mcap::McapError;

use crate::{
    exit::CliError,
    record::{
        About, RECORDING,
        entry::{self, Computed, NewestHeader, PartHeader, References},
        messages::each_message,
        observer::StepObserver,
        sink::{ChannelId, Sink, TakeMessages, unwritable},
        views::{Views, stamp},
    },
};

pub struct Recorder {
    pub sink: Sink,
    pub views: Views,
    starts: Vec<(PartHeader, ChannelId)>,
    newest: NewestHeader,
    written: Computed,
    foreign: Vec<ProcessKind>,
    failed: Option<WireError>,
}

fn named(values: &[(&str, String)]) -> BTreeMap<String, String> {
    let named = |(name, value): &(&str, String)| (name.to_string(), value.clone());
    values.iter().map(named).collect()
}

impl Recorder {
    /// Creates the file with its metadata and the channels that `more` opens.
    pub fn create<T>(
        path: &Path,
        about: &About,
        more: impl FnOnce(&mut Sink) -> Result<T, McapError>,
    ) -> Result<(Recorder, T), CliError> {
        let create = || -> Result<(Recorder, T), McapError> {
            let mut sink = Sink::create(path)?;
            sink.metadata(RECORDING, about.values.clone())?;
            for (name, text) in &about.texts {
                sink.attach(name, text)?;
            }
            let views = Views::new(&mut sink)?;
            let more = more(&mut sink)?;
            let recorder = Recorder {
                sink,
                views,
                starts: Vec::new(),
                newest: NewestHeader::default(),
                written: Computed::default(),
                foreign: about.foreign(),
                failed: None,
            };
            Ok((recorder, more))
        };
        create()
            .map_err(|e| CliError::because(format!("recording to {}", path.display()), unwritable(path, &e)))
    }
    pub fn begin(&mut self, header: PartHeader) {
        match self.sink.process(&header, self.starts.iter().map(|(h, _)| h)) {
            Ok(channel) => self.starts.push((header, channel)),
            Err(e) => self.sink.fail(e),
        }
    }
    pub fn channel(&self, process: &str, boot: u32) -> Option<ChannelId> {
        let is_own = |(h, _): &&(PartHeader, ChannelId)| h.process == process && h.boot == boot;
        self.starts.iter().find(is_own).map(|(_, channel)| *channel)
    }

    /// Checks that the file can be written, for a command that would otherwise fail after the flight.
    pub fn check(path: &Path) -> Result<(), CliError> {
        let begun = Sink::create(path).map(drop);
        begun.map_err(|e| CliError::because(format!("recording to {}", path.display()), unwritable(path, &e)))
    }
    fn entry(&mut self, channel: ChannelId, t: WorldTime, step: &Step<'_>) -> Result<(), WireError> {
        let (mut references, newest, written) = (References::default(), &mut self.newest, &self.written);
        if self.foreign.contains(&step.process) {
            return self.sink.message(channel, stamp(t), |to| {
                entry::append(to, step.now_ns, (step.output, references, step.output))
            });
        }
        let input = (step.parts).input_with(&mut |part| references.take(part, newest, written));
        self.sink.message(channel, stamp(t), |to| {
            entry::append(to, step.now_ns, (&*input, references, step.output))
        })
    }

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
    fn step(&mut self, t: WorldTime, step: &Step<'_>) {
        if let Some(channel) = self.channel(step.process.name(), step.boot)
            && let Err(e) = self.entry(channel, t, step)
        {
            self.failed.get_or_insert(e);
        }
        step.parts.written(&mut |part| self.written.keep(part));
        each_message(step, &mut |message| {
            self.views.message(&mut self.sink, t, &message)
        });
    }
    fn recorded(&mut self, t: WorldTime, of: &PartHeader, entry: &[u8]) -> Result<(), WireError> {
        match self.channel(&of.process, of.boot) {
            Some(channel) => self.sink.message(channel, stamp(t), |to| {
                to.extend_from_slice(entry);
                Ok(())
            }),
            None => Ok(()),
        }
    }
}
