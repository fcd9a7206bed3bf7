//! Store of the nodes' checkpoints across restarts of their processes. The supervisor runs it, because it lives as
//! long as the flight; a small file keeps the checkpoints through a crash of the supervisor. The flight's task also
//! survives a reboot of the computer, in a file on the disk.

use std::{fs, path::PathBuf};

use alight_shared::{
    admission::Periodic,
    checkpoint::{CheckpointStore, Republisher},
    time::{DroneClock, DroneTime, Span},
};
use alight_transport::memory::Memory;
use tracing::{info, warn};

use crate::{
    exit::CliError,
    io::store::{Holds, Store, read, remove, replace},
};

const COMPUTER_BOOT: &str = "/proc/sys/kernel/random/boot_id";
/// Period at which the file is written: a tenth of the shortest validity of a checkpoint.
const FILE_PERIOD: Span = Span::from_millis(50);
/// Value in place of the boot id in a file that is valid after any reboot.
const ANY_BOOT: &str = "";
/// Minimum time between writes of the lasting state, because signature times change with each frame.
const LASTING_PERIOD: Span = Span::from_millis(1000);

/// Keeps the checkpoints of predictor, mission and link.
pub struct PersistentCheckpoints {
    kept: Republisher<Memory>,
    file: Option<CheckpointFile>,
    lasting: Option<LastingFile>,
}

impl PersistentCheckpoints {
    pub fn join(memory: &Memory) -> Result<PersistentCheckpoints, CliError> {
        Ok(PersistentCheckpoints {
            kept: Republisher::join(memory, CheckpointStore::default())?,
            file: None,
            lasting: None,
        })
    }
    /// Restores the task of a flight that a reboot interrupted, from the file at `path` on the disk.
    #[must_use]
    pub fn on_disk(mut self, path: Option<PathBuf>, now: DroneTime) -> PersistentCheckpoints {
        self.lasting = path.and_then(|path| LastingFile::open(path, now, self.kept.store_mut()));
        self
    }
    /// Restores the checkpoints of a crashed supervisor from the file at `path`, and continues to write them there.
    #[must_use]
    pub fn in_file(mut self, path: PathBuf, now: DroneTime) -> PersistentCheckpoints {
        self.file = CheckpointFile::open(path);
        if let Some(file) = &self.file {
            file.restore(now, self.kept.store_mut());
        }
        self
    }
    /// Deletes the files after an orderly request to end.
    pub fn forget(self) {
        // If this fails, the file's checkpoints soon become too old.
        let of_supervisor = self.file.map(|file| file.path);
        // A pending write would recreate the file.
        let of_flight = self.lasting.map(|LastingFile { path, store, .. }| {
            drop(store);
            path
        });
        for path in of_supervisor.into_iter().chain(of_flight) {
            let _none = remove(&path);
        }
    }
    /// Takes the newest checkpoint of each node and publishes it ([`Republisher`]).
    pub fn poll(&mut self, now: DroneTime) {
        let new = self.kept.poll(now);
        if let Some(file) = &mut self.file {
            file.poll(now, new, self.kept.store());
        }
        if let Some(file) = &mut self.lasting {
            file.poll(now, new, self.kept.store());
        }
    }
}

/// File in the instance's directory. On an installed computer this directory is in memory (tmpfs), so a write does
/// not wait for a disk. The file needs no synchronisation, because a file of an earlier boot is invalid.
struct CheckpointFile {
    path: PathBuf,
    computer_boot: String,
    unwritten: bool,
    due: Periodic<DroneClock>,
    failed: bool,
}

impl CheckpointFile {
    /// None if the computer reports no boot id.
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
                warn!("checkpoints are lost if the supervisor crashes: reading {COMPUTER_BOOT}: {e}");
                None
            }
        }
    }
    fn restore(&self, now: DroneTime, checkpoints: &mut CheckpointStore) {
        let path = self.path.display();
        match read(&self.path) {
            Ok(None) => {}
            Ok(Some(bytes)) => match checkpoints.restore(now, &self.computer_boot, &bytes) {
                Ok(()) => info!("the nodes receive the checkpoints of a crashed supervisor"),
                Err(why) => warn!("{path}: the checkpoints of the former supervisor are ignored: {why}"),
            },
            Err(e) => warn!("{path}: reading the checkpoints of the former supervisor: {e}"),
        }
    }
    fn poll(&mut self, now: DroneTime, new: bool, checkpoints: &CheckpointStore) {
        self.unwritten |= new;
        if !self.unwritten || !self.due.is_due_spaced(now, FILE_PERIOD) {
            return;
        }
        self.unwritten = false;
        let bytes = checkpoints.encode(&self.computer_boot).map_err(|e| e.to_string());
        let written = bytes.and_then(|bytes| replace(&self.path, &bytes, false).map_err(|e| e.to_string()));
        if let Some(e) = written.as_ref().err().filter(|_| !self.failed) {
            warn!(
                "{}: writing the checkpoints: {e}: they are lost if the supervisor crashes",
                self.path.display()
            );
        }
        self.failed = written.is_err();
    }
}

const HOLDS: Holds = Holds {
    what: "the flight's purpose",
    lost: "the flight's purpose is lost if the computer reboots",
    misleads: false,
};

/// The file on the disk: [`CheckpointStore::lasting`]. It is absent while there is no lasting state.
struct LastingFile {
    path: PathBuf,
    store: Store,
    unwritten: bool,
    due: Periodic<DroneClock>,
}

