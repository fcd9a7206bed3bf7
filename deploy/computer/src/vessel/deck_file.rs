//! File of the deck's checkpoint.
//!
//! It is written to the disk at each change, whole and under another name first, and carries version and checksum: the
//! next start finds the old state or the new one. What is not known is closed until a person opens it: where the file
//! is missing, cannot be read, or cannot be replaced at the start (it may be older than what happened since). One that
//! cannot be replaced later is removed, so that no start finds it. Only on a disk that became read-only it stays, and
//! a start after that disk became writable again would believe it. The first file is the installation's, or a
//! launcher's: nothing stands on the deck yet.

use std::fs::{self, File};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use alight_shared::msg::Closure;
use alight_shared::wire;
use alight_usv::VesselCheckpoint;
use alight_usv::deck::DeckCheckpoint;
use serde::{Deserialize, Serialize};
use tracing::{info, warn};

use crate::config::VesselComputer;
use crate::process::supervisor::STATE_VARIABLE;

/// Of this layout.
const VERSION: u32 = 5;
/// The first file: an open deck on which nothing stands.
const FIRST: &[u8] = b"\"open\"";
/// Longest file, bytes.
const MAX_BYTES: u64 = 1 << 16;
/// States on their way to the disk.
const MAX_WAITING: usize = 4;
/// A file that cannot be written is tried again after this long.
const RETRY_PERIOD: Duration = Duration::from_secs(10);

#[derive(Serialize, Deserialize)]
struct Content {
    version: u32,
    vessel: u32,
    checksum: String,
    kept: VesselCheckpoint,
}

fn checksum(vessel: u32, kept: &VesselCheckpoint) -> Result<String, String> {
    let hash = wire::hash_record(&(VERSION, vessel, kept)).map_err(|e| e.to_string())?;
    Ok(format!("{hash:016x}"))
}

fn encode(vessel: u32, kept: &VesselCheckpoint) -> Result<Vec<u8>, String> {
    let content = Content {
        version: VERSION,
        vessel,
        checksum: checksum(vessel, kept)?,
        kept: kept.clone(),
    };
    serde_json::to_vec(&content).map_err(|e| e.to_string())
}

/// What the former start left; None: there is no file. An error says why it cannot be known.
fn load(path: &Path, vessel: u32) -> Result<Option<VesselCheckpoint>, String> {
    let Some(bytes) = read(path)? else {
        return Ok(None);
    };
    if bytes == FIRST {
        return Ok(Some(VesselCheckpoint::default()));
    }
    let content: Content = serde_json::from_slice(&bytes).map_err(|e| e.to_string())?;
    if content.version != VERSION {
        return Err(format!("version {}, not {VERSION}", content.version));
    }
    if content.vessel != vessel {
        return Err(format!("of vessel {}, not {vessel}", content.vessel));
    }
    if content.checksum != checksum(vessel, &content.kept)? {
        return Err("its checksum is wrong".into());
    }
    Ok(Some(content.kept))
}

/// A small file; None where there is none.
fn read(path: &Path) -> Result<Option<Vec<u8>>, String> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(e.to_string()),
    };
    let mut bytes = Vec::new();
    let read = file.take(MAX_BYTES + 1).read_to_end(&mut bytes);
    read.map_err(|e| e.to_string())?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(format!("longer than {MAX_BYTES} bytes"));
    }
    Ok(Some(bytes))
}

/// Replaces a file by one that is on the disk.
fn replace(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let directory = path.parent().unwrap_or(Path::new("."));
    let mut new = path.as_os_str().to_owned();
    new.push(".new");
    let mut file = File::create(&new)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    fs::rename(&new, path)?;
    File::open(directory)?.sync_all()
}

/// Where the process of this computer keeps its file.
fn own_path(computer: &VesselComputer) -> PathBuf {
    let named = std::env::var(STATE_VARIABLE).unwrap_or_default();
    // systemd separates several by colons.
    let directory = match named.split(':').next() {
        Some(first) if !first.is_empty() => first.into(),
        Some(_) | None => std::env::temp_dir(),
    };
    directory.join(name(computer))
}

fn name(computer: &VesselComputer) -> String {
    format!("alight-{}.deck", computer.instance)
}

/// The first file, in the directory of a simulated run.
pub fn write_first(directory: &Path, computer: &VesselComputer) -> Result<(), String> {
    let path = directory.join(name(computer));
    replace(&path, FIRST).map_err(|e| format!("writing {}: {e}", path.display()))
}

/// What the process begins with: what it found, once the disk has taken it anew. An error says why it has not.
fn confirm(path: &Path, vessel: u32, found: VesselCheckpoint) -> (VesselCheckpoint, Option<String>) {
    let written = encode(vessel, &found)
        .and_then(|bytes| replace(path, &bytes).map_err(|e| format!("writing {}: {e}", path.display())));
    let Err(e) = written else {
        return (found, None);
    };
    warn!(
        "{e}: what it holds of the deck may be old, and the deck is closed: free space or make it writable; look, then \
         alight command deck open"
    );
    discard(path);
    let mut kept = found;
    kept.deck.closed = kept.deck.closed.or(Some(Closure::CheckpointUnwritable));
    (kept, Some(e))
}

