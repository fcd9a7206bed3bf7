//! Reader of log files: those of the flight recorder, and recordings.
//!
//! A flight recorder's file without an end, after a kill or a power cut, is read up to its last complete chunk.

use std::{
    collections::BTreeMap,
    fmt::Display,
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

use alight_shared::wire::{self, WireError};
use mcap::{
    parse_record,
    read::{LinearReader, Options},
    records::Record,
    sans_io::linear_reader::{self, LinearReadEvent, LinearReaderOptions},
};
use serde::de::DeserializeOwned;

use crate::{
    exit::{CliError, Doing},
    record::{
        About, EXTENSION, PROCESS, RECORDING,
        entry::{ENCODING, Entry, FORMAT, PartHeader},
        outline::{MAX_CHUNK_BYTES, Outline},
        topic,
    },
};

const OF_FLIGHTS: &str = "alight flights lists the recorded ones";
/// Maximum size of a file, and of all its steps together, bytes.
const MAX_FILE_BYTES: u64 = 2 << 30;
/// Maximum size of the beginning of a file, including configurations, bytes.
const MAX_BEGINNING_BYTES: u64 = 1 << 20;

/// Runs `read` and converts a panic of the MCAP reader into an error: version 0.26 reserves the memory that a damaged
/// length field states, and panics when the capacity overflows.
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LogStep<'a> {
    pub header: &'a PartHeader,
    /// Number of the step within its start of the process, from 0.
    pub number: u64,
    /// Log time, ns: UTC since 1970; in a recording, the world's time.
    pub log_ns: u64,
    pub bytes: &'a [u8],
}

impl LogStep<'_> {
    pub fn entry<I: DeserializeOwned>(&self) -> Result<Entry<I>, WireError> {
        wire::decode_record(self.bytes)
    }
    /// The node's own time, ns, the first field of an entry.
    pub fn now_ns(&self) -> i64 {
        let first = self.bytes.first_chunk();
        first.map_or(0, |b| i64::from_le_bytes(*b))
    }
}

#[derive(Default)]
pub struct LogBeginning {
    pub headers: Vec<PartHeader>,
    pub about: About,
    /// The file ends before the first chunk.
    is_cut: bool,
}

impl LogBeginning {
    pub fn read(path: &Path) -> Result<LogBeginning, CliError> {
        let doing = format_args!("reading {} ({OF_FLIGHTS})", path.display());
        let mut bytes = Vec::new();
        let file = File::open(path).doing(doing)?;
        let mut beginning = file.take(MAX_BEGINNING_BYTES);
        beginning.read_to_end(&mut bytes).doing(doing)?;
        // The first chunk may be longer.
        let goes_on = bytes.len() as u64 == MAX_BEGINNING_BYTES;
        let found = LogBeginning::of(path, &bytes, goes_on)?;
        if !goes_on || !found.is_recording() {
            return Ok(found);
        }
        beginning.set_limit(MAX_FILE_BYTES);
        beginning.read_to_end(&mut bytes).doing(doing)?;
        LogBeginning::of(path, &bytes, false)
    }
    fn is_recording(&self) -> bool {
        !self.about.values.is_empty()
    }
    /// An error if the file was cut off before its first step.
    pub fn begun(self, path: &Path) -> Result<LogBeginning, CliError> {
        if self.is_cut {
            Err(CliError(format!(
                "reading {}: it was cut off before its first step",
                path.display()
            )))
        } else {
            Ok(self)
        }
    }
    /// Reads the beginning from `file`, which holds all bytes of the file, or its first bytes if `goes_on`.
    fn of(path: &Path, file: &[u8], goes_on: bool) -> Result<LogBeginning, CliError> {
        let origin = path.display();
        let mut found = LogBeginning {
            is_cut: !goes_on,
            ..LogBeginning::default()
        };
        let mut processes = Vec::new();
        let mut take = || -> Result<(), String> {
            if mcap::MAGIC.starts_with(file) {
                return Ok(());
            }
            let Outline { end, .. } = Outline::of(file)?;
            for record in records(file.get(..end).unwrap_or_default())? {
                match record.map_err(|e| e.to_string())? {
                    Record::Metadata(m) if m.name == PROCESS => processes.push(m.metadata),
                    Record::Metadata(m) if m.name == RECORDING => found.about.values = m.metadata,
                    Record::Attachment { header, data, .. } => {
                        let text = String::from_utf8(data.into_owned()).map_err(|e| e.to_string())?;
                        found.about.texts.insert(header.name, text);
                    }
                    Record::Chunk { .. } if found.is_recording() => found.is_cut = false,
                    Record::Chunk { .. } | Record::DataEnd(_) => {
                        found.is_cut = false;
                        return Ok(());
                    }
                    _ => {}
                }
            }
            Ok(())
        };
        take().map_err(|e| damaged(&origin, e))?;
        if found.is_cut {
            return Ok(found);
        }
        for values in processes {
            check_format(path, values.get("format"))?;
            let header = PartHeader::of(&values, &found.about.texts).ok_or_else(|| foreign(&origin))?;
            found.headers.push(header);
        }
        if found.headers.is_empty() {
            check_format(path, found.about.values.get("format"))?;
            return Err(foreign(&origin));
        }
        Ok(found)
    }
}

