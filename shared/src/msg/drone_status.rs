//! Status of a drone for its vessel, assembled from the newest reports of the drone's processes.

use nalgebra::Vector2;

use super::{AutopilotState, DroneStatus, Header, LandedState, MissionState, State};
use crate::{
    time::{DroneClock, DroneTime},
    topics,
};

impl DroneStatus {
    /// Status at the time of `header` from the newest states of mission and autopilot. If the autopilot's
    /// report is older than its topic allows, its state is unknown, and the motors of a landed drone count as
    /// armed ([`DroneStatus::still_armed_s`]).
    pub fn of(
        header: Header<DroneClock>,
        mission: &MissionState,
        autopilot: Option<&AutopilotState>,
        from_deck_m: Option<Vector2<f64>>,
    ) -> DroneStatus {
        let lasts = |a: &&AutopilotState| header.at - a.header.at <= topics::AUTOPILOT.stale_after;
        let autopilot = autopilot.filter(lasts);
        DroneStatus {
            header,
            state: mission.state,
            entered: mission.entered,
            waiting: mission.waiting,
            rejected: mission.rejected,
            attempts: mission.attempts,
            // A stuck gauge shows more charge than is left.
            battery: (autopilot.and_then(|a| a.battery))
                .map(|b| mission.battery.map_or(b, |counts| b.min(counts))),
            landed: autopilot.map_or(LandedState::Unknown, |a| a.landed),
            deck_distance_m: from_deck_m.map(|at| at.norm() as f32),
            bearing: from_deck_m.map(|at| at.y.atan2(at.x) as f32),
            abort: mission.abort,
            order: mission.order,
            armed: autopilot.is_some_and(|a| a.armed),
            still_armed_s: None,
            mission_age_s: (header.at - mission.header.at).secs().max(0.0) as f32,
            wind: None,
            gust_mps: None,
            station: mission.station.map(|kept| kept.station),
        }
    }
    /// Condition that the mission waits for, with a station's position.
    pub fn waits(&self) -> String {
        let waits = self.waiting.to_string();
        match self.station {
            Some(station) => waits.replacen("its station", &format!("its station {station}"), 1),
            None => waits,
        }
    }
    /// Whether the mission's state is current. An outdated one does not describe the drone's actions, but
    /// the status still shows its position.
    pub fn is_current(&self) -> bool {
        f64::from(self.mission_age_s) <= topics::DRONE_STATUS.stale_after.secs()
    }
}

/// Duration of a disarm after a stopped take-off, s: covers heartbeats, decay of the thrust, and several commands.
const STANDS_DOWN_S: f64 = 5.0;

/// Time since the landing or the stopped take-off, s, if the drone has been armed on the deck for longer than
/// a disarm takes (`disarm_s`); otherwise None. Causes: denied commands, unmet conditions, `disarm.on_deck`
/// is off. A mission leaves `Landed` when the drone is armed again after a disarm.
pub fn still_armed_s(now: DroneTime, mission: &MissionState, armed: bool, disarm_s: f64) -> Option<f64> {
    let stands_s = (now - mission.since).secs();
    let landed = mission.state == State::Landed && stands_s > disarm_s;
    let stopped = mission.state == State::StandDown && stands_s > STANDS_DOWN_S;
    (armed && (landed || stopped)).then_some(stands_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Time;

    #[test]
    fn ages_of_a_status_to_the_vessel() {
        let header = |at_s: f64| Header::new(1, 2, 7, 1, Time::from_secs(at_s));
        let mission = MissionState {
            header: header(10.0),
            state: State::Descent,
            ..MissionState::default()
        };
        let autopilot = AutopilotState {
            header: header(10.0),
            armed: true,
            landed: LandedState::InAir,
            battery: Some(0.57),
            ..AutopilotState::default()
        };
        let west = Vector2::new(0.0, -1.0);
        let sent = |at_s| DroneStatus::of(header(at_s), &mission, Some(&autopilot), Some(west));
        let fresh = sent(10.1);
        assert!(fresh.is_current() && fresh.armed && fresh.landed == LandedState::InAir);
        assert_eq!((fresh.state, fresh.battery), (State::Descent, Some(0.57)));
        let old = sent(20.0);
        assert!(!old.is_current() && !old.armed);
        assert!((old.mission_age_s - 10.0).abs() < 1e-6);
        assert_eq!((old.landed, old.battery), (LandedState::Unknown, None));
        assert_eq!(old.deck_distance_m, Some(1.0), "from_deck_m checks its age");
        assert_eq!(old.bearing.map(f32::to_degrees), Some(-90.0));
        let unlinked = DroneStatus::of(header(10.1), &mission, None, None);
        assert!(unlinked.is_current() && unlinked.battery.is_none());
    }
}
