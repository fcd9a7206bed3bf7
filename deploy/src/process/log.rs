//! A log of what a process consumed: configuration, boot id, then every step's time and input with
//! a hash of the output. Enough to compute every output again.
//!
//! Layout: records of a 4-byte length (little endian) and that many bytes. The first is [`LogHeader`],
//! each other a [`Step`], both as bincode.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;

use alight_shared::wire::{self, MAX_RECORD_BYTES};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::exit::{CliError, Doing};

/// A log grows no longer than this, bytes: about ten minutes of the busiest process.
const MAX_LOG_BYTES: u64 = 256 << 20;

/// The beginning of a log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LogHeader {
    /// Name of the process.
    pub process: String,
    /// Its boot id.
    pub boot: u32,
    /// The text of its configuration file.
    pub config: String,
}

/// One step: time, input, and what came out.
#[derive(Serialize, Deserialize)]
struct Step<I> {
    now_ns: i64,
    input: I,
    output_hash: u64,
}

/// Writes a log up to its bound.
pub struct LogWriter {
    file: BufWriter<File>,
    written: u64,
    full: bool,
}

impl LogWriter {
    /// Begins a log in `directory`, named after process and boot id.
    pub fn create(directory: &Path, head: &LogHeader) -> Result<LogWriter, CliError> {
        LogWriter::begin(directory, head).doing(format_args!("writing a log into {}", directory.display()))
    }
    fn begin(directory: &Path, head: &LogHeader) -> std::io::Result<LogWriter> {
        std::fs::create_dir_all(directory)?;
        let path = directory.join(format!("{}-{:08x}.log", head.process, head.boot));
        let mut log_writer = LogWriter {
            file: BufWriter::new(File::create(path)?),
            written: 0,
            full: false,
        };
        let bytes = wire::encode_record(head).map_err(std::io::Error::other)?;
        log_writer.put(&bytes)?;
        Ok(log_writer)
    }
    fn put(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.file.write_all(&(bytes.len() as u32).to_le_bytes())?;
        self.file.write_all(bytes)?;
        self.written += 4 + bytes.len() as u64;
        Ok(())
    }
    /// Logs one step. A disk that is full ends the log, not the process.
    pub fn write<I: Serialize, O: Serialize>(&mut self, now_ns: i64, input: &I, output: &O) {
        if self.full {
            return;
        }
        let put = wire::hash_record(output)
            .and_then(|output_hash| {
                wire::encode_record(&Step {
                    now_ns,
                    input,
                    output_hash,
                })
            })
            .map(|bytes| self.put(&bytes));
        self.full = !matches!(put, Ok(Ok(()))) || self.written > MAX_LOG_BYTES;
    }
    /// Puts on disk what was logged.
    pub fn flush(&mut self) {
        if self.file.flush().is_err() {
            self.full = true;
        }
    }
}

/// Why a log cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file.
    #[error(transparent)]
    File(#[from] std::io::Error),
    /// Its content.
    #[error(transparent)]
    Content(#[from] wire::WireError),
    /// A length that no record has.
    #[error("a record of {0} bytes; at most {MAX_RECORD_BYTES} are possible")]
    Length(usize),
    /// It has no beginning.
    #[error("an empty file")]
    Empty,
}

/// Reads a log.
pub struct LogReader {
    file: BufReader<File>,
}

impl LogReader {
    /// Opens a log and reads its beginning.
    pub fn open(path: &Path) -> Result<(LogReader, LogHeader), LogError> {
        let mut log = LogReader {
            file: BufReader::new(File::open(path)?),
        };
        let bytes = log.next()?.ok_or(LogError::Empty)?;
        Ok((log, wire::decode_record(&bytes)?))
    }
    /// The next record; None at the end, and for a last one that was cut off.
    fn next(&mut self) -> Result<Option<Vec<u8>>, LogError> {
        let mut length = [0_u8; 4];
        if let Err(e) = self.file.read_exact(&mut length) {
            return if e.kind() == std::io::ErrorKind::UnexpectedEof {
                Ok(None)
            } else {
                Err(e.into())
            };
        }
        let length = u32::from_le_bytes(length) as usize;
        if length > MAX_RECORD_BYTES {
            return Err(LogError::Length(length));
        }
        let mut bytes = vec![0; length];
        match self.file.read_exact(&mut bytes) {
            Ok(()) => Ok(Some(bytes)),
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => Ok(None),
            Err(e) => Err(e.into()),
        }
    }
    /// The next step: its time and input, and the hash of its output.
    pub fn step<I: DeserializeOwned>(&mut self) -> Result<Option<(i64, I, u64)>, LogError> {
        let Some(bytes) = self.next()? else {
            return Ok(None);
        };
        let step: Step<I> = wire::decode_record(&bytes)?;
        Ok(Some((step.now_ns, step.input, step.output_hash)))
    }
    /// Feeds every step through `step`; the number of steps and the first whose output differs.
    pub fn replay<I: DeserializeOwned, O: Serialize>(
        mut self,
        mut step: impl FnMut(i64, &I) -> O,
    ) -> Result<(u64, Option<u64>), LogError> {
        let mut steps = 0;
        let mut different = None;
        while let Some((now_ns, input, output_hash)) = self.step::<I>()? {
            let output = step(now_ns, &input);
            if wire::hash_record(&output)? != output_hash {
                different.get_or_insert(steps);
            }
            steps += 1;
        }
        Ok((steps, different))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log(name: &str, steps: &[(u32, u32)]) -> std::path::PathBuf {
        let directory = std::env::temp_dir().join(format!("alight-record-{}-{name}", std::process::id()));
        let head = LogHeader {
            process: "test".into(),
            boot: 7,
            config: "x = 1".into(),
        };
        let mut log_writer = LogWriter::create(&directory, &head).unwrap();
        for (k, (input, output)) in steps.iter().enumerate() {
            log_writer.write(k as i64, input, output);
        }
        log_writer.flush();
        directory.join("test-00000007.log")
    }

    #[test]
    fn node_log_replay_reports_the_first_difference() {
        let path = log("replay", &[(1, 2), (2, 4), (3, 7), (4, 8)]);
        let (opened, head) = LogReader::open(&path).unwrap();
        assert_eq!(
            (head.process.as_str(), head.boot, head.config.as_str()),
            ("test", 7, "x = 1")
        );
        assert_eq!(opened.replay(|_, i: &u32| i * 2).unwrap(), (4, Some(2)));
        std::fs::remove_dir_all(path.parent().unwrap()).unwrap();
    }

    #[test]
    fn truncated_node_log_replays_up_to_the_cut() {
        let path = log("cut", &[(1, 2), (2, 4)]);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 3]).unwrap();
        let (opened, _) = LogReader::open(&path).unwrap();
        assert_eq!(opened.replay(|_, i: &u32| i * 2).unwrap(), (1, None));
        std::fs::write(&path, [255; 8]).unwrap();
        assert!(matches!(LogReader::open(&path), Err(LogError::Length(_))));
        std::fs::remove_dir_all(path.parent().unwrap()).unwrap();
    }
}
