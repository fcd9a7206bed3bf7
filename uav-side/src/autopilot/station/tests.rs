use super::*;
use alight_shared::{
    msg::{ReasonCode, State},
    time::Time,
};

use CommandOutcome::{Answered, Order, Rejected};
use MavResult::{
    MAV_RESULT_ACCEPTED as Accepted, MAV_RESULT_CANCELLED as Cancelled, MAV_RESULT_DENIED as Denied,
    MAV_RESULT_FAILED as Failed, MAV_RESULT_IN_PROGRESS as InProgress,
    MAV_RESULT_TEMPORARILY_REJECTED as TemporarilyRejected, MAV_RESULT_UNSUPPORTED as Unsupported,
};

fn at(s: f64) -> DroneTime {
    Time::from_secs(s)
}
const STATION: Address = Address::new(255, 190);
const REJECTED: CommandOutcome = Rejected(TemporarilyRejected, UNAWARE);
/// The remote control does not block orders, and orders on the link are accepted.
const FREE: [bool; 2] = [false, true];
const BARRED: [bool; 2] = [true, true];
fn new(command: MavCmd) -> StationCommand {
    asked(command, Repetition::No)
}
fn asked(number: MavCmd, repetition: Repetition) -> StationCommand {
    StationCommand {
        number,
        first: [0.0; 4],
        repetition,
    }
}
fn given(sequence: u32, s: f64) -> Header<DroneClock> {
    Header::new(0, 1, 7, sequence, at(s))
}
const LAND: (MavCmd, CommandKind) = (MavCmd::MAV_CMD_USER_1, CommandKind::Land);
fn tracking(s: f64) -> MissionState {
    MissionState {
        header: Header::new(0, 1, 5, 1, at(s)),
        state: State::Tracking,
        order: Some([7, 1]),
        ..MissionState::default()
    }
}

#[test]
fn station_orders_and_repetitions() {
    let mut orders = StationOrders::default();
    let answered = |orders: &mut StationOrders, s, c| orders.received(at(s), STATION, &new(c), FREE);
    let land = MavCmd::MAV_CMD_USER_1;
    let abort = MavCmd::MAV_CMD_USER_2;
    assert_eq!(
        answered(&mut orders, 9.9, MavCmd::MAV_CMD_DO_SET_MODE),
        Answered(Unsupported)
    );
    assert_eq!(answered(&mut orders, 9.9, land), Order(CommandKind::Land));
    assert_eq!(orders.give(LAND, STATION, given(1, 10.0)), None);
    assert_eq!(answered(&mut orders, 10.0, land), Answered(InProgress));
    // An abort replaces the order and blocks others.
    assert_eq!(answered(&mut orders, 10.1, abort), Order(CommandKind::Abort));
    let replaced = orders.give((abort, CommandKind::Abort), STATION, given(2, 10.1));
    assert_eq!(replaced.map(|a| (a.number, a.result)), Some((land, Cancelled)));
    assert!(orders.aborts());
    assert_eq!(answered(&mut orders, 10.2, land), REJECTED);
}

#[test]
fn station_orders_unaware_of_an_abort() {
    let mut orders = StationOrders::default();
    orders.stopped(at(10.0));
    let lands = |orders: &mut StationOrders, s, repetition| {
        orders.received(at(s), STATION, &asked(MavCmd::MAV_CMD_USER_1, repetition), FREE)
    };
    let ordered = Order(CommandKind::Land);
    let first = Repetition::No;
    assert_eq!(
        [lands(&mut orders, 10.5, first), lands(&mut orders, 11.5, first)],
        [REJECTED, ordered]
    );
    // Certain and possible repetitions of an earlier order.
    for again in [Repetition::Yes, Repetition::Perhaps] {
        assert_eq!(
            [lands(&mut orders, 13.0, again), lands(&mut orders, 26.0, again)],
            [REJECTED, ordered]
        );
    }
    assert_eq!(
        orders.received(at(30.0), STATION, &new(MavCmd::MAV_CMD_USER_1), BARRED),
        REJECTED
    );
    assert_eq!(
        orders.received(at(10.1), STATION, &new(MavCmd::MAV_CMD_USER_2), BARRED),
        Order(CommandKind::Abort)
    );
}

