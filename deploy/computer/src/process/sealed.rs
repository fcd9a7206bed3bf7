//! Configuration of a flight, fixed at its start. The supervisor reads its file once and gives its processes a copy
//! of the text, so that a process that restarts in flight does not apply later edits. In the copy, the text of
//! Zenoh's own configuration file replaces its name. The supervisor keeps the copy fresh and removes it at an orderly
//! end. A successor that finds a fresh copy continues with it, because its predecessor was killed. An edit of the
//! file is reported and takes effect at the next start.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, Read, Write},
    os::unix::fs::{MetadataExt, OpenOptionsExt},
    path::{Path, PathBuf},
    time::{Duration, SystemTime},
};

use alight_shared::{
    config::{self, Check},
    wire,
};
use alight_transport::radio::zenoh_text;
use serde::de::DeserializeOwned;
use tracing::warn;

use crate::{
    config::method,
    exit::{CliError, Doing},
};

/// Maximum age of a copy that a successor continues to use: a hundred times the service manager's delay before it
/// starts one.
const MAX_AGE: Duration = Duration::from_secs(10);
const LOOK_PERIOD_NS: i64 = 1_000_000_000;
const MAX_BYTES: u64 = 1 << 20;

pub struct SealedConfig {
    origin: PathBuf,
    copy: PathBuf,
    text: String,
    edited: bool,
    next_look_ns: i64,
    unused: bool,
}

impl SealedConfig {
    pub fn begin<T: DeserializeOwned + Check>(origin: &Path) -> Result<(T, SealedConfig), CliError> {
        SealedConfig::begin_in(&std::env::temp_dir(), origin)
    }
    fn begin_in<T: DeserializeOwned + Check>(
        directory: &Path,
        origin: &Path,
    ) -> Result<(T, SealedConfig), CliError> {
        let copy = copy_of(directory, origin)?;
        if let Some(text) = fresh(&copy) {
            match config::parse(&text, &copy.display().to_string()) {
                Ok(computer) => {
                    let mut sealed = SealedConfig::of(origin, copy, text, false);
                    sealed.look();
                    return Ok((computer, sealed));
                }
                Err(e) => warn!("{e}: the configuration of the previous supervisor is ignored"),
            }
        }
        let text = read(origin).doing(format_args!(
            "reading {} (--config names another file, alight init writes one)",
            origin.display()
        ))?;
        let computer = method::parse(&text, &origin.display().to_string())?;
        let text = whole(text)?;
        write(&copy, &text).doing(format_args!("writing {}", copy.display()))?;
        Ok((computer, SealedConfig::of(origin, copy, text, true)))
    }
    fn of(origin: &Path, copy: PathBuf, text: String, unused: bool) -> SealedConfig {
        SealedConfig {
            origin: origin.to_owned(),
            copy,
            text,
            edited: false,
            next_look_ns: i64::MIN,
            unused,
        }
    }
    pub fn path(&self) -> &Path {
        &self.copy
    }
    /// Message about the file if it differs from the configuration in use.
    pub fn edited(&self) -> Option<String> {
        let message = || {
            format!(
                "{} was edited since the start: the service uses the old file until it is restarted",
                self.origin.display()
            )
        };
        self.edited.then(message)
    }
    /// Keeps the copy fresh and compares the file with it; true if the result has changed.
    pub fn poll(&mut self, now_ns: i64) -> bool {
        if now_ns < self.next_look_ns {
            return false;
        }
        self.next_look_ns = now_ns.saturating_add(LOOK_PERIOD_NS);
        self.unused = false;
        let touched = touch(&self.copy);
        // The next process to start needs the copy.
        if touched.is_err() {
            let _unwritten = write(&self.copy, &self.text);
        }
        self.look()
    }
    fn look(&mut self) -> bool {
        let now = read(&self.origin).ok().and_then(|text| whole(text).ok());
        let edited = now.is_none_or(|text| text != self.text);
        let changed = edited != self.edited;
        self.edited = edited;
        if let Some(message) = self.edited().filter(|_| changed) {
            warn!("{message}");
        }
        changed
    }
    pub fn end(mut self) {
        self.unused = true;
    }
}

impl Drop for SealedConfig {
    fn drop(&mut self) {
        // A failed start must not be continued. A copy that cannot be removed soon becomes too old.
        if self.unused {
            let _left = fs::remove_file(&self.copy);
        }
    }
}

/// Configuration text of the running service that was started with the file `origin`; None without one or if it
/// belongs to another user.
pub fn running(origin: &Path) -> Option<String> {
    fresh(&copy_of(&std::env::temp_dir(), origin).ok()?)
}

/// Configuration text with Zenoh's own configuration, if any, in place of its file name.
fn whole(text: String) -> Result<String, CliError> {
    // The parser later rejects text that is not TOML, and names the line.
    let mut table: toml::Table = toml::from_str(&text).unwrap_or_default();
    let Some(toml::Value::String(zenoh)) = table.get_mut("radio").and_then(|radio| radio.get_mut("zenoh"))
    else {
        return Ok(text);
    };
    let Some(own) = zenoh_text(zenoh)? else {
        return Ok(text);
    };
    *zenoh = own;
    toml::to_string(&table).doing("writing Zenoh's own configuration (radio.zenoh) into a copy")
}

fn copy_of(directory: &Path, origin: &Path) -> Result<PathBuf, CliError> {
    let named = fs::canonicalize(origin).unwrap_or_else(|_| origin.to_owned());
    let hash = wire::hash_record(&named.display().to_string()).doing("naming a copy")?;
    Ok(directory.join(format!("alight-config-{hash:016x}.toml")))
}