impl LastingFile {
    /// None if the thread that writes the file cannot be started.
    fn open(path: PathBuf, now: DroneTime, checkpoints: &mut CheckpointStore) -> Option<LastingFile> {
        let at = path.display();
        let found = match read(&path) {
            Ok(found) => found.unwrap_or_default(),
            Err(e) => {
                warn!("{at}: reading the purpose of the flight before a reboot: {e}");
                Vec::new()
            }
        };
        if !found.is_empty() {
            match checkpoints.restore(now, ANY_BOOT, &found) {
                Ok(()) => info!(
                    "{at}: this start continues the flight of a former one: a sortie returns while its charge lasts"
                ),
                Err(why) => {
                    warn!("{at}: the purpose of the flight before a reboot is ignored: it is {why}")
                }
            }
        }
        match Store::open(path.clone(), found, None, HOLDS) {
            Ok(store) => Some(LastingFile {
                path,
                store,
                unwritten: false,
                due: Periodic::default(),
            }),
            Err(e) => {
                warn!("{at}: starting the thread that writes the flight's purpose: {e}");
                None
            }
        }
    }
    fn poll(&mut self, now: DroneTime, new: bool, checkpoints: &CheckpointStore) {
        self.unwritten |= new;
        if !self.unwritten || !self.due.is_due_spaced(now, LASTING_PERIOD) {
            return;
        }
        let lasting = checkpoints.lasting();
        let bytes = if lasting.is_empty() {
            Vec::new()
        } else {
            lasting.encode(ANY_BOOT).unwrap_or_default()
        };
        // If the queue is full, the next poll tries again.
        self.unwritten = !self.store.keep(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::scratch;
    use alight_shared::{
        msg::{Header, LinkCheckpoint, MissionCheckpoint},
        time::Time,
    };

    #[test]
    fn lasting_file_of_a_sortie() {
        let path = scratch("lasting").with_extension("flight");
        let found = || {
            let mut checkpoints = CheckpointStore::default();
            let file = LastingFile::open(path.clone(), Time::from_secs(1.0), &mut checkpoints).unwrap();
            (checkpoints.newest::<MissionCheckpoint>().sortie, file)
        };
        let mission = |sortie, at: f64| {
            let header = Header::new(1, 1, 7, 1, Time::from_secs(at));
            let mut m = MissionCheckpoint {
                header,
                armed: sortie,
                sortie,
                ..MissionCheckpoint::default()
            };
            m.state.header = header;
            m
        };
        let (sortie, mut file) = found();
        assert!(!sortie && !path.exists());
        let mut checkpoints = CheckpointStore::default();
        let is_recovered = |exists: bool| {
            for _ in 0..500 {
                if path.exists() == exists {
                    return true;
                }
                crate::process::supervisor::pause(std::time::Duration::from_millis(10));
            }
            false
        };
        for (sortie, at) in [(true, 10.0), (false, 11.5), (true, 13.0)] {
            let now = Time::from_secs(at);
            assert!(checkpoints.take(now, Some(&mission(sortie, at))));
            file.poll(now, true, &checkpoints);
            assert_eq!(file.store.newest().is_empty(), !sortie);
            assert!(is_recovered(sortie), "{at}");
        }
        // A change within a period is written when the period ends.
        assert!(checkpoints.take(Time::from_secs(13.1), Some(&mission(false, 13.1))));
        file.poll(Time::from_secs(13.1), true, &checkpoints);
        assert!(!file.store.newest().is_empty());
        file.poll(Time::from_secs(14.1), false, &checkpoints);
        assert!(is_recovered(false));
        assert!(checkpoints.take(Time::from_secs(15.2), Some(&mission(true, 15.2))));
        file.poll(Time::from_secs(15.2), true, &checkpoints);
        drop(file);
        assert!(found().0);
        fs::write(&path, "another program's").unwrap();
        assert!(!found().0);
        fs::remove_file(&path).unwrap();
    }

    #[test]
    fn checkpoint_file_of_a_crashed_supervisor() {
        let now = Time::from_secs(10.0);
        let path = scratch("checkpoints");
        let file = || CheckpointFile::open(path.clone()).unwrap();
        let restored = || {
            let mut checkpoints = CheckpointStore::default();
            file().restore(now, &mut checkpoints);
            checkpoints.newest::<LinkCheckpoint>().header.boot
        };
        assert_eq!(restored(), 0);
        let mut checkpoints = CheckpointStore::default();
        let header = Header::new(1, 1, 7, 1, now);
        checkpoints.take(
            now,
            Some(&LinkCheckpoint {
                header,
                ..LinkCheckpoint::default()
            }),
        );
        let mut kept = file();
        kept.poll(now, false, &checkpoints);
        assert_eq!(restored(), 0, "nothing new");
        kept.poll(now, true, &checkpoints);
        assert_eq!(restored(), 7);
        for other in ["", "another program's"] {
            fs::write(&path, other).unwrap();
            assert_eq!(restored(), 0);
        }
        fs::remove_file(&path).unwrap();
        fs::create_dir(&path).unwrap();
        assert_eq!(restored(), 0);
        kept.poll(now + FILE_PERIOD, true, &checkpoints);
        assert!(kept.failed);
        fs::remove_dir(&path).unwrap();
        fs::remove_file(format!("{}.new", path.display())).unwrap();
    }
}
