//! Scheduling of processes: niceness, real-time priority, processors.

use std::fs;

use iceoryx2_bb_posix::process::Process;
use iceoryx2_bb_posix::scheduler::Scheduler;
use rustix::process::{getpriority_process, setpriority_process};
use rustix::thread::{CpuSet, sched_setaffinity};

/// Niceness of flight: before whatever else the computer does. Measured on two cores with twenty other busy
/// processes: ticks of the simulated world up to 6 s late without it.
const NICENESS: i32 = -10;

/// Real-time priority of a simulated world, before the processes of flight: what moves does not wait. Measured on two
/// cores during another landing's start: ticks up to 0.9 s late at that niceness alone, which the autopilot's link takes
/// for an autopilot that restarted.
const WORLD_PRIORITY: u8 = 40;

/// Niceness of this session where the system groups processes by session (`sched_autogroup`, sched(7)).
const SESSION: &str = "/proc/self/autogroup";

/// Asks for that niceness for this process and all that it starts; without the permission nothing changes.
pub fn raise() {
    let own = getpriority_process(None).unwrap_or(0);
    let _not_permitted = setpriority_process(None, own.min(NICENESS));
}

/// This session is before the others of the computer, until this is dropped.
#[must_use]
pub struct RaisedSession {
    before: Option<i32>,
}

/// Asks for that niceness for this session, too: where processes are grouped by session, that of a process counts within its
/// session alone. (A service has its weight by its unit, `CPUWeight`.) Without grouping or permission nothing changes.
pub fn raise_session() -> RaisedSession {
    let text = fs::read_to_string(SESSION).ok();
    let before = text.and_then(|text| text.trim().rsplit(' ').next()?.parse().ok());
    let lower = before.filter(|before| *before > NICENESS);
    RaisedSession {
        before: lower.filter(|_| fs::write(SESSION, NICENESS.to_string()).is_ok()),
    }
}

impl Drop for RaisedSession {
    fn drop(&mut self) {
        if let Some(before) = self.before {
            let _gone = fs::write(SESSION, before.to_string());
        }
    }
}

/// SCHED_FIFO at `priority` for this thread and those that it starts from now on; false where that is not
/// permitted.
pub fn set_real_time(priority: u8) -> bool {
    // The library's priorities, 0 to 255, are a scale over the kernel's 1 to 99; rounded up, none is lost.
    let scaled = u32::from(priority.clamp(1, 99) - 1) * 255;
    let scaled = u8::try_from(scaled.div_ceil(98)).unwrap_or(u8::MAX);
    let mut own = Process::from_self();
    own.set_scheduler(Scheduler::Fifo).is_ok() && own.set_priority(scaled).is_ok()
}

/// Raises a thread of the simulated world, where it is permitted.
pub fn set_real_time_world() {
    set_real_time(WORLD_PRIORITY);
}

/// The usual scheduling for this thread, whoever started it.
pub fn leave_real_time() {
    // From the usual one to itself is always permitted.
    let _same = Process::from_self().set_scheduler(Scheduler::Other);
}

/// Whether the system permits real-time priorities; tried on this thread for a moment.
pub fn real_time_permitted() -> bool {
    let mut own = Process::from_self();
    own.set_scheduler(Scheduler::Fifo).is_ok() && own.set_scheduler(Scheduler::Other).is_ok()
}

/// Keeps this thread and those that it starts from now on to these processors; false where there are none such.
pub fn keep_to(processors: &[u16]) -> bool {
    let mut set = CpuSet::new();
    let there = processors.iter().map(|p| usize::from(*p));
    there.filter(|p| *p < CpuSet::MAX_CPU).for_each(|p| set.set(p));
    sched_setaffinity(None, &set).is_ok()
}
