//! What the vessel hears of its drone, for the deck's operator.

use alight_shared::msg::{DroneStatus, MESSAGE_VERSION, Message, State};

/// The newest word of the drone.
pub struct HeardDrone {
    vessel: u32,
    newest: Option<(i64, DroneStatus)>,
    heard: u64,
    refused: u64,
}

impl HeardDrone {
    /// Nothing heard yet by vessel `vessel`.
    pub fn new(vessel: u32) -> HeardDrone {
        HeardDrone {
            vessel,
            newest: None,
            heard: 0,
            refused: 0,
        }
    }
    /// Something came that is no such word.
    pub fn refuse(&mut self) {
        self.refused += 1;
    }
    /// A word came at `at_ns` of the steady clock; gives a line for the operator when the mission's
    /// state is another.
    pub fn hear(&mut self, at_ns: i64, word: &DroneStatus) -> Option<String> {
        let header = &word.header;
        let before = self.newest.as_ref().map(|(_, w)| w);
        let repeated = before.is_some_and(|w| {
            w.header.drone == header.drone
                && w.header.boot == header.boot
                && w.header.sequence >= header.sequence
        });
        if header.version != MESSAGE_VERSION
            || header.vessel != self.vessel
            || word.check().is_err()
            || repeated
        {
            self.refused += 1;
            return None;
        }
        let news = before.is_none_or(|w| (w.header.drone, w.state) != (header.drone, word.state));
        self.heard += 1;
        self.newest = Some((at_ns, *word));
        news.then(|| {
            format!(
                "drone {}: {}: {} (battery {:.0} %)",
                header.drone,
                word.state.name(),
                word.entered,
                100.0 * word.battery
            )
        })
    }
    /// Words heard and refused; of the newest: age (s), state, descents begun, battery.
    pub fn figures(&self, now_ns: i64) -> [f64; 6] {
        let newest = self.newest.as_ref();
        let of = |f: fn(&DroneStatus) -> f64| newest.map_or(f64::NAN, |(_, w)| f(w));
        [
            self.heard as f64,
            self.refused as f64,
            newest.map_or(f64::INFINITY, |(at, _)| (now_ns - at) as f64 * 1e-9),
            of(|w| f64::from(w.state as u8)),
            of(|w| f64::from(w.attempts)),
            of(|w| w.battery),
        ]
    }
}

/// The state of that number.
pub fn state(number: f64) -> Option<State> {
    [
        State::Idle,
        State::GetAltitude,
        State::Approach,
        State::Tracking,
        State::TrackingStable,
        State::Descent,
        State::Flare,
        State::Landed,
        State::Hold,
        State::GaveUp,
    ]
    .into_iter()
    .find(|s| f64::from(*s as u8) == number)
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::Header;
    use alight_shared::time::Time;

    fn word(vessel: u32, sequence: u32, state: State) -> DroneStatus {
        DroneStatus {
            header: Header::new(vessel, 4, 7, sequence, Time::EPOCH),
            state,
            battery: 0.5,
            ..DroneStatus::default()
        }
    }

    #[test]
    fn news_are_told_once_and_what_is_not_for_us_is_counted() {
        let mut heard = HeardDrone::new(1);
        let line = heard.hear(0, &word(1, 1, State::Tracking)).unwrap();
        assert!(
            line.starts_with("drone 4: Tracking") && line.contains("50 %"),
            "{line}"
        );
        assert_eq!(heard.hear(0, &word(1, 2, State::Tracking)), None);
        let nan = DroneStatus {
            battery: f64::NAN,
            ..word(1, 3, State::Landed)
        };
        let version = DroneStatus {
            header: Header {
                version: MESSAGE_VERSION + 1,
                ..word(1, 3, State::Landed).header
            },
            ..word(1, 3, State::Landed)
        };
        for bad in [word(2, 3, State::Landed), word(1, 2, State::Landed), nan, version] {
            assert_eq!(heard.hear(0, &bad), None);
        }
        assert!(heard.hear(1_000_000_000, &word(1, 3, State::Landed)).is_some());
        let [heard, refused, age_s, number, _, battery] = heard.figures(3_000_000_000);
        assert_eq!((heard, refused, age_s, battery), (3.0, 4.0, 2.0, 0.5));
        assert_eq!(state(number), Some(State::Landed));
    }
}
