//! Scheduling of processes: niceness, real-time priority, processors.

use std::{
    env, fs,
    sync::atomic::{AtomicBool, Ordering},
};

use iceoryx2_bb_posix::{process::Process, scheduler::Scheduler};
use rustix::{
    mm::{MlockAllFlags, mlockall},
    process::{getpriority_process, setpriority_process, setsid},
    thread::{CpuSet, sched_setaffinity},
};

/// Niceness in flight, above the computer's other work. Measured on two cores with twenty other busy processes:
/// without it, ticks of the simulated world are up to 6 s late.
const NICENESS: i32 = -10;

/// Real-time priority of a simulated world, above the processes of flight, because physics does not wait. Measured on
/// two cores while another landing starts: with niceness alone, ticks are up to 0.9 s late, and the autopilot's link
/// infers a restart of the autopilot.
const WORLD_PRIORITY: u8 = 40;

/// Niceness of this session if the system groups processes by session (`sched_autogroup`, sched(7)).
const SESSION: &str = "/proc/self/autogroup";

/// Sets `NICENESS` for this process and its later children; has no effect without permission.
pub fn raise() {
    let own = getpriority_process(None).unwrap_or(0);
    let _not_permitted = setpriority_process(None, own.min(NICENESS));
}

/// Variable of the environment in which a process raises its own session.
pub const RAISED_VARIABLE: &str = "ALIGHT_RAISED_SESSION";

static RAISES_SESSIONS: AtomicBool = AtomicBool::new(false);

/// From now on, processes that this one starts also set `NICENESS` for their own sessions: if processes are grouped
/// by session, a process's niceness applies only within its session. (For a service, `CPUWeight` in its unit does
/// this.)
pub fn raise_sessions() {
    RAISES_SESSIONS.store(true, Ordering::Relaxed);
}

/// Variable for the processes that this one starts.
pub fn session_variable() -> Option<(&'static str, &'static str)> {
    if RAISES_SESSIONS.load(Ordering::Relaxed) {
        Some((RAISED_VARIABLE, "1"))
    } else {
        None
    }
}

/// Begins a session of this process: the terminal's Ctrl-C reaches only its starter, which ends all. Its priority has
/// no effect on the terminal's other programs, and none without permission.
pub fn begin_session() {
    if setsid().is_ok() && env::var_os(RAISED_VARIABLE).is_some() {
        let _not_permitted = fs::write(SESSION, NICENESS.to_string());
    }
}

/// Sets SCHED_FIFO at `priority` for this thread and its later children; false without permission.
pub fn set_real_time(priority: u8) -> bool {
    // The library scales its 0 to 255 to the kernel's 1 to 99; rounding up keeps each priority distinct.
    let scaled = u32::from(priority.clamp(1, 99) - 1) * 255;
    let scaled = u8::try_from(scaled.div_ceil(98)).unwrap_or(u8::MAX);
    let mut own = Process::from_self();
    own.set_scheduler(Scheduler::Fifo).is_ok() && own.set_priority(scaled).is_ok()
}

pub fn set_real_time_world() {
    set_real_time(WORLD_PRIORITY);
}

/// Keeps the present memory of this process, once used, from being reclaimed; false without permission.
pub fn lock_memory() -> bool {
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::ONFAULT).is_ok()
}

/// Restores this thread's default scheduling if it has inherited another.
pub fn leave_real_time() {
    // A change from the default policy to itself is always permitted.
    let _same = Process::from_self().set_scheduler(Scheduler::Other);
}

/// Whether the system permits real-time priorities, tested briefly on this thread.
pub fn real_time_permitted() -> bool {
    let mut own = Process::from_self();
    own.set_scheduler(Scheduler::Fifo).is_ok() && own.set_scheduler(Scheduler::Other).is_ok()
}

/// Restricts this thread and its later children to these processors; false if they do not exist.
pub fn keep_to(processors: &[u16]) -> bool {
    let mut set = CpuSet::new();
    let there = processors.iter().map(|p| usize::from(*p));
    for p in there.filter(|p| *p < CpuSet::MAX_CPU) {
        set.set(p);
    }
    sched_setaffinity(None, &set).is_ok()
}
