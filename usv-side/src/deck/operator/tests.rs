use super::*;
use alight_shared::{
    msg::{Reason, ReasonCode, State},
    time::Time,
};
use proptest::prelude::*;

fn command(sequence: u32, drone: u32, kind: CommandKind) -> OperatorCommand<VesselClock> {
    OperatorCommand {
        header: Header::new(1, drone, 5, sequence, Time::EPOCH),
        kind,
    }
}
fn given(message: OperatorCommand<VesselClock>) -> Arrival<VesselClock, OperatorCommand<VesselClock>> {
    Arrival {
        at: Time::EPOCH,
        sender: Sender::Operator(1),
        message,
    }
}
fn relay_of(boot: u32) -> OperatorRelay {
    let mut relay = OperatorRelay::new(1, boot);
    relay.admit([3]);
    relay
}
fn status(state: State, waiting: ReasonCode) -> DroneStatus {
    DroneStatus {
        header: Header::new(1, 3, 1, 1, Time::EPOCH),
        state,
        waiting: Reason::plain(waiting),
        ..DroneStatus::default()
    }
}

/// Status of a mission that has received the relay's newest repetition.
fn echo(relay: &OperatorRelay) -> Option<DroneStatus> {
    Some(DroneStatus {
        abort: Some([relay.boot, relay.sequence]),
        ..status(State::GaveUp, ReasonCode::NotCommanded)
    })
}

/// Relay of the next process at `t_s` with the state of this one, and its first output.
fn restarted(before: &OperatorRelay, t_s: f64) -> (OperatorRelay, OperatorOut) {
    let mut relay = relay_of(before.boot + 1);
    let input = OperatorIn {
        given: before.given(),
        ..OperatorIn::default()
    };
    let out = relay.step(Time::from_secs(t_s), &input);
    (relay, out)
}

fn stepped(
    relay: &mut OperatorRelay,
    t_s: f64,
    command: Option<OperatorCommand<VesselClock>>,
    status: Option<DroneStatus>,
) -> OperatorOut {
    let input = OperatorIn {
        commands: command.map(given).into_iter().collect(),
        statuses: status.into_iter().collect(),
        ..OperatorIn::default()
    };
    relay.step(Time::from_secs(t_s), &input)
}

fn step(
    relay: &mut OperatorRelay,
    t_s: f64,
    command: Option<OperatorCommand<VesselClock>>,
    status: Option<DroneStatus>,
) -> (bool, Vec<CommandKind>) {
    let out = stepped(relay, t_s, command, status);
    let sent = out.commands.iter().map(|c| c.kind).collect();
    (!out.accepted.is_empty(), sent)
}

#[test]
fn relayed_command_until_acknowledged() {
    let mut relay = relay_of(9);
    let land = Some(command(1, 3, CommandKind::Land));
    let idle = Some(status(State::Idle, ReasonCode::NotCommanded));
    let (accepted, sent) = step(&mut relay, 1.0, land, idle);
    assert!(accepted && sent.len() == 1);
    assert!(!step(&mut relay, 1.1, land, None).0, "a repetition");
    let sent: usize = (11..30)
        .map(|k| step(&mut relay, f64::from(k) * 0.1, None, idle).1.len())
        .sum();
    assert_eq!(sent, 3);
    let climbing = status(State::GetAltitude, ReasonCode::TooFar);
    assert_eq!(step(&mut relay, 3.0, None, Some(climbing)).1, [CommandKind::Land]);
    let climbing = Some(DroneStatus {
        order: Some([relay.boot, relay.sequence]),
        ..climbing
    });
    assert!(step(&mut relay, 3.5, None, climbing).1.is_empty());
    assert!(step(&mut relay, 4.0, None, None).1.is_empty());
    assert_eq!(relay.rejected().total(), 0);
}

/// Receipts of a step: boot, sequence and progress.
fn receipts(
    relay: &mut OperatorRelay,
    t_s: f64,
    command: Option<OperatorCommand<VesselClock>>,
    status: Option<DroneStatus>,
) -> Vec<(u32, u32, CommandProgress)> {
    let out = stepped(relay, t_s, command, status);
    assert!(
        out.receipts
            .iter()
            .all(|r| r.header.vessel == 1 && r.header.drone == 3)
    );
    let reported = out
        .receipts
        .iter()
        .map(|r| (r.operator[0], r.operator[1], r.progress));
    reported.collect()
}

