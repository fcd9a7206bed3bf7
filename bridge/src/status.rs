//! Status of the drone for the vessel, assembled from reports of the drone's processes twice a second.

use alight_shared::{
    admission::Periodic,
    msg::{AutopilotState, DeckForecast, DroneState, DroneStatus, Header, MissionState, still_armed_s},
    time::{DroneClock, DroneTime, Span},
    topics,
};

use crate::config::BridgeConfig;

#[derive(Clone, Debug)]
pub(crate) struct StatusReport {
    pub(crate) disarm_s: f64,
    pub(crate) mission: Option<MissionState>,
    pub(crate) drone: Option<DroneState>,
    pub(crate) forecast: Option<DeckForecast>,
    pub(crate) autopilot: Option<AutopilotState>,
    next: Periodic<DroneClock>,
    sequence: u32,
}

impl Default for StatusReport {
    fn default() -> Self {
        StatusReport {
            disarm_s: f64::INFINITY,
            mission: None,
            drone: None,
            forecast: None,
            autopilot: None,
            next: Periodic::default(),
            sequence: 0,
        }
    }
}

impl StatusReport {
    /// Status when due; None before the mission publishes, because a placeholder would free the deck.
    pub(crate) fn step(&mut self, now: DroneTime, config: &BridgeConfig, boot: u32) -> Option<DroneStatus> {
        let mission = self.mission.as_ref()?;
        let period = Span::from_secs(1.0 / topics::DRONE_STATUS.rate_hz);
        if !self.next.is_due(now, period) {
            return None;
        }
        self.sequence = self.sequence.wrapping_add(1);
        let header = Header::new(config.vessel_id, config.drone_id, boot, self.sequence, now);
        let from_deck_m = DroneStatus::from_deck_m(now, self.drone.as_ref(), self.forecast.as_ref());
        let armed = self.autopilot.is_some_and(|a| a.armed);
        let still_armed_s = still_armed_s(now, mission, armed, self.disarm_s);
        Some(DroneStatus {
            still_armed_s: still_armed_s.map(|s| s as f32),
            wind: (self.drone.and_then(|d| d.wind)).map(|w| w.map(|v| v as f32)),
            gust_mps: (self.drone.and_then(|d| d.gust_mps)).map(|gust| gust as f32),
            ..DroneStatus::of(header, mission, self.autopilot.as_ref(), from_deck_m)
        })
    }
}
