use super::fault::Fault;
use crate::harness::{failing::Failing, rig::Rig};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultTurn {
    Begins,
    Ends,
}

/// A fault in lock-step or in a live flight.
#[derive(Clone, Copy, Debug)]
pub struct FaultTimer {
    pub fault: Fault,
    pub began_s: Option<f64>,
    pub over: bool,
}

impl FaultTimer {
    pub const fn new(fault: Fault) -> FaultTimer {
        FaultTimer {
            fault,
            began_s: None,
            over: false,
        }
    }
    fn is_active(&self, t_s: f64) -> bool {
        self.began_s.is_some_and(|at| t_s < at + self.fault.lasts_s)
    }
    /// Returns the start or end due at `t_s`; `moment_s` is the time of the fault's moment.
    pub fn poll(&mut self, t_s: f64, moment_s: Option<f64>) -> Option<FaultTurn> {
        match self.began_s {
            None if moment_s.is_some_and(|at| t_s >= at + self.fault.after_s) => {
                self.began_s = Some(t_s);
                Some(FaultTurn::Begins)
            }
            Some(_) if !self.over && !self.is_active(t_s) => {
                self.over = true;
                Some(FaultTurn::Ends)
            }
            None | Some(_) => None,
        }
    }
}

pub(super) struct Scheduled {
    pub(super) timer: FaultTimer,
    /// At the fault's start, an abort or take-over stopped an operation.
    pub(super) stops: bool,
    /// Charge left after a battery fault, 0 to 1.
    pub(super) charge_left: Option<f64>,
}

impl Scheduled {
    /// Begins or ends the fault if due. `begins` is called at the start and returns true if it has given the
    /// fault's order.
    pub(super) fn step(&mut self, rig: &mut Rig, begins: impl FnOnce(&mut Rig, &mut Scheduled) -> bool) {
        let fault = self.timer.fault;
        match self.timer.poll(rig.t_s(), rig.moment_s(&fault)) {
            Some(FaultTurn::Begins) => {
                self.charge_left = fault.kind.empties().then_some(0.0);
                if !begins(rig, self) {
                    fault.kind.effect().begin(rig, fault.size);
                }
            }
            Some(FaultTurn::Ends) => {
                let charge = rig.world.linked(0).map(|l| l.autopilot.battery);
                self.charge_left = charge.filter(|_| fault.kind.empties());
                fault.kind.effect().end(rig, fault.size);
            }
            None => {}
        }
    }
}

pub struct Schedule(pub(super) Vec<Scheduled>);

impl Schedule {
    pub fn new(faults: &[Fault]) -> Schedule {
        let pending = |fault: &Fault| Scheduled {
            timer: FaultTimer::new(*fault),
            stops: false,
            charge_left: None,
        };
        Schedule(faults.iter().map(pending).collect())
    }
    /// Begins and ends faults before a tick, and applies the active ones. Does not touch the world without faults.
    pub fn act(&mut self, rig: &mut Rig) {
        for scheduled in &mut self.0 {
            scheduled.step(rig, |_, _| false);
        }
        if !self.0.is_empty() {
            rig.world.fail(&self.failing(rig.t_s()));
        }
    }
    pub(super) fn failing(&self, t_s: f64) -> Failing {
        let mut failing = Failing::default();
        for timer in self.0.iter().map(|f| &f.timer).filter(|t| t.is_active(t_s)) {
            timer.fault.kind.effect().apply(&mut failing, timer.fault.size);
        }
        failing
    }
}
