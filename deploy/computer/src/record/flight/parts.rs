//! Parts of one start of a process: rotated by size and age, synchronised every second, retried when the disk rejects
//! writes.

use std::{
    fs::File,
    io,
    path::{Path, PathBuf},
    sync::Once,
};

use alight_shared::step::Recorded;
use iceoryx2_bb_posix::signal::{FetchableSignal, SignalHandler};
use mcap::{Compression, McapError};
use time::OffsetDateTime;
use tracing::{info, warn};

use super::{MIN_FREE_BYTES, free_bytes};
use crate::record::{
    EXTENSION,
    entry::{self, PartHeader, References},
    sink::{ChannelId, Sink, why},
};

const S: i64 = 1_000_000_000;
/// Size of a part, bytes of steps: at this size or at the maximum age a part is finished and the next begins.
const PART_BYTES: u64 = 64 << 20;
const PART_NS: i64 = 600 * S;
/// Maximum delay between writing steps and synchronising the disk, ns. It is half of the loss that a power cut may
/// cause; the age of a batch is the other half.
const SYNC_PERIOD_NS: i64 = S;
/// Delay before a retry after the disk rejected a write, ns.
const RETRY_PERIOD_NS: i64 = 10 * S;
const WARNING_PERIOD_NS: i64 = 10 * S;

#[derive(Default)]
pub struct Batch {
    pub bytes: Vec<u8>,
    /// Number of each step, steady time at its end (ns), and end of its entry in `bytes`.
    pub marks: Vec<(u64, i64, usize)>,
}

impl Batch {
    /// Adds the step with this number. A step larger than the largest record is left out, and its number is missing.
    pub fn add(
        &mut self,
        (step, at_ns): (u64, i64),
        now_ns: i64,
        (input, output): (&dyn Recorded, &dyn Recorded),
    ) {
        let begin = self.bytes.len();
        let whole = References::default();
        if entry::append(&mut self.bytes, now_ns, (input, whole, output)).is_err() {
            return self.bytes.truncate(begin);
        }
        self.marks.push((step, at_ns, self.bytes.len()));
    }
    pub fn clear(&mut self) {
        self.bytes.clear();
        self.marks.clear();
    }
}

pub struct PartWriter {
    sink: Sink,
    /// Second handle of the file, for synchronisation.
    file: File,
    channel: ChannelId,
    path: PathBuf,
    began_ns: i64,
    bytes: u64,
    /// Number of steps that are not on the disk yet, and the time of the first.
    unsynced: u64,
    unsynced_ns: i64,
}

impl PartWriter {
    /// Creates the file, which must not exist, at `steady_ns` of the steady clock.
    pub fn create(path: &Path, header: &PartHeader, steady_ns: i64) -> Result<PartWriter, McapError> {
        if let Some(directory) = path.parent() {
            std::fs::create_dir_all(directory)?;
        }
        let file = File::create_new(path)?;
        let begun = PartWriter::on(file, path, header, steady_ns).and_then(|mut part| {
            // Detects a full disk now, and makes the file's name survive a power cut.
            part.sync()?;
            let directory = path.parent().unwrap_or(Path::new("."));
            File::open(directory)?.sync_all()?;
            Ok(part)
        });
        if begun.is_err() {
            // A file with an incomplete beginning is not a valid part.
            let _none = std::fs::remove_file(path);
        }
        begun
    }
    fn on(file: File, path: &Path, header: &PartHeader, steady_ns: i64) -> Result<PartWriter, McapError> {
        // Compression halves a vessel's bytes, which are recorded day and night, at a cost of 2 ms of processor time
        // per second. Forecasts, most of a drone's bytes, do not become smaller.
        let mut sink = Sink::of(file.try_clone()?, Some(Compression::Lz4), true)?;
        let channel = sink.process(header, std::iter::empty())?;
        Ok(PartWriter {
            sink,
            file,
            channel,
            path: path.into(),
            began_ns: steady_ns,
            bytes: 0,
            unsynced: 0,
            unsynced_ns: steady_ns,
        })
    }
    /// Writes a step that ended at `at_ns` of the steady clock and at `utc_ns` UTC.
    pub fn write(&mut self, step: u64, (at_ns, utc_ns): (i64, u64), bytes: &[u8]) -> Result<(), McapError> {
        if self.unsynced == 0 {
            self.unsynced_ns = at_ns;
        }
        // Counted before the write, because a step whose write fails is not on the disk either.
        self.unsynced += 1;
        self.bytes += bytes.len() as u64;
        // The 32-bit sequence number may wrap: the reader knows the part's first step.
        self.sink.write(self.channel, step as u32, utc_ns, bytes)
    }
    fn sync(&mut self) -> Result<(), McapError> {
        self.sink.flush()?;
        self.file.sync_data()?;
        self.unsynced = 0;
        Ok(())
    }
    fn is_due(&self, steady_ns: i64) -> bool {
        self.unsynced > 0 && steady_ns >= self.unsynced_ns.saturating_add(SYNC_PERIOD_NS)
    }
    pub fn finish(self) -> Result<(), McapError> {
        self.sink.finish()?;
        self.file.sync_data()?;
        Ok(())
    }
}

