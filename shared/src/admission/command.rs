//! Rules for accepting operator commands: the mission applies all, the vessel's relay and the drone's bridge some.
//!
//! - A command is accepted once. Its repetitions carry its original time, by which they are recognised to
//!   within the clock error, even with another sequence number or from a restarted relay.
//! - Commands are accepted in the order of their times while they are fresh.
//! - An abort overrides all others: it is accepted at any age, even after newer commands, but only once.
//! - A landing that another sender orders within [`UNAWARE_OF_ABORT`] of an abort is rejected.

use super::{RejectionReason, Rejections};
use crate::{
    msg::{CommandKind, Header, OperatorCommand, message_version},
    time::{Clock, Span, Time},
    topics,
};

/// Time after an abort during which another sender may not have received it.
pub const UNAWARE_OF_ABORT: Span = Span::from_millis(1000);
/// Maximum time difference between repetitions of a command: the clock error.
const SAME_COMMAND: Span = Span::from_millis(100);
/// Maximum time by which a command may lie in the future: the clock error before synchronisation.
const LEAD: Span = Span::from_millis(500);

impl<C: Clock> OperatorCommand<C> {
    /// Whether this is a landing or take-off order from another sender that may not have received `abort` yet.
    pub fn is_unaware_of(&self, abort: &Header<C>) -> bool {
        let h = &self.header;
        let begins = matches!(
            self.kind,
            CommandKind::Land | CommandKind::TakeOff | CommandKind::Ready | CommandKind::Station(_)
        );
        begins && abort.boot != h.boot && h.at < abort.at + UNAWARE_OF_ABORT
    }
}

/// Whether a command is accepted despite this reason: an abort is, at any age and clock offset.
pub fn counts_despite(kind: CommandKind, reason: RejectionReason) -> bool {
    let time = matches!(
        reason,
        RejectionReason::Stale | RejectionReason::Future | RejectionReason::NoClock
    );
    kind == CommandKind::Abort && time
}

/// Inserts `command` and keeps at most `max`: aborts first, then the newest of the others.
pub fn keep<C: Clock>(commands: &mut Vec<OperatorCommand<C>>, command: &OperatorCommand<C>, max: usize) {
    if commands.len() >= max {
        let spare = commands.iter().position(|c| c.kind != CommandKind::Abort);
        commands.remove(spare.unwrap_or(0));
    }
    commands.push(*command);
}

/// Admission of commands at a mission, relative to the newest accepted ones.
#[derive(Clone, Copy, Debug, Default)]
pub struct CommandAdmission<C: Clock> {
    newest: Option<OperatorCommand<C>>,
    abort: Option<Header<C>>,
    order: Option<[u32; 2]>,
    rejected: Rejections,
}

