//! The operator relay: operators' commands on their way through the vessel to its drones.
//!
//! A command is sent to its drone at 2 Hz until the drone's status echoes it, for 10 s at most; an abort for as long as it takes. While an abort has not shown its effect, no other command reaches that drone,
//! and none that was given until then, nor a landing that somebody else orders within a second of it, counts afterwards.
//! Each repetition bears the time at which the command was given: what the drone was commanded since, by whomever, is newer.
//!
//! An operator's terminal repeats its command for 12 s. The relay knows the commands that it was given, and when, also
//! after a new start of the vessel's process ([`GivenCommand`]).
//!
//! To each of an operator's messages, and whenever it changes, the relay answers how far that command has come
//! ([`CommandReceipt`]): a state of the drone that fits it by chance is no answer, and silence does not tell whether an
//! abort is pending.

use std::collections::VecDeque;

use alight_shared::admission::{RejectionReason, Rejections, check_identity};
use alight_shared::msg::{
    CommandKind, CommandProgress, CommandReceipt, DroneStatus, Header, OperatorCommand,
};
use alight_shared::node::Node;
use alight_shared::time::{Span, Time, VesselClock};
use serde::{Deserialize, Serialize};

use super::MAX_DRONES;
use super::checkpoint::GivenCommand;

/// Time between two repetitions.
const REPEAT_PERIOD: Span = Span::from_millis(500);
/// A command other than an abort that shows no effect is given up after this long.
const TIMEOUT: Span = Span::from_millis(10_000);
/// Most commands that are known.
const MAX_COMMANDS: usize = 4 * MAX_DRONES;

/// A command and its repetitions to the drone.
#[derive(Clone, Copy, Debug)]
struct Relayed {
    given: GivenCommand,
    next: Time<VesselClock>,
    /// Sequence that the first of its repetitions has at least.
    first: u32,
    progress: CommandProgress,
}

impl Relayed {
    fn drone(&self) -> u32 {
        self.given.command.header.drone
    }
    /// It is not repeated any more, for this reason.
    fn close(&mut self, progress: CommandProgress) {
        (self.given.open, self.progress) = (false, progress);
    }
    /// Whether it is the same command of the same operator.
    fn is_of(&self, h: &Header<VesselClock>) -> bool {
        let known = &self.given.command.header;
        (known.drone, known.boot, known.sequence) == (h.drone, h.boot, h.sequence)
    }
    /// Whether this abort keeps another command away.
    fn forbids(&self, command: &OperatorCommand<VesselClock>) -> bool {
        let GivenCommand { command: own, open } = &self.given;
        let other = own.kind == CommandKind::Abort && command.kind != CommandKind::Abort;
        self.drone() == command.header.drone && other && (*open || command.is_unaware_of(&own.header))
    }
}

/// What arrived since the last step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct OperatorIn {
    /// From operators whose certificates were accepted.
    pub commands: Vec<OperatorCommand<VesselClock>>,
    /// From drones.
    pub statuses: Vec<DroneStatus>,
    /// At the first step, the commands that the former start knew.
    pub given: Vec<GivenCommand>,
}

/// What the relay sends and has accepted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OperatorOut {
    /// Commands of this step that were new and valid, as the operators gave them.
    pub accepted: Vec<OperatorCommand<VesselClock>>,
    /// For the drones that their headers name.
    pub commands: Vec<OperatorCommand<VesselClock>>,
    /// For operators.
    pub receipts: Vec<CommandReceipt>,
}

/// The node that passes commands on.
#[derive(Clone, Debug)]
pub struct OperatorRelay {
    vessel: u32,
    boot: u32,
    sequence: u32,
    /// In the order in which they came; of a drone's one at most is open.
    commands: VecDeque<Relayed>,
    rejected: Rejections,
    /// Sequence of the receipts.
    receipts: u32,
}

impl OperatorRelay {
    /// The relay of vessel `vessel`, which started with this boot id.
    pub fn new(vessel: u32, boot: u32) -> OperatorRelay {
        OperatorRelay {
            vessel,
            boot,
            sequence: 0,
            commands: VecDeque::new(),
            rejected: Rejections::default(),
            receipts: 0,
        }
    }
    /// Commands that were not passed on, by reason.
    pub fn rejected(&self) -> &Rejections {
        &self.rejected
    }
    /// Drones that have not acknowledged an abort.
    pub fn unacknowledged(&self) -> impl Iterator<Item = u32> {
        let pending = |c: &&Relayed| c.given.open && c.given.command.kind == CommandKind::Abort;
        self.commands.iter().filter(pending).map(Relayed::drone)
    }
    /// The commands that it knows, for the next start.
    pub fn given(&self) -> Vec<GivenCommand> {
        self.commands.iter().map(|c| c.given).collect()
    }

