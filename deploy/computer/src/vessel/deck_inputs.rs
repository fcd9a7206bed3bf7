//! Digital inputs of the deck ([`DigitalLine`]): the crew's switch, an occupancy sensor, and the helm's switch.
//!
//! Each is read at 2 Hz on a separate thread, because a driver may take long. An input that cannot be read has no
//! level, and the deck arbiter treats it as active.

use std::{
    sync::mpsc::{Receiver, sync_channel},
    time::Duration,
};

use alight_usv::deck::{DeckConfig, DeckInputs};
use tracing::{info, warn};

use crate::{io::digital_line::DigitalLine, process::supervisor::pause};

const PERIOD: Duration = Duration::from_millis(500);
/// Duration of a read after which it is reported, ns: four periods, as for the arbiter.
const MAX_READING_NS: i64 = 2_000_000_000;
pub const REMEDY: &str = "it counts as 1: give the user alight read access to the line or file \
                          (alight help operate), or clear the key in \
                          vessel.toml";
/// Key and path of each possible input; an empty path means that the input is absent.
pub fn configured(deck: &DeckConfig) -> [(&'static str, &str); 3] {
    [
        ("deck.crew_switch", &deck.crew_switch),
        ("deck.occupancy_sensor", &deck.occupancy_sensor),
        ("deck.helm_switch", &deck.helm_switch),
    ]
}

type Level = Result<bool, String>;

struct Input {
    name: String,
    readings: Receiver<Level>,
    first: Option<Level>,
    answered_ns: i64,
    error: Option<String>,
}

impl Input {
    /// Starts reading; None if the input is not configured. Waits for the first level: without it the deck would be
    /// closed, and a restart of the vessel's process would abort a descent.
    fn start((key, path): (&str, &str), now_ns: i64) -> Option<Input> {
        let (sender, readings) = sync_channel(1);
        (!path.is_empty()).then(|| {
            let mut line = DigitalLine::new(path);
            // The thread ends when the receiver is dropped.
            std::thread::spawn(move || {
                while sender.send(line.read()).is_ok() {
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
    fn poll(&mut self, now_ns: i64) -> Option<bool> {
        let newest = self.readings.try_iter().last().or_else(|| self.first.take());
        let error = match &newest {
            Some(level) => level.as_ref().err().cloned(),
            None if now_ns - self.answered_ns > MAX_READING_NS => {
                Some("reading it takes more than 2 s".into())
            }
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

pub struct InputFiles([Option<Input>; 3]);

impl InputFiles {
    pub fn start(deck: &DeckConfig, now_ns: i64) -> InputFiles {
        InputFiles(configured(deck).map(|input| Input::start(input, now_ns)))
    }
    pub fn poll(&mut self, now_ns: i64) -> DeckInputs {
        let [closed, occupied, turning] = self.0.each_mut().map(|i| i.as_mut().and_then(|i| i.poll(now_ns)));
        DeckInputs {
            closed,
            occupied,
            turning,
        }
    }
    pub fn errors(&self) -> Vec<String> {
        self.0.iter().flatten().filter_map(|i| i.error.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::scratch;
    use std::fs;

    #[test]
    fn missing_deck_input() {
        let path = scratch("inputs");
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
            ..DeckInputs::default()
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
