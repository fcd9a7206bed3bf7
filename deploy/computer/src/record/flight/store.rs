//! Flights of a computer: their directories, and removal of the oldest when the disk is full.

use std::{
    fs::{File, TryLockError},
    io,
    path::{Path, PathBuf},
};

use time::OffsetDateTime;

use super::{
    MIN_FREE_BYTES, free_bytes,
    summary::{FlightSummary, SUMMARY_FILE},
};
use crate::record::{
    EXTENSION,
    reading::{is_whole, parts},
};

/// Maximum number of flights that are examined; a start every minute creates this number in a week.
const MAX_FLIGHTS: usize = 10_000;
const MAX_TRIES: u32 = 100;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredFlight {
    pub path: PathBuf,
    /// Number of the flight on this computer, independent of the clock.
    pub number: u32,
    /// Start time (UTC), for example 20261125T181500Z.
    pub begun: String,
}

impl StoredFlight {
    /// The flight at `path`; None if the name is not a flight's.
    pub fn of(path: &Path) -> Option<StoredFlight> {
        let name = path.file_name()?.to_str()?;
        let (begun, number) = name.split_once('-')?;
        let stamp = |k: usize, c: char| match k {
            8 => c == 'T',
            15 => c == 'Z',
            _ => c.is_ascii_digit(),
        };
        let is_stamp = begun.len() == 16 && begun.chars().enumerate().all(|(k, c)| stamp(k, c));
        is_stamp.then_some(())?;
        Some(StoredFlight {
            path: path.into(),
            number: number.parse().ok()?,
            begun: begun.into(),
        })
    }
    pub fn bytes(&self) -> u64 {
        let files = std::fs::read_dir(&self.path).into_iter().flatten().flatten();
        files.filter_map(|f| f.metadata().ok()).map(|m| m.len()).sum()
    }
    pub fn is_running(&self) -> bool {
        File::open(&self.path).is_ok_and(|d| matches!(d.try_lock_shared(), Err(TryLockError::WouldBlock)))
    }
    /// Number of parts, and number of parts without an end.
    pub fn parts(&self) -> (usize, usize) {
        let all = parts(&self.path).unwrap_or_default();
        (all.len(), all.iter().filter(|p| !is_whole(p)).count())
    }
    /// The summary; the duration of a flight that was cut off follows from the times of its files.
    pub fn summary(&self) -> Option<FlightSummary> {
        let mut summary = FlightSummary::read(&self.path)?;
        let written = |path: &Path| std::fs::metadata(path).and_then(|m| m.modified()).ok();
        let newest = parts(&self.path).ok()?.iter().filter_map(|p| written(p)).max();
        if let (false, Some(summed_up), Some(newest)) =
            (summary.ended, written(&self.path.join(SUMMARY_FILE)), newest)
        {
            summary.length_s += newest.duration_since(summed_up).map_or(0.0, |d| d.as_secs_f64());
        }
        Some(summary)
    }
}

/// Flights below `root`, oldest first.
pub fn flights(root: &Path) -> io::Result<Vec<StoredFlight>> {
    let mut found: Vec<StoredFlight> = std::fs::read_dir(root)?
        .flatten()
        // The target of a link must not be removed.
        .filter(|e| e.file_type().is_ok_and(|t| t.is_dir()))
        .filter_map(|e| StoredFlight::of(&e.path()))
        .take(MAX_FLIGHTS)
        .collect();
    found.sort_by(|a, b| (a.number, &a.begun).cmp(&(b.number, &b.begun)));
    Ok(found)
}

/// Whether `directory` holds one flight, judged by its files, because the directory of `land --log` has another name.
pub fn is_flight(directory: &Path) -> bool {
    directory.join(SUMMARY_FILE).is_file() || parts(directory).is_ok_and(|p| !p.is_empty())
}