    fn restore(&mut self, now: Time<VesselClock>, given: &[GivenCommand]) {
        for before in given.iter().take(MAX_COMMANDS) {
            let mut restored = *before;
            let header = &mut restored.command.header;
            // A computer that was started anew counts its time from zero: when it was given is not known any more.
            if header.at > now {
                header.at = now;
                restored.open &= restored.command.kind == CommandKind::Abort;
            }
            let progress = if restored.open {
                CommandProgress::Pending
            } else {
                CommandProgress::Unknown
            };
            self.push(now, restored, progress);
        }
    }
    fn push(&mut self, now: Time<VesselClock>, given: GivenCommand, progress: CommandProgress) {
        if self.commands.len() >= MAX_COMMANDS {
            let spare = self.commands.iter().position(|c| !c.given.open);
            self.commands.remove(spare.unwrap_or(0));
        }
        self.commands.push_back(Relayed {
            given,
            next: now,
            first: self.sequence.wrapping_add(1),
            progress,
        });
    }

    /// Takes an operator's command, or gives the reason why it does not count.
    fn accept(
        &mut self,
        now: Time<VesselClock>,
        command: &OperatorCommand<VesselClock>,
    ) -> Result<(), RejectionReason> {
        let h = &command.header;
        if self.commands.iter().any(|c| c.is_of(h)) {
            return Err(RejectionReason::Duplicate);
        }
        check_identity(h, self.vessel, h.drone)?;
        if h.drone == 0 {
            return Err(RejectionReason::Drone);
        }
        let replaced = |c: &Relayed| c.given.open && c.drone() == h.drone;
        let open = self.commands.iter().filter(|c| c.given.open).count();
        if open >= MAX_DRONES && !self.commands.iter().any(replaced) {
            return Err(RejectionReason::Flood);
        }
        let command = OperatorCommand {
            header: Header { at: now, ..*h },
            ..*command
        };
        // Also one that does not count is known: its repetitions do not count later.
        let forbidden = self.commands.iter().any(|c| c.forbids(&command));
        for c in self.commands.iter_mut().filter(|c| !forbidden && replaced(c)) {
            c.close(CommandProgress::Replaced);
        }
        let (open, progress) = if forbidden {
            (false, CommandProgress::Forbidden)
        } else {
            (true, CommandProgress::Pending)
        };
        self.push(now, GivenCommand { command, open }, progress);
        if forbidden {
            return Err(RejectionReason::Unaware);
        }
        Ok(())
    }

    /// The receipts of the commands that have changed since they stood so, and of those that an operator has just sent.
    fn answer(
        &mut self,
        now: Time<VesselClock>,
        before: &[(Header<VesselClock>, CommandProgress)],
        sent: &[OperatorCommand<VesselClock>],
    ) -> Vec<CommandReceipt> {
        let mut receipts = Vec::new();
        for c in &self.commands {
            let changed = before.iter().any(|(h, p)| c.is_of(h) && c.progress != *p);
            if changed || sent.iter().any(|s| c.is_of(&s.header)) {
                self.receipts = self.receipts.wrapping_add(1);
                let command = &c.given.command;
                receipts.push(CommandReceipt {
                    header: Header::new(self.vessel, c.drone(), self.boot, self.receipts, now),
                    operator: [command.header.boot, command.header.sequence],
                    kind: command.kind,
                    progress: c.progress,
                });
            }
        }
        receipts
    }

    /// What a status shows that became of a command; None: nothing.
    fn shown(&self, c: &Relayed, status: &DroneStatus) -> Option<CommandProgress> {
        let command = &c.given.command;
        let is_own = |[boot, k]: [u32; 2]| boot == self.boot && k >= c.first;
        let answer = status.echo().answers(command.kind, is_own)?;
        (status.header.drone == c.drone()).then_some(if answer {
            CommandProgress::Taken
        } else {
            CommandProgress::GivenUp
        })
    }
}

impl Node for OperatorRelay {
    type Clock = VesselClock;
    type In = OperatorIn;
    type Out = OperatorOut;

