//! File of the deck's checkpoint.
//!
//! It is replaced atomically at each change, with version and checksum, so the next start finds either the old state
//! or the new one. If the file is missing, unreadable, or cannot be replaced at the start (and may be outdated), the
//! state is unknown and the deck stays closed until the crew opens it. A file that cannot be replaced later is
//! removed, so that no start finds it. It remains only on a disk that became read-only; a start after that disk
//! became writable again would trust it. The installation or a launcher writes the first file, because nothing stands
//! on the deck yet.

use std::{
    fs,
    path::{Path, PathBuf},
};

use alight_shared::{
    checkpoint::{of_file, to_file},
    msg::Closure,
};
use alight_usv::{VesselCheckpoint, deck::DeckCheckpoint};
use tracing::warn;

use crate::{
    config::VesselComputerConfig,
    exit::CliError,
    io::store::{Holds, Store, discard, read, replace, state_directory},
};

const FIRST: &[u8] = b"\"open\"";

fn owner(vessel: u32) -> String {
    format!("vessel {vessel}")
}

fn encode(vessel: u32, kept: &VesselCheckpoint) -> Result<Vec<u8>, String> {
    to_file(&owner(vessel), kept).map_err(|e| e.to_string())
}

/// Content of a vessel's file; None if it is missing. The error explains why the content is unknown.
pub fn load(path: &Path, vessel: u32) -> Result<Option<VesselCheckpoint>, String> {
    let Some(bytes) = read(path).map_err(|e| e.to_string())? else {
        return Ok(None);
    };
    if bytes == FIRST {
        return Ok(Some(VesselCheckpoint::default()));
    }
    let kept = of_file(&owner(vessel), &bytes);
    kept.map(Some).map_err(|why| format!("it is invalid: {why}"))
}

fn own_path(computer: &VesselComputerConfig) -> PathBuf {
    let directory = state_directory().unwrap_or_else(std::env::temp_dir);
    directory.join(name(computer))
}

fn name(computer: &VesselComputerConfig) -> String {
    format!("alight-{}.deck", computer.instance)
}

/// Writes the first file into the directory of a simulated run.
pub fn write_first(directory: &Path, computer: &VesselComputerConfig) -> Result<(), String> {
    let path = directory.join(name(computer));
    replace(&path, FIRST, true).map_err(|e| format!("writing {}: {e}", path.display()))
}

/// Initial state of the process: `found`, once it is rewritten to the disk; a closed deck if the write fails.
fn confirm(path: &Path, vessel: u32, found: VesselCheckpoint) -> (VesselCheckpoint, Option<String>) {
    let written = encode(vessel, &found).and_then(|bytes| {
        replace(path, &bytes, true).map_err(|e| format!("writing {}: {e}", path.display()))
    });
    let Err(e) = written else {
        return (found, None);
    };
    warn!(
        "{e}: it may be old, so the deck is closed: free space or make it writable; look at the deck, then \
         alight order deck open"
    );
    discard(path);
    let mut kept = found;
    kept.deck.closed = kept.deck.closed.or(Some(Closure::CheckpointUnwritable));
    (kept, Some(e))
}

const HOLDS: Holds = Holds {
    what: "the deck's state",
    lost: "the deck's state is lost with this process, and the next start finds the deck closed",
    misleads: true,
};

pub struct DeckFile {
    vessel: u32,
    newest: Option<VesselCheckpoint>,
    store: Store,
}

