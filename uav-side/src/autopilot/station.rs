//! Orders of a ground station: `COMMAND_LONG` to the companion, answered by `COMMAND_ACK`.
//!
//! `MAV_CMD_USER_1` lands, `MAV_CMD_USER_2` aborts, `MAV_CMD_USER_3` holds, all without parameters. An order is answered with
//! IN_PROGRESS at once, with ACCEPTED when the mission has taken it, and with TEMPORARILY_REJECTED, or FAILED where no mission
//! reports, when it has not in 5 s. It is admitted by the mission as any other; nothing precedes an abort. Whoever reaches the
//! autopilot's link may fly the drone without us, too: `signing_key` keeps others out of both.

use alight_shared::msg::{Command, CommandKind, Header, MissionState};
use alight_shared::time::DroneClock;

use super::DroneTime;
use super::message::{Address, CommandLong, CommandResult, Message, command, severity};
use super::orders::{Order, Progress, named};

/// What a number orders.
const fn ordered(number: u16) -> Option<CommandKind> {
    match number {
        command::USER_1 => Some(CommandKind::Land),
        command::USER_2 => Some(CommandKind::Abort),
        command::USER_3 => Some(CommandKind::Hold),
        _ => None,
    }
}

/// The order of a station under way.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StationOrders {
    given: Option<(Address, u16, Order)>,
}

/// What a command from a station leads to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Received {
    /// It is no order of ours, repeats the one that is under way, or comes after an abort.
    Answered(CommandResult),
    /// A new order.
    Order(CommandKind),
}

impl StationOrders {
    /// A command of `from` to the companion.
    pub(super) fn received(&self, from: Address, c: &CommandLong) -> Received {
        let Some(kind) = ordered(c.command) else {
            return Received::Answered(CommandResult::Unsupported);
        };
        match &self.given {
            // A station repeats what was not answered in time.
            Some((station, number, _)) if (*station, *number) == (from, c.command) => {
                Received::Answered(CommandResult::InProgress)
            }
            Some((.., order)) if order.kind() == CommandKind::Abort => {
                Received::Answered(CommandResult::TemporarilyRejected)
            }
            Some(_) | None => Received::Order(kind),
        }
    }
    /// Begins a new order; the number of the one that it takes the place of.
    pub(super) fn give(&mut self, from: Address, number: u16, header: Header<DroneClock>) -> Option<u16> {
        let kind = ordered(number)?;
        let before = self.given.replace((from, number, Order::new(header, kind)));
        before.map(|(_, number, _)| number)
    }
    /// An abort is under way.
    pub(super) fn aborts(&self) -> bool {
        self.given
            .is_some_and(|(.., order)| order.kind() == CommandKind::Abort)
    }
    /// What is to be published now, and the answer where it is decided, with a text where it was not taken.
    pub(super) fn poll(
        &mut self,
        now: DroneTime,
        mission: Option<&MissionState>,
    ) -> (Option<Command>, Option<Answer>) {
        let Some((_, number, order)) = &mut self.given else {
            return (None, None);
        };
        let (number, kind) = (*number, order.kind());
        let answer = match order.poll(now, mission) {
            Progress::UnderWay(command) => return (command, None),
            Progress::Taken => Answer {
                number,
                result: CommandResult::Accepted,
                text: None,
            },
            Progress::GivenUp => Answer::refused(number, kind, mission),
        };
        self.given = None;
        (None, Some(answer))
    }
}

/// The last answer to an order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Answer {
    number: u16,
    result: CommandResult,
    text: Option<String>,
}

impl Answer {
    fn refused(number: u16, kind: CommandKind, mission: Option<&MissionState>) -> Answer {
        let (_, order) = named(kind);
        let (result, why) = match mission {
            Some(m) => (CommandResult::TemporarilyRejected, m.state.because(&m.waiting)),
            None => (CommandResult::Failed, "no mission reports".into()),
        };
        Answer {
            number,
            result,
            text: Some(format!("{order} was not taken: {why}")),
        }
    }
    /// As messages to the station.
    pub(super) fn messages(self) -> (Message, Option<(u8, String)>) {
        let ack = Message::CommandAck {
            command: self.number,
            result: self.result,
        };
        (ack, self.text.map(|text| (severity::WARNING, text)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{ReasonCode, State};
    use alight_shared::time::Time;

    const STATION: Address = Address::new(255, 190);

    fn at(s: f64) -> DroneTime {
        Time::from_secs(s)
    }
    fn to(command: u16) -> CommandLong {
        CommandLong::new(Address::new(1, 191), command, [])
    }

    #[test]
    fn station_orders_and_repetitions() {
        let mut orders = StationOrders::default();
        let answered = |orders: &StationOrders, from, c| orders.received(from, &to(c));
        assert_eq!(
            answered(&orders, STATION, command::SET_MODE),
            Received::Answered(CommandResult::Unsupported)
        );
        assert_eq!(
            answered(&orders, STATION, command::USER_1),
            Received::Order(CommandKind::Land)
        );
        assert_eq!(
            orders.give(STATION, command::USER_1, Header::new(0, 1, 7, 1, at(10.0))),
            None
        );
        assert_eq!(
            answered(&orders, STATION, command::USER_1),
            Received::Answered(CommandResult::InProgress)
        );
        // Another station's order counts, and so does the next one of the same; after an abort neither.
        let other = Address::new(254, 190);
        assert_eq!(
            answered(&orders, other, command::USER_1),
            Received::Order(CommandKind::Land)
        );
        let before = orders.give(STATION, command::USER_2, Header::new(0, 1, 7, 2, at(10.1)));
        assert_eq!((before, orders.aborts()), (Some(command::USER_1), true));
        assert_eq!(
            answered(&orders, other, command::USER_1),
            Received::Answered(CommandResult::TemporarilyRejected)
        );
    }

    #[test]
    fn station_order_answers() {
        let mission = |waiting: ReasonCode| MissionState {
            header: Header::new(0, 1, 5, 1, at(11.0)),
            state: State::Idle,
            waiting: waiting.into(),
            ..MissionState::default()
        };
        let result = |mission: Option<&MissionState>| {
            let mut orders = StationOrders::default();
            orders.give(STATION, command::USER_1, Header::new(0, 1, 7, 1, at(10.0)));
            let (mut published, mut answer) = (0, None);
            for k in 0..600 {
                let (command, a) = orders.poll(at(10.0 + 0.01 * f64::from(k)), mission);
                published += usize::from(command.is_some());
                answer = answer.or(a);
            }
            let answer = answer.unwrap();
            (published, answer.result, answer.text.unwrap_or_default())
        };
        assert_eq!(
            result(Some(&mission(ReasonCode::NotFlying))),
            (0, CommandResult::Accepted, String::new())
        );
        let (published, refused, text) = result(Some(&mission(ReasonCode::Operator)));
        assert_eq!((published, refused), (21, CommandResult::TemporarilyRejected));
        assert!(text.starts_with("a landing was not taken: Idle"), "{text}");
        assert_eq!(
            result(None),
            (
                21,
                CommandResult::Failed,
                "a landing was not taken: no mission reports".into()
            )
        );
    }
}
