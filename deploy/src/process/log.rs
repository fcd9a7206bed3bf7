//! A log of what a process consumed: configuration, boot id, then every step's time and input with
//! a hash of the output. Enough to compute every output again.
//!
//! Layout: records of a 4-byte length (little endian) and that many bytes. The first is [`LogHeader`],
//! each other a [`Step`], both as bincode.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Once;

use alight_shared::wire::{self, MAX_RECORD_BYTES};
use iceoryx2_bb_posix::signal::{FetchableSignal, SignalHandler};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use tracing::{info, warn};

use crate::exit::{CliError, Doing};

/// The files of a log grow no longer than this together, bytes: about ten minutes of the busiest process.
const MAX_LOG_BYTES: u64 = 256 << 20;
/// A log that cannot be written is tried again after this long, ns.
const RETRY_PERIOD_NS: i64 = 10_000_000_000;

/// The beginning of a log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LogHeader {
    /// Name of the process.
    pub process: String,
    /// Its boot id.
    pub boot: u32,
    /// Steps of the process before the first in this file: above zero where an earlier file could not be written,
    /// and the node's state is not known.
    pub first_step: u64,
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

/// One file of a log.
struct LogWriter {
    file: BufWriter<File>,
    path: PathBuf,
    written: u64,
}

impl LogWriter {
    fn create(path: &Path, header: &LogHeader) -> std::io::Result<LogWriter> {
        path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
        let mut writer = LogWriter {
            file: BufWriter::new(File::create(path)?),
            path: path.into(),
            written: 0,
        };
        writer.put(&wire::encode_record(header).map_err(std::io::Error::other)?)?;
        // A disk that is full is found out now.
        writer.file.flush()?;
        Ok(writer)
    }
    fn put(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.file.write_all(&(bytes.len() as u32).to_le_bytes())?;
        self.file.write_all(bytes)?;
        self.written += 4 + bytes.len() as u64;
        Ok(())
    }
    fn write<I: Serialize, O: Serialize>(
        &mut self,
        now_ns: i64,
        input: &I,
        output: &O,
    ) -> std::io::Result<()> {
        let step = wire::hash_record(output).and_then(|output_hash| {
            wire::encode_record(&Step {
                now_ns,
                input,
                output_hash,
            })
        });
        self.put(&step.map_err(std::io::Error::other)?)
    }
}

/// The log of a node, which goes on without it where it cannot be written: on a disk that is full or read-only. That
/// is reported, and tried again every 10 s in a file of its own.
pub struct NodeLog {
    directory: PathBuf,
    header: LogHeader,
    writer: Option<LogWriter>,
    /// Files begun.
    files: u32,
    /// In the files before this one, bytes.
    written: u64,
    steps: u64,
    unlogged: u64,
    retry_ns: i64,
}

impl NodeLog {
    /// Begins a log in `directory`, named after process and boot id, at `steady_ns` of the steady clock.
    pub fn begin(directory: &Path, header: LogHeader, steady_ns: i64) -> NodeLog {
        survive_size_limit();
        let mut log = NodeLog {
            directory: directory.into(),
            header,
            writer: None,
            files: 0,
            written: 0,
            steps: 0,
            unlogged: 0,
            retry_ns: steady_ns,
        };
        log.open(steady_ns);
        log
    }
    /// Begins a file.
    fn open(&mut self, steady_ns: i64) {
        let LogHeader { process, boot, .. } = &self.header;
        let part = if self.files == 0 {
            String::new()
        } else {
            format!("-{}", self.files + 1)
        };
        let path = self.directory.join(format!("{process}-{boot:08x}{part}.log"));
        self.header.first_step = self.steps;
        match LogWriter::create(&path, &self.header) {
            Ok(writer) => {
                if self.unlogged > 0 {
                    let (process, n) = (&self.header.process, self.unlogged);
                    info!(
                        "{process} is logged again, in {}; {n} steps are missing",
                        path.display()
                    );
                }
                self.files += 1;
                self.writer = Some(writer);
            }
            Err(e) => {
                // Half a beginning is no log; what was there before, such as a directory, stays.
                let _none = path.is_file() && std::fs::remove_file(&path).is_ok();
                self.fail(steady_ns, &path, &e);
            }
        }
    }
    /// The file cannot be written: without it from now on.
    fn fail(&mut self, steady_ns: i64, path: &Path, error: &std::io::Error) {
        // Once for each time, and not at each of the tries in it.
        if self.writer.is_some() || self.unlogged == 0 {
            warn!(
                "{} goes on without its log: writing {}: {error}; free space, or make the directory writable: it is \
                 tried again every {} s",
                self.header.process,
                path.display(),
                RETRY_PERIOD_NS / 1_000_000_000
            );
        }
        self.written += self.writer.take().map_or(0, |w| w.written);
        self.retry_ns = steady_ns.saturating_add(RETRY_PERIOD_NS);
    }
    /// Logs one step, which ended at `steady_ns` of the steady clock.
    pub fn write<I: Serialize, O: Serialize>(&mut self, steady_ns: i64, now_ns: i64, input: &I, output: &O) {
        let written = self.writer.as_ref().map_or(0, |w| w.written);
        if self.written + written > MAX_LOG_BYTES {
            return;
        }
        if self.writer.is_none() && steady_ns >= self.retry_ns {
            self.open(steady_ns);
        }
        self.steps += 1;
        let done = self.writer.as_mut().map(|w| w.write(now_ns, input, output));
        self.settle(steady_ns, done.unwrap_or(Ok(())));
        self.unlogged += u64::from(self.writer.is_none());
    }
    /// Puts on disk what was logged.
    pub fn flush(&mut self, steady_ns: i64) {
        let done = self.writer.as_mut().map(|w| w.file.flush());
        self.settle(steady_ns, done.unwrap_or(Ok(())));
    }
    fn settle(&mut self, steady_ns: i64, done: std::io::Result<()>) {
        let path = self.writer.as_ref().map(|w| w.path.clone());
        if let (Err(e), Some(path)) = (done, path) {
            self.fail(steady_ns, &path, &e);
        }
    }
    /// Steps that are not in it because it could not be written.
    pub fn unlogged(&self) -> u64 {
        self.unlogged
    }
}

