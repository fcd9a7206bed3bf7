//! Monitor of the drones that the vessel receives, for display to the crew.

use std::collections::BTreeMap;

use alight_shared::{
    admission::{Arrival, check_message},
    msg::DroneStatus,
    time::{VesselClock, VesselTime},
};
use nalgebra::Vector2;

use super::MAX_DRONES;

/// Validity of a mean wind, s.
const MAX_WIND_AGE_S: f64 = 600.0;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct News {
    pub(crate) state: bool,
    /// Time since landing, s, in the first status that reports a drone still armed past its disarm.
    pub(crate) still_armed: Option<f32>,
}

#[derive(Clone, Debug)]
pub struct DroneMonitor {
    vessel: u32,
    drones: BTreeMap<u32, Arrival<VesselClock, DroneStatus>>,
    newest: Option<u32>,
    received: u64,
    rejected: u64,
}

impl DroneMonitor {
    pub fn new(vessel: u32) -> DroneMonitor {
        DroneMonitor {
            vessel,
            drones: BTreeMap::new(),
            newest: None,
            received: 0,
            rejected: 0,
        }
    }
    /// Adds a status and returns changes for the crew.
    pub(crate) fn observe(&mut self, status: &Arrival<VesselClock, DroneStatus>) -> News {
        let new = &status.message;
        let header = &new.header;
        let before = self.drones.get(&header.drone).map(|s| &s.message);
        let repeated = before.is_some_and(|s| !header.follows(&s.header));
        let full = before.is_none() && self.drones.len() >= MAX_DRONES;
        if check_message(new).is_err() || header.vessel != self.vessel || repeated || full {
            self.rejected += 1;
            return News::default();
        }
        let news = News {
            state: before.is_none_or(|s| s.state != new.state),
            still_armed: new
                .still_armed_s
                .filter(|_| before.is_none_or(|s| s.still_armed_s.is_none())),
        };
        self.received += 1;
        self.newest = Some(header.drone);
        self.drones.insert(header.drone, *status);
        news
    }
    pub fn statuses(&self) -> impl Iterator<Item = &Arrival<VesselClock, DroneStatus>> {
        self.drones.values()
    }
    pub fn newest(&self) -> Option<&Arrival<VesselClock, DroneStatus>> {
        self.drones.get(&self.newest?)
    }
    /// True wind towards NED, m/s, from the newest status that has one and is no older than [`MAX_WIND_AGE_S`].
    pub fn wind(&self, now: VesselTime) -> Option<Vector2<f64>> {
        let recent = |s: &&Arrival<VesselClock, DroneStatus>| (now - s.at).secs() <= MAX_WIND_AGE_S;
        let known = self
            .statuses()
            .filter(recent)
            .filter(|s| s.message.wind.is_some());
        let [north, east] = known.max_by_key(|s| s.at)?.message.wind?.map(f64::from);
        Some(Vector2::new(north, east))
    }
    pub fn received(&self) -> u64 {
        self.received
    }
    /// Number of rejected statuses: of another vessel or version, damaged, repeated, or of a surplus drone.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{
        admission::Sender,
        msg::{Header, State, message_version},
        time::Time,
    };

    fn status(vessel: u32, drone: u32, sequence: u32, state: State) -> Arrival<VesselClock, DroneStatus> {
        let message = DroneStatus {
            header: Header::new(vessel, drone, 7, sequence, Time::EPOCH),
            state,
            battery: Some(0.5),
            ..DroneStatus::default()
        };
        Arrival {
            at: Time::from_secs(f64::from(sequence)),
            sender: Sender::Drone(drone),
            message,
        }
    }

    #[test]
    fn drone_monitor_states() {
        let mut monitor = DroneMonitor::new(1);
        assert!(monitor.observe(&status(1, 4, 1, State::Tracking)).state);
        assert!(!monitor.observe(&status(1, 4, 2, State::Tracking)).state);
        let mut nan = status(1, 4, 3, State::Landed);
        nan.message.battery = Some(f64::NAN);
        let mut version = status(1, 4, 3, State::Landed);
        version.message.header.version = message_version() ^ 1;
        let foreign = status(2, 4, 3, State::Landed);
        let repeated = status(1, 4, 2, State::Landed);
        for bad in [foreign, repeated, nan, version] {
            assert!(!monitor.observe(&bad).state);
        }
        // A status of another drone in between does not count as a change of state.
        assert!(monitor.observe(&status(1, 5, 1, State::Idle)).state);
        assert!(!monitor.observe(&status(1, 4, 3, State::Tracking)).state);
        assert!(monitor.observe(&status(1, 4, 4, State::Landed)).state);
        assert_eq!((monitor.received(), monitor.rejected()), (5, 4));
        let armed = |sequence, still_armed_s| {
            let mut armed = status(1, 4, sequence, State::Landed);
            armed.message.still_armed_s = still_armed_s;
            armed
        };
        let reported = [(5, Some(3.0)), (6, Some(3.5)), (7, None), (8, Some(3.0))]
            .map(|(k, s)| monitor.observe(&armed(k, s)).still_armed);
        assert_eq!(reported, [Some(3.0), None, None, Some(3.0)]);
        assert_eq!(monitor.newest().map(|s| s.message.header.sequence), Some(8));
        let newest = monitor.newest().map(|s| (s.at, s.message.header.drone));
        assert_eq!(newest, Some((Time::from_secs(8.0), 4)));
        assert_eq!(monitor.statuses().count(), 2);
    }
}
