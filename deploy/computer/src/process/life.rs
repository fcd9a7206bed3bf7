use std::{
    fs::File,
    io::{ErrorKind, Read},
    os::unix::fs::FileExt,
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use alight_shared::{
    metrics::{MetricName, Metrics},
    msg::Seq,
    process::{InputState, ProcessKind, ProcessState},
};
use alight_transport::{clock::steady_ns, statistics::Quantiles, wake::end_requested, warnings};
use rustix::time::{ClockId, clock_gettime};

use crate::{
    exit::{CliError, Doing},
    process::{lateness::Lateness, scheduling::begin_session},
    record::flight::recorder::{NodeRecorder, PartHeader},
};

const STATM: &str = "/proc/self/statm";
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
    statm: Option<File>,
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
            statm: File::open(STATM).ok(),
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
            cpu_s: processor_s(),
            resident_bytes: resident_bytes(self.statm.as_ref()),
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

/// Processor time of this process, s.
fn processor_s() -> f64 {
    let used = clock_gettime(ClockId::ProcessCPUTime);
    used.tv_sec as f64 + used.tv_nsec as f64 * 1e-9
}

/// Resident memory of this process, bytes, from `statm` of proc(5), which is opened once; zero without it.
fn resident_bytes(statm: Option<&File>) -> u64 {
    const PAGE: u64 = 4096;
    let mut text = [0; 128];
    let read = statm.and_then(|file| file.read_at(&mut text, 0).ok());
    let text = text.get(..read.unwrap_or(0)).unwrap_or_default();
    let mut fields = text.split(u8::is_ascii_whitespace);
    let pages = fields.nth(1).and_then(|pages| core::str::from_utf8(pages).ok());
    pages.and_then(|pages| pages.parse().ok()).unwrap_or(0) * PAGE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processor_time_and_memory_of_a_process() {
        let bytes = resident_bytes(File::open(STATM).ok().as_ref());
        assert!(processor_s() > 0.0 && bytes > 100_000, "{bytes} bytes");
    }
}