/// Beyond a limit on the size of files (setrlimit(2)) a write is an error from now on, as on a full disk: by itself
/// the signal of it ends the process.
fn survive_size_limit() {
    static ONCE: Once = Once::new();
    static NOTHING: fn(FetchableSignal) = |_| {};
    // Where it is handled already, it ends nothing.
    ONCE.call_once(|| {
        if let Ok(guard) = SignalHandler::register(FetchableSignal::FileSizeLimitExceeded, &NOTHING) {
            std::mem::forget(guard);
        }
    });
}

/// Whether logs can be written into `directory`, for a command that is of no use without them.
pub fn can_write(directory: &Path) -> Result<(), CliError> {
    let probe = directory.join(".alight");
    let done = std::fs::create_dir_all(directory).and_then(|()| std::fs::write(&probe, "log"));
    let removed = done.and_then(|()| std::fs::remove_file(&probe));
    removed.doing(format_args!("writing a log into {}", directory.display()))
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

    fn directory(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("alight-record-{}-{name}", std::process::id()))
    }
    fn begin(directory: &Path) -> NodeLog {
        let head = LogHeader {
            process: "test".into(),
            boot: 7,
            first_step: 0,
            config: "x = 1".into(),
        };
        NodeLog::begin(directory, head, 0)
    }
    fn log(name: &str, steps: &[(u32, u32)]) -> PathBuf {
        let directory = directory(name);
        let mut log = begin(&directory);
        for (k, (input, output)) in steps.iter().enumerate() {
            log.write(0, k as i64, input, output);
        }
        log.flush(0);
        assert_eq!(log.unlogged(), 0);
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

    #[test]
    fn node_log_that_cannot_be_written_is_tried_again_every_10_s() {
        const S: i64 = 1_000_000_000;
        let directory = directory("blocked");
        // A file in the place of the directory: no permission of root writes below it.
        std::fs::write(&directory, "").unwrap();
        let mut log = begin(&directory);
        log.write(S, 1, &1_u32, &2_u32);
        log.flush(S);
        std::fs::remove_file(&directory).unwrap();
        log.write(9 * S, 2, &2_u32, &4_u32);
        assert!(log.unlogged() == 2 && !directory.exists(), "tried within 10 s");
        log.write(10 * S, 3, &3_u32, &6_u32);
        log.flush(10 * S);
        assert_eq!(log.unlogged(), 2);
        let (opened, head) = LogReader::open(&directory.join("test-00000007.log")).unwrap();
        assert_eq!(head.first_step, 2);
        assert_eq!(opened.replay(|_, i: &u32| i * 2).unwrap(), (1, None));
        std::fs::remove_dir_all(&directory).unwrap();
    }

    #[test]
    fn node_log_on_a_disk_that_fills_up_goes_on_in_a_file_of_its_own() {
        const S: i64 = 1_000_000_000;
        let directory = directory("full");
        let mut log = begin(&directory);
        log.write(0, 1, &1_u32, &2_u32);
        log.flush(0);
        // Every write to this device fails: no space left.
        log.writer.as_mut().unwrap().file =
            BufWriter::new(File::options().write(true).open("/dev/full").unwrap());
        log.write(S, 2, &2_u32, &4_u32);
        log.flush(S);
        log.write(S, 3, &3_u32, &6_u32);
        assert_eq!(
            log.unlogged(),
            1,
            "the step that was under way is lost with its file"
        );
        log.write(12 * S, 4, &4_u32, &8_u32);
        log.flush(12 * S);
        let steps = |name: &str| {
            let (opened, head) = LogReader::open(&directory.join(name)).unwrap();
            (head.first_step, opened.replay(|_, i: &u32| i * 2).unwrap())
        };
        assert_eq!(steps("test-00000007.log"), (0, (1, None)));
        assert_eq!(steps("test-00000007-2.log"), (3, (1, None)));
        std::fs::remove_dir_all(&directory).unwrap();
    }
}
