//! Management of a computer's flights outside the processes that fly: begin, summary, retention.

use std::{
    fs::File,
    path::{Path, PathBuf},
    sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel},
    thread::{Builder, JoinHandle},
    time::Duration,
};

use alight_transport::clock::steady_ns;
use tracing::{info, warn};

use super::{
    store::{self, Removed, Room},
    summary::FlightSummary,
    yield_to_flight,
};

const SUMMARIES: usize = 2;
const POLL_PERIOD: Duration = Duration::from_millis(200);
/// Period of the check for free disk space, ns; in this time the processes write 20 MB.
const ROOM_PERIOD_NS: i64 = 10_000_000_000;
/// Period at which an unchanged summary is written, ns: after a power cut the time of the last write counts as the
/// end of the flight.
pub const SUMMARY_PERIOD_NS: i64 = 10_000_000_000;

pub struct FlightRecording {
    path: PathBuf,
    to: Option<SyncSender<FlightSummary>>,
    thread: Option<JoinHandle<()>>,
    _lock: Option<File>,
}

impl FlightRecording {
    /// Begins a flight in `directory`, in which all flights together use at most `max_bytes`. A failure is reported,
    /// and the processes continue without recording.
    pub fn begin(directory: &Path, max_bytes: u64) -> FlightRecording {
        let (path, lock) = store::begin(directory);
        match &lock {
            Ok(_) => info!("this flight is recorded in {}", path.display()),
            Err(e) => warn!(
                "nothing is recorded until {} can be written: {e}; make it writable for this user",
                path.display()
            ),
        }
        let (to, summaries) = sync_channel(SUMMARIES);
        let root = directory.to_owned();
        let own = path.clone();
        let thread = Builder::new().name("flights".into()).spawn(move || {
            yield_to_flight();
            keep(&root, &own, Room::of(max_bytes), &summaries);
        });
        FlightRecording {
            path,
            to: Some(to),
            thread: thread
                .map_err(|e| warn!("flights are neither removed nor summarised: starting a thread: {e}"))
                .ok(),
            _lock: lock.ok(),
        }
    }
    pub fn path(&self) -> &Path {
        &self.path
    }
    /// Queues the summary for writing; false while the disk is behind.
    pub fn sum_up(&self, summary: &FlightSummary) -> bool {
        self.to
            .as_ref()
            .is_some_and(|to| to.try_send(summary.clone()).is_ok())
    }
}

impl Drop for FlightRecording {
    fn drop(&mut self) {
        self.to = None;
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ended = thread.join();
        }
    }
}

fn keep(root: &Path, own: &Path, room: Room, summaries: &Receiver<FlightSummary>) {
    let mut failed = false;
    let mut room_ns = steady_ns();
    loop {
        match summaries.try_recv() {
            Ok(summary) => {
                let written = summary.write(own);
                if let Some(e) = written.as_ref().err().filter(|_| !failed) {
                    warn!("{}: writing the flight's summary: {e}", own.display());
                }
                failed = written.is_err();
                continue;
            }
            Err(TryRecvError::Empty) => std::thread::park_timeout(POLL_PERIOD),
            Err(TryRecvError::Disconnected) => return,
        }
        if steady_ns() >= room_ns {
            room_ns = steady_ns().saturating_add(ROOM_PERIOD_NS);
            match room.make(root, own) {
                Ok(removed) => removed.iter().for_each(report),
                // This failure was already reported at the start.
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
                Err(e) => warn!("{}: making room for this flight: {e}", root.display()),
            }
        }
    }
}

fn report(removed: &Removed) {
    match removed {
        Removed::Flight(path) => info!("removed the oldest flight, {}, to make room", path.display()),
        Removed::Part(path) => warn!(
            "removed {}, the oldest of this flight: it is larger than recorder.max_gb, and cannot be replayed any more",
            path.display()
        ),
    }
}