fn check_format(path: &Path, format: Option<&String>) -> Result<(), CliError> {
    let origin = path.display();
    match format.and_then(|f| f.parse::<u32>().ok()) {
        Some(FORMAT) => Ok(()),
        Some(other) => Err(CliError(format!(
            "{origin}: recorded in format {other}, this program reads format {FORMAT}; read it with the program \
             that recorded it, or record it again"
        ))),
        None => Err(foreign(origin)),
    }
}

fn foreign(origin: impl Display) -> CliError {
    CliError(format!(
        "{origin}: neither a file of the flight recorder nor a recording (`alight trial --record FILE.mcap`); `python -m \
         alight.convert FILE` converts one of ROS 2"
    ))
}

fn damaged(origin: impl Display, why: impl Display) -> CliError {
    CliError(format!(
        "{origin} is damaged, cut off or not an MCAP file: {why}; record it again"
    ))
}

/// Records of the file, in whole chunks; the end of the file may be missing.
fn records(file: &[u8]) -> Result<LinearReader<'_>, String> {
    LinearReader::new_with_options(file, Options::IgnoreEndMagic.into()).map_err(|e| e.to_string())
}

/// Reader of the records in a chunk. A record is at most as long as a chunk: [`mcap::read::ChunkReader`] allocates the
/// length that a damaged record states.
fn chunk_reader(chunk: &[u8]) -> linear_reader::LinearReader {
    let mut reader = linear_reader::LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(MAX_CHUNK_BYTES as usize),
    );
    reader.insert(chunk.len()).copy_from_slice(chunk);
    reader.notify_read(chunk.len());
    reader
}

pub struct LogFile {
    pub headers: Vec<PartHeader>,
    /// Reason why the file has no end; None: the file was finished.
    pub cut: Option<String>,
    /// Index of the header, number, time and end in `bytes` of each step.
    marks: Vec<(usize, u64, u64, usize)>,
    bytes: Vec<u8>,
}