    fn step(&mut self, now: Time<VesselClock>, input: &OperatorIn) -> OperatorOut {
        self.restore(now, &input.given);
        let standing = |c: &Relayed| (c.given.command.header, c.progress);
        let before: Vec<_> = self.commands.iter().map(standing).collect();
        let mut out = OperatorOut::default();
        for command in &input.commands {
            match self.accept(now, command) {
                Ok(()) => out.accepted.push(*command),
                // A terminal repeats its command as long as it runs.
                Err(RejectionReason::Duplicate) => {}
                Err(reason) => self.rejected.count(reason),
            }
        }
        for k in 0..self.commands.len() {
            let Some(mut c) = self.commands.get(k).copied().filter(|c| c.given.open) else {
                continue;
            };
            let command = c.given.command;
            let given_up = command.kind != CommandKind::Abort && now - command.header.at > TIMEOUT;
            let shown = input.statuses.iter().find_map(|s| self.shown(&c, s));
            if let Some(shown) = shown {
                c.close(shown);
            } else if given_up {
                c.close(CommandProgress::GivenUp);
            }
            if c.given.open && now >= c.next {
                c.next = now + REPEAT_PERIOD;
                self.sequence = self.sequence.wrapping_add(1);
                let (drone, at) = (c.drone(), command.header.at);
                out.commands.push(OperatorCommand {
                    header: Header::new(self.vessel, drone, self.boot, self.sequence, at),
                    kind: command.kind,
                });
            }
            if let Some(slot) = self.commands.get_mut(k) {
                *slot = c;
            }
        }
        out.receipts = self.answer(now, &before, &input.commands);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{Reason, ReasonCode, State};

    fn command(sequence: u32, drone: u32, kind: CommandKind) -> OperatorCommand<VesselClock> {
        OperatorCommand {
            header: Header::new(1, drone, 5, sequence, Time::EPOCH),
            kind,
        }
    }
    fn status(state: State, waiting: ReasonCode) -> DroneStatus {
        DroneStatus {
            header: Header::new(1, 3, 1, 1, Time::EPOCH),
            state,
            waiting: Reason::plain(waiting),
            ..DroneStatus::default()
        }
    }

    /// A status of a mission that has received the newest repetition.
    fn echo(relay: &OperatorRelay) -> Option<DroneStatus> {
        Some(DroneStatus {
            abort: Some([relay.boot, relay.sequence]),
            ..status(State::GaveUp, ReasonCode::NotCommanded)
        })
    }

    /// The relay of the vessel's next process at `t_s`, with what this one leaves, and what it sends at once.
    fn restarted(before: &OperatorRelay, t_s: f64) -> (OperatorRelay, OperatorOut) {
        let mut relay = OperatorRelay::new(1, before.boot + 1);
        let input = OperatorIn {
            given: before.given(),
            ..OperatorIn::default()
        };
        let out = relay.step(Time::from_secs(t_s), &input);
        (relay, out)
    }

    /// Steps the relay with at most one command and one status.
    fn step(
        relay: &mut OperatorRelay,
        t_s: f64,
        command: Option<OperatorCommand<VesselClock>>,
        status: Option<DroneStatus>,
    ) -> (bool, Vec<CommandKind>) {
        let input = OperatorIn {
            commands: command.into_iter().collect(),
            statuses: status.into_iter().collect(),
            ..OperatorIn::default()
        };
        let out = relay.step(Time::from_secs(t_s), &input);
        let sent = out.commands.iter().map(|c| c.kind).collect();
        (!out.accepted.is_empty(), sent)
    }

    #[test]
    fn relayed_command_until_acknowledged() {
        let mut relay = OperatorRelay::new(1, 9);
        let land = Some(command(1, 3, CommandKind::Land));
        let idle = Some(status(State::Idle, ReasonCode::NotCommanded));
        let (accepted, sent) = step(&mut relay, 1.0, land, idle);
        assert!(accepted && sent.len() == 1);
        assert!(!step(&mut relay, 1.1, land, None).0, "a repetition");
        let sent: usize = (11..30)
            .map(|k| step(&mut relay, f64::from(k) * 0.1, None, idle).1.len())
            .sum();
        assert_eq!(sent, 3);
        // It climbs for another order, as far as is known.
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

    /// Receipts for operators in a step: boot, sequence and progress.
    fn receipts(
        relay: &mut OperatorRelay,
        t_s: f64,
        command: Option<OperatorCommand<VesselClock>>,
        status: Option<DroneStatus>,
    ) -> Vec<(u32, u32, CommandProgress)> {
        let input = OperatorIn {
            commands: command.into_iter().collect(),
            statuses: status.into_iter().collect(),
            ..OperatorIn::default()
        };
        let out = relay.step(Time::from_secs(t_s), &input);
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
        let mut relay = OperatorRelay::new(1, 9);
        let of = |sequence, kind| Some(command(sequence, 3, kind));
        let gave_up = Some(status(State::GaveUp, ReasonCode::NotCommanded));
        // A drone that gave up before is no answer to an abort.
        let abort = of(1, CommandKind::Abort);
        assert_eq!(receipts(&mut relay, 1.0, abort, gave_up), [(5, 1, Pending)]);
        assert_eq!(receipts(&mut relay, 1.1, None, gave_up), []);
        // Each repetition by the terminal is answered.
        assert_eq!(receipts(&mut relay, 1.5, abort, gave_up), [(5, 1, Pending)]);
        assert_eq!(
            receipts(&mut relay, 1.6, of(2, CommandKind::Land), None),
            [(5, 2, Forbidden)]
        );
        let over = echo(&relay);
        assert_eq!(receipts(&mut relay, 2.0, None, over), [(5, 1, Taken)]);
        assert_eq!(receipts(&mut relay, 2.5, abort, None), [(5, 1, Taken)]);
        assert_eq!(
            receipts(&mut relay, 4.0, of(3, CommandKind::Land), None),
            [(5, 3, Pending)]
        );
        let hold = of(4, CommandKind::Hold);
        assert_eq!(
            receipts(&mut relay, 4.5, hold, None),
            [(5, 3, Replaced), (5, 4, Pending)]
        );
        assert_eq!(receipts(&mut relay, 14.6, None, None), [(5, 4, GivenUp)]);
        // An abort that is pending stays so through a restart; of the others the next process knows no more.
        assert_eq!(
            receipts(&mut relay, 15.0, of(5, CommandKind::Abort), None),
            [(5, 5, Pending)]
        );
        let (mut relay, _) = restarted(&relay, 16.0);
        assert_eq!(
            receipts(&mut relay, 16.5, of(5, CommandKind::Abort), None),
            [(5, 5, Pending)]
        );
        assert_eq!(receipts(&mut relay, 17.0, hold, None), [(5, 4, Unknown)]);
        // What the drone acknowledges and rejects is not repeated.
        let mut relay = OperatorRelay::new(1, 9);
        let ready = of(1, CommandKind::Ready);
        assert_eq!(receipts(&mut relay, 1.0, ready, None), [(5, 1, Pending)]);
        let rejected = DroneStatus {
            order: Some([relay.boot, relay.sequence]),
            rejected: Some(ReasonCode::SortiesDone.into()),
            ..status(State::Landed, ReasonCode::NotReady)
        };
        assert_eq!(receipts(&mut relay, 1.5, None, Some(rejected)), [(5, 1, GivenUp)]);
        // So is an abort that the drone receives and does not carry out, unless a newer order is what it rejects.
        for (order, progress) in [(None, GivenUp), (Some([3, 3]), Taken)] {
            let mut relay = OperatorRelay::new(1, 9);
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
    fn relayed_commands_behind_an_abort() {
        let mut relay = OperatorRelay::new(1, 9);
        let [land, abort, again, last] = [
            (1, CommandKind::Land),
            (2, CommandKind::Abort),
            (3, CommandKind::Land),
            (4, CommandKind::Land),
        ]
        .map(|(sequence, kind)| Some(command(sequence, 3, kind)));
        assert_eq!(step(&mut relay, 1.0, land, None), (true, vec![CommandKind::Land]));
        assert_eq!(
            step(&mut relay, 1.2, abort, None),
            (true, vec![CommandKind::Abort])
        );
        assert!(!step(&mut relay, 1.3, again, None).0);
        let descent = Some(status(State::Descent, ReasonCode::TooFar));
        assert_eq!(step(&mut relay, 1.8, None, descent).1, [CommandKind::Abort]);
        // It gave up before, as a status shows that was under way.
        let before = Some(status(State::GaveUp, ReasonCode::NotCommanded));
        assert_eq!(step(&mut relay, 2.3, None, before).1, [CommandKind::Abort]);
        let over = echo(&relay);
        assert!(step(&mut relay, 2.4, None, over).1.is_empty());
        assert!(step(&mut relay, 2.5, last, None).0);
        assert_eq!(relay.rejected().total(), 1);
    }

    #[test]
    fn landing_ordered_unaware_of_an_abort() {
        let of = |boot: u32, sequence: u32, kind: CommandKind| {
            let mut c = command(sequence, 3, kind);
            c.header.boot = boot;
            Some(c)
        };
        let mut relay = OperatorRelay::new(1, 9);
        let before = of(6, 1, CommandKind::Land);
        assert!(step(&mut relay, 1.0, before, None).0);
        assert!(step(&mut relay, 2.0, of(5, 1, CommandKind::Abort), None).0);
        let meanwhile = of(7, 1, CommandKind::Land);
        assert!(!step(&mut relay, 2.1, meanwhile, None).0);
        let over = echo(&relay);
        assert!(step(&mut relay, 2.4, None, over).1.is_empty());
        let just_after = of(8, 1, CommandKind::Land);
        assert!(!step(&mut relay, 2.9, just_after, None).0);
        assert_eq!(relay.rejected().total(), 2);
        // Their terminals repeat them, also to the vessel's next process.
        for k in 0..24 {
            if k == 12 {
                relay = restarted(&relay, 8.9).0;
            }
            for repeated in [before, meanwhile, just_after] {
                let (accepted, sent) = step(&mut relay, 3.0 + 0.5 * f64::from(k), repeated, None);
                assert!(!accepted && sent.is_empty(), "{repeated:?}");
            }
        }
        assert!(step(&mut relay, 15.0, of(7, 2, CommandKind::Land), None).0);
        assert!(!step(&mut relay, 15.5, meanwhile, None).0);
    }

    #[test]
    fn relay_time_limit_and_foreign_commands() {
        let mut relay = OperatorRelay::new(1, 9);
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
        let mut relay = OperatorRelay::new(1, 9);
        let abort = Some(command(1, 3, CommandKind::Abort));
        assert!(step(&mut relay, 1.0, abort, None).0);
        let sent: usize = (1..1200)
            .map(|k| step(&mut relay, 1.0 + f64::from(k) * 0.5, None, None).1.len())
            .sum();
        assert_eq!(sent, 1199, "ten minutes without a radio");
        assert_eq!(relay.unacknowledged().collect::<Vec<_>>(), [3]);
        // The vessel's process is started anew, then once more with its computer, whose clock begins at zero.
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

    /// A drone that climbs out goes on to a hold in any case: whether it was stopped, its state does not show.
    #[test]
    fn hold_while_the_drone_climbs_out() {
        let mut relay = OperatorRelay::new(1, 9);
        let climbs = status(State::ClimbOut, ReasonCode::OffHeight);
        assert!(
            step(
                &mut relay,
                1.0,
                Some(command(1, 3, CommandKind::Hold)),
                Some(climbs)
            )
            .0
        );
        assert_eq!(step(&mut relay, 1.6, None, Some(climbs)).1, [CommandKind::Hold]);
        let echoed = DroneStatus {
            order: Some([9, 2]),
            ..climbs
        };
        assert!(step(&mut relay, 2.2, None, Some(echoed)).1.is_empty());
    }

    #[test]
    fn relayed_command_time() {
        let mut relay = OperatorRelay::new(1, 4);
        let mut given = Vec::new();
        for k in 0..20 {
            let land = (k == 0).then(|| command(1, 3, CommandKind::Land));
            let input = OperatorIn {
                commands: land.into_iter().collect(),
                ..OperatorIn::default()
            };
            let out = relay.step(Time::from_secs(1.0 + 0.1 * f64::from(k)), &input);
            given.extend(out.commands.iter().map(|c| (c.header.at, c.header.sequence)));
        }
        let at = Time::from_secs(1.0);
        assert_eq!(given, [(at, 1), (at, 2), (at, 3), (at, 4)]);
    }

    /// A terminal repeats its landing while the vessel's process is started anew, and on the drone somebody aborts it.
    #[test]
    fn relayed_command_time_after_a_restart() {
        let mut relay = OperatorRelay::new(1, 9);
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
        // A computer that was started anew does not know any more when it was given: no landing goes on from there.
        let (mut relay, out) = restarted(&relay, 0.5);
        assert!(out.commands.is_empty());
        assert!(!step(&mut relay, 1.0, Some(command(2, 3, CommandKind::Land)), None).0);
    }

    #[test]
    fn replaced_command() {
        let mut relay = OperatorRelay::new(1, 9);
        let [land, mut hold] = [CommandKind::Land, CommandKind::Hold].map(|kind| command(1, 3, kind));
        hold.header.boot = 6;
        assert!(step(&mut relay, 1.0, Some(land), None).0);
        assert_eq!(
            step(&mut relay, 1.2, Some(hold), None),
            (true, vec![CommandKind::Hold])
        );
        // The first operator's terminal repeats its own.
        assert!(!step(&mut relay, 1.5, Some(land), None).0);
        assert_eq!(step(&mut relay, 1.7, None, None).1, [CommandKind::Hold]);
    }
}
