//! Recorder of a flight in one file: every node's step to its own channel, and views for people.

use std::collections::BTreeMap;
use std::path::Path;

use alight_shared::time::{Time, TrueTime};
use alight_shared::wire::{self, WireError};
use mcap::McapError;
use serde::Serialize;

use crate::exit::CliError;
use crate::record::entry::{Entry, Input, Newest, PartHeader, References};
use crate::record::observer::{NodeStep, StepObserver};
use crate::record::sink::{Channel, Sink, TakeMessages, unwritable};
use crate::record::views::{Views, stamp};
use crate::record::{NODES, RECORDING};

/// Records a flight.
pub struct Recorder {
    /// The file.
    pub sink: Sink,
    /// What a person looks at.
    pub views: Views,
    /// In the order of [`NODES`].
    inputs: [Channel; NODES.len()],
    newest: Newest,
    failed: Option<WireError>,
}

fn named(values: &[(&str, String)]) -> BTreeMap<String, String> {
    let named = |(name, value): &(&str, String)| (name.to_string(), value.clone());
    values.iter().map(named).collect()
}

impl Recorder {
    /// Creates the file of the nodes with these headers, with the attached `texts`, the `values` that say what is
    /// recorded, and the channels that `more` opens beside its own.
    pub fn create<T>(
        path: &Path,
        headers: &[PartHeader],
        texts: &[(&str, String)],
        values: &[(&str, String)],
        more: impl FnOnce(&mut Sink) -> Result<T, McapError>,
    ) -> Result<(Recorder, T), CliError> {
        let create = || -> Result<(Recorder, T), McapError> {
            let mut sink = Sink::create(path)?;
            sink.metadata(RECORDING, named(values))?;
            for (name, text) in texts {
                sink.attach(name, text)?;
            }
            let channels = sink.processes(headers)?;
            let mut inputs = [Channel::default(); NODES.len()];
            for (input, node) in inputs.iter_mut().zip(NODES) {
                let own = headers.iter().zip(&channels).find(|(h, _)| h.process == node);
                *input = own.map_or(*input, |(_, channel)| *channel);
            }
            let (views, more) = (Views::new(&mut sink)?, more(&mut sink)?);
            let recorder = Recorder {
                sink,
                views,
                inputs,
                newest: Newest::default(),
                failed: None,
            };
            Ok((recorder, more))
        };
        create()
            .map_err(|e| CliError::because(format!("recording to {}", path.display()), unwritable(path, &e)))
    }

    fn entry(
        &mut self,
        node: usize,
        t: Time<TrueTime>,
        now_ns: i64,
        input: &impl Input,
        output: &impl Serialize,
    ) {
        let mut input = input.clone();
        let references = References::take(&mut input, &mut self.newest);
        let wrote = wire::hash_record(output).and_then(|output| {
            let entry = Entry {
                now_ns,
                input,
                references,
                output,
            };
            self.sink
                .message(self.inputs[node], stamp(t), |to| wire::append_record(to, &entry))
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
    fn step(&mut self, t: Time<TrueTime>, step: NodeStep<'_>) {
        match step {
            NodeStep::Vessel(now, i, o) => self.entry(0, t, now.nanos(), i, o),
            NodeStep::Bridge(now, i, o) => self.entry(1, t, now.nanos(), i, o),
            NodeStep::Predictor(now, i, o) => self.entry(2, t, now.nanos(), i, o),
            NodeStep::Mission(now, i, o) => self.entry(3, t, now.nanos(), i, o),
            NodeStep::Planner(now, i, o) => self.entry(4, t, now.nanos(), i, o),
            NodeStep::Pilot(now, i, o) => self.entry(5, t, now.nanos(), i, o),
        }
        self.views.step(&mut self.sink, t, step);
    }
}
