//! Fault injected into a running landing, in a phase or at the first contact: a killed or briefly frozen process, or
//! an order.

use core::{fmt, str::FromStr};

use alight_shared::{
    msg::{CommandKind, MissionState, State},
    process::{ProcessKind, ProcessState},
};
use alight_sim::harness::storm::{self, FaultKind, FaultTimer, FaultTurn, Moment};
use alight_transport::signal::Signal;
use serde::{Deserialize, Serialize};

use crate::args::{PHASES, phase};

const CONTACT: &str = "contact";

/// Requested fault of one process, `KIND:PHASE` with the kinds of a storm's list; the times are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultSpec {
    pub kind: FaultKind,
    pub moment: Moment,
}

fn kinds() -> impl Iterator<Item = FaultKind> {
    FaultKind::ALL
        .iter()
        .copied()
        .filter(|kind| kind.process().is_some())
}

impl FromStr for FaultSpec {
    type Err = String;
    fn from_str(text: &str) -> Result<FaultSpec, String> {
        let Some((kind, state)) = text.split_once(':') else {
            return Err(format!(
                "{text:?}: write KIND:PHASE, such as planner-killed:descent"
            ));
        };
        let kind = kinds().find(|known| known.name() == kind).ok_or_else(|| {
            let names: Vec<&str> = kinds().map(FaultKind::name).collect();
            format!(
                "{text:?}: write KIND:PHASE, such as planner-killed:descent, with a kind of these: {}",
                names.join(", ")
            )
        })?;
        let moment = if state == CONTACT {
            Moment::Contact
        } else {
            Moment::In(phase(state).map_err(|e| format!("{e}, {CONTACT}"))?)
        };
        Ok(FaultSpec { kind, moment })
    }
}

impl fmt::Display for FaultSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let moment = match self.moment {
            Moment::In(state) => {
                let phase = PHASES.iter().find(|p| p.1 == state);
                phase.map_or(state.name(), |p| p.0)
            }
            Moment::Contact => CONTACT,
        };
        write!(f, "{}:{moment}", self.kind.name())
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultReport {
    pub fault: String,
    /// Time of the fault since the start, s; null if it did not occur.
    pub at_s: Option<f64>,
    pub state: Option<State>,
    /// Time from the fault to the next message of the process, s; null if none arrived.
    pub recovery_s: Option<f64>,
}

