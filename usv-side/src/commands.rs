//! Operators' commands on their way through the vessel.
//!
//! An operator reaches the vessel, and the vessel its drones. A command is said to its drone twice a
//! second until what the drone says about itself shows that it was taken, for 10 s at most. An abort that
//! was not taken yet lets no other command of that drone through.

use alight_shared::msg::{CommandKind, DroneStatus, Header, MESSAGE_VERSION, OperatorCommand};
use alight_shared::time::{Span, Time, VesselClock};

use crate::deck::MAX_DRONES;

/// Time between two repetitions.
const REPEAT_PERIOD: Span = Span::from_millis(500);
/// A command that shows no effect is given up after this long.
const TIMEOUT: Span = Span::from_millis(10_000);

#[derive(Clone, Copy, Debug)]
struct Pending {
    drone: u32,
    kind: CommandKind,
    given: Time<VesselClock>,
    next: Time<VesselClock>,
    /// Last one heard: operator's boot and sequence.
    identity: (u32, u32),
    /// Done or given up: kept to know a repetition when it comes.
    finished: bool,
}

/// What is on its way.
#[derive(Clone, Debug)]
pub struct OperatorRelay {
    vessel: u32,
    boot: u32,
    sequence: u32,
    pending: Vec<Pending>,
    rejected: u64,
}

impl OperatorRelay {
    /// Through vessel `vessel`, which started with this boot id.
    pub fn new(vessel: u32, boot: u32) -> OperatorRelay {
        OperatorRelay {
            vessel,
            boot,
            sequence: 0,
            pending: Vec::new(),
            rejected: 0,
        }
    }
    /// Commands that were not passed on.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }
    /// An admitted operator says this; true when it is news and on its way now.
    pub fn hear(&mut self, now: Time<VesselClock>, command: &OperatorCommand<VesselClock>) -> bool {
        let h = &command.header;
        let identity = (h.boot, h.sequence);
        let known = self.pending.iter().position(|p| p.drone == h.drone);
        let before = known.and_then(|k| self.pending.get(k));
        if before.is_some_and(|p| p.identity == identity) {
            return false;
        }
        let sound = h.version == MESSAGE_VERSION && h.vessel == self.vessel && h.drone != 0;
        let aborting = before.is_some_and(|p| !p.finished && p.kind == CommandKind::Abort);
        let full = known.is_none() && self.pending.len() >= MAX_DRONES;
        if !sound || full || aborting && command.kind != CommandKind::Abort {
            self.rejected = self.rejected.saturating_add(1);
            return false;
        }
        let pending = Pending {
            drone: h.drone,
            kind: command.kind,
            given: now,
            next: now,
            identity,
            finished: false,
        };
        match known.and_then(|k| self.pending.get_mut(k)) {
            Some(slot) => *slot = pending,
            None => self.pending.push(pending),
        }
        true
    }
    /// What drones say, and what is to be said to them now.
    pub fn step<'a>(
        &mut self,
        now: Time<VesselClock>,
        statuses: impl IntoIterator<Item = &'a DroneStatus>,
    ) -> Vec<OperatorCommand<VesselClock>> {
        for status in statuses {
            for p in &mut self.pending {
                // A word that was under way when the command was given shows nothing.
                if p.drone == status.header.drone && p.next > p.given {
                    p.finished |= p.kind.is_met(status.state, status.waiting.code);
                }
            }
        }
        let mut out = Vec::new();
        for p in &mut self.pending {
            p.finished |= now - p.given > TIMEOUT;
            if p.finished || now < p.next {
                continue;
            }
            p.next = now + REPEAT_PERIOD;
            self.sequence = self.sequence.wrapping_add(1);
            out.push(OperatorCommand {
                header: Header::new(self.vessel, p.drone, self.boot, self.sequence, now),
                kind: p.kind,
            });
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{Reason, ReasonCode, State};

    fn at(s: f64) -> Time<VesselClock> {
        Time::from_secs(s)
    }
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

    #[test]
    fn operator_relay_repeats_a_command_until_the_drone_status_shows_it() {
        let mut c = OperatorRelay::new(1, 9);
        assert!(c.hear(at(1.0), &command(1, 3, CommandKind::Land)));
        assert!(
            !c.hear(at(1.1), &command(1, 3, CommandKind::Land)),
            "a repetition"
        );
        let idle = status(State::Idle, ReasonCode::NotCommanded);
        let sent: usize = (10..30)
            .map(|k| c.step(at(f64::from(k) * 0.1), [&idle]).len())
            .sum();
        assert_eq!(sent, 4);
        assert!(
            c.step(at(3.0), [&status(State::GetAltitude, ReasonCode::TooFar)])
                .is_empty()
        );
        assert!(c.step(at(4.0), []).is_empty());
        assert_eq!(c.rejected(), 0);
    }

    #[test]
    fn operator_relay_holds_other_commands_back_until_an_abort_is_effective() {
        let mut c = OperatorRelay::new(1, 9);
        c.hear(at(1.0), &command(1, 3, CommandKind::Land));
        assert_eq!(c.step(at(1.0), [])[0].kind, CommandKind::Land);
        assert!(c.hear(at(1.2), &command(2, 3, CommandKind::Abort)));
        assert!(!c.hear(at(1.3), &command(3, 3, CommandKind::Land)));
        let descent = status(State::Descent, ReasonCode::TooFar);
        assert_eq!(c.step(at(1.4), [&descent])[0].kind, CommandKind::Abort);
        let finished = status(State::GaveUp, ReasonCode::NotCommanded);
        assert!(c.step(at(2.4), [&finished]).is_empty());
        assert!(c.hear(at(2.5), &command(4, 3, CommandKind::Land)));
        assert_eq!(c.rejected(), 1);
    }

    #[test]
    fn operator_relay_gives_up_after_10_s_and_rejects_foreign_commands() {
        let mut c = OperatorRelay::new(1, 9);
        assert!(!c.hear(at(1.0), &command(1, 0, CommandKind::Abort)));
        let mut other = command(2, 3, CommandKind::Abort);
        other.header.vessel = 2;
        assert!(!c.hear(at(1.0), &other));
        assert_eq!(c.rejected(), 2);
        c.hear(at(1.0), &command(3, 3, CommandKind::Hold));
        let sent: usize = (0..100)
            .map(|k| c.step(at(1.0 + f64::from(k) * 0.5), []).len())
            .sum();
        assert_eq!(sent, 21);
    }
}
