//! Keeper of the nodes' checkpoints while their processes are restarted. The supervisor does this: it lives as long as
//! the flight, and what it keeps outlives it in a small file. What the flight is for outlives the computer's boot, too, in a file on
//! the disk.

use std::fs::{self, File};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use alight_shared::admission::Periodic;
use alight_shared::checkpoint::{Keeper, Republisher};
use alight_shared::time::{DroneClock, Span, Time};
use alight_transport::memory::Memory;
use tracing::{info, warn};

use crate::exit::CliError;

/// Names this boot of the computer.
const COMPUTER_BOOT: &str = "/proc/sys/kernel/random/boot_id";
/// Time between two writings of the file: a tenth of the shortest age at which a checkpoint still counts.
const FILE_PERIOD: Span = Span::from_millis(50);
/// In the place of a boot's name: a file of any boot counts.
const ANY_BOOT: &str = "";
/// Longest file, bytes.
const MAX_BYTES: u64 = 1 << 16;

/// Keeps the checkpoints of predictor, mission and link.
pub struct CheckpointKeeper {
    kept: Republisher<Memory>,
    file: Option<CheckpointFile>,
    lasting: Option<LastingFile>,
}

impl CheckpointKeeper {
    /// Keeps nothing yet.
    pub fn join(memory: &Memory) -> Result<CheckpointKeeper, CliError> {
        Ok(CheckpointKeeper {
            kept: Republisher::join(memory, Keeper::default())?,
            file: None,
            lasting: None,
        })
    }
    /// Begins with what the flight was for that a reboot of the computer has interrupted, in the file at `path` on its disk.
    #[must_use]
    pub fn on_disk(mut self, path: Option<PathBuf>, now: Time<DroneClock>) -> CheckpointKeeper {
        self.lasting = path.map(|path| LastingFile::open(path, now, self.kept.keeper_mut()));
        self
    }
    /// Begins with what a crashed supervisor kept in the file at `path`, and keeps it there from now on.
    #[must_use]
    pub fn in_file(mut self, path: PathBuf, now: Time<DroneClock>) -> CheckpointKeeper {
        self.file = CheckpointFile::open(path);
        if let Some(file) = &self.file {
            file.restore(now, self.kept.keeper_mut());
        }
        self
    }
    /// Nothing is to outlive a supervisor that was asked to end.
    pub fn forget(self) {
        if let Some(file) = self.file {
            // Checkpoints that stay are too old soon.
            let _none = fs::remove_file(file.path);
        }
        if let Some(file) = self.lasting {
            let _none = fs::remove_file(file.path);
        }
    }
    /// Takes the newest of each and publishes it ([`Republisher`]).
    pub fn poll(&mut self, now: Time<DroneClock>) {
        let new = self.kept.poll(now);
        if let Some(file) = &mut self.file {
            file.poll(now, new, self.kept.keeper());
        }
        if let Some(file) = self.lasting.as_mut().filter(|_| new) {
            file.poll(self.kept.keeper());
        }
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

/// The file on the disk: [`Keeper::lasting`], written at each change by a thread of its own, since a disk may take seconds. There is
/// none while nothing lasts.
struct LastingFile {
    path: PathBuf,
    /// What was handed to the writer last; empty: nothing lasts.
    written: Vec<u8>,
    writer: SyncSender<Vec<u8>>,
}

impl LastingFile {
    fn open(path: PathBuf, now: Time<DroneClock>, keeper: &mut Keeper) -> LastingFile {
        let at = path.display();
        let found = match read(&path) {
            Ok(found) => found.unwrap_or_default(),
            Err(e) => {
                warn!("{at}: reading what the flight before a reboot was for: {e}");
                Vec::new()
            }
        };
        if !found.is_empty() {
            match keeper.restore(now, ANY_BOOT, &found) {
                Ok(()) => info!(
                    "{at}: the flight goes on that a former start was in: a sortie comes back while its charge lasts"
                ),
                Err(why) => {
                    warn!("{at}: what the flight before a reboot was for does not count: it is {why}")
                }
            }
        }
        let (writer, states) = sync_channel(1);
        let to = path.clone();
        let spawned = thread::Builder::new()
            .name("lasting".into())
            .spawn(move || write_each(&to, &states));
        if let Err(e) = spawned {
            warn!("{at}: no thread writes what the flight is for: {e}");
        }
        LastingFile {
            path,
            written: found,
            writer,
        }
    }
    fn poll(&mut self, keeper: &Keeper) {
        let lasting = keeper.lasting();
        let bytes = if lasting.is_empty() {
            Vec::new()
        } else {
            lasting.encode(ANY_BOOT).unwrap_or_default()
        };
        // Where the writer is busy the next poll tries again.
        if bytes != self.written && self.writer.try_send(bytes.clone()).is_ok() {
            self.written = bytes;
        }
    }
}

/// Writes the newest state until nobody sends one any more.
fn write_each(path: &Path, states: &Receiver<Vec<u8>>) {
    while let Ok(bytes) = states.recv() {
        let done = if bytes.is_empty() {
            match fs::remove_file(path) {
                Err(e) if e.kind() != ErrorKind::NotFound => Err(e),
                Ok(()) | Err(_) => Ok(()),
            }
        } else {
            replace_on_disk(path, &bytes)
        };
        if let Err(e) = done {
            warn!(
                "writing {}: {e}: what the flight is for does not outlive a reboot of the computer",
                path.display()
            );
        }
    }
}

/// Whole and under another name first, and on the disk before it returns.
fn replace_on_disk(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let new = path.with_extension("new");
    let mut file = File::create(&new)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    fs::rename(&new, path)?;
    File::open(path.parent().unwrap_or(Path::new(".")))?.sync_all()
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

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{Header, LinkCheckpoint, MissionCheckpoint};

    #[test]
    fn lasting_file_of_a_sortie() {
        let now = Time::from_secs(10.0);
        let path = std::env::temp_dir().join(format!("alight-lasting-{}.flight", std::process::id()));
        let found = || {
            let mut keeper = Keeper::default();
            let file = LastingFile::open(path.clone(), Time::from_secs(1.0), &mut keeper);
            (keeper.newest::<MissionCheckpoint>().sortie, file)
        };
        let mission = |sortie, at: f64| {
            let header = Header::new(1, 1, 7, 1, Time::from_secs(at));
            let mut m = MissionCheckpoint {
                header,
                sortie,
                ..MissionCheckpoint::default()
            };
            m.state.header = header;
            m
        };
        let (sortie, mut file) = found();
        assert!(!sortie && !path.exists());
        let mut keeper = Keeper::default();
        let settles = |exists: bool| {
            for _ in 0..500 {
                if path.exists() == exists {
                    return true;
                }
                crate::process::supervisor::pause(std::time::Duration::from_millis(10));
            }
            false
        };
        for (sortie, at) in [(true, 9.0), (false, 9.5), (true, 9.8)] {
            assert!(keeper.take(now, Some(&mission(sortie, at))));
            while file.written.is_empty() == sortie {
                file.poll(&keeper);
            }
            assert!(settles(sortie), "{at}");
        }
        assert!(found().0);
        fs::write(&path, "another program's").unwrap();
        assert!(!found().0);
        fs::remove_file(&path).unwrap();
    }

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
