//! Small file that outlives the process. A separate thread writes it at each change, because a disk may take seconds.
//! The next start finds either the old state or the new one.

use std::{
    fs::{self, File},
    io::{self, ErrorKind, Read as _, Write as _},
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, PoisonError,
        mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel},
    },
    thread::JoinHandle,
    time::Duration,
};

use tracing::{info, warn};

/// Variable in which a service manager names the state directory of a service.
pub const STATE_VARIABLE: &str = "STATE_DIRECTORY";
const MAX_BYTES: u64 = 1 << 16;
const MAX_WAITING: usize = 4;
const RETRY_PERIOD: Duration = Duration::from_secs(10);

pub fn state_directory() -> Option<PathBuf> {
    let named = std::env::var(STATE_VARIABLE).ok()?;
    // systemd separates several directories by colons.
    let first = named.split(':').next().filter(|first| !first.is_empty())?;
    Some(first.into())
}

pub fn read(path: &Path) -> io::Result<Option<Vec<u8>>> {
    let file = match File::open(path) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        file => file?,
    };
    let mut bytes = Vec::new();
    file.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_BYTES {
        let why = format!("longer than {MAX_BYTES} bytes");
        return Err(io::Error::new(ErrorKind::InvalidData, why));
    }
    Ok(Some(bytes))
}

/// Replaces a file atomically: a reader finds either the old content or the new one. If `synced`, the new content is
/// on the disk before this returns.
pub fn replace(path: &Path, bytes: &[u8], synced: bool) -> io::Result<()> {
    let mut new = path.as_os_str().to_owned();
    new.push(".new");
    let mut file = File::create(&new)?;
    file.write_all(bytes)?;
    if synced {
        file.sync_all()?;
    }
    fs::rename(&new, path)?;
    if synced {
        sync_directory(path)?;
    }
    Ok(())
}

/// Makes a rename or removal survive a power cut.
fn sync_directory(path: &Path) -> io::Result<()> {
    File::open(path.parent().unwrap_or(Path::new(".")))?.sync_all()
}

/// Removes a file if it exists; the removal is on the disk before this returns.
pub fn remove(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(()),
        removed => removed.and_then(|()| sync_directory(path)),
    }
}

/// Description of a file's content, and the consequence of a failure to replace it, for messages.
#[derive(Clone, Copy, Debug)]
pub struct Holds {
    pub what: &'static str,
    pub lost: &'static str,
    /// The file is removed if it cannot be replaced, because the next start would trust an outdated state.
    pub misleads: bool,
}

/// Keeps the newest state in a file on the disk; an empty state removes the file.
pub struct Store {
    newest: Vec<u8>,
    states: Option<SyncSender<Vec<u8>>>,
    writer: Option<JoinHandle<()>>,
    error: Arc<Mutex<Option<String>>>,
}

impl Store {
    /// Store for the file at `path`, which contains `found`. `unsaved`: a state not written yet, and the reason.
    pub fn open(
        path: PathBuf,
        found: Vec<u8>,
        unsaved: Option<(Vec<u8>, String)>,
        holds: Holds,
    ) -> io::Result<Store> {
        let (states, receiver) = sync_channel(MAX_WAITING);
        let (unsaved, failed) = unsaved.unzip();
        let error = Arc::new(Mutex::new(failed));
        let mut file = StoredFile {
            path,
            holds,
            error: Arc::clone(&error),
            unsaved,
        };
        let writer = std::thread::Builder::new()
            .name("store".into())
            .spawn(move || file.write_all(&receiver))?;
        Ok(Store {
            newest: found,
            states: Some(states),
            writer: Some(writer),
            error,
        })
    }
    /// Queues this state for the disk; false if the queue is full, in which case the caller tries again.
    pub fn keep(&mut self, state: Vec<u8>) -> bool {
        if state == self.newest {
            return true;
        }
        let Some(states) = &self.states else { return false };
        match states.try_send(state.clone()) {
            Ok(()) => self.newest = state,
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => return false,
        }
        true
    }
    pub fn newest(&self) -> &[u8] {
        &self.newest
    }
    pub fn error(&self) -> Option<String> {
        self.error.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Drop for Store {
    fn drop(&mut self) {
        // Waits until the newest state is on the disk.
        self.states = None;
        let _ended = self.writer.take().map(JoinHandle::join);
    }
}

struct StoredFile {
    path: PathBuf,
    holds: Holds,
    error: Arc<Mutex<Option<String>>>,
    unsaved: Option<Vec<u8>>,
}

impl StoredFile {
    fn write_all(&mut self, states: &Receiver<Vec<u8>>) {
        while let Some(next) = self.next(states) {
            let newest = states.try_iter().last().unwrap_or(next);
            self.write(newest);
        }
    }
    fn next(&self, states: &Receiver<Vec<u8>>) -> Option<Vec<u8>> {
        let Some(unsaved) = &self.unsaved else {
            return states.recv().ok();
        };
        match states.recv_timeout(RETRY_PERIOD) {
            Ok(newer) => Some(newer),
            Err(RecvTimeoutError::Timeout) => Some(unsaved.clone()),
            Err(RecvTimeoutError::Disconnected) => None,
        }
    }
    fn write(&mut self, state: Vec<u8>) {
        let path = &self.path;
        let Holds { what, lost, misleads } = self.holds;
        let done = if state.is_empty() {
            remove(path)
        } else {
            replace(path, &state, true)
        };
        let failed = done.err().map(|e| format!("writing {}: {e}", path.display()));
        match (&failed, &self.unsaved) {
            (Some(e), None) => {
                warn!("{e}: {lost}; tried again every {} s", RETRY_PERIOD.as_secs());
                if misleads {
                    discard(path);
                }
            }
            (None, Some(_)) => info!("{what} is saved in {} again", path.display()),
            (Some(_), Some(_)) | (None, None) => {}
        }
        self.unsaved = failed.is_some().then_some(state);
        *self.error.lock().unwrap_or_else(PoisonError::into_inner) = failed;
    }
}

/// Removes a file that no later start may trust.
pub fn discard(path: &Path) {
    if let Err(e) = remove(path) {
        warn!(
            "removing {}: {e}: once the disk is writable, a start would trust this old state: remove it by hand",
            path.display()
        );
    }
}
