//! An order that reaches the mission through the autopilot: repeated as the same command until the mission shows
//! that it has taken it, or the order expires.

use alight_shared::admission::Retransmission;
use alight_shared::msg::{Command, CommandKind, Header, MissionState};
use alight_shared::time::DroneClock;
use alight_shared::topics;

use super::DroneTime;

/// An order under way to the mission.
pub(super) type SentCommand = Retransmission<DroneClock, Command>;

/// An order, given at the time of `header`.
pub(super) fn sent(header: Header<DroneClock>, kind: CommandKind) -> SentCommand {
    Retransmission::new(Command { header, kind }, header.at, topics::AUTOPILOT_RETRIES)
}

/// By the mission's newest state, whether it has taken the order; it has not where it rejects it or too much time has passed.
/// None: the order is under way.
pub(super) fn outcome(order: &SentCommand, now: DroneTime, mission: Option<&MissionState>) -> Option<bool> {
    let answer = mission.and_then(|m| order.answered(m));
    answer.or(order.is_over(now).then_some(false))
}

/// Why it was given up, for people: the mission's reason in full where it rejects the order, as far as one STATUSTEXT holds it.
pub(super) fn refusal(order: &SentCommand, mission: Option<&MissionState>) -> String {
    let (_, named) = named(order.message.kind);
    let Some(m) = mission else {
        return format!("{named} was not taken: no mission reports");
    };
    match m.rejected.filter(|_| order.answered(m).is_some()) {
        Some(why) => {
            let (_, name) = named.split_once(' ').unwrap_or(("", named));
            let why = why.to_string();
            // Some reasons name the order themselves.
            if why.starts_with("no ") {
                why
            } else {
                format!("no {name}: {why}")
            }
        }
        None => format!("{named} was not taken: {}", m.state.because(&m.waiting)),
    }
}

/// Severity (`MAV_SEVERITY`) and name of an order, for people.
pub(super) fn named(kind: CommandKind) -> (u8, &'static str) {
    use super::message::severity;
    match kind {
        CommandKind::Abort => (severity::WARNING, "an abort"),
        CommandKind::Land => (severity::NOTICE, "a landing"),
        CommandKind::Hold => (severity::NOTICE, "a hold"),
        CommandKind::TakeOff => (severity::WARNING, "a take-off"),
        CommandKind::Ready => (severity::WARNING, "the next sortie"),
        CommandKind::Station(_) => (severity::NOTICE, "a station"),
    }
}
