//! Orders of a ground station: `COMMAND_LONG` or `COMMAND_INT` to the companion, answered by `COMMAND_ACK`.
//!
//! `MAV_CMD_USER_1` and `MAV_CMD_NAV_LAND` land, `MAV_CMD_USER_2` aborts, `MAV_CMD_USER_3` holds, `MAV_CMD_NAV_TAKEOFF`
//! takes off if the mission permits; their parameters are ignored. `MAV_CMD_USER_4` keeps station as its parameters
//! specify and is DENIED if they are invalid. An abort is accepted from every sender; an unsigned link answers any
//! other order with DENIED unless `unsigned_orders` is set.
//!
//! The answer is IN_PROGRESS at once and every second, and ACCEPTED when the mission has accepted the order. If the
//! mission rejects it or does not accept it within 5 s, the answer is TEMPORARILY_REJECTED (FAILED if the mission does
//! not report), and a text gives the reason. The mission applies its usual rules.
//!
//! After an abort or a pilot's takeover, an order other than an abort is rejected if a station repeats it (its
//! confirmation counter increases; a `COMMAND_INT` has no counter and may be a repetition) or gives it within a second,
//! because the operator cannot know of the abort yet. Other repetitions get the previous answer. An abort is carried
//! out each time, because another operator may have ordered a landing in the meantime. Any sender on the autopilot's
//! link can also fly the drone without Alight; `signing_key` protects against both.

use alight_shared::{
    admission::{Periodic, command::UNAWARE_OF_ABORT},
    msg::{Command, CommandKind, Header, MissionState, Station},
    time::{DroneClock, Span},
};

use super::{
    DroneTime,
    message::{Address, MavCmd, MavResult, MavlinkMessage, command_ack},
    orders::{self, SentCommand},
};

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StationCommand {
    pub(super) number: MavCmd,
    pub(super) first: [f64; 4],
    pub(super) repetition: Repetition,
}

impl StationCommand {
    /// Order in the command, or the answer to the station.
    fn ordered(&self) -> Result<CommandKind, MavResult> {
        match self.number {
            MavCmd::MAV_CMD_USER_1 | MavCmd::MAV_CMD_NAV_LAND => Ok(CommandKind::Land),
            MavCmd::MAV_CMD_NAV_TAKEOFF => Ok(CommandKind::TakeOff),
            MavCmd::MAV_CMD_USER_2 => Ok(CommandKind::Abort),
            MavCmd::MAV_CMD_USER_3 => Ok(CommandKind::Hold),
            MavCmd::MAV_CMD_USER_4 => station(self.first).map(CommandKind::Station),
            _ => Err(MavResult::MAV_RESULT_UNSUPPORTED),
        }
    }
}

/// Station from height, distances ahead and to starboard (m), and duration (min). NaN selects the default, and so does
/// 0 for height, distance ahead and duration. Consoles send 0 for omitted parameters, so 0 ahead and 0 to starboard
/// select the default place, never a place above the deck. DENIED if out of bounds.
fn station(first: [f64; 4]) -> Result<Station, MavResult> {
    let [height_m, ahead_m, right_m, for_min] = first.map(|v| Some(v).filter(|v| !v.is_nan()));
    let unless_0 = |value: Option<f64>| value.filter(|v| *v != 0.0);
    let whole = |value: f64| {
        let whole = value.round();
        let fits = (f64::from(i8::MIN)..=f64::from(i8::MAX)).contains(&whole);
        fits.then_some(whole as i8).ok_or(MavResult::MAV_RESULT_DENIED)
    };
    // A value that rounds to 0 must not select the default.
    let positive = |value: f64| match whole(value)? {
        most @ 1.. => Ok(most.unsigned_abs()),
        i8::MIN..=0 => Err(MavResult::MAV_RESULT_DENIED),
    };
    let (ahead_m, right_m) = match (unless_0(ahead_m), right_m) {
        (None, Some(0.0)) => (None, None),
        named => named,
    };
    let place = [ahead_m.map(whole).transpose()?, right_m.map(whole).transpose()?];
    if matches!(place, [Some(0), Some(0) | None] | [None, Some(0)]) {
        return Err(MavResult::MAV_RESULT_DENIED);
    }
    let station = Station::named(
        place,
        unless_0(height_m).map(positive).transpose()?,
        unless_0(for_min).map(positive).transpose()?,
    );
    station
        .is_sane()
        .then_some(station)
        .ok_or(MavResult::MAV_RESULT_DENIED)
}

/// Time within which a station may repeat an order.
const REPEATED: Span = Span::from_millis(15_000);
/// Period of answers to a pending order; without answers a station gives up.
const ANSWERED: Span = Span::from_millis(1000);

const MAX_STATIONS: usize = 4;