/// Begins a flight below `root`: creates its directory and the lock that marks it as running. Returns the path even
/// if the directory cannot be created, because the processes retry.
pub fn begin(root: &Path) -> (PathBuf, io::Result<File>) {
    let stamp = stamp(OffsetDateTime::now_utc());
    let made = std::fs::create_dir_all(root);
    let newest = flights(root).ok().and_then(|all| all.last().map(|f| f.number));
    let first = newest.unwrap_or(0).saturating_add(1);
    let path = |number: u32| root.join(format!("{stamp}-{number:04}"));
    if let Err(e) = made {
        return (path(first), Err(e));
    }
    for number in (first..).take(MAX_TRIES as usize) {
        let path = path(number);
        match std::fs::create_dir(&path) {
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
            Err(e) => return (path, Err(e)),
            Ok(()) => {
                let lock = lock(root, &path);
                return (path, lock);
            }
        }
    }
    (path(first), Err(io::ErrorKind::AlreadyExists.into()))
}

fn lock(root: &Path, path: &Path) -> io::Result<File> {
    // Makes the name survive a power cut.
    File::open(root)?.sync_all()?;
    let directory = File::open(path)?;
    // Recording also works on a file system without locks.
    let _unlocked = directory.try_lock();
    Ok(directory)
}

