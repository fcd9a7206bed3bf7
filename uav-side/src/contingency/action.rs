//! What a drone does in each step, by what is missing.

use alight_shared::msg::{AutopilotMode, AutopilotState, LandedState, MissionState, Phase, State};

use super::below::DeckBelow;

/// Below this clearance the landing goes on without mission or plan when a climb would end harder, m: the mission's commit
/// clearance.
pub(crate) const COMMIT_CLEARANCE_M: f64 = 0.8;
/// Without a message from the mission the last one counts so long, s, beyond its validity; then the autopilot's own failsafe
/// acts.
pub(crate) const GOES_ON_WITHOUT_MISSION_S: f64 = 3.0;

/// What a drone does in a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Action {
    /// Commands nothing: the autopilot's own failsafe acts.
    Nothing,
    /// Stands on the ground.
    Stand,
    /// Stays where it is.
    Hold,
    /// Stays where it is, and away from a deck that is near.
    Leave,
    /// Follows the plan.
    Follow,
    /// Completes the landing without a plan.
    Complete,
    /// Presses the feet onto the deck: a contact is suspected.
    Press,
}

/// What is known in a step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Known<'a> {
    /// The autopilot, armed.
    pub(crate) autopilot: Option<&'a AutopilotState>,
    /// The mission's state, or its last one while that counts.
    pub(crate) mission: Option<&'a MissionState>,
    /// The mission is silent: its last state counts.
    pub(crate) silent: bool,
    /// There is a plan that the mission wants.
    pub(crate) planned: bool,
    /// The deck.
    pub(crate) below: Option<&'a DeckBelow>,
    /// The drone holds, or leaves the deck, already.
    pub(crate) holds: bool,
    /// The pilot commands attitudes, so that it can stand and press.
    pub(crate) attitudes: bool,
    /// A contact is suspected.
    pub(crate) touches: bool,
}

impl Known<'_> {
    /// Alight commands the drone.
    pub(crate) fn commands(&self) -> bool {
        self.autopilot.is_some_and(|a| a.mode == AutopilotMode::Offboard)
    }
    /// The mission waits, on the ground or in the air.
    pub(crate) fn waits(&self) -> bool {
        self.mission.is_some_and(|m| m.state == State::Idle)
    }
    /// The landing is to end on the deck.
    pub(crate) fn lands(&self) -> bool {
        self.mission
            .is_some_and(|m| m.state.phase() == Phase::Landing && m.lowest_clearance_m.is_none())
    }

    /// What the drone does. `softer`: to complete the landing ends softer than to climb.
    pub(crate) fn action(&self, softer: impl Fn() -> bool) -> Action {
        let (Some(autopilot), Some(mission)) = (self.autopilot, self.mission) else {
            return Action::Nothing;
        };
        let close = self.below.is_some_and(|b| b.clearance < COMMIT_CLEARANCE_M);
        if self.waits() {
            let grounded = autopilot.landed == LandedState::OnGround;
            return if grounded && self.attitudes {
                Action::Stand
            } else {
                Action::Hold
            };
        }
        // A pilot before this one stopped the motors, and this one has to find the touchdown again.
        let landed = mission.state == State::Landed;
        if landed && !(close && self.commands()) {
            return Action::Nothing;
        }
        // A mission that fell silent in the descent would have gone on to the flare.
        let committed = close && (landed || mission.state == State::Flare || self.silent && self.lands());
        if self.silent && !(committed && (self.planned || softer())) {
            return Action::Leave;
        }
        if self.touches && (self.attitudes || landed) {
            return Action::Press;
        }
        if self.planned {
            return Action::Follow;
        }
        let completes = committed && !self.holds || self.lands() && softer();
        if completes && self.below.is_some() {
            Action::Complete
        } else {
            Action::Leave
        }
    }
}