impl<C: Clock> CommandAdmission<C> {
    /// Starts from the newest accepted command and abort.
    pub fn after(newest: Option<OperatorCommand<C>>, abort: Option<Header<C>>) -> Self {
        CommandAdmission {
            newest,
            abort,
            // The sender repeats an order until it is acknowledged, so none is acknowledged at the start.
            order: None,
            rejected: Rejections::default(),
        }
    }
    /// Newest accepted command; its time is the earliest for further commands.
    pub fn newest(&self) -> Option<OperatorCommand<C>> {
        self.newest
    }
    /// Newest accepted abort, with boot and sequence of its newest repetition, so that every repetition is acknowledged.
    pub fn abort(&self) -> Option<Header<C>> {
        self.abort
    }
    /// Boot and sequence number of the newest accepted command other than an abort, or of its newest repetition.
    pub fn order(&self) -> Option<[u32; 2]> {
        self.order
    }
    /// Rejected commands by reason.
    pub fn rejected(&self) -> &Rejections {
        &self.rejected
    }
    /// Discards all commands before `now` except an abort, because the drone has been taken over manually.
    pub fn supersede(&mut self, now: Time<C>) {
        self.newest = Some(OperatorCommand {
            header: Header::new(0, 0, 0, 0, now),
            kind: CommandKind::Hold,
        });
    }
    /// Command to accept from this list: an abort if there is one, otherwise the newest.
    pub fn first_of(&mut self, now: Time<C>, commands: &[OperatorCommand<C>]) -> Option<CommandKind> {
        let mut first = None;
        for command in commands {
            match self.admit(now, command) {
                Ok(()) if first == Some(CommandKind::Abort) => {}
                Ok(()) => first = Some(command.kind),
                Err(reason) => self.rejected.count(reason),
            }
        }
        first
    }
    fn admit(&mut self, now: Time<C>, command: &OperatorCommand<C>) -> Result<(), RejectionReason> {
        let h = &command.header;
        if h.version != message_version() {
            return Err(RejectionReason::Version);
        }
        if self.is_repeated(command) {
            self.answer(command);
            return Err(RejectionReason::Duplicate);
        }
        let abort = command.kind == CommandKind::Abort;
        let overtaken = self.newest.is_some_and(|n| h.at < n.header.at);
        let age = now - h.at;
        let late = if age < -LEAD {
            Some(RejectionReason::Future)
        } else if age > topics::COMMAND.stale_after {
            Some(RejectionReason::Stale)
        } else {
            overtaken.then_some(RejectionReason::OutOfOrder)
        };
        if let Some(reason) = late.filter(|_| !abort) {
            return Err(reason);
        }
        if self.abort.is_some_and(|a| command.is_unaware_of(&a)) {
            return Err(RejectionReason::Unaware);
        }
        // A corrupt time in the future must not block later commands, and a late abort must not admit earlier ones.
        let at = if late.is_none() { h.at } else { now };
        let header = Header { at, ..*h };
        self.newest = Some(OperatorCommand { header, ..*command });
        self.answer(command);
        if abort {
            // The abort replaces the acknowledgement of the order that it stops.
            self.abort = Some(header);
            self.order = None;
        }
        Ok(())
    }
    /// Acknowledges a command. Later commands do not hide the acknowledgement of an abort.
    fn answer(&mut self, command: &OperatorCommand<C>) {
        if command.kind != CommandKind::Abort {
            self.order = Some([command.header.boot, command.header.sequence]);
        }
    }
    /// Whether this command was accepted before. A repeated abort becomes the acknowledged command.
    fn is_repeated(&mut self, command: &OperatorCommand<C>) -> bool {
        let h = &command.header;
        let same_time = |other: &Header<C>| (-SAME_COMMAND..=SAME_COMMAND).contains(&(h.at - other.at));
        let same_message = |other: &Header<C>| (h.boot, h.sequence) == (other.boot, other.sequence);
        match (command.kind, &mut self.abort) {
            (CommandKind::Abort, Some(a)) => {
                // A late abort is dated by its arrival, so its repetitions are older.
                let repeated = same_time(a) || h.boot == a.boot && h.at <= a.at;
                if repeated {
                    a.boot = h.boot;
                    a.sequence = h.sequence;
                }
                repeated
            }
            (CommandKind::Abort, None) => false,
            (
                CommandKind::Land
                | CommandKind::Hold
                | CommandKind::TakeOff
                | CommandKind::Ready
                | CommandKind::Station(_),
                _,
            ) => self
                .newest
                .is_some_and(|n| same_message(&n.header) || n.kind == command.kind && same_time(&n.header)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::DroneClock;
    use CommandKind::{Abort, Hold, Land};
    use RejectionReason::{Duplicate, Future, OutOfOrder, Stale, Unaware};

    type TestCommand = (u32, u32, f64, CommandKind);

    fn command((boot, sequence, given_s, kind): TestCommand) -> OperatorCommand<DroneClock> {
        OperatorCommand {
            header: Header::new(1, 1, boot, sequence, Time::from_secs(given_s)),
            kind,
        }
    }

    #[test]
    fn command_admission_table() {
        // Each row: commands accepted at their own times, then the arrival time of a further command, and its result.
        let before_landing: &[TestCommand] = &[(9, 1, 10.0, Land)];
        let before_abort: &[TestCommand] = &[(9, 1, 10.0, Land), (9, 2, 20.0, Abort)];
        let landing_again: &[TestCommand] = &[(5, 1, 10.0, Abort), (9, 1, 20.0, Land)];
        for (before, now_s, given, expected) in [
            (&[][..], 10.0, (9, 1, 10.0, Land), Ok(())),
            (&[], 16.0, (9, 1, 10.0, Land), Err(Stale)),
            (&[], 9.0, (9, 1, 10.0, Hold), Err(Future)),
            (&[], 60.0, (9, 1, 10.0, Abort), Ok(())),
            (&[], 9.0, (9, 1, 10.0, Abort), Ok(())),
            // The relay's repetition has another sequence number and a time that differs by the clock error.
            (before_landing, 10.5, (9, 2, 10.0, Land), Err(Duplicate)),
            (before_landing, 10.5, (9, 2, 10.04, Land), Err(Duplicate)),
            (before_landing, 10.5, (9, 2, 9.96, Land), Err(Duplicate)),
            (before_landing, 12.0, (10, 1, 10.0, Land), Err(Duplicate)),
            (before_landing, 10.5, (9, 1, 10.4, Land), Err(Duplicate)),
            (before_landing, 10.5, (9, 2, 10.4, Land), Ok(())),
            // Another operator's hold at almost the same time, through the same relay.
            (before_landing, 10.5, (9, 2, 10.05, Hold), Ok(())),
            (before_landing, 10.5, (9, 2, 9.5, Hold), Err(OutOfOrder)),
            // Commands given before an abort, or by a sender that has not received it.
            (before_abort, 20.5, (9, 3, 19.0, Land), Err(OutOfOrder)),
            (before_abort, 20.5, (7, 1, 20.3, Land), Err(Unaware)),
            (before_abort, 20.5, (9, 3, 20.3, Land), Ok(())),
            (before_abort, 21.5, (7, 1, 21.2, Land), Ok(())),
            (before_abort, 20.5, (9, 3, 20.02, Abort), Err(Duplicate)),
            (before_abort, 20.5, (10, 1, 20.02, Abort), Err(Duplicate)),
            // A later landing is stopped by a delayed abort, but not by a repetition.
            (landing_again, 21.0, (9, 2, 19.0, Abort), Ok(())),
            (landing_again, 21.0, (5, 2, 10.05, Abort), Err(Duplicate)),
        ] {
            let mut admission = CommandAdmission::default();
            for accepted in before {
                let at = Time::from_secs(accepted.2);
                assert_eq!(admission.admit(at, &command(*accepted)), Ok(()));
            }
            let found = admission.admit(Time::from_secs(now_s), &command(given));
            assert_eq!(found, expected, "{given:?} after {before:?}");
        }
    }

    #[test]
    fn late_abort() {
        let mut admission = CommandAdmission::default();
        let mut first_of = |now_s, given: &[TestCommand]| {
            let commands: Vec<_> = given.iter().copied().map(command).collect();
            admission.first_of(Time::from_secs(now_s), &commands)
        };
        let both = [(9, 1, 20.0, Abort), (7, 1, 20.0, Land)];
        assert_eq!(first_of(30.0, &both), Some(Abort), "before all others");
        assert_eq!(first_of(32.0, &[(7, 2, 31.9, Land)]), Some(Land));
        assert_eq!(first_of(32.5, &[(9, 2, 20.05, Abort)]), None);
        assert_eq!(admission.abort().map(|a| a.sequence), Some(2), "answered");
        assert_eq!(admission.rejected().of(Duplicate), 1);
    }

    #[test]
    fn hold_and_its_answer() {
        let mut admission = CommandAdmission::default();
        let mut answered = |now_s, given| {
            admission.first_of(Time::from_secs(now_s), &[command(given)]);
            admission.order()
        };
        assert_eq!(answered(10.0, (9, 1, 10.0, Land)), Some([9, 1]));
        assert_eq!(answered(11.0, (9, 2, 11.0, Hold)), Some([9, 2]));
        assert_eq!(answered(11.5, (9, 3, 11.0, Hold)), Some([9, 3]), "repeated");
        assert_eq!(answered(12.0, (7, 1, 10.5, Hold)), Some([9, 3]), "too late");
    }

    #[test]
    fn orders_before_a_takeover() {
        let mut admission = CommandAdmission::default();
        let at = Time::from_secs;
        admission.supersede(at(10.0));
        for (given, expected) in [
            ((9, 1, 9.9, Land), Err(OutOfOrder)),
            ((9, 2, 10.05, Land), Ok(())),
            ((9, 3, 9.0, Abort), Ok(())),
        ] {
            assert_eq!(admission.admit(at(10.1), &command(given)), expected, "{given:?}");
        }
    }

    #[test]
    fn kept_commands() {
        let mut kept = Vec::new();
        for k in 0..9_u32 {
            let kind = if k == 1 { Abort } else { Land };
            keep(&mut kept, &command((1, k, 1.0, kind)), 3);
        }
        let sequences: Vec<u32> = kept.iter().map(|c| c.header.sequence).collect();
        assert_eq!(sequences, [1, 7, 8]);
    }
}
