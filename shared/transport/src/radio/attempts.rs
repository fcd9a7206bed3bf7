//! Openings of the session: how many succeeded, when one that failed is tried again, and which of their errors is news.

use crate::TransportError;

/// The pause after the first failure, ns; each further one doubles it.
const FIRST_PAUSE_NS: i64 = 1_000_000_000;
/// The longest pause, ns: a drone in flight waits for it.
const MAX_PAUSE_NS: i64 = 10_000_000_000;

/// What became of the openings so far.
#[derive(Debug, Default)]
pub(super) struct Attempts {
    opened: u64,
    /// The pause before the next attempt, ns, and when that is due; None: none has failed since the last that succeeded.
    next: Option<(i64, i64)>,
    /// The error that was said last.
    said: Option<String>,
}

impl Attempts {
    /// A session is open.
    pub(super) fn succeeded(&mut self) {
        self.opened = self.opened.saturating_add(1);
        (self.next, self.said) = (None, None);
    }
    /// One failed at `now_ns`: it is tried again after a pause, and what is to be said of it, if that is another error
    /// than the one before.
    pub(super) fn failed(&mut self, now_ns: i64, why: &TransportError) -> Option<String> {
        let pause_ns = self.next.map_or(FIRST_PAUSE_NS, |(pause_ns, _)| {
            pause_ns.saturating_mul(2).min(MAX_PAUSE_NS)
        });
        self.next = Some((pause_ns, now_ns.saturating_add(pause_ns)));
        let why = why.to_string();
        let is_news = self.said.as_ref() != Some(&why);
        self.said = Some(why.clone());
        is_news.then(|| {
            format!(
                "{why}; the radio stays closed and is tried again: if this goes on, look at what [radio] of the \
                 configuration names (alight check)"
            )
        })
    }
    /// Whether one has failed and the next waits for its time.
    pub(super) fn is_pausing(&self) -> bool {
        self.next.is_some()
    }
    /// Whether the next is due.
    pub(super) fn is_due(&self, now_ns: i64) -> bool {
        self.next.is_some_and(|(_, at_ns)| now_ns >= at_ns)
    }
    /// How often a session was opened after the first.
    pub(super) fn reopened(&self) -> u64 {
        self.opened.saturating_sub(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn openings_that_fail_again_and_again() {
        let error = |what: &str| TransportError {
            doing: "opening".into(),
            what: what.into(),
        };
        let mut attempts = Attempts::default();
        assert!(!attempts.is_due(i64::MAX) && !attempts.is_pausing());
        // The pauses grow, and the same error is said once.
        let (mut now, mut pauses, mut said) = (0, Vec::new(), 0);
        for _ in 0..8 {
            said += usize::from(attempts.failed(now, &error("no key")).is_some());
            let due = (0..)
                .map(|s| now + s * 1_000_000_000)
                .find(|t| attempts.is_due(*t));
            pauses.push((due.unwrap() - now) / 1_000_000_000);
            now = due.unwrap();
        }
        assert_eq!((pauses, said), (vec![1, 2, 4, 8, 10, 10, 10, 10], 1));
        assert!(
            attempts
                .failed(now, &error("no room"))
                .unwrap()
                .contains("no room")
        );
        // One that succeeds ends it; the first is no reopening.
        attempts.succeeded();
        assert!(!attempts.is_pausing() && attempts.reopened() == 0);
        assert!(attempts.failed(now, &error("no room")).is_some());
        assert!(attempts.is_due(now + FIRST_PAUSE_NS));
        attempts.succeeded();
        assert_eq!(attempts.reopened(), 1);
    }
}
