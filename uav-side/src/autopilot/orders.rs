//! An order that reaches the mission through the autopilot: repeated as the same command until the mission shows
//! that it has taken it, or the order expires.

use alight_shared::admission::Retransmission;
use alight_shared::msg::{Command, CommandKind, Header, MissionState};
use alight_shared::time::{DroneClock, Span};

use super::DroneTime;

/// A command is repeated at this period until the mission shows that it has received it ...
const REPEAT: Span = Span::from_millis(250);
/// ... for no longer than this.
const GIVEN_UP: Span = Span::from_millis(5000);

/// An order under way to the mission.
#[derive(Clone, Copy, Debug)]
pub(super) struct MavlinkOrder {
    command: Command,
    sending: Retransmission<DroneClock>,
}

/// Progress of an order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum OrderProgress {
    /// The mission has taken it.
    Taken,
    /// It rejects it, or has not taken it in 5 s.
    GivenUp,
    /// It is under way; what is to be published now.
    UnderWay(Option<Command>),
}

impl MavlinkOrder {
    /// Given at the time of `header`.
    pub(super) fn new(header: Header<DroneClock>, kind: CommandKind) -> MavlinkOrder {
        MavlinkOrder {
            command: Command { header, kind },
            sending: Retransmission::new(header.at, REPEAT, GIVEN_UP),
        }
    }
    /// Kind of the order.
    pub(super) fn kind(&self) -> CommandKind {
        self.command.kind
    }
    fn answered(&self, m: &MissionState) -> Option<bool> {
        let h = &self.command.header;
        m.echo()
            .answers(self.command.kind, |echo| echo == [h.boot, h.sequence])
    }
    /// By the mission's newest state.
    pub(super) fn poll(&mut self, now: DroneTime, mission: Option<&MissionState>) -> OrderProgress {
        match mission.and_then(|m| self.answered(m)) {
            Some(true) => OrderProgress::Taken,
            Some(false) => OrderProgress::GivenUp,
            None if self.sending.is_over(now) => OrderProgress::GivenUp,
            None => OrderProgress::UnderWay(self.sending.is_due(now).then_some(self.command)),
        }
    }
    /// Why it was given up, for people: the mission's reason in full where it rejects the order, as far as one STATUSTEXT holds it.
    pub(super) fn refusal(&self, mission: Option<&MissionState>) -> String {
        let (_, order) = named(self.command.kind);
        let Some(m) = mission else {
            return format!("{order} was not taken: no mission reports");
        };
        match m.rejected.filter(|_| self.answered(m).is_some()) {
            Some(why) => {
                let (_, name) = order.split_once(' ').unwrap_or(("", order));
                let why = why.to_string();
                // Some reasons name the order themselves.
                if why.starts_with("no ") {
                    why
                } else {
                    format!("no {name}: {why}")
                }
            }
            None => format!("{order} was not taken: {}", m.state.because(&m.waiting)),
        }
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
