//! The operator relay: operators' commands on their way through the vessel to its drones.
//!
//! A command is sent to its drone at 2 Hz until the drone's status shows its effect, for 10 s at most; an abort until the
//! status echoes it, for as long as it takes, also through a new start of the vessel's process ([`PendingAbort`]). While an
//! abort has not shown its effect, no other command reaches that drone, and none that was given until then, nor a
//! landing that somebody else orders within a second of it, counts afterwards, nor in the vessel's next process
//! ([`VoidCommand`]). Each repetition bears the time at which
//! the command was given: what the drone was told since, by whomever, is newer.

use std::collections::VecDeque;

use alight_shared::msg::{
    CommandKind, DroneStatus, Header, MESSAGE_VERSION, OperatorCommand, UNAWARE_OF_ABORT,
};
use alight_shared::node::Node;
use alight_shared::time::{Span, Time, VesselClock};
use serde::{Deserialize, Serialize};

use super::MAX_DRONES;
use super::checkpoint::{Identity, PendingAbort, VoidCommand};

/// Time between two repetitions.
const REPEAT_PERIOD: Span = Span::from_millis(500);
/// A command other than an abort that shows no effect is given up after this long.
const TIMEOUT: Span = Span::from_millis(10_000);
/// Most commands that are remembered as void: an operator's terminal repeats its own for 12 s.
const MAX_VOID: usize = 4 * MAX_DRONES;

#[derive(Clone, Debug)]
struct Pending {
    drone: u32,
    kind: CommandKind,
    given: Time<VesselClock>,
    next: Time<VesselClock>,
    identity: Identity,
    /// Sequence that the first of its repetitions has at least.
    first: u32,
    /// In effect or given up: kept to recognise its repetitions.
    finished: bool,
}

impl Pending {
    /// Whether this abort keeps a command of `kind` away at `now`.
    fn forbids(&self, now: Time<VesselClock>, kind: CommandKind, identity: Identity) -> bool {
        // Who gave the abort knows of it.
        let unaware =
            kind == CommandKind::Land && identity.0 != self.identity.0 && now - self.given < UNAWARE_OF_ABORT;
        self.kind == CommandKind::Abort && kind != CommandKind::Abort && (!self.finished || unaware)
    }
}

/// What arrived since the last step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct OperatorIn {
    /// From operators whose certificates were accepted.
    pub commands: Vec<OperatorCommand<VesselClock>>,
    /// From drones.
    pub statuses: Vec<DroneStatus>,
    /// At the first step, the aborts that the former start left.
    pub aborts: Vec<PendingAbort>,
    /// And the commands that never count.
    pub void: Vec<VoidCommand>,
}

/// What the relay sends and has accepted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OperatorOut {
    /// Commands of this step that were new and valid, as the operators gave them.
    pub accepted: Vec<OperatorCommand<VesselClock>>,
    /// For the drones that their headers name.
    pub commands: Vec<OperatorCommand<VesselClock>>,
}

/// The node that passes commands on.
#[derive(Clone, Debug)]
pub struct OperatorRelay {
    vessel: u32,
    boot: u32,
    sequence: u32,
    pending: Vec<Pending>,
    /// Commands that an abort has made void, newest last: their repetitions never count.
    void: VecDeque<VoidCommand>,
    rejected: u64,
}

impl OperatorRelay {
    /// The relay of vessel `vessel`, which started with this boot id.
    pub fn new(vessel: u32, boot: u32) -> OperatorRelay {
        OperatorRelay {
            vessel,
            boot,
            sequence: 0,
            pending: Vec::new(),
            void: VecDeque::new(),
            rejected: 0,
        }
    }
    /// Commands that were not passed on.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }

    /// Aborts that no drone has acknowledged.
    pub fn aborts(&self) -> Vec<PendingAbort> {
        let pending = |p: &&Pending| !p.finished && p.kind == CommandKind::Abort;
        let abort = |p: &Pending| PendingAbort {
            drone: p.drone,
            given: p.given,
            identity: p.identity,
        };
        self.pending.iter().filter(pending).map(abort).collect()
    }

    /// Commands whose repetitions never count.
    pub fn void(&self) -> Vec<VoidCommand> {
        self.void.iter().copied().collect()
    }
    fn make_void(&mut self, drone: u32, identity: Identity) {
        if self.void.len() >= MAX_VOID {
            self.void.pop_front();
        }
        self.void.push_back(VoidCommand { drone, identity });
    }

    fn remember(&mut self, now: Time<VesselClock>, aborts: &[PendingAbort]) {
        self.pending = aborts
            .iter()
            .take(MAX_DRONES)
            .map(|a| Pending {
                drone: a.drone,
                kind: CommandKind::Abort,
                // A computer that was started anew counts its time from zero.
                given: a.given.min(now),
                next: now,
                identity: a.identity,
                first: self.sequence.wrapping_add(1),
                finished: false,
            })
            .collect();
    }

