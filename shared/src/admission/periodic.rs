//! Periodic scheduling.

use crate::time::{Clock, Span, Time};

/// Schedule of a periodic task on a fixed time grid. Runs missed during a pause are not made up.
#[derive(Clone, Copy, Debug, Default)]
pub struct Periodic<C: Clock> {
    next: Option<Time<C>>,
}

impl<C: Clock> Periodic<C> {
    /// Whether the task is due or has never run.
    pub fn is_ready(&self, now: Time<C>) -> bool {
        self.next.is_none_or(|next| now >= next)
    }
    /// Sets the next time to one `period` from now.
    pub fn restart(&mut self, now: Time<C>, period: Span) {
        self.next = Some(now + period);
    }
    /// Whether the task is due, at least one `period` after its last run; the first call returns true.
    pub fn is_due_spaced(&mut self, now: Time<C>, period: Span) -> bool {
        let ready = self.is_ready(now);
        if ready {
            self.restart(now, period);
        }
        ready
    }
    /// Whether the task is due; the first call returns true. The next run is one `period` later on the grid,
    /// or a new grid starts if that time has passed.
    pub fn is_due(&mut self, now: Time<C>, period: Span) -> bool {
        let next = match self.next {
            Some(t) if now < t => return false,
            Some(t) if t + period > now => t + period,
            Some(_) | None => now + period,
        };
        self.next = Some(next);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::DroneClock;

    #[test]
    fn periodic_after_a_pause() {
        let mut p = Periodic::<DroneClock>::default();
        let at = |ms: i64| Time::from_nanos(ms * 1_000_000);
        let mut due = |ms| p.is_due(at(ms), Span::from_millis(100));
        assert!(due(0) && !due(99) && due(120), "late by 20 ms");
        assert!(!due(199) && due(200), "the grid did not move");
        assert!(
            due(1050) && !due(1149) && due(1150),
            "one after a pause, then a new grid"
        );
    }
}
