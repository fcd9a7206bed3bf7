//! Warnings and errors of iceoryx2: all are counted, few logged, because each message may cause one.

use std::fmt::Arguments;
use std::sync::atomic::{AtomicU64, Ordering};

use iceoryx2::prelude::{LogLevel, set_log_level, set_logger};
use iceoryx2_log::Log;
use tracing::warn;

static COUNTED: AtomicU64 = AtomicU64::new(0);

pub fn counted() -> u64 {
    COUNTED.load(Ordering::Relaxed)
}

pub(super) fn listen() {
    let _again = set_logger(&Counter);
    set_log_level(LogLevel::Warn);
}

struct Counter;

impl Log for Counter {
    fn log(&self, _level: LogLevel, _origin: Arguments, text: Arguments) {
        let number = COUNTED.fetch_add(1, Ordering::Relaxed).saturating_add(1);
        // Only powers of two are logged, so that any number of warnings fits into the journal.
        if number.is_power_of_two() {
            warn!("shared memory: warning {number} of this process: {text}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counted_warnings_of_iceoryx2() {
        listen();
        let before = counted();
        iceoryx2_log::warn!(from "test", "lost {} chunks", 3);
        iceoryx2_log::debug!(from "test", "not a warning");
        let count = counted() - before;
        assert!(count >= 1, "{count}");
    }
}