#[test]
fn station_order_whose_answer_was_lost() {
    let mut orders = StationOrders::default();
    let again = |orders: &mut StationOrders, s, from, repetition| {
        orders.received(at(s), from, &asked(MavCmd::MAV_CMD_USER_1, repetition), FREE)
    };
    let ordered = Order(CommandKind::Land);
    // A repetition after a lost answer is answered again without a new order.
    orders.give(LAND, STATION, given(1, 30.0));
    assert!(orders.poll(at(31.0), Some(&tracking(31.0))).1.is_some());
    assert_eq!(
        again(&mut orders, 33.0, STATION, Repetition::Yes),
        Answered(Accepted)
    );
    // Another station, a new order, and a possible repetition.
    let other = Address::new(254, 190);
    for (from, repetition) in [
        (other, Repetition::Yes),
        (STATION, Repetition::No),
        (STATION, Repetition::Perhaps),
    ] {
        assert_eq!(again(&mut orders, 33.0, from, repetition), ordered);
    }
    // The previous answer is not reused after the landing has been stopped.
    orders.stopped(at(34.0));
    assert_eq!(again(&mut orders, 35.5, STATION, Repetition::Yes), REJECTED);
}

#[test]
fn station_order_rejected_and_repeated() {
    let mut orders = StationOrders::default();
    orders.give(LAND, STATION, given(1, 10.0));
    let (_, answer) = orders.poll(at(16.0), None);
    assert_eq!(answer.map(|a| a.result), Some(Failed));
    for (repetition, expected) in [
        (Repetition::Yes, Answered(Failed)),
        (Repetition::No, Order(CommandKind::Land)),
        (Repetition::Perhaps, Order(CommandKind::Land)),
    ] {
        let received = orders.received(
            at(17.0),
            STATION,
            &asked(MavCmd::MAV_CMD_USER_1, repetition),
            FREE,
        );
        assert_eq!(received, expected, "{repetition:?}");
    }
}

#[test]
fn station_abort_after_a_landing_from_elsewhere() {
    let mut orders = StationOrders::default();
    let header = given(1, 10.0);
    orders.give((MavCmd::MAV_CMD_USER_2, CommandKind::Abort), STATION, header);
    let mission = MissionState {
        abort: Some([header.boot, header.sequence]),
        order: None,
        ..tracking(10.1)
    };
    let (_, answer) = orders.poll(at(10.1), Some(&mission));
    assert_eq!(answer.map(|a| a.result), Some(Accepted));
    // The stations do not know of a landing that another operator orders.
    for repetition in [Repetition::No, Repetition::Yes, Repetition::Perhaps] {
        let received = orders.received(
            at(20.0),
            STATION,
            &asked(MavCmd::MAV_CMD_USER_2, repetition),
            FREE,
        );
        assert_eq!(received, Order(CommandKind::Abort), "{repetition:?}");
    }
}

#[test]
fn station_order_answered_to_all_who_gave_it() {
    let mut orders = StationOrders::default();
    orders.give(LAND, STATION, given(1, 10.0));
    let others: Vec<Address> = (1..9).map(|k| Address::new(k, 190)).collect();
    for other in [&STATION].into_iter().chain(&others) {
        let answered = orders.received(at(10.1), *other, &new(MavCmd::MAV_CMD_USER_1), FREE);
        assert_eq!(answered, Answered(InProgress));
    }
    let (_, answer) = orders.poll(at(20.0), None);
    let reported: Vec<MavlinkMessage> = answer.iter().flat_map(Answer::messages).collect();
    let expected =
        [STATION, others[0], others[1], others[2]].map(|to| command_ack(MavCmd::MAV_CMD_USER_1, Failed, to));
    assert_eq!(reported, expected);
}

#[test]
fn station_order_answers() {
    let mission = |waiting: ReasonCode, order| MissionState {
        header: Header::new(0, 1, 5, 1, at(11.0)),
        state: State::Idle,
        waiting: waiting.into(),
        order,
        ..MissionState::default()
    };
    let result = |mission: Option<&MissionState>| {
        let mut orders = StationOrders::default();
        orders.give(LAND, STATION, given(1, 10.0));
        let mut published = 0;
        let mut answers = Vec::new();
        for k in 0..600 {
            let (command, a) = orders.poll(at(10.0 + 0.01 * f64::from(k)), mission);
            published += usize::from(command.is_some());
            answers.extend(a);
        }
        let answer = answers.pop().unwrap();
        let under_way = answers.iter().all(|a| a.result == InProgress);
        assert!(under_way && answers.len() == published.min(5), "{answers:?}");
        (published, answer.result, answer.text.unwrap_or_default())
    };
    assert_eq!(
        result(Some(&mission(ReasonCode::NotFlying, Some([7, 1])))),
        (0, Accepted, String::new())
    );
    let (published, rejections, text) = result(Some(&mission(ReasonCode::Operator, None)));
    assert_eq!((published, rejections), (21, TemporarilyRejected));
    assert!(text.starts_with("a landing was ignored: Idle"), "{text}");
    assert_eq!(
        result(None),
        (21, Failed, "a landing was ignored: no mission reports".into())
    );
}

