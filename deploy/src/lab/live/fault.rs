//! A fault put into a running landing: a process killed, or frozen for a moment, in a phase or at the first contact.

use core::fmt;
use core::str::FromStr;

use alight_shared::msg::{MissionState, State};
use alight_shared::transport::process::{ProcessKind, Signal, signal};
use alight_sim::harness::fault::{FaultKind, FaultTimes, Moment};
use serde::{Deserialize, Serialize};

use crate::exit::{CliError, Doing};
use crate::lab::args::{PHASES, phase};
use crate::process::snapshot::Snapshot;

/// The name of the first contact among the phases.
const CONTACT: &str = "contact";

/// A fault as it is asked for: `PROCESS:kill|freeze:PHASE`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultSpec {
    /// Which process; not the world, which is the vehicles themselves.
    pub process: ProcessKind,
    /// What happens to it.
    pub kind: FaultKind,
    /// When.
    pub moment: Moment,
}

/// Processes that a fault can meet: all but the world, which stands for the vehicles and the laws
/// of physics.
pub const PROCESSES: [ProcessKind; 7] = [
    ProcessKind::Vessel,
    ProcessKind::Bridge,
    ProcessKind::Predictor,
    ProcessKind::Mission,
    ProcessKind::Planner,
    ProcessKind::Pilot,
    ProcessKind::Autopilot,
];

impl FromStr for FaultSpec {
    type Err = String;
    fn from_str(text: &str) -> Result<FaultSpec, String> {
        let form = || format!("{text:?}: write PROCESS:kill|freeze:PHASE, such as planner:kill:descent");
        let mut parts = text.split(':');
        let (Some(process), Some(kind), Some(state), None) =
            (parts.next(), parts.next(), parts.next(), parts.next())
        else {
            return Err(form());
        };
        let named = |names: Vec<&str>, what: &str| format!("no {what} of that name: {}", names.join(", "));
        let process = *PROCESSES.iter().find(|p| p.name() == process).ok_or_else(|| {
            named(
                PROCESSES.iter().map(|p| p.name()).collect(),
                "process that can fail",
            )
        })?;
        let kind = *FaultKind::ALL
            .iter()
            .find(|k| k.name() == kind)
            .ok_or_else(form)?;
        let moment = if state == CONTACT {
            Moment::Contact
        } else {
            Moment::In(phase(state).map_err(|e| format!("{e}, {CONTACT}"))?)
        };
        Ok(FaultSpec {
            process,
            kind,
            moment,
        })
    }
}

impl fmt::Display for FaultSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let moment = match self.moment {
            Moment::In(state) => PHASES.iter().find(|p| p.1 == state).map_or("?", |p| p.0),
            Moment::Contact => CONTACT,
        };
        write!(f, "{}:{}:{moment}", self.process.name(), self.kind.name())
    }
}

/// What came of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultReport {
    /// As it was asked for.
    pub fault: String,
    /// When it happened, time since the start, s; null if it never did.
    pub at_s: Option<f64>,
    /// The mission's state when it happened.
    pub state: Option<State>,
    /// From the fault to the first word of the process afterwards, s; null if none came.
    pub recovery_s: Option<f64>,
}

/// How far it has come.
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
    /// The process has been heard again, or nothing more is to be done.
    Over,
}

/// A fault under way.
pub struct Fault {
    spec: FaultSpec,
    delay_ns: i64,
    /// How long a frozen process stays frozen, ns.
    freeze_ns: i64,
    stage: FaultStage,
    /// What came of it so far.
    pub report: FaultReport,
}

impl Fault {
    /// The fault, with its delay after the moment's beginning, and for how long it freezes, drawn from the seed.
    pub fn new(spec: FaultSpec, seed: u64) -> Fault {
        let times = FaultTimes::drawn(spec.moment, seed);
        Fault {
            spec,
            delay_ns: (times.delay_s * 1e9) as i64,
            freeze_ns: (times.frozen_s * 1e9) as i64,
            stage: FaultStage::Waits,
            report: FaultReport {
                fault: spec.to_string(),
                at_s: None,
                state: None,
                recovery_s: None,
            },
        }
    }

    /// It happened, and the process has not been heard again.
    pub fn is_under_way(&self) -> bool {
        matches!(self.stage, FaultStage::Happened { .. })
    }

    /// Looks whether it is time for something; `t_s` is the time since the start, `contact` whether there was one.
    /// True when the fault has just happened.
    pub fn poll(
        &mut self,
        now_ns: i64,
        t_s: f64,
        snapshot: &Snapshot,
        contact: bool,
    ) -> Result<bool, CliError> {
        let Some(mission) = snapshot.mission else {
            return Ok(false);
        };
        match self.stage {
            FaultStage::Waits => {
                let begun = match self.spec.moment {
                    Moment::In(state) => mission.state == state,
                    Moment::Contact => contact,
                };
                if begun {
                    self.stage = FaultStage::Due(now_ns + self.delay_ns);
                }
            }
            FaultStage::Due(at_ns) if now_ns >= at_ns => return self.inject(now_ns, t_s, &mission, snapshot),
            FaultStage::Happened {
                at_ns,
                pid,
                frozen_until_ns,
            } => {
                if frozen_until_ns.is_some_and(|until| now_ns >= until) {
                    self.send(pid, Signal::Continue)?;
                    self.stage = FaultStage::Happened {
                        at_ns,
                        pid,
                        frozen_until_ns: None,
                    };
                } else if frozen_until_ns.is_none()
                    && let Some(p) = snapshot.processes.get(&self.spec.process)
                    && p.at_ns > at_ns
                    && (self.spec.kind == FaultKind::Freeze || p.pid != pid)
                {
                    self.report.recovery_s = Some((p.at_ns - at_ns) as f64 * 1e-9);
                    self.stage = FaultStage::Over;
                }
            }
            FaultStage::Due(_) | FaultStage::Over => {}
        }
        Ok(false)
    }

    fn inject(
        &mut self,
        now_ns: i64,
        t_s: f64,
        mission: &MissionState,
        snapshot: &Snapshot,
    ) -> Result<bool, CliError> {
        let Some(process) = snapshot.processes.get(&self.spec.process) else {
            return Ok(false);
        };
        let frozen_until_ns = match self.spec.kind {
            FaultKind::Kill => {
                self.send(process.pid, Signal::Kill)?;
                None
            }
            FaultKind::Freeze => {
                self.send(process.pid, Signal::Freeze)?;
                Some(now_ns + self.freeze_ns)
            }
        };
        self.report.at_s = Some(t_s);
        self.report.state = Some(mission.state);
        self.stage = FaultStage::Happened {
            at_ns: now_ns,
            pid: process.pid,
            frozen_until_ns,
        };
        Ok(true)
    }

    fn send(&self, pid: u32, what: Signal) -> Result<(), CliError> {
        signal(pid, what).doing(format_args!("the fault {}", self.spec))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_spec_round_trip_and_rejection() {
        for process in PROCESSES {
            for kind in FaultKind::ALL {
                let moments = PHASES.map(|(_, state)| Moment::In(state));
                for moment in moments.into_iter().chain([Moment::Contact]) {
                    let spec = FaultSpec {
                        process,
                        kind,
                        moment,
                    };
                    assert_eq!(spec.to_string().parse(), Ok(spec));
                }
            }
        }
        for text in [
            "planner",
            "world:kill:flare",
            "planner:hit:flare",
            "planner:kill:soon",
            "a:b:c:d",
        ] {
            assert!(text.parse::<FaultSpec>().is_err(), "{text}");
        }
    }
}
