//! Action of the drone in each step, as a function of the missing inputs.

use alight_shared::msg::{AutopilotMode, AutopilotState, LandedState, MissionState, Phase, State};

use super::below::DeckBelow;

/// Time for which the last mission message is used beyond its validity, s; then the failsafe acts.
pub(crate) const GOES_ON_WITHOUT_MISSION_S: f64 = 3.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ContingencyAction {
    /// No command: the autopilot's own failsafe acts.
    Nothing,
    RemainOnDeck,
    Hold,
    /// Hold the position, and move away from the deck if it is near.
    Leave,
    Follow,
    Complete,
    /// Press the feet onto the deck after a suspected contact.
    Press,
    /// Stand on the deck for a take-off, armed or not: PX4 needs a stream of set-points before it enters OFFBOARD.
    Idle,
    Jump,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct ContingencyInput<'a> {
    pub(crate) autopilot: Option<&'a AutopilotState>,
    pub(crate) mission: Option<&'a MissionState>,
    /// Whether the mission is silent, so that its last state is in use.
    pub(crate) silent: bool,
    /// Whether a plan that suits the mission is available.
    pub(crate) planned: bool,
    pub(crate) below: Option<&'a DeckBelow>,
    /// Whether the drone is already holding or leaving the deck.
    pub(crate) holds: bool,
    /// Whether the pilot node commands attitudes, which standing and pressing require.
    pub(crate) attitudes: bool,
    pub(crate) touches: bool,
    /// Whether the drone is as low as when it was disarmed, or the rangefinder shows its feet on the ground. This is a
    /// second witness in addition to the autopilot's ground report.
    pub(crate) low: bool,
}

