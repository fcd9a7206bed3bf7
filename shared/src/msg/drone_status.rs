//! The status of a drone for its vessel, put together of what each process of the drone reported, by its own time.

use super::{AutopilotState, DroneStatus, Header, LandedState, MissionState, State};
use crate::time::{DroneClock, Time};
use crate::topics;

impl DroneStatus {
    /// The status that a drone sends at the time of `header`: of the mission's and the autopilot's newest state, each by
    /// its own time. What the autopilot reported longer ago than its topic allows is not known any more; the motors of
    /// a landed drone count as armed until it reports otherwise ([`DroneStatus::still_armed_s`]).
    pub fn of(
        header: Header<DroneClock>,
        mission: &MissionState,
        autopilot: Option<&AutopilotState>,
        deck_distance_m: Option<f32>,
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
            // A gauge that sticks shows more than counts.
            battery: (autopilot.and_then(|a| a.battery))
                .map(|b| mission.battery.map_or(b, |counts| b.min(counts))),
            landed: autopilot.map_or(LandedState::Unknown, |a| a.landed),
            deck_distance_m,
            abort: mission.abort,
            order: mission.order,
            armed: autopilot.is_some_and(|a| a.armed),
            still_armed_s: None,
            mission_age_s: (header.at - mission.header.at).secs().max(0.0) as f32,
            wind: None,
            station: mission.station.map(|kept| kept.station),
        }
    }
    /// Condition that the mission waits for, as text; a moment after an order that is not carried out, why.
    pub fn waits(&self) -> String {
        self.rejected.unwrap_or(self.waiting).to_string()
    }
    /// Whether it reports the mission's state as it was when this was sent. A status with an older one shows where the
    /// drone is, and as little of what it does as silence.
    pub fn is_current(&self) -> bool {
        f64::from(self.mission_age_s) <= topics::DRONE_STATUS.stale_after.secs()
    }
}

/// A drone whose take-off was stopped is disarmed by then, s: the heartbeats that show the arming, the thrust that has come
/// down, and some commands with their answers.
const STANDS_DOWN_S: f64 = 5.0;

/// Since the landing or since the take-off was stopped, s, of a drone that is on the deck and armed for longer than the disarm
/// takes (`disarm_s`): the commands were denied, what they need is missing, or `disarm.on_deck` is off. A mission leaves `Landed`
/// when the drone, disarmed in between, is armed again.
pub fn still_armed_s(
    now: Time<DroneClock>,
    mission: &MissionState,
    armed: bool,
    disarm_s: f64,
) -> Option<f64> {
    let stands_s = (now - mission.since).secs();
    let landed = mission.state == State::Landed && stands_s > disarm_s;
    let stopped = mission.state == State::StandDown && stands_s > STANDS_DOWN_S;
    (armed && (landed || stopped)).then_some(stands_s)
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let sent = |at_s| DroneStatus::of(header(at_s), &mission, Some(&autopilot), Some(1.0));
        let fresh = sent(10.1);
        assert!(fresh.is_current() && fresh.armed && fresh.landed == LandedState::InAir);
        assert_eq!((fresh.state, fresh.battery), (State::Descent, Some(0.57)));
        // Both are silent since: what was is not reported under a fresh time.
        let old = sent(20.0);
        assert!(!old.is_current() && !old.armed);
        assert!((old.mission_age_s - 10.0).abs() < 1e-6);
        assert_eq!((old.landed, old.battery), (LandedState::Unknown, None));
        assert_eq!(
            old.deck_distance_m,
            Some(1.0),
            "whose age its own function looks at"
        );
        let unlinked = DroneStatus::of(header(10.1), &mission, None, None);
        assert!(unlinked.is_current() && unlinked.battery.is_none());
    }
}
