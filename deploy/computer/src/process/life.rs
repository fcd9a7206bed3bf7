use std::io::{ErrorKind, Read};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use alight_shared::metrics::{MetricName, Metrics};
use alight_shared::msg::Seq;
use alight_shared::process::{InputState, ProcessKind, ProcessState};
use alight_transport::clock::steady_ns;
use alight_transport::statistics::Quantiles;
use alight_transport::wake::end_requested;
use alight_transport::warnings;

use crate::exit::{CliError, Doing};
use crate::process::lateness::Lateness;
use crate::process::scheduling::begin_session;
use crate::record::flight::recorder::{NodeRecorder, PartHeader};

const STATE_PERIOD_NS: i64 = 500_000_000;

pub struct Life {
    kind: ProcessKind,
    boot: u32,
    step_times: Quantiles,
    lateness: Lateness,
    steps: u64,
    began_ns: i64,
    next_state_ns: i64,
    end: Arc<AtomicBool>,
    pub metrics: Metrics,
}

impl Life {
    pub fn begin(kind: ProcessKind, boot: u32, supervised: bool) -> Life {
        let began_ns = steady_ns();
        Life {
            kind,
            boot,
            step_times: Quantiles::default(),
            lateness: Lateness::of(kind, began_ns),
            steps: 0,
            began_ns,
            next_state_ns: began_ns,
            end: end_with_supervisor(supervised),
            metrics: Metrics::default(),
        }
    }
    pub fn boot(&self) -> u32 {
        self.boot
    }
    pub fn stepped(&mut self, time_s: Option<f64>) {
        if let Some(time_s) = time_s {
            self.step_times.add(time_s);
        }
        self.steps += 1;
        self.lateness.step(steady_ns());
    }
    /// Makes the next state due now: the last one before an end.
    pub fn report_now(&mut self) {
        self.next_state_ns = steady_ns();
    }
    pub fn ended(&self) -> bool {
        self.end.load(Ordering::Relaxed) || end_requested()
    }
    pub fn state(&mut self, inputs: impl FnOnce() -> Vec<InputState>, unsent: u64) -> Option<ProcessState> {
        let now = steady_ns();
        if now < self.next_state_ns {
            return None;
        }
        self.next_state_ns = now + STATE_PERIOD_NS;
        let (cpu_s, resident_bytes) = usage();
        let mut metrics = self.metrics;
        for late in self.lateness.metrics() {
            // The capacity exceeds the number of metrics of any process.
            let _full = metrics.push(late);
        }
        let warned = warnings::counted();
        if warned > 0 {
            let _full = metrics.push(MetricName::MemoryWarnings.count(warned));
        }
        Some(ProcessState {
            kind: self.kind,
            pid: std::process::id(),
            boot: self.boot,
            at_ns: now,
            began_ns: self.began_ns,
            steps: self.steps,
            cpu_s,
            resident_bytes,
            step_p50_s: self.step_times.quantile(0.5),
            step_p99_s: self.step_times.quantile(0.99),
            unsent,
            metrics,
            inputs: Seq::filled(inputs()),
            flows: Seq::new(),
        })
    }
}

/// Draws a boot id that differs from that of the previous start.
pub fn draw_boot() -> u32 {
    // The steady clock in units of 65 us wraps after three days; the process id distinguishes two starts
    // within one unit.
    ((steady_ns() >> 16) as u32).wrapping_mul(0x9e37_79b1) ^ std::process::id()
}

/// Flag that is set when a supervised process's standard input closes. Such a process begins its own session.
pub fn end_with_supervisor(supervised: bool) -> Arc<AtomicBool> {
    let end = Arc::new(AtomicBool::new(false));
    if supervised {
        begin_session();
        let flag = Arc::clone(&end);
        std::thread::spawn(move || {
            // Nothing is ever written: the read ends when the supervisor does. A signal, such as SIGCONT after
            // SIGSTOP, may interrupt it earlier.
            while std::io::stdin()
                .read(&mut [0_u8; 1])
                .map_or_else(|e| e.kind() == ErrorKind::Interrupted, |read| read > 0)
            {}
            flag.store(true, Ordering::Relaxed);
        });
    }
    end
}

pub fn node_recorder(flight: &Path, name: &str, boot: u32, config: &Path) -> Result<NodeRecorder, CliError> {
    let config = std::fs::read_to_string(config).doing(format_args!("reading {}", config.display()))?;
    let header = PartHeader {
        process: name.into(),
        boot,
        began_ns: steady_ns(),
        first_step: 0,
        config,
    };
    Ok(NodeRecorder::begin(flight, header))
}

/// Processor time, s, and resident memory, bytes, of this process; zero on systems other than Linux.
pub fn usage() -> (f64, u64) {
    // Linux counts processor time in hundredths of a second for user space, and pages of 4 kB.
    const TICKS_PER_S: f64 = 100.0;
    const PAGE: u64 = 4096;
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // Fields are counted after the command name, which is in parentheses and may contain spaces.
    let after = stat.rsplit(')').next().unwrap_or_default();
    let ticks: f64 = after
        .split_whitespace()
        .skip(11)
        .take(2)
        .filter_map(|f| f.parse::<f64>().ok())
        .sum();
    let memory = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages: u64 = memory
        .split_whitespace()
        .nth(1)
        .and_then(|f| f.parse().ok())
        .unwrap_or(0);
    (ticks / TICKS_PER_S, pages * PAGE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processor_time_and_memory_of_a_process() {
        let (cpu_s, bytes) = usage();
        assert!(cpu_s >= 0.0 && bytes > 100_000, "{cpu_s} s, {bytes} bytes");
    }
}
