//! Keeper of the nodes' checkpoints while their processes are restarted. The supervisor does this: it lives as long as
//! the flight, and what it keeps outlives it in a small file.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use alight_shared::admission::Periodic;
use alight_shared::checkpoint::{Checkpoint, Keeper};
use alight_shared::msg::{LinkCheckpoint, MissionCheckpoint, PredictorCheckpoint};
use alight_shared::plain::Plain;
use alight_shared::time::{DroneClock, Span, Time};
use alight_transport::TransportError;
use alight_transport::memory::{Memory, Publisher, Subscriber};
use tracing::{info, warn};

use crate::exit::CliError;

/// Names this boot of the computer.
const COMPUTER_BOOT: &str = "/proc/sys/kernel/random/boot_id";
/// Time between two writings of the file: a tenth of the shortest age at which a checkpoint still counts.
const FILE_PERIOD: Span = Span::from_millis(50);
/// Longest file, bytes.
const MAX_BYTES: u64 = 1 << 16;

/// Keeps the checkpoints of predictor, mission and link.
pub struct CheckpointKeeper {
    keeper: Keeper,
    predictor: Ports<PredictorCheckpoint>,
    mission: Ports<MissionCheckpoint>,
    link: Ports<LinkCheckpoint>,
    file: Option<CheckpointFile>,
}

impl CheckpointKeeper {
    /// Keeps nothing yet.
    pub fn join(memory: &Memory) -> Result<CheckpointKeeper, CliError> {
        Ok(CheckpointKeeper {
            keeper: Keeper::default(),
            predictor: Ports::join(memory)?,
            mission: Ports::join(memory)?,
            link: Ports::join(memory)?,
            file: None,
        })
    }
    /// Begins with what a crashed supervisor kept in the file at `path`, and keeps it there from now on.
    #[must_use]
    pub fn in_file(mut self, path: PathBuf, now: Time<DroneClock>) -> CheckpointKeeper {
        self.file = CheckpointFile::open(path);
        if let Some(file) = &self.file {
            file.restore(now, &mut self.keeper);
        }
        self
    }
    /// Nothing is to outlive a supervisor that was asked to end.
    pub fn forget(self) {
        if let Some(file) = self.file {
            // Checkpoints that stay are too old soon.
            let _none = fs::remove_file(file.path);
        }
    }
    /// Takes the newest of each and publishes it on the same topic, where a node that begins looks for one of another
    /// boot; while there is none it publishes that.
    pub fn poll(&mut self, now: Time<DroneClock>) {
        let new = [
            self.predictor.poll(now, &mut self.keeper),
            self.mission.poll(now, &mut self.keeper),
            self.link.poll(now, &mut self.keeper),
        ];
        if let Some(file) = &mut self.file {
            file.poll(now, new.contains(&true), &self.keeper);
        }
    }
}

/// One node's.
struct Ports<M: Plain> {
    received: Subscriber<M>,
    published: Publisher<M>,
}

impl<M: Plain + Checkpoint> Ports<M> {
    fn join(memory: &Memory) -> Result<Ports<M>, CliError> {
        Ok(Ports {
            received: memory.subscriber()?,
            published: memory.publisher()?,
        })
    }
    /// Whether there is a new one. It receives its own publications, which are no newer.
    fn poll(&mut self, now: Time<DroneClock>, keeper: &mut Keeper) -> bool {
        let mut new = false;
        for m in self.received.all(now.nanos()) {
            new |= keeper.take(now, Some(&m));
        }
        self.published.send(&keeper.newest::<M>());
        new
    }
}

/// The file in the instance's directory. On the installed computer that lies in memory (tmpfs): writing does not wait
/// for a disk, and nothing has to be synchronised, because a file of another boot of the computer does not count.
struct CheckpointFile {
    path: PathBuf,
    computer_boot: String,
    unwritten: bool,
    due: Periodic<DroneClock>,
    /// The newest writing failed.
    failed: bool,
}