#[test]
fn receipts_of_a_command_in_every_progress() {
    use CommandProgress::{Forbidden, GivenUp, Pending, Replaced, Taken, Unknown};
    let mut relay = relay_of(9);
    let command_of = |sequence, kind| Some(command(sequence, 3, kind));
    let gave_up = Some(status(State::GaveUp, ReasonCode::NotCommanded));
    let abort = command_of(1, CommandKind::Abort);
    assert_eq!(receipts(&mut relay, 1.0, abort, gave_up), [(5, 1, Pending)]);
    assert_eq!(receipts(&mut relay, 1.1, None, gave_up), []);
    assert_eq!(receipts(&mut relay, 1.5, abort, gave_up), [(5, 1, Pending)]);
    assert_eq!(
        receipts(&mut relay, 1.6, command_of(2, CommandKind::Land), None),
        [(5, 2, Forbidden)]
    );
    let over = echo(&relay);
    assert_eq!(receipts(&mut relay, 2.0, None, over), [(5, 1, Taken)]);
    assert_eq!(receipts(&mut relay, 2.5, abort, None), [(5, 1, Taken)]);
    assert_eq!(
        receipts(&mut relay, 4.0, command_of(3, CommandKind::Land), None),
        [(5, 3, Pending)]
    );
    let hold = command_of(4, CommandKind::Hold);
    assert_eq!(
        receipts(&mut relay, 4.5, hold, None),
        [(5, 3, Replaced), (5, 4, Pending)]
    );
    assert_eq!(receipts(&mut relay, 14.6, None, None), [(5, 4, GivenUp)]);
    // A pending abort survives a restart; other commands are lost.
    assert_eq!(
        receipts(&mut relay, 15.0, command_of(5, CommandKind::Abort), None),
        [(5, 5, Pending)]
    );
    let (mut relay, _) = restarted(&relay, 16.0);
    assert_eq!(
        receipts(&mut relay, 16.5, command_of(5, CommandKind::Abort), None),
        [(5, 5, Pending)]
    );
    assert_eq!(receipts(&mut relay, 17.0, hold, None), [(5, 4, Unknown)]);
    let mut relay = relay_of(9);
    let ready = command_of(1, CommandKind::Ready);
    assert_eq!(receipts(&mut relay, 1.0, ready, None), [(5, 1, Pending)]);
    let rejected = DroneStatus {
        order: Some([relay.boot, relay.sequence]),
        rejected: Some(ReasonCode::SortiesDone.into()),
        ..status(State::Landed, ReasonCode::NotReady)
    };
    assert_eq!(receipts(&mut relay, 1.5, None, Some(rejected)), [(5, 1, GivenUp)]);
    // An abort that the drone receives but does not carry out; it counts as carried out if a newer order was rejected.
    for (order, progress) in [(None, GivenUp), (Some([3, 3]), Taken)] {
        let mut relay = relay_of(9);
        receipts(&mut relay, 1.0, abort, None);
        let rejected = DroneStatus {
            order,
            rejected: Some(ReasonCode::NotInControl.into()),
            ..echo(&relay).unwrap()
        };
        assert_eq!(
            receipts(&mut relay, 1.5, None, Some(rejected)),
            [(5, 1, progress)]
        );
    }
}