fn stamp(t: OffsetDateTime) -> String {
    let year = t.year().clamp(0, 9999);
    let month = u8::from(t.month());
    let (hour, minute, second) = t.to_hms();
    format!(
        "{year:04}{month:02}{:02}T{hour:02}{minute:02}{second:02}Z",
        t.day()
    )
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Removed {
    Flight(PathBuf),
    /// Oldest part of the current flight. Its removal is the last resort, because the flight can then not be replayed.
    Part(PathBuf),
}

#[derive(Clone, Copy, Debug)]
pub struct Room {
    pub max_bytes: u64,
    pub min_free_bytes: u64,
}

impl Room {
    /// Limits for this size of all flights; more space stays free than the minimum at which recording stops.
    pub fn of(max_bytes: u64) -> Room {
        Room {
            max_bytes,
            min_free_bytes: 2 * MIN_FREE_BYTES,
        }
    }
    /// Removes the oldest ended flights below `root` until there is enough room; if `current` alone is too large, its
    /// oldest parts.
    pub fn make(&self, root: &Path, current: &Path) -> io::Result<Vec<Removed>> {
        let sized = |f: StoredFlight| {
            let bytes = f.bytes();
            (f, bytes)
        };
        let all: Vec<(StoredFlight, u64)> = flights(root)?.into_iter().map(sized).collect();
        let mut total: u64 = all.iter().map(|(_, bytes)| bytes).sum();
        let fits = |total| total <= self.max_bytes;
        let is_free = || free_bytes(root).is_none_or(|free| free >= self.min_free_bytes);
        let mut removed = Vec::new();
        for (flight, bytes) in all {
            if fits(total) && is_free() {
                return Ok(removed);
            }
            if flight.path == current || flight.is_running() {
                continue;
            }
            std::fs::remove_dir_all(&flight.path)?;
            total = total.saturating_sub(bytes);
            removed.push(Removed::Flight(flight.path));
        }
        // If other files fill the disk, recording stops, but this flight keeps its parts.
        for (path, bytes) in closed_parts(current) {
            if fits(total) {
                break;
            }
            std::fs::remove_file(&path)?;
            total = total.saturating_sub(bytes);
            removed.push(Removed::Part(path));
        }
        Ok(removed)
    }
}

/// Parts of a running flight with their sizes, oldest first, without the newest part of each process, which is still
/// being written.
fn closed_parts(directory: &Path) -> Vec<(PathBuf, u64)> {
    let mut all: Vec<_> = std::fs::read_dir(directory)
        .into_iter()
        .flatten()
        .flatten()
        .filter(|e| e.path().extension().is_some_and(|x| x == EXTENSION))
        .filter_map(|e| {
            let meta = e.metadata().ok()?;
            let name = e.file_name().into_string().ok()?;
            let process = name.split('-').next()?.to_owned();
            Some((meta.modified().ok()?, process, e.path(), meta.len()))
        })
        .collect();
    all.sort();
    let newest = |process: &str| all.iter().rposition(|(_, p, ..)| p == process);
    let closed = all
        .iter()
        .enumerate()
        .filter(|(k, (_, process, ..))| newest(process) != Some(*k));
    closed
        .map(|(_, (_, _, path, bytes))| (path.clone(), *bytes))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::scratch;

    /// Directory of flights, each with a part of 1000 bytes for each process.
    fn root(name: &str, numbers: &[u32]) -> PathBuf {
        let root = scratch(&format!("flights-{name}"));
        for number in numbers {
            // Without a GNSS receiver, the computer's clock starts from an old time again.
            let path = root.join(format!("2026112{}T181500Z-{number:04}", 9 - number % 10));
            std::fs::create_dir_all(&path).unwrap();
            for process in ["pilot", "mission"] {
                std::fs::write(path.join(format!("{process}-00000007-001.mcap")), [0; 1000]).unwrap();
            }
        }
        root
    }
    fn left(root: &Path) -> Vec<u32> {
        flights(root).unwrap().iter().map(|f| f.number).collect()
    }
    fn room(max_bytes: u64) -> Room {
        Room {
            max_bytes,
            min_free_bytes: 0,
        }
    }

    #[test]
    fn removal_of_the_oldest_flights() {
        let root = root("room", &[1, 2, 3, 4]);
        let elsewhere = root.with_extension("elsewhere");
        std::fs::create_dir_all(&elsewhere).unwrap();
        std::fs::write(elsewhere.join("file"), "somebody else's").unwrap();
        std::os::unix::fs::symlink(&elsewhere, root.join("20260101T000000Z-0000")).unwrap();
        std::fs::create_dir(root.join("notes")).unwrap();
        std::fs::write(root.join("notes/file"), [0; 9000]).unwrap();
        let current = flights(&root).unwrap().pop().unwrap().path;
        assert_eq!(room(8000).make(&root, &current).unwrap(), []);
        let removed = room(5000).make(&root, &current).unwrap();
        assert_eq!((removed.len(), left(&root)), (2, vec![3, 4]));
        assert!(root.join("notes/file").exists() && elsewhere.join("file").exists());
        for path in [root, elsewhere] {
            std::fs::remove_dir_all(path).unwrap();
        }
    }

    #[test]
    fn removal_of_parts_of_a_running_flight() {
        let root = root("runs", &[1, 2]);
        let all = flights(&root).unwrap();
        let other = &all[0];
        let current = &all[1].path;
        let runs = File::open(&other.path).unwrap();
        runs.try_lock().unwrap();
        assert!(other.is_running() && !all[1].is_running());
        // The newest part of each of two processes is still being written.
        for number in 2..5 {
            let part = current.join(format!("pilot-00000007-{number:03}.mcap"));
            std::fs::write(&part, [0; 1000]).unwrap();
            let file = File::options().write(true).open(&part).unwrap();
            let time = std::time::UNIX_EPOCH + std::time::Duration::from_secs(4_000_000_000 + number);
            file.set_modified(time).unwrap();
        }
        let removed = room(5000).make(&root, current).unwrap();
        let oldest = [1, 2].map(|n| Removed::Part(current.join(format!("pilot-00000007-{n:03}.mcap"))));
        assert_eq!(removed, oldest);
        assert_eq!(room(0).make(&root, current).unwrap().len(), 1);
        assert_eq!((left(&root), parts(current).unwrap().len()), (vec![1, 2], 2));
        drop(runs);
        let disk_is_full = Room {
            max_bytes: u64::MAX,
            min_free_bytes: u64::MAX,
        };
        disk_is_full.make(&root, current).unwrap();
        assert_eq!((left(&root), parts(current).unwrap().len()), (vec![2], 2));
        std::fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn flight_number_with_a_wrong_clock() {
        let root = root("begins", &[1, 7]);
        let (path, lock) = begin(&root);
        let own = StoredFlight::of(&path).unwrap();
        assert!(own.number == 8 && own.is_running() && left(&root) == [1, 7, 8]);
        drop(lock);
        assert!(!own.is_running());
        assert!(StoredFlight::of(Path::new("notes")).is_none());
        assert!(StoredFlight::of(Path::new("20261125X181500Z-0001")).is_none());
        std::fs::remove_dir_all(&root).unwrap();
        // A file in its place prevents the directory: the path is returned with the reason.
        std::fs::write(&root, "").unwrap();
        let (path, lock) = begin(&root);
        assert!(path.starts_with(&root) && lock.is_err());
        std::fs::remove_file(root).unwrap();
    }
}
