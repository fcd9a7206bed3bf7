use alight_shared::{
    msg::{AutopilotMode, CommandKind, DeckOrder, LandedState},
    process::ProcessKind,
    time::Span,
};
use alight_uav::autopilot::message::MavResult;
use alight_usv::deck::DeckInputs;
use nalgebra::Vector3;

use super::kinds::{FaultKind, each_kind};
use crate::{
    autopilots::simulated::{SimulatedAutopilot, mode_number},
    harness::{failing::Failing, rig::Rig, world::Checkpoints},
    radio::ChannelFault,
};

/// Effect of a fault on the world, as a function of its size.
#[derive(Clone, Copy, Debug)]
pub enum Effect {
    /// Active while the fault lasts.
    Lasting(fn(&mut Failing, f64)),
    /// Called at the fault's start, and at its end.
    Events(fn(&mut Rig, f64), fn(&mut Rig, f64)),
    /// Called at the fault's start.
    Once(fn(&mut Rig, f64)),
    /// The process is killed, and started at the fault's end.
    Kills(ProcessKind),
    /// The process is frozen while the fault lasts, and afterwards unaware of the elapsed time.
    Freezes(ProcessKind),
}
use Effect::{Events, Freezes, Kills, Lasting, Once};

impl Effect {
    pub fn begin(self, rig: &mut Rig, size: f64) {
        match self {
            Events(begin, _) | Once(begin) => begin(rig, size),
            Kills(ProcessKind::Vessel) => rig.restart_vessel(),
            Kills(process) => rig.world.kill(0, process),
            Lasting(_) | Freezes(_) => {}
        }
    }
    pub fn end(self, rig: &mut Rig, size: f64) {
        match self {
            Events(_, end) => end(rig, size),
            Kills(process) if process != ProcessKind::Vessel => rig.world.start(0, process, kept(size)),
            Lasting(_) | Once(_) | Kills(_) | Freezes(_) => {}
        }
    }
    /// Whether the effect is active while the fault lasts.
    pub const fn lasts(self) -> bool {
        matches!(self, Lasting(_) | Freezes(_))
    }
    /// Adds the effect of a fault that lasts.
    pub fn apply(self, failing: &mut Failing, size: f64) {
        match self {
            Lasting(fail) => fail(failing, size),
            Freezes(ProcessKind::Vessel) => failing.frozen.vessel = true,
            Freezes(process) => failing.frozen.processes.push(process),
            Events(..) | Once(_) | Kills(_) => {}
        }
    }
}

const LOST: ChannelFault = ChannelFault {
    loss: 1.0,
    delay_s: 0.0,
    jitter_s: 0.0,
    doubled: 0.0,
};

/// Checkpoints are lost if the size is 0.5 or more.
fn kept(size: f64) -> Checkpoints {
    if size >= 0.5 {
        Checkpoints::Lost
    } else {
        Checkpoints::Kept
    }
}
/// Enters the mode by the pilot's switch, or from the ground station.
fn choose(rig: &mut Rig, mode: AutopilotMode) {
    if let Some(linked) = rig.world.linked(0) {
        let autopilot = &mut linked.autopilot;
        autopilot.choose(mode_number(autopilot.firmware(), mode));
    }
}

fn move_stick(rig: &mut Rig) {
    if let Some(linked) = rig.world.linked(0) {
        linked.autopilot.move_stick();
    }
}
/// Gives the mode back after a stick has taken it.
fn give_back(rig: &mut Rig) {
    let flown_by_hand = |a: &SimulatedAutopilot| a.firmware().mode(a.chosen()) == AutopilotMode::Other;
    if rig.world.linked(0).is_some_and(|l| flown_by_hand(&l.autopilot)) {
        choose(rig, AutopilotMode::Offboard);
    }
}

fn occupy(rig: &mut Rig, occupied: bool) {
    rig.world.deck_inputs(DeckInputs {
        occupied: Some(occupied),
        ..DeckInputs::default()
    });
}

/// Implements [`Effect`] from the last column of `each_kind`.
macro_rules! effects {
    ($($(#[$doc:meta])* $kind:ident, $name:literal, $of:literal, $size:expr, $lasts:expr, $takes:ident, $effect:expr;)*) => {
        impl FaultKind {
            pub const fn effect(self) -> Effect {
                match self { $(FaultKind::$kind => $effect,)* }
            }
            /// Process that the fault kills or freezes, if any.
            pub const fn process(self) -> Option<ProcessKind> {
                match self.effect() {
                    Kills(process) | Freezes(process) => Some(process),
                    Lasting(_) | Events(..) | Once(_) => None,
                }
            }
            pub const fn freezes(self) -> bool {
                matches!(self.effect(), Freezes(_))
            }
        }
    };
}
each_kind!(effects);
