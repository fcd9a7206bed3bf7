//! Boot of the computer that the drones follow, from the newest estimate named by each time request. If that
//! remains another boot, a second computer publishes with this vessel's identity.

use std::collections::BTreeMap;

use alight_shared::{
    admission::{Arrival, Sender},
    msg::{FollowsAnother, TimeRequest},
    time::{DroneClock, Span, VesselClock, VesselTime},
};

use crate::deck::MAX_DRONES;

/// Time for which a drone may follow this computer's former boot: ten times its wait before accepting a restart.
const RESTART_TIMEOUT: Span = Span::from_millis(5000);
/// Age up to which a request counts; a drone sends two per second.
const FRESH: Span = Span::from_millis(3000);

#[derive(Clone, Copy, Debug)]
struct Following {
    boot: u32,
    since: VesselTime,
    newest: VesselTime,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Followed {
    drones: BTreeMap<u32, Following>,
}

impl Followed {
    /// Adds the time requests received by vessel `vessel`.
    pub(crate) fn observe(
        &mut self,
        vessel: u32,
        requests: &[Arrival<VesselClock, TimeRequest<DroneClock>>],
    ) {
        for request in requests {
            let h = &request.message.header;
            let room = self.drones.len() < MAX_DRONES || self.drones.contains_key(&h.drone);
            if request.sender != Sender::Drone(h.drone) || h.vessel != vessel || !room {
                continue;
            }
            let boot = request.message.newest_boot;
            let before = self.drones.get(&h.drone);
            let same = before.filter(|f| f.boot == boot && request.at - f.newest <= FRESH);
            let since = same.map_or(request.at, |f| f.since);
            let newest = request.at;
            self.drones.insert(h.drone, Following { boot, since, newest });
        }
    }
    /// First drone that follows a computer other than the one with boot `boot`.
    pub(crate) fn another(&self, now: VesselTime, boot: u32) -> Option<FollowsAnother> {
        let follows = |f: &Following| {
            // Boot 0: no estimate received.
            f.boot != 0 && f.boot != boot && now - f.newest <= FRESH && f.newest - f.since >= RESTART_TIMEOUT
        };
        let another = self.drones.iter().find(|(_, f)| follows(f));
        another.map(|(drone, f)| FollowsAnother {
            drone: *drone,
            boot: f.boot,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{msg::Header, time::Time};

    #[test]
    fn drone_that_follows_a_second_computer() {
        let mut followed = Followed::default();
        let mut asks = |t_s: f64, drone: u32, newest_boot: u32| {
            let at = Time::from_secs(t_s);
            let message = TimeRequest {
                header: Header::new(1, drone, 7, 0, Time::EPOCH),
                newest_at: Time::EPOCH,
                newest_boot,
            };
            let sender = Sender::Drone(drone);
            followed.observe(1, &[Arrival { at, sender, message }]);
            followed.another(at, 9).map(|f| (f.drone, f.boot))
        };
        // After a restart, the drone's requests still name the former boot for a short time.
        assert!((0..6).all(|k| asks(0.5 * f64::from(k), 3, 8).is_none()));
        assert!((6..40).all(|k| asks(0.5 * f64::from(k), 3, 9).is_none()));
        assert!((6..40).all(|k| asks(0.5 * f64::from(k), 4, 0).is_none()));
        let found = (40..60).find(|k| asks(0.5 * f64::from(*k), 4, 5) == Some((4, 5)));
        assert!(found.is_some_and(|k| (50..=51).contains(&k)), "{found:?}");
        assert_eq!(asks(40.0, 3, 9), None);
    }
}