#[test]
fn station_of_a_command() {
    let ordered = |first| {
        let number = MavCmd::MAV_CMD_USER_4;
        StationCommand {
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
    // A console sends 0 for omitted parameters.
    assert_eq!(ordered([0.0; 4]), Ok(CommandKind::Station(Station::USUAL)));
    assert_eq!(ordered([25.0, 0.0, 0.0, 5.0]), kept(25, 0, 20, 5));
    assert_eq!(ordered([0.0, 30.0, 0.0, 0.0]), kept(0, 30, 0, 10));
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
        [20.0, 0.3, 0.2, 10.0],
        [20.0, 0.0, 0.4, 10.0],
        [20.0, 0.0, 20.0, 0.4],
        [20.0, 0.0, 20.0, 31.0],
        [20.0, 0.0, 20.0, -1.0],
    ] {
        assert_eq!(ordered(wrong), Err(Denied), "{wrong:?}");
    }
}

#[test]
fn orders_of_an_unsigned_link() {
    let mut orders = StationOrders::default();
    let unsigned = [false, false];
    for (number, expected) in [
        (MavCmd::MAV_CMD_USER_1, Rejected(Denied, UNSIGNED)),
        (MavCmd::MAV_CMD_USER_3, Rejected(Denied, UNSIGNED)),
        (MavCmd::MAV_CMD_USER_4, Rejected(Denied, UNSIGNED)),
        (MavCmd::MAV_CMD_NAV_TAKEOFF, Rejected(Denied, UNSIGNED)),
        (MavCmd::MAV_CMD_USER_2, Order(CommandKind::Abort)),
        (MavCmd::MAV_CMD_DO_SET_MODE, Answered(Unsupported)),
    ] {
        assert_eq!(
            orders.received(at(9.0), STATION, &new(number), unsigned),
            expected
        );
    }
}

#[test]
fn station_in_place_of_another() {
    let mut orders = StationOrders::default();
    let right = |m| StationCommand {
        first: [0.0, 0.0, m, 0.0],
        ..new(MavCmd::MAV_CMD_USER_4)
    };
    let Order(first) = orders.received(at(10.0), STATION, &right(20.0), FREE) else {
        panic!("no order");
    };
    orders.give((MavCmd::MAV_CMD_USER_4, first), STATION, given(1, 10.0));
    let again = orders.received(at(10.1), STATION, &right(20.0), FREE);
    assert_eq!(again, Answered(InProgress));
    let other = orders.received(at(10.2), STATION, &right(30.0), FREE);
    assert!(matches!(other, Order(kind) if kind != first), "{other:?}");
}

/// The mission also acknowledges orders that it rejects; the answer gives the full reason.
#[test]
fn station_order_that_the_mission_rejects() {
    let station = (MavCmd::MAV_CMD_USER_4, CommandKind::Station(Station::USUAL));
    for (order, state, code, text) in [
        (
            station,
            State::Tracking,
            ReasonCode::StationNotNow,
            "no station from here: ",
        ),
        (
            LAND,
            State::Landed,
            ReasonCode::OnDeck,
            "no landing: the drone stands on the deck",
        ),
    ] {
        let mut orders = StationOrders::default();
        let header = given(1, 10.0);
        orders.give(order, STATION, header);
        let mission = MissionState {
            state,
            order: Some([header.boot, header.sequence]),
            rejected: Some(code.into()),
            ..tracking(10.1)
        };
        let (_, answer) = orders.poll(at(10.1), Some(&mission));
        let answer = answer.unwrap();
        assert_eq!(answer.result, TemporarilyRejected);
        assert!(answer.text.unwrap().starts_with(text));
    }
}
