//! Operators' commands on their way through the vessel.
//!
//! An operator reaches the vessel, and the vessel its drones. A command is said to its drone twice a
//! second until what the drone says about itself shows that it was taken, for 10 s at most. An abort that
//! was not taken yet lets no other command of that drone through.

use alight_shared::msg::{CommandKind, DroneStatus, Header, MESSAGE_VERSION, OperatorCommand};
use alight_shared::time::{Span, Time, VesselClock};

use crate::deck::DRONES;

/// Time between two repetitions.
const AGAIN: Span = Span::from_millis(500);
/// A command that shows no effect is given up after this long.
const LONGEST: Span = Span::from_millis(10_000);

#[derive(Clone, Copy, Debug)]
struct Pending {
    drone: u32,
    kind: CommandKind,
    given: Time<VesselClock>,
    next: Time<VesselClock>,
    /// Last one heard: operator's boot and sequence.
    heard: (u32, u32),
    /// Done or given up: kept to know a repetition when it comes.
    over: bool,
}

/// What is on its way.
#[derive(Clone, Debug)]
pub struct Commands {
    vessel: u32,
    boot: u32,
    sequence: u32,
    pending: Vec<Pending>,
    refused: u64,
}

impl Commands {
    /// Through vessel `vessel`, which started with this boot id.
    pub fn new(vessel: u32, boot: u32) -> Commands {
        Commands {
            vessel,
            boot,
            sequence: 0,
            pending: Vec::new(),
            refused: 0,
        }
    }
    /// Commands that were not passed on.
    pub fn refused(&self) -> u64 {
        self.refused
    }
    /// An admitted operator says this; true when it is news and on its way now.
    pub fn hear(&mut self, now: Time<VesselClock>, said: &OperatorCommand<VesselClock>) -> bool {
        let h = &said.header;
        let heard = (h.boot, h.sequence);
        let known = self.pending.iter().position(|p| p.drone == h.drone);
        let before = known.and_then(|k| self.pending.get(k));
        if before.is_some_and(|p| p.heard == heard) {
            return false;
        }
        let sound = h.version == MESSAGE_VERSION && h.vessel == self.vessel && h.drone != 0;
        let aborting = before.is_some_and(|p| !p.over && p.kind == CommandKind::Abort);
        let full = known.is_none() && self.pending.len() >= DRONES;
        if !sound || full || aborting && said.kind != CommandKind::Abort {
            self.refused = self.refused.saturating_add(1);
            return false;
        }
        let pending = Pending {
            drone: h.drone,
            kind: said.kind,
            given: now,
            next: now,
            heard,
            over: false,
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
        words: impl IntoIterator<Item = &'a DroneStatus>,
    ) -> Vec<OperatorCommand<VesselClock>> {
        for word in words {
            for p in &mut self.pending {
                // A word that was under way when the command was given shows nothing.
                if p.drone == word.header.drone && p.next > p.given {
                    p.over |= p.kind.is_met(word.state, word.waiting.code);
                }
            }
        }
        let mut out = Vec::new();
        for p in &mut self.pending {
            p.over |= now - p.given > LONGEST;
            if p.over || now < p.next {
                continue;
            }
            p.next = now + AGAIN;
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
    fn said(sequence: u32, drone: u32, kind: CommandKind) -> OperatorCommand<VesselClock> {
        OperatorCommand {
            header: Header::new(1, drone, 5, sequence, Time::EPOCH),
            kind,
        }
    }
    fn word(state: State, waiting: ReasonCode) -> DroneStatus {
        DroneStatus {
            header: Header::new(1, 3, 1, 1, Time::EPOCH),
            state,
            waiting: Reason::plain(waiting),
            ..DroneStatus::default()
        }
    }

    #[test]
    fn a_command_is_repeated_until_the_drone_shows_it() {
        let mut c = Commands::new(1, 9);
        assert!(c.hear(at(1.0), &said(1, 3, CommandKind::Land)));
        assert!(!c.hear(at(1.1), &said(1, 3, CommandKind::Land)), "a repetition");
        let idle = word(State::Idle, ReasonCode::NotCommanded);
        let sent: usize = (10..30)
            .map(|k| c.step(at(f64::from(k) * 0.1), [&idle]).len())
            .sum();
        assert_eq!(sent, 4);
        assert!(
            c.step(at(3.0), [&word(State::GetAltitude, ReasonCode::TooFar)])
                .is_empty()
        );
        assert!(c.step(at(4.0), []).is_empty());
        assert_eq!(c.refused(), 0);
    }

    #[test]
    fn an_abort_lets_nothing_past_until_it_is_taken() {
        let mut c = Commands::new(1, 9);
        c.hear(at(1.0), &said(1, 3, CommandKind::Land));
        assert_eq!(c.step(at(1.0), [])[0].kind, CommandKind::Land);
        assert!(c.hear(at(1.2), &said(2, 3, CommandKind::Abort)));
        assert!(!c.hear(at(1.3), &said(3, 3, CommandKind::Land)));
        let descent = word(State::Descent, ReasonCode::TooFar);
        assert_eq!(c.step(at(1.4), [&descent])[0].kind, CommandKind::Abort);
        let over = word(State::GaveUp, ReasonCode::NotCommanded);
        assert!(c.step(at(2.4), [&over]).is_empty());
        assert!(c.hear(at(2.5), &said(4, 3, CommandKind::Land)));
        assert_eq!(c.refused(), 1);
    }

    #[test]
    fn what_shows_no_effect_ends_and_what_is_not_ours_is_refused() {
        let mut c = Commands::new(1, 9);
        assert!(!c.hear(at(1.0), &said(1, 0, CommandKind::Abort)));
        let mut other = said(2, 3, CommandKind::Abort);
        other.header.vessel = 2;
        assert!(!c.hear(at(1.0), &other));
        assert_eq!(c.refused(), 2);
        c.hear(at(1.0), &said(3, 3, CommandKind::Hold));
        let sent: usize = (0..100)
            .map(|k| c.step(at(1.0 + f64::from(k) * 0.5), []).len())
            .sum();
        assert_eq!(sent, 21);
    }
}
