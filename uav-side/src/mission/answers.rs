//! Answers to orders, with the reason if the mission does not carry an order out.

use alight_shared::msg::{CommandKind, Phase, Reason, ReasonCode};

use super::{
    phase::{Decision, MissionPhase, MissionProgress},
    situation::{ControlState, Situation},
};

/// Reason why the decision does not carry out an order given in `phase` with the progress `before`; None if it does, or
/// if the order is already fulfilled.
pub(super) fn not_done(
    order: CommandKind,
    phase: MissionPhase,
    before: &MissionProgress,
    d: &Decision,
    s: &Situation,
) -> Option<Reason> {
    let because = |code: ReasonCode| Some(code.into());
    let anothers = match s.flight {
        ControlState::OtherControl(_) | ControlState::SetPointsLost | ControlState::Unknown => true,
        ControlState::Disarmed | ControlState::OnGround | ControlState::Ours => false,
    };
    match order {
        // Afterwards no landing is ordered, even if none was before.
        CommandKind::Abort => None,
        // While another authority flies the drone, only a waiting order can be stopped.
        CommandKind::Hold => {
            let nothing = d.phase == MissionPhase::Idle && anothers && !before.landing;
            nothing.then(|| ReasonCode::NotInControl.into())
        }
        CommandKind::Land => {
            let completes = before.stopped && d.phase.state().phase() == Phase::Landing;
            let landed = phase.flies() && matches!(d.phase, MissionPhase::Landed { .. });
            if d.progress.landing || completes || landed {
                None
            } else if matches!(phase, MissionPhase::Landed { .. }) {
                because(ReasonCode::OnDeck)
            } else if phase.stands() || phase.takes_off() {
                because(ReasonCode::DuringTakeOff)
            } else {
                s.held_back().or(because(ReasonCode::NotInControl))
            }
        }
        CommandKind::TakeOff if d.phase.state().is_take_off() => None,
        CommandKind::TakeOff => d.entered.or(match phase {
            MissionPhase::Landed { .. } | MissionPhase::StandDown { .. } => because(ReasonCode::StillArmed),
            MissionPhase::Idle
            | MissionPhase::GetAltitude { .. }
            | MissionPhase::Approach { .. }
            | MissionPhase::Search(_)
            | MissionPhase::Seek
            | MissionPhase::Tracking { .. }
            | MissionPhase::TrackingStable
            | MissionPhase::Descent { .. }
            | MissionPhase::Flare { .. }
            | MissionPhase::Hold { .. }
            | MissionPhase::GaveUp { .. }
            | MissionPhase::Preparing
            | MissionPhase::Countdown { .. }
            | MissionPhase::SpinUp { .. }
            | MissionPhase::TakeOff { .. }
            | MissionPhase::ClimbOut { .. } => because(ReasonCode::NotOnDeck),
        }),
        CommandKind::Station(_) => (d.phase.station().is_none()).then(|| ReasonCode::StationNotNow.into()),
        CommandKind::Ready => (!d.progress.cycles.ready).then(|| ReasonCode::NotOnDeck.into()),
    }
}
