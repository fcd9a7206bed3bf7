//! Recorder of a process's steps. It never waits: a thread writes the steps in batches; steps that find the queue
//! full are counted and left out.

use std::{
    fs,
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicU64, AtomicUsize, Ordering},
        mpsc::{Receiver, SyncSender, TryRecvError, sync_channel},
    },
    thread::{Builder, JoinHandle},
    time::Duration,
};

use alight_shared::step::Recorded;
use alight_transport::clock::steady_ns;
use tracing::warn;

use super::{
    parts::{Batch, Parts},
    yield_to_flight,
};
use crate::exit::{CliError, Doing};

pub use crate::record::entry::PartHeader;

/// Size at which a batch is passed to the thread, bytes; it is also passed when its first step reaches the maximum
/// age.
const BATCH_BYTES: usize = 64 << 10;
const BATCH_NS: i64 = 200_000_000;
/// Maximum number of batches in the queue: enough for more than 10 s of a disk that does not respond.
const BATCHES: usize = 64;
/// Maximum number of bytes in the queue, mainly images: 3 s at 9 MB/s.
const MAX_WAITING_BYTES: usize = 32 << 20;
/// Period at which the thread polls the queue. It is not woken, because a process in flight must not take a lock that
/// a thread of lower priority may hold.
const POLL_PERIOD: Duration = Duration::from_millis(100);

pub struct NodeRecorder {
    batch: Batch,
    since_ns: i64,
    steps: u64,
    /// Number of dropped steps that the thread has not counted yet.
    dropped: u64,
    to: Option<SyncSender<Batch>>,
    free: Receiver<Batch>,
    waiting: Arc<AtomicUsize>,
    missing: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl NodeRecorder {
    /// Starts recording to `directory`. Call this before the process sets its scheduling, which the thread
    /// must not inherit.
    pub fn begin(directory: &Path, header: PartHeader) -> NodeRecorder {
        let (to, batches) = sync_channel(BATCHES);
        let (give_back, free) = sync_channel(BATCHES);
        let missing = Arc::<AtomicU64>::default();
        let waiting = Arc::<AtomicUsize>::default();
        let name = header.process.clone();
        let counts = (Arc::clone(&waiting), Arc::clone(&missing));
        let directory = directory.to_owned();
        let thread = Builder::new().name("recorder".into()).spawn(move || {
            yield_to_flight();
            let parts = Parts::new(&directory, header, steady_ns());
            write(parts, &batches, &give_back, (&counts.0, &counts.1));
        });
        let thread = thread
            .map_err(|e| warn!("{name} continues without its recorder: starting its thread: {e}"))
            .ok();
        NodeRecorder {
            batch: Batch::default(),
            since_ns: 0,
            steps: 0,
            dropped: 0,
            to: Some(to),
            free,
            waiting,
            missing,
            thread,
        }
    }
    /// Records one step, which ended at `at_ns` of the steady clock.
    pub fn step(&mut self, at_ns: i64, now_ns: i64, input: &dyn Recorded, output: &dyn Recorded) {
        if self.batch.marks.is_empty() {
            self.since_ns = at_ns;
        }
        self.batch.add((self.steps, at_ns), now_ns, (input, output));
        self.steps += 1;
        if self.batch.bytes.len() >= BATCH_BYTES || at_ns >= self.since_ns.saturating_add(BATCH_NS) {
            self.hand_over();
        }
    }
    fn hand_over(&mut self) {
        let empty = self.free.try_recv().unwrap_or_default();
        let full = core::mem::replace(&mut self.batch, empty);
        let steps = full.marks.len() as u64;
        let bytes = full.bytes.len();
        let has_room = self.waiting.fetch_add(bytes, Ordering::Relaxed) + bytes <= MAX_WAITING_BYTES;
        let to = self.to.as_ref().filter(|_| has_room);
        let sent = to.is_some_and(|to| to.try_send(full).is_ok());
        if !sent {
            self.waiting.fetch_sub(bytes, Ordering::Relaxed);
        }
        // The thread counts the missing steps before the next batch that reaches it.
        self.dropped = if sent { 0 } else { self.dropped + steps };
    }
    /// Number of steps not recorded because the disk rejected writes or was too slow.
    pub fn missing(&self) -> u64 {
        self.missing.load(Ordering::Relaxed) + self.dropped
    }
}

impl Drop for NodeRecorder {
    fn drop(&mut self) {
        self.hand_over();
        self.to = None;
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ended = thread.join();
        }
    }
}

