//! The operator relay: operators' commands on their way through the vessel to its drones.
//!
//! A command is sent to its drone at 2 Hz until the drone's status echoes it, for 10 s at most; an abort for as long as it takes. While an abort has not shown its effect, no other command reaches that drone,
//! and none that was given until then, nor a landing that somebody else orders within a second of it, counts afterwards.
//! Each repetition bears the time at which the command was given: what the drone was commanded since, by whomever, is newer.
//!
//! An operator's terminal repeats its command for 12 s. The relay knows the commands that it was given, and when, also
//! after a new start of the vessel's process ([`GivenCommand`]).
//!
//! Commands for drones that the radio does not admit are rejected, so that each admitted drone always has room for one:
//! whatever other operators send, an abort becomes pending.
//!
//! To each of an operator's messages, and whenever it changes, the relay answers how far that command has come
//! ([`CommandReceipt`]): a state of the drone that fits it by chance is no answer, and silence does not show whether an
//! abort is pending.

use std::collections::VecDeque;

use alight_shared::admission::{
    Arrival, RejectionReason, Rejections, Retransmission, Sender, check_identity,
};
use alight_shared::msg::{
    CommandKind, CommandProgress, CommandReceipt, DroneStatus, Header, OperatorCommand,
};
use alight_shared::node::Node;
use alight_shared::time::{Span, Time, VesselClock};
use alight_shared::topics;
use serde::{Deserialize, Serialize};

use super::MAX_DRONES;
use super::checkpoint::GivenCommand;

/// Most commands that are known: those that are open, one for each drone at most, and the newest others.
const MAX_COMMANDS: usize = 4 * MAX_DRONES;

/// A command and its repetitions to the drone.
#[derive(Clone, Copy, Debug)]
struct Relayed {
    operator: Sender,
    /// Boot and sequence are those of the operator's message.
    given: Retransmission<VesselClock, OperatorCommand<VesselClock>>,
    /// Sequence that the first of its repetitions has at least.
    first: u32,
    progress: CommandProgress,
}

impl Relayed {
    fn drone(&self) -> u32 {
        self.given.message.header.drone
    }
    /// It is repeated.
    fn is_open(&self) -> bool {
        self.progress == CommandProgress::Pending
    }
    /// Whether it is the same command of the same operator.
    fn is_of(&self, operator: Sender, h: &Header<VesselClock>) -> bool {
        let known = &self.given.message.header;
        (self.operator, known.drone, known.boot, known.sequence) == (operator, h.drone, h.boot, h.sequence)
    }
    /// Whether this abort keeps another command away.
    fn forbids(&self, command: &OperatorCommand<VesselClock>) -> bool {
        let own = &self.given.message;
        let other = own.kind == CommandKind::Abort && command.kind != CommandKind::Abort;
        self.drone() == command.header.drone
            && other
            && (self.is_open() || command.is_unaware_of(&own.header))
    }
}

/// Input that arrived since the last step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct OperatorIn {
    /// From operators whose certificates were accepted.
    pub commands: Vec<Arrival<VesselClock, OperatorCommand<VesselClock>>>,
    /// From drones.
    pub statuses: Vec<DroneStatus>,
    /// At the first step, the commands that the former start knew.
    pub given: Vec<GivenCommand>,
}