impl LogFile {
    pub fn open(path: &Path) -> Result<LogFile, CliError> {
        let origin = path.display();
        let doing = format_args!("reading {origin} ({OF_FLIGHTS})");
        let mut bytes = Vec::new();
        let file = File::open(path).doing(doing)?;
        file.take(MAX_FILE_BYTES + 1)
            .read_to_end(&mut bytes)
            .doing(doing)?;
        if bytes.len() as u64 > MAX_FILE_BYTES {
            return Err(CliError(format!(
                "{doing}: more than {} MB",
                MAX_FILE_BYTES >> 20
            )));
        }
        let found = LogBeginning::of(path, &bytes, false)?.begun(path)?;
        let is_recording = found.is_recording();
        let mut file = LogFile {
            headers: found.headers,
            cut: None,
            marks: Vec::new(),
            bytes: Vec::new(),
        };
        file.cut = file.take_steps(&bytes).map_err(|e| damaged(&origin, e))?;
        match &file.cut {
            // A recording is not made in flight, so its steps are not recovered.
            Some(why) if is_recording => Err(damaged(&origin, why)),
            Some(_) | None => Ok(file),
        }
    }
    /// Reads the steps; returns the reason if the file has no end.
    fn take_steps(&mut self, file: &[u8]) -> Result<Option<String>, String> {
        let Outline { end, cut, chunks } = Outline::of(file)?;
        let mut channels = BTreeMap::new();
        let mut chunks = chunks.into_iter();
        for record in records(file.get(..end).unwrap_or_default())? {
            let Record::Chunk { .. } = record.map_err(|e| e.to_string())? else {
                continue;
            };
            let chunk = chunks.next().and_then(|place| file.get(place));
            match (self.take_chunk(chunk.unwrap_or_default(), &mut channels), &cut) {
                (Ok(()), _) => {}
                // The disk had begun this chunk when power was lost.
                (Err(e), Some(_)) => return Ok(Some(e)),
                (Err(e), None) => return Err(e),
            }
        }
        Ok(cut)
    }
    fn take_chunk(&mut self, chunk: &[u8], channels: &mut BTreeMap<u16, usize>) -> Result<(), String> {
        let marks = self.marks.len();
        let bytes = self.bytes.len();
        let mut take = || -> Result<(), String> {
            let mut reader = chunk_reader(chunk);
            while let Some(event) = reader.next_event() {
                let (opcode, data) = match event.map_err(|e| e.to_string())? {
                    LinearReadEvent::Record { opcode, data } => (opcode, data),
                    LinearReadEvent::ReadRequest(_) => {
                        reader.notify_read(0);
                        continue;
                    }
                };
                match parse_record(opcode, data).map_err(|e| e.to_string())? {
                    Record::Channel(c) if c.message_encoding == ENCODING => {
                        let headers = &self.headers;
                        let is_own =
                            |(k, h): (usize, &PartHeader)| topic(h, headers.iter().take(k)) == c.topic;
                        let own = headers.iter().enumerate().position(is_own);
                        channels.extend(own.map(|header| (c.id, header)));
                    }
                    Record::Message {
                        header: message,
                        data,
                    } => {
                        let Some(&header) = channels.get(&message.channel_id) else {
                            continue;
                        };
                        if (self.bytes.len() + data.len()) as u64 > MAX_FILE_BYTES {
                            return Err(format!("more than {} MB of steps", MAX_FILE_BYTES >> 20));
                        }
                        // The 32-bit sequence number continues from the file's first step.
                        let first = self.headers.get(header).map_or(0, |h| h.first_step);
                        let number = first + u64::from(message.sequence.wrapping_sub(first as u32));
                        self.bytes.extend_from_slice(&data);
                        self.marks
                            .push((header, number, message.log_time, self.bytes.len()));
                    }
                    _ => {}
                }
            }
            Ok(())
        };
        // Only a complete chunk counts, because its checksum is at its end.
        let taken = take();
        if taken.is_err() {
            self.marks.truncate(marks);
            self.bytes.truncate(bytes);
        }
        taken
    }
    pub fn steps(&self) -> usize {
        self.marks.len()
    }
    pub fn step(&self, at: usize) -> Option<LogStep<'_>> {
        let &(header, number, log_ns, end) = self.marks.get(at)?;
        let before = at.checked_sub(1).and_then(|k| self.marks.get(k));
        Some(LogStep {
            header: self.headers.get(header)?,
            number,
            log_ns,
            bytes: self.bytes.get(before.map_or(0, |m| m.3)..end)?,
        })
    }
}

/// Header of the part at `path`; None if the file was cut off before its first step.
pub fn read_header(path: &Path) -> Result<Option<PartHeader>, CliError> {
    Ok(LogBeginning::read(path)?.headers.into_iter().next())
}

pub fn is_mcap(path: &Path) -> bool {
    let begins = || -> std::io::Result<[u8; 5]> {
        let mut begin = [0; 5];
        File::open(path)?.read_exact(&mut begin)?;
        Ok(begin)
    };
    begins().is_ok_and(|b| mcap::MAGIC.starts_with(&b))
}

pub fn is_whole(path: &Path) -> bool {
    use std::io::{Seek, SeekFrom};
    let end = || -> std::io::Result<[u8; 8]> {
        let mut file = File::open(path)?;
        let mut end = [0; 8];
        file.seek(SeekFrom::End(-8))?;
        file.read_exact(&mut end)?;
        Ok(end)
    };
    end().is_ok_and(|e| e == mcap::MAGIC)
}

/// Process, boot id and number of a part, parsed from its file name.
pub fn parse_name(path: &Path) -> Option<(String, u32, u32)> {
    let stem = path
        .file_name()?
        .to_str()?
        .strip_suffix(EXTENSION)?
        .strip_suffix('.')?;
    let (rest, number) = stem.rsplit_once('-')?;
    let (process, boot) = rest.rsplit_once('-')?;
    let boot = u32::from_str_radix(boot, 16).ok()?;
    Some((process.into(), boot, number.parse().ok()?))
}

pub fn parts(directory: &Path) -> Result<Vec<PathBuf>, CliError> {
    let entries = std::fs::read_dir(directory);
    let entries = entries.doing(format_args!("reading {} ({OF_FLIGHTS})", directory.display()))?;
    let mut found: Vec<PathBuf> = entries
        .flatten()
        .map(|e| e.path())
        .filter(|p| parse_name(p).is_some())
        .collect();
    found.sort();
    Ok(found)
}