#[test]
fn landing_ordered_unaware_of_an_abort() {
    let command_of = |boot: u32, sequence: u32, kind: CommandKind| {
        let mut c = command(sequence, 3, kind);
        c.header.boot = boot;
        Some(c)
    };
    let mut relay = relay_of(9);
    let before = command_of(6, 1, CommandKind::Land);
    assert!(step(&mut relay, 1.0, before, None).0);
    assert!(step(&mut relay, 2.0, command_of(5, 1, CommandKind::Abort), None).0);
    let meanwhile = command_of(7, 1, CommandKind::Land);
    assert!(!step(&mut relay, 2.1, meanwhile, None).0);
    let over = echo(&relay);
    assert!(step(&mut relay, 2.4, None, over).1.is_empty());
    let just_after = command_of(8, 1, CommandKind::Land);
    assert!(!step(&mut relay, 2.9, just_after, None).0);
    assert_eq!(relay.rejected().total(), 2);
    for k in 0..24 {
        if k == 12 {
            relay = restarted(&relay, 8.9).0;
        }
        for repeated in [before, meanwhile, just_after] {
            let (accepted, sent) = step(&mut relay, 3.0 + 0.5 * f64::from(k), repeated, None);
            assert!(!accepted && sent.is_empty(), "{repeated:?}");
        }
    }
    assert!(step(&mut relay, 15.0, command_of(7, 2, CommandKind::Land), None).0);
    assert!(!step(&mut relay, 15.5, meanwhile, None).0);
}

#[test]
fn relay_time_limit_and_foreign_commands() {
    let mut relay = relay_of(9);
    assert!(!step(&mut relay, 1.0, Some(command(1, 0, CommandKind::Abort)), None).0);
    let mut other = command(2, 3, CommandKind::Abort);
    other.header.vessel = 2;
    assert!(!step(&mut relay, 1.0, Some(other), None).0);
    assert_eq!(relay.rejected().total(), 2);
    let hold = command(3, 3, CommandKind::Hold);
    let sent: usize = (0..100)
        .map(|k| {
            let given = (k == 0).then_some(hold);
            step(&mut relay, 1.0 + f64::from(k) * 0.5, given, None).1.len()
        })
        .sum();
    assert_eq!(sent, 21);
}

#[test]
fn relayed_abort_after_a_restart() {
    let mut relay = relay_of(9);
    let abort = Some(command(1, 3, CommandKind::Abort));
    assert!(step(&mut relay, 1.0, abort, None).0);
    let sent: usize = (1..1200)
        .map(|k| step(&mut relay, 1.0 + f64::from(k) * 0.5, None, None).1.len())
        .sum();
    assert_eq!(sent, 1199, "ten minutes without a radio");
    assert_eq!(relay.unacknowledged().collect::<Vec<_>>(), [3]);
    // The vessel's process restarts, then its computer, whose clock begins at zero.
    for (t_s, given_s) in [(700.0, 1.0), (0.5, 0.5)] {
        let (mut relay, out) = restarted(&relay, t_s);
        assert_eq!(out.commands.len(), 1);
        assert_eq!(out.commands[0].kind, CommandKind::Abort);
        assert_eq!(out.commands[0].header.at, Time::from_secs(given_s));
        let land = Some(command(2, 3, CommandKind::Land));
        assert!(!step(&mut relay, t_s + 0.1, land, None).0);
        let over = echo(&relay);
        assert!(step(&mut relay, t_s + 0.6, None, over).1.is_empty());
        assert_eq!(relay.unacknowledged().count(), 0);
    }
}

/// A climbing drone changes to hold in any case, so its state does not show whether it was stopped.
#[test]
fn hold_while_the_drone_climbs_out() {
    let mut relay = relay_of(9);
    let climbs = status(State::ClimbOut, ReasonCode::OffHeight);
    let hold = Some(command(1, 3, CommandKind::Hold));
    assert!(step(&mut relay, 1.0, hold, Some(climbs)).0);
    assert_eq!(step(&mut relay, 1.6, None, Some(climbs)).1, [CommandKind::Hold]);
    let echoed = DroneStatus {
        order: Some([9, 2]),
        ..climbs
    };
    assert!(step(&mut relay, 2.2, None, Some(echoed)).1.is_empty());
}

#[test]
fn relayed_command_time() {
    let mut relay = relay_of(4);
    let mut given = Vec::new();
    for k in 0..20 {
        let land = (k == 0).then(|| command(1, 3, CommandKind::Land));
        let input = OperatorIn {
            commands: land.map(self::given).into_iter().collect(),
            ..OperatorIn::default()
        };
        let out = relay.step(Time::from_secs(1.0 + 0.1 * f64::from(k)), &input);
        given.extend(out.commands.iter().map(|c| (c.header.at, c.header.sequence)));
    }
    let at = Time::from_secs(1.0);
    assert_eq!(given, [(at, 1), (at, 2), (at, 3), (at, 4)]);
}

