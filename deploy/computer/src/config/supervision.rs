use alight_shared::config;

const MAX_PROCESSORS: usize = 64;

config! {
    /// Supervision of the drone's processes.
    pub struct Supervision {
        /// Real-time priority (SCHED_FIFO) of the pilot and of the autopilot's link, if the system permits it; 0:
        /// none. Source: Above the planner's, because a set-point takes microseconds and a plan milliseconds. Both
        /// are below the kernel's own threads (50).
        pub pilot_priority: u8 = 30, in 0.0..=49.0;
        /// Real-time priority of the planner; 0: none. Predictor and mission have one between these two.
        pub planner_priority: u8 = 20, in 0.0..=49.0;
        /// Processors on which these processes run; empty: all.
        pub processors: Vec<u16> = Vec::new();
        /// The autopilot's link is one of the processes; false if another program connects to the autopilot. Source:
        /// Most drones connect directly.
        pub autopilot: bool = true;
        /// Silence after which a process is killed and restarted, s. Source: Six times the reporting period.
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
