//! Warnings and errors of iceoryx2: all are counted, few logged, because each message may cause one.

use std::{
    fmt::Arguments,
    sync::atomic::{AtomicU64, Ordering},
};

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
    use std::sync::Arc;
    use tracing_subscriber::layer::{Context, Layer, SubscriberExt};

    /// Number of lines in the log of this thread.
    #[derive(Clone, Default)]
    struct Lines(Arc<AtomicU64>);

    impl<S: tracing::Subscriber> Layer<S> for Lines {
        fn on_event(&self, _: &tracing::Event<'_>, _: Context<'_, S>) {
            self.0.fetch_add(1, Ordering::Relaxed);
        }
    }

    #[test]
    fn counted_and_logged_warnings_of_iceoryx2() {
        listen();
        let lines = Lines::default();
        let log = tracing_subscriber::registry().with(lines.clone());
        let before = counted();
        let emitted = 8 * (before + 64);
        tracing::subscriber::with_default(log, || {
            for chunks in 0..emitted {
                iceoryx2_log::warn!(from "test", "lost {chunks} chunks");
                iceoryx2_log::debug!(from "test", "not a warning");
            }
        });
        let counted = counted() - before;
        assert!(counted >= emitted, "{counted}");
        // Other tests may cause warnings, too: one of them may be the second, fourth, and so on.
        let logged = lines.0.load(Ordering::Relaxed);
        assert!((2..=12).contains(&logged), "{logged} of {emitted}");
    }
}