/// The vessel's process restarts during a terminal's landing order, and the pilot aborts on the drone.
#[test]
fn relayed_command_time_after_a_restart() {
    let mut relay = relay_of(9);
    let land = Some(command(1, 3, CommandKind::Land));
    assert!(step(&mut relay, 1.0, land, None).0);
    let (mut relay, out) = restarted(&relay, 3.0);
    assert_eq!(out.commands[0].header.at, Time::from_secs(1.0));
    assert_eq!(step(&mut relay, 3.1, land, None), (false, vec![]));
    let sent: usize = (0..20)
        .map(|k| step(&mut relay, 3.2 + 0.5 * f64::from(k), land, None).1.len())
        .sum();
    assert_eq!(sent, 15, "10 s after it was given");
    assert!(step(&mut relay, 14.0, Some(command(2, 3, CommandKind::Land)), None).0);
    // A restarted computer has lost the time of the command, and starts no landing.
    let (mut relay, out) = restarted(&relay, 0.5);
    assert!(out.commands.is_empty());
    assert!(!step(&mut relay, 1.0, Some(command(2, 3, CommandKind::Land)), None).0);
}

#[test]
fn replaced_command() {
    let mut relay = relay_of(9);
    let [land, mut hold] = [CommandKind::Land, CommandKind::Hold].map(|kind| command(1, 3, kind));
    hold.header.boot = 6;
    assert!(step(&mut relay, 1.0, Some(land), None).0);
    assert_eq!(
        step(&mut relay, 1.2, Some(hold), None),
        (true, vec![CommandKind::Hold])
    );
    assert!(!step(&mut relay, 1.5, Some(land), None).0);
    assert_eq!(step(&mut relay, 1.7, None, None).1, [CommandKind::Hold]);
}

/// Delay, ms, and a later order of another operator for an admitted or another drone.
fn other_command() -> impl Strategy<Value = (u32, OperatorCommand<VesselClock>)> {
    let kind = prop_oneof![3 => Just(CommandKind::Abort), 1 => Just(CommandKind::Land), 1 => Just(CommandKind::Hold)];
    let drone = prop_oneof![1 => Just(3_u32), 99 => 1_u32..200];
    (1_u32..600, drone, 1_u32..4, kind)
        .prop_map(|(wait_ms, drone, sequence, kind)| (wait_ms, command(sequence, drone, kind)))
}

proptest! {
    /// An abort is relayed after any commands of others and any restarts, even if a command has its boot and sequence.
    #[test]
    fn abort_after_any_orders_of_others(
        orders in prop::collection::vec(other_command(), 0..400),
        restarts in prop::collection::vec(0_usize..400, 0..3),
        sequence in 1_u32..4,
    ) {
        let mut relay = relay_of(9);
        relay.admit(1..=MAX_DRONES as u32);
        let mut t_ms = 1000;
        for (k, (wait_ms, message)) in orders.into_iter().enumerate() {
            t_ms += i64::from(wait_ms);
            let mut input = OperatorIn { commands: vec![given(message)], ..OperatorIn::default() };
            if restarts.contains(&k) {
                input.given = relay.given();
                relay = OperatorRelay::new(1, relay.boot + 1);
                relay.admit(1..=MAX_DRONES as u32);
            }
            relay.step(Time::from_nanos(t_ms * 1_000_000), &input);
        }
        let abort = Arrival {
            sender: Sender::Operator(2),
            ..given(command(sequence, 3, CommandKind::Abort))
        };
        let input = OperatorIn { commands: vec![abort], ..OperatorIn::default() };
        let out = relay.step(Time::from_nanos(t_ms * 1_000_000), &input);
        prop_assert_eq!(out.accepted, vec![abort.message]);
        prop_assert_eq!(out.commands.iter().filter(|c| c.header.drone == 3).count(), 1);
        prop_assert!(relay.unacknowledged().any(|drone| drone == 3));
        prop_assert!(relay.unacknowledged().count() <= MAX_DRONES);
    }
}
