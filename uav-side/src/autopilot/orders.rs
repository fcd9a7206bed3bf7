//! An order of somebody who reaches the mission through the autopilot: repeated as the same command until the mission shows
//! that it has taken it, or nobody waits any longer.

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
pub(super) struct Order {
    command: Command,
    sending: Retransmission<DroneClock>,
}

/// What became of an order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Progress {
    /// The mission has taken it.
    Taken,
    /// It rejects it, or has not taken it in 5 s.
    GivenUp,
    /// It is under way; what is to be published now.
    UnderWay(Option<Command>),
}

impl Order {
    /// Given at the time of `header`.
    pub(super) fn new(header: Header<DroneClock>, kind: CommandKind) -> Order {
        Order {
            command: Command { header, kind },
            sending: Retransmission::new(header.at, REPEAT, GIVEN_UP),
        }
    }
    /// What is ordered.
    pub(super) fn kind(&self) -> CommandKind {
        self.command.kind
    }
    /// Whether it is the newest that this state acknowledges.
    pub(super) fn is_acknowledged(&self, m: &MissionState) -> bool {
        m.order == Some([self.command.header.boot, self.command.header.sequence])
    }
    /// By the mission's newest state.
    pub(super) fn poll(&mut self, now: DroneTime, mission: Option<&MissionState>) -> Progress {
        let (h, kind) = (self.command.header, self.command.kind);
        let own = Some([h.boot, h.sequence]);
        let taken = |m: &MissionState| match kind {
            CommandKind::Abort => (m.abort == own).then_some(true),
            CommandKind::Hold | CommandKind::Ready | CommandKind::Station(_) => {
                self.is_acknowledged(m).then_some(m.rejected.is_none())
            }
            CommandKind::Land | CommandKind::TakeOff => {
                (m.header.at > h.at && kind.is_met(m.state, m.waiting.code)).then_some(true)
            }
        };
        match mission.and_then(taken) {
            Some(true) => Progress::Taken,
            Some(false) => Progress::GivenUp,
            None if self.sending.is_over(now) => Progress::GivenUp,
            None => Progress::UnderWay(self.sending.is_due(now).then_some(self.command)),
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
