//! Periodic scheduling.

use crate::time::{Span, Time};

/// When something periodic is due: on the period's grid, without catching up after a pause.
#[derive(Clone, Copy, Debug)]
pub struct Periodic<C> {
    next: Option<Time<C>>,
}

impl<C> Default for Periodic<C> {
    fn default() -> Self {
        Periodic { next: None }
    }
}

impl<C> Periodic<C> {
    /// Whether it is due at `now`; the first time at once. The next time is a `period` later on the grid,
    /// or a `period` from now when that has passed.
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
    fn periodic_keeps_its_grid_and_does_not_catch_up_after_a_pause() {
        let mut p = Periodic::<DroneClock>::default();
        let at = |ms: i64| Time::from_nanos(ms * 1_000_000);
        let mut due = |ms| p.is_due(at(ms), Span::from_millis(100));
        assert!(due(0) && !due(99) && due(120), "late by 20 ms");
        assert!(!due(199) && due(200), "the grid did not move");
        assert!(due(1050) && !due(1149) && due(1150), "one after a pause, then a new grid");
    }
}
