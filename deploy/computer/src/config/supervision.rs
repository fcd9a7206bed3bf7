//! Supervision of the drone's processes: restart, silence, scheduling.

use alight_shared::config;

/// Maximum number of processors in the list.
const MAX_PROCESSORS: usize = 64;

config! {
    /// Supervision of the drone's processes.
    pub struct Supervision {
        /// Real-time priority (SCHED_FIFO) of the pilot and of the autopilot's link, if the system permits it; 0: none.
        /// Source: Above the planner, because a set-point takes microseconds and a plan milliseconds. Both below the
        /// kernel's own threads (50).
        pub pilot_priority: u8 = 30, in 0.0..=49.0;
        /// Real-time priority of the planner; 0: none.
        pub planner_priority: u8 = 20, in 0.0..=49.0;
        /// Processors for pilot, planner and the autopilot's link; empty: all.
        pub processors: Vec<u16> = Vec::new();
        /// The link to the autopilot is one of the processes; false if another program connects to the autopilot.
        /// Source: Every drone except those whose autopilot another program connects to.
        pub autopilot: bool = true;
        /// Silence after which a process is killed and restarted, s.
        /// Source: Six times the period of the reports.
        pub silent_s: f64 = 3.0, in 1.5..=600.0;
    }
    check |this, at| {
        at.require(
            this.processors.len() <= MAX_PROCESSORS,
            "processors",
            this.processors.len(),
            "64 numbers at most",
        )?;
    }
}
