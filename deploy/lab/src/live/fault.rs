//! A fault put into a running landing: a process killed, or frozen for a moment, in a phase or at the first contact.

use core::fmt;
use core::str::FromStr;

use alight_shared::msg::{MissionState, State};
use alight_shared::process::{ProcessKind, ProcessState};
use alight_sim::harness::storm::{self, FaultKind, Moment};
use alight_transport::signal::Signal;
use serde::{Deserialize, Serialize};

use crate::args::{PHASES, phase};

/// The name of the first contact among the phases.
const CONTACT: &str = "contact";

/// A fault of one process as it is asked for, `KIND:PHASE` with the kinds of a storm's list; its times are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultSpec {
    pub kind: FaultKind,
    pub moment: Moment,
}

/// The kinds that happen to one process.
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
    /// As it was asked for.
    pub fault: String,
    /// When it happened, time since the start, s; null if it never did.
    pub at_s: Option<f64>,
    /// The mission's state when it happened.
    pub state: Option<State>,
    /// From the fault to the first message of the process afterwards, s; null if none came.
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
            _ => f.write_str("its phase did not come"),
        }
    }
}

/// Observation of a landing under way.
#[derive(Clone, Copy, Debug)]
pub struct FaultInput {
    /// Time since the start, s.
    pub t_s: f64,
    pub mission: Option<MissionState>,
    /// The process that the fault meets.
    pub process: Option<ProcessState>,
    /// The drone has touched something.
    pub contact: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum FaultStage {
    /// The state has not been entered yet.
    Waits,
    /// It will happen at this time of the steady clock, ns.
    Due(i64),
    /// It happened at this time to this process id, which stays frozen until then.
    Happened {
        at_ns: i64,
        pid: u32,
        frozen_until_ns: Option<i64>,
    },
    /// Messages of the process arrive again, or nothing more is to be done.
    Over,
}

/// A fault of a process under way.
pub struct ProcessFault {
    spec: FaultSpec,
    process: ProcessKind,
    delay_ns: i64,
    /// Time that a frozen process stays frozen, ns.
    freeze_ns: i64,
    stage: FaultStage,
    /// Report so far.
    pub report: FaultReport,
}

impl ProcessFault {
    /// The fault, with its delay after the moment's beginning, and for how long it freezes, drawn from the seed; None: its kind
    /// happens to no process.
    pub fn new(spec: FaultSpec, seed: u64) -> Option<ProcessFault> {
        ProcessFault::of(&storm::Fault::drawn(spec.kind, spec.moment, seed))
    }
    /// A fault of a storm's list.
    pub fn of(fault: &storm::Fault) -> Option<ProcessFault> {
        let spec = FaultSpec {
            kind: fault.kind,
            moment: fault.moment,
        };
        Some(ProcessFault {
            process: fault.kind.process()?,
            spec,
            delay_ns: (fault.after_s * 1e9) as i64,
            freeze_ns: (fault.lasts_s * 1e9) as i64,
            stage: FaultStage::Waits,
            report: FaultReport {
                fault: spec.to_string(),
                at_s: None,
                state: None,
                recovery_s: None,
            },
        })
    }

    /// The process; not the world, which is the vehicles themselves.
    pub const fn process(&self) -> ProcessKind {
        self.process
    }
    /// The process stands still, and is not killed.
    pub fn freezes(&self) -> bool {
        self.spec.kind.freezes()
    }
    /// It happened, and no message of the process has arrived since.
    pub fn is_under_way(&self) -> bool {
        matches!(self.stage, FaultStage::Happened { .. })
    }

    /// The signal to send now, and its process id.
    pub fn poll(&mut self, now_ns: i64, input: &FaultInput) -> Option<(u32, Signal)> {
        let (mission, process) = input.mission.zip(input.process)?;
        match self.stage {
            FaultStage::Waits => {
                let begun = match self.spec.moment {
                    Moment::In(state) => mission.state == state,
                    Moment::Contact => input.contact,
                };
                if begun {
                    self.stage = FaultStage::Due(now_ns + self.delay_ns);
                }
                None
            }
            FaultStage::Due(at_ns) if now_ns >= at_ns => {
                let (what, frozen_until_ns) = if self.freezes() {
                    (Signal::Freeze, Some(now_ns + self.freeze_ns))
                } else {
                    (Signal::Kill, None)
                };
                (self.report.at_s, self.report.state) = (Some(input.t_s), Some(mission.state));
                self.stage = FaultStage::Happened {
                    at_ns: now_ns,
                    pid: process.pid,
                    frozen_until_ns,
                };
                Some((process.pid, what))
            }
            FaultStage::Happened {
                at_ns,
                pid,
                frozen_until_ns: Some(until),
            } if now_ns >= until => {
                self.stage = FaultStage::Happened {
                    at_ns,
                    pid,
                    frozen_until_ns: None,
                };
                Some((pid, Signal::Continue))
            }
            FaultStage::Happened {
                at_ns,
                pid,
                frozen_until_ns: None,
            } if process.at_ns > at_ns && (self.freezes() || process.pid != pid) => {
                self.report.recovery_s = Some((process.at_ns - at_ns) as f64 * 1e-9);
                self.stage = FaultStage::Over;
                None
            }
            FaultStage::Due(_) | FaultStage::Happened { .. } | FaultStage::Over => None,
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

    #[test]
    fn frozen_process_from_its_moment_to_its_next_report() {
        let spec: FaultSpec = "pilot-frozen:contact".parse().unwrap();
        let mut fault = ProcessFault::new(spec, 7).unwrap();
        let input = |contact, at_ns| FaultInput {
            t_s: 12.0,
            mission: Some(MissionState::default()),
            process: Some(ProcessState {
                pid: 42,
                at_ns,
                ..ProcessState::default()
            }),
            contact,
        };
        assert_eq!(fault.poll(1_000, &input(false, 0)), None);
        // The contact begins the moment, and the fault is due at once.
        assert_eq!(fault.poll(2_000, &input(true, 0)), None);
        assert_eq!(fault.poll(3_000, &input(true, 0)), Some((42, Signal::Freeze)));
        assert_eq!((fault.report.at_s, fault.is_under_way()), (Some(12.0), true));
        // Frozen for 0.2 s at least and 2 s at most.
        assert_eq!(fault.poll(200_000_000, &input(true, 0)), None);
        let end_ns = 2_100_000_000;
        assert_eq!(fault.poll(end_ns, &input(true, 0)), Some((42, Signal::Continue)));
        assert_eq!(fault.poll(end_ns, &input(true, 0)), None);
        assert!(fault.is_under_way());
        assert_eq!(fault.poll(end_ns, &input(true, 2_000_003_000)), None);
        assert_eq!(fault.report.recovery_s, Some(2.0));
        assert!(!fault.is_under_way());
    }
}
