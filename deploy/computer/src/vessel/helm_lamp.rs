//! Lamp at the helm, on a [`DigitalLine`]: it requests a steady course while lit.
//!
//! It is written at 2 Hz on a separate thread, because a driver may take long; it is switched off when the process
//! ends.

use std::{
    sync::{
        Arc, Mutex, PoisonError,
        mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel},
    },
    thread::JoinHandle,
    time::Duration,
};

use tracing::{info, warn};

use crate::io::digital_line::DigitalLine;

const PERIOD: Duration = Duration::from_millis(500);
pub const REMEDY: &str = "it cannot signal the helm: give the user alight write access to the line or file \
                          (alight help operate), or clear deck.helm_lamp in vessel.toml";

pub struct HelmLamp {
    levels: Option<SyncSender<bool>>,
    writer: Option<JoinHandle<()>>,
    shown: bool,
    error: Arc<Mutex<Option<String>>>,
}

impl HelmLamp {
    /// Starts to drive the lamp at `path`, initially off; an empty path means no lamp.
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

/// Shows the newest level until the sender ends, then switches the lamp off.
fn drive(path: &str, levels: &Receiver<bool>, error: &Mutex<Option<String>>) {
    let mut line = DigitalLine::new(path);
    let mut lit = false;
    let mut ended = false;
    let mut before = None;
    while !ended {
        let failed = line.write(lit).err();
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
            Ok(newest) => lit = newest,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => ended = true,
        }
    }
    let _out = line.write(false);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::scratch;
    use std::fs;

    #[test]
    fn helm_lamp_on_off_and_end() {
        let path = scratch("lamp");
        let text = path.display().to_string();
        fs::write(&path, "1").unwrap();
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
