//! Reader of parts: also of one without an end, which a kill or a power cut left, up to its last whole
//! chunk.

use std::collections::{BTreeMap, VecDeque};
use std::fmt::Display;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use alight_shared::wire;
use mcap::read::{ChunkReader, LinearReader, Options};
use mcap::records::Record;
use serde::de::DeserializeOwned;

use super::parts::PartHeader;
use super::{CONFIG_FILE, ENCODING, EXTENSION, PROCESS};
use crate::exit::{CliError, Doing};
use crate::record::entry::{Entry, FORMAT};
use crate::record::outline::Outline;
use crate::record::reading::contained;

/// No part is larger, nor are its steps together, bytes.
const MAX_PART_BYTES: u64 = 512 << 20;
/// A part's beginning, its configuration included, is no longer, bytes.
const MAX_BEGINNING_BYTES: u64 = 1 << 20;

/// A step as it is recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step<'a> {
    /// Its number in its start of the process, from 0 on.
    pub number: u64,
    /// People's time, ns since 1970 (UTC).
    pub utc_ns: u64,
    /// Its [`Entry`].
    pub bytes: &'a [u8],
}

impl Step<'_> {
    /// The node's own time (ns), the input, and the hash of the output.
    pub fn entry<I: DeserializeOwned>(&self) -> Result<(i64, I, u64), wire::WireError> {
        let entry: Entry<I> = wire::decode_record(self.bytes)?;
        Ok((entry.now_ns, entry.input, entry.output))
    }
}

/// A part in memory.
pub struct Part {
    /// Whose steps.
    pub header: PartHeader,
    /// Why the file has no end; None: it was finished.
    pub cut: Option<String>,
    /// Number, people's time and end in `bytes` of each step.
    marks: Vec<(u64, u64, usize)>,
    bytes: Vec<u8>,
}

impl Part {
    /// Reads a part.
    pub fn open(path: &Path) -> Result<Part, CliError> {
        let doing = format_args!("reading {}", path.display());
        let bytes = read(path, MAX_PART_BYTES)?;
        let found = beginning(&bytes).doing(doing)?;
        if found.is_cut {
            return Err(CliError(format!("{doing}: it was cut off before its first step")));
        }
        let mut part = Part {
            header: header(path, &found.values, found.config)?,
            cut: None,
            marks: Vec::new(),
            bytes: Vec::new(),
        };
        part.cut = part.take_steps(&bytes).doing(doing)?;
        Ok(part)
    }
    /// Takes the steps in; why the file has no end, if it has none.
    fn take_steps(&mut self, file: &[u8]) -> Result<Option<String>, String> {
        let Outline { end, cut } = Outline::of(file)?;
        let mut channel = None;
        for record in records(file.get(..end).unwrap_or_default())? {
            let (header, data) = match record.map_err(|e| e.to_string())? {
                Record::Chunk { header, data } => (header, data),
                _ => continue,
            };
            let taken = ChunkReader::new(header, &data)
                .map_err(|e| e.to_string())
                .and_then(|chunk| self.take_chunk(chunk, &mut channel));
            match (taken, &cut) {
                (Ok(()), _) => {}
                // The disk had begun with this chunk when the power went.
                (Err(e), Some(_)) => return Ok(Some(e)),
                (Err(e), None) => return Err(format!("{e}; the file is damaged")),
            }
        }
        Ok(cut)
    }
    fn take_chunk(&mut self, chunk: ChunkReader<'_>, channel: &mut Option<u16>) -> Result<(), String> {
        let (marks, bytes) = (self.marks.len(), self.bytes.len());
        let take = || -> Result<(), String> {
            for record in chunk {
                match record.map_err(|e| e.to_string())? {
                    Record::Channel(c) if c.message_encoding == ENCODING => *channel = Some(c.id),
                    Record::Message { header, data } if Some(header.channel_id) == *channel => {
                        if (self.bytes.len() + data.len()) as u64 > MAX_PART_BYTES {
                            return Err(format!("more than {} MB of steps", MAX_PART_BYTES >> 20));
                        }
                        // 32 bits count on from the part's first step.
                        let first = self.header.first_step;
                        let number = first + u64::from(header.sequence.wrapping_sub(first as u32));
                        self.bytes.extend_from_slice(&data);
                        self.marks.push((number, header.log_time, self.bytes.len()));
                    }
                    _ => {}
                }
            }
            Ok(())
        };
        // A chunk counts as a whole or not at all: its check sum comes with its end.
        let taken = take();
        if taken.is_err() {
            self.marks.truncate(marks);
            self.bytes.truncate(bytes);
        }
        taken
    }
    /// Steps in it.
    pub fn len(&self) -> usize {
        self.marks.len()
    }
    /// Its step in this place.
    pub fn step(&self, at: usize) -> Option<Step<'_>> {
        let &(number, utc_ns, end) = self.marks.get(at)?;
        let before = at.checked_sub(1).and_then(|k| self.marks.get(k));
        Some(Step {
            number,
            utc_ns,
            bytes: self.bytes.get(before.map_or(0, |m| m.2)..end)?,
        })
    }
}

