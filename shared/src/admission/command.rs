//! Admission of operators' commands: the rules by which the mission admits them; the vessel's relay and the drone's bridge
//! take from here what concerns them.
//!
//! - A command counts once. Its repetitions bear the time at which it was given, by which they are known: an error of the
//!   clocks apart, also under another sequence number or from a relay that was restarted.
//! - It counts in order of the times at which commands were given, and while it is fresh.
//! - An abort precedes all others: it counts however old it is, also after newer commands, but not again after them.
//! - A landing that somebody else orders within [`UNAWARE_OF_ABORT`] of an abort was ordered without knowing of it.

use super::{RejectionReason, Rejections};
use crate::msg::{CommandKind, Header, MESSAGE_VERSION, OperatorCommand};
use crate::time::{Clock, Span, Time};
use crate::topics;

/// An order to land within this time of an abort was given by a sender who cannot know the abort's effect yet.
pub const UNAWARE_OF_ABORT: Span = Span::from_millis(1000);
/// Repetitions of one command differ in time by the error of the clocks, at most.
const SAME_COMMAND: Span = Span::from_millis(100);
/// A command may lie this far ahead of now: the error of the clocks before they have settled.
const LEAD: Span = Span::from_millis(500);

impl<C: Clock> OperatorCommand<C> {
    /// Whether this is a landing or take-off ordered by another sender who cannot know the effect of `abort` yet.
    pub fn is_unaware_of(&self, abort: &Header<C>) -> bool {
        let h = &self.header;
        let begins = matches!(
            self.kind,
            CommandKind::Land | CommandKind::TakeOff | CommandKind::Ready | CommandKind::Station(_)
        );
        begins && abort.boot != h.boot && h.at < abort.at + UNAWARE_OF_ABORT
    }
}

/// Whether a command of this kind counts although it was rejected for this reason: an abort does, however old it is and
/// whatever the clocks show.
pub fn counts_despite(kind: CommandKind, reason: RejectionReason) -> bool {
    let time = matches!(
        reason,
        RejectionReason::Stale | RejectionReason::Future | RejectionReason::NoClock
    );
    kind == CommandKind::Abort && time
}

/// Keeps `command` with those before it, `max` at most: aborts first, and of the others the newest.
pub fn keep<C: Clock>(commands: &mut Vec<OperatorCommand<C>>, command: &OperatorCommand<C>, max: usize) {
    if commands.len() >= max {
        let spare = commands.iter().position(|c| c.kind != CommandKind::Abort);
        commands.remove(spare.unwrap_or(0));
    }
    commands.push(*command);
}

/// The commands that count for a mission, judged by the newest that it has accepted.
#[derive(Clone, Copy, Debug, Default)]
pub struct CommandAdmission<C: Clock> {
    newest: Option<OperatorCommand<C>>,
    abort: Option<Header<C>>,
    order: Option<[u32; 2]>,
    rejected: Rejections,
}

