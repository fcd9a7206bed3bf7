//! The drone as the vessel receives it, for the deck's operator.

use alight_shared::msg::{DroneStatus, MESSAGE_VERSION, Message, State};

/// The newest status of the drone.
pub struct DroneMonitor {
    vessel: u32,
    newest: Option<(i64, DroneStatus)>,
    received: u64,
    rejected: u64,
}

impl DroneMonitor {
    /// Nothing received yet by vessel `vessel`.
    pub fn new(vessel: u32) -> DroneMonitor {
        DroneMonitor {
            vessel,
            newest: None,
            received: 0,
            rejected: 0,
        }
    }
    /// A message arrived that is no status.
    pub fn reject(&mut self) {
        self.rejected += 1;
    }
    /// A status arrived at `at_ns` of the steady clock; a line for the operator when the mission's state
    /// changed.
    pub fn receive(&mut self, at_ns: i64, status: &DroneStatus) -> Option<String> {
        let header = &status.header;
        let before = self.newest.as_ref().map(|(_, w)| w);
        let repeated = before.is_some_and(|w| {
            w.header.drone == header.drone
                && w.header.boot == header.boot
                && w.header.sequence >= header.sequence
        });
        if header.version != MESSAGE_VERSION
            || header.vessel != self.vessel
            || status.check().is_err()
            || repeated
        {
            self.rejected += 1;
            return None;
        }
        let changed = before.is_none_or(|w| (w.header.drone, w.state) != (header.drone, status.state));
        self.received += 1;
        self.newest = Some((at_ns, *status));
        changed.then(|| {
            format!(
                "drone {}: {}: {} (battery {:.0} %)",
                header.drone,
                status.state.name(),
                status.entered,
                100.0 * status.battery
            )
        })
    }
    /// Statuses received and rejected; of the newest: age (s), state, descents begun, battery.
    pub fn figures(&self, now_ns: i64) -> [f64; 6] {
        let newest = self.newest.as_ref();
        let of = |f: fn(&DroneStatus) -> f64| newest.map_or(f64::NAN, |(_, w)| f(w));
        [
            self.received as f64,
            self.rejected as f64,
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

    fn status(vessel: u32, sequence: u32, state: State) -> DroneStatus {
        DroneStatus {
            header: Header::new(vessel, 4, 7, sequence, Time::EPOCH),
            state,
            battery: 0.5,
            ..DroneStatus::default()
        }
    }

    #[test]
    fn drone_monitor_reports_each_state_once_and_counts_rejected_statuses() {
        let mut received = DroneMonitor::new(1);
        let line = received.receive(0, &status(1, 1, State::Tracking)).unwrap();
        assert!(
            line.starts_with("drone 4: Tracking") && line.contains("50 %"),
            "{line}"
        );
        assert_eq!(received.receive(0, &status(1, 2, State::Tracking)), None);
        let nan = DroneStatus {
            battery: f64::NAN,
            ..status(1, 3, State::Landed)
        };
        let version = DroneStatus {
            header: Header {
                version: MESSAGE_VERSION + 1,
                ..status(1, 3, State::Landed).header
            },
            ..status(1, 3, State::Landed)
        };
        for bad in [
            status(2, 3, State::Landed),
            status(1, 2, State::Landed),
            nan,
            version,
        ] {
            assert_eq!(received.receive(0, &bad), None);
        }
        assert!(
            received
                .receive(1_000_000_000, &status(1, 3, State::Landed))
                .is_some()
        );
        let [received, rejected, age_s, number, _, battery] = received.figures(3_000_000_000);
        assert_eq!((received, rejected, age_s, battery), (3.0, 4.0, 2.0, 0.5));
        assert_eq!(state(number), Some(State::Landed));
    }
}