#[derive(Clone, Debug)]
struct StationOrder {
    number: MavCmd,
    order: SentCommand,
    answers: Periodic<DroneClock>,
    stations: Vec<Address>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Repetition {
    No,
    Yes,
    Perhaps,
}

impl Repetition {
    pub(super) fn counted(confirmation: u8) -> Repetition {
        if confirmation > 0 {
            Repetition::Yes
        } else {
            Repetition::No
        }
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct StationOrders {
    given: Option<StationOrder>,
    decided: Option<(Answer, DroneTime)>,
    /// Last abort or takeover by the pilot that stopped a landing.
    stopped: Option<DroneTime>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum CommandOutcome {
    /// Unknown command, or repetition of an order.
    Answered(MavResult),
    Rejected(MavResult, &'static str),
    Order(CommandKind),
}

/// Reasons to reject an order before it reaches the mission; each fits in a STATUSTEXT.
const OUT_OF_BOUNDS: &str = "station out of bounds";
const UNAWARE: &str = "landing just stopped, or switch on abort";
pub(super) const UNSIGNED: &str = "no signing_key (or unsigned_orders)";

impl StationOrders {
    pub(super) fn stopped(&mut self, now: DroneTime) {
        self.stopped = Some(now);
    }
    /// Processes a command. `barred`: the remote control's switch blocks orders; `counts`: orders on this link are
    /// accepted.
    pub(super) fn received(
        &mut self,
        now: DroneTime,
        from: Address,
        asked: &StationCommand,
        [barred, counts]: [bool; 2],
    ) -> CommandOutcome {
        let number = asked.number;
        let repetition = asked.repetition;
        let kind = match asked.ordered() {
            Ok(kind) if counts || kind == CommandKind::Abort => kind,
            Ok(_) => return CommandOutcome::Rejected(MavResult::MAV_RESULT_DENIED, UNSIGNED),
            Err(MavResult::MAV_RESULT_DENIED) => {
                return CommandOutcome::Rejected(MavResult::MAV_RESULT_DENIED, OUT_OF_BOUNDS);
            }
            Err(answer) => return CommandOutcome::Answered(answer),
        };
        let is_same = |g: &&mut StationOrder| g.number == number && g.order.message.kind == kind;
        if let Some(same) = self.given.as_mut().filter(is_same) {
            if !same.stations.contains(&from) && same.stations.len() < MAX_STATIONS {
                same.stations.push(from);
            }
            return CommandOutcome::Answered(MavResult::MAV_RESULT_IN_PROGRESS);
        }
        if kind == CommandKind::Abort {
            // The previous answer is not reused, because a landing may have been ordered since.
            return CommandOutcome::Order(kind);
        }
        let recent = |at: DroneTime, within| now - at < within;
        // Checked before the previous answer is reused, because its order is no longer in force.
        let unaware = match repetition {
            Repetition::No => UNAWARE_OF_ABORT,
            Repetition::Yes | Repetition::Perhaps => REPEATED,
        };
        let stopped = self.stopped.is_some_and(|at| recent(at, unaware));
        if stopped || barred || self.aborts() {
            return CommandOutcome::Rejected(MavResult::MAV_RESULT_TEMPORARILY_REJECTED, UNAWARE);
        }
        let same = |a: &Answer| a.number == number && a.kind == kind && a.stations.contains(&from);
        match &self.decided {
            Some((answer, at)) if repetition == Repetition::Yes && same(answer) && recent(*at, REPEATED) => {
                CommandOutcome::Answered(answer.result)
            }
            Some(_) | None => CommandOutcome::Order(kind),
        }
    }
    /// Starts a new order. Returns the answer to the one it replaces.
    pub(super) fn give(
        &mut self,
        (number, kind): (MavCmd, CommandKind),
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
        before.map(|g| g.answer(MavResult::MAV_RESULT_CANCELLED))
    }
    pub(super) fn aborts(&self) -> bool {
        let given = self.given.as_ref();
        given.is_some_and(|g| g.order.message.kind == CommandKind::Abort)
    }
    /// Order to publish now, answer to a completed order, and text if it failed.
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
                let answer = again.then(|| given.answer(MavResult::MAV_RESULT_IN_PROGRESS));
                return (given.order.due(now), answer);
            }
            Some(true) => given.answer(MavResult::MAV_RESULT_ACCEPTED),
            Some(false) => given.rejected(mission),
        };
        self.given = None;
        self.decided = Some((answer.clone(), now));
        (None, Some(answer))
    }
}

impl StationOrder {
    fn answer(&self, result: MavResult) -> Answer {
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
            Some(_) => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
            None => MavResult::MAV_RESULT_FAILED,
        };
        Answer {
            text: Some(orders::rejection_text(&self.order, mission)),
            ..self.answer(result)
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Answer {
    number: MavCmd,
    kind: CommandKind,
    result: MavResult,
    stations: Vec<Address>,
    pub(super) text: Option<String>,
}

impl Answer {
    pub(super) fn messages(&self) -> impl Iterator<Item = MavlinkMessage> + '_ {
        self.stations
            .iter()
            .map(|to| command_ack(self.number, self.result, *to))
    }
}

#[cfg(test)]
mod tests;