impl fmt::Display for FaultReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.at_s, self.state, self.recovery_s) {
            (Some(at), Some(state), Some(back)) => {
                write!(
                    f,
                    "at {at:.2} s in {}, reported again after {back:.2} s",
                    state.name()
                )
            }
            (Some(at), Some(state), None) => write!(f, "at {at:.2} s in {}, no report since", state.name()),
            _ => f.write_str("its phase was not reached"),
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub struct FaultInput {
    pub t_s: f64,
    pub mission: Option<MissionState>,
    pub process: Option<ProcessState>,
    pub contact: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LiveAct {
    Signal(u32, Signal),
    Order(CommandKind),
}

pub const ORDERS: [(FaultKind, CommandKind); 3] = [
    (FaultKind::Abort, CommandKind::Abort),
    (FaultKind::Hold, CommandKind::Hold),
    (FaultKind::OrderedAgain, CommandKind::Land),
];

pub struct LiveFault {
    timer: FaultTimer,
    /// Start of the phase or time of the contact, since the start of the landing, s.
    moment_s: Option<f64>,
    /// Time of the fault on the steady clock, ns, and process id; None once the process reports again.
    met: Option<(i64, u32)>,
    pub report: FaultReport,
}

impl LiveFault {
    /// Fault whose freeze duration and delay after the start of the phase are drawn from the seed; None if its kind
    /// affects no process.
    pub fn new(spec: FaultSpec, seed: u64) -> Option<LiveFault> {
        spec.kind.process()?;
        Some(LiveFault::of(&storm::Fault::drawn(spec.kind, spec.moment, seed)))
    }
    pub fn of(fault: &storm::Fault) -> LiveFault {
        let spec = FaultSpec {
            kind: fault.kind,
            moment: fault.moment,
        };
        LiveFault {
            timer: FaultTimer::new(*fault),
            moment_s: None,
            met: None,
            report: FaultReport {
                fault: spec.to_string(),
                at_s: None,
                state: None,
                recovery_s: None,
            },
        }
    }

    /// Process that the fault affects; None for an order. It is never the world's, which simulates the vehicles.
    pub fn process(&self) -> Option<ProcessKind> {
        self.timer.fault.kind.process()
    }
    pub fn freezes(&self) -> bool {
        self.timer.fault.kind.freezes()
    }
    /// Whether the fault has occurred and no later message of the process has arrived.
    pub fn is_under_way(&self) -> bool {
        self.met.is_some()
    }

    pub fn poll(&mut self, now_ns: i64, input: &FaultInput) -> Option<LiveAct> {
        let mission = input.mission?;
        let begun = match self.timer.fault.moment {
            Moment::In(state) => mission.state == state,
            Moment::Contact => input.contact,
        };
        if begun {
            self.moment_s.get_or_insert(input.t_s);
        }
        if let Some((_, order)) = ORDERS.iter().find(|(kind, _)| *kind == self.timer.fault.kind) {
            let turn = self.timer.poll(input.t_s, self.moment_s)?;
            return (turn == FaultTurn::Begins).then_some(LiveAct::Order(*order));
        }
        let process = input.process?;
        match (self.timer.poll(input.t_s, self.moment_s), self.met) {
            (Some(FaultTurn::Begins), _) => {
                self.report.at_s = Some(input.t_s);
                self.report.state = Some(mission.state);
                self.met = Some((now_ns, process.pid));
                let what = if self.freezes() {
                    Signal::Freeze
                } else {
                    Signal::Kill
                };
                Some(LiveAct::Signal(process.pid, what))
            }
            (Some(FaultTurn::Ends), Some((_, pid))) if self.freezes() => {
                Some(LiveAct::Signal(pid, Signal::Continue))
            }
            (_, Some((at_ns, pid))) => {
                let back = if self.freezes() {
                    self.timer.over
                } else {
                    process.pid != pid
                };
                if back && process.at_ns > at_ns {
                    self.report.recovery_s = Some((process.at_ns - at_ns) as f64 * 1e-9);
                    self.met = None;
                }
                None
            }
            (_, None) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_spec_round_trip_and_rejection() {
        for kind in kinds() {
            let moments = PHASES.map(|(_, state)| Moment::In(state));
            for moment in moments.into_iter().chain([Moment::Contact]) {
                let spec = FaultSpec { kind, moment };
                assert_eq!(spec.to_string().parse(), Ok(spec));
            }
        }
        for text in [
            "planner",
            "world-killed:flare",
            "planner-killed:soon",
            "radio-lost:flare",
            "planner-killed",
            "a:b:c:d",
        ] {
            assert!(text.parse::<FaultSpec>().is_err(), "{text}");
        }
    }

    /// Input in this state, with a process whose last report was at `at_ns`.
    fn input(t_s: f64, (state, contact): (State, bool), at_ns: i64) -> FaultInput {
        let mission = MissionState {
            state,
            ..MissionState::default()
        };
        let process = ProcessState {
            pid: 42,
            at_ns,
            ..ProcessState::default()
        };
        FaultInput {
            t_s,
            mission: Some(mission),
            process: Some(process),
            contact,
        }
    }

    #[test]
    fn frozen_process_from_its_moment_to_its_next_report() {
        let spec: FaultSpec = "pilot-frozen:contact".parse().unwrap();
        let mut fault = LiveFault::new(spec, 7).unwrap();
        let mut poll = |t_s: f64, contact, at_s: f64| {
            let input = input(t_s, (State::Flare, contact), (1e9 * at_s) as i64);
            let act = fault.poll((1e9 * t_s) as i64, &input);
            (act, fault.is_under_way(), fault.report.recovery_s)
        };
        assert_eq!(poll(12.0, false, 11.9), (None, false, None));
        // The contact begins the phase, and the fault is due at once.
        let freezes = Some(LiveAct::Signal(42, Signal::Freeze));
        assert_eq!(poll(12.1, true, 12.0), (freezes, true, None));
        // Frozen for 0.2 to 2 s; messages sent before the freeze arrive late.
        assert_eq!(poll(12.2, true, 12.15), (None, true, None));
        let continues = Some(LiveAct::Signal(42, Signal::Continue));
        assert_eq!(poll(14.2, true, 12.1), (continues, true, None));
        assert_eq!(poll(14.3, true, 12.1), (None, true, None));
        assert_eq!(poll(14.4, true, 14.35), (None, false, Some(2.25)));
        assert_eq!(fault.report.at_s, Some(12.1));
    }

    #[test]
    fn order_once_after_its_state() {
        let moment = Moment::In(State::Descent);
        let mut order = LiveFault::of(&storm::Fault::new(FaultKind::Abort, moment, 0.5, 0.0));
        let mut poll = |t_s, state| order.poll(0, &input(t_s, (state, false), 0));
        assert_eq!(poll(1.0, State::Tracking), None);
        assert_eq!(poll(2.0, State::Descent), None);
        assert_eq!(
            poll(2.6, State::Tracking),
            Some(LiveAct::Order(CommandKind::Abort))
        );
        assert_eq!(poll(2.7, State::Descent), None);
    }
}
