//! A recording as a whole: checked before it is read, then its parts by name and its nodes' steps.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::Path;

use alight_shared::config::{self, Check};
use alight_shared::wire::WireError;
use mcap::read::Options;
use mcap::{MessageStream, Summary};
use serde::de::DeserializeOwned;

use crate::exit::CliError;
use crate::record::entry::{ENCODING, FORMAT};
use crate::record::{NODES, RECORDING, topic};

/// No recording that this program makes is larger, bytes.
const MAX_FILE_BYTES: u64 = 2 << 30;

/// A file of ours.
pub struct Recording {
    file: Vec<u8>,
    origin: String,
    summary: Summary,
}

/// Runs `read`, with a panic of the MCAP reader made an error: version 0.26 reserves what some damaged
/// length fields claim and panics on an overflow of the capacity.
pub fn contained<T>(path: &Path, read: impl FnOnce() -> Result<T, CliError>) -> Result<T, CliError> {
    let loud = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(read));
    std::panic::set_hook(loud);
    done.unwrap_or_else(|_| {
        let origin = path.display();
        Err(CliError(format!(
            "reading {origin}: the recording is damaged; record it again"
        )))
    })
}

impl Recording {
    /// Reads the file.
    pub fn open(path: &Path) -> Result<Recording, CliError> {
        let origin = path.display().to_string();
        let reading = |e: &dyn Display| CliError::because(format!("reading {origin}"), e);
        let size = std::fs::metadata(path).map_err(|e| reading(&e))?.len();
        if size > MAX_FILE_BYTES {
            return Err(reading(&format_args!(
                "{size} bytes; at most {MAX_FILE_BYTES} are accepted"
            )));
        }
        let file = std::fs::read(path).map_err(|e| reading(&e))?;
        crate::record::outline::check(&file).map_err(|e| reading(&e))?;
        let summary = Summary::read(&file)
            .map_err(|e| unreadable(&origin, &e))?
            .ok_or_else(|| unreadable(&origin, &"no summary at its end"))?;
        let recording = Recording {
            file,
            origin,
            summary,
        };
        let format: u32 = recording.number("format")?;
        if format != FORMAT {
            return Err(CliError(format!(
                "{}: recorded in format {format}, this program reads format {FORMAT}; record it again",
                recording.origin
            )));
        }
        Ok(recording)
    }
    /// Its name, for errors.
    pub fn origin(&self) -> &str {
        &self.origin
    }
    /// An attached file.
    pub fn text(&self, name: &str) -> Result<String, CliError> {
        let index = self.summary.attachment_indexes.iter().find(|a| a.name == name);
        let index = index.ok_or_else(|| self.foreign(name))?;
        let attached = mcap::read::attachment(&self.file, index).map_err(|e| unreadable(&self.origin, &e))?;
        String::from_utf8(attached.data.into_owned()).map_err(|e| unreadable(&self.origin, &e))
    }
    /// A number that says what was recorded.
    pub fn number(&self, name: &str) -> Result<u32, CliError> {
        let index = self.summary.metadata_indexes.iter().find(|m| m.name == RECORDING);
        let index = index.ok_or_else(|| self.foreign(RECORDING))?;
        let values: BTreeMap<String, String> = mcap::read::metadata(&self.file, index)
            .map_err(|e| unreadable(&self.origin, &e))?
            .metadata;
        let value = values.get(name).and_then(|v| v.parse().ok());
        value.ok_or_else(|| self.foreign(name))
    }
    /// Every node's steps in their order: number of the node in [`NODES`], the world's time (s), the entry.
    pub fn steps(
        &self,
        mut each: impl FnMut(usize, f64, &[u8]) -> Result<(), WireError>,
    ) -> Result<(), CliError> {
        let topics = NODES.map(topic);
        let checked = Options::ValidateChunkCrcs.into();
        let messages = MessageStream::new_with_options(&self.file, checked);
        for message in messages.map_err(|e| unreadable(&self.origin, &e))? {
            let message = message.map_err(|e| unreadable(&self.origin, &e))?;
            if message.channel.message_encoding != ENCODING {
                continue;
            }
            let Some(k) = topics.iter().position(|t| *t == message.channel.topic) else {
                continue;
            };
            let t_s = message.log_time as f64 * 1e-9;
            each(k, t_s, &message.data).map_err(|e| {
                CliError(format!(
                    "{}: the step of `{}` at {t_s:.2} s: {e}",
                    self.origin, NODES[k]
                ))
            })?;
        }
        Ok(())
    }
    /// The configuration attached as `name`.
    pub fn configuration<C: Check + DeserializeOwned>(&self, name: &str) -> Result<C, CliError> {
        Ok(config::parse(
            &self.text(name)?,
            &format!("{}, {name}", self.origin),
        )?)
    }
    fn foreign(&self, what: &str) -> CliError {
        CliError(format!(
            "{}: not a recording of `alight --record`: `{what}` is missing in it",
            self.origin
        ))
    }
}

fn unreadable(origin: &str, e: &dyn Display) -> CliError {
    CliError(format!(
        "{origin} is damaged, cut off or not an MCAP file: {e}; record it again \
         (`alight trial --seed N --record FILE.mcap`)"
    ))
}
