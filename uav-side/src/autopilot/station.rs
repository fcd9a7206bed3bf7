//! Orders of a ground station: `COMMAND_LONG` or `COMMAND_INT` to the companion, answered by `COMMAND_ACK` to whoever gave it.
//!
//! `MAV_CMD_USER_1` and `MAV_CMD_NAV_LAND` land, `MAV_CMD_USER_2` aborts, `MAV_CMD_USER_3` holds, `MAV_CMD_NAV_TAKEOFF` takes
//! off where the mission permits that, all whatever their parameters; `MAV_CMD_USER_4` keeps the station that its parameters name,
//! and is DENIED where they name none. An order is answered with
//! IN_PROGRESS at once and each second, with ACCEPTED when the mission has taken it, and with TEMPORARILY_REJECTED, or FAILED
//! where no mission reports, when it rejects it or has not taken it in 5 s. It is admitted by the mission as any other. An order
//! other than an abort that a station repeats (its confirmation counts; a `COMMAND_INT`, which has none, may be a repetition), or gives within a
//! second of it, is rejected after an abort or after a person took the drone over: whoever gave it cannot have seen that. One
//! whose confirmation counts is answered as it was before; an abort is ordered again each time, for somebody else may have
//! ordered a landing since. Whoever reaches the autopilot's link may fly the drone without us, too: `signing_key` keeps others
//! out of both.

use alight_shared::admission::Periodic;
use alight_shared::admission::command::UNAWARE_OF_ABORT;
use alight_shared::msg::{Command, CommandKind, Header, MissionState, Station};
use alight_shared::time::{DroneClock, Span};

use super::DroneTime;
use super::message::{Address, CommandResult, Message, command};
use super::orders::{Order, Progress, named};

/// A command as a station gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Asked {
    /// Which.
    pub(super) number: u16,
    /// Its first four parameters.
    pub(super) first: [f64; 4],
    pub(super) repetition: Repetition,
}

impl Asked {
    /// What it orders; else the answer.
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
/// height, a distance ahead and a time of 0 are, too; DENIED outside a station's bounds.
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
    let station = Station::named(
        [
            unless_0(ahead_m).map(whole).transpose()?,
            right_m.map(whole).transpose()?,
        ],
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
struct Given {
    number: u16,
    order: Order,
    answers: Periodic<DroneClock>,
    /// Who gave it, and who gave it again.
    stations: Vec<Address>,
}

/// Whether a command repeats another, by its message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Repetition {
    /// Given for the first time.
    No,
    /// Its confirmation counts.
    Yes,
    /// The message does not state it.
    Perhaps,
}

impl Repetition {
    /// Of a `COMMAND_LONG` with this confirmation.
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
    given: Option<Given>,
    /// The answer to the last order that was decided, and when.
    decided: Option<(Answer, DroneTime)>,
    /// When a landing was stopped last: by an abort of anybody, or by a person who took the drone over.
    stopped: Option<DroneTime>,
}

/// What a command from a station leads to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Received {
    /// It is no order of ours, repeats another, or its sender cannot know of an abort.
    Answered(CommandResult),
    /// A new order.
    Order(CommandKind),
}

