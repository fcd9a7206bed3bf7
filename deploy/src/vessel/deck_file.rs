//! The file in which the vessel's process keeps what it must not forget of its deck, and the crew's orders.
//!
//! It is written to the disk at each change, whole and under another name first, and carries version and checksum: the
//! next start finds the old state or the new one. One that cannot be read closes the deck until a person opens it.

use std::fs::{self, File};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use alight_shared::wire;
use alight_usv::VesselCheckpoint;
use alight_usv::deck::{DeckCheckpoint, DeckOrder};
use serde::{Deserialize, Serialize};
use tracing::{info, warn};

use crate::config::VesselComputer;
use crate::process::supervisor::STATE_VARIABLE;
use crate::vessel::status_file::file_name;

/// Of this layout.
const VERSION: u32 = 4;
/// Directory of the installed service, which outlives the computer's restarts.
const SERVICE_DIRECTORY: &str = "/var/lib/alight";
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

/// What the former start left; None on the first start. An error says why it cannot be known.
fn load(path: &Path, vessel: u32) -> Result<Option<VesselCheckpoint>, String> {
    let Some(bytes) = read(path)? else {
        return Ok(None);
    };
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
    let new = path.with_extension("new");
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
    directory.join(file_name(computer, "deck"))
}

/// The file of the process that runs, or ran, on this computer.
fn existing(computer: &VesselComputer) -> Option<PathBuf> {
    let name = file_name(computer, "deck");
    let directories = [PathBuf::from(SERVICE_DIRECTORY), std::env::temp_dir()];
    // Without a name for it the service's comes first: a process that somebody started by hand leaves files too.
    let named = std::env::var_os(STATE_VARIABLE).map(|_| own_path(computer));
    let mut paths = named.into_iter().chain(directories.map(|d| d.join(&name)));
    paths.find(|path| path.exists())
}

/// Leaves an order of the crew for the process, which takes it within a second, or at its next start.
pub fn leave(computer: &VesselComputer, order: DeckOrder) -> Result<PathBuf, String> {
    let path = existing(computer)
        .ok_or("no vessel's process has run on this computer, or this user may not see it")?
        .with_extension("order");
    let bytes = serde_json::to_vec(&order).map_err(|e| e.to_string())?;
    replace(&path, &bytes).map_err(|e| format!("writing {}: {e}", path.display()))?;
    Ok(path)
}

/// Keeps the state on the disk.
pub struct DeckFile {
    vessel: u32,
    path: PathBuf,
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
        let kept = match load(&path, vessel) {
            Ok(Some(kept)) => kept,
            Ok(None) => VesselCheckpoint::default(),
            Err(e) => {
                let damaged = path.with_extension("damaged");
                // A copy: until the closed state has replaced it, the next start must find it damaged too.
                let _kept_aside = fs::copy(&path, damaged);
                warn!(
                    "{}: {e}: who stands on the deck is not known, and it is closed: look, then alight command deck \
                     open",
                    path.display()
                );
                VesselCheckpoint {
                    deck: DeckCheckpoint::damaged(),
                    ..VesselCheckpoint::default()
                }
            }
        };
        let (sender, receiver) = sync_channel(MAX_WAITING);
        let error = Arc::new(Mutex::new(None));
        let writer = {
            let (path, error) = (path.clone(), Arc::clone(&error));
            // A disk may take long: the vessel's estimate does not wait for it.
            std::thread::spawn(move || write_all(&path, &receiver, &error))
        };
        let file = DeckFile {
            vessel,
            path,
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
    /// The crew's order, if one was left.
    pub fn order(&self) -> Option<DeckOrder> {
        let path = self.path.with_extension("order");
        let order = read(&path).transpose()?;
        // One that stays would be obeyed again and again, and free the deck of whoever lands later.
        fs::remove_file(&path).ok()?;
        match order.and_then(|bytes| serde_json::from_slice(&bytes).map_err(|e| e.to_string())) {
            Ok(order) => Some(order),
            Err(e) => {
                warn!("{}: {e}: no order to the deck", path.display());
                None
            }
        }
    }
}

impl Drop for DeckFile {
    fn drop(&mut self) {
        // The newest state is on the disk before the process ends.
        self.states = None;
        let _ended = self.writer.take().map(JoinHandle::join);
    }
}

/// Writes the newest state until nobody sends any more.
fn write_all(path: &Path, states: &Receiver<Vec<u8>>, error: &Mutex<Option<String>>) {
    let mut unsaved: Option<Vec<u8>> = None;
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
                warn!("the deck's state is lost with this process: {e}; tried again every 10 s")
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
    use alight_usv::deck::{Claim, Closure, DroneClaim};

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

    #[test]
    fn deck_file_gives_the_next_start_the_newest_state() {
        let path = scratch("newest");
        let (mut file, before) = DeckFile::at(path.clone(), 1);
        assert_eq!(
            before,
            VesselCheckpoint::default(),
            "a first start knows of nobody"
        );
        file.keep(VesselCheckpoint::default());
        file.keep(occupied());
        drop(file);
        assert_eq!(DeckFile::at(path.clone(), 1).1, occupied());
        remove(&path);
    }

    #[test]
    fn deck_file_that_is_damaged_closes_the_deck() {
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
            let (_file, kept) = DeckFile::at(path.clone(), 1);
            assert_eq!(kept.deck.closed, Some(Closure::CheckpointDamaged), "{name}");
        }
        remove(&path);
    }

    #[test]
    fn deck_file_that_cannot_be_written_says_why() {
        let path = scratch("blocked");
        let blocked = path.join("vessel.deck");
        fs::write(&path, "a file in the place of the directory").unwrap();
        let (mut file, _) = DeckFile::at(blocked, 1);
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

    #[test]
    fn deck_file_takes_an_order_of_the_crew_once() {
        let path = scratch("order");
        let (file, _) = DeckFile::at(path.clone(), 1);
        let order = path.with_extension("order");
        replace(&order, &serde_json::to_vec(&DeckOrder::Closed).unwrap()).unwrap();
        assert_eq!(file.order(), Some(DeckOrder::Closed));
        assert_eq!(file.order(), None);
        fs::write(&order, "shut").unwrap();
        assert_eq!(file.order(), None);
        assert!(!order.exists());
        remove(&path);
    }
}