/// Whether the file at `path` is a part, and not another kind of recording.
pub fn is_part(path: &Path) -> bool {
    let found = contained(path, || beginning(&read_beginning(path)?).doing(""));
    found.is_ok_and(|f| !f.values.is_empty())
}

/// Whose steps the part at `path` holds; None where it was cut off before the first.
pub fn read_header(path: &Path) -> Result<Option<PartHeader>, CliError> {
    let found = beginning(&read_beginning(path)?).doing(format_args!("reading {}", path.display()))?;
    if found.is_cut {
        return Ok(None);
    }
    header(path, &found.values, found.config).map(Some)
}

/// Whether a file has its end: the magic bytes, after which nothing comes.
pub fn is_whole(path: &Path) -> bool {
    use std::io::{Seek, SeekFrom};
    let end = || -> std::io::Result<[u8; 8]> {
        let (mut file, mut end) = (File::open(path)?, [0; 8]);
        file.seek(SeekFrom::End(-8))?;
        file.read_exact(&mut end)?;
        Ok(end)
    };
    end().is_ok_and(|e| e == mcap::MAGIC)
}

/// What stands before the first chunk.
#[derive(Default)]
struct Found {
    values: BTreeMap<String, String>,
    config: String,
    /// The file ends before the first chunk.
    is_cut: bool,
}

fn beginning(file: &[u8]) -> Result<Found, String> {
    let mut found = Found {
        is_cut: true,
        ..Found::default()
    };
    if mcap::MAGIC.starts_with(file) {
        return Ok(found);
    }
    let Outline { end, .. } = Outline::of(file)?;
    for record in records(file.get(..end).unwrap_or_default())? {
        match record.map_err(|e| e.to_string())? {
            Record::Metadata(m) if m.name == PROCESS => found.values = m.metadata,
            Record::Attachment { header, data, .. } if header.name == CONFIG_FILE => {
                found.config = String::from_utf8(data.into_owned()).map_err(|e| e.to_string())?;
            }
            Record::Chunk { .. } | Record::DataEnd(_) => {
                found.is_cut = false;
                break;
            }
            _ => {}
        }
    }
    Ok(found)
}

fn header(path: &Path, values: &BTreeMap<String, String>, config: String) -> Result<PartHeader, CliError> {
    let origin = path.display();
    let format = values.get("format").and_then(|f| f.parse::<u32>().ok());
    match format {
        Some(FORMAT) => {}
        Some(other) => {
            return Err(CliError(format!(
                "{origin}: recorded in format {other}, this program reads format {FORMAT}; read it with the program \
                 that recorded it"
            )));
        }
        None => return Err(foreign(origin)),
    }
    PartHeader::of(values, config).ok_or_else(|| foreign(origin))
}

fn foreign(origin: impl Display) -> CliError {
    CliError(format!("{origin}: no file of the flight recorder"))
}

/// Its records, chunks whole; the file may have no end.
fn records(file: &[u8]) -> Result<LinearReader<'_>, String> {
    LinearReader::new_with_options(file, Options::IgnoreEndMagic.into()).map_err(|e| e.to_string())
}