/// Successive parts of one start of a process. If the disk is full or read-only, the process continues without
/// recording; the failure is reported, and a new part is tried every 10 s.
pub struct Parts {
    directory: PathBuf,
    header: PartHeader,
    part: Option<PartWriter>,
    tried: u32,
    next: u64,
    /// Number of steps that are not on the disk and will not be written.
    missing: u64,
    /// The disk has rejected a write, which is already reported.
    failed: bool,
    retry_ns: i64,
    /// Steps that came too fast since the last warning, and the earliest time of the next warning.
    dropped: u64,
    warning_ns: i64,
    /// UTC minus the steady clock, ns: keeps UTC steady while a receiver sets the system clock.
    utc_ahead_ns: i128,
}

impl Parts {
    /// Parts of a start; the first begins with the first step.
    pub fn new(directory: &Path, header: PartHeader, steady_ns: i64) -> Parts {
        survive_size_limit();
        Parts {
            directory: directory.into(),
            header,
            part: None,
            tried: 0,
            next: 0,
            missing: 0,
            failed: false,
            retry_ns: steady_ns,
            dropped: 0,
            warning_ns: steady_ns,
            utc_ahead_ns: OffsetDateTime::now_utc().unix_timestamp_nanos() - i128::from(steady_ns),
        }
    }
    /// Number of steps not recorded because the disk rejected writes or was too slow.
    pub fn missing(&self) -> u64 {
        self.missing
    }
    pub fn write(&mut self, steady_ns: i64, batch: &Batch) {
        let mut begin = 0;
        for &(step, at_ns, end) in &batch.marks {
            let bytes = batch.bytes.get(begin..end).unwrap_or_default();
            begin = end;
            let skipped = step.saturating_sub(self.next);
            self.missing += skipped;
            self.dropped += skipped;
            self.next = step + 1;
            self.rotate(steady_ns);
            if self.part.is_none() && steady_ns >= self.retry_ns {
                self.open(steady_ns, step);
            }
            let utc_ns = u64::try_from(self.utc_ahead_ns + i128::from(at_ns)).unwrap_or_default();
            match self.part.as_mut().map(|p| p.write(step, (at_ns, utc_ns), bytes)) {
                None => self.missing += 1,
                Some(Ok(())) => {}
                Some(Err(e)) => self.fail(steady_ns, &e),
            }
        }
    }
    pub fn poll(&mut self, steady_ns: i64) {
        if self.dropped > 0 && steady_ns >= self.warning_ns {
            warn!(
                "{} steps of {} are not recorded: the disk is too slow",
                self.dropped, self.header.process
            );
            self.dropped = 0;
            self.warning_ns = steady_ns.saturating_add(WARNING_PERIOD_NS);
        }
        let due = self.part.as_mut().filter(|p| p.is_due(steady_ns));
        let done = due.map(|part| {
            part.sync()?;
            enough_room(&self.directory)
        });
        if let Some(Err(e)) = done {
            self.fail(steady_ns, &e);
        }
    }
    pub fn finish(&mut self, steady_ns: i64) {
        if let Some(Err(e)) = self.part.as_mut().map(PartWriter::sync) {
            return self.fail(steady_ns, &e);
        }
        let Some(part) = self.part.take() else { return };
        let path = part.path.clone();
        // Its steps are already on the disk.
        if let Err(e) = part.finish() {
            self.report_failure(steady_ns, &path, &e);
        }
    }
    fn rotate(&mut self, steady_ns: i64) {
        let full = |p: &PartWriter| p.bytes >= PART_BYTES || steady_ns >= p.began_ns.saturating_add(PART_NS);
        if self.part.as_ref().is_some_and(full) {
            self.finish(steady_ns);
        }
    }
    fn open(&mut self, steady_ns: i64, step: u64) {
        self.tried = self.tried.saturating_add(1);
        self.header.first_step = step;
        let PartHeader { process, boot, .. } = &self.header;
        let name = format!("{process}-{boot:08x}-{:03}.{EXTENSION}", self.tried);
        let path = self.directory.join(name);
        // If the directory does not exist, creating the file reports the error.
        let begun =
            enough_room(&self.directory).and_then(|()| PartWriter::create(&path, &self.header, steady_ns));
        match begun {
            Ok(part) => {
                if self.failed {
                    let missing = self.missing;
                    info!(
                        "{process} is recorded again, in {}; {missing} steps are missing",
                        path.display()
                    );
                }
                self.failed = false;
                self.part = Some(part);
            }
            Err(e) => self.report_failure(steady_ns, &path, &e),
        }
    }
    /// Ends an open part that cannot be written; its steps that are not on the disk are lost.
    fn fail(&mut self, steady_ns: i64, error: &McapError) {
        let Some(part) = self.part.take() else { return };
        self.missing += part.unsynced;
        let path = part.path.clone();
        // Dropping the writer tries to end the file; without an end, the steps on the disk remain readable.
        drop(part);
        self.report_failure(steady_ns, &path, error);
    }
    fn report_failure(&mut self, steady_ns: i64, path: &Path, error: &McapError) {
        // Reported once per outage, not at each retry.
        if !self.failed {
            warn!(
                "{} continues without its recorder: writing {}: {}; free space, or make the directory writable: it \
                 is tried again every {} s",
                self.header.process,
                path.display(),
                why(error),
                RETRY_PERIOD_NS / S
            );
        }
        self.failed = true;
        self.retry_ns = steady_ns.saturating_add(RETRY_PERIOD_NS);
    }
}

