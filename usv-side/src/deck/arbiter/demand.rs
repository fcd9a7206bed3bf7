//! What the drones want of the vessel's helm.

use alight_shared::time::{Time, VesselClock};

use super::{Claim, DeckArbiter, Drone};
use crate::demand::Demand;

impl DeckArbiter {
    /// The most that a drone wants of the helm. One on its way down wants it for as long as a descent lasts, heard or not.
    pub fn demand(&self, now: Time<VesselClock>) -> Demand {
        let timeout_s = self.config.status_timeout_s;
        let wants = |d: &Drone| match d.claim {
            Claim::Landing if (now - d.received).secs() <= timeout_s => Demand::Descends,
            Claim::OnDeck if d.armed && d.is_fresh(now) => Demand::Armed,
            Claim::OnDeck => Demand::Stands,
            Claim::Requesting | Claim::Above if d.is_fresh(now) && d.flies => Demand::Comes,
            Claim::Away | Claim::Requesting | Claim::Above | Claim::Landing => Demand::Nothing,
        };
        let most = self.drones.iter().map(wants).max_by_key(|d| *d as u8);
        most.unwrap_or_default()
    }
    /// The helm states by order or switch that the vessel turns or may turn.
    pub fn is_turning(&self, now: Time<VesselClock>) -> bool {
        self.course.is_turning(now, &self.config)
    }
}
