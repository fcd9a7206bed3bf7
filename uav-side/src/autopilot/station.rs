//! Orders of a ground station: `COMMAND_LONG` or `COMMAND_INT` to the companion, answered by `COMMAND_ACK` to whoever gave it.
//!
//! `MAV_CMD_USER_1` and `MAV_CMD_NAV_LAND` land, `MAV_CMD_USER_2` aborts, `MAV_CMD_USER_3` holds, `MAV_CMD_NAV_TAKEOFF` takes
//! off where the mission permits that, all whatever their parameters; `MAV_CMD_USER_4` keeps the station that its parameters name,
//! and is DENIED where they name none. An abort counts whoever gives it; any other order is DENIED on a link that is not signed,
//! unless the configuration permits that (`unsigned_orders`). A rejected order is answered with a text that has the
//! reason. An order is answered with IN_PROGRESS at once and each second, with ACCEPTED when the mission has taken it,
//! and with TEMPORARILY_REJECTED, or FAILED where no mission reports, when it rejects it or has not taken it in 5 s. It
//! is admitted by the mission as any other. An order other than an abort that a station repeats (its confirmation counts;
//! a `COMMAND_INT`, which has none, may be a repetition), or gives within a second of it, is rejected after an abort or
//! after a person took the drone over: whoever gave it cannot know that yet. One whose confirmation counts is answered
//! as it was before; an abort is ordered again each time, for somebody else may have ordered a landing since. Whoever
//! reaches the autopilot's link may fly the drone without us, too: `signing_key` keeps others out of both.

use alight_shared::admission::Periodic;
use alight_shared::admission::command::UNAWARE_OF_ABORT;
use alight_shared::msg::{Command, CommandKind, Header, MissionState, Station};
use alight_shared::time::{DroneClock, Span};

use super::DroneTime;
use super::message::{Address, CommandResult, MavlinkMessage, command};
use super::orders::{self, SentCommand};

/// A command as a station gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StationCommand {
    pub(super) number: u16,
    /// First four parameters of the command.
    pub(super) first: [f64; 4],
    pub(super) repetition: Repetition,
}

impl StationCommand {
    /// Kind of the order; otherwise the answer.
    fn ordered(&self) -> Result<CommandKind, CommandResult> {
        match self.number {
            command::USER_1 | command::NAV_LAND => Ok(CommandKind::Land),
            command::NAV_TAKEOFF => Ok(CommandKind::TakeOff),
            command::USER_2 => Ok(CommandKind::Abort),
            command::USER_3 => Ok(CommandKind::Hold),
            command::USER_4 => station(self.first).map(CommandKind::Station),
            _ => Err(CommandResult::Unsupported),
        }
    }
}

/// The station of these parameters: height, m; ahead and to starboard, m; min. What is not a number is the usual, and a
/// height, a distance ahead and a time of 0 are, too. Consoles send 0 for what is left out: neither ahead nor to the side is the usual
/// place, never one straight above the deck. DENIED outside a station's bounds.
fn station(first: [f64; 4]) -> Result<Station, CommandResult> {
    let [height_m, ahead_m, right_m, for_min] = first.map(|v| Some(v).filter(|v| !v.is_nan()));
    let unless_0 = |value: Option<f64>| value.filter(|v| *v != 0.0);
    let whole = |value: f64| {
        let whole = value.round();
        let fits = (f64::from(i8::MIN)..=f64::from(i8::MAX)).contains(&whole);
        fits.then_some(whole as i8).ok_or(CommandResult::Denied)
    };
    // Nearly nothing is not the usual.
    let positive = |value: f64| match whole(value)? {
        most @ 1.. => Ok(most.unsigned_abs()),
        i8::MIN..=0 => Err(CommandResult::Denied),
    };
    let (ahead_m, right_m) = match (unless_0(ahead_m), right_m) {
        (None, Some(0.0)) => (None, None),
        named => named,
    };
    let place = [ahead_m.map(whole).transpose()?, right_m.map(whole).transpose()?];
    if matches!(place, [Some(0), Some(0) | None] | [None, Some(0)]) {
        return Err(CommandResult::Denied);
    }
    let station = Station::named(
        place,
        unless_0(height_m).map(positive).transpose()?,
        unless_0(for_min).map(positive).transpose()?,
    );
    station.is_sane().then_some(station).ok_or(CommandResult::Denied)
}

/// A station repeats an order for no longer than this.
const REPEATED: Span = Span::from_millis(15_000);
/// An order under way is answered again at this period: a station gives up a command without an answer.
const ANSWERED: Span = Span::from_millis(1000);

/// Stations that wait for the answer to one order, at most.
const MAX_STATIONS: usize = 4;

/// The order of a station under way.
#[derive(Clone, Debug)]
struct StationOrder {
    number: u16,
    order: SentCommand,
    answers: Periodic<DroneClock>,
    /// Who gave it, and who gave it again.
    stations: Vec<Address>,
}

/// Whether a command repeats another, by its message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Repetition {
    /// Given for the first time.
    No,
    /// The command's confirmation counts.
    Yes,
    /// The message does not state it.
    Perhaps,
}

impl Repetition {
    /// Repetition of a `COMMAND_LONG` with this confirmation.
    pub(super) fn counted(confirmation: u8) -> Repetition {
        if confirmation > 0 {
            Repetition::Yes
        } else {
            Repetition::No
        }
    }
}

/// The orders of all stations.
#[derive(Clone, Debug, Default)]
pub(super) struct StationOrders {
    given: Option<StationOrder>,
    /// The answer to the last order that was decided, and when.
    decided: Option<(Answer, DroneTime)>,
    /// When a landing was stopped last: by an abort of anybody, or by a person who took the drone over.
    stopped: Option<DroneTime>,
}

