//! The drone as the vessel receives it, for the deck's operator.

use alight_shared::admission::check_message;
use alight_shared::msg::DroneStatus;
use alight_shared::transport::metrics::{Metric, MetricName, MetricValue};

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
        let repeated = before.is_some_and(|w| w.header.drone == header.drone && !header.follows(&w.header));
        if check_message(status).is_err() || header.vessel != self.vessel || repeated {
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
    /// Messages received.
    pub fn received(&self) -> u64 {
        self.received
    }
    /// Messages received and rejected, and what the newest says.
    pub fn metrics(&self, now_ns: i64) -> Vec<Metric> {
        let mut metrics = vec![
            MetricName::DroneMessages.count(self.received),
            MetricName::DroneMessagesRejected.count(self.rejected),
        ];
        if let Some((at_ns, status)) = &self.newest {
            metrics.extend([
                MetricName::DroneMessageAge.seconds((now_ns - at_ns) as f64 * 1e-9),
                MetricName::DroneState.with(MetricValue::State(Some(status.state))),
                MetricName::DroneDescents.count(status.attempts),
                MetricName::DroneBattery.fraction(status.battery),
            ]);
        }
        metrics
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{Header, MESSAGE_VERSION, State};
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
        let expected = [
            MetricName::DroneMessages.count(3_u32),
            MetricName::DroneMessagesRejected.count(4_u32),
            MetricName::DroneMessageAge.seconds(2.0),
            MetricName::DroneState.with(MetricValue::State(Some(State::Landed))),
            MetricName::DroneDescents.count(0_u32),
            MetricName::DroneBattery.fraction(0.5),
        ];
        assert_eq!(received.metrics(3_000_000_000), expected);
    }
}