impl CheckpointFile {
    /// None where the computer does not name its boot.
    fn open(path: PathBuf) -> Option<CheckpointFile> {
        match fs::read_to_string(COMPUTER_BOOT) {
            Ok(boot) => Some(CheckpointFile {
                path,
                computer_boot: boot.trim().into(),
                unwritten: false,
                due: Periodic::default(),
                failed: false,
            }),
            Err(e) => {
                warn!("no checkpoint outlives the supervisor: reading {COMPUTER_BOOT}: {e}");
                None
            }
        }
    }
    fn restore(&self, now: Time<DroneClock>, keeper: &mut Keeper) {
        let path = self.path.display();
        match read(&self.path) {
            Ok(None) => {}
            Ok(Some(bytes)) => match keeper.restore(now, &self.computer_boot, &bytes) {
                Ok(()) => info!("the nodes are given the checkpoints of a crashed supervisor"),
                Err(why) => warn!("{path}: the checkpoints of the former supervisor do not count: {why}"),
            },
            Err(e) => warn!("{path}: reading the checkpoints of the former supervisor: {e}"),
        }
    }
    fn poll(&mut self, now: Time<DroneClock>, new: bool, keeper: &Keeper) {
        self.unwritten |= new;
        if !self.unwritten || !self.due.is_due_spaced(now, FILE_PERIOD) {
            return;
        }
        self.unwritten = false;
        let bytes = keeper.encode(&self.computer_boot).map_err(|e| e.to_string());
        let written = bytes.and_then(|bytes| replace(&self.path, &bytes).map_err(|e| e.to_string()));
        if let Some(e) = written.as_ref().err().filter(|_| !self.failed) {
            warn!(
                "{}: writing the checkpoints: {e}: they do not outlive the supervisor",
                self.path.display()
            );
        }
        self.failed = written.is_err();
    }
}

/// A small file; None where there is none.
fn read(path: &Path) -> std::io::Result<Option<Vec<u8>>> {
    let file = match fs::File::open(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        file => file?,
    };
    let mut bytes = Vec::new();
    file.take(MAX_BYTES).read_to_end(&mut bytes)?;
    Ok(Some(bytes))
}

/// Whole and under another name first: a reader finds the old content or the new one.
fn replace(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let new = path.with_extension("new");
    fs::write(&new, bytes)?;
    fs::rename(&new, path)
}

/// A node's own end: the checkpoint of a crashed predecessor, and its own for a successor.
pub struct OwnCheckpoint<M: Plain> {
    published: Publisher<M>,
    /// None: this node has published, and would receive its own.
    predecessor: Option<Subscriber<M>>,
}

impl<M: Plain> OwnCheckpoint<M> {
    /// Looks for a predecessor's.
    pub fn join(memory: &Memory) -> Result<OwnCheckpoint<M>, TransportError> {
        Ok(OwnCheckpoint {
            published: memory.publisher()?,
            predecessor: Some(memory.subscriber()?),
        })
    }
    /// The predecessor's, until this one publishes; `t` is the drone's clock, ns.
    pub fn predecessor(&mut self, t: i64) -> Option<M> {
        self.predecessor.as_mut().and_then(|p| p.newest(t))
    }
    /// Publishes its own, where it is due.
    pub fn publish(&mut self, m: Option<&M>) {
        if m.is_some() {
            self.predecessor = None;
        }
        self.published.send_any(m);
    }
    /// Messages that could not be published.
    pub fn unsent(&self) -> u64 {
        self.published.unsent()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::Header;

    #[test]
    fn checkpoint_file_of_a_crashed_supervisor() {
        let now = Time::from_secs(10.0);
        let path = std::env::temp_dir().join(format!("alight-checkpoints-{}", std::process::id()));
        let file = || CheckpointFile::open(path.clone()).unwrap();
        let restored = || {
            let mut keeper = Keeper::default();
            file().restore(now, &mut keeper);
            keeper.newest::<LinkCheckpoint>().header.boot
        };
        assert_eq!(restored(), 0);
        let mut keeper = Keeper::default();
        let header = Header::new(1, 1, 7, 1, now);
        keeper.take(
            now,
            Some(&LinkCheckpoint {
                header,
                ..LinkCheckpoint::default()
            }),
        );
        let mut kept = file();
        kept.poll(now, false, &keeper);
        assert_eq!(restored(), 0, "nothing new");
        kept.poll(now, true, &keeper);
        assert_eq!(restored(), 7);
        for other in ["", "another program's"] {
            fs::write(&path, other).unwrap();
            assert_eq!(restored(), 0);
        }
        fs::remove_file(&path).unwrap();
        fs::create_dir(&path).unwrap();
        assert_eq!(restored(), 0);
        kept.poll(now + FILE_PERIOD, true, &keeper);
        assert!(kept.failed);
        fs::remove_dir(&path).unwrap();
        fs::remove_file(path.with_extension("new")).unwrap();
    }
}