/// Returns an error if less space is free than recording must leave.
fn enough_room(directory: &Path) -> Result<(), McapError> {
    match free_bytes(directory) {
        Some(free) if free < MIN_FREE_BYTES => Err(McapError::Io(io::Error::other(format!(
            "{} MB are free, of which {} MB are left to the rest of the computer",
            free >> 20,
            MIN_FREE_BYTES >> 20
        )))),
        Some(_) | None => Ok(()),
    }
}

/// Turns a write beyond the limit on file sizes (setrlimit(2)) into an error, as on a full disk; by default a
/// signal would end the process.
fn survive_size_limit() {
    static ONCE: Once = Once::new();
    static NOTHING: fn(FetchableSignal) = |_| {};
    ONCE.call_once(|| {
        if let Ok(guard) = SignalHandler::register(FetchableSignal::FileSizeLimitExceeded, &NOTHING) {
            std::mem::forget(guard);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        record::{
            entry::Entry,
            log::{Log, ReplayOrder},
            reading::{LogFile, LogStep, is_whole, parts, read_header},
        },
        scratch::scratch,
    };
    use alight_shared::wire;
    use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, memfd_create};
    use std::sync::OnceLock;

    fn begin(directory: &Path) -> Parts {
        let header = PartHeader {
            process: "test".into(),
            boot: 7,
            config: "x = 1".into(),
            ..PartHeader::default()
        };
        Parts::new(directory, header, 0)
    }
    /// A batch with one step, whose number is in twelve bytes of input.
    fn batch(step: u64, ns: i64) -> Batch {
        let entry = Entry {
            now_ns: ns,
            input: (step, 1_u32),
            references: References::default(),
            output: 2 * step,
        };
        let bytes = wire::encode_record(&entry).unwrap();
        Batch {
            marks: vec![(step, ns, bytes.len())],
            bytes,
        }
    }
    fn numbers(path: &Path) -> Vec<u64> {
        let mut found = Vec::new();
        let log = Log::open(path).unwrap();
        let each = |_, _, step: &LogStep<'_>| {
            let entry = step.entry::<(u64, u32)>()?;
            assert_eq!((entry.input.0, entry.output), (step.number, 2 * step.number));
            found.push(step.number);
            Ok(())
        };
        log.steps(ReplayOrder::ByStart, each).unwrap();
        found
    }

    #[test]
    fn part_rotation_by_size_and_age() {
        let directory = scratch("parts-rotated");
        let mut written = begin(&directory);
        for step in 0..4 {
            written.write(0, &batch(step, 0));
        }
        // Rotated by age, then by size: this step is as large as a part.
        written.write(PART_NS, &batch(4, PART_NS));
        if let Some(part) = &mut written.part {
            part.bytes = PART_BYTES;
        }
        written.write(PART_NS + 1, &batch(5, PART_NS + 1));
        written.finish(PART_NS + 1);
        assert_eq!(written.missing(), 0);
        let files = parts(&directory).unwrap();
        assert!(files.len() == 3 && files.iter().all(|f| is_whole(f)), "{files:?}");
        let firsts = files
            .iter()
            .map(|f| LogFile::open(f).unwrap().headers[0].first_step);
        assert_eq!(firsts.collect::<Vec<_>>(), [0, 4, 5]);
        let header = &LogFile::open(&files[2]).unwrap().headers[0];
        assert_eq!(
            (header.process.as_str(), header.boot, header.config.as_str()),
            ("test", 7, "x = 1")
        );
        assert_eq!(numbers(&directory), [0, 1, 2, 3, 4, 5]);
        std::fs::remove_dir_all(&directory).unwrap();
    }

    #[test]
    fn part_synchronisation_within_a_second() {
        let directory = scratch("parts-synchronised");
        let mut written = begin(&directory);
        for (k, ns) in [0, S / 2, S].into_iter().enumerate() {
            written.write(ns, &batch(k as u64, ns));
            written.poll(ns);
        }
        let file = parts(&directory).unwrap().remove(0);
        assert!(!is_whole(&file) && LogFile::open(&file).unwrap().cut.is_some());
        assert_eq!(numbers(&directory), [0, 1, 2]);
        written.write(S + 1, &batch(3, S + 1));
        written.poll(2 * S);
        assert_eq!(numbers(&directory).len(), 3);
        written.poll(2 * S + 1);
        assert_eq!(numbers(&directory).len(), 4);
        std::fs::remove_dir_all(&directory).unwrap();
    }

    #[test]
    fn parts_on_a_blocked_disk() {
        let directory = scratch("parts-blocked");
        // A file in place of the directory, in which not even root can create files.
        std::fs::write(&directory, "").unwrap();
        let mut written = begin(&directory);
        written.write(S, &batch(0, S));
        std::fs::remove_file(&directory).unwrap();
        written.write(9 * S, &batch(1, 9 * S));
        assert!(written.missing() == 2 && !directory.exists(), "tried within 10 s");
        written.write(11 * S, &batch(2, 11 * S));
        written.finish(11 * S);
        assert_eq!((written.missing(), numbers(&directory)), (2, vec![2]));
        std::fs::remove_dir_all(&directory).unwrap();
    }

    #[test]
    fn parts_on_a_full_disk() {
        let directory = scratch("parts-full");
        let mut written = begin(&directory);
        written.write(0, &batch(0, 0));
        written.poll(S);
        let full = File::from(memfd_create("full", MemfdFlags::ALLOW_SEALING).unwrap());
        let sealed = full.try_clone().unwrap();
        let mut part = PartWriter::on(full, &directory.join("full"), &written.header, S).unwrap();
        part.sync().unwrap();
        fcntl_add_seals(&sealed, SealFlags::GROW).unwrap();
        let before = written.part.replace(part).unwrap();
        written.write(S, &batch(1, S));
        written.poll(2 * S);
        written.write(3 * S, &batch(2, 3 * S));
        assert_eq!(written.missing(), 2);
        written.write(12 * S, &batch(3, 12 * S));
        written.finish(12 * S);
        before.finish().unwrap();
        assert_eq!((written.missing(), numbers(&directory)), (2, vec![0, 3]));
        std::fs::remove_dir_all(&directory).unwrap();
    }

    #[test]
    fn missing_steps() {
        let directory = scratch("parts-gap");
        let mut written = begin(&directory);
        for step in [0, 1, 5, 6] {
            written.write(0, &batch(step, 0));
        }
        written.finish(0);
        assert_eq!((written.missing(), numbers(&directory)), (3, vec![0, 1, 5, 6]));
        std::fs::remove_dir_all(&directory).unwrap();
    }

    /// Header and bytes of a part; after each chunk, the length and the number of steps so far.
    type Chunks = (PartHeader, Vec<u8>, Vec<(usize, usize)>);

    /// A part of four chunks with 1 to 4 steps.
    fn chunks() -> &'static Chunks {
        static CHUNKS: OnceLock<Chunks> = OnceLock::new();
        CHUNKS.get_or_init(write_chunks)
    }
    fn write_chunks() -> Chunks {
        let directory = scratch("parts-chunks");
        let mut written = begin(&directory);
        let mut step = 0;
        let mut lengths = Vec::new();
        for chunk in 1..=4_i64 {
            for _ in 0..chunk {
                written.write(chunk * 10 * S, &batch(step, chunk * 10 * S));
                step += 1;
            }
            written.poll(chunk * 10 * S + S);
            let file = &parts(&directory).unwrap()[0];
            lengths.push((std::fs::metadata(file).unwrap().len() as usize, step as usize));
        }
        written.finish(100 * S);
        let bytes = std::fs::read(&parts(&directory).unwrap()[0]).unwrap();
        std::fs::remove_dir_all(&directory).unwrap();
        (written.header, bytes, lengths)
    }

    #[test]
    fn part_cut_at_any_byte() {
        let (header, bytes, lengths) = chunks();
        let directory = scratch("parts-cut");
        std::fs::create_dir_all(&directory).unwrap();
        let path = directory.join("test-00000007-001.mcap");
        for cut in 0..bytes.len() {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            let before = lengths
                .iter()
                .rev()
                .find(|(length, _)| *length <= cut)
                .map_or(0, |l| l.1);
            if read_header(&path).unwrap().is_none() {
                assert_eq!(before, 0, "{cut} bytes");
                continue;
            }
            let part = LogFile::open(&path).unwrap();
            assert_eq!(
                (&part.headers[0], part.cut.is_some()),
                (header, true),
                "{cut} bytes"
            );
            // The last chunk counts once it is complete, even if its index is not.
            assert!(part.steps() >= before && numbers(&path) == (0..part.steps() as u64).collect::<Vec<_>>());
            let after = lengths
                .iter()
                .find(|(length, _)| *length > cut)
                .map_or(usize::MAX, |l| l.1);
            assert!(part.steps() <= after, "{cut} bytes");
        }
        std::fs::write(&path, bytes).unwrap();
        assert_eq!(
            (LogFile::open(&path).unwrap().cut, numbers(&path).len()),
            (None, 10)
        );
        std::fs::remove_dir_all(&directory).unwrap();
    }

    proptest::proptest! {
        #![proptest_config(proptest::test_runner::Config::with_cases(64))]
        /// Part followed by bytes that a power cut may leave after the last synchronised chunk: none, zeros or old
        /// content.
        #[test]
        fn part_with_a_damaged_tail(
            (chunk, tail) in (0_usize..4, proptest::collection::vec(proptest::num::u8::ANY, 0..300)),
            zeros in 0_usize..5000,
        ) {
            let (_, bytes, lengths) = chunks();
            let (length, steps) = lengths[chunk];
            let path = scratch("parts-tail").with_extension("mcap");
            for tail in [tail, vec![0; zeros]] {
                std::fs::write(&path, [&bytes[..length], &tail].concat()).unwrap();
                // A record with a length beyond the file's end makes the MCAP reader panic; the tools contain the
                // panic.
                let read = crate::record::reading::contained(&path, || LogFile::open(&path));
                proptest::prop_assert_eq!(read.map(|p| p.steps()).unwrap_or(usize::MAX), steps);
            }
            std::fs::remove_file(&path).unwrap();
        }
    }
}