impl<C: Clock> CommandAdmission<C> {
    /// After these: the newest command and the newest abort that were accepted.
    pub fn after(newest: Option<OperatorCommand<C>>, abort: Option<Header<C>>) -> Self {
        CommandAdmission {
            newest,
            abort,
            // Its sender repeats one that is not answered yet.
            order: None,
            rejected: Rejections::default(),
        }
    }
    /// The newest command that was accepted, at the time from which on commands count.
    pub fn newest(&self) -> Option<OperatorCommand<C>> {
        self.newest
    }
    /// The newest abort that was accepted, with the boot and sequence of its newest repetition: the vessel is answered
    /// whichever it waits for.
    pub fn abort(&self) -> Option<Header<C>> {
        self.abort
    }
    /// Boot and sequence of the newest other command that was accepted, or of its newest repetition.
    pub fn order(&self) -> Option<[u32; 2]> {
        self.order
    }
    /// Commands that do not count, by reason.
    pub fn rejected(&self) -> &Rejections {
        &self.rejected
    }
    /// Somebody has taken the drone over at `now`: what was given before counts no more, but for an abort.
    pub fn supersede(&mut self, now: Time<C>) {
        self.newest = Some(OperatorCommand {
            header: Header::new(0, 0, 0, 0, now),
            kind: CommandKind::Hold,
        });
    }
    /// The command of these that counts: an abort before all others, else the newest.
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
    /// Takes a command at `now`, or gives the reason why it does not count.
    fn admit(&mut self, now: Time<C>, command: &OperatorCommand<C>) -> Result<(), RejectionReason> {
        let h = &command.header;
        if h.version != MESSAGE_VERSION {
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
        // A damaged time far ahead must not lock out what follows, nor a late abort let in what came before it.
        let at = if late.is_none() { h.at } else { now };
        let header = Header { at, ..*h };
        self.newest = Some(OperatorCommand { header, ..*command });
        self.answer(command);
        if abort {
            // What it stops is not answered any more.
            (self.abort, self.order) = (Some(header), None);
        }
        Ok(())
    }
    /// It is answered as it came; an abort has an answer of its own, which nothing after it hides.
    fn answer(&mut self, command: &OperatorCommand<C>) {
        if command.kind != CommandKind::Abort {
            self.order = Some([command.header.boot, command.header.sequence]);
        }
    }
    /// Whether it was accepted already; an abort's repetition becomes the one that is answered.
    fn is_repeated(&mut self, command: &OperatorCommand<C>) -> bool {
        let h = &command.header;
        let same_time = |other: &Header<C>| (-SAME_COMMAND..=SAME_COMMAND).contains(&(h.at - other.at));
        let same_message = |other: &Header<C>| (h.boot, h.sequence) == (other.boot, other.sequence);
        match (command.kind, &mut self.abort) {
            (CommandKind::Abort, Some(a)) => {
                // A late one counts from its arrival on: its repetitions are older.
                let repeated = same_time(a) || h.boot == a.boot && h.at <= a.at;
                if repeated {
                    (a.boot, a.sequence) = (h.boot, h.sequence);
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

    /// Boot, sequence, time given (s) and kind.
    type Given = (u32, u32, f64, CommandKind);

    fn command((boot, sequence, given_s, kind): Given) -> OperatorCommand<DroneClock> {
        OperatorCommand {
            header: Header::new(1, 1, boot, sequence, Time::from_secs(given_s)),
            kind,
        }
    }

    #[test]
    fn command_admission_table() {
        // Each line: what was accepted before at its own time, then a command at a time, and whether it counts.
        let before_landing: &[Given] = &[(9, 1, 10.0, Land)];
        let before_abort: &[Given] = &[(9, 1, 10.0, Land), (9, 2, 20.0, Abort)];
        let landing_again: &[Given] = &[(5, 1, 10.0, Abort), (9, 1, 20.0, Land)];
        for (before, now_s, given, expected) in [
            (&[][..], 10.0, (9, 1, 10.0, Land), Ok(())),
            (&[], 16.0, (9, 1, 10.0, Land), Err(Stale)),
            (&[], 9.0, (9, 1, 10.0, Hold), Err(Future)),
            // An abort counts whatever its time.
            (&[], 60.0, (9, 1, 10.0, Abort), Ok(())),
            (&[], 9.0, (9, 1, 10.0, Abort), Ok(())),
            // The relay's repetition has another sequence number, and the error of the clocks.
            (before_landing, 10.5, (9, 2, 10.0, Land), Err(Duplicate)),
            (before_landing, 10.5, (9, 2, 10.04, Land), Err(Duplicate)),
            (before_landing, 10.5, (9, 2, 9.96, Land), Err(Duplicate)),
            // A command of a restarted relay has another boot id, too.
            (before_landing, 12.0, (10, 1, 10.0, Land), Err(Duplicate)),
            (before_landing, 10.5, (9, 1, 10.4, Land), Err(Duplicate)),
            (before_landing, 10.5, (9, 2, 10.4, Land), Ok(())),
            // Another operator's hold at almost the same time, through the same relay.
            (before_landing, 10.5, (9, 2, 10.05, Hold), Ok(())),
            (before_landing, 10.5, (9, 2, 9.5, Hold), Err(OutOfOrder)),
            // Given before an abort, or without knowing of it.
            (before_abort, 20.5, (9, 3, 19.0, Land), Err(OutOfOrder)),
            (before_abort, 20.5, (7, 1, 20.3, Land), Err(Unaware)),
            (before_abort, 20.5, (9, 3, 20.3, Land), Ok(())),
            (before_abort, 21.5, (7, 1, 21.2, Land), Ok(())),
            (before_abort, 20.5, (9, 3, 20.02, Abort), Err(Duplicate)),
            (before_abort, 20.5, (10, 1, 20.02, Abort), Err(Duplicate)),
            // A landing ordered since is stopped by an abort that was on its way, and by no repetition.
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
        let mut first_of = |now_s, given: &[Given]| {
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