/// Removes a file that no start may believe any more.
fn discard(path: &Path) {
    match fs::remove_file(path) {
        Ok(()) => {}
        Err(e) if e.kind() == ErrorKind::NotFound => {}
        Err(e) => warn!(
            "removing {}: {e}: once the disk is writable, a start would believe this old state: remove it by hand",
            path.display()
        ),
    }
}

/// Keeps the state on the disk.
pub struct DeckFile {
    vessel: u32,
    newest: Option<VesselCheckpoint>,
    states: Option<SyncSender<Vec<u8>>>,
    writer: Option<JoinHandle<()>>,
    error: Arc<Mutex<Option<String>>>,
}

impl DeckFile {
    /// Opens the computer's file; with what the former start left.
    pub fn open(computer: &VesselComputer) -> (DeckFile, VesselCheckpoint) {
        DeckFile::at(own_path(computer), computer.vessel_id)
    }
    fn at(path: PathBuf, vessel: u32) -> (DeckFile, VesselCheckpoint) {
        let unknown = |closure| VesselCheckpoint {
            deck: DeckCheckpoint::unknown(closure),
            ..VesselCheckpoint::default()
        };
        let found = match load(&path, vessel) {
            Ok(Some(found)) => found,
            Ok(None) => {
                warn!(
                    "there is no {}: who stands on the deck is not known, and it is closed: look, then alight command \
                     deck open",
                    path.display()
                );
                unknown(Closure::CheckpointMissing)
            }
            Err(e) => {
                let damaged = path.with_extension("damaged");
                // A copy: until the closed state has replaced it, the next start must find it damaged too.
                let _kept_aside = fs::copy(&path, damaged);
                warn!(
                    "{}: {e}: who stands on the deck is not known, and it is closed: look, then alight command deck \
                     open",
                    path.display()
                );
                unknown(Closure::CheckpointDamaged)
            }
        };
        let (kept, failed) = confirm(&path, vessel, found);
        let unsaved = failed.as_ref().and_then(|_| encode(vessel, &kept).ok());
        let (sender, receiver) = sync_channel(MAX_WAITING);
        let error = Arc::new(Mutex::new(failed));
        let writer = {
            let error = Arc::clone(&error);
            // A disk may take long: the vessel's estimate does not wait for it.
            std::thread::spawn(move || write_all(&path, &receiver, &error, unsaved))
        };
        let file = DeckFile {
            vessel,
            newest: None,
            states: Some(sender),
            writer: Some(writer),
            error,
        };
        (file, kept)
    }
    /// Keeps this from now on.
    pub fn keep(&mut self, kept: VesselCheckpoint) {
        if self.newest.as_ref() == Some(&kept) {
            return;
        }
        let (Ok(bytes), Some(states)) = (encode(self.vessel, &kept), &self.states) else {
            return;
        };
        // Where too many wait, the next call tries again.
        if states.try_send(bytes).is_ok() {
            self.newest = Some(kept);
        }
    }
    /// Why the newest state is not on the disk, if it is not.
    pub fn error(&self) -> Option<String> {
        self.error.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Drop for DeckFile {
    fn drop(&mut self) {
        // The newest state is on the disk before the process ends.
        self.states = None;
        let _ended = self.writer.take().map(JoinHandle::join);
    }
}

/// Writes the newest state until nobody sends any more; `unsaved` is one that could not be written before.
fn write_all(
    path: &Path,
    states: &Receiver<Vec<u8>>,
    error: &Mutex<Option<String>>,
    mut unsaved: Option<Vec<u8>>,
) {
    loop {
        let next = match &unsaved {
            None => states.recv().ok(),
            Some(bytes) => match states.recv_timeout(RETRY_PERIOD) {
                Ok(newer) => Some(newer),
                Err(RecvTimeoutError::Timeout) => Some(bytes.clone()),
                Err(RecvTimeoutError::Disconnected) => None,
            },
        };
        let Some(next) = next else { return };
        let newest = states.try_iter().last().unwrap_or(next);
        let done = replace(path, &newest);
        let failed = done.err().map(|e| format!("writing {}: {e}", path.display()));
        match (&failed, &unsaved) {
            (Some(e), None) => {
                warn!(
                    "the deck's state is lost with this process, and the next start finds the deck closed: {e}; tried \
                     again every 10 s"
                );
                // It is older than what it could not be replaced by.
                discard(path);
            }
            (None, Some(_)) => info!("the deck's state is in {} again", path.display()),
            (Some(_), Some(_)) | (None, None) => {}
        }
        unsaved = failed.is_some().then_some(newest);
        *error.lock().unwrap_or_else(PoisonError::into_inner) = failed;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_usv::deck::{Claim, DroneClaim};

    fn scratch(name: &str) -> PathBuf {
        let directory = std::env::temp_dir().join(format!("alight-deck-{}-{name}", std::process::id()));
        let _none = fs::remove_dir_all(&directory);
        fs::create_dir_all(&directory).unwrap();
        directory.join("vessel.deck")
    }
    fn occupied() -> VesselCheckpoint {
        VesselCheckpoint {
            deck: DeckCheckpoint {
                owner: Some(3),
                closed: None,
                claims: vec![DroneClaim {
                    drone: 3,
                    boot: 9,
                    claim: Claim::OnDeck,
                    place: None,
                    inside: true,
                }],
            },
            ..VesselCheckpoint::default()
        }
    }
    fn remove(path: &Path) {
        fs::remove_dir_all(path.parent().unwrap()).unwrap();
    }

    fn open(path: &Path) -> (DeckFile, VesselCheckpoint) {
        DeckFile::at(path.to_owned(), 1)
    }
    fn closed(path: &Path) -> Option<Closure> {
        open(path).1.deck.closed
    }

    #[test]
    fn missing_deck_file() {
        let path = scratch("missing");
        assert_eq!(closed(&path), Some(Closure::CheckpointMissing));
        // That is written at once: the next start knows no more.
        assert_eq!(closed(&path), Some(Closure::CheckpointMissing));
        // The first file of an installation or a simulated run.
        replace(&path, FIRST).unwrap();
        assert_eq!(closed(&path), None);
        remove(&path);
    }

    /// Permissions stop no test that runs as root: a directory in the place of the new file does.
    fn block(path: &Path) -> PathBuf {
        let mut new = path.as_os_str().to_owned();
        new.push(".new");
        fs::create_dir(&new).unwrap();
        new.into()
    }

    #[test]
    fn unwritable_deck_file_at_start() {
        let path = scratch("start");
        replace(&path, &encode(1, &occupied()).unwrap()).unwrap();
        let blocked = block(&path);
        let (file, kept) = open(&path);
        assert_eq!(kept.deck.closed, Some(Closure::CheckpointUnwritable));
        assert_eq!(
            kept.deck.claims,
            occupied().deck.claims,
            "what it held may be true"
        );
        assert!(file.error().unwrap().contains("vessel.deck"));
        assert!(!path.exists(), "no start believes it");
        drop(file);
        fs::remove_dir(blocked).unwrap();
        assert_eq!(closed(&path), Some(Closure::CheckpointMissing));
        remove(&path);
    }

    #[test]
    fn unwritable_deck_file_after_a_landing() {
        let path = scratch("landing");
        replace(&path, &encode(1, &VesselCheckpoint::default()).unwrap()).unwrap();
        let (mut file, kept) = open(&path);
        assert_eq!(kept.deck.closed, None);
        let blocked = block(&path);
        file.keep(occupied());
        drop(file);
        assert!(!path.exists(), "the empty deck that it held is not true any more");
        fs::remove_dir(blocked).unwrap();
        assert_eq!(closed(&path), Some(Closure::CheckpointMissing));
        remove(&path);
    }

    #[test]
    fn deck_file_at_the_next_start() {
        let path = scratch("newest");
        let (mut file, _) = open(&path);
        file.keep(VesselCheckpoint::default());
        file.keep(occupied());
        drop(file);
        assert_eq!(open(&path).1, occupied());
        remove(&path);
    }

    #[test]
    fn damaged_deck_file() {
        let path = scratch("damaged");
        let whole = encode(1, &occupied()).unwrap();
        let text = String::from_utf8(whole.clone()).unwrap();
        let cases: [(&str, Vec<u8>); 6] = [
            ("cut", whole[..whole.len() - 7].to_vec()),
            ("empty", Vec::new()),
            (
                "another drone",
                text.replace("\"owner\":3", "\"owner\":4").into_bytes(),
            ),
            (
                "another version",
                text.replace(&format!("\"version\":{VERSION}"), "\"version\":1")
                    .into_bytes(),
            ),
            ("of another vessel", encode(2, &occupied()).unwrap()),
            ("too long", vec![b' '; 1 << 17]),
        ];
        for (name, bytes) in cases {
            fs::write(&path, bytes).unwrap();
            let (_file, kept) = open(&path);
            assert_eq!(kept.deck.closed, Some(Closure::CheckpointDamaged), "{name}");
        }
        remove(&path);
    }

    #[test]
    fn unwritable_deck_file_error() {
        let path = scratch("blocked");
        let blocked = path.join("vessel.deck");
        fs::write(&path, "a file in the place of the directory").unwrap();
        let (mut file, _) = open(&blocked);
        file.keep(occupied());
        let mut waits = 0;
        while file.error().is_none() && waits < 1000 {
            crate::process::supervisor::pause(Duration::from_millis(10));
            waits += 1;
        }
        assert!(
            file.error().unwrap().contains("vessel.deck"),
            "{:?}",
            file.error()
        );
        drop(file);
        remove(&path);
    }
}