impl DeckFile {
    /// Opens the computer's file; also returns the state of the previous start.
    pub fn open(computer: &VesselComputerConfig) -> Result<(DeckFile, VesselCheckpoint), CliError> {
        let path = own_path(computer);
        let doing = format!("starting the writer of {}", path.display());
        DeckFile::at(path, computer.vessel_id).map_err(|e| CliError::because(doing, e.to_string()))
    }
    fn at(path: PathBuf, vessel: u32) -> std::io::Result<(DeckFile, VesselCheckpoint)> {
        let (kept, failed) = confirm(&path, vessel, found(&path, vessel));
        let unsaved = failed.and_then(|e| Some((encode(vessel, &kept).ok()?, e)));
        let file = DeckFile {
            vessel,
            newest: None,
            store: Store::open(path, Vec::new(), unsaved, HOLDS)?,
        };
        Ok((file, kept))
    }
    pub fn keep(&mut self, kept: VesselCheckpoint) {
        if self.newest.as_ref() == Some(&kept) {
            return;
        }
        let sent = encode(self.vessel, &kept).is_ok_and(|bytes| self.store.keep(bytes));
        if sent {
            self.newest = Some(kept);
        }
    }
    pub fn error(&self) -> Option<String> {
        self.store.error()
    }
}

/// State of the previous start; a closed deck if it is unknown.
fn found(path: &Path, vessel: u32) -> VesselCheckpoint {
    let unknown = |closure| VesselCheckpoint {
        deck: DeckCheckpoint::unknown(closure),
        ..VesselCheckpoint::default()
    };
    match load(path, vessel) {
        Ok(Some(found)) => found,
        Ok(None) => {
            warn!(
                "there is no {}: the deck's drones are not known, so it is closed: look at the deck, then alight order deck \
                 open",
                path.display()
            );
            unknown(Closure::CheckpointMissing)
        }
        Err(e) => {
            let damaged = path.with_extension("damaged");
            // Until the closed state has replaced it, the next start must also find the damaged file.
            let _kept_aside = fs::copy(path, damaged);
            warn!(
                "{}: {e}: the deck's drones are not known, so it is closed: look at the deck, then alight order deck open",
                path.display()
            );
            unknown(Closure::CheckpointDamaged)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::scratch::scratch;
    use alight_usv::deck::{Claim, DroneClaim};

    fn deck_file(name: &str) -> PathBuf {
        let directory = scratch(&format!("deck-{name}"));
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
        DeckFile::at(path.to_owned(), 1).unwrap()
    }
    fn closed(path: &Path) -> Option<Closure> {
        open(path).1.deck.closed
    }

    #[test]
    fn missing_deck_file() {
        let path = deck_file("missing");
        assert_eq!(closed(&path), Some(Closure::CheckpointMissing));
        // The closed state is written at once, because the next start has no other information.
        assert_eq!(closed(&path), Some(Closure::CheckpointMissing));
        replace(&path, FIRST, true).unwrap();
        assert_eq!(closed(&path), None);
        remove(&path);
    }

    /// Blocks the new file with a directory, because root ignores permissions.
    fn block(path: &Path) -> PathBuf {
        let mut new = path.as_os_str().to_owned();
        new.push(".new");
        fs::create_dir(&new).unwrap();
        new.into()
    }

    #[test]
    fn unwritable_deck_file_at_start() {
        let path = deck_file("start");
        replace(&path, &encode(1, &occupied()).unwrap(), true).unwrap();
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
        let path = deck_file("landing");
        replace(&path, &encode(1, &VesselCheckpoint::default()).unwrap(), true).unwrap();
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
        let path = deck_file("newest");
        let (mut file, _) = open(&path);
        file.keep(VesselCheckpoint::default());
        file.keep(occupied());
        drop(file);
        assert_eq!(open(&path).1, occupied());
        remove(&path);
    }

    #[test]
    fn damaged_deck_file() {
        let path = deck_file("damaged");
        let whole = encode(1, &occupied()).unwrap();
        let mut flipped = whole.clone();
        flipped[whole.len() - 9] ^= 1;
        let cases: [(&str, Vec<u8>); 6] = [
            ("cut", whole[..whole.len() - 7].to_vec()),
            ("empty", Vec::new()),
            ("one bit", flipped),
            ("another layout", to_file(&owner(1), &(occupied(), true)).unwrap()),
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
        let path = deck_file("blocked");
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
