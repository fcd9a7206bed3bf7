//! The lamp at the helm that asks for a steady course: a file that takes 0 or 1, such as `/sys/class/gpio/gpio18/value`,
//! or one that a program reads which drives another interface.
//!
//! It is written twice a second in a thread of its own, since a driver may take long, and put out when the process ends.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use tracing::{info, warn};

/// Time between two writings of the same level.
const PERIOD: Duration = Duration::from_millis(500);
/// What to do about a lamp that cannot be written.
pub const REMEDY: &str = "the helm is not asked by it: export the line as an output, let the user alight write it \
                          (docs/operate.md), or empty deck.helm_lamp in vessel.toml";

/// Writes the level to a file that exists.
fn write_level(path: &Path, lit: bool) -> Result<(), String> {
    // Writing to a pipe or a device may wait for ever; what sysfs offers is a regular file.
    if !fs::metadata(path).map_err(|e| e.to_string())?.is_file() {
        return Err("not a regular file".into());
    }
    let file = OpenOptions::new().write(true).truncate(true).open(path);
    let level: &[u8] = if lit { b"1\n" } else { b"0\n" };
    file.and_then(|mut file| file.write_all(level))
        .map_err(|e| e.to_string())
}

/// The lamp, while its thread drives it.
pub struct HelmLamp {
    levels: Option<SyncSender<bool>>,
    writer: Option<JoinHandle<()>>,
    shown: bool,
    error: Arc<Mutex<Option<String>>>,
}

impl HelmLamp {
    /// Begins to drive the lamp at `path`, out; an empty path is none.
    pub fn start(path: &str) -> HelmLamp {
        let error = Arc::new(Mutex::new(None));
        let mut lamp = HelmLamp {
            levels: None,
            writer: None,
            shown: false,
            error: Arc::clone(&error),
        };
        if !path.is_empty() {
            let (sender, levels) = sync_channel(1);
            let path = path.to_owned();
            lamp.levels = Some(sender);
            lamp.writer = Some(std::thread::spawn(move || drive(&path, &levels, &error)));
        }
        lamp
    }
    /// Lit or out from now on.
    pub fn set(&mut self, lit: bool) {
        if lit == self.shown {
            return;
        }
        let sent = self.levels.as_ref().map(|levels| levels.try_send(lit));
        // While the thread is busy, the next call tries again.
        if !matches!(sent, Some(Err(TrySendError::Full(_)))) {
            self.shown = lit;
        }
    }
    /// Why it cannot be written.
    pub fn error(&self) -> Option<String> {
        self.error.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Drop for HelmLamp {
    fn drop(&mut self) {
        self.levels = None;
        let _ended = self.writer.take().map(JoinHandle::join);
    }
}

/// Writes the newest level until nobody sends any more, then puts the lamp out.
fn drive(path: &str, levels: &Receiver<bool>, error: &Mutex<Option<String>>) {
    let (mut lit, mut ended, mut before) = (false, false, None);
    while !ended {
        let failed = write_level(Path::new(path), lit).err();
        let failed = failed.map(|e| format!("deck.helm_lamp: {path}: {e}"));
        if failed != before {
            match &failed {
                Some(e) => warn!("{e}: {REMEDY}"),
                None => info!("deck.helm_lamp: {path}: written again"),
            }
            (*error.lock().unwrap_or_else(PoisonError::into_inner)).clone_from(&failed);
            before = failed;
        }
        match levels.recv_timeout(PERIOD) {
            Ok(level) => lit = level,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => ended = true,
        }
    }
    let _out = write_level(Path::new(path), false);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn helm_lamp_follows_and_is_out_after_its_end() {
        let path = std::env::temp_dir().join(format!("alight-lamp-{}", std::process::id()));
        let text = path.display().to_string();
        assert!(write_level(&path, true).is_err(), "a missing file is not created");
        assert!(
            write_level(Path::new("/dev/null"), true).is_err(),
            "no regular file"
        );
        fs::write(&path, "1").unwrap();
        write_level(&path, false).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "0\n");
        write_level(&path, true).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "1\n");
        let mut lamp = HelmLamp::start(&text);
        lamp.set(true);
        drop(lamp);
        assert_eq!(fs::read_to_string(&path).unwrap(), "0\n");
        fs::remove_file(&path).unwrap();
        let mut none = HelmLamp::start("");
        none.set(true);
        assert_eq!(none.error(), None);
    }
}