/// Messages that the relay sends, and orders that it has accepted.
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
    /// Numbers of the drones that may get commands.
    admitted: Vec<u32>,
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
            admitted: Vec::new(),
            sequence: 0,
            commands: VecDeque::new(),
            rejected: Rejections::default(),
            receipts: 0,
        }
    }
    /// Passes commands on to these drones, [`MAX_DRONES`] at most, and to no others.
    pub fn admit(&mut self, drones: impl IntoIterator<Item = u32>) {
        self.admitted = drones.into_iter().take(MAX_DRONES).collect();
    }
    /// Commands that were not passed on, by reason.
    pub fn rejected(&self) -> &Rejections {
        &self.rejected
    }
    /// Drones that have not acknowledged an abort.
    pub fn unacknowledged(&self) -> impl Iterator<Item = u32> {
        let pending = |c: &&Relayed| c.is_open() && c.given.message.kind == CommandKind::Abort;
        self.commands.iter().filter(pending).map(Relayed::drone)
    }
    /// The commands that it knows, for the next start.
    pub fn given(&self) -> Vec<GivenCommand> {
        let given = |c: &Relayed| GivenCommand {
            operator: c.operator,
            command: c.given.message,
            open: c.is_open(),
        };
        self.commands.iter().map(given).collect()
    }

    fn restore(&mut self, now: Time<VesselClock>, given: &[GivenCommand]) {
        let admitted = |g: &&GivenCommand| self.admitted.contains(&g.command.header.drone);
        let given: Vec<_> = given.iter().filter(admitted).take(MAX_COMMANDS).collect();
        for before in given {
            let GivenCommand {
                operator,
                mut command,
                open,
            } = *before;
            // A restarted computer counts its time from zero: when it was given is not known any more.
            let is_dated = command.header.at <= now;
            command.header.at = command.header.at.min(now);
            let progress = if open && (is_dated || command.kind == CommandKind::Abort) {
                CommandProgress::Pending
            } else {
                CommandProgress::Unknown
            };
            self.push(operator, command, progress);
        }
    }
    fn push(&mut self, operator: Sender, command: OperatorCommand<VesselClock>, progress: CommandProgress) {
        if self.commands.len() >= MAX_COMMANDS {
            let spare = self.commands.iter().position(|c| !c.is_open());
            self.commands.remove(spare.unwrap_or(0));
        }
        let mut retries = topics::RELAY_RETRIES;
        if command.kind == CommandKind::Abort {
            retries.timeout = Span::MAX;
        }
        self.commands.push_back(Relayed {
            operator,
            given: Retransmission::new(command, command.header.at, retries),
            first: self.sequence.wrapping_add(1),
            progress,
        });
    }

    /// Takes an operator's command, or gives the reason why it does not count.
    fn accept(
        &mut self,
        now: Time<VesselClock>,
        arrival: &Arrival<VesselClock, OperatorCommand<VesselClock>>,
    ) -> Result<(), RejectionReason> {
        let (operator, command) = (arrival.sender, &arrival.message);
        let h = &command.header;
        if self.commands.iter().any(|c| c.is_of(operator, h)) {
            return Err(RejectionReason::Duplicate);
        }
        check_identity(h, self.vessel, h.drone)?;
        if !self.admitted.contains(&h.drone) {
            return Err(RejectionReason::Drone);
        }
        let command = OperatorCommand {
            header: Header { at: now, ..*h },
            ..*command
        };
        // Also one that does not count is known: its repetitions do not count later.
        let forbidden = self.commands.iter().any(|c| c.forbids(&command));
        let replaced = |c: &&mut Relayed| !forbidden && c.is_open() && c.drone() == h.drone;
        for c in self.commands.iter_mut().filter(replaced) {
            c.progress = CommandProgress::Replaced;
        }
        if forbidden {
            self.push(operator, command, CommandProgress::Forbidden);
            return Err(RejectionReason::Unaware);
        }
        self.push(operator, command, CommandProgress::Pending);
        Ok(())
    }

    /// The receipts of the commands that have changed since they stood so, and of those that an operator has just sent.
    fn answer(
        &mut self,
        now: Time<VesselClock>,
        before: &[(Sender, Header<VesselClock>, CommandProgress)],
        sent: &[Arrival<VesselClock, OperatorCommand<VesselClock>>],
    ) -> Vec<CommandReceipt> {
        let mut receipts = Vec::new();
        for c in &self.commands {
            let changed = before.iter().any(|(o, h, p)| c.is_of(*o, h) && c.progress != *p);
            if changed || sent.iter().any(|s| c.is_of(s.sender, &s.message.header)) {
                self.receipts = self.receipts.wrapping_add(1);
                let command = &c.given.message;
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

    /// Progress of a command that a status shows; None: none.
    fn shown(&self, c: &Relayed, status: &DroneStatus) -> Option<CommandProgress> {
        let command = &c.given.message;
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
        let standing = |c: &Relayed| (c.operator, c.given.message.header, c.progress);
        let before: Vec<_> = self.commands.iter().map(standing).collect();
        let mut out = OperatorOut::default();
        for command in &input.commands {
            match self.accept(now, command) {
                Ok(()) => out.accepted.push(command.message),
                // A terminal repeats its command as long as it runs.
                Err(RejectionReason::Duplicate) => {}
                Err(reason) => self.rejected.count(reason),
            }
        }
        for k in 0..self.commands.len() {
            let Some(mut c) = self.commands.get(k).copied().filter(Relayed::is_open) else {
                continue;
            };
            let shown = input.statuses.iter().find_map(|s| self.shown(&c, s));
            if let Some(shown) = shown {
                c.progress = shown;
            } else if c.given.is_over(now) {
                c.progress = CommandProgress::GivenUp;
            } else if let Some(command) = c.given.due(now) {
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
mod tests;