fn write(
    mut parts: Parts,
    batches: &Receiver<Batch>,
    give_back: &SyncSender<Batch>,
    (waiting, missing): (&AtomicUsize, &AtomicU64),
) {
    loop {
        match batches.try_recv() {
            Ok(mut batch) => {
                parts.write(steady_ns(), &batch);
                waiting.fetch_sub(batch.bytes.len(), Ordering::Relaxed);
                batch.clear();
                // If the queue of empty buffers is full, this buffer is not reused.
                let _unused = give_back.try_send(batch);
            }
            Err(TryRecvError::Empty) => std::thread::park_timeout(POLL_PERIOD),
            Err(TryRecvError::Disconnected) => break,
        }
        parts.poll(steady_ns());
        missing.store(parts.missing(), Ordering::Relaxed);
    }
    parts.finish(steady_ns());
}

/// Checks that `directory` can be recorded to, for a command that would otherwise be useless.
pub fn can_write(directory: &Path) -> Result<(), CliError> {
    let probe = directory.join(".alight");
    let done = fs::create_dir_all(directory).and_then(|()| fs::write(&probe, "recorder"));
    let removed = done.and_then(|()| fs::remove_file(&probe));
    removed.doing(format_args!("recording into {}", directory.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        record::log::{Log, ReplayOrder},
        scratch::scratch,
    };
    use alight_shared::wire;

    #[test]
    fn recorder_of_every_step() {
        let directory = scratch("recorder");
        let header = PartHeader {
            process: "test".into(),
            boot: 7,
            ..PartHeader::default()
        };
        let mut recorder = NodeRecorder::begin(&directory, header);
        let began_ns = steady_ns();
        for k in 0..1000_u64 {
            recorder.step(began_ns + k as i64, k as i64, &vec![k; 20], &k);
        }
        assert_eq!(recorder.missing(), 0);
        drop(recorder);
        let mut read = 0;
        let log = Log::open(&directory).unwrap();
        log.steps(ReplayOrder::ByStart, |_, _, step| {
            let entry = step.entry::<Vec<u64>>()?;
            assert_eq!(
                (step.number, entry.now_ns, entry.input),
                (read, read as i64, vec![read; 20])
            );
            assert_eq!(entry.output, wire::hash_record(&read)?);
            read += 1;
            Ok(())
        })
        .unwrap();
        assert_eq!(read, 1000);
        fs::remove_dir_all(&directory).unwrap();
    }

    #[test]
    fn recorder_with_a_slow_thread() {
        let (to, batches) = sync_channel::<Batch>(BATCHES);
        let (_give_back, free) = sync_channel(BATCHES);
        let mut recorder = NodeRecorder {
            batch: Batch::default(),
            since_ns: 0,
            steps: 0,
            dropped: 0,
            to: Some(to),
            free,
            waiting: Arc::default(),
            missing: Arc::default(),
            thread: None,
        };
        let image = vec![0_u8; MAX_WAITING_BYTES / 16];
        for k in 0..20 {
            recorder.step(k, k, &image, &());
        }
        assert_eq!(recorder.missing(), 5, "each takes a little more than a sixteenth");
        assert_eq!(batches.try_iter().count(), 15);
        recorder.dropped = 0;
        recorder.waiting = Arc::default();
        for k in 0..10 * BATCHES as i64 {
            recorder.step(k, k, &vec![0_u8; BATCH_BYTES / 2], &());
        }
        let taken = 10 * BATCHES as u64 / 2;
        assert_eq!(recorder.missing(), 2 * (taken - BATCHES as u64));
    }
}