fn fresh(copy: &Path) -> Option<String> {
    let found = fs::symlink_metadata(copy).ok()?;
    let own = found.is_file() && found.uid() == rustix::process::geteuid().as_raw();
    let age = found.modified().ok()?.elapsed().unwrap_or_default();
    (own && age <= MAX_AGE).then(|| read(copy).ok())?
}

/// Sets the copy's time to the present, by the file system's clock, because its age is compared across processes.
#[allow(clippy::disallowed_methods)]
fn touch(copy: &Path) -> io::Result<()> {
    File::options()
        .append(true)
        .open(copy)?
        .set_modified(SystemTime::now())
}

fn read(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    File::open(path)?.take(MAX_BYTES).read_to_string(&mut text)?;
    Ok(text)
}

fn write(copy: &Path, text: &str) -> io::Result<()> {
    let new = copy.with_extension(format!("{}.new", std::process::id()));
    // Removes a file or link of another user.
    let _none = fs::remove_file(&new);
    let mut file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(&new)?;
    file.write_all(text.as_bytes())?;
    fs::rename(&new, copy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{config::DroneComputerConfig, scratch::scratch};

    fn number(path: &Path) -> u32 {
        let computer: DroneComputerConfig = config::load(path).unwrap();
        computer.bridge.drone_id
    }

    #[test]
    fn configuration_edited_in_flight() {
        let directory = scratch("sealed");
        fs::create_dir_all(&directory).unwrap();
        let origin = directory.join("drone.toml");
        let edit = |text: &str| fs::write(&origin, text).unwrap();
        let begin = || SealedConfig::begin_in::<DroneComputerConfig>(&directory, &origin).unwrap();
        edit("[bridge]\ndrone_id = 2\n");
        let (computer, mut sealed) = begin();
        assert_eq!((computer.bridge.drone_id, number(sealed.path())), (2, 2));
        assert!(!sealed.poll(0) && sealed.edited().is_none());
        // A process that starts now uses the copy, and the edit is reported once.
        edit("[bridge]\ndrone_id = 3\n");
        assert!(!sealed.poll(LOOK_PERIOD_NS / 2), "not yet looked");
        assert!(sealed.poll(LOOK_PERIOD_NS) && !sealed.poll(2 * LOOK_PERIOD_NS));
        assert!(sealed.edited().unwrap().contains("drone.toml was edited"));
        assert_eq!(number(sealed.path()), 2);
        // A successor of a killed supervisor also uses it, even if the file is no longer a valid configuration.
        edit("half a fi");
        let (computer, successor) = begin();
        assert!(computer.bridge.drone_id == 2 && successor.edited().is_some());
        sealed.poll(3 * LOOK_PERIOD_NS);
        // The file is used if no supervisor ran recently, and after an orderly end.
        edit("[bridge]\ndrone_id = 4\n");
        let copy = File::options().append(true).open(successor.path()).unwrap();
        copy.set_modified(SystemTime::UNIX_EPOCH).unwrap();
        let (computer, sealed) = begin();
        assert_eq!(computer.bridge.drone_id, 4);
        edit("[bridge]\ndrone_id = 5\n");
        sealed.end();
        assert_eq!(begin().0.bridge.drone_id, 5);
        // The file is also used after a failed start. A removed copy is written again.
        edit("[bridge]\ndrone_id = 6\n");
        let (computer, mut sealed) = begin();
        assert_eq!(computer.bridge.drone_id, 6);
        fs::remove_file(sealed.path()).unwrap();
        sealed.poll(0);
        assert_eq!(number(sealed.path()), 6);
        fs::remove_dir_all(directory).unwrap();
    }

    #[test]
    fn zenoh_file_edited_in_flight() {
        let directory = scratch("sealed-zenoh");
        fs::create_dir_all(&directory).unwrap();
        let origin = directory.join("drone.toml");
        let zenoh = directory.join("zenoh.json5");
        let text = format!(
            "[radio]\nconnect = [\"udp/192.168.7.1:7447\"]\nzenoh = {:?}\n",
            zenoh.display().to_string()
        );
        fs::write(&origin, &text).unwrap();
        let begin = || SealedConfig::begin_in::<DroneComputerConfig>(&directory, &origin);
        assert!(begin().err().unwrap().to_string().contains("zenoh.json5"));
        let original = "{\n  metadata: { boat: \"Ida\" }, // a comment\n}\n";
        fs::write(&zenoh, original).unwrap();
        let (_, mut sealed) = begin().unwrap();
        let flown = |sealed: &SealedConfig| {
            let computer: DroneComputerConfig = config::load(sealed.path()).unwrap();
            computer.radio.check_zenoh().unwrap();
            computer.radio.zenoh
        };
        assert_eq!(flown(&sealed), original);
        assert!(!sealed.poll(0));
        // A process that starts now uses the copy, and so does a successor of a killed supervisor.
        fs::write(&zenoh, "{ mode: ").unwrap();
        assert!(sealed.poll(LOOK_PERIOD_NS) && sealed.edited().is_some());
        fs::remove_file(&zenoh).unwrap();
        assert!(!sealed.poll(2 * LOOK_PERIOD_NS) && sealed.edited().is_some());
        let (computer, successor) = begin().unwrap();
        assert_eq!(
            (&*computer.radio.zenoh, flown(&successor)),
            (original, original.into())
        );
        fs::write(&zenoh, original).unwrap();
        assert!(sealed.poll(3 * LOOK_PERIOD_NS) && sealed.edited().is_none());
        fs::remove_dir_all(directory).unwrap();
    }
}