/// Result of a command from a station.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum CommandOutcome {
    /// It is no order of ours, or repeats another.
    Answered(CommandResult),
    /// It is not taken, for this reason.
    Rejected(CommandResult, &'static str),
    /// A new order.
    Order(CommandKind),
}

/// Why an order is not taken before the mission is asked: each fits a STATUSTEXT.
const OUT_OF_BOUNDS: &str = "out of a station's bounds";
const UNAWARE: &str = "just stopped, or switch on abort";
pub(super) const UNSIGNED: &str = "no signing_key (or unsigned_orders)";

impl StationOrders {
    /// A landing was stopped.
    pub(super) fn stopped(&mut self, now: DroneTime) {
        self.stopped = Some(now);
    }
    /// A command to the companion. `barred`: the remote control's switch aborts or stands there; `counts`: orders of this link do.
    pub(super) fn received(
        &mut self,
        now: DroneTime,
        from: Address,
        asked: &StationCommand,
        [barred, counts]: [bool; 2],
    ) -> CommandOutcome {
        let (number, repetition) = (asked.number, asked.repetition);
        let kind = match asked.ordered() {
            Ok(kind) if counts || kind == CommandKind::Abort => kind,
            Ok(_) => return CommandOutcome::Rejected(CommandResult::Denied, UNSIGNED),
            Err(CommandResult::Denied) => {
                return CommandOutcome::Rejected(CommandResult::Denied, OUT_OF_BOUNDS);
            }
            Err(answer) => return CommandOutcome::Answered(answer),
        };
        let is_same = |g: &&mut StationOrder| g.number == number && g.order.message.kind == kind;
        if let Some(same) = self.given.as_mut().filter(is_same) {
            if !same.stations.contains(&from) && same.stations.len() < MAX_STATIONS {
                same.stations.push(from);
            }
            return CommandOutcome::Answered(CommandResult::InProgress);
        }
        if kind == CommandKind::Abort {
            // Never by an old answer: somebody may have ordered a landing since, and a second abort does no harm.
            return CommandOutcome::Order(kind);
        }
        let recent = |at: DroneTime, within| now - at < within;
        // Before the answer that it had once: what it ordered is no longer in force.
        let unaware = match repetition {
            Repetition::No => UNAWARE_OF_ABORT,
            Repetition::Yes | Repetition::Perhaps => REPEATED,
        };
        let stopped = self.stopped.is_some_and(|at| recent(at, unaware));
        if stopped || barred || self.aborts() {
            return CommandOutcome::Rejected(CommandResult::TemporarilyRejected, UNAWARE);
        }
        let same = |a: &Answer| a.number == number && a.kind == kind && a.stations.contains(&from);
        match &self.decided {
            Some((answer, at)) if repetition == Repetition::Yes && same(answer) && recent(*at, REPEATED) => {
                CommandOutcome::Answered(answer.result)
            }
            Some(_) | None => CommandOutcome::Order(kind),
        }
    }
    /// Begins a new order; the answer to the one that it takes the place of.
    pub(super) fn give(
        &mut self,
        (number, kind): (u16, CommandKind),
        from: Address,
        header: Header<DroneClock>,
    ) -> Option<Answer> {
        let order = orders::sent(header, kind);
        let mut answers = Periodic::default();
        answers.restart(header.at, ANSWERED);
        let before = self.given.replace(StationOrder {
            number,
            order,
            answers,
            stations: vec![from],
        });
        before.map(|g| g.answer(CommandResult::Other))
    }
    /// An abort is under way.
    pub(super) fn aborts(&self) -> bool {
        let given = self.given.as_ref();
        given.is_some_and(|g| g.order.message.kind == CommandKind::Abort)
    }
    /// Order to publish now, and the answer where it is decided, with a text where it was not taken.
    pub(super) fn poll(
        &mut self,
        now: DroneTime,
        mission: Option<&MissionState>,
    ) -> (Option<Command>, Option<Answer>) {
        let Some(given) = &mut self.given else {
            return (None, None);
        };
        let answer = match orders::outcome(&given.order, now, mission) {
            None => {
                let again = given.answers.is_due_spaced(now, ANSWERED);
                let answer = again.then(|| given.answer(CommandResult::InProgress));
                return (given.order.due(now), answer);
            }
            Some(true) => given.answer(CommandResult::Accepted),
            Some(false) => given.rejected(mission),
        };
        self.given = None;
        self.decided = Some((answer.clone(), now));
        (None, Some(answer))
    }
}

impl StationOrder {
    fn answer(&self, result: CommandResult) -> Answer {
        Answer {
            number: self.number,
            kind: self.order.message.kind,
            result,
            stations: self.stations.clone(),
            text: None,
        }
    }
    fn rejected(&self, mission: Option<&MissionState>) -> Answer {
        let result = match mission {
            Some(_) => CommandResult::TemporarilyRejected,
            None => CommandResult::Failed,
        };
        Answer {
            text: Some(orders::refusal(&self.order, mission)),
            ..self.answer(result)
        }
    }
}

/// An answer to an order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Answer {
    number: u16,
    kind: CommandKind,
    result: CommandResult,
    /// Who waits for it.
    stations: Vec<Address>,
    /// Why it was not taken.
    pub(super) text: Option<String>,
}

impl Answer {
    /// As messages to all who wait for it.
    pub(super) fn messages(&self) -> impl Iterator<Item = MavlinkMessage> + '_ {
        self.stations.iter().map(|to| MavlinkMessage::CommandAck {
            command: self.number,
            result: self.result,
            to: *to,
        })
    }
}

#[cfg(test)]
mod tests;
