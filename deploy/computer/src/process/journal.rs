//! Journal of a process: lines on standard error, which systemd keeps. A separate thread writes them, so that
//! no process waits for a slow journal or a stopped terminal. Lines beyond the queue's capacity are dropped.

use core::fmt;
use std::io::stderr;

use alight_transport::rejections;
use rustix::fs::fstat;
use tracing::{Event, Level, Subscriber, level_filters::LevelFilter};
use tracing_appender::non_blocking::{NonBlockingBuilder, WorkerGuard};
use tracing_subscriber::{
    Layer,
    filter::Targets,
    fmt::{
        FmtContext, FormatEvent, FormatFields,
        format::{Format, Full, Writer},
    },
    layer::SubscriberExt,
    registry::LookupSpan,
    util::SubscriberInitExt,
};

const MAX_LINES: usize = 1000;

/// Sends log events to the journal until the returned guard is dropped, which writes the queued lines. Also counts
/// rejected radio peers.
pub fn init() -> WorkerGuard {
    let (lines, guard) = NonBlockingBuilder::default()
        .lossy(true)
        .buffered_lines_limit(MAX_LINES)
        .finish(stderr());
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(lines)
        .with_ansi(false)
        // A failure to write standard error cannot be reported there, and would end the process.
        .log_internal_errors(false)
        .event_format(Line {
            with_priority: is_journal(),
            text: tracing_subscriber::fmt::format()
                .with_ansi(false)
                .with_level(false)
                .with_target(false)
                .without_time(),
        });
    let own = Targets::new().with_target("alight", LevelFilter::INFO);
    let all = tracing_subscriber::registry()
        .with(rejections::layer())
        .with(lines.with_filter(own));
    let _another = all.try_init();
    guard
}

/// Whether standard error is systemd's journal: the variable names the stream's device and inode (systemd.exec(5)).
fn is_journal() -> bool {
    let named = std::env::var("JOURNAL_STREAM").unwrap_or_default();
    fstat(stderr()).is_ok_and(|stream| named == format!("{}:{}", stream.st_dev, stream.st_ino))
}

/// Format of a line; the journal's lines begin with their priority (sd-daemon(3)).
struct Line {
    with_priority: bool,
    text: Format<Full, ()>,
}

impl<S, N> FormatEvent<S, N> for Line
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut to: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        if self.with_priority {
            let priority = match *event.metadata().level() {
                Level::ERROR => 3,
                Level::WARN => 4,
                Level::INFO => 6,
                Level::DEBUG | Level::TRACE => 7,
            };
            write!(to, "<{priority}>")?;
        }
        self.text.format_event(context, to, event)
    }
}
