//! The firmware's own mission (PX4 Mission, ArduCopter AUTO): waypoints visited in order.
//!
//! After the last waypoint PX4 enters Hold and reports a complete mission until the next start. ArduCopter
//! hovers at that waypoint in AUTO, and restarts the mission after a disarm.

use alight_shared::mavlink::dialect::{MISSION_CURRENT_DATA, MissionState};
use alight_uav::autopilot::modes::Firmware;
use nalgebra::Vector3;

const SPEED_MPS: f64 = 5.0;
const REACHED_M: f64 = 2.0;

#[derive(Clone, Debug, Default)]
pub(super) struct OwnFlight {
    /// Waypoints in the autopilot's NED, m.
    items: Vec<Vector3<f64>>,
    next: usize,
    /// Newest waypoint that was reached but not yet reported.
    reached: Option<u16>,
}

impl OwnFlight {
    pub(super) fn upload(&mut self, items: Vec<Vector3<f64>>) {
        *self = OwnFlight {
            items,
            ..OwnFlight::default()
        };
    }
    pub(super) fn is_empty(&self) -> bool {
        self.items.is_empty()
    }
    pub(super) fn begin_again(&mut self) {
        self.next = 0;
    }
    pub(super) fn is_complete(&self) -> bool {
        !self.items.is_empty() && self.next >= self.items.len()
    }
    /// Moves `hold` towards the next waypoint, with the drone at `position`; returns the velocity of `hold`.
    pub(super) fn fly(
        &mut self,
        firmware: Firmware,
        hold: &mut Vector3<f64>,
        position: &Vector3<f64>,
        dt: f64,
    ) -> Vector3<f64> {
        let Some(to) = self.items.get(self.next) else {
            return Vector3::zeros();
        };
        let away = to - *hold;
        let step = SPEED_MPS * dt;
        let velocity = away
            .try_normalize(step)
            .map_or(Vector3::zeros(), |d| d * SPEED_MPS);
        *hold = if away.norm() <= step {
            *to
        } else {
            *hold + velocity * dt
        };
        if (to - position).norm() < REACHED_M {
            // ArduCopter's first item is home.
            let number = self.next + usize::from(firmware == Firmware::ArduCopter);
            self.reached = u16::try_from(number).ok();
            self.next += 1;
        }
        velocity
    }
    pub(super) fn reached(&mut self) -> Option<u16> {
        self.reached.take()
    }
    /// `flies` is true while the mission's mode is active.
    pub(super) fn report(&self, flies: bool) -> MISSION_CURRENT_DATA {
        let total = match self.items.len() {
            0 => u16::MAX,
            n => u16::try_from(n).unwrap_or(u16::MAX),
        };
        let mission_state = match (self.is_complete(), flies, self.next) {
            _ if self.items.is_empty() => MissionState::MISSION_STATE_NO_MISSION,
            (true, _, _) => MissionState::MISSION_STATE_COMPLETE,
            (false, true, _) => MissionState::MISSION_STATE_ACTIVE,
            (false, false, 0) => MissionState::MISSION_STATE_NOT_STARTED,
            (false, false, _) => MissionState::MISSION_STATE_PAUSED,
        };
        MISSION_CURRENT_DATA {
            total,
            mission_state,
            ..MISSION_CURRENT_DATA::DEFAULT
        }
    }
}
