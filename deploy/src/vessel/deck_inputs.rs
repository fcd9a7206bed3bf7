//! The deck's digital inputs as Linux offers them: files that hold 0 or 1, such as `/sys/class/gpio/gpio17/value`, or
//! what a program writes that reads another interface. The crew's switch, a sensor of what lies on the deck, and the
//! helm's switch.
//!
//! Each is read twice a second in a thread of its own, since a driver may take long. One that cannot be read yields no
//! level, and the deck arbiter then counts it as active.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

use alight_usv::deck::{DeckConfig, DeckInputs};
use tracing::{info, warn};

use crate::process::supervisor::pause;

/// Time between two readings.
const PERIOD: Duration = Duration::from_millis(500);
/// A reading that takes longer is reported, ns: four periods, as the arbiter counts.
const MAX_READING_NS: i64 = 2_000_000_000;
/// Longest content, bytes.
const MAX_BYTES: u64 = 16;
/// What to do about an input that cannot be read.
pub const REMEDY: &str = "it counts as 1: export it, make it a file of 0 or 1 that the user alight may read, or empty \
                          the key in vessel.toml";

/// The inputs that may be configured: key and path; an empty path is none.
pub fn configured(deck: &DeckConfig) -> [(&'static str, &str); 3] {
    [
        ("deck.crew_switch", &deck.crew_switch),
        ("deck.occupancy_sensor", &deck.occupancy_sensor),
        ("deck.helm_switch", &deck.helm_switch),
    ]
}

/// The level that a file holds, or why it cannot be known.
pub fn read_level(path: &Path) -> Result<bool, String> {
    // Reading a pipe or a device may wait for ever; what sysfs offers is a regular file.
    if !fs::metadata(path).map_err(|e| e.to_string())?.is_file() {
        return Err("not a regular file".into());
    }
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(MAX_BYTES).read_to_end(&mut bytes));
    read.map_err(|e| e.to_string())?;
    match bytes.trim_ascii() {
        b"0" => Ok(false),
        b"1" => Ok(true),
        other => Err(format!(
            "it holds {:?}, not 0 or 1",
            String::from_utf8_lossy(other)
        )),
    }
}

type Level = Result<bool, String>;

/// One input, while its thread reads it.
struct Input {
    name: String,
    readings: Receiver<Level>,
    first: Option<Level>,
    answered_ns: i64,
    error: Option<String>,
}

impl Input {
    /// Begins to read; None where none is configured. The first level is waited for: without it the deck is closed,
    /// and a drone on its way down would break off because the vessel's process was started anew.
    fn start((key, path): (&str, &str), now_ns: i64) -> Option<Input> {
        let (sender, readings) = sync_channel(1);
        let file = Path::new(path).to_path_buf();
        (!path.is_empty()).then(|| {
            // Ends after the receiver.
            std::thread::spawn(move || {
                while sender.send(read_level(&file)).is_ok() {
                    pause(PERIOD);
                }
            });
            Input {
                name: format!("{key}: {path}"),
                first: readings.recv_timeout(PERIOD).ok(),
                readings,
                answered_ns: now_ns,
                error: None,
            }
        })
    }
    /// The level, if it was read since the last call.
    fn poll(&mut self, now_ns: i64) -> Option<bool> {
        let newest = self.readings.try_iter().last().or_else(|| self.first.take());
        let error = match &newest {
            Some(level) => level.as_ref().err().cloned(),
            None if now_ns - self.answered_ns > MAX_READING_NS => Some("reading it does not end".into()),
            None => return None,
        };
        if newest.is_some() {
            self.answered_ns = now_ns;
        }
        let error = error.map(|e| format!("{}: {e}", self.name));
        if error != self.error {
            match &error {
                Some(e) => warn!("{e}: {REMEDY}"),
                None => info!("{}: read again", self.name),
            }
            self.error = error;
        }
        newest?.ok()
    }
}

/// All inputs that are configured.
pub struct InputFiles([Option<Input>; 3]);

impl InputFiles {
    /// Begins to read them.
    pub fn start(deck: &DeckConfig, now_ns: i64) -> InputFiles {
        InputFiles(configured(deck).map(|input| Input::start(input, now_ns)))
    }
    /// The levels that were read since the last call.
    pub fn poll(&mut self, now_ns: i64) -> DeckInputs {
        let [closed, occupied, turning] = self.0.each_mut().map(|i| i.as_mut().and_then(|i| i.poll(now_ns)));
        DeckInputs {
            closed,
            occupied,
            turning,
        }
    }
    /// Why inputs cannot be read: key, path and error.
    pub fn errors(&self) -> Vec<String> {
        self.0.iter().flatten().filter_map(|i| i.error.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deck_input_is_a_small_regular_file_of_0_or_1() {
        let path = std::env::temp_dir().join(format!("alight-input-{}", std::process::id()));
        assert!(read_level(&path).is_err(), "missing");
        assert!(read_level(Path::new("/dev/zero")).is_err(), "endless");
        for (text, level) in [("0", Some(false)), ("1\n", Some(true)), (" 0\r\n", Some(false))] {
            fs::write(&path, text).unwrap();
            assert_eq!(read_level(&path).ok(), level, "{text:?}");
        }
        for nonsense in ["", "2", "01", "1 0", "\u{0}", &"1".repeat(1 << 20)] {
            fs::write(&path, nonsense).unwrap();
            assert!(read_level(&path).unwrap_err().contains("not 0 or 1"));
        }
        fs::remove_file(&path).unwrap();
    }

    #[test]
    fn deck_input_that_is_missing_yields_no_level_and_names_key_and_path() {
        let path = std::env::temp_dir().join(format!("alight-inputs-{}", std::process::id()));
        fs::write(&path, "1\n").unwrap();
        let deck = DeckConfig {
            crew_switch: path.display().to_string(),
            occupancy_sensor: "/nowhere/value".into(),
            ..DeckConfig::default()
        };
        let mut files = InputFiles::start(&deck, 0);
        let read = DeckInputs {
            closed: Some(true),
            occupied: None,
            turning: None,
        };
        assert_eq!(files.poll(0), read);
        let [error] = &files.errors()[..] else {
            panic!("{:?}", files.errors());
        };
        assert!(
            error.starts_with("deck.occupancy_sensor: /nowhere/value: "),
            "{error}"
        );
        fs::remove_file(&path).unwrap();
        let mut none = InputFiles::start(&DeckConfig::default(), 0);
        assert_eq!(none.poll(i64::MAX), DeckInputs::default());
    }
}