impl ContingencyInput<'_> {
    pub(crate) fn commands(&self) -> bool {
        self.autopilot.is_some_and(|a| a.mode == AutopilotMode::Offboard)
    }
    /// Whether the mission is idle, on the ground or in the air.
    pub(crate) fn waits(&self) -> bool {
        self.mission.is_some_and(|m| m.state == State::Idle)
    }
    /// Whether the mission intends to end the landing on the deck.
    pub(crate) fn lands(&self) -> bool {
        self.mission
            .is_some_and(|m| m.state.phase() == Phase::Landing && m.lowest_clearance_m.is_none())
    }

    /// `softer`: whether completing the landing hits the deck more softly than climbing.
    pub(crate) fn action(&self, softer: impl Fn() -> bool) -> ContingencyAction {
        if let Some(state) = self.mission.map(|m| m.state)
            && (state.stands_for_take_off() || state == State::TakeOff)
        {
            // If the mission falls silent, the drone stays on the deck, because without set-points the autopilot may
            // lift it.
            let stands = matches!(state, State::SpinUp | State::StandDown);
            let jumps = state == State::TakeOff && self.autopilot.is_some();
            return if stands && self.attitudes {
                ContingencyAction::Idle
            } else if jumps && self.attitudes {
                ContingencyAction::Jump
            } else {
                ContingencyAction::Nothing
            };
        }
        let (Some(autopilot), Some(mission)) = (self.autopilot, self.mission) else {
            return ContingencyAction::Nothing;
        };
        // Without mission or plan the landing continues if a climb would hit the deck harder.
        let close = self
            .below
            .is_some_and(|b| b.clearance < mission.commit_clearance_m);
        if self.waits() {
            // The autopilot's report may be wrong, so it does not cut the thrust on its own.
            let grounded = autopilot.landed == LandedState::OnGround && self.low;
            return if grounded && self.attitudes {
                ContingencyAction::RemainOnDeck
            } else {
                ContingencyAction::Hold
            };
        }
        // A previous pilot node stopped the motors, and this one must detect the touchdown again.
        let landed = mission.state == State::Landed;
        if landed && !(close && self.commands()) {
            return ContingencyAction::Nothing;
        }
        // A mission that fell silent in the descent would have continued with the flare.
        let committed = close && (landed || mission.state == State::Flare || self.silent && self.lands());
        if self.silent && !(committed && (self.planned || softer())) {
            return ContingencyAction::Leave;
        }
        if self.touches && (self.attitudes || landed) {
            return ContingencyAction::Press;
        }
        if self.planned {
            return ContingencyAction::Follow;
        }
        let completes = committed && !self.holds || self.lands() && softer();
        if completes && self.below.is_some() {
            ContingencyAction::Complete
        } else {
            ContingencyAction::Leave
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{super::below::Body, *};
    use crate::fixtures::{airborne, forecast, header, level, mission};
    use alight_shared::{geometry::DroneGeometry, time::Time};
    use nalgebra::{UnitQuaternion, Vector3};

    /// Action with or without a plan and a fresh mission message, at this clearance (m).
    fn action(
        state: State,
        planned: bool,
        silent: bool,
        clearance: f64,
        softer: bool,
        holds: bool,
    ) -> ContingencyAction {
        let header = header(1, Time::from_secs(10.0));
        let drone = DroneGeometry::default();
        let f = forecast(header, |_| level([0.0, 0.0, -1.3]));
        let body = Body {
            position: Vector3::new(0.0, 0.0, -1.3 - drone.feet_below_m - clearance),
            velocity: Vector3::zeros(),
            attitude: UnitQuaternion::identity(),
        };
        let autopilot = airborne(header);
        let mission = mission(header, state, 0.5);
        let below = DeckBelow::of(header.at, &f, &body, &drone);
        let known = ContingencyInput {
            autopilot: Some(&autopilot),
            mission: Some(&mission),
            silent,
            planned,
            below: below.as_ref(),
            holds,
            attitudes: true,
            touches: false,
            low: false,
        };
        known.action(|| softer)
    }

    #[test]
    fn action_by_what_is_missing() {
        use ContingencyAction::{Complete, Follow, Leave};
        use State::{Descent, Flare, Tracking};
        for (state, planned, silent, clearance, softer, expected) in [
            (Descent, true, false, 5.0, false, Follow),
            // Without a plan a flare continues, but a descent continues only if that is softer.
            (Flare, false, false, 0.4, false, Complete),
            (Flare, false, false, 5.0, false, Leave),
            (Descent, false, false, 0.4, false, Leave),
            (Descent, false, false, 0.4, true, Complete),
            (Tracking, false, false, 0.4, true, Leave),
            // Without a mission, a drone that is low in a landing follows the plan or takes the softer action.
            (Descent, true, true, 0.4, false, Follow),
            (Descent, true, true, 5.0, true, Leave),
            (Tracking, true, true, 0.4, true, Leave),
            (Descent, false, true, 0.4, false, Leave),
            (Descent, false, true, 0.4, true, Complete),
            (Flare, false, true, 0.4, false, Leave),
        ] {
            let found = action(state, planned, silent, clearance, softer, false);
            let what = format!("{state:?}, plan {planned}, silent {silent}, {clearance} m, softer {softer}");
            assert_eq!(found, expected, "{what}");
        }
        // A deck that comes near does not make a climbing drone land.
        assert_eq!(action(Flare, false, false, 0.4, false, true), Leave);
    }

    /// An idle drone accepts the autopilot's ground report only if another witness shows that it is low.
    #[test]
    fn idle_drone_reported_on_the_ground() {
        let header = header(1, Time::from_secs(10.0));
        let mission = mission(header, State::Idle, 0.0);
        for (landed, low, expected) in [
            (LandedState::OnGround, true, ContingencyAction::RemainOnDeck),
            (LandedState::OnGround, false, ContingencyAction::Hold),
            (LandedState::Unknown, true, ContingencyAction::Hold),
            (LandedState::InAir, true, ContingencyAction::Hold),
        ] {
            let autopilot = AutopilotState {
                landed,
                ..airborne(header)
            };
            let known = ContingencyInput {
                autopilot: Some(&autopilot),
                mission: Some(&mission),
                silent: false,
                planned: false,
                below: None,
                holds: false,
                attitudes: true,
                touches: false,
                low,
            };
            assert_eq!(known.action(|| false), expected, "{landed:?}, low: {low}");
        }
    }
}