fn read(path: &Path, most: u64) -> Result<Vec<u8>, CliError> {
    let doing = format_args!("reading {}", path.display());
    let mut bytes = Vec::new();
    let file = File::open(path).doing(doing)?;
    file.take(most + 1).read_to_end(&mut bytes).doing(doing)?;
    if bytes.len() as u64 > most {
        return Err(CliError(format!("{doing}: more than {} MB", most >> 20)));
    }
    Ok(bytes)
}

fn read_beginning(path: &Path) -> Result<Vec<u8>, CliError> {
    let doing = format_args!("reading {}", path.display());
    let mut bytes = Vec::new();
    let file = File::open(path).doing(doing)?;
    file.take(MAX_BEGINNING_BYTES)
        .read_to_end(&mut bytes)
        .doing(doing)?;
    Ok(bytes)
}

/// One start of a process: its parts in their order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Start {
    /// Name of the process.
    pub process: String,
    /// Its boot id.
    pub boot: u32,
    /// The parts.
    pub parts: Vec<PathBuf>,
}

impl Start {
    /// The name that a person reads.
    pub fn name(&self) -> String {
        format!("{}-{:08x}", self.process, self.boot)
    }
}

/// Process, boot id and number of a part by its file's name.
fn parse_name(path: &Path) -> Option<(String, u32, u32)> {
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

/// The parts in a flight's directory.
pub fn parts(directory: &Path) -> Result<Vec<PathBuf>, CliError> {
    let entries = std::fs::read_dir(directory).doing(format_args!("reading {}", directory.display()))?;
    let mut found: Vec<PathBuf> = entries
        .flatten()
        .map(|e| e.path())
        .filter(|p| parse_name(p).is_some())
        .collect();
    found.sort();
    Ok(found)
}

/// The starts of processes that a flight's directory holds, or the one of a single part: by name, a process's first start
/// first. A part that was cut off before its first step is none.
pub fn starts(path: &Path) -> Result<Vec<Start>, CliError> {
    let all = if path.is_dir() {
        parts(path)?
    } else {
        vec![path.into()]
    };
    let mut found = Vec::new();
    for part in all {
        if let Some(header) = read_header(&part)? {
            // A copy under another name stands alone.
            let number = parse_name(&part).map_or(0, |(_, _, number)| number);
            found.push((header.process, header.began_ns, header.boot, number, part));
        }
    }
    found.sort();
    let mut starts: Vec<Start> = Vec::new();
    for (process, _, boot, _, part) in found {
        match starts.last_mut() {
            Some(last) if last.process == process && last.boot == boot => last.parts.push(part),
            Some(_) | None => starts.push(Start {
                process,
                boot,
                parts: vec![part],
            }),
        }
    }
    Ok(starts)
}

/// The steps of a start, part after part; one part at a time is in memory.
pub struct Steps {
    waiting: VecDeque<PathBuf>,
    part: Part,
    at: usize,
    path: PathBuf,
}

impl Steps {
    /// From its first part on.
    pub fn of(start: &Start) -> Result<Steps, CliError> {
        let mut waiting: VecDeque<PathBuf> = start.parts.clone().into();
        let path = waiting
            .pop_front()
            .ok_or_else(|| CliError(format!("{}: no part", start.name())))?;
        Ok(Steps {
            part: Part::open(&path)?,
            waiting,
            at: 0,
            path,
        })
    }
    /// Whose they are.
    pub fn header(&self) -> &PartHeader {
        &self.part.header
    }
    /// Where the newest came from.
    pub fn path(&self) -> &Path {
        &self.path
    }
    /// The next.
    pub fn next(&mut self) -> Result<Option<Step<'_>>, CliError> {
        while self.at >= self.part.len() {
            let Some(path) = self.waiting.pop_front() else {
                return Ok(None);
            };
            self.part = Part::open(&path)?;
            (self.path, self.at) = (path, 0);
        }
        self.at += 1;
        Ok(self.part.step(self.at - 1))
    }
}
