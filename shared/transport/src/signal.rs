//! Termination signals, and signals sent by fault tests.

use std::sync::{
    Arc, LazyLock,
    atomic::{AtomicBool, Ordering},
};

use iceoryx2_bb_posix::{
    process::{Process, ProcessId},
    signal::{Signal as OsSignal, SignalHandler},
};
use signal_hook::consts::{SIGINT, SIGTERM};

use crate::TransportError;

/// Set permanently by SIGTERM or SIGINT, because systemd sends SIGCONT right after SIGTERM.
static END: LazyLock<Arc<AtomicBool>> = LazyLock::new(|| {
    // When iceoryx2 0.10.0 creates shared memory, it replaces all signal handlers once per process. If its
    // handlers are installed first, those registered here stay and call them.
    let asked = SignalHandler::termination_requested();
    let end = Arc::new(AtomicBool::new(asked));
    for signal in [SIGTERM, SIGINT] {
        // Fails only for signals that no program may catch.
        let _registered = signal_hook::flag::register(signal, Arc::clone(&end));
    }
    end
});

/// Whether the process was asked to end (SIGTERM or SIGINT) since the first call.
pub fn end_requested() -> bool {
    END.load(Ordering::Relaxed)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    Kill,
    Freeze,
    Continue,
}

pub fn signal(pid: u32, signal: Signal) -> Result<(), TransportError> {
    let doing = || format!("sending {signal:?} to process {pid}");
    let os_signal = match signal {
        Signal::Kill => OsSignal::Kill,
        Signal::Freeze => OsSignal::StopExecution,
        Signal::Continue => OsSignal::Continue,
    };
    // Zero and negative numbers denote process groups.
    let id = i32::try_from(pid)
        .ok()
        .filter(|id| *id > 0)
        .ok_or_else(|| TransportError::because(doing(), "not the number of a process"))?;
    Process::from_pid(ProcessId::new(id))
        .send_signal(os_signal)
        .map_err(|e| TransportError::because(doing(), e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::{Instance, Memory, Services};
    use signal_hook::{consts::SIGCONT, low_level::raise};
    use std::{process::Command, time::Duration};

    const ASKED: &str = "ALIGHT_TEST_END";

    #[test]
    fn end_request_followed_by_another_signal() {
        let name = "signal::tests::end_request_followed_by_another_signal";
        if std::env::var_os(ASKED).is_none() {
            let program = std::env::current_exe().unwrap();
            let mut asked = Command::new(program);
            asked.args([name, "--exact"]).env(ASKED, "1");
            assert!(asked.output().unwrap().status.success());
            return;
        }
        let instance = Instance::new(&format!("end-test-{}", std::process::id())).unwrap();
        instance.wipe().unwrap();
        let memory = Memory::join(&instance, "test").unwrap();
        let services = Services::create(&memory).unwrap();
        let span = Duration::from_millis(1);
        assert!(memory.wait(span));
        raise(SIGCONT).unwrap();
        assert!(memory.wait(span), "other signals do not end the process");
        raise(SIGTERM).unwrap();
        raise(SIGCONT).unwrap();
        for _ in 0..2 {
            assert!(!memory.wait(span), "a request to end is kept");
        }
        drop((services, memory));
        instance.wipe().unwrap();
        std::fs::remove_dir_all(instance.directory()).unwrap();
    }
}
