//! What a process reports to people: into the journal where a service's manager started it, as plain lines
//! on standard error elsewhere.

use std::io::stderr;

use alight_shared::transport::rejections;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{Layer, fmt};

/// Reports go there from now on; who was refused at the radio is counted besides.
pub fn init() {
    let own = || Targets::new().with_target(env!("CARGO_PKG_NAME"), LevelFilter::INFO);
    // systemd sets this for what it connects to its journal (systemd.exec(5)).
    let service = std::env::var_os("JOURNAL_STREAM").is_some();
    let journal = service.then(|| tracing_journald::layer().ok()).flatten();
    let lines = fmt::layer()
        .with_writer(stderr)
        .with_ansi(false)
        .with_level(false)
        // Where standard error cannot be written, the report of that cannot either, and would end the process.
        .log_internal_errors(false)
        .with_target(false)
        .without_time();
    let lines = journal.is_none().then(|| lines.with_filter(own()));
    let all = tracing_subscriber::registry()
        .with(rejections::layer())
        .with(journal.map(|layer| layer.with_filter(own())))
        .with(lines);
    // A test may have set another before.
    let _another = all.try_init();
}
