//! Signals that a test of faults sends to a process.

use iceoryx2_bb_posix::process::{Process, ProcessId};
use iceoryx2_bb_posix::signal::Signal as OsSignal;

use crate::TransportError;

/// What a test of faults sends to a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// SIGKILL.
    Kill,
    /// SIGSTOP.
    Freeze,
    /// SIGCONT.
    Continue,
}

/// Sends `signal` to the process `pid`.
pub fn signal(pid: u32, signal: Signal) -> Result<(), TransportError> {
    let doing = || format!("sending {signal:?} to process {pid}");
    let os_signal = match signal {
        Signal::Kill => OsSignal::Kill,
        Signal::Freeze => OsSignal::StopExecution,
        Signal::Continue => OsSignal::Continue,
    };
    // Zero and negative numbers mean groups of processes.
    let id = i32::try_from(pid)
        .ok()
        .filter(|id| *id > 0)
        .ok_or_else(|| TransportError::because(doing(), "not the number of a process"))?;
    Process::from_pid(ProcessId::new(id))
        .send_signal(os_signal)
        .map_err(|e| TransportError::because(doing(), e))
}
