//! Attempts to open the session: successes, time of the next one, and errors to report.

use crate::TransportError;

/// Pause after the first failure, ns; each further failure doubles it.
const FIRST_PAUSE_NS: i64 = 1_000_000_000;
/// Maximum pause, ns, for a drone in flight.
const MAX_PAUSE_NS: i64 = 10_000_000_000;

#[derive(Debug, Default)]
pub(super) struct Attempts {
    opened: u64,
    /// Pause before the next attempt and its time, ns; None after a success.
    next: Option<(i64, i64)>,
    reported: Option<String>,
}

impl Attempts {
    pub(super) fn succeeded(&mut self) {
        self.opened = self.opened.saturating_add(1);
        self.next = None;
        self.reported = None;
    }
    /// Records a failure at `now_ns` and schedules the next attempt. Returns the error if it is new.
    pub(super) fn failed(&mut self, now_ns: i64, why: &TransportError) -> Option<String> {
        let pause_ns = self.next.map_or(FIRST_PAUSE_NS, |(pause_ns, _)| {
            pause_ns.saturating_mul(2).min(MAX_PAUSE_NS)
        });
        self.next = Some((pause_ns, now_ns.saturating_add(pause_ns)));
        let why = why.to_string();
        let is_news = self.reported.as_ref() != Some(&why);
        self.reported = Some(why.clone());
        is_news.then(|| {
            format!(
                "{why}; the radio is opened again later: if this continues, check [radio] in the configuration \
                 (alight check)"
            )
        })
    }
    pub(super) fn is_pausing(&self) -> bool {
        self.next.is_some()
    }
    pub(super) fn is_due(&self, now_ns: i64) -> bool {
        self.next.is_some_and(|(_, at_ns)| now_ns >= at_ns)
    }
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
        // Pauses grow, and a repeated error is reported once.
        let mut now = 0;
        let mut pauses = Vec::new();
        let mut reported = 0;
        for _ in 0..8 {
            reported += usize::from(attempts.failed(now, &error("no key")).is_some());
            let due = (0..)
                .map(|s| now + s * 1_000_000_000)
                .find(|t| attempts.is_due(*t));
            pauses.push((due.unwrap() - now) / 1_000_000_000);
            now = due.unwrap();
        }
        assert_eq!((pauses, reported), (vec![1, 2, 4, 8, 10, 10, 10, 10], 1));
        assert!(
            attempts
                .failed(now, &error("no room"))
                .unwrap()
                .contains("no room")
        );
        // A success ends the pauses; the first is not a reopening.
        attempts.succeeded();
        assert!(!attempts.is_pausing() && attempts.reopened() == 0);
        assert!(attempts.failed(now, &error("no room")).is_some());
        assert!(attempts.is_due(now + FIRST_PAUSE_NS));
        attempts.succeeded();
        assert_eq!(attempts.reopened(), 1);
    }
}
