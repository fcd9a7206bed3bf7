//! Supervision of the drone's processes: restart, silence, scheduling.

use alight_shared::config;

/// Processors that a process can be kept to, at most.
const MAX_PROCESSORS: usize = 64;

config! {
    /// Supervision of the drone's processes.
    pub struct Supervision {
        /// Real-time priority (SCHED_FIFO) of the pilot and of the autopilot's link where the system permits it; 0: none.
        /// Source: Above the planner: a set-point takes microseconds, a plan milliseconds. Both
        /// below the kernel's own threads (50).
        pub pilot_priority: u8 = 30, in 0.0..=49.0;
        /// Period of the planner.
        pub planner_priority: u8 = 20, in 0.0..=49.0;
        /// Processors that pilot, planner and the autopilot's link keep to; empty: all.
        pub processors: Vec<u16> = Vec::new();
        /// The link to the autopilot is one of the processes; false where another program connects to it.
        /// Source: Every drone; false only where another program links to the autopilot.
        pub autopilot: bool = true;
        /// A process that reports nothing for this long is killed and restarted, s.
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