    /// Takes an operator's command; true when it is new and valid.
    fn accept(&mut self, now: Time<VesselClock>, command: &OperatorCommand<VesselClock>) -> bool {
        let h = &command.header;
        let identity = (h.boot, h.sequence);
        let index = self.pending.iter().position(|p| p.drone == h.drone);
        let full = index.is_none() && self.pending.len() >= MAX_DRONES;
        let before = index.and_then(|k| self.pending.get_mut(k));
        let void = VoidCommand {
            drone: h.drone,
            identity,
        };
        if before.as_ref().is_some_and(|p| p.identity == identity) || self.void.contains(&void) {
            return false;
        }
        let valid = h.version == MESSAGE_VERSION && h.vessel == self.vessel && h.drone != 0;
        if !valid || full {
            self.rejected = self.rejected.saturating_add(1);
            return false;
        }
        let pending = Pending {
            drone: h.drone,
            kind: command.kind,
            given: now,
            next: now,
            identity,
            first: self.sequence.wrapping_add(1),
            finished: false,
        };
        match before {
            Some(p) if p.forbids(now, command.kind, identity) => {
                self.make_void(h.drone, identity);
                self.rejected = self.rejected.saturating_add(1);
                return false;
            }
            Some(p) => {
                let before = core::mem::replace(p, pending);
                if command.kind == CommandKind::Abort {
                    self.make_void(h.drone, before.identity);
                }
            }
            None => self.pending.push(pending),
        }
        true
    }
}

impl Node for OperatorRelay {
    type Clock = VesselClock;
    type In = OperatorIn;
    type Out = OperatorOut;

    fn step(&mut self, now: Time<VesselClock>, input: &OperatorIn) -> OperatorOut {
        if self.pending.is_empty() {
            self.remember(now, &input.aborts);
        }
        for c in &input.void {
            self.make_void(c.drone, c.identity);
        }
        let new = |c: &&OperatorCommand<VesselClock>| self.accept(now, c);
        let mut out = OperatorOut {
            accepted: input.commands.iter().filter(new).copied().collect(),
            commands: Vec::new(),
        };
        for p in &mut self.pending {
            // An abort is answered by its own echo: another state shows what was before it as well.
            let boot = self.boot;
            let echoed = |s: &DroneStatus| s.abort.is_some_and(|[b, k]| b == boot && k >= p.first);
            // A status that was under way when the command was given shows nothing.
            let met = |s: &DroneStatus| {
                p.drone == s.header.drone
                    && match p.kind {
                        CommandKind::Abort => echoed(s),
                        CommandKind::Land | CommandKind::Hold => {
                            p.next > p.given && p.kind.is_met(s.state, s.waiting.code)
                        }
                    }
            };
            p.finished |=
                input.statuses.iter().any(met) || p.kind != CommandKind::Abort && now - p.given > TIMEOUT;
            if p.finished || now < p.next {
                continue;
            }
            p.next = now + REPEAT_PERIOD;
            self.sequence = self.sequence.wrapping_add(1);
            out.commands.push(OperatorCommand {
                header: Header::new(self.vessel, p.drone, self.boot, self.sequence, p.given),
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
    fn operator_relay_repeats_a_command_until_the_drone_status_shows_it() {
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
        let climbing = Some(status(State::GetAltitude, ReasonCode::TooFar));
        assert!(step(&mut relay, 3.0, None, climbing).1.is_empty());
        assert!(step(&mut relay, 4.0, None, None).1.is_empty());
        assert_eq!(relay.rejected(), 0);
    }

    #[test]
    fn operator_relay_holds_other_commands_back_until_an_abort_is_effective() {
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
        assert_eq!(relay.rejected(), 1);
    }

    #[test]
    fn landing_ordered_without_knowledge_of_an_abort_never_counts() {
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
        assert_eq!(relay.rejected(), 2);
        // Their terminals repeat them, also to the vessel's next process.
        for k in 0..24 {
            if k == 12 {
                let left = relay.void();
                relay = OperatorRelay::new(1, 10);
                relay.step(
                    Time::from_secs(8.9),
                    &OperatorIn {
                        void: left,
                        ..OperatorIn::default()
                    },
                );
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
    fn operator_relay_gives_up_after_10_s_and_rejects_foreign_commands() {
        let mut relay = OperatorRelay::new(1, 9);
        assert!(!step(&mut relay, 1.0, Some(command(1, 0, CommandKind::Abort)), None).0);
        let mut other = command(2, 3, CommandKind::Abort);
        other.header.vessel = 2;
        assert!(!step(&mut relay, 1.0, Some(other), None).0);
        assert_eq!(relay.rejected(), 2);
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
    fn operator_relay_repeats_an_abort_until_the_drone_shows_it_also_after_a_restart() {
        let mut relay = OperatorRelay::new(1, 9);
        let abort = Some(command(1, 3, CommandKind::Abort));
        assert!(step(&mut relay, 1.0, abort, None).0);
        let sent: usize = (1..1200)
            .map(|k| step(&mut relay, 1.0 + f64::from(k) * 0.5, None, None).1.len())
            .sum();
        assert_eq!(sent, 1199, "ten minutes without a radio");
        let left = relay.aborts();
        assert_eq!(left.len(), 1);
        // The vessel's process is started anew, then once more with its computer, whose clock begins at zero.
        for (t_s, given_s) in [(700.0, 1.0), (0.5, 0.5)] {
            let mut relay = OperatorRelay::new(1, 10);
            let input = OperatorIn {
                aborts: left.clone(),
                ..OperatorIn::default()
            };
            let out = relay.step(Time::from_secs(t_s), &input);
            assert_eq!(out.commands.len(), 1);
            assert_eq!(out.commands[0].kind, CommandKind::Abort);
            assert_eq!(out.commands[0].header.at, Time::from_secs(given_s));
            let land = Some(command(2, 3, CommandKind::Land));
            assert!(!step(&mut relay, t_s + 0.1, land, None).0);
            let over = echo(&relay);
            assert!(step(&mut relay, t_s + 0.6, None, over).1.is_empty());
            assert!(relay.aborts().is_empty());
        }
    }

    #[test]
    fn operator_relay_repeats_a_command_with_the_time_at_which_it_was_given() {
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
}
