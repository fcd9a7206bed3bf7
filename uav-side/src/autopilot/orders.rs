//! Order to the mission, repeated until the mission accepts or rejects it or it expires.

use alight_shared::{
    admission::Retransmission,
    msg::{Command, CommandKind, Header, MissionState},
    time::DroneClock,
    topics,
};

use super::DroneTime;

pub(super) type SentCommand = Retransmission<DroneClock, Command>;

pub(super) fn sent(header: Header<DroneClock>, kind: CommandKind) -> SentCommand {
    Retransmission::new(Command { header, kind }, header.at, topics::AUTOPILOT_RETRIES)
}

/// Whether the mission has accepted the order: false after a rejection or the time limit, None while pending.
pub(super) fn outcome(order: &SentCommand, now: DroneTime, mission: Option<&MissionState>) -> Option<bool> {
    let answer = mission.and_then(|m| order.answered(m));
    answer.or(order.is_over(now).then_some(false))
}

/// Text to operators on a failed order, with the mission's reason, truncated to one STATUSTEXT.
pub(super) fn rejection_text(order: &SentCommand, mission: Option<&MissionState>) -> String {
    let (_, named) = named(order.message.kind);
    let Some(m) = mission else {
        return format!("{named} was ignored: no mission reports");
    };
    match m.rejected.filter(|_| order.answered(m).is_some()) {
        Some(why) => {
            let (_, name) = named.split_once(' ').unwrap_or(("", named));
            let why = why.to_string();
            // Some reasons already name the order.
            if why.starts_with("no ") {
                why
            } else {
                format!("no {name}: {why}")
            }
        }
        None => format!("{named} was ignored: {}", m.state.because(&m.waiting)),
    }
}

/// Severity (`MAV_SEVERITY`) and name of an order in texts.
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
