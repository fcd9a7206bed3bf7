//! Retransmission of a command until its receiver shows that it has taken it.

use crate::time::{Clock, Span, Time};

/// A command under way, on the sender's clock. Its repetitions bear the time at which it was given, so that its receiver
/// knows them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Retransmission<C: Clock> {
    period: Span,
    due: Time<C>,
    end: Time<C>,
}

impl<C: Clock> Retransmission<C> {
    /// Given at `now`: sent at once, and each `period` until `timeout`.
    pub fn new(now: Time<C>, period: Span, timeout: Span) -> Self {
        Retransmission {
            period,
            due: now,
            end: now + timeout,
        }
    }
    /// Whether it is to be sent now.
    pub fn is_due(&mut self, now: Time<C>) -> bool {
        let due = now >= self.due && !self.is_over(now);
        if due {
            self.due = now + self.period;
        }
        due
    }
    /// Nothing more is waited for.
    pub fn is_over(&self, now: Time<C>) -> bool {
        now > self.end
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::DroneClock;

    #[test]
    fn repetitions_until_the_timeout() {
        let at = |ms: i64| Time::<DroneClock>::from_nanos(ms * 1_000_000);
        let [period, timeout] = [500, 1900].map(Span::from_millis);
        let mut r = Retransmission::new(at(1000), period, timeout);
        let sent: Vec<i64> = (1000..5000).step_by(50).filter(|ms| r.is_due(at(*ms))).collect();
        assert_eq!(sent, [1000, 1500, 2000, 2500]);
        assert!(!r.is_over(at(2900)) && r.is_over(at(2901)));
    }
}
