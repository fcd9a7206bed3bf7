//! Operator relay: passes operator commands through the vessel to its drones.
//!
//! A command is sent to its drone at 2 Hz until the drone's status echoes it, for at most 10 s. An abort is repeated
//! without a time limit, and until it has taken effect, no other command reaches that drone. Commands given before
//! then, and landings ordered by others within a second of the abort, remain rejected afterwards. Each repetition
//! carries the original time of the command, so that every later command from any source is newer.
//!
//! An operator's terminal repeats its command for 12 s. The relay recognises these repetitions, also after a
//! restart of the vessel's process ([`GivenCommand`]).
//!
//! Commands for drones that the radio does not admit are rejected, so there is always room for one command to each
//! admitted drone. An abort is therefore relayed regardless of what other operators send.
//!
//! The relay replies to each of an operator's messages, and at every change, with the progress of the command
//! ([`CommandReceipt`]). A drone state that matches a command by chance does not count as an acknowledgement, and
//! silence does not show whether an abort is pending.

use std::collections::VecDeque;

use alight_shared::{
    admission::{Arrival, RejectionReason, Rejections, Retransmission, Sender, check_identity},
    msg::{CommandKind, CommandProgress, CommandReceipt, DroneStatus, Header, OperatorCommand},
    node::Node,
    time::{Span, VesselClock, VesselTime},
    topics,
};
use serde::{Deserialize, Serialize};

use super::{MAX_DRONES, checkpoint::GivenCommand};

/// Maximum number of stored commands: at most one open command per drone, and the newest others.
const MAX_COMMANDS: usize = 4 * MAX_DRONES;

#[derive(Clone, Copy, Debug)]
struct Relayed {
    operator: Sender,
    /// Command with boot and sequence of the operator's message.
    given: Retransmission<VesselClock, OperatorCommand<VesselClock>>,
    /// Minimum sequence number of the command's repetitions.
    first: u32,
    progress: CommandProgress,
}

impl Relayed {
    fn drone(&self) -> u32 {
        self.given.message.header.drone
    }
    fn is_open(&self) -> bool {
        self.progress == CommandProgress::Pending
    }
    /// Whether this entry is the command of `operator` with the header `h`.
    fn is_of(&self, operator: Sender, h: &Header<VesselClock>) -> bool {
        let known = &self.given.message.header;
        (self.operator, known.drone, known.boot, known.sequence) == (operator, h.drone, h.boot, h.sequence)
    }
    /// Whether this abort blocks another command.
    fn forbids(&self, command: &OperatorCommand<VesselClock>) -> bool {
        let own = &self.given.message;
        let other = own.kind == CommandKind::Abort && command.kind != CommandKind::Abort;
        self.drone() == command.header.drone
            && other
            && (self.is_open() || command.is_unaware_of(&own.header))
    }
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct OperatorIn {
    /// Commands of operators with accepted certificates.
    pub commands: Vec<Arrival<VesselClock, OperatorCommand<VesselClock>>>,
    pub statuses: Vec<DroneStatus>,
    /// Commands known to the previous start, at the first step.
    pub given: Vec<GivenCommand>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OperatorOut {
    /// New valid commands of this step, as given by the operators.
    pub accepted: Vec<OperatorCommand<VesselClock>>,
    /// Commands for the drones named in their headers.
    pub commands: Vec<OperatorCommand<VesselClock>>,
    pub receipts: Vec<CommandReceipt>,
}

#[derive(Clone, Debug)]
pub struct OperatorRelay {
    vessel: u32,
    boot: u32,
    admitted: Vec<u32>,
    sequence: u32,
    /// Commands in order of arrival, at most one open per drone.
    commands: VecDeque<Relayed>,
    rejected: Rejections,
    receipts: u32,
}

impl OperatorRelay {
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
    /// Sets the drones that receive commands, at most [`MAX_DRONES`].
    pub fn admit(&mut self, drones: impl IntoIterator<Item = u32>) {
        self.admitted = drones.into_iter().take(MAX_DRONES).collect();
    }
    pub fn rejected(&self) -> &Rejections {
        &self.rejected
    }
    /// Drones that have not acknowledged an abort.
    pub fn unacknowledged(&self) -> impl Iterator<Item = u32> {
        let pending = |c: &&Relayed| c.is_open() && c.given.message.kind == CommandKind::Abort;
        self.commands.iter().filter(pending).map(Relayed::drone)
    }
    pub fn given(&self) -> Vec<GivenCommand> {
        let given = |c: &Relayed| GivenCommand {
            operator: c.operator,
            command: c.given.message,
            open: c.is_open(),
        };
        self.commands.iter().map(given).collect()
    }

    fn restore(&mut self, now: VesselTime, given: &[GivenCommand]) {
        let admitted = |g: &&GivenCommand| self.admitted.contains(&g.command.header.drone);
        let given: Vec<_> = given.iter().filter(admitted).take(MAX_COMMANDS).collect();
        for before in given {
            let GivenCommand {
                operator,
                mut command,
                open,
            } = *before;
            // A restarted computer counts its time from zero: the command's original time is lost.
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

    /// Accepts an operator's command, or returns the reason for rejecting it.
    fn accept(
        &mut self,
        now: VesselTime,
        arrival: &Arrival<VesselClock, OperatorCommand<VesselClock>>,
    ) -> Result<(), RejectionReason> {
        let operator = arrival.sender;
        let command = &arrival.message;
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
        // A rejected command is also stored, so that its repetitions stay rejected.
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

    /// Receipts for commands whose progress has changed, and for commands just sent by an operator.
    fn answer(
        &mut self,
        now: VesselTime,
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

    /// Progress of a command according to a status; None if the status does not show it.
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

    fn step(&mut self, now: VesselTime, input: &OperatorIn) -> OperatorOut {
        self.restore(now, &input.given);
        let standing = |c: &Relayed| (c.operator, c.given.message.header, c.progress);
        let before: Vec<_> = self.commands.iter().map(standing).collect();
        let mut out = OperatorOut::default();
        for command in &input.commands {
            match self.accept(now, command) {
                Ok(()) => out.accepted.push(command.message),
                // The terminal repeats the command while it runs.
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
                let drone = c.drone();
                let at = command.header.at;
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
