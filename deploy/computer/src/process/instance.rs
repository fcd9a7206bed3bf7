//! Instance: a set of processes on this computer, its files and its lock.

use std::{
    fs::{File, TryLockError},
    path::{Path, PathBuf},
};

use alight_transport::memory::Instance;

use crate::{
    exit::{CliError, Doing},
    process::supervisor::pause,
};

const LOCK_FILE: &str = "lock";
/// Directory of a supervisor's checkpoints, which outlive a killed supervisor.
pub const CHECKPOINTS_FILE: &str = "checkpoints";
/// File that exists once all services run, so that observers may join. It holds the owner's process id, because a
/// killed owner leaves the file behind.
const READY_FILE: &str = "ready";
const MAX_TRIES: u32 = 20;
const RETRY_PAUSE: std::time::Duration = std::time::Duration::from_millis(50);

/// Instance owned by this process: no other process runs under its name while this value lives.
pub struct OwnedInstance {
    instance: Instance,
    _lock: File,
}

impl OwnedInstance {
    /// Claims the name and removes a former owner's files.
    pub fn take(name: &str) -> Result<OwnedInstance, CliError> {
        let instance = Instance::new(name)?;
        let directory = instance.directory();
        let doing = format_args!("preparing {}", directory.display());
        std::fs::create_dir_all(&directory).doing(doing)?;
        // The directory's files are removed next; files behind a link must not be.
        if std::fs::symlink_metadata(&directory).is_ok_and(|m| m.is_symlink()) {
            return Err(CliError(format!(
                "{}: it is a symbolic link; remove it",
                directory.display()
            )));
        }
        let lock = File::create(directory.join(LOCK_FILE)).doing(doing)?;
        // A child that a former owner is creating may hold the lock for some milliseconds.
        let mut tries = 0;
        let taken = loop {
            match lock.try_lock() {
                Err(TryLockError::WouldBlock) if tries < MAX_TRIES => {
                    tries += 1;
                    pause(RETRY_PAUSE);
                }
                other => break other,
            }
        };
        match taken {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(CliError(format!(
                    "an instance named {name} runs already; stop it, or choose another --instance"
                )));
            }
            Err(TryLockError::Error(e)) => return Err(CliError::because(doing, e)),
        }
        // Removes a killed owner's files. The ready file goes first, so that no observer joins.
        let _none = std::fs::remove_file(directory.join(READY_FILE));
        remove_contents(&directory).doing(doing)?;
        instance.wipe().doing(doing)?;
        Ok(OwnedInstance {
            instance,
            _lock: lock,
        })
    }
    pub fn instance(&self) -> &Instance {
        &self.instance
    }
    pub fn ready(&self) -> Result<(), CliError> {
        let path = self.file(READY_FILE);
        std::fs::write(&path, std::process::id().to_string())
            .doing(format_args!("writing {}", path.display()))
    }
    pub fn file(&self, name: &str) -> PathBuf {
        self.instance.directory().join(name)
    }
}

impl Drop for OwnedInstance {
    fn drop(&mut self) {
        // The ready file goes first, so that no observer joins an instance that is being removed.
        let _none = std::fs::remove_file(self.file(READY_FILE));
        // All processes have ended. A file that cannot be removed now is removed at the next start.
        let _left = self.instance.wipe();
        let directory = self.instance.directory();
        let _left = remove_contents(&directory);
        let _left = std::fs::remove_file(self.file(LOCK_FILE));
        // The directory remains if it holds the checkpoints of a supervisor that was not asked to end.
        let _left = std::fs::remove_dir(directory);
    }
}

/// Removes a former owner's files except the lock, which this process holds, and the checkpoints.
fn remove_contents(directory: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(directory)? {
        let entry = entry?;
        if [LOCK_FILE, CHECKPOINTS_FILE]
            .iter()
            .any(|kept| entry.file_name() == *kept)
        {
            continue;
        }
        // Removes a link itself, not its target.
        if entry.file_type()?.is_dir() {
            std::fs::remove_dir_all(entry.path())?;
        } else {
            std::fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Process id of the owner, while it lives and its services run.
pub fn owner(instance: &Instance) -> Option<u32> {
    let owner = std::fs::read_to_string(instance.directory().join(READY_FILE));
    let owner = owner.ok().and_then(|pid| pid.parse::<u32>().ok());
    owner.filter(|pid| Path::new("/proc").join(pid.to_string()).exists())
}

pub fn is_running(instance: &Instance) -> bool {
    // The lock alone is not sufficient: a new owner holds it before it has removed the ready file of a killed one.
    if owner(instance).is_none() {
        return false;
    }
    File::open(instance.directory().join(LOCK_FILE))
        .is_ok_and(|lock| matches!(lock.try_lock_shared(), Err(TryLockError::WouldBlock)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::scratch;

    #[test]
    fn instance_ownership() {
        let name = format!("test-{}", std::process::id());
        let owned = OwnedInstance::take(&name).unwrap();
        let instance = owned.instance().clone();
        assert!(!is_running(&instance));
        owned.ready().unwrap();
        assert!(is_running(&instance));
        let Err(rejected) = OwnedInstance::take(&name) else {
            panic!("taken twice")
        };
        assert!(rejected.0.contains("runs already"), "{rejected}");
        drop(owned);
        assert!(!instance.directory().exists() && !is_running(&instance));
        assert!(Instance::new("No/such name").is_err());
    }

    #[test]
    fn instance_with_files_of_a_killed_owner() {
        let name = format!("test-left-{}", std::process::id());
        let directory = Instance::new(&name).unwrap().directory();
        let elsewhere = scratch("elsewhere");
        std::fs::create_dir_all(directory.join("log/old")).unwrap();
        std::fs::write(directory.join("pilot.err"), "an old complaint").unwrap();
        std::fs::write(directory.join(READY_FILE), std::process::id().to_string()).unwrap();
        std::fs::write(directory.join("log/old/pilot.log"), "old").unwrap();
        std::fs::write(directory.join(CHECKPOINTS_FILE), "a crashed supervisor's").unwrap();
        std::fs::write(&elsewhere, "somebody else's").unwrap();
        std::os::unix::fs::symlink(&elsewhere, directory.join("link")).unwrap();
        let owned = OwnedInstance::take(&name).unwrap();
        let left = || {
            let entries = std::fs::read_dir(&directory).unwrap();
            let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name()).collect();
            names.sort();
            names
        };
        assert_eq!(left(), [CHECKPOINTS_FILE, LOCK_FILE]);
        assert!(elsewhere.exists() && !is_running(owned.instance()));
        drop(owned);
        assert_eq!(left(), [CHECKPOINTS_FILE]);
        std::fs::remove_dir_all(directory).unwrap();
        std::fs::remove_file(elsewhere).unwrap();
    }

    #[test]
    fn instance_behind_a_symbolic_link() {
        let name = format!("test-link-{}", std::process::id());
        let directory = Instance::new(&name).unwrap().directory();
        let elsewhere = directory.with_extension("elsewhere");
        std::fs::create_dir_all(&elsewhere).unwrap();
        std::fs::write(elsewhere.join("file"), "somebody else's").unwrap();
        std::os::unix::fs::symlink(&elsewhere, &directory).unwrap();
        let Err(rejected) = OwnedInstance::take(&name) else {
            panic!("taken through a link")
        };
        assert!(rejected.0.contains("it is a symbolic link"), "{rejected}");
        assert!(elsewhere.join("file").exists());
        std::fs::remove_file(&directory).unwrap();
        std::fs::remove_dir_all(elsewhere).unwrap();
    }
}