impl StationOrders {
    /// A landing was stopped.
    pub(super) fn stopped(&mut self, now: DroneTime) {
        self.stopped = Some(now);
    }
    /// A command to the companion. `barred`: the remote control's switch aborts or stands there.
    pub(super) fn received(
        &mut self,
        now: DroneTime,
        from: Address,
        asked: &Asked,
        barred: bool,
    ) -> Received {
        let (number, repetition) = (asked.number, asked.repetition);
        let kind = match asked.ordered() {
            Ok(kind) => kind,
            Err(answer) => return Received::Answered(answer),
        };
        let is_same = |g: &&mut Given| g.number == number && g.order.kind() == kind;
        if let Some(same) = self.given.as_mut().filter(is_same) {
            if !same.stations.contains(&from) && same.stations.len() < MAX_STATIONS {
                same.stations.push(from);
            }
            return Received::Answered(CommandResult::InProgress);
        }
        if kind == CommandKind::Abort {
            // Never by an old answer: somebody may have ordered a landing since, and a second abort does no harm.
            return Received::Order(kind);
        }
        let recent = |at: DroneTime, within| now - at < within;
        // Before the answer that it had once: what it ordered is no longer in force.
        let unaware = match repetition {
            Repetition::No => UNAWARE_OF_ABORT,
            Repetition::Yes | Repetition::Perhaps => REPEATED,
        };
        let stopped = self.stopped.is_some_and(|at| recent(at, unaware));
        if stopped || barred || self.aborts() {
            return Received::Answered(CommandResult::TemporarilyRejected);
        }
        let same = |a: &Answer| a.number == number && a.kind == kind && a.stations.contains(&from);
        match &self.decided {
            Some((answer, at)) if repetition == Repetition::Yes && same(answer) && recent(*at, REPEATED) => {
                Received::Answered(answer.result)
            }
            Some(_) | None => Received::Order(kind),
        }
    }
    /// Begins a new order; the answer to the one that it takes the place of.
    pub(super) fn give(
        &mut self,
        (number, kind): (u16, CommandKind),
        from: Address,
        header: Header<DroneClock>,
    ) -> Option<Answer> {
        let order = Order::new(header, kind);
        let mut answers = Periodic::default();
        answers.restart(header.at, ANSWERED);
        let before = self.given.replace(Given {
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
        given.is_some_and(|g| g.order.kind() == CommandKind::Abort)
    }
    /// What is to be published now, and the answer where it is decided, with a text where it was not taken.
    pub(super) fn poll(
        &mut self,
        now: DroneTime,
        mission: Option<&MissionState>,
    ) -> (Option<Command>, Option<Answer>) {
        let Some(given) = &mut self.given else {
            return (None, None);
        };
        let answer = match given.order.poll(now, mission) {
            Progress::UnderWay(command) => {
                let again = given.answers.is_due_spaced(now, ANSWERED);
                return (command, again.then(|| given.answer(CommandResult::InProgress)));
            }
            Progress::Taken => given.answer(CommandResult::Accepted),
            Progress::GivenUp => given.rejected(mission),
        };
        self.given = None;
        self.decided = Some((answer.clone(), now));
        (None, Some(answer))
    }
}

impl Given {
    fn answer(&self, result: CommandResult) -> Answer {
        Answer {
            number: self.number,
            kind: self.order.kind(),
            result,
            stations: self.stations.clone(),
            text: None,
        }
    }
    fn rejected(&self, mission: Option<&MissionState>) -> Answer {
        let (_, order) = named(self.order.kind());
        let (result, why) = match mission {
            Some(m) => {
                let own = m.rejected.filter(|_| self.order.is_acknowledged(m));
                let why = own.unwrap_or(m.waiting);
                (CommandResult::TemporarilyRejected, m.state.because(&why))
            }
            None => (CommandResult::Failed, "no mission reports".into()),
        };
        Answer {
            text: Some(format!("{order} was not taken: {why}")),
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
    pub(super) fn messages(&self) -> impl Iterator<Item = Message> + '_ {
        self.stations.iter().map(|to| Message::CommandAck {
            command: self.number,
            result: self.result,
            to: *to,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{ReasonCode, State};
    use alight_shared::time::Time;

    fn at(s: f64) -> DroneTime {
        Time::from_secs(s)
    }
    const STATION: Address = Address::new(255, 190);
    const REJECTED: Received = Received::Answered(CommandResult::TemporarilyRejected);
    /// A command that is given for the first time.
    fn new(command: u16) -> Asked {
        asked(command, Repetition::No)
    }
    fn asked(number: u16, repetition: Repetition) -> Asked {
        Asked {
            number,
            first: [0.0; 4],
            repetition,
        }
    }
    const LAND: (u16, CommandKind) = (command::USER_1, CommandKind::Land);
    fn tracking(s: f64) -> MissionState {
        MissionState {
            header: Header::new(0, 1, 5, 1, at(s)),
            state: State::Tracking,
            ..MissionState::default()
        }
    }

    #[test]
    fn station_orders_and_repetitions() {
        let mut orders = StationOrders::default();
        let answered = |orders: &mut StationOrders, s, c| orders.received(at(s), STATION, &new(c), false);
        let (land, abort) = (command::USER_1, command::USER_2);
        assert_eq!(
            answered(&mut orders, 9.9, command::SET_MODE),
            Received::Answered(CommandResult::Unsupported)
        );
        assert_eq!(
            answered(&mut orders, 9.9, land),
            Received::Order(CommandKind::Land)
        );
        assert_eq!(
            orders.give(LAND, STATION, Header::new(0, 1, 7, 1, at(10.0))),
            None
        );
        assert_eq!(
            answered(&mut orders, 10.0, land),
            Received::Answered(CommandResult::InProgress)
        );
        // An abort takes its place, and bars what is no abort.
        assert_eq!(
            answered(&mut orders, 10.1, abort),
            Received::Order(CommandKind::Abort)
        );
        let replaced = orders.give(
            (abort, CommandKind::Abort),
            STATION,
            Header::new(0, 1, 7, 2, at(10.1)),
        );
        assert_eq!(
            replaced.map(|a| (a.number, a.result)),
            Some((land, CommandResult::Other))
        );
        assert!(orders.aborts());
        assert_eq!(answered(&mut orders, 10.2, land), REJECTED);
    }

    #[test]
    fn station_orders_unaware_of_an_abort() {
        let mut orders = StationOrders::default();
        orders.stopped(at(10.0));
        let lands = |orders: &mut StationOrders, s, repetition| {
            orders.received(at(s), STATION, &asked(command::USER_1, repetition), false)
        };
        let ordered = Received::Order(CommandKind::Land);
        let first = Repetition::No;
        assert_eq!(
            [lands(&mut orders, 10.5, first), lands(&mut orders, 11.5, first)],
            [REJECTED, ordered]
        );
        // What repeats, or may repeat, what a station ordered before.
        for again in [Repetition::Yes, Repetition::Perhaps] {
            assert_eq!(
                [lands(&mut orders, 13.0, again), lands(&mut orders, 26.0, again)],
                [REJECTED, ordered]
            );
        }
        assert_eq!(
            orders.received(at(30.0), STATION, &new(command::USER_1), true),
            REJECTED
        );
        assert_eq!(
            orders.received(at(10.1), STATION, &new(command::USER_2), true),
            Received::Order(CommandKind::Abort)
        );
    }

    #[test]
    fn station_order_whose_answer_was_lost() {
        let mut orders = StationOrders::default();
        let again = |orders: &mut StationOrders, s, from, repetition| {
            orders.received(at(s), from, &asked(command::USER_1, repetition), false)
        };
        let ordered = Received::Order(CommandKind::Land);
        // Whose answer was lost is answered again, and orders nothing.
        orders.give(LAND, STATION, Header::new(0, 1, 7, 1, at(30.0)));
        assert!(orders.poll(at(31.0), Some(&tracking(31.0))).1.is_some());
        assert_eq!(
            again(&mut orders, 33.0, STATION, Repetition::Yes),
            Received::Answered(CommandResult::Accepted)
        );
        // Another's, one that is new, and one that may be.
        let other = Address::new(254, 190);
        for (from, repetition) in [
            (other, Repetition::Yes),
            (STATION, Repetition::No),
            (STATION, Repetition::Perhaps),
        ] {
            assert_eq!(again(&mut orders, 33.0, from, repetition), ordered);
        }
        // Unless it was stopped since.
        orders.stopped(at(34.0));
        assert_eq!(again(&mut orders, 35.5, STATION, Repetition::Yes), REJECTED);
    }

    #[test]
    fn station_order_refused_and_given_again() {
        let mut orders = StationOrders::default();
        orders.give(LAND, STATION, Header::new(0, 1, 7, 1, at(10.0)));
        let (_, answer) = orders.poll(at(16.0), None);
        assert_eq!(answer.map(|a| a.result), Some(CommandResult::Failed));
        for (repetition, expected) in [
            (Repetition::Yes, Received::Answered(CommandResult::Failed)),
            (Repetition::No, Received::Order(CommandKind::Land)),
            (Repetition::Perhaps, Received::Order(CommandKind::Land)),
        ] {
            let received = orders.received(at(17.0), STATION, &asked(command::USER_1, repetition), false);
            assert_eq!(received, expected, "{repetition:?}");
        }
    }

    #[test]
    fn station_abort_after_a_landing_from_elsewhere() {
        let mut orders = StationOrders::default();
        let header = Header::new(0, 1, 7, 1, at(10.0));
        orders.give((command::USER_2, CommandKind::Abort), STATION, header);
        let mission = MissionState {
            abort: Some([header.boot, header.sequence]),
            ..tracking(10.1)
        };
        let (_, answer) = orders.poll(at(10.1), Some(&mission));
        assert_eq!(answer.map(|a| a.result), Some(CommandResult::Accepted));
        // Somebody else orders a landing meanwhile: no station is informed of it.
        for repetition in [Repetition::No, Repetition::Yes, Repetition::Perhaps] {
            let received = orders.received(at(20.0), STATION, &asked(command::USER_2, repetition), false);
            assert_eq!(received, Received::Order(CommandKind::Abort), "{repetition:?}");
        }
    }

    #[test]
    fn station_order_answered_to_all_who_gave_it() {
        let mut orders = StationOrders::default();
        orders.give(LAND, STATION, Header::new(0, 1, 7, 1, at(10.0)));
        let others: Vec<Address> = (1..9).map(|k| Address::new(k, 190)).collect();
        for other in [&STATION].into_iter().chain(&others) {
            let answered = orders.received(at(10.1), *other, &new(command::USER_1), false);
            assert_eq!(answered, Received::Answered(CommandResult::InProgress));
        }
        let (_, answer) = orders.poll(at(20.0), None);
        let reported: Vec<Message> = answer.iter().flat_map(Answer::messages).collect();
        let expected = [STATION, others[0], others[1], others[2]].map(|to| Message::CommandAck {
            command: command::USER_1,
            result: CommandResult::Failed,
            to,
        });
        assert_eq!(reported, expected);
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
            orders.give(LAND, STATION, Header::new(0, 1, 7, 1, at(10.0)));
            let (mut published, mut answers) = (0, Vec::new());
            for k in 0..600 {
                let (command, a) = orders.poll(at(10.0 + 0.01 * f64::from(k)), mission);
                published += usize::from(command.is_some());
                answers.extend(a);
            }
            // It is answered each second.
            let answer = answers.pop().unwrap();
            let under_way = answers.iter().all(|a| a.result == CommandResult::InProgress);
            assert!(under_way && answers.len() == published.min(5), "{answers:?}");
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

    #[test]
    fn station_of_a_command() {
        let ordered = |first| {
            let number = command::USER_4;
            Asked {
                number,
                first,
                ..new(number)
            }
            .ordered()
        };
        let kept = |height_m, ahead_m, right_m, for_min| {
            Ok(CommandKind::Station(Station {
                ahead_m,
                right_m,
                height_m,
                for_min,
            }))
        };
        let none = f64::NAN;
        assert_eq!(ordered([none; 4]), Ok(CommandKind::Station(Station::USUAL)));
        assert_eq!(ordered([0.0; 4]), kept(0, 0, 0, 10));
        assert_eq!(ordered([25.0, -30.2, none, 20.0]), kept(25, -30, 0, 20));
        assert_eq!(ordered([none, none, -40.0, none]), kept(0, 0, -40, 10));
        assert_eq!(ordered([25.0, 0.0, none, 10.0]), kept(25, 0, 20, 10));
        for wrong in [
            [-1.0, 0.0, 20.0, 10.0],
            [51.0, 0.0, 20.0, 10.0],
            [20.0, 50.0, 50.0, 10.0],
            [20.0, 0.0, 1e9, 10.0],
            [20.0, 0.0, f64::INFINITY, 10.0],
            [0.4, 0.0, 20.0, 10.0],
            [20.0, 0.0, 20.0, 0.4],
            [20.0, 0.0, 20.0, 31.0],
            [20.0, 0.0, 20.0, -1.0],
        ] {
            assert_eq!(ordered(wrong), Err(CommandResult::Denied), "{wrong:?}");
        }
    }

    #[test]
    fn station_in_place_of_another() {
        let mut orders = StationOrders::default();
        let right = |m| Asked {
            first: [0.0, 0.0, m, 0.0],
            ..new(command::USER_4)
        };
        let Received::Order(first) = orders.received(at(10.0), STATION, &right(20.0), false) else {
            panic!("no order");
        };
        orders.give(
            (command::USER_4, first),
            STATION,
            Header::new(0, 1, 7, 1, at(10.0)),
        );
        let again = orders.received(at(10.1), STATION, &right(20.0), false);
        assert_eq!(again, Received::Answered(CommandResult::InProgress));
        let other = orders.received(at(10.2), STATION, &right(30.0), false);
        assert!(
            matches!(other, Received::Order(kind) if kind != first),
            "{other:?}"
        );
    }

    /// The mission acknowledges what it does not carry out, too.
    #[test]
    fn station_order_that_the_mission_rejects() {
        let mut orders = StationOrders::default();
        let header = Header::new(0, 1, 7, 1, at(10.0));
        let kind = CommandKind::Station(Station::USUAL);
        orders.give((command::USER_4, kind), STATION, header);
        let mission = MissionState {
            order: Some([header.boot, header.sequence]),
            rejected: Some(ReasonCode::StationNotNow.into()),
            ..tracking(10.1)
        };
        let (_, answer) = orders.poll(at(10.1), Some(&mission));
        let answer = answer.unwrap();
        assert_eq!(answer.result, CommandResult::TemporarilyRejected);
        assert!(answer.text.unwrap().starts_with("a station was not taken: "));
    }
}
